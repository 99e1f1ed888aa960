"""``delta3 run``: bring a robot up, run a program with a progress display, print a summary, stop everything."""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.output import (
    add_robot_options,
    announce_compilation,
    guarded,
    parser_for,
    print_figures,
    print_json,
)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'run', 'Start every node of a robot, run a program, print a summary, stop everything.'
    )
    add_robot_options(parser)
    add_graph_options(parser)
    result = parser.parse_args(arguments)
    check_graph_options(parser, result)
    return result


def add_graph_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how the nodes of a robot run."""
    parser.add_argument('--namespace', default='/', help='ROS namespace of the robot')
    parser.add_argument(
        '--real-time-factor',
        type=float,
        default=1.0,
        metavar='F',
        help='bus time over wall time; 0: no clock',
    )
    parser.add_argument('--single-process', action='store_true', help='all nodes in one process')
    parser.add_argument(
        '--ordinary-priority', action='store_true', help='no real-time scheduling even where it is permitted'
    )
    parser.add_argument('--bag', metavar='DIR', help='record every cyclic topic into a new rosbag2 folder')
    parser.add_argument('--logs', metavar='DIR', help='keep the log of every process in this folder')


def check_graph_options(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End the program with a usage error if an option is out of range."""
    if not 0.0 <= options.real_time_factor <= 1000.0:
        parser.error(f'--real-time-factor is {options.real_time_factor}, but must be between 0 and 1000')


class Display:
    """A bar and a line that tell how the run goes; silent where nobody looks."""

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn('{task.description}'),
            BarColumn(bar_width=24),
            TextColumn('{task.percentage:3.0f} %'),
            TextColumn('{task.fields[facts]}'),
            console=console,
            disable=quiet or not console.is_terminal,
        )
        self._task = self._bar.add_task('starting', total=None, facts='')
        self._bar.start()

    def show(self, progress: dict[str, Any]) -> None:
        """Draw the line anew."""
        wall = progress['wall_time_s'] or 1e-9
        facts = (
            f'{progress["master_m"] * 1e3:6.1f} mm'
            f'  following error {math.degrees(progress["following_error_rad"]):.4f} deg'
            f'  {progress["bus_time_s"] / wall:.2f} x real time  {progress["overruns"]} overruns'
        )
        self._bar.update(
            self._task,
            description=f'bus {progress["bus_time_s"]:8.3f} s  move {progress["move"] + 1}/{progress["moves"]}',
            completed=progress['bus_time_s'],
            total=progress['end_s'],
            facts=facts,
        )

    def close(self) -> None:
        """End the display."""
        self._bar.stop()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _run(options), options.json)


def refuse_second(options: argparse.Namespace) -> None:
    """Raise RunError if the namespace has a robot, before anything that takes long is loaded."""
    from delta3_pacdrive.bringup.lock import only_one

    with only_one(namespace_of(options)):
        pass


def namespace_of(options: argparse.Namespace) -> str:
    """Return the namespace that is asked for, with one slash in front."""
    return '/' + str(options.namespace).strip('/')


def _run(options: argparse.Namespace) -> int:
    refuse_second(options)
    # ROS and numba are imported after the options are known to be good
    from delta3_pacdrive.analysis.provenance import digest
    from delta3_pacdrive.bringup.bringup import Bringup
    from delta3_pacdrive.motion import program_file as programs

    announce_compilation()
    program = programs.find(options.program).absolute()
    bringup = Bringup(options_of(options, program))
    display = Display(quiet=options.json)
    try:
        result = bringup.run(display.show)
    finally:
        display.close()
    if options.json:
        print_json(result, options, bringup.robot, [f'{options.program} {digest(program)}'])
    else:
        ending = 'done' if result['ok'] else 'not arrived'
        print(f'{result["program"]}: {ending}, ready after {result["ready_s"]:.2f} s')
        print_figures(result)
        if missing := result.get('bag_missing'):
            print(f'{options.bag} lacks {missing} messages: the machine was too busy to record all of them')
        if cut := result.get('bag_cut'):
            print(f'{options.bag}: {cut}')
    if not result['ok']:
        print(f'error: {result["error"]}', file=sys.stderr)
        return 1
    return 0


def options_of(options: argparse.Namespace, program: Path | None) -> Any:
    """Return the options of a bring-up from those of the command line."""
    from delta3_pacdrive.bringup.bringup import Options

    return Options(
        program=program,
        parameters=Path(options.parameters) if options.parameters else None,
        namespace=namespace_of(options),
        real_time_factor=options.real_time_factor,
        bag=Path(options.bag).absolute() if options.bag else None,
        single_process=options.single_process,
        exchange_period_s=options.exchange_period,
        real_time_priority=not options.ordinary_priority,
        logs=Path(options.logs).absolute() if options.logs else None,
    )


def bringup() -> int:
    """Be ``ros2 run delta3_pacdrive bringup``."""
    return main(sys.argv[1:])


if __name__ == '__main__':
    sys.exit(bringup())
