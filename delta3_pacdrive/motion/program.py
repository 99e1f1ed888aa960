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


@dataclass(frozen=True, kw_only=True)
class PathMove:
    """A move along a path: its limits, the blend with the next move, and whether it is refused instead of slowed.

    A time-optimal one is as fast as the motors allow within its limits, and changes their torques no faster than its
    torque rate.
    """

    limits: Limits
    blend_m: float = 0.0
    strict: bool = False
    time_optimal: bool = False
    torque_rate_n_m_s: float = math.inf


@dataclass(frozen=True)
class MoveL(PathMove):
    """Straight line to a point (6.1)."""

    to: Target


@dataclass(frozen=True)
class MoveC(PathMove):
    """Circle through a circle point to an end (6.2)."""

    via: Target
    to: Target


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
class Dwell:
    """Rest at the present point."""

    time_s: float


@dataclass(frozen=True)
class Output:
    """An output, and perhaps the payload, that changes at the end of the move before it or a distance before that."""

    name: str
    value: float
    before_m: float = 0.0
    payload_kg: float | None = None


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


Statement = MoveL | MoveC | MoveSB | Arch | Cubic | Joints | Dwell | Output


@dataclass(frozen=True)
class Program:
    """Statements to run ``repeat`` times.

    Attributes
    ----------
    source, places
        The file that it was read from, and where each statement stands in it; empty if that says nothing.

    """

    name: str
    statements: tuple[Statement, ...]
    start_m: Point | None = None
    repeat: int = 1
    payload_kg: float | None = None
    faults: tuple[Fault, ...] = ()
    source: str = field(default='', compare=False)
    places: tuple[Place | None, ...] = field(default=(), compare=False)


def point_text(point_m: ArrayLike) -> str:
    """Write a point as people do."""
    return '(' + ', '.join(f'{value:g}' for value in np.round(np.asarray(point_m), 6)) + ')'
