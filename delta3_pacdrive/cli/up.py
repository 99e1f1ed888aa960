"""``delta3 up``: start robots and keep them running for ``delta3 move`` and other ROS clients, until Ctrl-C."""

import sys
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cli.command import Command, flag, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.output import Output, with_provenance
from delta3_pacdrive.cli.progress import Progress
from delta3_pacdrive.cli.run import GraphOptions, bring_up, lacking, show_run
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.view import serving

ROBOTS_MAX = 10  # limit of discovery on one machine, see ``bringup.robots``


@dataclass
class Options(GraphOptions):
    """Options of the command."""

    robots: int | None = option(
        'number of robots: robot1, robot2 ... below the namespace, each with all nodes in one process; --bag and '
        '--logs create a subfolder for each, --view a web page for each, from --view-port upwards',
        'N',
        type=integer_within(1, ROBOTS_MAX),
    )
    frame_prefix: str | None = option(
        'text before the frame base and the links of the robot, such as robot1/, for several robots in one tf tree; '
        'with --robots the number of each robot and / follow it: robot becomes robot1/, robot2/ ...',
        'PREFIX',
    )
    shared_clock: bool = flag(
        'with --robots: one bus clock for all robots, so that bus cycles with the same number start at the same time; '
        'a slow robot delays all others'
    )
    separate_processes: bool = flag(
        'with --robots: a separate process for each node', needs='--robots', excludes=('--single-process',)
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.shared_clock and (self.robots or 1) < 2:
            return '--shared-clock requires --robots with two or more robots'
        last = (self.view_port or 0) + (self.robots or 1) - 1
        if self.view_port and self.robots and last > serving.PORT_MAX:
            return (
                f'--view-port is {self.view_port}, but the page of the last robot would require port {last}'
            )
        return super().check()


class _Announcement:
    """Prints notes, faults and readiness of the robot above the progress line."""

    def __init__(self, display: Progress, bringup: Any, quiet: bool) -> None:
        self._display, self._bringup, self._quiet = display, bringup, quiet
        self._announced = False
        self._notes = 0
        self._fault = ''

    def _print(self, sentence: str) -> None:
        if not self._quiet:
            print(sentence, file=sys.stderr, flush=True)

    def show(self, progress: MotionProgress) -> None:
        for note in self._bringup.notes[self._notes :]:
            self._notes += 1
            self._print(note)
        if progress.fault != self._fault:
            self._fault = progress.fault
            self._print(f'fault: {self._fault}' if self._fault else 'faults cleared')
        if not self._announced and progress.phase == 'CP4' and progress.waiting:
            self._announced = True
            self._print(f'{progress.waiting}; Ctrl-C ends')
        if not self._announced and progress.in_torque:
            self._announced = True
            self._print(f'ready after {self._bringup.ready_s:.2f} s; Ctrl-C ends')
            self._print(f'controller: {self._bringup.robot.controller}')
        show_run(self._display, progress)


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive import parameters as core

    options.parameters = core.of_run(options.parameters)
    if options.robots is not None:
        from delta3_pacdrive.cli import up_robots

        options.single_process = not options.separate_processes
        return up_robots.run(options, options.robots, options.shared_clock)
    bringup, result = bring_up(
        options, None, lambda display, bringup: _Announcement(display, bringup, options.json).show
    )
    done = (
        f'bus time {result["bus_time_s"]:.3f} s in {result["cycles"]} cycles, {result["overruns"]} overruns, '
        f'{result["lost_telegrams"]} lost AT, {result["restarts"]} processes restarted'
    )
    document = with_provenance(result | {'controller': bringup.robot.controller}, options, bringup.robot)
    return Output(document, [done, *lacking(result, options.bag)])


main = Command(
    'up',
    'Start all nodes of one or several robots and keep them running for moves, until Ctrl-C.',
    Options,
    run,
)
