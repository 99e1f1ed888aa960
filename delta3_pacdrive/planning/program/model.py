"""Data model of motion programs: statements and their parameters."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.configuration.fields import contextual, entries, internal, positive, quantity, read_by
from delta3_pacdrive.configuration.source_positions import Place
from delta3_pacdrive.configuration.strict_reader import refuse
from delta3_pacdrive.configuration.value_readers import finite_numbers, flag, number
from delta3_pacdrive.planning.limits.limit_reader import blend
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.curves import SPLINE_POINTS_MAX
from delta3_pacdrive.robot.faults.fault import Fault

Point = tuple[float, float, float]
# of a joint trajectory: reception of a message with as many takes the planner's node 3 s on a slow machine
JOINT_POINTS_MAX = 30_000
SHIFT_MAX_S = 10.0  # of an output
CLEARANCE_MAX_M = 1.0  # of an arch
REACH_M = 10.0
TIME_MAX_S = 3600.0
ARC_TURNS_MAX = 100
ARC_MAX_RAD, ARC_ROUNDING_RAD = ARC_TURNS_MAX * math.tau, 1e-9


def _arc_angle(value: Any, where: str) -> float:
    angle = number(value, where)
    if not 0.0 < angle <= ARC_MAX_RAD + ARC_ROUNDING_RAD:
        refuse(
            f'{where} is {angle:g} rad, but must be positive and at most {ARC_MAX_RAD:.6g} rad '
            f'({ARC_TURNS_MAX} turns); exchange via and to for the other direction'
        )
    return angle


@dataclass(frozen=True)
class Target:
    """A point [m], or a displacement from the current position."""

    point_m: Point
    relative: bool = False


@dataclass(frozen=True)
class Angle:
    """A tool angle about z [rad], or a rotation from the current angle."""

    angle_rad: float
    relative: bool = False

    def after(self, present_rad: float) -> float:
        """Return the resulting tool angle [rad]."""
        return present_rad + self.angle_rad if self.relative else self.angle_rad


@dataclass(frozen=True, kw_only=True)
class PathMove:
    """A move along a path.

    A ``strict`` move is rejected instead of slowed down. With ``constant_speed`` the path, with all moves blended with
    it, is rejected unless its speed is constant. With ``in_position`` the program continues only when the robot has
    settled at the end. A ``time_optimal`` move is as fast as the motors allow within its limits and its torque rate.
    With ``turns``, angles of the first rotary axes, the tool rotates along the path from the start of the move to its
    end.
    """

    limits: Limits = internal()
    blend_m: float = read_by(blend, default=0.0)
    strict: bool = False
    time_optimal: bool = False
    torque_rate_n_m_s: float = internal(default=math.inf)
    in_position: bool = False
    constant_speed: bool = False
    turns: tuple[Angle, ...] = contextual('angles', key='turn_rad', default=())


@dataclass(frozen=True)
class MoveL(PathMove):
    """Straight line to a point (6.1)."""

    to: Target = contextual('target', key='to_m')


@dataclass(frozen=True)
class MoveC(PathMove):
    """Circle through a circle point to an end (6.2), or over an angle [rad] on that circle in the same direction."""

    via: Target = contextual('target', key='via_m')
    to: Target = contextual('target', key='to_m')
    angle_rad: float | None = read_by(_arc_angle, default=None)


@dataclass(frozen=True)
class MoveSB(PathMove):
    """Cubic spline through points (6.3)."""

    through: tuple[Target, ...] = entries('points', 1, SPLINE_POINTS_MAX, key='through_m')


class Aim(StrEnum):
    """Objective of the shape of an arch."""

    TIME = 'time'
    ENERGY = 'energy'


@dataclass(frozen=True)
class KeepOut:
    """Minimum height z of a path except near its ends."""

    height_m: float = quantity('minimum height', -REACH_M, REACH_M)
    margin_m: float = quantity(
        'horizontal distance from an end within which the path may be lower', 0.0, REACH_M, default=0.0
    )


@dataclass(frozen=True)
class Arch(PathMove):
    """Arch from pick to place: straight up by a clearance, across, and straight down by another one.

    Height and bends are optimized for the shortest time or the least energy.
    """

    to: Target = contextual('target', key='to_m')
    up_m: float = quantity('clearance after the start', 0.0, CLEARANCE_MAX_M)
    down_m: float = quantity('clearance before the end', 0.0, CLEARANCE_MAX_M)
    keep_out: KeepOut | None = contextual('keep_out', default=None)
    aim: Aim = Aim.TIME


@dataclass(frozen=True)
class Cubic:
    """Cubic in time with given end velocity; it starts with the end velocity of the preceding cubic (5.1)."""

    to: Target = contextual('target', key='to_m')
    duration_s: float = quantity('duration', 1e-3, TIME_MAX_S)
    end_velocity_m_s: Point = contextual('velocity', default=(0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Turn:
    """Rotation of the tool at a fixed TCP to angles of its first rotary axes, as fast as they allow."""

    turns: tuple[Angle, ...] = contextual('angles', key='to_rad')


@dataclass(frozen=True)
class Dwell:
    """Rest at the current point."""

    time_s: float = positive('duration', TIME_MAX_S)


@dataclass(frozen=True)
class Output:
    """Change of an output, and optionally of the payload, at or near the end of the preceding move.

    Distances are along the path, times at override 1. At most one of the four shifts is given; timed outputs cannot
    change the payload.
    """

    name: str = contextual('output')
    value: float = read_by(lambda value, where: float(flag(value, where)))
    before_m: float = quantity('before the end of the move', 0.0, REACH_M, default=0.0)
    payload_kg: float | None = contextual('payload', default=None)
    after_m: float = quantity('after the end of the move', 0.0, REACH_M, default=0.0)
    before_s: float = quantity('before the end of the move', 0.0, SHIFT_MAX_S, default=0.0)
    after_s: float = quantity('after the end of the move', 0.0, SHIFT_MAX_S, default=0.0)

    @property
    def is_later(self) -> bool:
        """Whether it is due after the end of the preceding move."""
        return self.after_m > 0.0 or self.after_s > 0.0


@dataclass(frozen=True)
class JointPoint:
    """Arm angles at a time after the start, optionally with speeds, or with speeds and accelerations."""

    time_s: float = quantity('after the start', 0.0, TIME_MAX_S)
    angles_rad: Point = read_by(finite_numbers('rad'))
    speeds_rad_s: Point | None = read_by(finite_numbers('rad/s'), default=None)
    accelerations_rad_s2: Point | None = read_by(finite_numbers('rad/s2'), default=None)


@dataclass(frozen=True)
class Joints:
    """Arm angles over time, from rest to rest; rejected instead of slowed down."""

    points: tuple[JointPoint, ...] = entries('points', 1, JOINT_POINTS_MAX)
    strict: ClassVar[bool] = True


Statement = MoveL | MoveC | MoveSB | Arch | Cubic | Joints | Turn | Dwell | Output
KINDS: dict[type[Statement], str] = {
    MoveL: 'move_l',
    MoveC: 'move_c',
    MoveSB: 'move_sb',
    Arch: 'arch',
    Cubic: 'cubic',
    Joints: 'joints',
    Turn: 'turn',
    Dwell: 'dwell',
    Output: 'output',
}


@dataclass(frozen=True)
class Program:
    """Statements to execute ``repeat`` times."""

    name: str
    statements: tuple[Statement, ...]
    start_m: Point | None = None
    repeat: int = 1
    payload_kg: float | None = None
    faults: tuple[Fault, ...] = ()
    start_turns_rad: tuple[float, ...] = ()  # required angles of the first rotary axes at the start
    source: str = field(default='', compare=False)  # program file
    places: tuple[Place | None, ...] = field(default=(), compare=False)  # of the statements in the file
    names: tuple[str, ...] = field(default=(), compare=False)  # of statements in messages (default: by index)

    def name_of(self, number: int) -> str:
        """Return the name of a statement for messages."""
        name = self.names[number] if number < len(self.names) else ''
        return name or f'moves[{number}].{KINDS[type(self.statements[number])]}'

    def place_of(self, number: int) -> Place | None:
        """Return the position of a statement in its file, if known."""
        return self.places[number] if number < len(self.places) else None


def turns_of(statement: Statement) -> tuple[Angle, ...]:
    """Return the angles of the first rotary axes after a statement; empty if it does not turn the tool."""
    return statement.turns if isinstance(statement, PathMove | Turn) else ()


def point_of(values: ArrayLike) -> Point:
    """Convert three numbers to a point."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def point_text(point_m: ArrayLike) -> str:
    """Format a point for messages."""
    return '(' + ', '.join(f'{value:g}' for value in np.round(np.asarray(point_m), 6)) + ')'
