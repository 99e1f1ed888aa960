"""``delta3 simulate``: the same control and plant code in one loop, without ROS."""

import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.command import Command, ReferenceOptions, flag, name, option
from delta3_pacdrive.cli.option_types import filled, number_within, signal_names, trace_file
from delta3_pacdrive.cli.output import print_run
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.reference import program_of
from delta3_pacdrive.cli.scope_options import Records, ScopeOptions, record_file
from delta3_pacdrive.errors import RunError

if TYPE_CHECKING:
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.motion.learned import Learned
    from delta3_pacdrive.motion.program import Program
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.recording.trace import Trace


def _channels(text: str) -> list[str]:
    return [part.strip() for part in filled(text).split(',') if part.strip()]


@dataclass
class Options(ReferenceOptions, ScopeOptions):
    """Options of the command."""

    scope: list[str] | None = option(
        'look into the drives: up to eight channels such as axis1.current_reference,axis1.phase_current_1; '
        'delta3 scope list names them',
        'CHANNELS',
        type=_channels,
    )
    scope_output: str = option(
        'file of what --scope shows: .parquet, .csv or .npz', 'FILE', default='scope.csv', type=record_file
    )
    learned: str | None = option(
        'follow the torques that delta3 learn has found for this program; they are refused with any other',
        'FILE',
    )
    trace: str | None = option(
        'write every signal to this .npz, .csv or .parquet file', 'FILE', type=trace_file
    )
    signals: list[str] | None = option(
        "with --trace: write these only, such as tcp_speed,payload,'drive_*', or all: everything, which is more than "
        'there is unasked',
        'NAMES',
        type=signal_names,
    )
    report: str | None = option(
        'leave a folder with the figures and signals of the run, the records of --scope with a figure of each, and a '
        'page that shows all of it',
        'DIR',
    )
    one_motor: bool = flag(
        'run one MC-4 with one motor and a load instead of the robot, on the motion of one arm: figures 8.2 to 8.4'
    )
    axis: int = option(
        'with --one-motor: the arm whose motion it drives', 'N', default=1, type=int, choices=(1, 2, 3)
    )
    load_inertia: float | None = option(
        'with --one-motor: I_Load behind the gear [kg m2], instead of motor.load_inertia_kg_m2',
        'KG_M2',
        type=number_within(0.0, 1e3, 'kg m2'),
    )
    load_torque: float | None = option(
        'with --one-motor: tau_load behind the gear [N m], instead of motor.load_torque_n_m',
        'N_M',
        type=number_within(-1e4, 1e4, 'N m'),
    )
    coupling: float | None = option(
        'with --one-motor: CE, share of the coupling torque of the robot that the motor feels, instead of '
        'motor.coupling_effect',
        'SHARE',
        type=number_within(0.0, 1.0),
    )
    output: str | None = option(
        'with --one-motor: folder for table, figures and report (default: one_motor)', 'DIR'
    )

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if not self.one_motor:
            for one in ('--axis', '--load-inertia', '--load-torque', '--coupling', '--output'):
                if one in self.given():
                    return f'{one} is for --one-motor: it says what a single motor drives'
        elif self.learned is not None:
            return '--learned is for the robot, so it is not for --one-motor'
        elif self.scope is not None:
            return '--scope looks into the drives of a robot, so it is not for --one-motor'
        if self.report is not None:
            if self.one_motor:
                return '--report is about a robot, --one-motor leaves a folder of its own: --output'
            if self.scope is not None and Path(self.scope_output).name != self.scope_output:
                return '--scope-output is a name without a folder if there is a --report: records are in its folder'
        if self.signals and (self.one_motor or not self.trace):
            return '--signals says what --trace holds of a robot, which is not asked for'
        of_scope = {name(one) for one in fields(ScopeOptions) if one.metadata} | {'--scope-output'}
        if self.scope is None and (unused := [one for one in self.given() if one in of_scope]):
            return f'{unused[0]} is for --scope, which is not given'
        return super().check()


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    if options.one_motor:
        return _run_one_motor(options)
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis import run_comparison, trace_export
    from delta3_pacdrive.analysis.provenance import Provenance, digest
    from delta3_pacdrive.analysis.report_folder import ReportFolder, require_writable_folder
    from delta3_pacdrive.analysis.run_energy import energy_of_round
    from delta3_pacdrive.motion import arrival, learned
    from delta3_pacdrive.motion import program_file as programs
    from delta3_pacdrive.recording import trace_file

    if options.trace:
        trace_file.require_writable_trace(options.trace)
    require_writable_folder(options.report)
    if options.signals:
        trace_export.require_known(options.signals)
    announce_compilation(options.parameters)
    with program_of(options) as chosen:
        robot = core.load(options.parameters)
        if options.exchange_period is not None:
            robot = robot.replace(bus__exchange_period_s=options.exchange_period)
        program = programs.load(chosen.program, robot.motion)
    simulation.load_kernels(robot)
    inputs, torques = chosen.digests(), None
    if options.learned is not None:
        torques = learned.load(options.learned)
        placed = simulation.placed(robot, program)
        torques.require(simulation.plan_of(program, placed).plan, placed, options.learned)
        inputs.append(f'{options.learned} {digest(Path(options.learned))}')
    origin = Provenance.of(options.command_line, robot, options.parameters, inputs)
    folder = None if options.report is None else ReportFolder(Path(options.report), origin)
    if folder is not None:
        folder.make()
    started = time.perf_counter()
    trace, records = _simulated(options, program, robot, origin, torques)
    wall = time.perf_counter() - started
    exact = None
    if robot.dynamics.arm_coupling == core.DECOUPLED:
        exact = run_comparison.from_exact(
            trace, simulation.run(program, robot.replace(dynamics__arm_coupling=core.EXACT))
        )
    if options.trace or folder is not None:
        from delta3_pacdrive.analysis.runs import note_limits

        note_limits(trace, program, simulation.placed(robot, program))
        trace.meta['provenance'] = origin.lines()
    if options.trace:
        whole = trace_export.completed(trace, options.signals)
        trace_file.save(trace_export.chosen(whole, options.signals, program.name), options.trace)
    stopped, figures = trace.meta['stopped'], trace.meta['figures']
    if folder is not None:
        from delta3_pacdrive.analysis import run_report

        told = [*([stopped] if stopped else []), *(records.sentences() if records else ())]
        run_report.write(folder, trace, records.taken if records else (), told)
    if stopped:
        raise RunError(f'{stopped}; it stood after {trace.time_s[-1]:.3f} s of bus time')
    ends = figures['final_tcp_m'], trace.meta['planned_end_m']
    missed = arrival.why_not_arrived(*ends)
    cycles = len(trace.time_s)
    result = {
        'ok': missed is None,
        **({} if missed is None else {'error': missed}),
        'program': program.name,
        **{key: trace.meta[key] for key in ('notices', 'program_s', 'repeat')},
        'cycles': cycles,
        'bus_time_s': cycles * robot.bus.cycle_time_s,
        'wall_time_s': wall,
        'overruns': 0,  # there is no clock
        'lost_telegrams': trace.meta['lost_telegrams'],
        'end_error_m': arrival.end_error_m(*ends),
        **figures,
        **({} if exact is None else {'from_exact': exact}),
    }
    energy = energy_of_round(trace, robot, trace.meta['repeat'])
    if energy is not None:
        result['energy'] = asdict(energy)
    if records is not None:
        result['scope'] = records.written
    notes = (*chosen.notes, *(records.sentences() if records else ()))
    if folder is not None:
        result['files'] = folder.files
        notes = (*notes, f'report: {folder.files[0]}')
    return print_run(result, options, robot, inputs, notes=notes)


