"""``delta3 bench sweep``: runs per second with one and two workers, planning and memory, compared with plain loops."""

import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from delta3_pacdrive import simulation
from delta3_pacdrive.parameters import from_flat
from delta3_pacdrive.robot.sercos.words import CONTROL_ON
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.studies.fleet.sweep import engine, specification
from delta3_pacdrive.studies.fleet.sweep.run import require_engine
from delta3_pacdrive.studies.fleet.sweep.sampling import values_of
from delta3_pacdrive.studies.fleet.sweep.single_run import Row, Runner
from delta3_pacdrive.studies.fleet.sweep.study import Sweep
from delta3_pacdrive.studies.framework.study import OnProgress, silent

RUNS = 300  # default, for each number of workers
LOOPED = 60  # runs of a loop in one process
WARMED = 10  # warm-up runs of each worker
WORKERS = (1, 2)
AIM_S, AIM_RUNS = 120.0, 10_000
EFFICIENCY_AIM = 0.9
SPEC = """\
program: experiment1
runs: {runs}
vary:
"""
EVERY_PLAN, NO_PLAN = 'every run is planned', 'only drives vary'
VARIED = {
    EVERY_PLAN: """\
  motor.torque_constant_n_m_a: {normal: [0.78, 0.008]}
  dynamics.payload_mass_kg: {uniform: [0.3, 0.7]}
""",
    NO_PLAN: """\
  drive.velocity_gain_a_s_rad: {uniform: [0.2, 0.25]}
  drive.position_gain_rad_s_rad: {uniform: [55.0, 65.0]}
""",
}


def measure(runs: int = RUNS, show: OnProgress = silent) -> dict[str, Any]:
    """Return the figures; ``runs`` applies to each number of workers. Raises SweepError."""
    require_engine()
    sweeps = {name: _sweep(varied, runs) for name, varied in VARIED.items()}
    simulation.load_kernels(from_flat(dict(sweeps[EVERY_PLAN].parameters)))
    result: dict[str, Any] = {'program': 'experiment1', 'runs': runs, 'cores': len(os.sched_getaffinity(0))}
    result['loops'] = {name: _looped(sweep, name, show) for name, sweep in sweeps.items()}
    result['plain'] = _plain(sweeps[EVERY_PLAN])
    result['workers'] = {str(count): _swept(sweeps[EVERY_PLAN], count, show) for count in WORKERS}
    one, two = (result['workers'][str(count)] for count in WORKERS)
    result['efficiency'] = two['runs_per_s'] / (2.0 * one['runs_per_s'])
    result['cpu_efficiency'] = one['cpu_ms_a_run'] / two['cpu_ms_a_run']
    return result


def _sweep(varied: str, runs: int) -> Sweep:
    with tempfile.TemporaryDirectory(prefix='delta3_bench_') as folder:
        path = Path(folder, 'bench.yaml')
        path.write_text(SPEC.format(runs=runs) + varied, encoding='utf-8')
        return specification.load(path)


def _looped(sweep: Sweep, name: str, show: OnProgress) -> dict[str, float]:
    """Measure the runs of a sweep in this process: processor time per run [ms], and share of planning."""
    values, runner = values_of(sweep), Runner(sweep)
    numbers = [1 + n % sweep.runs for n in range(LOOPED)]
    for number in numbers[:2]:
        runner.run(number, engine.values_in(values, number))
    fresh = Runner(sweep)
    fresh.run(1, engine.values_in(values, 1))
    planned, started = fresh.planning_s, time.process_time()
    for done, number in enumerate(numbers[1:]):
        show(name, done, len(numbers))
        fresh.run(number, engine.values_in(values, number))
    spent = time.process_time() - started
    return {
        'cpu_ms_a_run': 1e3 * spent / (len(numbers) - 1),
        'planning_share': (fresh.planning_s - planned) / spent,
    }


