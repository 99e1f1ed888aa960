"""Data model of motion programs: statements and their parameters."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.configuration.source_positions import Place
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.robot.faults.fault import Fault

Point = tuple[float, float, float]
JOINT_POINTS_MAX = 10_000  # of a joint trajectory
ASKED_POINTS_MAX = 1000  # of a joint trajectory in a message for immediate execution


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

    limits: Limits
    blend_m: float = 0.0
    strict: bool = False
    time_optimal: bool = False
    torque_rate_n_m_s: float = math.inf
    in_position: bool = False
    constant_speed: bool = False
    turns: tuple[Angle, ...] = ()


@dataclass(frozen=True)
class MoveL(PathMove):
    """Straight line to a point (6.1)."""

    to: Target


@dataclass(frozen=True)
class MoveC(PathMove):
    """Circle through a circle point to an end (6.2), or over an angle [rad] on that circle in the same direction."""

    via: Target
    to: Target
    angle_rad: float | None = None


@dataclass(frozen=True)
class MoveSB(PathMove):
    """Cubic spline through points (6.3)."""

    through: tuple[Target, ...]


class Aim(StrEnum):
    """Objective of the shape of an arch."""

    TIME = 'time'
    ENERGY = 'energy'


@dataclass(frozen=True)
class KeepOut:
    """Minimum height z of a path except near its ends."""

    height_m: float
    margin_m: float = 0.0  # horizontal distance from an end within which the path may be lower


@dataclass(frozen=True)
class Arch(PathMove):
    """Arch from pick to place: straight up by a clearance, across, and straight down by another one.

    Height and bends are optimized for the shortest time or the least energy.
    """

    to: Target
    up_m: float
    down_m: float
    keep_out: KeepOut | None = None
    aim: Aim = Aim.TIME


@dataclass(frozen=True)
class Cubic:
    """Cubic in time with given end velocity; it starts with the end velocity of the preceding cubic (5.1)."""

    to: Target
    duration_s: float
    end_velocity_m_s: Point = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Turn:
    """Rotation of the tool at a fixed TCP to angles of its first rotary axes, as fast as they allow."""

    turns: tuple[Angle, ...]


@dataclass(frozen=True)
class Dwell:
    """Rest at the current point."""

    time_s: float


@dataclass(frozen=True)
class Output:
    """Change of an output, and optionally of the payload, at or near the end of the preceding move.

    Distances are along the path, times at override 1. At most one of the four shifts is given; timed outputs cannot
    change the payload.
    """

    name: str
    value: float
    before_m: float = 0.0
    payload_kg: float | None = None
    after_m: float = 0.0
    before_s: float = 0.0
    after_s: float = 0.0

    @property
    def is_later(self) -> bool:
        """Whether it is due after the end of the preceding move."""
        return self.after_m > 0.0 or self.after_s > 0.0


@dataclass(frozen=True)
class JointPoint:
    """Arm angles at a time after the start, optionally with speeds, or with speeds and accelerations."""

    time_s: float
    angles_rad: Point
    speeds_rad_s: Point | None = None
    accelerations_rad_s2: Point | None = None


@dataclass(frozen=True)
class Joints:
    """Arm angles over time, from rest to rest; rejected instead of slowed down."""

    points: tuple[JointPoint, ...]
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
