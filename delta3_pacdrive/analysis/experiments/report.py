"""An experiment from the runs to its folder: signals, tables, figures and report, each with how it can be repeated."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.analysis import figure_style
from delta3_pacdrive.analysis.experiments import figures
from delta3_pacdrive.analysis.experiments.attribution import EFFECTS
from delta3_pacdrive.analysis.experiments.comparison import QUANTITIES, Statistics
from delta3_pacdrive.analysis.experiments.conclusions import OTHER, conclusions, explanations, truth, verdict
from delta3_pacdrive.analysis.provenance import Provenance, write_json, write_table
from delta3_pacdrive.errors import ReportError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from delta3_pacdrive.analysis.experiments.attribution import Attribution, Outcome
    from delta3_pacdrive.analysis.experiments.comparison import Comparison
    from delta3_pacdrive.parameters import Parameters

REPORT = 'report.json'
TABLES = ('signals.csv', 'table.csv', 'attribution.csv')
MODEL_FILE, ROBOT_FILE = 'model.yaml', 'robot.yaml'
ACCELERATION = (
    'the actual acceleration is not measured: it is the slope of the least-squares line through the actual speed of '
    'the cycles within 2 ms on either side; the reference acceleration is the same slope of the reference speed'
)


def provenance_of(
    command: str, model: Parameters, robot: Parameters, names: tuple[str, str], inputs: Sequence[str]
) -> Provenance:
    """Note where an experiment comes from; ``names`` are those of the two parameter files."""
    seed = robot.rich.sensor_seed if robot.rich.effects.sensors else None
    origin = Provenance.of(command, model, names[0], inputs, seed)
    both = f'model {origin.parameters}, robot {robot.checksum} ({names[1]})'
    return replace(origin, parameters=both)


def write_parameters(model: Parameters, robot: Parameters, folder: Path) -> tuple[Path, Path]:
    """Write the parameters of both into the folder, made if it is not there; raises ReportError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return core.write(model, folder / MODEL_FILE), core.write(robot, folder / ROBOT_FILE)
    except OSError as error:
        raise ReportError(f'cannot write to {folder}: {error.strerror or error}') from error


def clear(number: int, folder: Path) -> None:
    """Remove what an earlier report of the experiment left, so that none looks complete; raises ReportError."""
    try:
        for pattern in (REPORT, *TABLES, *figures.file_names(number)):
            for path in folder.glob(pattern):
                path.unlink()
    except OSError as error:
        raise ReportError(f'cannot write to {folder}: {error.strerror or error}') from error


def write(
    number: int,
    program: str,
    comparison: Comparison,
    attribution: Attribution | None,
    notes: Sequence[str],
    folder: Path,
    provenance: Provenance,
) -> dict[str, Any]:
    """Write everything of an experiment, the report last, and return it.

    Raises
    ------
    ReportError, FigureError
        Something cannot be written.

    """
    rows = comparison.statistics()
    tables = [
        write_signals(comparison, folder, provenance),
        write_statistics(rows, folder, provenance),
    ]
    if attribution is not None:
        tables.append(write_attribution(attribution, folder, provenance))
    drawings = figures.by_name(number, comparison, attribution, provenance)
    pictures = figure_style.save(drawings, folder, provenance.lines())
    document = _document(number, program, comparison, rows, attribution, notes, provenance)
    report = folder / REPORT
    parameters = [folder / name for name in (MODEL_FILE, ROBOT_FILE)]
    document['files'] = [str(path) for path in (report, *parameters, *tables, *pictures)]
    write_json(document, report)
    return document


