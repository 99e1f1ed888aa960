"""``delta3 simulate``: the same control and plant code in one loop, without ROS."""

import time
from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, ReferenceOptions, option
from delta3_pacdrive.cli.option_types import trace_file
from delta3_pacdrive.cli.output import print_run
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.reference import program_of


@dataclass
class Options(ReferenceOptions):
    """Options of the command."""

    trace: str | None = option('write every signal to this .npz or .csv file', 'FILE', type=trace_file)


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis import derived_signals
    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.errors import RunError
    from delta3_pacdrive.motion import arrival
    from delta3_pacdrive.motion import program_file as programs
    from delta3_pacdrive.recording import trace_file

    if options.trace:
        trace_file.require_writable(options.trace)
    announce_compilation(options.parameters)
    robot = core.load(options.parameters)
    if options.exchange_period is not None:
        robot = robot.replace(bus__exchange_period_s=options.exchange_period)
    with program_of(options) as chosen:
        program = programs.load(chosen.program, robot.motion)
    simulation.load_kernels(robot)
    started = time.perf_counter()
    trace = simulation.run(program, robot)
    wall = time.perf_counter() - started
    inputs = chosen.digests()
    if options.trace:
        from delta3_pacdrive.analysis.runs import note_limits

        note_limits(trace, program, simulation.placed(robot, program))
        origin = Provenance.of(options.command_line, robot, options.parameters, inputs)
        trace.meta['provenance'] = origin.lines()
        trace_file.save(derived_signals.added(trace), options.trace)
    stopped, figures = trace.meta['stopped'], trace.meta['figures']
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
    }
    return print_run(result, options, robot, inputs, notes=chosen.notes)


main = Command(
    'simulate', 'Run a program without ROS, as fast as possible; the same signals as the graph.', Options, run
)
