"""``delta3 plan``: plan a program without running it and report every move."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.command import (
    NO_PROGRAM,
    PARAMETERS,
    Command,
    JsonOptions,
    argument,
    first_statement,
    flag,
    option,
)
from delta3_pacdrive.cli.option_types import number_within
from delta3_pacdrive.cli.output import Output, stdout_reserved, with_provenance
from delta3_pacdrive.cli.reference import cell_digest, cell_of
from delta3_pacdrive.cli.studies import written
from delta3_pacdrive.configuration.packaged import program_names

if TYPE_CHECKING:
    from delta3_pacdrive.parameters import Parameters


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    program: str = argument(
        f'program file, or a packaged program: {", ".join(program_names())}', default='experiment1'
    )
    parameters: str | None = option(PARAMETERS, 'FILE')
    first: int = first_statement()
    output: str | None = option(
        'folder for figures 6.2 to 6.4 of the thesis, plots of motors and limits, and tables', 'FOLDER'
    )
    cell: str | None = option(
        'cell file, or cell for the packaged one: programs may use the names of its outputs, scripts its inputs',
        'FILE',
    )
    vibration: bool = flag(
        'predict the residual vibration of the TCP after each shaped move, with and without shaping, by simulation of '
        'the built robot'
    )
    ambient: float | None = option(
        'temperature of the surroundings [degC] for the temperatures of the motors, instead of thermal.ambient_degc',
        'DEGC',
        type=number_within(-40.0, 80.0, 'degC'),
    )
    limits: bool = flag(
        'with --json: the used share of every limit for each move, not only the active one', needs='--json'
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        script = self.program.endswith('.py')
        if script and self.first:
            return f'{NO_PROGRAM} script'
        if self.vibration and script:
            return '--vibration requires a program: a script is planned while it runs'
        if self.ambient is not None and script:
            return '--ambient requires a program: a script is planned while it runs'
        if self.output is not None and script:
            return '--output requires a program: a script is planned while it runs'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.cli.progress import Progress
    from delta3_pacdrive.errors import ParameterError
    from delta3_pacdrive.planning.adapted_program import rest_of
    from delta3_pacdrive.planning.program import file_reader as program_file
    from delta3_pacdrive.planning.program.output_names import OWN
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder
    from delta3_pacdrive.studies.framework.residual_vibration import predicted_swings
    from delta3_pacdrive.studies.places.planning import evaluation, figures, report
    from delta3_pacdrive.studies.runs.inputs import with_digests

    robot = core.load(options.parameters)
    if options.ambient is not None:
        robot = robot.replace(thermal__ambient_degc=options.ambient)
    if options.vibration and robot.control.shaping == core.UNSHAPED:
        raise ParameterError(
            '--vibration compares shaped moves with unshaped ones, but control.shaping is none'
        )
    if options.program.endswith('.py'):
        return _run_script(options, robot)
    cell = cell_of(options)
    outputs = OWN if cell is None else cell.output_names
    program = rest_of(program_file.load(options.program, robot.motion, outputs), options.first, robot)
    inputs = [*with_digests([options.program]), *cell_digest(options)]
    require_writable_folder(options.output)
    with Progress(quiet=options.json) as progress:
        found = evaluation.of_program(program, robot, progress.show)
        result, lines = report.document(found, robot, options.limits), report.text(found, robot)
        if options.vibration:
            swings = predicted_swings(program, found.planned, robot, progress.show)
            result['vibration'] = report.vibration(swings)
            lines += report.vibration_text(swings)
        if options.output is not None:
            progress.show('drawing')
            origin = Provenance.of(options.command_line, robot, options.parameters, inputs)
            drawings, title = figures.by_name(found, robot), f'Plan of {found.planned.name}'
            result['files'] = written(options, title, lines, drawings, report.tables(found), of=origin)
    return Output(with_provenance(result, options, robot, inputs), [*lines, *result.get('files', ())])


def _run_script(options: Options, robot: 'Parameters') -> Output:
    """Dry-run a script; return its result."""
    from delta3_pacdrive.scripting import dry_run, script
    from delta3_pacdrive.studies.runs.inputs import with_digests

    with stdout_reserved(options.json):
        read = script.load(options.program)
    inputs = [*with_digests([options.program]), *cell_digest(options)]
    cell = cell_of(options)
    with stdout_reserved(options.json):
        found = dry_run.dry_run(read, robot, cell)

    result = (
        {'ok': False, 'error': found.stopped} if found.stopped else dry_run.document(found, options.limits)
    )
    document = result if found.stopped else with_provenance(result, options, robot, inputs)
    message = f'error: {found.stopped}' if found.stopped else ''
    return Output(document, dry_run.text(found), int(bool(found.stopped)), message=message)


main = Command(
    'plan',
    'Plan a program without running it: path, speed, acceleration and jerk, motor speeds, torques and currents, '
    'distances to the limits, and the active limit of each move.',
    Options,
    run,
)