def _plain(sweep: Sweep) -> dict[str, float]:
    """Measure a loop of ``simulate`` without a sweep, and drives and plant alone in one compiled call."""
    values, runner = values_of(sweep), Runner(sweep)
    made = [runner.made(engine.values_in(values, 1 + n % sweep.runs)) for n in range(LOOPED)]
    simulation.run(made[0][1], made[0][0])
    started = time.process_time()
    for parameters, program in made:
        trace = simulation.run(program, parameters)
    each_s = (time.process_time() - started) / len(made)
    robots = [Robot(simulation.placed(parameters, program)) for parameters, program in made]
    commands = np.tile(robots[0].encoder_positions(), (len(trace.time_s), 1))
    robots[0].run(commands, CONTROL_ON)
    started = time.process_time()
    for robot in robots[1:]:
        robot.run(commands, CONTROL_ON)
    bound_s = (time.process_time() - started) / (len(robots) - 1)
    return {'cpu_ms_a_run': 1e3 * each_s, 'compiled_ms_a_run': 1e3 * bound_s}


def _swept(sweep: Sweep, workers: int, show: OnProgress) -> dict[str, Any]:
    """Measure a sweep on workers of this machine."""
    values, done = values_of(sweep), 0
    every = range(1, sweep.runs + 1)

    def keep(rows: list[Row]) -> None:
        nonlocal done
        done += len(rows)
        show(f'{workers} workers', done, sweep.runs)

    with engine.cluster(workers, '') as client:
        first = [(number, engine.values_in(values, number)) for number in islice(every, WARMED)]
        client.run(engine.made, sweep, first)
        begin, started = client.run(usage), time.perf_counter()
        engine.make(client, sweep, engine.work_of(sweep, values, every), keep)
        wall_s, end = time.perf_counter() - started, client.run(usage)
    spent_s = sum(end[worker]['cpu_s'] - begin[worker]['cpu_s'] for worker in end)
    return {
        'runs_per_s': sweep.runs / wall_s,
        'seconds': wall_s,
        'cpu_ms_a_run': 1e3 * spent_s / sweep.runs,
        'memory_mb': [[used['memory_mb'] for used in one.values()] for one in (begin, end)],
    }


def usage() -> dict[str, float]:
    """Return memory [MB] and processor time [s] of this process."""
    return {'memory_mb': psutil.Process().memory_info().rss / 1e6, 'cpu_s': time.process_time()}


def text(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield the results as lines of text."""
    rows = []
    for name, loop in result['loops'].items():
        share = loop['planning_share']
        rows.append(
            (name, f'{loop["cpu_ms_a_run"]:.1f} ms of processor a run, {100.0 * share:.0f} % of it planning')
        )
    plain = result['plain']
    rows += [
        ('simulate', f'{_per_core(plain["cpu_ms_a_run"])} in a plain loop'),
        ('compiled', f'{_per_core(plain["compiled_ms_a_run"])} if drives and plant were all of a run'),
    ]
    for count, swept in result['workers'].items():
        begin, end = (', '.join(f'{one:.0f}' for one in memory) for memory in swept['memory_mb'])
        whole_s = AIM_RUNS / swept['runs_per_s']
        rows.append(
            (
                f'{count} workers',
                f'{swept["runs_per_s"]:.1f} runs/s ({AIM_RUNS} in {whole_s:.0f} s), {swept["cpu_ms_a_run"]:.1f} ms of '
                f'processor a run, memory {begin} MB, at the end {end} MB',
            )
        )
    rows.append(
        (
            'efficiency',
            f'{result["efficiency"]:.2f} from 1 to 2 workers, {result["cpu_efficiency"]:.2f} by processor time '
            f'({result["cores"]} cores); aims: {EFFICIENCY_AIM:g}, {AIM_RUNS} runs in {AIM_S:g} s, a third planning',
        )
    )
    for name, text in rows:
        yield f'{name:>20}  {text}'


def _per_core(cpu_ms: float) -> str:
    return f'{1e3 / cpu_ms:.1f} runs/s on a core'
