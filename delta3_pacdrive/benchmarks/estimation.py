"""Coverage of 95 % intervals of estimates: on the model with noisy sensors, and on built robots.

Nominal robots: one simulation with different noise per seed, and a whole estimation from values that are 30 % off.
Built robots: one simulation per seed with different sensor noise in the loops, and one Gauss-Newton step from the true
values with the derivatives there; the remaining residuals determine the interval as in an estimation.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.studies.estimation.identifiability import WEAK, Z_95, Verdict, analyse
from delta3_pacdrive.studies.estimation.measurement import simulate, with_noise
from delta3_pacdrive.studies.estimation.models import TorqueModel, WindingModel
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import GROUPS, start_values, values_of
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from delta3_pacdrive.studies.estimation.solver import fit, half_widths, whiteness_of
from delta3_pacdrive.studies.framework.study import OnProgress, silent

SEEDS = 200
FIRST_SEED = 1000
OFF = 0.3
PROGRAM = 'excitation'
CONFOUNDED = ('gain_1', 'gain_2', 'gain_3')  # with K_m, in signals of the bus


def measure(seeds: int = SEEDS, on_progress: OnProgress = silent) -> dict[str, Any]:
    """Return the coverage of the intervals of the group motor, by robot."""
    return {
        'program': PROGRAM,
        'seeds': seeds,
        'nominal': nominal(seeds, on_progress),
        'built': built(seeds, on_progress),
    }


def nominal(seeds: int, on_progress: OnProgress = silent) -> dict[str, Any]:
    """Return the coverage on nominal robots, measured by oscilloscopes in the drives."""
    robot = core.load()
    exact = simulate(programs.load(PROGRAM, robot.motion), robot)
    quantities = GROUPS['motor'].chosen()
    true = values_of(robot)
    off: dict[str, list[float]] = {q.symbol: [] for q in quantities}
    widths: dict[str, list[float]] = {q.symbol: [] for q in quantities}
    for seed in range(seeds):
        on_progress('nominal robots', seed, seeds)
        trace = with_noise(exact, robot, 1.0, FIRST_SEED + seed)
        problem = Problem(quantities, [WindingModel(trace, robot), TorqueModel(trace, robot)], robot)
        found = fit(problem, start_values(quantities, robot, OFF))
        for quantity, e in zip(quantities, found.estimates, strict=False):
            if e.verdict is Verdict.IDENTIFIABLE:
                off[e.symbol].append((e.value - true[e.symbol]) / e.half_width)
                widths[e.symbol].append(e.half_width / quantity.extent(true[e.symbol]))
    return _result({s: (np.array(off[s]), float(np.mean(widths[s]))) for s in off if off[s]})


def built(seeds: int, on_progress: OnProgress = silent) -> dict[str, Any]:
    """Return the coverage on built robots, by replay of signals sampled once per bus cycle."""
    robot = core.load('rich')
    program = programs.load(PROGRAM, robot.motion)
    first = _built_trace(program, robot, FIRST_SEED)
    model = ReplayModel(first, robot)
    quantities = GROUPS['motor'].chosen(known=CONFOUNDED, robot=robot)
    problem = Problem(quantities, [model], robot)
    x = start_values(quantities, robot, 0.0)
    values = problem.values(x)
    model.settle(values)
    (slopes,) = problem.jacobian(x)
    (residual,) = model.residuals(values)
    report = analyse(problem, x)
    shown = [j for j, f in enumerate(report.findings) if f.verdict is Verdict.IDENTIFIABLE]
    inverse = np.linalg.pinv(slopes.reshape(-1, len(x)))
    columns = list(range(len(x)))
    off, widths = [], []
    for seed in range(seeds):
        on_progress('built robots', seed, seeds)
        trace = _built_trace(program, robot, FIRST_SEED + seed)
        own = residual + model.seen(trace['current'][model.rows] - first['current'][model.rows])
        step = -(inverse @ own.ravel())
        left = own + slopes @ step
        half = half_widths(problem, x, columns, [left], [whiteness_of(left)])
        off.append(step / half)
        widths.append(half)
    found: Floats = np.array(off)
    mean: Floats = np.mean(widths, axis=0)
    return _result({quantities[j].symbol: (found[:, j], float(mean[j])) for j in shown})


def _built_trace(program: Any, robot: Parameters, seed: int) -> Any:
    return simulation.run(program, robot.replace(rich__sensor_seed=seed))


def _result(found: dict[str, tuple[Floats, float]]) -> dict[str, Any]:
    rates = {symbol: float(np.mean(np.abs(own) <= 1.0)) for symbol, (own, _) in found.items()}
    every: Sequence[Floats] = [own for own, _ in found.values()]
    return {
        'coverage': rates,
        'half_width_relative': {symbol: width for symbol, (_, width) in found.items()},
        'mean_error_in_deviations': {symbol: float(own.mean() * Z_95) for symbol, (own, _) in found.items()},
        'pooled': float(np.mean(np.abs(np.concatenate(every)) <= 1.0)),
        'identifiable_below': WEAK,
    }


def text(result: dict[str, Any]) -> Iterator[str]:
    """Yield the coverage, one line per quantity."""
    yield f'{result["program"]}, {result["seeds"]} seeds: how often 95 % intervals contain the true value'
    for kind in ('nominal', 'built'):
        own = result[kind]
        yield f'{kind} robots: {100.0 * own["pooled"]:.1f} % over all quantities'
        for symbol, rate in own['coverage'].items():
            width = 100.0 * own['half_width_relative'][symbol]
            yield f'{symbol:>12}  {100.0 * rate:5.1f} %   half width {width:.2g} %'
