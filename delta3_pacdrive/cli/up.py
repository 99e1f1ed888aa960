"""``delta3 up``: bring a robot up and keep it up, ready for ``delta3 move`` and any ROS client, until Ctrl-C."""

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from delta3_pacdrive.cli.output import (
    add_parameter_options,
    announce_compilation,
    guarded,
    parser_for,
    print_json,
)
from delta3_pacdrive.cli.run import Display, add_graph_options, check_graph_options, options_of, refuse_second


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for('up', 'Start every node of a robot and keep it up for moves, until Ctrl-C.')
    add_parameter_options(parser)
    add_graph_options(parser)
    options = parser.parse_args(arguments)
    check_graph_options(parser, options)
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _run(options), options.json)


class _Announcement:
    """Says once that the robot is ready, then leaves the line to the display."""

    def __init__(self, display: Display, bringup: Any, quiet: bool) -> None:
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
        self._display.show(progress)


def _run(options: argparse.Namespace) -> int:
    refuse_second(options)
    from delta3_pacdrive.bringup.bringup import Bringup

    announce_compilation()
    bringup = Bringup(options_of(options, None))
    display = Display(quiet=options.json)
    try:
        result = bringup.run(_Announcement(display, bringup, options.json).show)
    finally:
        display.close()
    if options.json:
        print_json(result, options, bringup.robot)
    else:
        print(
            f'bus time {result["bus_time_s"]:.3f} s in {result["cycles"]} cycles, {result["overruns"]} overruns, '
            f'{result["lost_telegrams"]} lost AT'
        )
    return 0


if __name__ == '__main__':
    sys.exit(main())
