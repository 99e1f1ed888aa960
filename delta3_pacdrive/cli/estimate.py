"""``delta3 estimate``: estimate parameters of motors, masses and geometry from traces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, flag, option, settings_of
from delta3_pacdrive.cli.option_types import NOISE, PROGRAM, SEED, number_within, trace_file
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import Task, run_study

if TYPE_CHECKING:
    from delta3_pacdrive.studies.framework.study import OnProgress


def _symbols(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(',') if part.strip())


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    inputs: list[str] = argument(
        'traces (.npz, .csv, bag folder), or one program', default=(), nargs='*', metavar='INPUT'
    )
    group: str = option(
        'parameters to estimate', default='motor', choices=('motor', 'masses', 'geometry', 'thesis')
    )
    parameters: str | None = option('parameter file instead of the packaged one', 'FILE')
    columns: str | None = option('column file that maps the columns of tables to signals', 'FILE')
    free: tuple[str, ...] = option(
        'additional quantities to estimate, such as I_brake,w_s, or effects of built robots: '
        'friction,gear,ripple,sensors,geometry',
        'SYMBOLS',
        default=(),
        type=_symbols,
    )
    known: tuple[str, ...] = option(
        'quantities to keep fixed, such as m_fb', 'SYMBOLS', default=(), type=_symbols
    )
    start_off: float | None = option(
        'relative offset of the start values from the parameter file (default: 0.3 for a program, 0 for traces)',
        'SHARE',
        type=number_within(-0.9, 9.0),
    )
    sampling: str = option(
        'sampling of a simulated measurement: every period of the current loop or every bus cycle; auto: bus for a '
        'built robot',
        default='auto',
        choices=['auto', 'drive', 'bus'],
    )
    method: str = option(
        'model of the mechanics: torque balance or replay of the closed loop; auto: depending on the sampling',
        default='auto',
        choices=['auto', 'balance', 'replay'],
    )
    noise: float = option(
        'sensor noise of a simulated measurement, or assumed for traces; 1: typical',
        'X',
        default=0.0,
        type=NOISE,
    )
    seed: int = option('seed of the noise and of --design', default=0, type=SEED)
    validate: tuple[str, ...] = option(
        'recordings, or programs of a simulated measurement, for validation only',
        'INPUTS',
        default=(),
        type=_symbols,
    )
    apply: bool = flag('write fitted.yaml and show its effect: figures 11.6 and 11.8 before and after')
    measurement: str | None = option(
        'write the simulated measurement to this .npz, .csv or .parquet file', 'FILE', type=trace_file
    )
    output: str = option('folder for report, tables and figures', 'FOLDER', default='estimation')
    resume: str | None = option('continue the estimation in this folder', 'FOLDER')
    design: str | None = option(
        'only design an exciting program for the group and write it to this file', 'FILE', type=PROGRAM
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.resume and (self.inputs or self.design or self.measurement):
            return '--resume uses the inputs of the folder: it takes no others'
        return ''


def _require_effective(options: Options) -> None:
    """Raise EstimationError for options without effect in this combination."""
    from delta3_pacdrive.errors import EstimationError
    from delta3_pacdrive.studies.runs.inputs import is_recording

    models = ('--sampling', '--method')
    quantities, more = ('--free', '--known'), ('--validate', '--apply')
    cases = [
        (
            any(is_recording(text) for text in options.inputs),
            'the inputs are traces',
            ('--sampling', '--seed', '--measurement'),
        ),
        (
            bool(options.inputs) and not any(is_recording(text) for text in options.inputs),
            'the input is a program',
            ('--columns',),
        ),
        (
            options.group == 'thesis' and not options.design,
            'the group thesis has fixed signals and quantities',
            (*models, '--measurement', *quantities, *more),
        ),
        (
            options.group == 'geometry' and not options.design,
            'the group geometry has one model and is sampled once per bus cycle',
            models,
        ),
        (
            bool(options.design),
            '--design only writes a program',
            ('INPUT', *models, '--columns', '--noise', '--measurement', *quantities, *more, '--start-off'),
        ),
        (
            bool(options.resume),
            '--resume uses the settings of the folder',
            (*models, '--columns', '--noise', '--seed', *quantities, *more, '--start-off'),
        ),
    ]
    given = options.given()
    for holds, why, names in cases:
        if holds and (ignored := [name for name in given if name in names]):
            raise EstimationError(f'{why}: {", ".join(ignored)} would have no effect')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.studies.estimation import report

    _require_effective(options)
    if path := options.design:
        return run_study(
            options,
            partial(Task, partial(_design, options, path)),
            lambda found: [f'{found["file"]}: condition {found["condition"]:.4g}'],
        )
    summaries: list[dict[str, Any]] = []

    def estimated(study: Any) -> dict[str, Any]:
        summaries.append(study.run(Path(options.measurement) if options.measurement else None))
        return summaries[0]

    if options.measurement:
        trace_file.require_writable_trace(options.measurement)
    folder = None if options.resume else options.output
    output = run_study(options, lambda show: _study(options, show), report.text, folder, estimated)
    refusal = '' if output.status else report.refusal(summaries[0])
    return replace(output, status=1, message=f'error: {refusal}') if refusal else output


def _study(options: Options, show: OnProgress) -> Any:
    from delta3_pacdrive.studies.estimation import run
    from delta3_pacdrive.studies.estimation.study import Settings

    if options.resume:
        return run.Study.resumed(Path(options.resume), options.command_line, show)
    program = 'experiment1' if options.group == 'thesis' else 'excitation'
    settings = settings_of(Settings, options, inputs=tuple(options.inputs) or (program,))
    return run.Study(settings, Path(options.output), options.command_line, show)


def _design(options: Options, path: str, show: OnProgress) -> dict[str, Any]:
    import yaml

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.estimation import excitation
    from delta3_pacdrive.studies.framework.provenance import versions, write_text

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
    write_text(text, Path(path))
    return {
        'ok': True,
        'file': path,
        'condition': found.condition,
        'first_condition': found.first_condition,
        'evaluations': found.evaluations,
    }


main = Command(
    'estimate',
    'Estimate parameters by least squares from traces or from the simulated measurement of a program, with 95 % '
    'intervals, and list the quantities that the signals do not identify. The group thesis repeats the estimation of '
    'chapter 9 and shows why it returned its initial values.',
    Options,
    run,
)
