"""What an estimation leaves behind: a report as JSON, tables as CSV, and with each how it can be repeated."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.analysis.estimation.identifiability import Verdict
from delta3_pacdrive.analysis.estimation.quantities import COMBINATIONS, TABLE, values_of
from delta3_pacdrive.analysis.estimation.solver import COLOURED, quieter_than_sensors
from delta3_pacdrive.analysis.estimation.thesis_setup import FACTORS, SYMBOLS, explanation
from delta3_pacdrive.analysis.provenance import write_table

if TYPE_CHECKING:
    from pathlib import Path

    from delta3_pacdrive.analysis.estimation.identifiability import Identifiability
    from delta3_pacdrive.analysis.estimation.problem import Problem
    from delta3_pacdrive.analysis.estimation.solver import Fit
    from delta3_pacdrive.analysis.estimation.thesis_setup import ThesisStudy
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.parameters import Parameters

ROWS_MAX = 20_000  # of a table of residuals; longer ones are thinned out


def estimates_table(
    fit: Fit, problem: Problem, parameters: Parameters, truth_known: bool
) -> list[dict[str, Any]]:
    """Return one row per estimate; what the signals do not show has no value but a reason."""
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
    """Return one row per free quantity: sensitivities in deviations of the noise, and what they mean."""
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
                'relative_error': finding.relative_error if math.isfinite(finding.relative_error) else None,
                'verdict': finding.verdict.value,
                'partners': ' '.join(finding.partners),
                'reason': finding.reason,
            }
        )
    return rows


def fit_document(
    fit: Fit, problem: Problem, parameters: Parameters, truth_known: bool, provenance: Provenance
) -> dict[str, Any]:
    """Return the report of an estimation, ready for JSON."""
    report = fit.identifiability
    return {
        'ok': True,
        'provenance': provenance.lines(),
        'estimates': estimates_table(fit, problem, parameters, truth_known),
        'identifiability': {
            'condition': _finite(report.condition),
            'condition_of_columns': _finite(report.condition_of_columns),
            'rank': report.rank,
            'singular_values': list(report.singular_values),
            'collinear': [asdict(group) for group in report.collinear],
            'quantities': sensitivity_table(report, problem),
        },
        'residuals': [
            {
                'signal': block.name,
                'unit': block.unit,
                'samples': list(array.shape),
                'rms': white.rms,
                'sensor_noise': block.sigma,
                'intervals_from': 'sensor noise'
                if quieter_than_sensors(white.rms, block.sigma)
                else 'residuals',
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


def study_document(study: ThesisStudy, cure: dict[str, Any]) -> dict[str, Any]:
    """Return the report of the thesis' set-up; ``cure`` is that of its last estimation."""
    return cure | {
        'explanation': explanation(study),
        'quotients': [asdict(q) for q in study.quotients],
        'profiles': study.profiles,
        'attempts': [asdict(a) for a in study.attempts],
    }


def write_fit_tables(
    document: dict[str, Any], fit: Fit, problem: Problem, folder: Path, provenance: Provenance
) -> list[Path]:
    """Write ``estimates.csv``, ``sensitivities.csv`` and ``residuals_N.csv`` for each signal."""
    own = dict.fromkeys(('start', 'estimate', 'low_95', 'high_95', 'true', 'scale'), '[unit]')
    units = own | dict.fromkeys(('half_width_relative', 'error_relative', 'relative_error'), '[1]')
    paths = []
    for name, rows in (
        ('estimates', document['estimates']),
        ('sensitivities', document['identifiability']['quantities']),
    ):
        keys = list(rows[0])
        header = [
            f'{key} [noise]' if key.startswith('sensitivity') else f'{key} {units.get(key, "")}'.strip()
            for key in keys
        ]
        table = [['' if row[key] is None else row[key] for key in keys] for row in rows]
        paths.append(write_table(folder / f'{name}.csv', header, table, provenance))
    for number, (block, array) in enumerate(zip(problem.blocks, fit.residuals, strict=True), start=1):
        every = -(-len(array) // ROWS_MAX)
        times = block.start_s + block.period_s * np.arange(len(array))
        suffixes = 'xyz' if block.name == 'TCP' else '123'
        header = ['time [s]', *(f'residual of {block.name} {suffix} [{block.unit}]' for suffix in suffixes)]
        rows = np.column_stack([times, array])[::every].tolist()
        paths.append(write_table(folder / f'residuals_{number}.csv', header, rows, provenance))
    return paths


def write_study_tables(study: ThesisStudy, folder: Path, provenance: Provenance) -> list[Path]:
    """Write ``quotients.csv``, ``profiles.csv`` and ``attempts.csv``."""
    quotients = [list(asdict(q).values()) for q in study.quotients]
    header = [
        'quantity', 'step [1]', 'quotient through encoder [noise per 100 %]',
        'quotient with ideal encoder [noise per 100 %]', 'cosine to the true slope [1]',
        'largest change of a shaft [increments]',
    ]  # fmt: skip
    paths = [write_table(folder / 'quotients.csv', header, quotients, provenance)]
    profiles = zip(FACTORS, *(study.profiles[s] for s in SYMBOLS), strict=True)
    header = ['factor [1]', *(f'cost over {s} less its minimum [noise^2]' for s in SYMBOLS)]
    paths.append(write_table(folder / 'profiles.csv', header, profiles, provenance))
    header = ['step [1]', 'start off [1]', *(f'{s} moved [1]' for s in SYMBOLS),
              'cost at start [SI]', 'cost [SI]', 'simulations', 'message']  # fmt: skip
    attempts = [
        [a.step, a.off, *a.moved, a.cost_start, a.cost, a.evaluations, a.message] for a in study.attempts
    ]
    paths.append(write_table(folder / 'attempts.csv', header, attempts, provenance))
    return paths


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
