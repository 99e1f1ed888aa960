"""Report of an estimation: JSON document, text and tables."""

from dataclasses import asdict
from typing import Any

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.estimation.identifiability import Identifiability, Verdict
from delta3_pacdrive.studies.estimation.missing_effects import BetterModel
from delta3_pacdrive.studies.estimation.model_check import ModelCheck
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import COMBINATIONS, TABLE, values_of
from delta3_pacdrive.studies.estimation.solver import COLOURED, Fit
from delta3_pacdrive.studies.estimation.thesis_setup import FACTORS, SYMBOLS, ThesisStudy, explanation
from delta3_pacdrive.studies.framework.columns import csv_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table, columns_of

ROWS_MAX = 20_000  # of a table of residuals; longer ones are decimated


def estimates_table(
    fit: Fit, problem: Problem, parameters: Parameters, truth_known: bool
) -> list[dict[str, Any]]:
    """Return one row per estimate; quantities that are not identifiable have a reason instead of a value."""
    reasons = {finding.symbol: finding.reason for finding in fit.identifiability.findings}
    true = values_of(parameters)
    combined = {c.symbol: c for c in COMBINATIONS}
    rows = []
    for e in fit.estimates:
        shown = e.verdict is Verdict.IDENTIFIABLE
        truth = None
        if truth_known:
            truth = combined[e.symbol].value(true, parameters) if e.formula else true[e.symbol]
        scale = abs(e.value) if e.formula else TABLE[e.symbol].extent(true[e.symbol])
        rows.append(
            {
                'quantity': e.symbol,
                'parameter': e.formula or TABLE[e.symbol].parameter,
                'unit': e.unit,
                'start': e.start,
                'estimate': e.value if shown else None,
                'low_95': e.value - e.half_width if shown else None,
                'high_95': e.value + e.half_width if shown else None,
                'scale': scale,
                'half_width_relative': e.half_width / scale if shown else None,
                'true': truth,
                'error_relative': (e.value - truth) / scale if shown and truth is not None else None,
                'verdict': e.verdict.value,
                'reason': reasons.get(e.symbol, 'a combination that the signals show'),
            }
        )
    return rows


def sensitivity_table(report: Identifiability, problem: Problem) -> list[dict[str, Any]]:
    """Return one row per free quantity: sensitivities in standard deviations of the noise, with the verdict."""
    rows = []
    for finding, quantity in zip(report.findings, problem.quantities, strict=True):
        blocks = {
            f'sensitivity of {block.name}': value
            for block, value in zip(problem.blocks, finding.sensitivity_by_block, strict=True)
        }
        rows.append(
            {
                'quantity': finding.symbol,
                'meaning': quantity.meaning,
                'sensitivity': finding.sensitivity,
                **blocks,
                'relative_error': to_dict(finding.relative_error),
                'verdict': finding.verdict.value,
                'partners': ' '.join(finding.partners),
                'reason': finding.reason,
            }
        )
    return rows


def fit_summary(fit: Fit, problem: Problem, parameters: Parameters, truth_known: bool) -> dict[str, Any]:
    """Return an estimation ready for JSON."""
    report = fit.identifiability
    return {
        'estimates': estimates_table(fit, problem, parameters, truth_known),
        'identifiability': {
            'condition': to_dict(report.condition),
            'condition_of_columns': to_dict(report.condition_of_columns),
            'rank': report.rank,
            'singular_values': list(report.singular_values),
            'collinear': to_dict(report.collinear),
            'quantities': sensitivity_table(report, problem),
        },
        'residuals': [
            {
                'signal': block.name,
                'unit': block.unit,
                'samples': list(array.shape),
                'rms': white.rms,
                'sensor_noise': block.sigma,
                'intervals_from': 'sensor noise' if block.is_quieter(white.rms) else 'residuals',
                'white': white.lag <= 1,
                'first_lag_below': COLOURED,
                'lag': white.lag,
            }
            for block, array, white in zip(problem.blocks, fit.residuals, fit.whiteness, strict=True)
        ],
        'solver': {
            'cost': fit.cost,
            'iterations': fit.iterations,
            'converged': fit.converged,
            'message': fit.message,
        },
    }


