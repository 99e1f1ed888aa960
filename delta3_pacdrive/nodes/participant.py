"""Announcement of bus participants: who is there, and what they were configured with."""

from collections.abc import Callable
from dataclasses import asdict, fields

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node

from delta3_pacdrive.bus.phases import PARTICIPANTS, Identity
from delta3_pacdrive.injection import UNIT_ROBOT
from delta3_pacdrive.nodes.qos import LATCHED, LATCHED_FROM_MANY
from delta3_pacdrive.parameters import Parameters

TOPIC = 'sercos/participants'
CYCLE_DIGITS_MAX = 15
CALLED = 'answers the call'


class Participant:
    """Publishes the identity of one participant, for latecomers as well."""

    def __init__(self, node: Node, name: str, parameters: Parameters) -> None:
        self._publisher = node.create_publisher(DiagnosticStatus, TOPIC, LATCHED)
        self._name = name
        self._identity = Identity.of(parameters)
        self.announce()

    def announce(
        self, links: tuple[str, ...] = (), bus_cycle: int = 0, session: bytes = b'', called: bool = False
    ) -> None:
        """Publish the identity, the partners heard in a session and the bus time that is over [cycles].

        Who answers a call of CP0 (``called``) may be heard late; that makes nobody a newcomer.
        """
        facts = asdict(self._identity) | {'links': ' '.join(links), 'bus_cycle': str(bus_cycle)}
        facts['session'] = session.decode()
        message = DiagnosticStatus(name=self._name, message=CALLED if called else 'present')
        message.values = [KeyValue(key=key, value=value) for key, value in facts.items()]
        self._publisher.publish(message)


class Roll:
    """What the master knows of the participants.

    Attributes
    ----------
    identities
        Of those that are there.
    links
        Session of its last announcement and the partners that it has heard in it.
    planner
        Identity of UnitRobot, which takes no part in the bus; None before it was heard.
    bus_cycle
        First bus cycle that nobody has seen yet.

    """

    def __init__(self, node: Node, on_newcomer: Callable[[str], None]) -> None:
        self.identities: dict[str, Identity] = {}
        self.links: dict[str, tuple[bytes, tuple[str, ...]]] = {}
        self.planner: Identity | None = None
        self.bus_cycle = 0
        self._on_newcomer = on_newcomer
        self._closed = False
        self._newcomers: set[str] = set()
        node.create_subscription(DiagnosticStatus, TOPIC, self._on_announcement, LATCHED_FROM_MANY)

    def close(self) -> None:
        """Begin cyclic operation: who announces itself now comes too late, or comes back."""
        self._closed = True
        self._newcomers.clear()

    def call_again(self) -> None:
        """Forget everybody who has not come back meanwhile."""
        self._closed = False
        self.identities = {name: self.identities[name] for name in self._newcomers}
        self.links = {}

    def _on_announcement(self, message: DiagnosticStatus) -> None:
        facts = {item.key: item.value for item in message.values}
        links, bus_cycle, session = (facts.pop(key, '') for key in ('links', 'bus_cycle', 'session'))
        if message.name not in (*PARTICIPANTS, UNIT_ROBOT) or facts.keys() != {
            f.name for f in fields(Identity)
        }:
            return
        if not bus_cycle.isdecimal() or len(bus_cycle) > CYCLE_DIGITS_MAX:
            return
        if message.name == UNIT_ROBOT:
            self.planner = Identity(**facts)
            return
        self.identities[message.name] = Identity(**facts)
        self.links[message.name] = session.encode(), tuple(links.split())
        self.bus_cycle = max(self.bus_cycle, int(bus_cycle))
        if self._closed and message.message != CALLED:
            self._newcomers.add(message.name)
            self._on_newcomer(message.name)