def write_signals(comparison: Comparison, folder: Path, provenance: Provenance) -> Path:
    """Write ``signals.csv``: all that is drawn, cycle by cycle, in SI."""
    header, columns = ['time [s]'], [comparison.time_s[:, None]]
    for name in comparison.names:
        quantity = QUANTITIES[name]
        runs = {'model': comparison.model.actual, 'robot': comparison.robot.actual}
        if name in comparison.model.reference:
            runs |= {
                'model reference': comparison.model.reference,
                'robot reference': comparison.robot.reference,
            }
        for who, values in runs.items():
            suffixes = [f'_{column}' if column else '' for column in quantity.columns]
            header += [f'{name}{suffix} {who} [{quantity.unit}]' for suffix in suffixes]
            columns.append(values[name])
    table = np.hstack(columns)
    rows = (['' if value != value else value for value in row] for row in table.tolist())
    return write_table(folder / TABLES[0], header, rows, provenance)


def write_statistics(rows: Sequence[Statistics], folder: Path, provenance: Provenance) -> Path:
    """Write ``table.csv``: maxima, rms and deviations of every signal."""
    units = {'deviation_max_at_s': '[s]', 'signal': '', 'column': '', 'unit': ''}
    header = []
    for field in fields(Statistics):
        unit = '[%]' if field.name.endswith('_percent') else units.get(field.name, '[unit]')
        header.append(f'{field.name} {unit}'.strip())
    table = (['' if value is None else value for value in asdict(row).values()] for row in rows)
    return write_table(folder / TABLES[1], header, table, provenance)


def write_attribution(attribution: Attribution, folder: Path, provenance: Provenance) -> Path:
    """Write ``attribution.csv``: one row per number that is explained and effect, in SI."""
    header = [
        'signal', 'statistic', 'unit', 'model [unit]', 'robot [unit]', 'effect', 'alone [unit]', 'left_out [unit]',
        'share [unit]', 'alone [%]', 'left_out [%]', 'share [%]',
    ]  # fmt: skip
    rows: list[list[Any]] = []
    for outcome in attribution.outcomes.values():
        begin = [outcome.signal, outcome.statistic, outcome.unit, outcome.model, outcome.robot]
        for name in attribution.effects:
            values = [by[name] for by in (outcome.alone, outcome.left_out, outcome.share)]
            rows.append([*begin, name, *values, *_percents(outcome, values)])
        rows.append([*begin, OTHER, '', '', outcome.other, '', '', *_percents(outcome, [outcome.other])])
    return write_table(folder / TABLES[2], header, rows, provenance)


def _percents(outcome: Outcome, values: Sequence[float]) -> list[Any]:
    return ['' if (percent := outcome.percent(value)) is None else percent for value in values]


def _document(
    number: int,
    program: str,
    comparison: Comparison,
    rows: Sequence[Statistics],
    attribution: Attribution | None,
    notes: Sequence[str],
    provenance: Provenance,
) -> dict[str, Any]:
    found = conclusions(list(rows))
    missing = comparison.missing
    told = list(notes)
    if missing:
        told.append(
            f'topics do not carry what is really there, so these signals are missing: {", ".join(missing)}'
        )
    return {
        'ok': True,
        'experiment': number,
        'program': program,
        'provenance': provenance.lines(),
        'cycles': int((comparison.model.cycle >= 0).sum()),
        'acceleration': ACCELERATION,
        'references_apart_mm': 1e3 * comparison.reference_apart_m(),
        'missing': missing,
        'reproduced': all(finding.holds for finding in found),
        'verdict': verdict(found),
        'findings': [asdict(finding) for finding in found],
        'truth': truth(list(rows)),
        'signals': [{'text': QUANTITIES[row.signal].text} | asdict(row) for row in rows],
        'attribution': None if attribution is None else _attribution_document(attribution),
        'notes': told,
    }


def _attribution_document(attribution: Attribution) -> dict[str, Any]:
    return {
        'simulations': attribution.simulations,
        'effects': {name: EFFECTS[name].text for name in attribution.effects},
        'other_parameters': list(attribution.other_parameters),
        'outcomes': [
            asdict(outcome) | {'unit': outcome.unit, 'total': outcome.total}
            for outcome in attribution.outcomes.values()
        ],
        'explanations': explanations(attribution),
    }
