"""``delta3 run``: bring a robot up, run a program with a progress display, print a summary, stop everything."""

import math
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.command import Command, NodeOptions, ReferenceOptions, RobotOptions, flag, option
from delta3_pacdrive.cli.output import print_run
from delta3_pacdrive.cli.progress import Progress, announce_compilation
from delta3_pacdrive.cli.reference import program_of
from delta3_pacdrive.view import serving

OnProgress = Callable[[dict[str, Any]], None]


@dataclass
class GraphOptions(NodeOptions, RobotOptions):
    """Options that say how the nodes of a robot run."""

    real_time_factor: float = option('bus time over wall time; 0: no clock', 'F', default=1.0, type=float)
    single_process: bool = flag('all nodes in one process')
    ordinary_priority: bool = flag('no real-time scheduling even where it is permitted')
    bag: str | None = option('record every cyclic topic into a new rosbag2 folder', 'DIR')
    learned: str | None = option(
        'follow the torques that delta3 learn has found for this program; they are refused, or dropped, with any other',
        'FILE',
    )
    markers: bool = flag('also show the robot as markers for RViz and Foxglove, and tell bus time as /clock')
    joint_motion: bool = flag(
        'also tell joint speeds and accelerations through the Jacobian, and its condition, in every cycle: topics '
        'joint_motion and jacobian'
    )
    logs: str | None = option('keep the log of every process in this folder', 'DIR')
    view: bool = flag('show the robot as a page in the browser (delta3 view)')
    view_port: int | None = option(
        f'show it at this port; without it --view takes the first free one from {serving.PORT} on',
        'PORT',
        type=int,
    )

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if not 0.0 <= self.real_time_factor <= 1000.0:
            return f'--real-time-factor is {self.real_time_factor}, but must be between 0 and 1000'
        return serving.refusal('--view-port', self.view_port) or super().check()


@dataclass
class Options(GraphOptions, ReferenceOptions):
    """Options of the command."""


def show_run(display: Progress, progress: dict[str, Any]) -> None:
    """Show how a run goes."""
    wall, bus, end = progress['wall_time_s'] or 1e-9, progress['bus_time_s'], progress['end_s']
    share = f'{100.0 * bus / end:3.0f} % ' if end else ''
    display.show(
        f'bus {bus:8.3f} s  move {progress["move"] + 1}/{progress["moves"]}',
        bus,
        end,
        f'{share}{progress["master_m"] * 1e3:6.1f} mm'
        f'  following error {math.degrees(progress["following_error_rad"]):.4f} deg'
        f'  {bus / wall:.2f} x real time  {progress["overruns"]} overruns',
    )


def bring_up(
    options: GraphOptions, program: str | None, shown: Callable[[Progress, Any], OnProgress]
) -> tuple[Any, dict[str, Any]]:
    """Bring a robot up, for a program or until it is interrupted; return the bring-up and its result.

    ``shown`` returns what shows how it goes. Raises RunError.
    """
    started_s = time.monotonic()
    namespace = '/' + options.namespace.strip('/')
    from delta3_pacdrive.bringup.environment import log_folder, only_one
    from delta3_pacdrive.bringup.page import started

    with only_one(namespace):  # a second robot is refused before anything that takes long is loaded
        pass
    with ExitStack() as stack:
        logs = Path(options.logs).absolute() if options.logs else None
        page = None
        if options.view or options.view_port:
            place = stack.enter_context(serving.held(serving.HOST, options.view_port))
            logs = stack.enter_context(log_folder(logs))
            page = stack.enter_context(started(place, namespace, logs))
            print(f'the page comes up at {place.url}', file=sys.stderr, flush=True)
        # ROS and numba are imported after the options are known to be good
        from delta3_pacdrive.bringup.bringup import Bringup
        from delta3_pacdrive.bringup.options import Options as BringupOptions
        from delta3_pacdrive.motion import program_file as programs

        announce_compilation(options.parameters)
        asked = BringupOptions(
            program=programs.find(program).absolute() if program is not None else None,
            parameters=Path(options.parameters) if options.parameters else None,
            namespace=namespace,
            real_time_factor=options.real_time_factor,
            bag=Path(options.bag).absolute() if options.bag else None,
            single_process=options.single_process,
            exchange_period_s=options.exchange_period,
            real_time_priority=not options.ordinary_priority,
            markers=options.markers,
            joint_motion=options.joint_motion,
            logs=logs,
            learned=Path(options.learned).absolute() if options.learned else None,
            view=page,
        )
        bringup = Bringup(asked, started_s)
        display = stack.enter_context(Progress(quiet=options.json))
        return bringup, bringup.run(shown(display, bringup))


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    with program_of(options) as chosen:
        bringup, result = bring_up(options, chosen.program, lambda display, _: partial(show_run, display))
    notes = list(chosen.notes)
    if missing := result.get('bag_missing'):
        notes.append(
            f'{options.bag} lacks {missing} messages: the machine was too busy to record all of them'
        )
    if cut := result.get('bag_cut'):
        notes.append(f'{options.bag}: {cut}')
    ready = f', ready after {result["ready_s"]:.2f} s'
    return print_run(result, options, bringup.robot, chosen.digests(), ready, notes)


main = Command(
    'run', 'Start every node of a robot, run a program, print a summary, stop everything.', Options, run
)
