"""``delta3 run``: start a robot, run a program with a progress display, print a summary, stop the robot."""

import math
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, NodeOptions, ReferenceOptions, RobotOptions, flag, option
from delta3_pacdrive.cli.output import Output, output_of_run, stdout_reserved, with_provenance
from delta3_pacdrive.cli.progress import Progress, announce_compilation
from delta3_pacdrive.cli.reference import Chosen, cell_digest, program_of
from delta3_pacdrive.errors import ProgramError, RunError, RunInterruptedError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.view import serving

if TYPE_CHECKING:
    from delta3_pacdrive.bringup.options import Options as BringupOptions

SCRIPT_SUFFIX = '.py'  # repeated from ``scripting.script``, whose import is slow
OnProgress = Callable[[MotionProgress], None]


@dataclass
class GraphOptions(NodeOptions, RobotOptions):
    """Options of the commands that start the nodes of a robot."""

    real_time_factor: float = option(
        'bus time divided by wall time; 0: as fast as possible', 'F', default=1.0, type=float
    )
    single_process: bool = flag('all nodes in one process')
    no_realtime: bool = flag(
        'do not use real-time scheduling, even if it is permitted', formerly='--ordinary-priority'
    )
    bag: str | None = option('record every cyclic topic into a new rosbag2 folder', 'DIR')
    learned: str | None = option(
        'add the feed-forward torques of delta3 learn to this program; rejected or ignored for other programs',
        'FILE',
    )
    cell: str | None = option(
        'simulate a cell: cell file, or cell for the packaged one; the gripper then holds simulated parts, and the '
        'inputs are on the bus',
        'FILE',
    )
    markers: bool = flag('publish markers for RViz and Foxglove, and the bus time as /clock')
    joint_motion: bool = flag(
        'publish joint speeds and accelerations through the Jacobian and its condition number in every cycle: topics '
        'joint_motion and jacobian'
    )
    logs: str | None = option('keep the logs of all processes in this folder', 'DIR')
    memory: str | None = option(
        'keep the data that the drives store (S-0-0264) in this folder; default: until the robot ends', 'DIR'
    )
    view: bool = flag('serve a web page that shows the robot (delta3 view)')
    view_port: int | None = option(
        f'port of the web page (default: first free port from {serving.PORT})',
        'PORT',
        type=int,
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if not 0.0 <= self.real_time_factor <= 1000.0:
            return f'--real-time-factor is {self.real_time_factor}, but must be between 0 and 1000'
        return serving.refusal('--view-port', self.view_port) or super().check()


@dataclass
class Options(GraphOptions, ReferenceOptions):
    """Options of the command."""

    step: bool = flag('single-step a script: ask before each move and stop after it')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.step and Path(self.program or '').suffix != SCRIPT_SUFFIX:
            return '--step requires a script'
        return super().check()


def show_run(display: Progress, progress: MotionProgress) -> None:
    """Show the progress of a run."""
    wall, bus, end = progress.wall_time_s or 1e-9, progress.bus_time_s, progress.end_s
    share = f'{100.0 * bus / end:3.0f} % ' if end else ''
    settling = '  settling' if progress.settling else ''
    display.show(
        f'bus {bus:8.3f} s  move {progress.move + 1}/{progress.moves}{settling}',
        bus,
        end,
        f'{share}{progress.master_m * 1e3:6.1f} mm'
        f'  following error {math.degrees(progress.following_error_rad):.4f} deg'
        f'  {bus / wall:.2f} x real time  {progress.overruns} overruns',
    )


def bring_up(
    options: GraphOptions,
    program: str | None,
    shown: Callable[[Progress, Any], OnProgress],
    script: bool = False,
) -> tuple[Any, dict[str, Any]]:
    """Start a robot for a program, for a script or until an interrupt; return the bring-up and its result.

    ``shown`` returns the callback for progress. Raises RunError.
    """
    started_s = time.monotonic()
    from delta3_pacdrive.bringup.environment import log_folder, only_one
    from delta3_pacdrive.bringup.page import started
    from delta3_pacdrive.ros.wire import domain

    namespace = domain.namespace(options.namespace)
    with only_one(namespace):  # reject a second robot before slow imports
        pass
    with ExitStack() as stack:
        logs = Path(options.logs).absolute() if options.logs else None
        page = None
        if options.view or options.view_port:
            place = stack.enter_context(serving.held(serving.HOST, options.view_port))
            logs = stack.enter_context(log_folder(logs))
            page = stack.enter_context(started(place, namespace, logs))
            print(f'web page: {place.url}', file=sys.stderr, flush=True)
        # ROS and numba are imported after the options are checked
        from delta3_pacdrive.bringup.bringup import Bringup

        announce_compilation(options.parameters)
        asked = replace(asked_for(options, program, script), namespace=namespace, logs=logs, view=page)
        bringup = Bringup(asked, started_s)
        display = stack.enter_context(Progress(quiet=options.json))
        return bringup, bringup.run(shown(display, bringup))


def asked_for(options: GraphOptions, program: str | None = None, script: bool = False) -> 'BringupOptions':
    """Return the options of the bring-up, except namespace, logs and page."""
    from delta3_pacdrive.bringup.options import Options as BringupOptions
    from delta3_pacdrive.cell import cell_file
    from delta3_pacdrive.planning.program import file_reader as programs

    return BringupOptions(
        program=programs.find(program).absolute() if program is not None else None,
        parameters=Path(options.parameters) if options.parameters else None,
        real_time_factor=options.real_time_factor,
        bag=Path(options.bag).absolute() if options.bag else None,
        single_process=options.single_process,
        exchange_period_s=options.exchange_period,
        real_time_priority=not options.no_realtime,
        markers=options.markers,
        joint_motion=options.joint_motion,
        learned=Path(options.learned).absolute() if options.learned else None,
        memory=Path(options.memory).absolute() if options.memory else None,
        script=script,
        frame_prefix=getattr(options, 'frame_prefix', None) or '',
        first=getattr(options, 'first', 0),
        cell=cell_file.find(options.cell).absolute() if options.cell else None,
    )


def lacking(result: dict[str, Any], bag: object) -> list[str]:
    """Return notes on messages missing from the recording in folder ``bag``."""
    notes = []
    if missing := result.get('bag_missing'):
        notes.append(f'{bag} lacks {missing} messages: the recorder could not keep up')
    if cut := result.get('bag_cut'):
        notes.append(f'{bag}: {cut}')
    return notes


def run(options: Options) -> Output:
    """Run the command; return its result."""
    with program_of(options) as chosen:
        if Path(chosen.program).suffix == SCRIPT_SUFFIX:
            return _run_script(options, chosen)
        bringup, result = bring_up(options, chosen.program, lambda display, _: partial(show_run, display))
    notes, inputs = [*chosen.notes, *lacking(result, options.bag)], [*chosen.digests(), *cell_digest(options)]
    ready = f', ready after {result["ready_s"]:.2f} s'
    return output_of_run(result, options, bringup.robot, inputs, ready=ready, notes=notes)


def _run_script(options: Options, chosen: Chosen) -> Output:
    """Start a robot and run a script on it; return the result."""
    from delta3_pacdrive.cli.script_run import ScriptRun, held_text, text
    from delta3_pacdrive.scripting import script

    if options.learned:
        raise ProgramError('--learned requires a program: the path of a script is not known in advance')
    with stdout_reserved(options.json):
        read = script.load(chosen.program)
    runs: list[ScriptRun] = []

    def shown(display: Progress, bringup: Any) -> OnProgress:
        shows = (lambda _: None) if options.step else partial(show_run, display)
        runs.append(ScriptRun(read, bringup, shows, options.step))
        return runs[0].show

    with stdout_reserved(options.json):
        bringup, result = bring_up(options, None, shown, script=True)
    (own,) = runs
    result |= own.result()
    if own.interrupted:
        raise RunInterruptedError(held_text(result['held_at_cycle']))
    if own.error is not None:
        raise own.error
    if not own.ended:
        raise RunError(f'{read.name} did not finish')
    result |= {'controller': bringup.robot.controller}
    done = f'{read.name}: done, ready after {result["ready_s"]:.2f} s'
    document = with_provenance(result, options, bringup.robot, [*chosen.digests(), *cell_digest(options)])
    return Output(document, [done, *text(result), *lacking(result, options.bag)])


main = Command(
    'run', 'Start all nodes of a robot, run a program, print a summary, stop the nodes.', Options, run
)
