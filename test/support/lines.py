"""Lines for tests: short ones, an upper bound for any allocation, and the optimum with all parts known."""

import math
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.fleet.line import shift, specification
from delta3_pacdrive.studies.fleet.line import shift as parts
from delta3_pacdrive.studies.fleet.line.cycle_times import CycleTable, Station
from delta3_pacdrive.studies.fleet.line.design import Line

ROBOT = {'belt': 'infeed', 'middle_mm': [0, 100, -870], 'window_mm': [-250, 300], 'place_mm': [0, -200, -830]}
STEP_M = 1.2
SLOT_S = 0.0005  # of the bound
ROUNDS = 300  # in which its prices are found
STEP, SLOWER = 0.05, 20.0  # by which they change at first, and rounds after which it is half of that
WAITS_S = (0.0, 0.03, 0.1)  # of robots that could begin: a part that is nearer then may take less time
SAME_S = 2e-4  # robots that are free so much earlier are not looked at
KEPT = 2000  # of the best beginnings of an allocation


def document(robots: int = 2, **belt: Any) -> dict[str, Any]:
    """Return a line with some robots at one belt."""
    return {
        'hours': 0.05,
        'parts': {'bar': {'mass_kg': 0.2, 'height_mm': 20}},
        'belts': {'infeed': {'speed_m_s': 0.5, 'rate_per_min': 180, 'noise': 0.3, 'spread_mm': 40} | belt},
        'robots': {f'robot{n + 1}': deepcopy(ROBOT) | {'at_m': 0.8 + STEP_M * n} for n in range(robots)},
    }


def line_of(robots: int = 2, **belt: Any) -> Line:
    """Return such a line, read."""
    return specification.parse(document(robots, **belt), Path('line.yaml'))


def tables_of(line: Line) -> list[list[CycleTable]]:
    """Return the tables of the robots of its first belt."""
    belt = line.belts[0]
    return [
        [CycleTable(Station(line, belt, robot, kind)) for kind in line.kinds]
        for robot in line.robots_of(belt.name)
    ]


def shift_of(line: Line, tables: list[list[CycleTable]]) -> shift.BeltShift:
    """Return a shift of its first belt."""
    belt = line.belts[0]
    return shift.simulate(line, belt, parts.of_belt(line, belt), tables)


def most_that_can_be_picked(line: Line, tables: list[list[CycleTable]], until_s: float) -> float:
    """Return an upper bound of the number of parts that any allocation picks until some time.

    The bound also holds for an allocation that knows all parts in advance. Each part has a price. Each robot selects
    the sequence of picks with the highest total price that it has time for, by dynamic programming backwards in time
    slots. For any prices, their sum and the surplus of the robots are together a bound. The price of a part that two
    robots select rises until the bound no longer falls (Lagrange, subgradients). Starts and cycles are rounded down
    to slots.
    """
    belt = line.belts[0]
    coming = parts.of_belt(line, belt)
    reach = shift.reach_of(belt, coming, tables)
    count = int(np.searchsorted(coming.enters_s, until_s))
    chances = [_chances(line, tables, reach, coming, robot, count) for robot in range(len(tables))]
    prices, bound = np.zeros(count), float(count)
    for number in range(ROUNDS):
        wanted = np.zeros(count)
        value = prices.sum()
        for slots, begin, part, length in chances:
            value += _dearest(slots, begin, part, length, prices, wanted)
        bound = min(bound, value)
        surplus = wanted - 1.0
        surplus[(prices == 0.0) & (surplus < 0.0)] = 0.0
        if not surplus.any():
            break
        prices = np.maximum(prices + STEP / (1.0 + number / SLOWER) * surplus, 0.0)
    return bound


