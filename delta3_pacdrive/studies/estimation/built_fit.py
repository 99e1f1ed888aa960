"""Least squares for a built robot in closed loop: start values and sensor noise."""

from collections.abc import Callable, Sequence

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.estimation.problem import Model, Problem
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from delta3_pacdrive.studies.estimation.solver import Fit, Iterate, OnIterate, fit

Build = Callable[[Parameters], Sequence[Model]]
"""Builds the models of a robot for the recordings."""

NEAR = 3.0  # times the noise: residuals below which the start is good enough


def fit_built(
    problem: Problem,
    start: Floats,
    build: Build,
    on_iterate: OnIterate | None = None,
    resume: Iterate | None = None,
) -> Fit:
    """Estimate like ``solver.fit``, with special start values for elastic gears and with the effect of sensor noise.

    Elastic gears leave the loops a margin of a decibel. With a torque constant that is a third too large the model is
    unstable and carries no information. Then a model with rigid gears is fitted first. The effect of sensor noise is
    measured at the solution and taken into account in a second fit.
    """
    if resume is None and (begin := _rigid_start(problem, start, build, on_iterate)) is not None:
        resume = Iterate(0, begin, 0.0)
    found = fit(problem, start, on_iterate, resume)
    values = problem.values(found.x)
    noisy = [model.settle(values) for model in problem.models if isinstance(model, ReplayModel)]
    if any(noisy):
        found = fit(problem, start, on_iterate, Iterate(found.iterations, found.x, found.cost))
    return found


def _rigid_start(
    problem: Problem, start: Floats, build: Build, on_iterate: OnIterate | None
) -> Floats | None:
    """Return start values fitted by a model with rigid gears; None if ``start`` is good enough."""
    robot = problem.parameters
    replayed = any(isinstance(model, ReplayModel) for model in problem.models)
    if not robot.rich.effects.gear or not replayed or _is_near(problem, start):
        return None
    rigid = robot.replace(rich__gear=False)
    places = [j for j, quantity in enumerate(problem.quantities) if quantity.is_on(rigid)]
    stiff = Problem([problem.quantities[j] for j in places], build(rigid), rigid)
    begin = start.copy()

    def report(iterate: Iterate) -> None:
        if on_iterate is not None:
            whole = begin.copy()
            whole[places] = iterate.x
            on_iterate(Iterate(iterate.number, whole, iterate.cost))

    begin[places] = fit(stiff, start[places], report).x
    return begin


def _is_near(problem: Problem, start: Floats) -> bool:
    pairs = zip(problem.residuals(start), problem.blocks, strict=True)
    return all(float(np.sqrt(np.mean(array**2))) < NEAR * block.sigma for array, block in pairs)
