"""Lines for tests: short ones, and a bound of what any allocation could pick."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array

from delta3_pacdrive.analysis.line import parts, shift, specification
from delta3_pacdrive.analysis.line.cycle_times import CycleTable, Station
from delta3_pacdrive.analysis.line.design import Line

ROBOT = {'belt': 'infeed', 'middle_mm': [0, 100, -870], 'window_mm': [-250, 300], 'place_mm': [0, -200, -830]}
STEP_M = 1.2
SPANS = (2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)  # parts over which intervals of the bound go


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
    """Return a bound: no allocation whatever picks more of the parts that come until some time.

    It is a linear programme. A part goes to robots by shares. The picks of a robot that must all begin between two
    instants take no longer than from the one to the other, and the last of them; each takes as long as it would at its
    best start.
    """
    belt = line.belts[0]
    coming = parts.of_belt(line, belt)
    reach = shift.reach_of(belt, coming, tables)
    count = int(np.searchsorted(coming.enters_s, until_s))
    robots = len(tables)
    shortest = reach.cycle_s[:, :count].min(axis=2)
    rows, columns, values, bounds = [], [], [], []
    number = 0
    for part in range(count):
        rows += [number] * robots
        columns += [robot * count + part for robot in range(robots)]
        values += [1.0] * robots
        bounds.append(1.0)
        number += 1
    for robot in range(robots):
        for first in range(count):
            for last in sorted({min(first + span, count) - 1 for span in SPANS} - {first}):
                inside = np.arange(first, last + 1)
                begin = reach.earliest_s[robot, inside].min()
                end = reach.latest_s[robot, inside].max()
                rows += [number] * len(inside)
                columns += (robot * count + inside).tolist()
                values += shortest[robot, inside].tolist()
                bounds.append(float(end - begin + shortest[robot, inside].max()))
                number += 1
    matrix = coo_array((values, (rows, columns)), shape=(number, robots * count)).tocsr()
    found = linprog(-np.ones(robots * count), A_ub=matrix, b_ub=bounds, bounds=(0.0, 1.0), method='highs')
    return float(-found.fun)
