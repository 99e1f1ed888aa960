"""``delta3 up --robots N``: run several robots under one supervisor, with a table of their states."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.output import Output, with_provenance
from delta3_pacdrive.cli.progress import announce_compilation
from delta3_pacdrive.cli.run import GraphOptions, asked_for, lacking
from delta3_pacdrive.errors import RunError, TraceError

if TYPE_CHECKING:
    from delta3_pacdrive.bringup.options import Options as BringupOptions
    from delta3_pacdrive.parameters import Parameters

HEADINGS = ('robot', 'phase', 'state', 'bus time', 'overruns', 'lost AT')
ALIGNED = ('left', 'left', 'left', 'right', 'right', 'right')


def row(robot: Any) -> tuple[str, ...]:
    """Return the table row of a robot."""
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
    from delta3_pacdrive.studies.framework.columns import aligned

    return aligned([HEADINGS, *map(row, robots)], [{'left': '<', 'right': '>'}[side] for side in ALIGNED])


class _Display:
    """Live table of states on terminals, and messages about events."""

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
        self._reported: dict[str, dict[str, Any]] = {}
        self._printed: set[str] = set()
        self._all_up = False

    def __enter__(self) -> _Display:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def print(self, sentence: str) -> None:
        """Print a message above the table."""
        if not self._quiet:
            self._console.print(sentence, soft_wrap=True)

    def show(self, robots: Sequence[Any]) -> None:
        """Print new events and update the table."""
        for robot in robots:
            self._print_news(robot, self._reported.setdefault(robot.namespace, {}))
        if not self._all_up and all(robot.ready_s or robot.ended for robot in robots):
            self._all_up = True
            up = [robot for robot in robots if not robot.ended]
            if up and self._live is None:
                self.print('\n'.join(text_table(robots)))
            if up:
                seconds = max(robot.ready_s for robot in up)
                self.print(f'ready after {seconds:.2f} s: {len(up)} of {len(robots)} robots; Ctrl-C ends all')
        if self._live is not None:
            self._live.update(_rich_table(robots), refresh=True)

    def _print_news(self, robot: Any, reported: dict[str, Any]) -> None:
        for note in robot.notes[reported.get('notes', 0) :]:
            if note not in self._printed or 'page' in note:  # print notes common to all robots once
                self.print(f'{robot.namespace}: {note}')
            self._printed.add(note)
        reported['notes'] = len(robot.notes)
        fault = robot.progress.get('fault', '')
        if fault != reported.get('fault', ''):
            self.print(f'{robot.namespace}: ' + (f'fault: {fault}' if fault else 'faults cleared'))
        reported['fault'] = fault
        if robot.error and not reported.get('error'):
            self.print(f'{robot.namespace}: {robot.error}; this robot has ended, the others continue')
        reported['error'] = robot.error


def _rich_table(robots: Sequence[Any]) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading, side in zip(HEADINGS, ALIGNED, strict=True):
        table.add_column(heading, justify=side, overflow='fold')  # type: ignore[arg-type]
    for robot in robots:
        table.add_row(*row(robot))
    return table


def run(options: GraphOptions, count: int, shared_clock: bool) -> Output:
    """Start robots and keep them running until Ctrl-C or until all have ended; return the result."""
    started_s = time.monotonic()
    from delta3_pacdrive.bringup.environment import bag_of, namespaces, only_one

    names = namespaces(count, options.namespace)
    with ExitStack() as held:  # report robots that are already running before slow imports
        for name in names:
            held.enter_context(only_one(name))
    from delta3_pacdrive.bringup import robots
    from delta3_pacdrive.bringup.options import check_options

    asked = asked_for(options)
    page = bool(options.view or options.view_port)
    robots.require_room(count, asked, page)
    announce_compilation(options.parameters)
    logs = Path(options.logs).absolute() if options.logs else None
    bags = _folder_of_bags(asked.bag)
    each = options_of_each(replace(asked, logs=logs, bag=bags), names)
    supervisor = robots.Robots(each, page, options.view_port, started_s, shared_clock)
    with _Display(options.json) as display:
        supervisor.run(display.show, display.print)
    loads: dict[str, Any] = {}
    if shared_clock and bags is not None:
        robot, _, _ = check_options(replace(each[0], bag=None))
        cycles = max((one.result or {}).get('cycles', 0) for one in supervisor.now)
        loads = load_of_recordings([bag_of(bags, name) for name in names], cycles, robot)
    return _output(options, supervisor.now, bags, supervisor.crowded, loads)


def options_of_each(common: BringupOptions, names: Sequence[str]) -> list[BringupOptions]:
    """Return the options of each robot, by namespace; ``common`` has the folder of all bags.

    A prefix of frames is followed by the number of the robot and a slash.
    """
    from delta3_pacdrive.bringup.environment import bag_of

    prefix, bags = common.frame_prefix, common.bag
    return [
        replace(
            common,
            namespace=name,
            frame_prefix=prefix and f'{prefix}{number}/',
            bag=bags and bag_of(bags, name),
            memory=common.memory and common.memory / name.strip('/'),
        )
        for number, name in enumerate(names, 1)
    ]


def _folder_of_bags(folder: Path | None) -> Path | None:
    """Create the folder of the bags; raises RunError."""
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise RunError(f'cannot record into {folder}: it exists already') from None
    return folder


def load_of_recordings(recordings: Sequence[Path], cycles: int, robot: Parameters) -> dict[str, Any]:
    """Return the load of one DC link for all robots, or why it is unknown; empty without a model of the supply.

    ``cycles`` is the number of bus cycles of the longest recording.
    """
    from delta3_pacdrive.bringup.bringup import ENERGY_CYCLES_MAX
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.studies.runs.run_supply import common_supply, drives_power

    if not robot.supply.enabled:
        return {}
    if cycles > ENERGY_CYCLES_MAX:  # to read them would take too long
        return {'common_supply_unknown': f'the recordings have more than {ENERGY_CYCLES_MAX} cycles'}
    try:
        found = common_supply([drives_power(trace_file.load(path), robot) for path in recordings], robot)
    except TraceError as error:
        return {'common_supply_unknown': str(error)}
    if found is None:
        return {'common_supply_unknown': 'the recordings have no bus cycle in common'}
    return {'common_supply': asdict(found)}


def _output(
    options: GraphOptions, robots: Sequence[Any], bags: Path | None, crowded: str, loads: dict[str, Any]
) -> Output:
    dead = [robot.namespace for robot in robots if robot.error]
    results = {
        robot.namespace: (robot.result or {'ok': not robot.error})
        | ({'error': robot.error} if robot.error else {})
        | {'notices': robot.notes}
        for robot in robots
    }
    result = {'ok': not dead, 'real_time': not crowded, 'robots': results} | loads
    message = f'error: {len(dead)} of {len(robots)} robots ended early: {", ".join(dead)}' if dead else ''
    document = with_provenance(result, options)
    text = [*result_lines(robots, bags), *load_lines(loads)]
    return Output(document, text, int(bool(dead)), message=message)


def load_lines(loads: dict[str, Any]) -> list[str]:
    """Return the load of a common DC link as lines of text."""
    if 'common_supply' in loads:
        from delta3_pacdrive.studies.runs.run_supply import CommonSupply

        return CommonSupply.of(loads['common_supply']).lines()
    return [f'load of a common DC link unknown: {why}' for why in loads.values()]


def result_lines(robots: Sequence[Any], bags: Path | None) -> list[str]:
    """Return the result of each robot, with notes on missing messages in its bag."""
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
        return 'ended during start-up'
    result = robot.result
    late = result.get('lateness_ms', {}).get('p99', math.nan)
    more = '' if math.isnan(late) else f', 99 % of cycles started within {late:.2f} ms'
    return (
        f'bus time {result["bus_time_s"]:.3f} s in {result["cycles"]} cycles, {result["overruns"]} overruns, '
        f'{result["lost_telegrams"]} lost AT{more}'
    )
