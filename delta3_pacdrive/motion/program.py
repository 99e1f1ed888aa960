"""Programs as values: what statements there are, and what each says."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.configuration.located import Place
from delta3_pacdrive.faults.fault import Fault
from delta3_pacdrive.motion.limits import Limits

Point = tuple[float, float, float]
JOINT_POINTS_MAX = 10_000  # of a trajectory of arm angles
ASKED_POINTS_MAX = 1000  # of one that is asked for by a message, to be driven at once


@dataclass(frozen=True)
class Target:
    """A point [m], or a step from where the robot stands."""

    point_m: Point
    relative: bool = False


@dataclass(frozen=True)
class Angle:
    """An angle of the tool about z [rad], or a step from where it stands."""

    angle_rad: float
    relative: bool = False

    def after(self, present_rad: float) -> float:
        """Return where the tool stands then [rad]."""
        return present_rad + self.angle_rad if self.relative else self.angle_rad


@dataclass(frozen=True, kw_only=True)
class PathMove:
    """A move along a path: its limits, the blend with the next move, and whether it is refused instead of slowed.

    With ``constant_speed`` its path, the blended moves around it included, is refused unless its speed is constant.

    Behind one that ends in position the program goes on only when the robot has followed there.
    A time-optimal one is as fast as the motors allow within its limits, and changes their torques no faster than its
    torque rate. With a turn the tool turns along the path, from the begin of the move to its end.
    """

    limits: Limits
    blend_m: float = 0.0
    strict: bool = False
    time_optimal: bool = False
    torque_rate_n_m_s: float = math.inf
    in_position: bool = False
    constant_speed: bool = False
    turn: Angle | None = None


@dataclass(frozen=True)
class MoveL(PathMove):
    """Straight line to a point (6.1)."""

    to: Target


@dataclass(frozen=True)
class MoveC(PathMove):
    """Circle through a circle point to an end (6.2), or on that circle over an angle [rad], in the same direction."""

    via: Target
    to: Target
    angle_rad: float | None = None


@dataclass(frozen=True)
class MoveSB(PathMove):
    """Cubic spline through points (6.3)."""

    through: tuple[Target, ...]


class Aim(StrEnum):
    """What the shape of an arch is best for."""

    TIME = 'time'
    ENERGY = 'energy'


@dataclass(frozen=True)
class KeepOut:
    """Nothing of the path may be below a height z, but around both of its ends."""

    height_m: float
    margin_m: float = 0.0  # horizontal distance from an end up to which it may


@dataclass(frozen=True)
class Arch(PathMove):
    """Arch from a pick to a place: straight up by a clearance, over, and straight down by another one.

    Its height and its bends are chosen for the shortest time, or for the least energy.
    """

    to: Target
    up_m: float
    down_m: float
    keep_out: KeepOut | None = None
    aim: Aim = Aim.TIME


@dataclass(frozen=True)
class Cubic:
    """Cubic in time with prescribed end velocity; it starts with the end velocity of the cubic before it (5.1)."""

    to: Target
    duration_s: float
    end_velocity_m_s: Point = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Turn:
    """The tool turns while the robot stands, as fast as its axis can."""

    to: Angle


@dataclass(frozen=True)
class Dwell:
    """Rest at the present point."""

    time_s: float


@dataclass(frozen=True)
class Output:
    """An output, and perhaps the payload, that changes at the end of the move before it, or before or after that.

    A distance counts along the path, a time as the program is driven at 100 %. One of the four is told at most; with a
    time there is no payload.
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
        """Whether it is due on what follows the move before it."""
        return self.after_m > 0.0 or self.after_s > 0.0


@dataclass(frozen=True)
class JointPoint:
    """Arm angles at a time after the start; with their speeds, and with their accelerations as well, if it has them."""

    time_s: float
    angles_rad: Point
    speeds_rad_s: Point | None = None
    accelerations_rad_s2: Point | None = None


@dataclass(frozen=True)
class Joints:
    """Arm angles over time, from rest to rest; refused instead of slowed down."""

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
    """Statements to run ``repeat`` times.

    Attributes
    ----------
    start_turn_rad
        Where the tool must stand; None: wherever it stands.
    source, places
        The file that it was read from, and where each statement stands in it; empty if that says nothing.
    names
        What each statement is called in sentences; those that have none are called by their number.

    """

    name: str
    statements: tuple[Statement, ...]
    start_m: Point | None = None
    repeat: int = 1
    payload_kg: float | None = None
    faults: tuple[Fault, ...] = ()
    start_turn_rad: float | None = None
    source: str = field(default='', compare=False)
    places: tuple[Place | None, ...] = field(default=(), compare=False)
    names: tuple[str, ...] = field(default=(), compare=False)

    def name_of(self, number: int) -> str:
        """Return what a statement is called in sentences."""
        told = self.names[number] if number < len(self.names) else ''
        return told or f'moves[{number}].{KINDS[type(self.statements[number])]}'

    def place_of(self, number: int) -> Place | None:
        """Return where a statement stands in its file, if that is known."""
        return self.places[number] if number < len(self.places) else None


def point_of(values: ArrayLike) -> Point:
    """Return three numbers as a point."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def point_text(point_m: ArrayLike) -> str:
    """Write a point as people do."""
    return '(' + ', '.join(f'{value:g}' for value in np.round(np.asarray(point_m), 6)) + ')'
