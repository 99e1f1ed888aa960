"""Report of the Jacobian experiments: JSON summary, conclusions in sentences, tables."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.framework.columns import csv_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table, columns_of
from delta3_pacdrive.studies.thesis.jacobian import condition
from delta3_pacdrive.studies.thesis.jacobian.condition import Sweep
from delta3_pacdrive.studies.thesis.jacobian.deviation import THRESHOLD, Deviation, largest_momentary
from delta3_pacdrive.studies.thesis.jacobian.mapping import LENGTHS, JointMotion, Pose
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion, Signals
from delta3_pacdrive.studies.thesis.jacobian.study import (
    LATE,
    PRINTED_JACOBIAN_DOT,
    WITHOUT_JACOBIAN_DOT,
    Results,
    Settings,
    Trial,
)

IMPLAUSIBLE_M = 0.01  # error of a length that drawings and drilling cannot cause
QUANTITIES = ('velocity', 'acceleration')
PERCENTAGES, COMPARED = ('of_peak', 'momentary'), ('exact', 'inexact')


def error_text(errors: Mapping[str, float], mathematical: bool = False) -> str:
    """Return errors of lengths [m] by symbol as text in millimetres, in mathtext if ``mathematical``."""
    sign = '$' if mathematical else ''
    return ', '.join(f'{sign}{symbol}{sign} {1e3 * error:+g} mm' for symbol, error in errors.items())


def number(value: float) -> str:
    """Return a number with two significant digits, or as an integer."""
    return f'{value:.2g}' if abs(value) < 99.5 else f'{value:.0f}'


def summary(found: Results, settings: Settings, robot: Parameters) -> dict[str, Any]:
    """Return the report for JSON."""
    result: dict[str, Any] = {
        'errors_m': dict(settings.errors),
        'lengths_m': {symbol: getattr(robot.kinematics, key) for symbol, key in LENGTHS.items()},
        'pose': settings.pose.value,
        'signals': settings.signals.value,
        'threshold': THRESHOLD,
        'trajectories': [_trajectory(trial) for trial in found.trials],
        'condition': {
            'workspace': condition.workspace(robot.kinematics),
            'decades': condition.decades(found.sweep),
            'exponents': condition.exponents(found.sweep),
        },
    }
    result['findings'] = conclusions(result)
    return result


def conclusions(result: dict[str, Any]) -> list[str]:
    """Return conclusions from the numbers of a report as sentences."""
    rows, pose = result['trajectories'], result['pose']
    thesis = [row['thesis_percent'] for row in rows]
    compared = f' (thesis: {_list(thesis)})' if None not in thesis else ''
    velocity, acceleration = (max(_largest(rows, 'exact', quantity)) for quantity in QUANTITIES)
    tolerance = [row['every_length_1_mm_off']['velocity'] for row in rows]
    left = 'what differencing, rounding and noise leave'
    if result['signals'] == Signals.TRUE:
        left += ', and the errors of the arms as they are built'
    return [
        f'With exact lengths joint velocities deviate by at most {velocity:.2g} %, accelerations by '
        f'{acceleration:.2g} % of their peaks: {left}.',
        f'With {error_text(result["errors_m"])} the velocities deviate by '
        f'{_list(_largest(rows, "inexact", "velocity"))} % of their peaks{compared}, '
        f'the accelerations by {_list(_largest(rows, "inexact", "acceleration"))} %.',
        f'Every length 1 mm off makes at most {_list([t["of_peak"] for t in tolerance])} % of the peak velocities, but '
        f'{_list([t["momentary"] for t in tolerance])} % of momentary ones above {100.0 * THRESHOLD:g} % of the peak: '
        'such percentages tell of small denominators.',
        _needed_sentence(rows, pose),
        'With exact lengths, Jdot left out makes the accelerations deviate by '
        f'{_list(_caused(rows, WITHOUT_JACOBIAN_DOT))} % of their peaks, (4.15) as printed by '
        f'{_list(_caused(rows, PRINTED_JACOBIAN_DOT))} %; one bus cycle between TCP and joints the velocities by '
        f'{_list(_caused(rows, LATE))} %.',
        _condition_sentence(rows, result['condition'], pose),
    ]


def _needed_sentence(rows: list[dict[str, Any]], pose: str) -> str:
    """Return the error of each length that alone causes the deviation of the joint velocities in the thesis."""
    parts = []
    for symbol in LENGTHS:
        own = [s for row in rows for s in row['sensitivities'] if s['pose'] == pose and s['symbol'] == symbol]
        if all(s['velocity']['of_peak'] == 0.0 for s in own):
            parts.append(f'{symbol} none, it does not enter')
            continue
        of_peak, momentary = (
            _millimetres([s[key] for s in own]) for key in ('needed_of_peak_m', 'needed_momentary_m')
        )
        parts.append(f'{symbol} {of_peak} ({momentary})')
    wanted = _list([s['target_percent'] for row in rows for s in row['sensitivities'][:1]])
    return f'Alone, {wanted} % of the peak (of the momentary) velocity takes an error of {", ".join(parts)}.'


def _millimetres(values: list[float | None]) -> str:
    texts = ['none' if value is None else number(1e3 * value) for value in values]
    return ' / '.join(texts) + ('' if set(texts) == {'none'} else ' mm')


def _condition_sentence(rows: list[dict[str, Any]], swept: dict[str, Any], pose: str) -> str:
    inside = swept['workspace']
    low = min(row['condition']['min'] for row in rows)
    high = max(row['condition']['max'] for row in rows)
    medians = _list([decade[pose]['median'] for decade in swept['decades']])
    return (
        f'On the trajectories cond(J) is {low:.2f} to {high:.2f}, in the workspace up to '
        f'{inside["condition"]["max"]:.2f}, where 1 mm of each length, independently, makes '
        f'{inside[pose]["least"]:.2f} to {inside[pose]["largest"]:.2f} % in the worst direction of motion; beyond, '
        'towards the singularities, '
        f'the median is {medians} % by decade of cond(J), growing as cond(J)^{swept["exponents"][pose]["all"]:.2f} '
        f'from {condition.FITTED:g} on.'
    )


def text(document: dict[str, Any]) -> list[str]:
    """Return the lines of a summary as text."""
    columns = ('exact lengths', error_text(document['errors_m']), 'all 1 mm off, at worst')
    widths = [max(len(column), 17) for column in columns]

    def line(name: str, cells: Iterable[str]) -> str:
        texts = [cell.rjust(width) for cell, width in zip(cells, widths, strict=True)]
        return f'{name:>14}  {"  ".join(texts)}'

    lines = [line('', columns), line('', ['peak / momentary*'] * len(columns))]
    for row in document['trajectories']:
        low, high = row['condition']['min'], row['condition']['max']
        lines.append(f'{row["name"]}: {row["samples"]} samples, cond(J) {low:.2f} to {high:.2f}')
        for quantity in QUANTITIES:
            cells = [{key: row[which][quantity][key]['max'] for key in PERCENTAGES} for which in COMPARED]
            cells.append(row['every_length_1_mm_off'][quantity])
            lines.append(
                line(
                    quantity,
                    (' / '.join(number(cell[key]).rjust(7) for key in PERCENTAGES) for cell in cells),
                )
            )
    share = f'{100.0 * document["threshold"]:g} %'
    lines.append(
        f'largest deviations in percent of the peak, and of the momentary value (* where above {share} of the peak)'
    )
    return [*lines, *(f'- {sentence}' for sentence in document['findings'])]


def tables(found: Results) -> list[Table]:
    """Return tables of signals and deviations, sensitivities to each length, and the condition of the Jacobian."""
    sensitivities = [row for trial in found.trials for row in trial.sensitivities]
    return [_signals(found.trials), csv_table('sensitivities.csv', sensitivities), _condition(found.sweep)]


def _trajectory(trial: Trial) -> dict[str, Any]:
    motion = trial.motion
    return {
        'name': motion.name,
        'source': motion.source,
        'samples': len(motion.time_s),
        'thesis_percent': motion.thesis.deviation_percent if motion.thesis else None,
        'condition': {'min': float(trial.condition.min()), 'max': float(trial.condition.max())},
        'worst_direction_percent': {'min': float(trial.worst.min()), 'max': float(trial.worst.max())},
        'rank_correlation_with_condition': float(spearmanr(trial.condition, trial.worst).statistic),
        'exact': _compared(motion, trial.exact),
        'inexact': _compared(motion, trial.inexact),
        'every_length_1_mm_off': trial.tolerance,
        'sensitivities': to_dict(trial.sensitivities),
        'other_causes': to_dict(trial.causes),
    }


def _compared(motion: Motion, computed: JointMotion) -> dict[str, Any]:
    pairs = (
        ('velocity', computed.velocity, motion.thetadot),
        ('acceleration', computed.acceleration, motion.thetaddot),
    )
    return {
        name: Deviation.of(calculated, recorded).summary()
        | {'momentary_max_by_threshold': largest_momentary(calculated, recorded)}
        for name, calculated, recorded in pairs
    }


def _largest(rows: list[dict[str, Any]], lengths: str, quantity: str) -> list[float]:
    return [float(row[lengths][quantity]['of_peak']['max']) for row in rows]


def _caused(rows: list[dict[str, Any]], name: str) -> list[float]:
    """Return the largest deviation of the peak by a cause on each trajectory, for its first quantity."""
    return [next(cause['of_peak'] for cause in row['other_causes'] if cause['name'] == name) for row in rows]


def plausibility(errors: Mapping[str, float]) -> str:
    """Return a remark if an error of a length is implausibly large, else an empty string."""
    largest = max(map(abs, errors.values()), default=0.0)
    return f'An error of {1e3 * largest:g} mm is implausible.' if largest >= IMPLAUSIBLE_M else ''


def _list(values: list[float]) -> str:
    return ' / '.join(number(value) for value in values)


def _signals(trials: list[Trial]) -> Table:
    rows: list[dict[str, Any]] = []
    for trial in trials:
        motion = trial.motion
        columns = {'time [s]': motion.time_s}
        columns |= columns_of('theta_{} [rad]', motion.theta) | columns_of('tcp_{} [m]', motion.tcp, 'xyz')
        for name, unit, recorded, exact, wrong in (
            ('velocity', 'rad/s', motion.thetadot, trial.exact.velocity, trial.inexact.velocity),
            ('acceleration', 'rad/s^2', motion.thetaddot, trial.exact.acceleration, trial.inexact.acceleration),
        ):  # fmt: skip
            near, far = Deviation.of(exact, recorded), Deviation.of(wrong, recorded)
            columns |= columns_of(f'recorded {name}_{{}} [{unit}]', recorded)
            columns |= columns_of(f'exact {name}_{{}} [{unit}]', exact)
            columns |= columns_of(f'inexact {name}_{{}} [{unit}]', wrong)
            columns |= columns_of(f'exact {name}_{{}} deviation of peak [%]', near.of_peak)
            columns |= columns_of(f'inexact {name}_{{}} deviation of peak [%]', far.of_peak)
            columns |= columns_of(f'inexact {name}_{{}} deviation momentary [%]', far.momentary)
        columns['condition of J [1]'] = trial.condition
        for values in np.column_stack(list(columns.values())).tolist():
            cells = [None if value != value else f'{value:.9g}' for value in values]
            rows.append({'trajectory': motion.name, **dict(zip(columns, cells, strict=True))})
    return Table.of_rows('signals.csv', rows)


def _condition(found: Sweep) -> Table:
    header = ['x [m]', 'y [m]', 'z [m]', 'distance to singularity [m]', 'singularity',
              'condition of J [1]', 'least s.b/(l_A l_B) [1]', '|det S|/l_B^3 [1]']  # fmt: skip
    header += [f'{pose.value}: {symbol} [%/mm]' for pose in Pose for symbol in LENGTHS]
    numbers = np.column_stack(
        [found.condition, found.serial, found.parallel, *(found.per_mm[pose] for pose in Pose)]
    )
    rows = (
        [*(f'{value:.6g}' for value in tcp), f'{gap:.6g}', 'serial' if serial else 'parallel',
         *(f'{value:.6g}' for value in row)]
        for tcp, gap, serial, row in zip(
            found.tcp.tolist(), found.gap_m.tolist(), found.serial_end, numbers.tolist(), strict=True
        )
    )  # fmt: skip
    return Table('condition.csv', header, rows)
