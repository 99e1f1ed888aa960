"""A shift: robots are free, take parts, and are away for a cycle. From event to event, without a bus."""

import heapq
import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.line.allocation import CYCLES, Allocation, Reach
from delta3_pacdrive.analysis.line.cycle_times import CycleTable
from delta3_pacdrive.analysis.line.design import Line, LineBelt
from delta3_pacdrive.analysis.line.parts import Parts
from delta3_pacdrive.analysis.study import OnProgress, silent
from delta3_pacdrive.numerics.types import Floats

NOBODY = -1
TELL = 4096  # events between two reports of progress
IDLE_S = 1e-9  # shorter than that nobody is idle


class Miss(StrEnum):
    """Why a part is missed."""

    OUT_OF_REACH = 'out of reach'  # no robot can pick it: it is too short in every window
    BUSY = 'all busy'  # every robot that could have picked it worked on others as long as it could
    LEFT = 'left'  # a robot was free, and the rule gave it another part, or none


@dataclass(frozen=True)
class BeltShift:
    """What has become of the parts of a belt.

    Attributes
    ----------
    belt
        Its name.
    robots
        Names of its robots.
    parts
        That came.
    robot
        Number of the robot that picked each part; -1: none.
    start_s, cycle_s
        When that started, and how long it was away; nan for parts that nobody picked.
    offered
        Which parts count: those that the last robot could have picked before the end, and those that were picked.
    missed
        Why each part that counts was missed; empty if it was not.

    """

    belt: str
    robots: tuple[str, ...]
    parts: Parts
    robot: NDArray[np.int64]
    start_s: Floats
    cycle_s: Floats
    offered: NDArray[np.bool_]
    missed: NDArray[np.str_]


def simulate(
    line: Line, belt: LineBelt, parts: Parts, tables: list[list[CycleTable]], show: OnProgress = silent
) -> BeltShift:
    """Let the robots of a belt work for a shift.

    Parameters
    ----------
    line, belt, parts
        The line, one of its belts, and the parts on that.
    tables
        Of the robots of the belt, in its order, and of each type of parts.
    show
        Is told how far it is.

    """
    robots = line.robots_of(belt.name)
    reach = reach_of(belt, parts, tables)
    allocation = Allocation(line.rule, reach, parts.enters_s, line.horizon_s)
    taken_by = np.full(len(parts.kind), NOBODY)
    starts, cycles = np.full(len(parts.kind), math.nan), np.full(len(parts.kind), math.nan)
    events = [(0.0, number) for number in range(len(robots))]
    heapq.heapify(events)
    done = 0
    while events:
        now, robot = heapq.heappop(events)
        if now >= line.shift_s:
            continue
        done += 1
        if done % TELL == 0:
            show(f'belt {belt.name}', int(now), int(line.shift_s))
        part, start = allocation.next_for(robot, now)
        if part < 0 or start > now:
            # it looks again then: until then another robot may take the part
            heapq.heappush(events, (max(start, now + IDLE_S), robot))
            continue
        place = belt.speed_m_s * (now - parts.enters_s[part]) - robots[robot].at_m
        table = tables[robot][parts.kind[part]]
        cycle = float(table.cycles_s(parts.across_m[part], np.float64(place)))
        allocation.take(robot, part, now + cycle)
        taken_by[part], starts[part], cycles[part] = robot, now, cycle
        heapq.heappush(events, (now + cycle, robot))
    latest = np.where(reach.latest_s >= reach.earliest_s, reach.latest_s, -math.inf)
    offered = (taken_by >= 0) | (reach.latest_s.max(axis=0) < line.shift_s)
    missed = _reasons(reach.earliest_s, latest, taken_by, starts, cycles, offered)
    names = tuple(robot.name for robot in robots)
    return BeltShift(belt.name, names, parts, taken_by, starts, cycles, offered, missed)


def reach_of(belt: LineBelt, parts: Parts, tables: list[list[CycleTable]]) -> Reach:
    """Return when each robot of a belt can start to pick each part."""
    shape = len(tables), len(parts.kind)
    earliest, latest, cycle = np.empty(shape), np.empty(shape), np.empty((*shape, CYCLES))
    for row, of_robot in enumerate(tables):
        for number, table in enumerate(of_robot):
            which = parts.kind == number
            across, enters = parts.across_m[which], parts.enters_s[which]
            first, last = table.starts_m(across)
            at_m = table.station.robot.at_m
            # a part is known when it comes onto the belt
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
    """Say of each part why it was missed."""
    missed = offered & (taken_by < 0)
    reasons = np.where(missed, str(Miss.BUSY), '').astype(f'U{max(map(len, Miss))}')
    reasons[missed & np.isneginf(latest).all(axis=0)] = Miss.OUT_OF_REACH
    for robot in range(len(earliest)):
        own = np.sort(starts[taken_by == robot])
        order = np.argsort(starts[taken_by == robot])
        ends = own + cycles[taken_by == robot][order]
        # the instants from which on the robot was free, and when it took the next part
        free_from, free_to = np.append(0.0, ends), np.append(own, math.inf)
        idle = free_to - free_from > IDLE_S
        free_from, free_to = free_from[idle], free_to[idle]
        for part in np.flatnonzero(missed & (latest[robot] >= earliest[robot])):
            n = int(np.searchsorted(free_to, earliest[robot, part], side='right'))
            if n < len(free_from) and free_from[n] < latest[robot, part]:
                reasons[part] = Miss.LEFT
    return reasons
