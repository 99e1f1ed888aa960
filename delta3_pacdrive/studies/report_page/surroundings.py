"""Surroundings of the robot in a page: fixed objects, belts, and parts with their stays.

``ways`` contains the position of each belt in every bus cycle of the run; ``belts`` are its rows in ``things``. A part
consists of its number, its type (a row of ``sizes``) and its outcome. A row of ``stays`` contains the row of a part,
the bus cycle relative to the first one of the run (-1: before it), the kind of stay, and the belt; a row of
``places`` contains x, y, z, angle, and the belt position at that time. Belt positions are relative to the first cycle.
The three tables are packed by ``columns``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.cell.cell_scene import REACH_MAX_M, Kind, Thing
from delta3_pacdrive.cell.parts import How, Stay
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.report_page.packed_columns import packed
from delta3_pacdrive.studies.runs.cell_history import CellStory
from delta3_pacdrive.studies.runs.run_signals import noted_cycle
from delta3_pacdrive.studies.runs.runs import Run

THINGS_DRAWN, PARTS_DRAWN, STAYS_DRAWN = 1000, 1000, 4000  # the first objects, the newest parts and stays
STEP = 1e-6  # resolution of positions, angles and belt positions [m], [rad]
DIGITS = 6
HOWS = tuple(How)
NO_BELT = -1
Drawn = tuple[int, Sequence[Stay]]  # row of a part in the story, and its visible stays


def surroundings(run: Run) -> dict[str, Any] | None:
    """Return the objects, belts and parts around the robot for a page; None without any."""
    story = run.cell
    if story is None or not (story.things or any(story.stays)):
        return None
    first = first_cycle(run)
    cycles = first + np.arange(len(run.window.time_s), dtype=np.float64)
    drawn = shown_stays(run, story)[-PARTS_DRAWN:]
    things = story.things[:THINGS_DRAWN]
    belts = [thing.name for thing in things if thing.kind is Kind.BELT]
    ways = _table([story.ways_m(belt, cycles) for belt in belts], len(cycles)).T
    offset = _first_known(ways)
    kinds = [_kind(story.parts[row]) for row, _ in drawn]
    types = list(dict.fromkeys(kinds))
    rows = [(n, stay) for n, (_, stays) in enumerate(drawn) for stay in stays][-STAYS_DRAWN:]
    return {
        'things': [_thing(thing) for thing in things],
        'belts': [row for row, thing in enumerate(things) if thing.kind is Kind.BELT],
        'ways': packed(ways - offset, STEP) if belts else None,
        'sizes': [list(size_m) for _, size_m in types],
        'parts': [
            [story.parts[row]['number'], types.index(kind), story.parts[row]['outcome']]
            for (row, _), kind in zip(drawn, kinds, strict=True)
        ],
        'hows': list(HOWS),
        'rows': len(rows),
        'stays': packed(_table([_stay(n, stay, first, belts) for n, stay in rows], 4), 1.0),
        'places': packed(_near(_table([_place(story, stay, belts, offset) for _, stay in rows], 5)), STEP),
    }


def first_cycle(run: Run) -> int:
    """Return the number of the first bus cycle of the window of a run."""
    return round(float(run.window.time_s[0]) / run.period_s) + (noted_cycle(run.window, 'start_cycle') or 0)


def shown_stays(run: Run, story: CellStory) -> list[Drawn]:
    """Return the parts visible in the window of a run, as rows of its story with their stays."""
    first = first_cycle(run)
    last = first + len(run.window.time_s) - 1
    found: list[Drawn] = []
    for row, stays in enumerate(story.stays):
        begun = [stay for stay in stays if stay.cycle <= first][-1:]
        shown = [*begun, *(stay for stay in stays if first < stay.cycle <= last)]
        if any(stay.how is not How.GONE for stay in shown):
            found.append((row, shown))
    return found


def _kind(part: Any) -> tuple[str, tuple[float, ...]]:
    return part['type'], tuple(part['size_m'])


def _thing(thing: Thing) -> list[Any]:
    numbers = *thing.at_m, thing.angle_rad, *thing.size_m
    return [thing.kind, *(round(number, DIGITS) for number in numbers)]


def _first_known(ways: Floats) -> Floats:
    """Return the first known position of each belt, shape (belts,); 0 without one."""
    known = np.isfinite(ways)
    return np.where(known.any(axis=0), ways[known.argmax(axis=0), np.arange(ways.shape[1])], 0.0)


def _stay(row: int, stay: Stay, first: int, belts: Sequence[str]) -> list[float]:
    belt = belts.index(stay.belt) if stay.belt in belts else NO_BELT
    return [row, max(stay.cycle - first, -1), HOWS.index(stay.how), belt]


def _place(story: CellStory, stay: Stay, belts: Sequence[str], offset: Floats) -> list[float]:
    begin = story.begin_m(stay) - offset[belts.index(stay.belt)] if stay.belt in belts else 0.0
    return [*stay.at_m, stay.angle_rad, begin]


def _table(rows: Sequence[Sequence[float] | Floats], columns: int) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def _near(values: Floats) -> Floats:
    """Replace numbers beyond the reach by nan: they would reduce the resolution of the others."""
    return np.where(np.abs(values) <= REACH_MAX_M, values, np.nan)