def judged(
    document: dict[str, Any],
    verdict: ModelCheck,
    better: BetterModel | None,
    parameters: Parameters,
    truth_known: bool,
) -> dict[str, Any]:
    """Return the document of an estimation with its verdict; intervals are removed if the model does not hold.

    If a better model holds, each interval is widened to include the interval of that model.
    """
    judgement = {
        'ok': verdict.holds,
        'model_holds': verdict.holds,
        'verdict': verdict.sentences,
        'checks': [asdict(block) | {'holds': block.holds} for block in verdict.blocks],
        'missing': None,
    }
    if verdict.holds:
        return judgement | document
    others: dict[str, dict[str, Any]] = {}
    if better is not None:
        found = fit_summary(better.fit, better.problem, parameters, truth_known)
        if better.check.holds:
            others = {row['quantity']: row for row in found['estimates']}
        judgement['missing'] = {
            'sentence': better.sentence,
            'effects': [asdict(one) for one in better.lacking],
            'model_holds': better.check.holds,
            'verdict': better.check.sentences,
            **{key: found[key] for key in ('estimates', 'residuals', 'solver')},
        }
    rows = [_widened(row, others.get(row['quantity'])) for row in document['estimates']]
    return judgement | document | {'estimates': rows}


def _widened(row: dict[str, Any], other: dict[str, Any] | None) -> dict[str, Any]:
    if row['estimate'] is None:
        return row
    low, high = None, None
    if other is not None and other['low_95'] is not None:
        low, high = min(row['low_95'], other['low_95']), max(row['high_95'], other['high_95'])
    half = None if low is None else (high - low) / 2.0 / row['scale']
    return row | {'low_95': low, 'high_95': high, 'half_width_relative': half}


def thesis_summary(study: ThesisStudy) -> dict[str, Any]:
    """Return the additional content of the document for the group ``thesis``."""
    return {
        'explanation': explanation(study),
        'quotients': to_dict(study.quotients),
        'profiles': study.profiles,
        'attempts': to_dict(study.attempts),
        'trials': [
            {
                'data': t.data,
                'outcome': t.outcome,
                'excess': t.excess,
                'error': t.attempt.error,
                **asdict(t.attempt),
            }
            for t in study.trials
        ],
    }


def text(document: dict[str, Any]) -> list[str]:
    """Return a summary as lines of text."""
    lines = [*document.get('verdict', ()), *document.get('explanation', ())]
    if document.get('other_group'):
        lines.append(other_group(document))
    lines += [_line(row) for row in document['estimates']]
    if more := document.get('missing'):
        lines.append(more['sentence'])
        lines += [_line(row) for row in more['estimates']]
    facts = document['identifiability']
    lines.append(
        f'{"condition":>14}  {facts["condition"]:.3g} scaled, {facts["condition_of_columns"]:.3g} of the columns'
    )
    for group in facts['collinear']:
        lines.append(
            f'{"collinear":>14}  {", ".join(group["symbols"])} (index {group["condition_index"]:.0f})'
        )
    for signal in document['residuals']:
        colour = 'white' if signal['white'] else f'correlated over {signal["lag"]} samples'
        lines.append(
            f'{signal["signal"]:>20}  residuals {signal["rms"]:.3g} {signal["unit"]} rms, '
            f'sensor noise {signal["sensor_noise"]:.3g}, {colour}; intervals from {signal["intervals_from"]}'
        )
    lines += [f'{"note":>14}  {note}' for note in document.get('notes', ())]
    if not document['solver']['converged']:
        lines.append(f'{"note":>14}  {document["solver"]["message"]}')
    if applied := document.get('applied'):
        lines.append(f'{applied["file"]}: parameters with the estimates')
        lines += [sentence for row in applied['before_after'] for sentence in row['text']]
    return lines