def picked_knowing_all(line: Line, tables: list[list[CycleTable]], until_s: float) -> int:
    """Return how many of the parts that come until some time two robots can pick that know all of them before.

    Part by part, in the order of the belt, it goes to one of the robots, or to none. Of beginnings with as many picks
    the ones are kept in which no other has both robots free earlier. To set a part aside and to take it after the next
    ones brought nothing in nine shifts.
    """
    belt = line.belts[0]
    coming = parts.of_belt(line, belt)
    reach = shift.reach_of(belt, coming, tables)
    count = int(np.searchsorted(coming.enters_s, until_s))
    mean_s = float(reach.cycle_s.mean())
    free_s, picks = np.zeros((1, 2)), np.zeros(1, np.int64)
    for part in range(count):
        all_free, all_picks = [free_s], [picks]
        for robot in range(2):
            for wait_s in WAITS_S:
                start = np.maximum(free_s[:, robot], reach.earliest_s[robot, part]) + wait_s
                can = start <= reach.latest_s[robot, part]
                after = free_s[can]
                cycle = reach.cycle_at(robot, np.int64(part), start[can])
                after[:, robot] = start[can] + cycle
                all_free.append(after)
                all_picks.append(picks[can] + 1)
        free_s, picks = np.concatenate(all_free), np.concatenate(all_picks)
        if part + 1 < count:  # who is free before the next part comes may as well be free then
            free_s = np.maximum(free_s, reach.earliest_s[:, part + 1])
        kept = _foremost(free_s, picks)
        if len(kept) > KEPT:
            promise = picks[kept] - free_s[kept].sum(axis=1) / mean_s
            kept = kept[np.argsort(-promise, kind='stable')[:KEPT]]
        free_s, picks = free_s[kept], picks[kept]
    return int(picks.max())


def _foremost(free_s: Floats, picks: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which beginnings no other one surpasses that has as many picks, or more, and both robots free earlier."""
    kept: list[NDArray[np.int64]] = []
    firsts, seconds = np.empty(0), np.empty(0)  # when both are free: the second at the earliest
    for number in np.unique(picks)[::-1]:
        which = np.flatnonzero(picks == number)
        which = which[np.lexsort((free_s[which, 1], free_s[which, 0]))]
        first, second = free_s[which].T
        before = np.append(math.inf, np.minimum.accumulate(second)[:-1])
        place = np.searchsorted(firsts, first, side='right')
        better = second < np.minimum(before, np.append(math.inf, seconds)[place]) - SAME_S
        kept.append(which[better])
        firsts, seconds = np.append(firsts, first[better]), np.append(seconds, second[better])
        order = np.argsort(firsts, kind='stable')
        firsts, seconds = firsts[order], np.minimum.accumulate(seconds[order])
    return np.concatenate(kept)


def _chances(
    line: Line,
    tables: list[list[CycleTable]],
    reach: shift.Reach,
    coming: parts.Parts,
    robot: int,
    count: int,
) -> tuple[int, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return by slot of time which parts a robot can begin to pick then, and for how many slots it is away."""
    belt = line.belts[0]
    at_m = line.robots_of(belt.name)[robot].at_m
    begins, which, lengths = [], [], []
    for one in range(count):
        first, last = reach.earliest_s[robot, one], reach.latest_s[robot, one]
        if last < first:
            continue
        slots = np.arange(math.floor(first / SLOT_S), math.floor(last / SLOT_S) + 1)
        edges = np.clip(SLOT_S * np.append(slots, slots[-1] + 1), first, last)
        table = tables[robot][coming.kind[one]]
        cycles = table.cycles_s(
            np.full(len(edges), coming.across_m[one]), belt.speed_m_s * (edges - coming.enters_s[one]) - at_m
        )
        begins.append(slots)
        which.append(np.full(len(slots), one))
        lengths.append(np.floor(np.minimum(cycles[1:], cycles[:-1]) / SLOT_S).astype(np.int64))
    slots, part, length = np.concatenate(begins), np.concatenate(which), np.concatenate(lengths)
    order = np.argsort(slots, kind='stable')
    number = int(slots.max()) + 1
    return number, np.searchsorted(slots[order], np.arange(number + 1)), part[order], length[order]


@njit
def _dearest(slots, begin, part, length, prices, wanted):  # type: ignore[no-untyped-def]
    """Return the value of the best sequence of picks of a robot, and count its parts."""
    values = np.zeros(slots + 1)
    choice = np.full(slots, -1)
    for slot in range(slots - 1, -1, -1):
        values[slot] = values[slot + 1]
        for k in range(begin[slot], begin[slot + 1]):
            value = 1.0 - prices[part[k]] + values[min(slot + length[k], slots)]
            if value > values[slot]:
                values[slot], choice[slot] = value, k
    slot = 0
    while slot < slots:
        k = choice[slot]
        if k < 0:
            slot += 1
        else:
            wanted[part[k]] += 1.0
            slot += length[k]
    return values[0]
