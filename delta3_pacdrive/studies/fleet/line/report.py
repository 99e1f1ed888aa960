"""Summary, text and tables of a line."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from delta3_pacdrive.studies.fleet.line.shift import NO_ROBOT, BeltShift, Miss
from delta3_pacdrive.studies.fleet.line.study import Results
from delta3_pacdrive.studies.framework.report_folder import Table

TABLES = ('robots.csv', 'minutes.csv', 'missed.csv', 'picks.csv')
ROWS_MAX = 20_000  # of tables of parts
MINUTE_S = 60.0


def summary(results: Results) -> dict[str, Any]:
    """Return the summary of a shift for JSON."""
    line = results.line
    belts = [_belt(belt, results) for belt in results.belts]
    offered, picked = (sum(belt[key] for belt in belts) for key in ('offered', 'picked'))
    return {
        'line': line.name,
        'rule': str(line.rule),
        'seed': line.seed,
        'hours': line.hours,
        'offered': offered,
        'picked': picked,
        'share': _share(picked, offered),
        'picks_per_min': picked / (line.shift_s / MINUTE_S),
        'belts': belts,
        'tables': {'plans': results.check.plans, 'error_max_s': results.check.error_max_s},
        'seconds': results.seconds,
    }


def _belt(belt: BeltShift, results: Results) -> dict[str, Any]:
    picked = belt.robot >= 0
    shift_s = results.line.shift_s
    return {
        'belt': belt.belt,
        'offered': int(belt.offered.sum()),
        'picked': int(picked.sum()),
        'share': _share(int(picked.sum()), int(belt.offered.sum())),
        'missed': {str(kind): int((belt.missed == kind).sum()) for kind in Miss},
        'robots': [
            _robot(name, belt, belt.robot == number, shift_s) for number, name in enumerate(belt.robots)
        ],
    }


def _robot(name: str, belt: BeltShift, own: Any, shift_s: float) -> dict[str, Any]:
    picks = int(own.sum())
    return {
        'robot': name,
        'picks': picks,
        'picks_per_min': picks / (shift_s / MINUTE_S),
        'busy': float(belt.cycle_s[own].sum()) / shift_s,
        'cycle_mean_s': float(belt.cycle_s[own].mean()) if picks else None,
    }


def _share(picked: int, offered: int) -> float:
    return picked / offered if offered else 1.0


def text(document: dict[str, Any]) -> Iterator[str]:
    """Return the summary as lines of text."""
    yield (
        f'{document["line"]}: {document["hours"]:g} h, {document["rule"]}, seed {document["seed"]}: '
        f'{document["picked"]} of {document["offered"]} parts picked, {100.0 * document["share"]:.2f} %, '
        f'{document["picks_per_min"]:.1f} a minute'
    )
    tables = document['tables']
    if tables['plans']:
        error = 1e3 * tables['error_max_s']
        yield f'cycle times from tables; largest error {error:.3f} ms against {tables["plans"]} plans'
    for belt in document['belts']:
        yield ''
        yield f'belt {belt["belt"]}: {belt["picked"]} of {belt["offered"]}, {100.0 * belt["share"]:.2f} %'
        yield f'  {"robot":<16} {"picks":>8} {"a minute":>9} {"busy":>8} {"mean cycle":>11}'
        for one in belt['robots']:
            cycle = '-' if one['cycle_mean_s'] is None else f'{one["cycle_mean_s"]:.3f} s'
            rate = f'{one["picks_per_min"]:.1f}'
            yield f'  {one["robot"]:<16} {one["picks"]:8} {rate:>9} {100.0 * one["busy"]:6.1f} % {cycle:>11}'
        for kind, count in belt['missed'].items():
            if count:
                yield f'  missed: {count} {_EXPLAINED[kind]}'


_EXPLAINED = {
    str(Miss.OUT_OF_REACH): 'out of reach: no window is long enough to pick them',
    str(Miss.BUSY): 'while all robots that could have picked them were busy',
    str(Miss.LEFT): 'not allocated by the rule, though a robot was free',
}


def tables(results: Results) -> list[Table]:
    """Return the tables of a shift; those of parts are limited to ``ROWS_MAX`` rows."""
    robots = [
        {'belt': belt.belt, **_robot(name, belt, belt.robot == number, results.line.shift_s)}
        for belt in results.belts
        for number, name in enumerate(belt.robots)
    ]
    minutes: list[list[Any]] = []
    missed: list[list[Any]] = []
    picks: list[list[Any]] = []
    for belt in results.belts:
        minutes += _minutes(belt, results.line.shift_s)
        names = np.array([kind.name for kind in results.line.kinds])[belt.parts.kind]
        for part in np.flatnonzero(belt.missed != '')[: ROWS_MAX - len(missed)]:
            enters, across = float(belt.parts.enters_s[part]), float(belt.parts.across_m[part])
            missed.append(
                [belt.belt, int(part) + 1, str(names[part]), enters, across, str(belt.missed[part])]
            )
        order = np.argsort(belt.start_s)[: int((belt.robot >= 0).sum())]
        for part in order[: ROWS_MAX - len(picks)]:
            cycle = float(belt.cycle_s[part])
            picks.append(
                [belt.belt, int(part) + 1, belt.robots[belt.robot[part]], float(belt.start_s[part]), cycle]
            )
    header = ['belt', 'part', 'type', 'enters_s', 'across_m', 'reason']
    return [
        Table.of_rows(TABLES[0], robots),
        Table(TABLES[1], ['belt', 'minute', 'came', 'picked', 'missed'], minutes),
        Table(TABLES[2], header, missed),
        Table(TABLES[3], ['belt', 'part', 'robot', 'start_s', 'cycle_s'], picks),
    ]


def _minutes(belt: BeltShift, shift_s: float) -> list[list[Any]]:
    came, picked, missed = by_minute(belt, shift_s)
    rows = zip(came, picked, missed, strict=True)
    return [[belt.belt, minute + 1, *map(int, counts)] for minute, counts in enumerate(rows)]


def by_minute(belt: BeltShift, shift_s: float) -> tuple[Any, Any, Any]:
    """Return the numbers of arrived, picked and missed parts by minute of arrival."""
    edges = np.arange(0.0, shift_s + MINUTE_S, MINUTE_S)
    enters = belt.parts.enters_s
    return tuple(  # type: ignore[return-value]
        np.histogram(enters[which], edges)[0]
        for which in (belt.offered, belt.robot != NO_ROBOT, belt.missed != '')
    )
