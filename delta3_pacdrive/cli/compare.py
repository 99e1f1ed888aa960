"""``delta3 compare``: compare two runs signal by signal and move by move."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.command import Command, flag, option
from delta3_pacdrive.cli.option_types import folder
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.progress import Progress
from delta3_pacdrive.cli.run_options import RunOptions


@dataclass
class Options(RunOptions):
    """Options of the command."""

    output: Path | None = option(
        'folder for figures 11.1 to 11.8, tables and a page; the first run is the model, the second the robot',
        'DIR',
        type=folder,
    )
    no_attribution: bool = flag(
        'with --output: do not attribute the difference of two simulations to effects', needs='--output'
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if len(self.inputs) != 2:
            return f'compare takes two runs, not {len(self.inputs)}'
        return super().check()


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder
    from delta3_pacdrive.studies.runs.run_comparison import compare, to_document
    from delta3_pacdrive.studies.runs.runs import named
    from delta3_pacdrive.studies.thesis.experiments import report
    from delta3_pacdrive.studies.thesis.experiments.run import PairStudy, compared
    from delta3_pacdrive.studies.thesis.experiments.study import Pair

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
    sources = first.parameter_source, [first.origin, second.origin]
    origin = Provenance.of(options.command_line, first.robot, *sources)
    text = [*_lines(result, names), '', *report.text(document), *document.get('files', ())]
    return Output(result | {'provenance': origin.lines()}, text)


def _lines(result: dict[str, Any], names: list[str]) -> list[str]:
    """Return the result as lines of text."""
    aligned = result['alignment']
    lines = [
        f'{names[1]} minus {names[0]}',
        _alignment_text(aligned),
        *(f'warning: {text}' for text in aligned['doubts']),
        f'from {result["from_s"]:.3f} to {result["to_s"]:.3f} s, {result["cycles"]} cycles',
        '',
    ]
    if result['same']:
        lines += ['all signals are bit-identical', '']
    elif result['equal']:
        lines += ['all signals are bit-identical in the common cycles', '']
    if result['uncompared']:
        lines += [f'{result["uncompared"]} cycles were not compared: they are in one run only', '']
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
    lines += ['', 'parameters: identical' if not result['parameters'] else 'differing parameters:']
    lines += [f'  {name}: {a} and {b}' for name, (a, b) in result['parameters'].items()]
    return lines


def _alignment_text(aligned: dict[str, Any]) -> str:
    """Return how the runs were aligned, with the shift and its uncertainty."""
    shift = f', shifted by {aligned["shift_s"]:+.3f} s' if aligned['shift_s'] else ''
    if aligned['uncertainty_s']:
        shift = f', shifted by {aligned["shift_s"]:+.6f} s +- {aligned["uncertainty_s"]:.1g} s (95 %)'
    correlation, rival = aligned['correlation'], aligned['rival_correlation']
    quality = '' if correlation is None else f'; correlation of {aligned["of"]} {correlation:.6f}'
    if rival is not None:
        quality += f', at the next best shift, {aligned["rival_shift_s"]:+.3f} s, {rival:.3f}'
    return f'aligned by {aligned["by"]}{shift}{quality}'


def _number(value: float | None, width: int, form: str = '.4g') -> str:
    known = value is not None and math.isfinite(value)
    return f'{value if known else "-":>{width}{form if known else ""}}'


main = Command(
    'compare',
    'Compare two runs: alignment, differences of all signals and moves, differing parameters; and the evaluation of '
    'the experiments of the thesis with the first run as the model and the second as the robot.',
    Options,
    run,
)
