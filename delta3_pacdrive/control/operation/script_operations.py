"""Operations of a script on its robot, and the state that it reads; the same in a simulation and on the bus.

The table ``OPERATIONS`` has all requests of a script to a running robot. Their arguments are text on the way.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, astuple, dataclass
from typing import Any, NamedTuple, Self

from delta3_pacdrive.axes import ROTARY_AXES_MAX, numbered
from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.control.cycle.servo import checked_limits
from delta3_pacdrive.control.cycle.set_points import SetPoint
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.motion_state import UNDER_WAY, MotionState
from delta3_pacdrive.control.operation.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program.model import Point


@dataclass(frozen=True)
class Snapshot:
    """State of the robot in the latest evaluated bus cycle."""

    cycle: int
    motion: MotionState
    command_m: Point
    position_m: Point
    outputs: int  # bits
    payload_kg: float
    inputs: int  # bits
    planned_m: Point  # differs from command_m while the robot moves with a belt
    turns_rad: tuple[float, ...] = ()  # commanded angles of the rotary axes

    @classmethod
    def of(
        cls, task: Transformation, cycle: int, commanded: Commanded, motion: MotionState, inputs: int
    ) -> Self:
        """Return the state after the feedback of a bus cycle; ``motion`` may be that after a later command."""
        x, y, z = task.answer['tcp_command'].tolist()
        a, b, c = task.answer['tcp_actual'].tolist()
        if motion in UNDER_WAY:
            at_rest = MotionState.STOPPED if cycle >= commanded.end_cycle else MotionState.STOPPING
            motion = at_rest if commanded.held else MotionState.MOVING
        return cls(
            cycle,
            motion,
            command_m=(x, y, z),
            position_m=(a, b, c),
            outputs=commanded.outputs,
            payload_kg=commanded.payload_kg,
            inputs=inputs,
            planned_m=(x, y, z) if commanded.tracked is None else commanded.planned_m,
            turns_rad=commanded.turns_rad,
        )

    def to_document(self) -> dict[str, Any]:
        """Return the state for JSON; the angles of the rotary axes present are ``turn_rad`` and ``turn_rad_2``."""
        document = asdict(self)
        turns_rad = document.pop('turns_rad')
        return document | {numbered('turn_rad', number): angle for number, angle in enumerate(turns_rad)}

    @classmethod
    def from_document(cls, document: dict[str, Any]) -> Self:
        """Return the state of ``to_document``; ``planned_m`` may be missing."""
        values = {'planned_m': document['command_m'], **document}
        names = sorted({numbered('turn_rad', number) for number in range(ROTARY_AXES_MAX)} & values.keys())
        values['motion'] = MotionState(values['motion'])
        values['turns_rad'] = tuple(values.pop(name) for name in names)
        fields: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in values.items()
        }
        return cls(**fields)


@dataclass(frozen=True)
class ScriptOperation:
    """Operation of a script on a running robot, and the conversion of its argument; ``read`` raises Delta3Error."""

    name: str
    write: Callable[[Any], str] = lambda _: ''
    read: Callable[[str], Any] = lambda _: None


def _cycle_of(text: str) -> int:
    if not text.isdecimal() or len(text) > 15:
        raise ProgramError(f'a bus cycle is needed, not {shown(text)}')
    return int(text)


def _track_order_of(text: str) -> TrackOrder:
    try:
        return TrackOrder.from_document(json.loads(text))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, OverflowError):
        raise ProgramError(f'an order is needed, not {shown(text)}') from None


class Steer(NamedTuple):
    """Let set points move the robot from a bus cycle on."""

    cycle: int
    limits: Limits


class Guide(NamedTuple):
    """A set point that counts from a bus cycle on."""

    cycle: int
    point: SetPoint


def _steer_of(text: str) -> Steer:
    try:
        cycle, *limits = json.loads(text)
        return Steer(int(cycle), checked_limits(Limits(*map(float, limits))))
    except (ValueError, TypeError, RecursionError, OverflowError):
        raise ProgramError(f'a bus cycle and three limits are needed, not {shown(text)}') from None


def _guide_of(text: str) -> Guide:
    try:
        cycle, point = json.loads(text)
        return Guide(int(cycle), SetPoint.from_document(point))
    except (ValueError, TypeError, KeyError, RecursionError, OverflowError):
        raise ProgramError(f'a bus cycle and a set point are needed, not {shown(text)}') from None


ATTACH = ScriptOperation('attach')
POLL = ScriptOperation('look')
WAIT = ScriptOperation('wait', WaitCondition.to_json, WaitCondition.from_json)
HOLD = ScriptOperation('hold', str, _cycle_of)
TRACK = ScriptOperation('get on', lambda order: json.dumps(order.to_document()), _track_order_of)
TRACK_AGAIN = ScriptOperation('get on again', str, _cycle_of)
STEER = ScriptOperation('steer', lambda steer: json.dumps([steer.cycle, *astuple(steer.limits)]), _steer_of)
GUIDE = ScriptOperation(
    'set point', lambda guide: json.dumps([guide.cycle, guide.point.to_document()]), _guide_of
)
CANCEL = ScriptOperation('abandon', str, _cycle_of)
END = ScriptOperation('leave')
OPERATIONS = {
    one.name: one for one in (ATTACH, POLL, WAIT, HOLD, TRACK, TRACK_AGAIN, STEER, GUIDE, CANCEL, END)
}
