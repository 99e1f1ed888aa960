"""Summary, text and tables of an optimisation."""

import math
import shlex
from collections.abc import Iterator
from typing import Any

from delta3_pacdrive.studies.fleet.optimisation.study import Results, Trial, Trials
from delta3_pacdrive.studies.fleet.sweep.report import counts
from delta3_pacdrive.studies.fleet.sweep.study import Law
from delta3_pacdrive.studies.framework.report_folder import Table

TABLES = ('best.csv', 'figures.csv', 'trials.csv')


def summary(results: Results) -> dict[str, Any]:
    """Return the summary of an optimisation, ready for JSON."""
    found, sweep = results.trials, results.trials.optimisation.sweep
    best = found.best
    return {
        'optimisation': sweep.name,
        'program': sweep.program_name,
        'goal': found.optimisation.goal,
        'maximise': found.optimisation.maximise,
        'limits': dict(sweep.limits),
        'trials': sweep.runs,
        'trials_within_limits': sum(one.keeps_limits for one in found.trials),
        'runs_made': results.made,
        'workers': results.workers,
        'seconds': results.seconds if results.made else None,
        **counts([one.outcome for one in found.trials], [one.reason for one in found.trials], 'trials'),
        'base': _to_dict(found, found.base),
        'best': None if best is None else _to_dict(found, best),
        'nearest': None if best is not None or found.nearest is None else _to_dict(found, found.nearest),
        'importance': dict(found.importance),
        'again': None if not results.files else again(*map(str, results.files)),
    }


def again(parameters: str, program: str) -> str:
    """Return the command that runs the best trial again."""
    return f'delta3 simulate {shlex.quote(program)} --parameters {shlex.quote(parameters)}'


def _to_dict(found: Trials, trial: Trial) -> dict[str, Any]:
    return {
        'trial': trial.number,
        'value': found.value(trial),
        'outcome': str(trial.outcome),
        'reason': trial.reason,
        'keeps_limits': trial.keeps_limits,
        'values': dict(trial.values),
        'kept': dict(trial.kept),
    }


def text(document: dict[str, Any]) -> Iterator[str]:
    """Yield the summary as lines of text."""
    outcomes = ', '.join(f'{count} {name}' for name, count in document['outcomes'].items() if count)
    within = f'; {document["trials_within_limits"]} within the limits' if document['limits'] else ''
    yield f'{document["optimisation"]}: {document["trials"]} trials of {document["program"]}: {outcomes}{within}'
    if document['runs_made']:
        yield (
            f'{document["runs_made"]} runs made now by {document["workers"]} workers in {document["seconds"]:.1f} s'
        )
    for one in document['reasons']:
        yield f'{one["trials"]} trials: {one["reason"]}'
    best, base, goal = document['best'], document['base'], document['goal']
    if best is None:
        yield 'no trial is within the limits'
        best = document['nearest']
        if best is None:
            return
        broken = [
            f'{name} {best["kept"][name]:.5g} > {limit:g}'
            for name, limit in document['limits'].items()
            if best['kept'].get(name, math.inf) > limit and name in best['kept']
        ]
        yield f'trial {best["trial"]} exceeds them least: {", ".join(broken)}'
    word = 'largest' if document['maximise'] else 'least'
    yield f'{word} {goal}: {_number(best["value"])} in trial {best["trial"]}{_base_text(best, base)}'
    names = list(best['values'])
    width = max(map(len, names), default=0)
    yield ''
    yield f'{"":{width}}  {"base":>12} {"best":>12} {"importance":>11}'
    for name in names:
        share = document['importance'].get(name)
        yield (
            f'{name:{width}}  {_number(base["values"].get(name)):>12} {_number(best["values"][name]):>12} '
            f'{"" if share is None else f"{100.0 * share:.0f} %":>11}'
        )
    for name, limit in document['limits'].items():
        yield f'{name}: {_number(best["kept"].get(name))}, the limit is {limit:g}'
    if document['again']:
        yield f'again: {document["again"]}'


def _base_text(best: dict[str, Any], base: dict[str, Any]) -> str:
    if base['value'] is None:
        return f'; the base is {base["outcome"]}: {base["reason"]}'
    share = (best['value'] - base['value']) / abs(base['value']) if base['value'] else math.nan
    change = f' ({100.0 * share:+.1f} %)' if math.isfinite(share) else ''
    return f', {_number(base["value"])} with the values of the files{change}'


def _number(value: Any) -> str:
    if value is None:
        return '-'
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return f'{value:.5g}'
    return str(value)


def tables(found: Trials) -> list[Table]:
    """Return the best trial, its figures and all trials as tables."""
    best = found.best or found.nearest or found.base
    lowest = {
        one.key: ('', '') if one.law is Law.LIST else (one.values[0], one.values[1])
        for one in found.optimisation.sweep.vary
    }
    chosen = [
        [
            key,
            _cell(found.base.values.get(key)),
            _cell(best.values.get(key)),
            *span,
            found.importance.get(key),
        ]
        for key, span in lowest.items()
    ]
    names = dict.fromkeys([*found.base.kept, *best.kept])
    figures = [
        [name, found.base.kept.get(name), best.kept.get(name), found.optimisation.sweep.limits.get(name)]
        for name in names
    ]
    kept = dict.fromkeys([found.optimisation.goal, *found.optimisation.sweep.limits])
    history = [
        [
            one.number,
            str(one.outcome),
            'yes' if one.keeps_limits else 'no',
            *(one.kept.get(name) for name in kept),
            *(_cell(one.values.get(key)) for key in lowest),
            one.reason,
        ]
        for one in found.trials
    ]
    return [
        Table(TABLES[0], ['quantity', 'base', 'best', 'least', 'greatest', 'importance'], chosen),
        Table(TABLES[1], ['figure', 'base', 'best', 'limit'], figures),
        Table(TABLES[2], ['trial', 'outcome', 'keeps limits', *kept, *lowest, 'reason'], history),
    ]


def _cell(value: Any) -> Any:
    return value if isinstance(value, (int, float, str)) or value is None else repr(value)
