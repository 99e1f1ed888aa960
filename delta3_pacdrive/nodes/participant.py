"""Announcement of bus participants: who is there, and what they were configured with."""

from dataclasses import asdict, fields

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node

from delta3_pacdrive.bus.phases import PARTICIPANTS, Identity
from delta3_pacdrive.nodes.qos import LATCHED, LATCHED_FROM_MANY
from delta3_pacdrive.parameters import Parameters

TOPIC = 'sercos/participants'


class Participant:
    """Publishes the identity of one participant, for latecomers as well."""

    def __init__(self, node: Node, name: str, parameters: Parameters) -> None:
        self._publisher = node.create_publisher(DiagnosticStatus, TOPIC, LATCHED)
        self._name = name
        self._identity = Identity.of(parameters)
        self.announce()

    def announce(self, links: tuple[str, ...] = ()) -> None:
        """Publish the identity and the partners that have been heard."""
        facts = asdict(self._identity) | {'links': ' '.join(links)}
        message = DiagnosticStatus(name=self._name, message='present')
        message.values = [KeyValue(key=key, value=value) for key, value in facts.items()]
        self._publisher.publish(message)


class Roll:
    """What the master knows of the participants."""

    def __init__(self, node: Node) -> None:
        self.identities: dict[str, Identity] = {}
        self.links: dict[str, tuple[str, ...]] = {}
        node.create_subscription(DiagnosticStatus, TOPIC, self._on_announcement, LATCHED_FROM_MANY)

    def _on_announcement(self, message: DiagnosticStatus) -> None:
        facts = {item.key: item.value for item in message.values}
        links = facts.pop('links', '')
        if message.name in PARTICIPANTS and facts.keys() == {f.name for f in fields(Identity)}:
            self.identities[message.name] = Identity(**facts)
            self.links[message.name] = tuple(links.split())
