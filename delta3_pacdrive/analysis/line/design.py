"""What a line is: belts, the parts on them, the robots along them, and the rule by which parts are allocated."""

from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.motion.belt_synchronization import TrackLimits, TrackWindow, Vector
from delta3_pacdrive.parameters import Parameters

HOUR_S = 3600.0


class Rule(StrEnum):
    """By which rule parts are allocated to robots."""

    FIRST_COME = 'first come'  # the part that is farthest along
    NEAREST = 'nearest'  # the part that is met soonest
    BALANCED = 'balanced'  # the robots in turn; who is missed is there for all
    OPTIMAL = 'optimal'  # the best assignment of all known parts to the next picks of all robots


@dataclass(frozen=True)
class PartKind:
    """A type of parts.

    Attributes
    ----------
    name
        Of the type.
    mass_kg, height_m
        Of a part.
    share
        Of all parts.

    """

    name: str
    mass_kg: float
    height_m: float
    share: float


@dataclass(frozen=True)
class LineBelt:
    """A belt of the line. Parts come onto it at 0 m.

    Attributes
    ----------
    name
        Of the belt.
    speed_m_s, rate_per_min
        Of the belt, and of the parts that come.
    noise
        Standard deviation of the spacing, as a share of it.
    spread_m
        How far beside the middle of the belt parts lie at most.

    """

    name: str
    speed_m_s: float
    rate_per_min: float
    noise: float
    spread_m: float


@dataclass(frozen=True)
class LineRobot:
    """A robot of the line.

    Attributes
    ----------
    name, belt
        Of the robot, and of its belt.
    at_m
        Where along the belt the middle of its base is.
    middle_m
        The middle of the surface of the belt there, in the frame ``base``; the belt runs along x.
    window
        Along the belt, from the middle of the base on, in which it may work.
    place_m
        Where it puts parts down: the TCP in the frame ``base``.

    """

    name: str
    belt: str
    at_m: float
    middle_m: Vector
    window: TrackWindow
    place_m: Vector


@dataclass(frozen=True)
class Line:
    """A line.

    Attributes
    ----------
    name
        Of the line.
    seed
        Of the parts.
    hours
        How long the shift is.
    rule
        By which parts are allocated.
    horizon_s
        How far ahead the optimal rule looks.
    limits
        Of the TCP.
    above_m
        How high above a part the robot gets on and off the belt.
    grip_s, release_s, decision_s
        How long it stays on a part until it holds it, at the place until it has let go, and what its script needs for
        the decisions of a cycle.
    kinds, belts, robots
        What there is; robots in the order in which their belts reach them.
    parameters
        Of each robot.

    """

    name: str
    seed: int
    hours: float
    rule: Rule
    horizon_s: float
    limits: TrackLimits
    above_m: float
    grip_s: float
    release_s: float
    decision_s: float
    kinds: tuple[PartKind, ...]
    belts: tuple[LineBelt, ...]
    robots: tuple[LineRobot, ...]
    parameters: Parameters

    @property
    def shift_s(self) -> float:
        """How long the shift is [s]."""
        return self.hours * HOUR_S

    def robots_of(self, belt: str) -> list[LineRobot]:
        """Return the robots of a belt, in the order in which it reaches them."""
        return [robot for robot in self.robots if robot.belt == belt]
