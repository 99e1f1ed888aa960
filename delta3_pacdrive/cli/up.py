"""``delta3 up``: bring a robot up and keep it up, ready for ``delta3 move`` and any ROS client, until Ctrl-C."""

import sys
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cli.command import Command
from delta3_pacdrive.cli.output import print_json
from delta3_pacdrive.cli.progress import Progress
from delta3_pacdrive.cli.run import GraphOptions, bring_up, show_run


@dataclass
class Options(GraphOptions):
    """Options of the command."""


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
    bringup, result = bring_up(
        options, None, lambda display, bringup: _Announcement(display, bringup, options.json).show
    )
    if options.json:
        print_json(result | {'controller': bringup.robot.controller}, options, bringup.robot)
    else:
        print(
            f'bus time {result["bus_time_s"]:.3f} s in {result["cycles"]} cycles, {result["overruns"]} overruns, '
            f'{result["lost_telegrams"]} lost AT'
        )
    return 0


main = Command('up', 'Start every node of a robot and keep it up for moves, until Ctrl-C.', Options, run)
