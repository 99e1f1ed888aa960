"""Report of learning: JSON document, text and tables."""

import shlex
from pathlib import Path
from typing import Any

from delta3_pacdrive.studies.framework.columns import csv_table, to_dict
from delta3_pacdrive.studies.framework.report_folder import Table
from delta3_pacdrive.studies.learning.study import Results, Settings

LEARNED, TABLE, CONTRACTIONS = 'learned.npz', 'repetitions.csv', 'contractions.csv'


def summary(found: Results, settings: Settings, file: Path | None) -> dict[str, Any]:
    """Return the results ready for JSON; ``file`` contains the learned torques, None without improvement."""
    worst = max(found.contractions, key=lambda one: one.rate)
    before = found.repetitions[0]
    return {
        'program': found.program,
        'bandwidth_hz': settings.bandwidth_hz,
        'change_weight': settings.change_weight,
        'torque_weight': settings.torque_weight,
        'contraction': to_dict(worst),
        'repetitions': to_dict(found.repetitions),
        'best': found.best.number,
        'gain_max': _gain(before.tcp_error_max_m, found.best.tcp_error_max_m),
        'gain_rms': _gain(before.tcp_error_rms_m, found.best.tcp_error_rms_m),
        'at_end': found.at_end,
        'follow': _follow(settings, file) if file is not None else '',
    }


def _gain(before_m: float, after_m: float) -> float:
    return before_m / after_m if after_m else 1.0


def _follow(settings: Settings, file: Path) -> str:
    """Return the command that applies the learned torques."""
    robot = ['--parameters', settings.parameters] if settings.parameters else []
    return shlex.join(['delta3', 'simulate', settings.program, *robot, '--learned', str(file)])


def tables(found: Results) -> list[Table]:
    """Return repetitions and contractions as tables."""
    return [csv_table(TABLE, found.repetitions), csv_table(CONTRACTIONS, found.contractions)]


def text(document: dict[str, Any]) -> list[str]:
    """Return a summary as lines of text, one per repetition."""
    worst = document['contraction']
    lines = [
        document['program'],
        '',
        f'{"repetition":>10} {"TCP error, max / rms":>22} {"current, peak / rms":>22} {"learned torque":>16}',
    ]
    for one in document['repetitions']:
        error = f'{1e3 * one["tcp_error_max_m"]:.4f} / {1e3 * one["tcp_error_rms_m"]:.4f} mm'
        current = f'{one["current_peak_a"]:.2f} / {one["current_rms_a"]:.2f} A'
        mark = ' *' if one['number'] == document['best'] else ''
        torque = f'{one["torque_max_n_m"]:.3f} N m'
        lines.append(f'{one["number"]:>10} {error:>22} {current:>22} {torque:>16}{mark}')
    if document['follow']:
        kept = (
            f'repetition {document["best"]} is used: the error is {document["gain_max"]:.1f} times smaller, '
            f'{document["gain_rms"]:.1f} times in rms; {document["at_end"]}'
        )
    else:
        kept = 'no repetition is better than the first run: no torques were written'
    return [
        *lines,
        '',
        kept,
        f'contraction rate per repetition: at most {worst["rate"]:.2f} ({worst["at_hz"]:.0f} Hz, '
        f'{100.0 * worst["masses"]:.0f} % of the masses, {worst["payload_kg"]:g} kg): learning converges monotonically',
        *([f'to apply it: {document["follow"]}'] if document['follow'] else []),
        '',
    ]
