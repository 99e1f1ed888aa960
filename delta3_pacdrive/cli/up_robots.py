"""``delta3 up --robots N``: several robots under one supervisor, with one table of their states."""

import math
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.output import print_json
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.run import GraphOptions, asked_for, lacking
from delta3_pacdrive.errors import RunError

HEADINGS = ('robot', 'phase', 'state', 'bus time', 'overruns', 'lost AT')
ALIGNED = ('left', 'left', 'left', 'right', 'right', 'right')


def row(robot: Any) -> tuple[str, ...]:
    """Return what the table says of a robot."""
    progress = robot.progress
    state = progress.get('fault') or progress.get('waiting') or progress.get('state') or 'starting'
    if robot.ended:
        state = robot.error or 'ended'
    if 'bus_time_s' not in progress:
        return robot.namespace, '', state, '', '', ''
    counts = str(progress['overruns']), str(progress['lost_telegrams'])
    return robot.namespace, progress['phase'], state, f'{progress["bus_time_s"]:.1f} s', *counts


def text_table(robots: Sequence[Any]) -> list[str]:
    """Return the table as lines."""
    rows = [HEADINGS, *map(row, robots)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        '  '.join(
            cell.rjust(width) if side == 'right' else cell.ljust(width)
            for cell, width, side in zip(cells, widths, ALIGNED, strict=True)
        ).rstrip()
        for cells in rows
    ]


class _Display:
    """A table that is drawn anew where somebody looks, and sentences about what has happened."""

    def __init__(self, quiet: bool) -> None:
        from rich.console import Console
        from rich.live import Live

        self._quiet = quiet
        self._console = Console(stderr=True, highlight=False, markup=False)
        self._live = (
            None
            if quiet or not self._console.is_terminal
            else Live(console=self._console, auto_refresh=False, transient=True)
        )
        self._told: dict[str, dict[str, Any]] = {}
        self._said: set[str] = set()
        self._all_up = False

    def __enter__(self) -> '_Display':
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, sentence: str) -> None:
        """Say a sentence, above the table."""
        if not self._quiet:
            self._console.print(sentence, soft_wrap=True)

    def show(self, robots: Sequence[Any]) -> None:
        """Say what is new, and draw the table."""
        for robot in robots:
            self._say_news(robot, self._told.setdefault(robot.namespace, {}))
        if not self._all_up and all(robot.ready_s or robot.ended for robot in robots):
            self._all_up = True
            up = [robot for robot in robots if not robot.ended]
            if up and self._live is None:
                self.say('\n'.join(text_table(robots)))
            if up:
                seconds = max(robot.ready_s for robot in up)
                self.say(f'ready after {seconds:.2f} s: {len(up)} of {len(robots)} robots; Ctrl-C ends all')
        if self._live is not None:
            self._live.update(_rich_table(robots), refresh=True)

    def _say_news(self, robot: Any, told: dict[str, Any]) -> None:
        for note in robot.notes[told.get('notes', 0) :]:
            own = f'{robot.namespace}: {note}'
            if note not in self._said or 'page' in note:  # what is true of all is said once
                self.say(own)
            self._said.add(note)
        told['notes'] = len(robot.notes)
        fault = robot.progress.get('fault', '')
        if fault != told.get('fault', ''):
            self.say(f'{robot.namespace}: ' + (f'fault: {fault}' if fault else 'faults cleared'))
        told['fault'] = fault
        if robot.error and not told.get('error'):
            self.say(f'{robot.namespace}: {robot.error}; this robot is gone, the others go on')
        told['error'] = robot.error


def _rich_table(robots: Sequence[Any]) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading, side in zip(HEADINGS, ALIGNED, strict=True):
        table.add_column(heading, justify=side, overflow='fold')  # type: ignore[arg-type]
    for robot in robots:
        table.add_row(*row(robot))
    return table


def run(options: GraphOptions, count: int, shared_clock: bool) -> int:
    """Bring robots up and keep them up, until Ctrl-C or until none is left; return the exit status."""
    started_s = time.monotonic()
    from delta3_pacdrive.bringup.environment import bag_of, namespaces, only_one

    names = namespaces(count, options.namespace)
    with (
        ExitStack() as held
    ):  # a robot that is there already is told before anything that takes long is loaded
        for name in names:
            held.enter_context(only_one(name))
    from delta3_pacdrive.bringup import robots

    asked = asked_for(options)
    page = bool(options.view or options.view_port)
    robots.require_room(count, asked, page)
    announce_compilation(options.parameters)
    logs = Path(options.logs).absolute() if options.logs else None
    bags = _folder_of_bags(asked.bag)
    each = [replace(asked, namespace=name, logs=logs, bag=bags and bag_of(bags, name)) for name in names]
    supervisor = robots.Robots(each, page, options.view_port, started_s, shared_clock)
    with _Display(options.json) as display:
        supervisor.run(display.show, display.say)
    return _print_result(options, supervisor.now, bags, supervisor.crowded)


def _folder_of_bags(folder: Path | None) -> Path | None:
    """Make the folder in which each robot has its bag; raises RunError."""
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise RunError(f'cannot record into {folder}: it exists already') from None
    return folder


def _print_result(options: GraphOptions, robots: Sequence[Any], bags: Path | None, crowded: str) -> int:
    dead = [robot for robot in robots if robot.error]
    if options.json:
        told = {
            robot.namespace: (robot.result or {'ok': not robot.error})
            | ({'error': robot.error} if robot.error else {})
            | {'notices': robot.notes}
            for robot in robots
        }
        print_json({'ok': not dead, 'real_time': not crowded, 'robots': told}, options)
    else:
        for line in result_lines(robots, bags):
            print(line)
    if dead:
        names = ', '.join(robot.namespace for robot in dead)
        print(f'error: {len(dead)} of {len(robots)} robots had gone before the end: {names}', file=sys.stderr)
    return int(bool(dead))


def result_lines(robots: Sequence[Any], bags: Path | None) -> list[str]:
    """Return what has become of each robot, and what its recording below a folder lacks."""
    from delta3_pacdrive.bringup.environment import bag_of

    lines = []
    for robot in robots:
        bag = bags and bag_of(bags, robot.namespace)
        lines += [f'{robot.namespace}: {_text(robot)}', *lacking(robot.result or {}, bag)]
    return lines


def _text(robot: Any) -> str:
    if robot.error:
        return str(robot.error)
    if robot.result is None:
        return 'ended while it came up'
    result = robot.result
    late = result.get('lateness_ms', {}).get('p99', math.nan)
    more = '' if math.isnan(late) else f', 99 % of cycles began within {late:.2f} ms'
    return (
        f'bus time {result["bus_time_s"]:.3f} s in {result["cycles"]} cycles, {result["overruns"]} overruns, '
        f'{result["lost_telegrams"]} lost AT{more}'
    )
