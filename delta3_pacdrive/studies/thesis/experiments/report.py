"""Report of an experiment: JSON document, text and tables."""

import math
from dataclasses import asdict, fields
from typing import Any

from delta3_pacdrive.studies.framework.columns import TextColumn, text_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table, columns_of
from delta3_pacdrive.studies.thesis.experiments.attribution import EFFECTS, Attribution
from delta3_pacdrive.studies.thesis.experiments.claims import Claim, claims, claims_over_seeds
from delta3_pacdrive.studies.thesis.experiments.compared_signals import OF_SAMPLES, QUANTITIES
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison, Statistics
from delta3_pacdrive.studies.thesis.experiments.conclusions import OTHER, conclusions, explanations, truth
from delta3_pacdrive.studies.thesis.experiments.study import Results

TABLES = ('signals.csv', 'table.csv', 'attribution.csv', 'claims.csv')
ACCELERATION = (
    'the actual acceleration is not measured: it is the slope of the least-squares line through the actual speed of '
    'the cycles within 2 ms on either side; the reference acceleration is the same slope of the reference speed'
)
SHOWN = [
    TextColumn('', '{text}'),
    TextColumn('', '{unit}'),
    TextColumn('model max', '{model_max:.4g}'),
    TextColumn('rms', '{model_rms:.4g}'),
    TextColumn('robot max', '{robot_max:.4g}'),
    TextColumn('rms', '{robot_rms:.4g}'),
    TextColumn('apart max', '{deviation_max:.4g}'),
    TextColumn('rms', '{deviation_rms:.4g}'),
    TextColumn('% of peak', '{deviation_max_percent:.4g}'),
]


def tables(found: Results) -> list[Table]:
    """Return signals, statistics, attribution and claims as tables."""
    made = [_signals(found.comparison), _statistics(found.comparison.statistics())]
    if found.attribution is not None:
        made.append(_attribution(found.attribution))
    if listed := _claims(found):
        made.append(Table.of_rows(TABLES[3], [_claim_row(claim) for claim in listed]))
    return made


def _claims(found: Results) -> list[Claim]:
    own = claims(found.number, found.comparison, found.attribution, found.elsewhere)
    return claims_over_seeds(own, [claims(found.number, other, None, where) for other, where in found.seeded])


def _claim_row(claim: Claim) -> dict[str, Any]:
    value = claim.value
    return {
        'section': claim.section,
        'claim': claim.text,
        'verdict': claim.verdict,
        'figure': claim.figure,
        'value [unit]': value.number if value else None,
        'lowest over seeds [unit]': claim.low,
        'highest over seeds [unit]': claim.high,
        'limit [unit]': value.limit if value else None,
        'unit': value.unit if value else '',
        'seeds [1]': claim.seeds + 1,
        'by construction': claim.by_construction,
    }


def _signals(comparison: Comparison) -> Table:
    """Return all drawn signals in every cycle [SI]."""
    columns = {'time [s]': comparison.time_s}
    model, robot = comparison.model, comparison.robot
    for name in comparison.names:
        quantity = QUANTITIES[name]
        labels = [f'_{label}' if label else '' for label in quantity.columns]
        for who, values in (('model', model.actual), ('robot', robot.actual),
                            ('model reference', model.reference), ('robot reference', robot.reference)):  # fmt: skip
            if name in values:
                columns |= columns_of(f'{name}{{}} {who} [{quantity.unit}]', values[name], labels)
    for name in OF_SAMPLES:
        for who, values in (('model', model.actual), ('robot', robot.actual)):
            if name in values:
                columns |= columns_of(f'{name}{{}} {who} [A]', values[name], ('_1', '_2', '_3'))
    return Table.of_columns(TABLES[0], columns)


def _statistics(rows: list[Statistics]) -> Table:
    units = {'deviation_max_at_s': ' [s]', 'signal': '', 'column': '', 'unit': ''}
    names = [field.name for field in fields(Statistics)]
    header = [name + (' [%]' if name.endswith('_percent') else units.get(name, ' [unit]')) for name in names]
    return Table(TABLES[1], header, [list(asdict(row).values()) for row in rows])


def _attribution(attribution: Attribution) -> Table:
    """Return one row per attributed number and effect [SI]."""
    header = [
        'signal', 'statistic', 'unit', 'model [unit]', 'robot [unit]', 'effect', 'alone [unit]', 'left_out [unit]',
        'share [unit]', 'alone [%]', 'left_out [%]', 'share [%]',
    ]  # fmt: skip
    rows: list[list[Any]] = []
    for outcome in attribution.outcomes.values():
        begin = [outcome.signal, outcome.statistic, outcome.unit, outcome.model, outcome.robot]
        for name in attribution.effects:
            values = [by[name] for by in (outcome.alone, outcome.left_out, outcome.share)]
            rows.append([*begin, name, *values, *map(outcome.percent, values)])
        rows.append([*begin, OTHER, '', '', outcome.other, '', '', outcome.percent(outcome.other)])
    return Table(TABLES[2], header, rows)


def summary(found: Results) -> dict[str, Any]:
    """Return the report, ready for JSON."""
    comparison = found.comparison
    rows, missing = comparison.statistics(), comparison.missing
    concluded = conclusions(rows)
    notes, apart = list(found.notes), 1e3 * comparison.reference_apart_m()
    unseen = [name for name in missing if name.endswith('_true')]
    if unseen:
        notes.append(f'topics do not contain true values, so these signals are missing: {", ".join(unseen)}')
    if absent := [name for name in missing if name not in unseen]:
        notes.append(f'these signals are not in both runs: {", ".join(absent)}')
    return {
        'experiment': found.number,
        'program': found.program,
        'cycles': int(comparison.counted.sum()),
        'period_s': comparison.model.period_s,
        'acceleration': ACCELERATION,
        'references_apart_mm': apart if math.isfinite(apart) else None,
        'missing': missing,
        'findings': to_dict(concluded),
        'claims': [to_dict(claim) | {'sentence': claim.sentence} for claim in _claims(found)],
        'truth': truth(rows),
        'signals': [{'text': QUANTITIES[row.signal].text} | to_dict(row) for row in rows],
        'attribution': None if found.attribution is None else _attribution_summary(found.attribution),
        'notes': notes,
    }


def _attribution_summary(attribution: Attribution) -> dict[str, Any]:
    return {
        'simulations': attribution.simulations,
        'effects': {name: EFFECTS[name].text for name in attribution.effects},
        'other_parameters': list(attribution.other_parameters),
        'outcomes': [
            to_dict(outcome) | {'unit': outcome.unit, 'total': outcome.total}
            for outcome in attribution.outcomes.values()
        ],
        'explanations': explanations(attribution),
    }


def text(document: dict[str, Any]) -> list[str]:
    """Return a summary as lines of text."""
    rows = [row for row in document['signals'] if row['column'] in ('', 'all')]
    lines = [document['program'], *text_table(rows, SHOWN)]
    sentences = [conclusion['sentence'] for conclusion in document['findings']]
    sentences += [document['truth']] if document['truth'] else []
    lines.append('')
    lines += [f'- {sentence}' for sentence in sentences]
    if found := document.get('claims'):
        lines += ['', 'Claims:', *(f'- {claim["sentence"]}' for claim in found)]
    if document['attribution'] is not None:
        lines += ['', 'Attribution (Shapley values; for a deviation shares of its mean square):']
        lines += [f'- {sentence}' for sentence in document['attribution']['explanations']]
    return [*lines, '', *(f'note: {note}' for note in document['notes'])]
