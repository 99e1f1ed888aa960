"""``delta3 plan``: what the planner makes of a program, move by move and over time, without running it."""

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
from delta3_pacdrive.cli.output import kept_for_json, print_json
from delta3_pacdrive.configuration.packaged import program_names

if TYPE_CHECKING:
    from delta3_pacdrive.analysis.planning.study import PlanStudy
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.peripherals.cell import Cell


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    program: str = argument(
        f'program file, or a packaged program: {", ".join(program_names())}', default='experiment1'
    )
    parameters: str | None = option(PARAMETERS, 'FILE')
    first: int = first_statement()
    output: str | None = option(
        'write figures 6.2 to 6.4 of the thesis, motors, limits and tables into this folder', 'FOLDER'
    )
    cell: str | None = option(
        'what stands around the robot, a cell file, or cell: the packaged one: programs may name its outputs, and '
        'scripts wait for its inputs',
        'FILE',
    )
    vibration: bool = flag(
        'predict how far the TCP swings after each shaped move, with and without shaping: simulates each on the built '
        'robot'
    )
    limits: bool = flag(
        'in the JSON, tell of each move how much of every limit it uses, not only of the first'
    )

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        script = self.program.endswith('.py')
        if script and self.first:
            return f'{NO_PROGRAM} script'
        if self.vibration and script:
            return '--vibration is for a program: a script is planned in pieces while it runs'
        if self.output is not None and script:
            return '--output is for a program: a script is planned in pieces while it runs'
        return '--limits is for --json' if self.limits and not self.json else ''


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.analysis.inputs import noted
    from delta3_pacdrive.analysis.planning import evaluation, report
    from delta3_pacdrive.analysis.report_folder import require_writable_folder
    from delta3_pacdrive.analysis.residual_vibration import predicted_swings
    from delta3_pacdrive.cli.progress import Progress
    from delta3_pacdrive.errors import ParameterError
    from delta3_pacdrive.motion import program_file
    from delta3_pacdrive.motion.adapted_program import rest_of
    from delta3_pacdrive.motion.output_names import OWN

    robot = core.load(options.parameters)
    if options.vibration and robot.control.shaping == core.UNSHAPED:
        raise ParameterError(
            '--vibration compares shaped moves with unshaped ones, but control.shaping is none'
        )
    if options.program.endswith('.py'):
        return _run_script(options, robot)
    around, more = _around(options)
    outputs = OWN if around is None else around.output_names
    program = rest_of(program_file.load(options.program, robot.motion, outputs), options.first, robot)
    inputs = [*noted([options.program]), *more]
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
            result['files'] = _written(options, robot, found, lines, inputs)
    if options.json:
        print_json(result, options, robot, inputs)
    else:
        print('\n'.join([*lines, *result.get('files', ())]))
    return 0


def _run_script(options: Options, robot: 'Parameters') -> int:
    """Run a script dry; return the exit status."""
    from delta3_pacdrive.analysis.inputs import noted
    from delta3_pacdrive.cell import dry_run, script
    from delta3_pacdrive.errors import RunError

    with kept_for_json(options.json):
        read = script.load(options.program)
    inputs = noted([options.program])
    around, more = _around(options)
    inputs += more
    with kept_for_json(options.json):
        found = dry_run.dry_run(read, robot, around)
    if not options.json:
        print('\n'.join(dry_run.text(found)))
    elif not found.stopped:
        print_json(dry_run.document(found, options.limits), options, robot, inputs)
    if found.stopped:
        raise RunError(found.stopped)
    return 0


def _around(options: Options) -> 'tuple[Cell | None, list[str]]':
    """Return the cell that is asked for, and its file with its digest; raises CellError."""
    if options.cell is None:
        return None, []
    from delta3_pacdrive.analysis.provenance import digest
    from delta3_pacdrive.peripherals import cell_file

    found = cell_file.load(options.cell)
    return found, [f'{options.cell} {digest(cell_file.find(options.cell))}']


def _written(
    options: Options, robot: 'Parameters', found: 'PlanStudy', lines: list[str], inputs: list[str]
) -> list[str]:
    """Write figures, tables and page; return the files."""
    from pathlib import Path

    from delta3_pacdrive.analysis.planning import figures, report
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.analysis.report_folder import ReportFolder

    origin = Provenance.of(options.command_line, robot, options.parameters, inputs)
    folder = ReportFolder(Path(options.output or '.'), origin)
    folder.figures(figures.by_name(found, robot))
    for table in report.tables(found):
        folder.table(table)
    folder.page(f'Plan of {found.planned.name}', lines)
    return folder.files


main = Command(
    'plan',
    'Plan a program without running it: path, speed, acceleration and jerk, motor speeds, torques and currents, '
    'distances to the limits, and for each move what keeps it from being faster.',
    Options,
    run,
)
