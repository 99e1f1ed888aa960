"""Data of a line: belts, parts, robots, and the allocation rule."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from delta3_pacdrive.belts.synchronization import TrackLimits, TrackWindow, Vector
from delta3_pacdrive.configuration.fields import Rules, entries, own_name, quantity, read_by, reference, text
from delta3_pacdrive.configuration.strict_reader import refuse
from delta3_pacdrive.configuration.value_readers import line_of_text, numbers_between
from delta3_pacdrive.parameters import Parameters, load, of_run

HOUR_S = 3600.0
NAME_MAX = 40
REACH_M, BELT_MAX_M = 2.0, 1000.0
PARTS_MAX = 2_000_000  # per shift
DECISION_S = (
    0.029  # measured by delta3 line --replay: bus cycles from the end of a cycle to the begin of the next
)
LIMITS = TrackLimits(4.0, 40.0, 4000.0)


def _window(value: Any, where: str) -> TrackWindow:
    begin, end = numbers_between(2, -REACH_M, REACH_M)(value, where)
    if not begin < end:
        refuse(f'{where} is from {begin:g} m to {end:g} m, but the end must be after the begin')
    return TrackWindow(begin, end)


def _robot(value: Any, where: str) -> Parameters:
    return load(of_run(line_of_text(1000)(value, where)))


class Rule(StrEnum):
    """Allocation rule for parts."""

    FIRST_COME = 'first come'  # the part that is farthest along the belt
    NEAREST = 'nearest'  # the part with the earliest end of the cycle
    BALANCED = 'balanced'  # robots in turn; a missed part is available to all
    OPTIMAL = 'optimal'  # the best assignment of known parts to the next picks of all robots


@dataclass(frozen=True)
class PartKind:
    """Type of parts."""

    name: str = own_name(NAME_MAX)
    mass_kg: float = quantity('mass', 0.0, 100.0)
    height_m: float = quantity('height', 1e-4, 0.5)
    share: float = quantity('of all parts', 1e-6, 1e6, default=1.0)


@dataclass(frozen=True)
class LineBelt:
    """Belt of a line; parts enter it at 0 m."""

    name: str = own_name(NAME_MAX)
    speed_m_s: float = quantity('speed', 0.01, 5.0)
    rate_per_min: float = quantity('of the parts', 0.01, 1e5)
    noise: float = quantity('standard deviation of the spacing, relative to its mean', 0.0, 1.0, default=0.0)
    spread_m: float = quantity(
        'largest distance of a part from the middle of the belt', 0.0, 0.5, default=0.0
    )


@dataclass(frozen=True)
class LineRobot:
    """Robot of a line."""

    name: str = own_name(NAME_MAX)
    belt: str = reference('its belt', 'belts')
    at_m: float = quantity('position of the middle of its base along the belt', 0.0, BELT_MAX_M)
    middle_m: Vector = quantity(
        'middle of the belt surface there, in the frame base; the belt runs along x', -REACH_M, REACH_M
    )
    window: TrackWindow = read_by(
        _window, 'working range along the belt, from the middle of the base', key='window_m'
    )
    place_m: Vector = quantity('place position of the TCP in the frame base', -REACH_M, REACH_M)


@dataclass(frozen=True)
class Line:
    """Line of robots at belts."""

    kinds: tuple[PartKind, ...] = entries('by name', 1, 20, key='parts')
    belts: tuple[LineBelt, ...] = entries('by name', 1, 10)
    robots: tuple[LineRobot, ...] = entries('by name, in the order along their belts', 1, 50)
    name: str = text('name of the line', 60, default='')
    seed: int = quantity('of the random parts', 0, 2**31 - 1, default=1)
    hours: float = quantity('of the shift', 1e-3, 24.0, default=8.0)
    rule: Rule = Rule.OPTIMAL
    horizon_s: float = quantity('of the optimal rule', 0.1, 60.0, default=12.0)
    limits: TrackLimits = LIMITS  # of the TCP
    above_m: float = quantity(
        'height above a part at which the robot gets on and off the belt', 1e-3, 0.3, default=0.02
    )
    grip_s: float = quantity('time to grip a part', 0.0, 10.0, default=0.04)
    release_s: float = quantity('time to release a part', 0.0, 10.0, default=0.02)
    decision_s: float = quantity(
        'time of the script for the decisions of a cycle', 0.0, 10.0, default=DECISION_S
    )
    parameters: Parameters = read_by(_robot, 'of each robot', default_factory=lambda: load(of_run(None)))

    def broken_rules(self) -> Rules:
        """Yield violated rules between values."""
        if sum(belt.rate_per_min for belt in self.belts) * self.hours * 60.0 > PARTS_MAX:
            yield ('belts',), f'would carry more than {PARTS_MAX} parts in {self.hours:g} h'

    @property
    def shift_s(self) -> float:
        """Duration of the shift [s]."""
        return self.hours * HOUR_S

    def robots_of(self, belt: str) -> list[LineRobot]:
        """Return the robots of a belt in the order along it."""
        return [robot for robot in self.robots if robot.belt == belt]
