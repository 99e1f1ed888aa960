"""``delta3 simulate``: run control and plant code in one loop, without ROS."""

import math
import time
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, ReferenceOptions, flag, name, option, settings_of
from delta3_pacdrive.cli.option_types import non_empty, number_within, signal_names, trace_file
from delta3_pacdrive.cli.output import Output, output_of_run, stdout_reserved
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.reference import Chosen, cell_digest, cell_of, program_of
from delta3_pacdrive.cli.scope_options import Records, ScopeOptions, record_file
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.signals import OF_CELLS

if TYPE_CHECKING:
    from delta3_pacdrive.cell.cell import Cell
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.planning.learned_torques import Learned
    from delta3_pacdrive.planning.program.model import Program
    from delta3_pacdrive.recording.trace import Trace
    from delta3_pacdrive.scripting.script import Script
    from delta3_pacdrive.studies.framework.provenance import Provenance


def _channels(text: str) -> list[str]:
    return [part.strip() for part in non_empty(text).split(',') if part.strip()]


@dataclass
class Options(ReferenceOptions, ScopeOptions):
    """Options of the command."""

    scope: list[str] | None = option(
        'record up to eight drive channels such as axis1.current_reference,axis1.phase_current_1; delta3 scope list '
        'lists them',
        'CHANNELS',
        excludes=('--one-motor',),
        type=_channels,
    )
    scope_output: str = option(
        'with --scope: file of the record, .parquet, .csv or .npz',
        'FILE',
        default='scope.csv',
        type=record_file,
    )
    learned: str | None = option(
        'add the feed-forward torques of delta3 learn to this program; rejected for other programs',
        'FILE',
        excludes=('--one-motor',),
    )
    trace: str | None = option(
        'write all signals to this .npz, .csv or .parquet file', 'FILE', type=trace_file
    )
    signals: list[str] | None = option(
        "with --trace: write only these signals, such as tcp_speed,payload,'drive_*', or all: including those that are "
        'not recorded by default',
        'NAMES',
        needs='--trace',
        excludes=('--one-motor',),
        type=signal_names,
    )
    report: str | None = option(
        'write a report folder: figures and signals of the run, records and plots of --scope, and a page',
        'DIR',
        excludes=('--one-motor',),
    )
    cell: str | None = option(
        'simulate a cell: cell file, or cell for the packaged one; the gripper then holds simulated parts, and their '
        'outcomes are reported',
        'FILE',
        excludes=('--one-motor',),
    )
    ambient: float | None = option(
        'temperature of the surroundings [degC] for the temperatures of the motors, instead of thermal.ambient_degc',
        'DEGC',
        excludes=('--one-motor',),
        type=number_within(-40.0, 80.0, 'degC'),
    )
    one_motor: bool = flag(
        'simulate one MC-4 with one motor and a load instead of the robot, with the motion of one arm: figures 8.2 to '
        '8.4'
    )
    axis: int = option(
        'with --one-motor: arm whose motion is used',
        'N',
        default=1,
        needs='--one-motor',
        type=int,
        choices=(1, 2, 3),
    )
    load_inertia: float | None = option(
        'with --one-motor: I_Load at the gear output [kg m2], instead of motor.load_inertia_kg_m2',
        'KG_M2',
        needs='--one-motor',
        type=number_within(0.0, 1e3, 'kg m2'),
    )
    load_torque: float | None = option(
        'with --one-motor: tau_load at the gear output [N m], instead of motor.load_torque_n_m',
        'N_M',
        needs='--one-motor',
        type=number_within(-1e4, 1e4, 'N m'),
    )
    coupling: float | None = option(
        'with --one-motor: CE, share of the coupling torque of the robot on the motor, instead of '
        'motor.coupling_effect',
        'SHARE',
        needs='--one-motor',
        type=number_within(0.0, 1.0),
    )
    output: str | None = option(
        'with --one-motor: folder for table, figures and report (default: one_motor)',
        'DIR',
        needs='--one-motor',
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        script = self.program.endswith('.py')
        if script and self.one_motor:
            return '--one-motor requires a program, not a script'
        if script and self.learned is not None:
            return '--learned requires a program: the path of a script is not known in advance'
        if self.cell is None and (
            asked := [name for name in self.signals or () if name.startswith(OF_CELLS)]
        ):
            return f'--signals includes {asked[0]}, which requires --cell'
        if self.report and self.scope and Path(self.scope_output).name != self.scope_output:
            return '--scope-output must be a name without a folder: records are written to the folder of --report'
        of_scope = {name(one) for one in fields(ScopeOptions) if one.metadata} | {'--scope-output'}
        if self.scope is None and (unused := [one for one in self.given() if one in of_scope]):
            return f'{unused[0]} requires --scope'
        return super().check()


def run(options: Options) -> Output:
    """Run the command; return its result."""
    if options.one_motor:
        return _run_one_motor(options)
    from delta3_pacdrive import simulation
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.scripting.script import Script
    from delta3_pacdrive.studies.framework.provenance import Provenance, digest
    from delta3_pacdrive.studies.framework.report_folder import ReportFolder, require_writable_folder
    from delta3_pacdrive.studies.runs import trace_export
    from delta3_pacdrive.studies.runs.derived_signals import loads_of_round
    from delta3_pacdrive.studies.runs.runs import note_limits

    if options.trace:
        trace_file.require_writable_trace(options.trace)
    require_writable_folder(options.report)
    if options.signals:
        trace_export.require_known(options.signals)
    cell = cell_of(options)
    with stdout_reserved(options.json):
        chosen, robot, program = _read(options, cell)
    inputs, torques = [*chosen.digests(), *cell_digest(options)], None
    simulation.load_kernels(robot)
    if options.learned is not None and not isinstance(program, Script):
        torques = _learned(options.learned, program, robot)
        inputs.append(f'{options.learned} {digest(Path(options.learned))}')
    origin = Provenance.of(options.command_line, robot, options.parameters, inputs)
    folder = None if options.report is None else ReportFolder(Path(options.report), origin)
    if folder is not None:
        folder.make()
    started = time.perf_counter()
    with stdout_reserved(options.json):
        trace, records = _simulated(options, program, robot, origin, learned=torques, cell=cell)
    wall = time.perf_counter() - started
    exact = None if isinstance(program, Script) else _from_exact(trace, program, robot, cell)
    if options.trace or folder is not None:
        if not isinstance(program, Script):
            note_limits(trace, program, simulation.placed(robot, program))
        trace.meta['provenance'] = origin.lines()
    if options.trace:
        whole = trace_export.completed(trace, options.signals)
        trace_file.save(trace_export.chosen(whole, options.signals, program.name), options.trace)
    stopped = trace.meta['stopped']
    if folder is not None:
        from delta3_pacdrive.studies.runs import run_report

        lines = [
            *([stopped] if stopped else []),
            *(records.sentences() if records else ()),
            *_supply(trace, robot),
        ]
        run_report.write(folder, trace, records.taken if records else (), lines)
    if stopped:
        raise RunError(f'{stopped}; at rest after {trace.time_s[-1]:.3f} s of bus time')
    result = _result(trace, wall)
    if exact is not None:
        result['from_exact'] = exact
    result |= loads_of_round(trace, robot, trace.meta['repeat'])
    if records is not None:
        result['scope'] = records.written
    notes = (*chosen.notes, *(records.sentences() if records else ()))
    if folder is not None:
        result['files'] = folder.files
        notes = (*notes, f'report: {folder.files[0]}')
    return output_of_run(result, options, robot, inputs, notes=notes)


def _supply(trace: 'Trace', robot: 'Parameters') -> list[str]:
    """Return the load of the supply and the energy balance as lines of text, none without a model."""
    from delta3_pacdrive.studies.runs.run_supply import supply_of_run

    found = supply_of_run(trace, robot)
    return [] if found is None else [f'{name}: {text}' for name, text in found.rows()]


def _read(options: Options, cell: 'Cell | None') -> 'tuple[Chosen, Parameters, Program | Script]':
    """Return the selection, the robot, and the program or script; raises Delta3Error."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.planning.adapted_program import rest_of
    from delta3_pacdrive.planning.program import file_reader as programs
    from delta3_pacdrive.planning.program.output_names import OWN
    from delta3_pacdrive.scripting import script

    announce_compilation(options.parameters)
    with program_of(options) as chosen:
        robot = core.load(options.parameters)
        if options.exchange_period is not None:
            robot = robot.replace(bus__exchange_period_s=options.exchange_period)
        if options.ambient is not None:
            robot = robot.replace(thermal__ambient_degc=options.ambient)
        if script.is_script(chosen.program):
            return chosen, robot, script.load(chosen.program)
        outputs = OWN if cell is None else cell.output_names
        program = programs.load(chosen.program, robot.motion, outputs)
        return chosen, robot, rest_of(program, options.first, robot)


def _learned(path: str, program: 'Program', robot: 'Parameters') -> 'Learned':
    """Return the learned torques of a program; raises Delta3Error if they belong to another program."""
    from delta3_pacdrive import simulation
    from delta3_pacdrive.planning import learned_torques as learned

    torques, placed = learned.load(path), simulation.placed(robot, program)
    torques.require(simulation.plan_of(program, placed).plan, placed, path)
    return torques


def _from_exact(
    trace: 'Trace', program: 'Program', robot: 'Parameters', cell: 'Cell | None'
) -> dict[str, float] | None:
    """Return the deviation of decoupled from coupled arms; None for a robot with coupled arms."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.studies.runs import run_comparison

    if robot.dynamics.arm_coupling != core.DECOUPLED:
        return None
    coupled = robot.replace(dynamics__arm_coupling=core.EXACT)
    return run_comparison.from_exact(trace, simulation.run(program, coupled, cell=cell))


def _result(trace: 'Trace', wall_s: float) -> dict[str, Any]:
    """Return the result of a completed run."""
    cycles, figures = len(trace.time_s), trace.meta['figures']
    copied = ('program', 'notices', 'program_s', 'repeat', 'cell')
    return {
        'ok': True,
        **{key: trace.meta[key] for key in copied if key in trace.meta},
        'cycles': cycles,
        'bus_time_s': cycles * trace.meta['cycle_time_s'],
        'wall_time_s': wall_s,
        'overruns': 0,  # there is no clock
        'lost_telegrams': trace.meta['lost_telegrams'],
        'end_error_m': math.dist(figures['final_tcp_m'], trace.meta['planned_end_m']),
        **figures,
    }


def _simulated(
    options: Options, program: 'Program | Script', robot: 'Parameters', origin: 'Provenance', **more: Any
) -> 'tuple[Trace, Records | None]':
    """Run a program, with oscilloscopes in the drives if requested; raises Delta3Error.

    ``more`` are keyword arguments of ``simulation.run``.
    """
    from delta3_pacdrive.studies.runs import trace_export

    asked = trace_export.on_request(options.signals or ())
    if options.scope is None:
        return _driven(program, robot, signals=asked, **more), None
    from delta3_pacdrive.recording.acquisition import Acquisition

    output = (
        options.scope_output if options.report is None else str(Path(options.report) / options.scope_output)
    )
    records = Records(options, output, origin)
    setting = options.setting(options.scope, robot, all_of_it=True)
    acquisition = Acquisition(setting, records.take)
    trace = _driven(program, robot, acquisition=acquisition, signals=asked, **more)
    if not records.written:
        raise RunError(
            f'no trigger: {setting.trigger.sentence if setting.trigger else ""} did not occur until the end of the '
            f'run, {trace.time_s[-1]:.3f} s'
        )
    return trace, records


def _driven(
    program: 'Program | Script', robot: 'Parameters', learned: 'Learned | None', **more: Any
) -> 'Trace':
    """Return the trace of a program or of a script, which may have been aborted; raises Delta3Error."""
    from delta3_pacdrive import scripting, simulation
    from delta3_pacdrive.scripting.script import Script

    if not isinstance(program, Script):
        return simulation.run(program, robot, learned=learned, **more)
    simulated = None
    try:
        with scripting.simulate(robot, name=program.name, **more) as simulated:
            program.run(simulated)
    except scripting.ScriptError:
        if simulated is None:
            raise
    return simulated.trace


def _run_one_motor(options: Options) -> Output:
    """Run the study of a single motor; return its result."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.cli.studies import run_study
    from delta3_pacdrive.planning.adapted_program import rest_of
    from delta3_pacdrive.planning.program import file_reader as programs
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.studies.drives.one_motor import report, run, study

    if options.exchange_period is not None:
        raise RunError('--exchange-period is not for --one-motor: drive and motor exchange every 125e-6 s')
    if options.trace:
        trace_file.require_writable_trace(options.trace)
    # the thesis ran this experiment in ECAM-4 with its own controller
    options.parameters = options.parameters or core.THESIS_CONTROLLER
    settings = settings_of(
        study.Settings,
        options,
        load_inertia_kg_m2=options.load_inertia,
        load_torque_n_m=options.load_torque,
        coupling_effect=options.coupling,
    )
    folder = Path(options.output or 'one_motor').absolute()
    with program_of(options) as chosen:
        robot = core.load(options.parameters)
        program = rest_of(programs.load(chosen.program, robot.motion), options.first, robot)
    return run_study(
        options,
        lambda show: run.Study(
            settings, folder, options.command_line, show, program=program, inputs=chosen.digests()
        ),
        report.text,
        folder,
    )


main = Command(
    'simulate',
    'Run a program without ROS, as fast as possible, with the same signals as the graph.',
    Options,
    run,
)