def _simulated(
    options: Options,
    program: 'Program',
    robot: 'Parameters',
    origin: 'Provenance',
    torques: 'Learned | None',
) -> 'tuple[Trace, Records | None]':
    """Run a program, with oscilloscopes in the drives if they are asked for; raises Delta3Error."""
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis import trace_export

    asked = trace_export.on_request(options.signals or ())
    if options.scope is None:
        given = asked or torques is not None
        more = (None, asked, torques) if given else ()
        return simulation.run(program, robot, *more), None
    from delta3_pacdrive.recording.acquisition import Acquisition

    output = (
        options.scope_output if options.report is None else str(Path(options.report) / options.scope_output)
    )
    records = Records(options, output, origin)
    setting = options.setting(options.scope, robot, all_of_it=True)
    acquisition = Acquisition(setting, records.take)
    trace = simulation.run(program, robot, acquisition, asked, torques)
    if not records.written:
        raise RunError(
            f'the trigger never came: {setting.trigger.sentence if setting.trigger else ""} was awaited until the end '
            f'of the run, {trace.time_s[-1]:.3f} s'
        )
    return trace, records


def _run_one_motor(options: Options) -> int:
    """Run the study of a single motor; return the exit status."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.analysis.one_motor import report, run, study
    from delta3_pacdrive.cli.studies import conduct
    from delta3_pacdrive.motion import program_file as programs
    from delta3_pacdrive.recording import trace_file

    if options.exchange_period is not None:
        raise RunError('--exchange-period is not for --one-motor: drive and motor exchange every 125e-6 s')
    if options.trace:
        trace_file.require_writable_trace(options.trace)
    # what the thesis did in ECAM-4 has its controller
    options.parameters = options.parameters or core.THESIS_CONTROLLER
    settings = study.Settings(
        options.parameters,
        options.axis,
        options.load_inertia,
        options.load_torque,
        options.coupling,
        options.trace,
    )
    folder = Path(options.output or 'one_motor').absolute()
    with program_of(options) as chosen:
        program = programs.load(chosen.program, core.load(options.parameters).motion)
    return conduct(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show, program, chosen.digests()).run(),
        report.text,
        writes=folder,
    )


main = Command(
    'simulate', 'Run a program without ROS, as fast as possible; the same signals as the graph.', Options, run
)
