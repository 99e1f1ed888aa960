"""``delta3 bench robots``: timing of several robots on one machine, and speed of ten robots without a clock.

Each robot has its nodes in one process, as with ``delta3 up --robots``, and repeats experiment 1.
"""

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from typing import Any

from delta3_pacdrive import interrupts
from delta3_pacdrive.benchmarks.case import program_file, times_text
from delta3_pacdrive.errors import RunError, RunInterruptedError

ROBOTS = 2  # in real time
ROBOTS_FAST = 10  # without a clock
CASES = ('one', 'several', 'fast')


def measure(seconds: float, robots: int | None, quiet: bool) -> dict[str, Any]:
    """Measure one robot, several in real time, and ten without a clock; a failed case contains the reason.

    Parameters
    ----------
    seconds
        Bus time of motion in real time [s].
    robots
        Number of robots in real time; None: two.
    quiet
        Whether progress is not printed.

    """
    counts = {'one': 1, 'several': robots or ROBOTS, 'fast': ROBOTS_FAST}
    results: dict[str, Any] = {}
    for case in CASES:
        if not quiet:
            print(f'measuring {_title(case, counts[case])} ...', file=sys.stderr, flush=True)
        try:
            results[case] = _measure(counts[case], seconds, 0.0 if case == 'fast' else 1.0)
        except RunInterruptedError:
            raise
        except RunError as error:  # another case may still succeed on a busy machine
            results[case] = {'robots': {}, 'crowded': '', 'error': str(error)}
    return results


def _measure(count: int, seconds: float, real_time_factor: float) -> dict[str, Any]:
    from delta3_pacdrive import simulation
    from delta3_pacdrive.bringup.environment import namespaces
    from delta3_pacdrive.bringup.options import Options
    from delta3_pacdrive.bringup.robots import Robots

    simulation.compile_kernels()
    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder:
        program = program_file(seconds, folder)
        options = [
            Options(
                program=program,
                namespace=namespace,
                real_time_factor=real_time_factor,
                single_process=True,
            )
            for namespace in namespaces(count, '/')
        ]
        robots = Robots(options, False, None, time.monotonic())
        robots.run(lambda _: None)
    if interrupts.asked():
        raise RunInterruptedError(interrupts.sentence(interrupts.asked()))
    dead = next((robot for robot in robots.now if robot.result is None), None)
    if dead is not None:
        raise RunError(f'{dead.namespace}: {dead.error}')
    return {
        'crowded': robots.crowded,
        'robots': {robot.namespace: _figures(robot.result or {}, robot.notes) for robot in robots.now},
    }


def _figures(result: dict[str, Any], notes: Sequence[str]) -> dict[str, Any]:
    kept = ('cycles', 'overruns', 'slip_s', 'lateness_ms', 'bus_time_s', 'wall_time_s', 'lost_telegrams')
    return {key: result[key] for key in kept if key in result} | {'notes': list(notes)}


def _title(case: str, count: int) -> str:
    robots = 'one robot' if count == 1 else f'{count} robots'
    return f'{robots}, {"as fast as possible" if case == "fast" else "real time"}'


def text(results: dict[str, Any]) -> Iterator[str]:
    """Yield a line per robot, and the totals."""
    for case, result in results.items():
        robots = result['robots']
        if 'error' in result:
            yield f'\n{case}: {result["error"]}'
            continue
        yield f'\n{_title(case, len(robots))}'
        if result['crowded']:
            yield f'  {result["crowded"]}'
        for namespace, one in robots.items():
            share = one['overruns'] / max(one['cycles'], 1)
            rate = one['bus_time_s'] / one['wall_time_s']
            facts = (
                f'{rate:.2f} x real time'
                if case == 'fast'
                else f'{one["overruns"]} overruns ({share:.3%}), cycle start late '
                f'{times_text(one["lateness_ms"])}'
            )
            yield f'  {namespace:<10} {one["cycles"]} cycles, {facts}, {one["lost_telegrams"]} lost AT'
            for note in one['notes']:
                yield f'  {"":<10} {note}'
        if case == 'fast':
            rates = [one['bus_time_s'] / one['wall_time_s'] for one in robots.values()]
            yield f'  together   {sum(rates):.1f} x real time'
    yield '\ntimes as p50 / p99 / p99.9 / max'
