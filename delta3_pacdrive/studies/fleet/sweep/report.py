"""Summary, text and tables of a sweep."""

import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from delta3_pacdrive.studies.fleet.sweep.effects import distributions, effects, worst, yields
from delta3_pacdrive.studies.fleet.sweep.study import Outcome, Results, Runs
from delta3_pacdrive.studies.framework.columns import csv_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table

TABLES = ('distributions.csv', 'effects.csv', 'worst.csv', 'runs.csv')
LISTED = 3  # effects listed for each result
REASONS = 5
CSV_RUNS_MAX = 100_000  # rows of the CSV table


def summary(results: Results, specification: str) -> dict[str, Any]:
    """Return the summary of a sweep, ready for JSON."""
    found = results.runs
    return {
        'sweep': found.sweep.name,
        'program': found.sweep.program_name,
        'sampling': str(found.sweep.sampling),
        'runs': found.sweep.runs,
        'runs_made': results.made,
        'workers': results.workers,
        'seconds': to_dict(results.seconds),
        'runs_per_second': to_dict(results.made / results.seconds) if results.seconds > 0.0 else None,
        **counts(found.outcomes, found.reasons, 'runs'),
        'distributions': to_dict(distributions(found)),
        'effects': to_dict(effects(found)),
        'yields': [to_dict(one) | {'share': one.share} for one in yields(found)],
        'worst': [
            {
                'name': name,
                'runs': [{'run': run, 'command': command(specification, run)} for run in worst(found, name)],
            }
            for name in (found.sweep.limits or list(found.kept)[:1])
        ],
    }


def counts(outcomes: Sequence[str], reasons: Sequence[str], runs: str) -> dict[str, Any]:
    """Return the number of runs by outcome and the most common reasons; ``runs`` is the key of their number."""
    common = Counter(filter(None, reasons)).most_common(REASONS)
    return {
        'outcomes': {str(kind): outcomes.count(kind) for kind in Outcome},
        'reasons': [{'reason': reason, runs: count} for reason, count in common],
    }


def command(specification: str, run: int) -> str:
    """Return the command that repeats a run and stores its trace."""
    return f'delta3 sweep {shlex.quote(specification)} --run {run} --trace run{run}.npz'


def text(document: dict[str, Any]) -> Iterator[str]:
    """Yield the summary as lines of text."""
    outcomes = ', '.join(f'{count} {name}' for name, count in document['outcomes'].items() if count)
    yield f'{document["sweep"]}: {document["runs"]} runs of {document["program"]}, {document["sampling"]}: {outcomes}'
    if document['runs_made']:
        rate = document['runs_per_second']
        per_second = f', {rate:.1f} per second' if rate else ''
        seconds = f'{document["seconds"] or 0.0:.1f} s{per_second}'
        yield f'{document["runs_made"]} new runs by {document["workers"]} workers in {seconds}'
    for one in document['reasons']:
        yield f'{one["runs"]} runs: {one["reason"]}'
    names = [one['name'] for one in document['distributions']]
    width = max(map(len, names), default=0)
    if names:
        yield ''
        yield f'{"":{width}}  {"mean":>11} {"deviation":>11} {"least":>11} {"median":>11} {"99 %":>11} {"greatest":>11}'
    for one in document['distributions']:
        shares = one['shares']
        row = one['mean'], one['deviation'], one['low'], shares['0.5'], shares['0.99'], one['high']
        yield f'{one["name"]:{width}}  ' + ' '.join(f'{value:11.5g}' for value in row)
    for name in names:
        found = [one for one in document['effects'] if one['name'] == name]
        if found:
            yield from _effects(name, found)
    for one in document['yields']:
        yield (
            f'{100.0 * one["share"]:.2f} % of the runs have {one["name"]} <= {one["limit"]:g} '
            f'({100.0 * one["low"]:.2f} to {100.0 * one["high"]:.2f} %, 95 %)'
        )
    for one in document['worst']:
        if one['runs']:
            yield f'worst in {one["name"]}: {one["runs"][0]["command"]}'


def _effects(name: str, found: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the largest contributions to the variance of a result."""
    of_sobol = found[0]['total'] is not None
    order = sorted(found, key=lambda one: -(one['total'] if of_sobol else one['share']))[:LISTED]
    terms = [
        f'{one["key"]} {100.0 * one["first"]:.0f} +- {100.0 * one["first_interval"]:.0f} % '
        f'(in all {100.0 * one["total"]:.0f} +- {100.0 * one["total_interval"]:.0f} %)'
        if of_sobol
        else f'{one["key"]} {100.0 * one["share"]:.0f} %'
        for one in order
    ]
    yield f'{name}: shares of its variance {", ".join(terms)}'


def tables(found: Runs, specification: str) -> list[Table]:
    """Return the tables of a sweep; that of the runs is limited to ``CSV_RUNS_MAX`` rows."""
    made = []
    if every := distributions(found):
        made.append(csv_table(TABLES[0], every))
    if shown := effects(found):
        made.append(Table.of_rows(TABLES[1], [asdict(one) for one in shown]))
    first = next(iter(found.sweep.limits or found.kept), None)
    if first is not None:
        rows = [
            [run, found.outcomes[run - 1], float(found.kept[first][run - 1]), command(specification, run)]
            for run in worst(found, first)
        ]
        made.append(Table(TABLES[2], ['run', 'outcome', first, 'again with'], rows))
    return [*made, _runs(found)]


def _runs(found: Runs) -> Table:
    columns = {**found.values, **found.kept}
    count = min(found.sweep.runs, CSV_RUNS_MAX)
    rows = [
        [n + 1, found.outcomes[n], *(_cell(column[n]) for column in columns.values()), found.reasons[n]]
        for n in range(count)
    ]
    return Table(TABLES[3], ['run', 'outcome', *columns, 'reason'], rows)


def _cell(value: Any) -> Any:
    plain = value.item() if isinstance(value, np.generic) else value
    return plain if isinstance(plain, (int, float, str)) or plain is None else repr(plain)
