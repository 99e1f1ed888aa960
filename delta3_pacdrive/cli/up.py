"""``delta3 up``: bring robots up and keep them up, ready for ``delta3 move`` and any ROS client, until Ctrl-C."""

import sys
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cli.command import Command, flag, option
from delta3_pacdrive.cli.option_types import integer_within
from delta3_pacdrive.cli.output import print_json
from delta3_pacdrive.cli.progress import Progress
from delta3_pacdrive.cli.run import GraphOptions, bring_up, lacking, show_run
from delta3_pacdrive.view import serving

ROBOTS_MAX = 10  # that find each other on one machine, see ``bringup.robots``


@dataclass
class Options(GraphOptions):
    """Options of the command."""

    robots: int | None = option(
        'bring up so many robots, robot1, robot2 ... below the namespace, each with all its nodes in one process; with '
        '--bag and --logs each has a folder of that name, with --view a page, from --view-port on',
        'N',
        type=integer_within(1, ROBOTS_MAX),
    )
    shared_clock: bool = flag(
        'with --robots: all go by one bus clock, so that bus cycles of one number begin at one instant; who falls '
        'behind makes all late'
    )
    separate_processes: bool = flag('with --robots: each node in a process of its own, as one robot has it')

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if self.separate_processes and self.robots is None:
            return '--separate-processes is for --robots: one robot has separate processes anyway'
        if self.shared_clock and (self.robots or 1) < 2:
            return '--shared-clock is for --robots, two or more: one robot has a bus clock of its own'
        if self.separate_processes and self.single_process:
            return '--separate-processes and --single-process exclude each other'
        last = (self.view_port or 0) + (self.robots or 1) - 1
        if self.view_port and self.robots and last > serving.PORT_MAX:
            return f'--view-port is {self.view_port}, but the page of the last robot would need port {last}'
        return super().check()


class _Announcement:
    """The announcement says once that the robot is ready, then leaves the line to the display."""

    def __init__(self, display: Progress, bringup: Any, quiet: bool) -> None:
        self._display, self._bringup, self._quiet = display, bringup, quiet
        self._told = False
        self._notes = 0
        self._fault = ''

    def _say(self, sentence: str) -> None:
        if not self._quiet:
            print(sentence, file=sys.stderr, flush=True)

    def show(self, progress: dict[str, Any]) -> None:
        for note in self._bringup.notes[self._notes :]:
            self._notes += 1
            self._say(note)
        if progress['fault'] != self._fault:
            self._fault = progress['fault']
            self._say(f'fault: {self._fault}' if self._fault else 'faults cleared')
        if not self._told and progress['in_torque']:
            self._told = True
            self._say(f'ready after {self._bringup.ready_s:.2f} s; Ctrl-C ends')
            self._say(f'controller: {self._bringup.robot.controller}')
        show_run(self._display, progress)


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive import parameters as core

    options.parameters = core.of_run(options.parameters)
    if options.robots is not None:
        from delta3_pacdrive.cli import up_robots

        options.single_process = not options.separate_processes
        return up_robots.run(options, options.robots, options.shared_clock)
    bringup, result = bring_up(
        options, None, lambda display, bringup: _Announcement(display, bringup, options.json).show
    )
    if options.json:
        print_json(result | {'controller': bringup.robot.controller}, options, bringup.robot)
    else:
        done = (
            f'bus time {result["bus_time_s"]:.3f} s in {result["cycles"]} cycles, {result["overruns"]} overruns, '
            f'{result["lost_telegrams"]} lost AT, {result["restarts"]} processes started again'
        )
        print('\n'.join([done, *lacking(result, options.bag)]))
    return 0


main = Command(
    'up',
    'Start every node of a robot, or of several, and keep them up for moves, until Ctrl-C.',
    Options,
    run,
)
