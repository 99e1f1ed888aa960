"""Random parts, and the event simulation of a shift: free robots take parts and are busy for a cycle."""

import heapq
import math
import zlib
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.fleet.line.allocation import CYCLES, Allocation, Reach
from delta3_pacdrive.studies.fleet.line.cycle_times import CycleTable
from delta3_pacdrive.studies.fleet.line.design import Line, LineBelt
from delta3_pacdrive.studies.framework.study import OnProgress, silent

SPACING_MIN = 0.1  # relative to the mean: parts do not overlap


class Parts(NamedTuple):
    """Parts of a belt in the order of their arrival."""

    enters_s: Floats  # arrival at 0 m
    across_m: Floats  # distance from the middle of the belt, positive to the left
    kind: NDArray[np.int64]  # index of the type


def of_belt(line: Line, belt: LineBelt) -> Parts:
    """Return the parts of a shift; they depend on the seed and the belt only."""
    draw = np.random.default_rng([line.seed, zlib.crc32(belt.name.encode())])
    mean_s = 60.0 / belt.rate_per_min
    count = int(line.shift_s / mean_s * (1.0 + belt.noise)) + 10
    spacing = mean_s * np.maximum(1.0 + belt.noise * draw.standard_normal(count), SPACING_MIN)
    enters = np.cumsum(spacing)
    across = draw.uniform(-belt.spread_m, belt.spread_m, count)
    shares = np.array([kind.share for kind in line.kinds])
    kinds = draw.choice(len(shares), count, p=shares / shares.sum())
    during = enters < line.shift_s
    return Parts(enters[during], across[during], kinds[during])


NO_ROBOT = -1
PROGRESS_EVENTS = 4096  # events between two reports of progress
IDLE_S = 1e-9  # shorter gaps do not count as idle time


class Miss(StrEnum):
    """Reason why a part is missed."""

    OUT_OF_REACH = 'out of reach'  # every window is too short to pick it
    BUSY = 'all busy'  # every robot that could have picked it was busy while it could
    LEFT = 'left'  # a robot was free, but the rule gave it another part or none


@dataclass(frozen=True)
class BeltShift:
    """Results of a shift on one belt."""

    belt: str
    robots: tuple[str, ...]  # names
    parts: Parts
    robot: NDArray[np.int64]  # index of the robot that picked each part, or NO_ROBOT
    start_s: Floats  # of the cycle; nan for parts that were not picked
    cycle_s: Floats  # duration of the cycle; nan likewise
    # parts that count: the last robot could have picked them before the end of the shift, or they were picked
    offered: NDArray[np.bool_]
    missed: NDArray[np.str_]  # reason for each part that counts and was missed, else empty


def simulate(
    line: Line, belt: LineBelt, parts: Parts, tables: list[list[CycleTable]], show: OnProgress = silent
) -> BeltShift:
    """Simulate the robots of a belt during a shift.

    Parameters
    ----------
    line, belt, parts
        Line, one of its belts, and the parts on that belt.
    tables
        Cycle times of each robot of the belt, in the order along it, and of each type of parts.
    show
        Callback for the progress.

    """
    robots = line.robots_of(belt.name)
    reach = reach_of(belt, parts, tables)
    allocation = Allocation(line.rule, reach, parts.enters_s, line.horizon_s)
    taken_by = np.full(len(parts.kind), NO_ROBOT)
    starts, cycles = np.full(len(parts.kind), math.nan), np.full(len(parts.kind), math.nan)
    events = [(0.0, number) for number in range(len(robots))]
    heapq.heapify(events)
    done = 0
    while events:
        now, robot = heapq.heappop(events)
        if now >= line.shift_s:
            continue
        done += 1
        if done % PROGRESS_EVENTS == 0:
            show(f'belt {belt.name}', int(now), int(line.shift_s))
        part, start = allocation.next_for(robot, now)
        if part < 0 or start > now:
            # choose again at that time: another robot may take the part before
            heapq.heappush(events, (max(start, now + IDLE_S), robot))
            continue
        position = belt.speed_m_s * (now - parts.enters_s[part]) - robots[robot].at_m
        table = tables[robot][parts.kind[part]]
        cycle = float(table.cycles_s(parts.across_m[part], np.float64(position)))
        allocation.take(robot, part, now + cycle)
        taken_by[part], starts[part], cycles[part] = robot, now, cycle
        heapq.heappush(events, (now + cycle, robot))
    latest = np.where(reach.latest_s >= reach.earliest_s, reach.latest_s, -math.inf)
    offered = (taken_by >= 0) | (reach.latest_s.max(axis=0) < line.shift_s)
    return BeltShift(
        belt=belt.name,
        robots=tuple(robot.name for robot in robots),
        parts=parts,
        robot=taken_by,
        start_s=starts,
        cycle_s=cycles,
        offered=offered,
        missed=_reasons(reach.earliest_s, latest, taken_by, starts=starts, cycles=cycles, offered=offered),
    )


def reach_of(belt: LineBelt, parts: Parts, tables: list[list[CycleTable]]) -> Reach:
    """Return the times at which each robot of a belt can start to pick each part."""
    shape = len(tables), len(parts.kind)
    earliest, latest, cycle = np.empty(shape), np.empty(shape), np.empty((*shape, CYCLES))
    for row, of_robot in enumerate(tables):
        for number, table in enumerate(of_robot):
            which = parts.kind == number
            across, enters = parts.across_m[which], parts.enters_s[which]
            first, last = table.starts_m(across)
            at_m = table.station.robot.at_m
            # a part is known from its arrival on
            earliest[row, which] = enters + np.maximum(first + at_m, 0.0) / belt.speed_m_s
            latest[row, which] = enters + (last + at_m) / belt.speed_m_s
            starts = np.linspace(first, np.maximum(first, last), CYCLES, axis=1)
            cycle[row, which] = table.cycles_s(across[:, None], starts)
    return Reach(earliest, latest, cycle)


def _reasons(
    earliest: Floats,
    latest: Floats,
    taken_by: NDArray[np.int64],
    starts: Floats,
    cycles: Floats,
    offered: NDArray[np.bool_],
) -> NDArray[np.str_]:
    """Return the reason why each part was missed."""
    missed = offered & (taken_by < 0)
    reasons = np.where(missed, str(Miss.BUSY), '').astype(f'U{max(map(len, Miss))}')
    reasons[missed & np.isneginf(latest).all(axis=0)] = Miss.OUT_OF_REACH
    for robot in range(len(earliest)):
        own = np.sort(starts[taken_by == robot])
        order = np.argsort(starts[taken_by == robot])
        ends = own + cycles[taken_by == robot][order]
        # intervals in which the robot was free
        free_from, free_to = np.append(0.0, ends), np.append(own, math.inf)
        idle = free_to - free_from > IDLE_S
        free_from, free_to = free_from[idle], free_to[idle]
        for part in np.flatnonzero(missed & (latest[robot] >= earliest[robot])):
            n = int(np.searchsorted(free_to, earliest[robot, part], side='right'))
            if n < len(free_from) and free_from[n] < latest[robot, part]:
                reasons[part] = Miss.LEFT
    return reasons
