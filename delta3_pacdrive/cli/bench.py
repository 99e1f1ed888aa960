"""``delta3 bench``: figures of the robot, each beside what it is measured against. Never a test."""

import argparse
import json
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.bench_motion import bench_motion
from delta3_pacdrive.cli.output import guarded, parser_for, print_json

CASES = ('machine', 'bare', 'separate', 'single', 'fast')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = parser_for(
        'bench',
        'Measure the graph (timing, processor time, memory), planning, or the speed of simulation and kinematics.',
    )
    parser.add_argument('what', choices=['graph', 'motion', 'simulate', 'kinematics'])
    parser.add_argument('--seconds', type=float, default=60.0, help='bus time of motion per case')
    parser.add_argument(
        '--case', choices=CASES, action='append', help='only this case of graph (may be repeated)'
    )
    parser.add_argument('--no-graph', action='store_true', help='motion: only what needs no running robot')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    options = parser.parse_args(arguments)
    if not 1.0 <= options.seconds <= 3600.0:
        parser.error(f'--seconds is {options.seconds}, but must be between 1 and 3600')
    if options.what in ('simulate', 'kinematics'):
        from delta3_pacdrive.cli import bench_simulation

        action = getattr(bench_simulation, f'bench_{options.what}')
    else:
        action = {'graph': _graph, 'motion': bench_motion}[options.what]
    return guarded(lambda: action(options), options.json)


class _Meter:
    """Processor time and memory of processes between two looks."""

    def __init__(self, pids: dict[str, int]) -> None:
        import psutil

        self._processes = {name: psutil.Process(pid) for name, pid in pids.items()}
        self._start_s = time.monotonic()
        self._start = self._cpu()
        self.cores: dict[str, float] = {}
        self.spent_s = 0.0
        self.memory_mib: dict[str, float] = {}

    def _cpu(self) -> dict[str, float]:
        times = {name: process.cpu_times() for name, process in self._processes.items()}
        return {name: item.user + item.system for name, item in times.items()}

    def look(self) -> None:
        """Take the figures up to now."""
        duration = time.monotonic() - self._start_s
        spent = {name: cpu - self._start[name] for name, cpu in self._cpu().items()}
        self.cores = {name: cpu / duration for name, cpu in spent.items()}
        self.spent_s = sum(spent.values())
        self.memory_mib = {name: p.memory_full_info().pss / 2**20 for name, p in self._processes.items()}

    def figures(self, cycles: int) -> dict[str, Any]:
        """Return the figures of the last look; ``cycles`` passed since the first."""
        spent = 1e6 * self.spent_s / max(cycles, 1)
        return {'cores': self.cores, 'us_per_cycle': spent, 'memory_mib': self.memory_mib}


def program_file(seconds: float, folder: str) -> Path:
    """Write experiment 1, repeated for about this long."""
    import yaml

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import yaml_file
    from delta3_pacdrive.errors import ProgramError
    from delta3_pacdrive.motion import planning
    from delta3_pacdrive.motion import program as programs

    robot = core.load()
    source = programs.find('experiment1')
    once = programs.load(source, robot.motion)
    planned = planning.plan(once, once.start_m or robot.motion.home_m, robot)
    document = yaml_file.read(source, 'program file', ProgramError)
    document['repeat'] = max(1, round(seconds / planned.plan.duration_s))
    path = Path(folder) / 'benchmark.yaml'
    path.write_text(yaml.safe_dump(document), encoding='utf-8')
    return path


def _graph(options: argparse.Namespace) -> int:
    results = {}
    # each case is a process of its own: one process can start ROS and fork its children only once
    for case in options.case or CASES:
        if not options.json:
            print(f'measuring {case}: {options.seconds:g} s of motion ...', file=sys.stderr, flush=True)
        results[case] = in_child(partial(_measure, case, options.seconds))
    if options.json:
        print_json(results, options)
    else:
        _print_graph(results)
    return 0


