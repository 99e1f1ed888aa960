"""Allocation of parts to robots by four rules.

A free robot gets a part and a start time, now or later. The part is reserved only at that time; until then another
robot may take it.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.fleet.line.design import Rule

SLOTS_MAX = 40  # planned picks per robot
CYCLES = 9  # sampled start times between the earliest and the latest one
PRICE = 0.5  # cost in parts of waiting, or of a longer cycle, by one mean cycle
LATER = 0.06  # loss of value of a part per cycle of delay
AGAIN_S = 0.5  # period of new assignments


class Reach(NamedTuple):
    """Times at which the robots of a belt can start to pick each part."""

    earliest_s: Floats  # shape (robots, parts)
    latest_s: Floats  # shape (robots, parts); before the earliest: the robot cannot pick the part
    cycle_s: (
        Floats  # cycle time for CYCLES start times from earliest to latest, shape (robots, parts, CYCLES)
    )

    def cycle_at(self, robot: NDArray[np.int64] | int, part: NDArray[np.int64], start_s: Floats) -> Floats:
        """Return the approximate cycle times of robots that start to pick parts at given times; shapes broadcast."""
        first = self.earliest_s[robot, part]
        span = np.maximum(self.latest_s[robot, part] - first, 1e-9)
        index = np.clip((CYCLES - 1) * (start_s - first) / span + 0.5, 0.0, CYCLES - 1)
        found: Floats = self.cycle_s[robot, part, index.astype(np.int64)]
        return found


class Choice(NamedTuple):
    """A part and the time at which a robot starts to pick it [s]; part -1: none, choose again at that time."""

    part: int
    start_s: float


@dataclass
class Allocation:
    """State of the allocation on one belt."""

    rule: Rule
    reach: Reach
    enters_s: Floats  # times at which the parts become known
    horizon_s: float  # of the optimal rule
    taken: NDArray[np.bool_] = field(init=False)  # shape (parts,)
    free_s: Floats = field(init=False)  # time at which each robot is free

    def __post_init__(self) -> None:
        robots, parts = self.reach.earliest_s.shape
        self.taken = np.zeros(parts, np.bool_)
        self.free_s = np.zeros(robots)
        possible = self.reach.latest_s >= self.reach.earliest_s
        self._latest = np.where(possible, self.reach.latest_s, -math.inf)
        # running maxima: parts before an index are out of reach of the robot (or of all robots) after this time
        self._gone = np.maximum.accumulate(self._latest, axis=1)
        self._last_gone = self._gone.max(axis=0)
        self._soonest = np.minimum.accumulate(self.reach.earliest_s[:, ::-1], axis=1)[:, ::-1]
        self._owner = _in_turn(possible)
        middle = np.where(possible, self.reach.cycle_s[:, :, CYCLES // 2], 0.0)
        mean = middle.sum(axis=1) / np.maximum(possible.sum(axis=1), 1)
        self._mean_s = np.where(mean > 0.0, mean, 1.0)
        self._plans: list[list[int]] = [[] for _ in range(robots)]  # the next parts of each robot
        self._planned_s = -math.inf

    def take(self, robot: int, part: int, until_s: float) -> None:
        """Assign a part to a robot, which is busy until a time [s]."""
        self.taken[part] = True
        self.free_s[robot] = until_s

    def next_for(self, robot: int, now_s: float) -> Choice:
        """Return the next part of a free robot and its start time."""
        low = int(np.searchsorted(self._gone[robot], now_s))
        high = int(np.searchsorted(self._soonest[robot], now_s + self.horizon_s, side='right'))
        if low >= high:
            return self._later(robot, now_s, low, high)
        found = np.arange(low, high)
        found = found[~self.taken[low:high] & (self._latest[robot, low:high] >= now_s)]
        if self.rule is Rule.BALANCED:
            found = found[self._is_own(robot, found, now_s)]
        if not len(found):
            return self._later(robot, now_s, low, high)
        if self.rule is Rule.OPTIMAL:
            return self._assigned(robot, now_s, found)
        starts = np.maximum(self.reach.earliest_s[robot, found], now_s)
        if self.rule is Rule.NEAREST:
            best = int(np.argmin(starts + self.reach.cycle_at(robot, found, starts)))
        else:
            best = int(np.argmin(starts))  # the first of the available parts is the farthest along
        return Choice(int(found[best]), float(starts[best]))

    def _later(self, robot: int, now_s: float, low: int, high: int) -> Choice:
        """Return no part, and the time at which the next part comes into reach of an idle robot."""
        nearest = math.inf
        for part in range(low, len(self.taken)):
            start = self.reach.earliest_s[robot, part]
            if part >= high and nearest <= self._soonest[robot, part]:
                break
            if not self.taken[part] and self._latest[robot, part] >= start > now_s:
                nearest = min(nearest, start)
        return Choice(-1, float(nearest))

    def _is_own(self, robot: int, parts: NDArray[np.int64], now_s: float) -> NDArray[np.bool_]:
        """Return whether parts are assigned to a robot, or were missed by the robot they are assigned to."""
        owner = self._owner[parts]
        own: NDArray[np.bool_] = (owner == robot) | (self._latest[owner, parts] < now_s)
        return own

    def _assigned(self, robot: int, now_s: float, found: NDArray[np.int64]) -> Choice:
        """Return the next part of a robot from the best assignment of known parts to the next picks of all robots."""
        plan = self._plan(robot, now_s)
        if not plan and now_s > self._planned_s:
            self._assign(now_s)
            plan = self._plan(robot, now_s)
        if plan:
            return Choice(plan[0], max(now_s, float(self.reach.earliest_s[robot, plan[0]])))
        return self._later(robot, now_s, int(found[0]), int(found[-1]) + 1)

    def _plan(self, robot: int, now_s: float) -> list[int]:
        """Return the planned parts of a robot that are still possible; the assignment is renewed periodically."""
        if now_s > self._planned_s + AGAIN_S:
            self._assign(now_s)
        plan = self._plans[robot]
        while plan and (self.taken[plan[0]] or self._latest[robot, plan[0]] < now_s):
            plan.pop(0)
        return plan

    def _assign(self, now_s: float) -> None:
        """Assign all known parts to the next picks of all robots with the largest total value."""
        self._planned_s = now_s
        low = int(np.searchsorted(self._last_gone, now_s))
        high = int(np.searchsorted(self.enters_s, now_s, side='right'))
        parts = np.arange(low, high)[~self.taken[low:high]]
        end_s = now_s + self.horizon_s
        free = np.maximum(self.free_s, now_s)
        counts = np.ceil((end_s - free) / self._mean_s).clip(0, SLOTS_MAX).astype(np.int64)
        robots = np.repeat(np.arange(len(free)), counts)[:, None]
        number = np.concatenate([np.arange(count) for count in counts])[:, None]
        mean = self._mean_s[robots]
        slot = free[robots] + number * mean
        start = np.maximum(self.reach.earliest_s[robots, parts], slot)
        possible = (start <= self._latest[robots, parts]) & (start < end_s)
        longer = self.reach.cycle_at(robots, parts, start) - mean
        worth = 1.0 - PRICE * (start - slot + longer) / mean - LATER * number
        worth = np.where(possible, np.maximum(worth, 1e-6), 0.0)
        self._plans = [[] for _ in free]
        for row, column in zip(*linear_sum_assignment(worth, maximize=True), strict=True):
            if possible[row, column]:
                self._plans[int(robots[row, 0])].append(int(parts[column]))


def _in_turn(possible: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the robot of each part: among those that can pick it, the one with the fewest parts so far."""
    robots, parts = possible.shape
    counts = np.zeros(robots)
    owner = np.zeros(parts, np.int64)
    for part in range(parts):
        best = int(np.argmin(np.where(possible[:, part], counts, math.inf)))
        owner[part] = best
        counts[best] += 1
    return owner
