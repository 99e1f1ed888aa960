"""Announcements of bus participants on ``sercos/participants``: identity, session and configuration."""

import json
import secrets
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node

from delta3_pacdrive.belts.image import read_belts
from delta3_pacdrive.control.messages import TEXT_MAX
from delta3_pacdrive.errors import TelegramError, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.signals import CELL_BELTS, CELL_INPUTS
from delta3_pacdrive.robot.faults.fault import UNIT_ROBOT
from delta3_pacdrive.robot.sercos.configuration_check import PARTICIPANTS, Identity
from delta3_pacdrive.robot.sercos.participants import Announcement, Occasion
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import interfaces

CYCLE_DIGITS_MAX = 15
INSTANCE_DIGITS = 8


class Participant:
    """A bus participant that announces itself, also on request of nodes that start later."""

    def __init__(
        self, node: Node, name: str, parameters: Parameters, inputs: Sequence[str] = (), belts: str = '[]'
    ) -> None:
        self._publisher = interfaces.PARTICIPANTS.publisher(node)
        self._name, self._inputs = name, json.dumps(list(inputs))
        self._belts, self._identity = belts, Identity.of(parameters)
        self.instance = secrets.token_hex(INSTANCE_DIGITS // 2)  # differs after each start

    def announce(
        self,
        session: bytes,
        occasion: Occasion = Occasion.CALLED,
        links: tuple[str, ...] = (),
        bus_cycle: int = 0,
    ) -> None:
        """Publish the identity, the session, the linked partners and the bus time that has passed [cycles]."""
        facts = asdict(self._identity) | {'links': ' '.join(links), 'bus_cycle': str(bus_cycle)}
        facts |= {'session': session.decode(), 'inputs': self._inputs, 'belts': self._belts}
        message = DiagnosticStatus(name=self._name, message=str(occasion), hardware_id=self.instance)
        message.values = [KeyValue(key=key, value=value) for key, value in facts.items()]
        self._publisher.publish(message)


def read_announcement(message: DiagnosticStatus, names: Sequence[str] = PARTICIPANTS) -> Announcement:
    """Parse an announcement of one of ``names`` or of a planner; raises TelegramError."""
    facts = {item.key: item.value for item in message.values}
    links, bus_cycle, session = (facts.pop(key, '') for key in ('links', 'bus_cycle', 'session'))
    inputs, belts = _inputs(message.name, facts.pop('inputs', '[]')), facts.pop('belts', '[]')
    _require_belts(message.name, belts)
    if message.name not in (*names, UNIT_ROBOT) or facts.keys() != {f.name for f in fields(Identity)}:
        raise TelegramError(f'{shown(message.name)} announces itself without the required identity')
    if not bus_cycle.isdecimal() or len(bus_cycle) > CYCLE_DIGITS_MAX:
        raise TelegramError(f'{shown(message.name)} announces bus cycle {shown(bus_cycle)}, not a number')
    try:
        occasion = Occasion(message.message)
    except ValueError:
        raise TelegramError(
            f'{shown(message.name)} announces itself for an unknown reason: {shown(message.message)}'
        ) from None
    return Announcement(
        name=message.name,
        instance=message.hardware_id,
        session=session,
        occasion=occasion,
        identity=Identity(**facts),
        links=tuple(links.split()),
        bus_cycle=int(bus_cycle),
        inputs=inputs,
        belts=belts,
    )


def _require_belts(sender: str, text: str) -> None:
    """Raise TelegramError unless ``text`` describes valid belts."""
    try:
        known = len(read_belts(text)) <= CELL_BELTS
    except ValueError:
        known = False
    if not known:
        raise TelegramError(f'{shown(sender)} announces invalid belts {shown(text)}')


def _inputs(sender: str, text: str) -> tuple[str, ...]:
    """Return the names of the inputs; raises TelegramError."""
    try:
        names = json.loads(text)
    except (ValueError, RecursionError):
        names = None
    known = isinstance(names, list) and len(names) <= CELL_INPUTS and all(map(_is_name, names))
    if not known or len(set(names)) < len(names):
        raise TelegramError(f'{shown(sender)} announces invalid inputs {shown(text)}')
    return tuple(names)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= TEXT_MAX and value.isprintable()


def receive_announcements(
    node: RobotNode,
    take: Callable[[Announcement], None],
    refuse: Callable[[str], None],
    names: Sequence[str] = PARTICIPANTS,
) -> None:
    """Subscribe to the announcements of the participants with these names."""
    interfaces.PARTICIPANTS.bounded_subscription(
        node, lambda message: take(read_announcement(message, names)), refuse=refuse
    )
