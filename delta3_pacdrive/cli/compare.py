"""``delta3 compare``: how far two runs are apart, signal by signal and move by move, as model and robot."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.command import Command, flag, option
from delta3_pacdrive.cli.option_types import folder
from delta3_pacdrive.cli.progress import Progress
from delta3_pacdrive.cli.run_options import RunOptions


@dataclass
class Options(RunOptions):
    """Options of the command."""

    output: Path | None = option(
        'write figures 11.1 to 11.8 of these two, tables and a page with all of it into this folder, the first as the '
        'model, the second as the robot',
        'DIR',
        type=folder,
    )
    no_attribution: bool = flag(
        'with --output: do not look for what explains the difference of two simulations'
    )

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if len(self.inputs) != 2:
            return f'two runs are compared, not {len(self.inputs)}'
        if self.no_attribution and self.output is None:
            return '--no-attribution is for --output: without it nothing is attributed'
        return super().check()


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.experiments import report
    from delta3_pacdrive.analysis.experiments.run import PairStudy, compared
    from delta3_pacdrive.analysis.experiments.study import Pair
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.analysis.report_folder import require_writable_folder
    from delta3_pacdrive.analysis.run_comparison import compare, to_document
    from delta3_pacdrive.analysis.runs import named

    require_writable_folder(options.output)
    first, second = options.runs()
    found = compare(first, second, options.align)
    names = named([first, second])
    attributed = options.output is not None and not options.no_attribution
    pair = Pair(first, second, options.align, attributed)
    if options.output is None:
        document = report.summary(compared(pair))
    else:
        with Progress(quiet=options.json) as progress:
            document = PairStudy(pair, options.output, options.command_line, progress.show).run()
    result = {'ok': True, 'runs': names, **to_document(found, first, second), 'model_and_robot': document}
    if options.json:
        origin = Provenance.of(
            options.command_line, first.robot, first.parameter_source, [first.origin, second.origin]
        )
        print(json.dumps(result | {'provenance': origin.lines()}))
    else:
        print('\n'.join([*_lines(result, names), '', *report.text(document), *document.get('files', ())]))
    return 0


def _lines(result: dict[str, Any], names: list[str]) -> list[str]:
    """Return the result for people."""
    aligned = result['alignment']
    lines = [
        f'{names[1]} minus {names[0]}',
        _alignment_text(aligned),
        *(f'careful: {text}' for text in aligned['doubts']),
        f'from {result["from_s"]:.3f} to {result["to_s"]:.3f} s, {result["cycles"]} cycles',
        '',
    ]
    if result['same']:
        lines += ['no signal differs by a single bit', '']
    elif result['equal']:
        lines += ['no signal differs by a single bit in the cycles that both have', '']
    if result['uncompared']:
        lines += [f'{result["uncompared"]} cycles were not compared: only one of the two has them', '']
    lines.append(f'{"signal":<16} {"rms":>12} {"largest":>12}  {"unit":<6} {"at [s]":>8}')
    for name, row in result['signals'].items():
        numbers = ' '.join(_number(row[key], 12) for key in ('rms', 'largest'))
        lines.append(f'{name:<16} {numbers}  {row["unit"]:<6} {_number(row["at_s"], 8, ".3f")}')
    if result['moves']:
        lines += [
            '',
            f'{"move":>4} {"kind":<8} {"duration [s]":>19} {"peak current [A]":>19} {"TCP error [mm]":>19}',
        ]
    for row in result['moves']:
        pairs = [
            ' '.join(_number(None if value is None else factor * value, 9, '.3f') for value in row[key])
            for key, factor in (('duration_s', 1.0), ('current_peak_a', 1.0), ('tcp_error_max_m', 1e3))
        ]
        lines.append(f'{row["move"]:>4} {row["kind"]:<8} {" ".join(pairs)}')
    lines += ['', 'parameters: all are the same' if not result['parameters'] else 'parameters that differ:']
    lines += [f'  {name}: {a} and {b}' for name, (a, b) in result['parameters'].items()]
    return lines


def _alignment_text(aligned: dict[str, Any]) -> str:
    """Tell how the runs were aligned, which shift was found, and how sure it is."""
    shift = f', shifted by {aligned["shift_s"]:+.3f} s' if aligned['shift_s'] else ''
    if aligned['uncertainty_s']:
        shift = f', shifted by {aligned["shift_s"]:+.6f} s +- {aligned["uncertainty_s"]:.1g} s (95 %)'
    correlation, rival = aligned['correlation'], aligned['rival_correlation']
    told = '' if correlation is None else f'; {aligned["of"]} correlate by {correlation:.6f}'
    if rival is not None:
        told += f', at the next best shift, {aligned["rival_shift_s"]:+.3f} s, by {rival:.3f}'
    return f'aligned by {aligned["by"]}{shift}{told}'


def _number(value: float | None, width: int, form: str = '.4g') -> str:
    known = value is not None and math.isfinite(value)
    return f'{value if known else "-":>{width}{form if known else ""}}'


main = Command(
    'compare',
    'Tell how far two runs are apart: alignment, differences of all signals, moves, parameters that differ; and as the '
    'experiments of the thesis do, the first as the model, the second as the robot.',
    Options,
    run,
)
