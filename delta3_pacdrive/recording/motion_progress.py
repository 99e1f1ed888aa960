"""Report of the transformation task on bus and program: ``motion/progress`` and ``motion/progress/values``."""

import json
import math
import warnings
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Self

from delta3_pacdrive.configuration.json_message import JsonMessage, nullable
from delta3_pacdrive.errors import TelegramError, shown

NUMBER_MAX = 1e15  # beyond it whole numbers are not exact


@dataclass(frozen=True, kw_only=True)
class MotionProgress(JsonMessage):
    """State of bus and program; the keys of the message are the fields in their order.

    The defaults are those of a robot that has not reported yet.
    """

    number_max: ClassVar[float] = NUMBER_MAX
    further: ClassVar[str] = 'statistics'

    session: str = ''  # of the bus
    phase: str = ''  # of the bus
    waiting: str = ''  # what the bus waits for, empty if for nothing
    missing: tuple[str, ...] = ()  # participants that the bus waits for
    fault: str = (
        ''  # that stopped the robot, empty without one; the following fields as in ``RobotFault.facts``
    )
    fault_code: str = ''
    fault_number: int = 0
    fault_source: str = ''
    fault_cycle: int = 0
    state: str = ''  # of the motion
    finished: bool = False  # the program has ended
    settling: bool = False  # at the end of an exact stop
    in_torque: bool = False
    enabled: bool = False
    operator: str = ''  # name of the operator in control, empty without one
    operator_identity: str = ''
    control: int = 0  # number of changes of control
    # measured, None if not yet; nan if forward kinematics has no solution
    tcp_m: tuple[float, float, float] | None = nullable(nan=True)
    cycles: int = 0  # evaluated bus cycles
    bus_time_s: float = 0.0
    wall_time_s: float = 0.0
    move: int = 0  # index of the active move
    moves: int = 0
    end_s: float = 0.0  # bus time at which the program ends
    remaining_s: float | None = nullable()  # None while the robot is held
    master_m: float = 0.0
    master_speed_m_s: float = 0.0
    rate: float = 0.0  # override, 1 = as planned
    outputs: int = 0  # bit n is output n
    payload_kg: float = 0.0
    following_error_rad: float = 0.0  # largest of all arms
    overruns: int = 0
    slip_s: float = 0.0
    lost_telegrams: int = 0
    learned_torques: bool = False  # the program has some
    unlearned: str = ''  # why they are not followed, empty if they are
    repeated_telegrams: int = 0
    # measured angle of each rotary axis, if present
    turn_rad: float | None = None
    turn_rad_2: float | None = None
    # totals of bus and program, after the end of a program and with a fault
    statistics: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of_recording(cls, text: str) -> Self:
        """Read a recorded report, in which keys of later versions may be missing; raises TelegramError."""
        try:
            given = dict(json.loads(text))
        except (RecursionError, TypeError, ValueError):
            raise TelegramError(f'{shown(text)} is not a progress report') from None
        return cls.from_fields(NO_REPORT.to_fields() | given)

    def __getitem__(self, key: str) -> Any:
        """Return a value by its key; deprecated. Raises KeyError."""
        warnings.warn(f'progress[{key!r}] is now progress.{key}', FutureWarning, stacklevel=2)
        return self.to_fields()[key]

    @property
    def turns_rad(self) -> tuple[float, ...]:
        """Measured angles of the rotary axes."""
        return tuple(angle for angle in (self.turn_rad, self.turn_rad_2) if angle is not None)

    def numbers(self) -> dict[str, float]:
        """Return the numbers by name, for ``motion/progress/values``; all robots have the same, up to ``tcp_z_m``.

        Truth values are 0 or 1, as is ``fault``; values that are None are nan. Angles of rotary axes come last.
        """
        return {
            'fault': float(bool(self.fault)),
            **{name: float(getattr(self, name)) for name in _NUMBERS},
            'remaining_s': math.nan if self.remaining_s is None else self.remaining_s,
            **dict(zip(('tcp_x_m', 'tcp_y_m', 'tcp_z_m'), self.tcp_m or (math.nan,) * 3, strict=True)),
            **dict(zip(('turn_rad', 'turn_rad_2'), self.turns_rad, strict=False)),
        }

    @property
    def received(self) -> bool:
        """Whether this is a report of a robot."""
        return self is not NO_REPORT


_NUMBERS = tuple(own.name for own in fields(MotionProgress) if own.type in (bool, int, float))
NO_REPORT = MotionProgress()