def _line(row: dict[str, Any]) -> str:
    if row['estimate'] is None:
        return f'{row["quantity"]:>14}  {row["verdict"]}: {row["reason"]}'
    error = '' if row['true'] is None else f'  true error {100.0 * row["error_relative"]:+.2g} %'
    if row['low_95'] is None:
        return f'{row["quantity"]:>14}  {row["estimate"]:.6g} {row["unit"]}, no valid interval{error}'
    low, high, value = row['low_95'], row['high_95'], row['estimate']
    share = 100.0 * row['half_width_relative']
    begin = f'{row["quantity"]:>14}  {value:.6g}'
    # widened intervals are asymmetric
    if abs(low + high - 2.0 * value) > 1e-6 * (high - low):
        return f'{begin}, {low:.6g} to {high:.6g} {row["unit"]} (95 %, {share:.2g} %){error}'
    half = (high - low) / 2.0
    return f'{begin} +- {half:.2g} {row["unit"]} (95 %, {share:.2g} %){error}'


def refusal(document: dict[str, Any]) -> str:
    """Return the reason for rejecting the estimates, in one sentence; empty if they are valid."""
    if document.get('model_holds', True):
        return ''
    more = document.get('missing')
    if more and more['model_holds'] and document.get('applied'):
        return ''
    begin = 'the model does not explain the data, so its estimates do not apply to the robot'
    if document.get('other_group'):
        return f'{begin}; {other_group(document)}'
    if not more:
        return begin
    effects = ','.join(one['effect'] for one in more['effects'])
    return f'{begin}; {more["sentence"]}' + (f' (found: {effects})' if effects else '')


def other_group(document: dict[str, Any]) -> str:
    """Return the group that explains the data, as a sentence."""
    name = document['other_group']
    return f'the quantities of the group {name} explain them: estimate these with --group {name}'


def fit_tables(document: dict[str, Any], fit: Fit, problem: Problem) -> list[Table]:
    """Return estimates, sensitivities and the residuals of each signal as tables."""
    own = dict.fromkeys(('start', 'estimate', 'low_95', 'high_95', 'true', 'scale'), '[unit]')
    units = own | dict.fromkeys(('half_width_relative', 'error_relative', 'relative_error'), '[1]')
    quantities = document['identifiability']['quantities']
    units |= dict.fromkeys((key for key in quantities[0] if key.startswith('sensitivity')), '[noise]')
    made = []
    for name, rows in (('estimates', document['estimates']), ('sensitivities', quantities)):
        header = [f'{key} {units.get(key, "")}'.strip() for key in rows[0]]
        made.append(Table(f'{name}.csv', header, [list(row.values()) for row in rows]))
    for number, (block, array) in enumerate(zip(problem.blocks, fit.residuals, strict=True), start=1):
        every = -(-len(array) // ROWS_MAX)
        title = f'residual of {block.name} {{}} [{block.unit}]'
        columns = {'time [s]': block.times(len(array))[::every]}
        columns |= columns_of(title, array[::every], block.columns)
        made.append(Table.of_columns(f'residuals_{number}.csv', columns))
    return made


def thesis_tables(study: ThesisStudy) -> list[Table]:
    """Return difference quotients, cost profiles and attempts as tables."""
    profiles = ['factor [1]', *(f'cost over {s} less its minimum [noise^2]' for s in SYMBOLS)]
    attempts = ['data', 'step [1]', 'start off [1]', *(f'{s} moved [1]' for s in SYMBOLS), 'largest error [1]',
                'cost at start [SI]', 'cost [SI]', 'cost of the least [1]', 'simulations', 'outcome',
                'message']  # fmt: skip
    costs = zip(FACTORS, *(study.profiles[s] for s in SYMBOLS), strict=True)
    tries = (
        [
            t.data,
            a.step,
            a.off,
            *a.moved,
            a.error,
            a.cost_start,
            a.cost,
            t.excess,
            a.evaluations,
            t.outcome,
            a.message,
        ]
        for t in study.trials
        for a in [t.attempt]
    )
    return [
        csv_table('quotients.csv', study.quotients),
        Table('profiles.csv', profiles, costs),
        Table('attempts.csv', attempts, tries),
    ]
