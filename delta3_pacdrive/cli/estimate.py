"""``delta3 estimate``: parameters of motors, masses and geometry from traces, and what traces can tell of them."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.option_types import NOISE, SEED, number_within, program_file, trace_file
from delta3_pacdrive.cli.output import guarded, parser_for
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from collections.abc import Sequence

    from delta3_pacdrive.analysis.study import OnProgress

GROUPS = ('motor', 'masses', 'geometry', 'thesis')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _estimate(options), options.json)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'estimate',
        'Least squares on traces, or on a program that is simulated as measurement: values with 95 % intervals, and '
        'which quantities the signals do not show. The group thesis repeats the estimation of chapter 9 and shows why '
        'it returned its initial values.',
    )
    parser.add_argument(
        'inputs', nargs='*', metavar='INPUT', help='traces (.npz, .csv, folder of a bag), or one program'
    )
    parser.add_argument('--group', choices=GROUPS, default='motor', help='what is estimated')
    parser.add_argument('--parameters', metavar='FILE', help='parameter file instead of the packaged one')
    parser.add_argument(
        '--free', metavar='SYMBOLS', default='', help='quantities to free, such as I_brake,w_s'
    )
    parser.add_argument('--known', metavar='SYMBOLS', default='', help='quantities to hold, such as m_fb')
    parser.add_argument(
        '--start-off',
        type=number_within(-0.9, 9.0),
        metavar='SHARE',
        help='start beside the values of the parameter file; 0.3 for a program, 0 for traces, if not given',
    )
    parser.add_argument(
        '--sampling',
        choices=['drive', 'bus'],
        default='drive',
        help='of a simulated measurement: every period of the current loop, or every bus cycle',
    )
    parser.add_argument(
        '--method',
        choices=['auto', 'balance', 'replay'],
        default='auto',
        help='mechanical part: balance of torques, or replay of the closed loop; auto: as the sampling asks for',
    )
    parser.add_argument(
        '--noise',
        type=NOISE,
        default=0.0,
        metavar='X',
        help='sensor noise of a simulated measurement, 1: typical',
    )
    parser.add_argument('--seed', type=SEED, default=0, help='of the noise, and of --design')
    parser.add_argument(
        '--measurement',
        type=trace_file,
        metavar='FILE',
        help='write the simulated measurement to this .npz or .csv file',
    )
    parser.add_argument(
        '--output', metavar='FOLDER', default='estimation', help='for report, tables, figures'
    )
    parser.add_argument(
        '--resume', metavar='FOLDER', help='go on with the estimation that began in this folder'
    )
    parser.add_argument(
        '--design',
        type=program_file,
        metavar='FILE',
        help='write an exciting program for the group to this file instead',
    )
    parser.add_argument('--json', action='store_true', help='print the report as JSON')
    options = parser.parse_args(arguments)
    if options.resume and (options.inputs or options.design or options.measurement):
        parser.error('--resume goes on with the inputs of the folder: it takes no others')
    return options


def _refuse_ignored(options: argparse.Namespace) -> None:
    """Raise EstimationError for an option that the rest of the command leaves without a meaning."""
    from delta3_pacdrive.analysis.inputs import is_recording
    from delta3_pacdrive.errors import EstimationError

    given = {
        '--sampling': options.sampling != 'drive',
        '--noise': options.noise != 0.0,
        '--measurement': options.measurement is not None,
        '--method': options.method != 'auto',
        '--free': bool(options.free),
        '--known': bool(options.known),
        '--start-off': options.start_off is not None,
        'INPUT': bool(options.inputs),
        '--seed': options.seed != 0,
    }
    cases = [
        (
            any(is_recording(text) for text in options.inputs),
            'the inputs are traces',
            ('--sampling', '--noise', '--seed', '--measurement'),
        ),
        (
            options.group == 'thesis' and not options.design,
            'the group thesis has signals and quantities of its own',
            ('--sampling', '--method', '--measurement', '--free', '--known'),
        ),
        (
            options.group == 'geometry' and not options.design,
            'the group geometry is measured once per bus cycle and has one model',
            ('--sampling', '--method'),
        ),
        (
            bool(options.design),
            '--design only writes a program',
            (
                'INPUT',
                '--sampling',
                '--noise',
                '--measurement',
                '--method',
                '--free',
                '--known',
                '--start-off',
            ),
        ),
        (
            bool(options.resume),
            '--resume goes on with the settings of the folder',
            ('--sampling', '--noise', '--seed', '--method', '--free', '--known', '--start-off'),
        ),
    ]
    for holds, why, names in cases:
        if holds and (ignored := [name for name in names if given[name]]):
            raise EstimationError(f'{why}: {", ".join(ignored)} would change nothing')


def _estimate(options: argparse.Namespace) -> int:
    from delta3_pacdrive.analysis.estimation import report

    _refuse_ignored(options)
    if options.design:
        return conduct(
            options,
            lambda show: _design(options, show),
            lambda found: [f'{found["file"]}: condition {found["condition"]:.4g}'],
            lambda: 'interrupted: no program was written',
        )
    studies: list[Any] = []

    def work(show: OnProgress) -> dict[str, Any]:
        studies.append(_study(options, show))
        summary: dict[str, Any] = studies[0].run(Path(options.measurement) if options.measurement else None)
        return summary

    def unfinished() -> str:
        if not studies or studies[0].iterate is None:
            return 'interrupted before the first iteration'
        again = f'delta3 estimate --resume {shlex.quote(str(studies[0].folder))}'
        return f'interrupted after iteration {studies[0].iterate.number}; {again} goes on from there'

    return conduct(options, work, report.text, unfinished)


def _study(options: argparse.Namespace, show: OnProgress) -> Any:
    from delta3_pacdrive.analysis.estimation import run
    from delta3_pacdrive.analysis.estimation.study import Settings

    if options.resume:
        return run.Study.resumed(Path(options.resume), options.command_line, show)
    program = 'experiment1' if options.group == 'thesis' else 'excitation'
    settings = Settings(
        options.group,
        tuple(options.inputs) or (program,),
        options.parameters,
        options.sampling,
        options.method,
        options.noise,
        options.seed,
        options.start_off,
        _symbols(options.free),
        _symbols(options.known),
    )
    return run.Study(settings, Path(options.output), options.command_line, show)


def _symbols(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(',') if part.strip())


def _design(options: argparse.Namespace, show: OnProgress) -> dict[str, Any]:
    import yaml

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.analysis.estimation import excitation
    from delta3_pacdrive.analysis.provenance import versions
    from delta3_pacdrive.errors import EstimationError

    robot = core.load(options.parameters)
    group = 'geometry' if options.group == 'geometry' else 'masses'
    found = excitation.design(group, robot, options.seed, on_progress=show)
    lines = [
        f'condition of the scaled jacobian {found.condition:.4g}, '
        f'{found.first_condition:.4g} after the random search; {found.evaluations} curves',
        f'command: {options.command_line}',
        f'seed: {options.seed}',
        f'parameters: {robot.checksum}',
        f'versions: {versions()}',
    ]
    text = ''.join(f'# {line}\n' for line in lines)
    text += yaml.safe_dump(found.document, sort_keys=False, default_flow_style=None)
    try:
        Path(options.design).write_text(text, encoding='utf-8')
    except OSError as error:
        raise EstimationError(f'cannot write {options.design}: {error.strerror or error}') from error
    return {
        'ok': True,
        'file': options.design,
        'condition': found.condition,
        'first_condition': found.first_condition,
        'evaluations': found.evaluations,
    }


if __name__ == '__main__':
    sys.exit(main())