def in_child(action: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Run an action in a forked process and return its result: ROS can be started once in a process."""
    read_end, write_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            os.close(read_end)
            with os.fdopen(write_end, 'w') as pipe:
                status = guarded(lambda: pipe.write(json.dumps(action())) * 0)
        except BaseException:  # noqa: BLE001 (a forked child must never return into its parent's code)
            traceback.print_exc()
        finally:
            os._exit(status)
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        text = pipe.read()
    if os.waitpid(pid, 0)[1] != 0:
        from delta3_pacdrive.errors import RunError

        raise RunError('the case did not come to its end')
    return dict(json.loads(text))


def _measure(case: str, seconds: float) -> dict[str, Any]:
    if case == 'machine':
        return _measure_machine(seconds)
    return _measure_bare(seconds) if case == 'bare' else _measure_robot(case, seconds)


def _measure_machine(seconds: float) -> dict[str, Any]:
    """Lateness of a loop that does nothing but sleep to the next millisecond, in real time where permitted."""
    from delta3_pacdrive.bus.pacing import Histogram
    from delta3_pacdrive.nodes.scheduling import Schedule, prefer

    prefer(Schedule.REAL_TIME)
    lateness = Histogram()
    start = time.monotonic()
    for cycle in range(round(seconds * 1e3)):
        due = start + cycle * 1e-3
        time.sleep(max(0.0, due - time.monotonic()))
        lateness.add(time.monotonic() - due)
    return {'lateness_ms': lateness.summary_ms()}


def _measure_robot(case: str, seconds: float) -> dict[str, Any]:
    from delta3_pacdrive.nodes.bringup import Bringup, Options

    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder:
        bringup = Bringup(
            Options(
                program=program_file(seconds, folder),
                real_time_factor=0.0 if case == 'fast' else 1.0,
                single_process=case in ('single', 'fast'),
            )
        )
        meters: list[_Meter] = []
        first_cycle = 0

        def show(progress: dict[str, Any]) -> None:
            nonlocal first_cycle
            if not meters:
                first_cycle = progress['cycles']
                meters.append(_Meter({child.name: child.pid for child in bringup.processes()}))
            if progress['finished']:
                meters[0].look()

        result = bringup.run(show)
    return result | meters[0].figures(result['cycles'] - first_cycle)


def _measure_bare(seconds: float) -> dict[str, Any]:
    from delta3_pacdrive.bus.phases import DRIVES
    from delta3_pacdrive.nodes import bare, discovery, runtime
    from delta3_pacdrive.nodes.child import end_all, spawn
    from delta3_pacdrive.nodes.scheduling import Schedule

    discovery.keep_to_this_machine()
    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder:
        report = Path(folder) / 'report.json'

        def done(figures: dict[str, Any]) -> None:
            report.with_suffix('.part').write_text(json.dumps(figures))
            report.with_suffix('.part').rename(report)

        factories: dict[str, Any] = {'plant': bare.BarePlant}
        factories |= {f'mc4_drive_{n + 1}': partial(bare.BareDrive, axis) for n, axis in enumerate(DRIVES)}
        factories['transformation_task'] = partial(bare.BareMaster, round(seconds / bare.PERIOD_S), done)
        children = [
            spawn(name, partial(runtime.run, [factory], []), Path(folder) / name, Schedule.REAL_TIME)
            for name, factory in factories.items()
        ]
        try:
            time.sleep(3.0)  # start-up is not what is measured
            meter = _Meter({child.name: child.pid for child in children})
            deadline = time.monotonic() + 3.0 * seconds + 30.0
            while not report.exists() and time.monotonic() < deadline:
                time.sleep(0.2)
            meter.look()
            figures = json.loads(report.read_text())
        finally:
            end_all(children)
    return dict(figures) | meter.figures(figures['cycles'])


def _percentiles(counts: list[int]) -> str:
    import numpy as np

    cumulative = np.cumsum(counts)
    shares = [int(np.searchsorted(cumulative, share * cumulative[-1])) for share in (0.5, 0.99, 0.999, 1.0)]
    return ' / '.join(str(value) for value in shares)


TITLES = {
    'machine': 'the machine: a loop that only sleeps',
    'bare': 'bare nodes, separate processes, real time',
    'separate': 'robot, separate processes, real time',
    'single': 'robot, one process, real time',
    'fast': 'robot, one process, as fast as possible',
}


def _each(values: dict[str, float], digits: int) -> str:
    return ', '.join(f'{name} {value:.{digits}f}' for name, value in values.items())


def times_text(values: dict[str, float]) -> str:
    """Write percentiles of times."""
    return ' / '.join(f'{value:.2f}' for value in values.values()) + ' ms (p50 / p99 / p99.9 / max)'


def _rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    if 'cycles' not in result:
        return [('wakes up late', times_text(result['lateness_ms']))]
    cycles, overruns = result['cycles'], result['overruns']
    rows = [
        (
            'cycles',
            f'{cycles}, {overruns} overruns ({overruns / cycles:.3%}), slip {result["slip_s"] * 1e3:.1f} ms',
        )
    ]
    if 'bus_time_s' in result:
        bus, wall = result['bus_time_s'], result['wall_time_s']
        rows.append(('time', f'bus {bus:.3f} s, wall {wall:.3f} s: {bus / wall:.3f} x'))
        rows.append(('telegrams', f'{result["lost_telegrams"]} lost, {result["refused_telegrams"]} refused'))
        rows.append(
            ('outstanding', f'{_percentiles(result["outstanding"])} cycles (p50 / p99 / p99.9 / max)')
        )
    for key, name in (('lateness_ms', 'cycle start late'), ('mdt_to_last_at_ms', 'MDT to last AT')):
        rows.append((name, times_text(result[key])))
    cores, memory = result['cores'], result['memory_mib']
    rows.append(('processor', f'{sum(cores.values()):.2f} cores: {_each(cores, 2)}'))
    rows.append(('', f'{result["us_per_cycle"]:.0f} us per cycle'))
    rows.append(('memory (PSS)', f'{sum(memory.values()):.0f} MiB: {_each(memory, 0)}'))
    return rows


def _print_graph(results: dict[str, dict[str, Any]]) -> None:
    for case, result in results.items():
        print(f'\n{TITLES[case]}')
        for name, text in _rows(result):
            print(f'  {name:>16}  {text}')
    if 'bare' in results and 'separate' in results:
        print('\nrobot / bare nodes')
        robot, bare = results['separate'], results['bare']
        pairs = [('processor us per cycle', robot['us_per_cycle'], bare['us_per_cycle'])]
        for share in ('p50', 'p99', 'p99.9'):
            times = (case['mdt_to_last_at_ms'][share] for case in (robot, bare))
            pairs.append((f'MDT to last AT {share}', *times))
        for name, ours, theirs in pairs:
            print(f'  {name:>22}  {ours:.2f} / {theirs:.2f} = {ours / theirs:.2f}')


if __name__ == '__main__':
    sys.exit(main())
