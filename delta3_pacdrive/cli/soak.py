"""``delta3 soak``: random programs with random faults, without a clock and in real time, and what must always hold."""

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from delta3_pacdrive.cli.output import announce_compilation, guarded, parser_for, print_json
from delta3_pacdrive.errors import RunError

PACES = {'fast': 0.0, 'real-time': 1.0}


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'soak', 'Run random programs with random faults; half of the time without a clock, half in real time.'
    )
    parser.add_argument('--minutes', type=float, default=10.0, metavar='N', help='how long, all in all')
    parser.add_argument('--seed', type=int, default=1, help='of programs and faults')
    parser.add_argument('--pace', choices=PACES, help='only without a clock, or only in real time')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    options = parser.parse_args(arguments)
    if not 0.0 < options.minutes <= 1e5:
        parser.error(f'--minutes is {options.minutes:g}, but must be between 0 and 100000')
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _run(options), options.json)


def _run(options: argparse.Namespace) -> int:
    from delta3_pacdrive import parameters as core

    if options.pace:
        rows = {options.pace: _soak(options, options.pace)}
    else:
        rows = {pace: _in_a_process(options, pace) for pace in PACES}
    ok = all(row['ok'] for row in rows.values())
    if options.json:
        result = {'ok': ok, 'seed': options.seed, 'minutes': options.minutes, **rows}
        print_json(result, options, core.load(), seed=options.seed)
    else:
        for pace, row in rows.items():
            _print(pace, row)
    if not ok and not options.json:
        raise RunError('the soak found something: see the violations')
    return int(not ok)


def _in_a_process(options: argparse.Namespace, pace: str) -> dict[str, Any]:
    """Run one pace in a process of its own: a bring-up forks, which a process that had ROS in it must not."""
    arguments = ['--pace', pace, '--minutes', str(options.minutes / len(PACES)), '--seed', str(options.seed)]
    command = [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.soak', *arguments, '--json']
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    result = json.loads(done.stdout.splitlines()[-1]) if done.stdout else {}
    if pace not in result:
        raise RunError(result.get('error', f'the soak {pace} ended with status {done.returncode}'))
    row: dict[str, Any] = result[pace]
    return row


def _soak(options: argparse.Namespace, pace: str) -> dict[str, Any]:
    from rich.console import Console
    from rich.progress import Progress, TextColumn, TimeElapsedColumn

    from delta3_pacdrive.nodes.soak import Figures, run_soak

    announce_compilation()
    console = Console(stderr=True)
    figures = Figures()
    # a display that refreshes by itself has a thread, which a process that forks must not have
    with Progress(
        TextColumn('{task.description}'), TimeElapsedColumn(), console=console, auto_refresh=False
    ) as bar:
        line = bar.add_task('starting', total=None)

        def show(now: Figures) -> None:
            text = f'{pace}: {now.programs} programs, {now.injected} faults, {now.cycles} cycles'
            bar.update(
                line, description=f'{text}, {len(now.violations)} violations', refresh=console.is_terminal
            )

        run_soak(60.0 * options.minutes, options.seed, PACES[pace], figures, show)
    return asdict(figures) | {'ok': figures.ok}


def _print(name: str, row: dict[str, Any]) -> None:
    print(f'{name}:')
    print(
        f'    {row["programs"]} programs in {row["cycles"]} cycles, {row["refused"]} refused by the planner'
    )
    print(
        f'    {row["injected"]} faults injected, {row["stopped"]} stopped the robot, {row["survived"]} survived'
    )
    print(f'    {row["lost_telegrams"]} AT lost, {row["lost_injected"]} of them at most by injected faults')
    rss = f'{row["rss_start_mb"]:.1f} MB at the start, {row["rss_end_mb"]:.1f} MB at the end'
    print(f'    memory of the processes that lived throughout: {rss}')
    kinds = ', '.join(f'{kind} {count}' for kind, count in sorted(row['kinds'].items()))
    print(f'    {kinds or "no faults"}')
    for sentence in row['violations']:
        print(f'    VIOLATED: {sentence}')


if __name__ == '__main__':
    sys.exit(main())
