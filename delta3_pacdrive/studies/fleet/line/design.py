"""Data of a line: belts, parts, robots, and the allocation rule."""

from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.belts.synchronization import TrackLimits, TrackWindow, Vector
from delta3_pacdrive.parameters import Parameters

HOUR_S = 3600.0


class Rule(StrEnum):
    """Allocation rule for parts."""

    FIRST_COME = 'first come'  # the part that is farthest along the belt
    NEAREST = 'nearest'  # the part with the earliest end of the cycle
    BALANCED = 'balanced'  # robots in turn; a missed part is available to all
    OPTIMAL = 'optimal'  # the best assignment of known parts to the next picks of all robots


@dataclass(frozen=True)
class PartKind:
    """Type of parts."""

    name: str
    mass_kg: float
    height_m: float
    share: float  # of all parts


@dataclass(frozen=True)
class LineBelt:
    """Belt of a line; parts enter it at 0 m."""

    name: str
    speed_m_s: float
    rate_per_min: float  # of the parts
    noise: float  # standard deviation of the spacing, relative to its mean
    spread_m: float  # largest distance of a part from the middle of the belt


@dataclass(frozen=True)
class LineRobot:
    """Robot of a line."""

    name: str
    belt: str
    at_m: float  # position of the middle of its base along the belt
    middle_m: Vector  # middle of the belt surface there, in the frame base; the belt runs along x
    window: TrackWindow  # working range along the belt, from the middle of the base
    place_m: Vector  # place position of the TCP in the frame base


@dataclass(frozen=True)
class Line:
    """Line of robots at belts."""

    name: str
    seed: int  # of the random parts
    hours: float  # of the shift
    rule: Rule
    horizon_s: float  # of the optimal rule
    limits: TrackLimits  # of the TCP
    above_m: float  # height above a part at which the robot gets on and off the belt
    grip_s: float
    release_s: float
    decision_s: float  # time of the script for the decisions of a cycle
    kinds: tuple[PartKind, ...]
    belts: tuple[LineBelt, ...]
    robots: tuple[LineRobot, ...]  # in the order along their belts
    parameters: Parameters  # of each robot

    @property
    def shift_s(self) -> float:
        """Duration of the shift [s]."""
        return self.hours * HOUR_S

    def robots_of(self, belt: str) -> list[LineRobot]:
        """Return the robots of a belt in the order along it."""
        return [robot for robot in self.robots if robot.belt == belt]
