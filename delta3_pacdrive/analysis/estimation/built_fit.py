"""Least squares on a built robot in its closed loop: where to begin, and what its noise does."""

from collections.abc import Callable, Sequence

import numpy as np

from delta3_pacdrive.analysis.estimation.problem import Model, Problem
from delta3_pacdrive.analysis.estimation.replay_model import ReplayModel
from delta3_pacdrive.analysis.estimation.solver import Fit, Iterate, OnIterate, fit
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

Build = Callable[[Parameters], Sequence[Model]]
"""Makes the models of a robot for the recordings."""

NEAR = 3.0  # times the noise: residuals of a start that needs no other one


def fit_built(
    problem: Problem,
    start: Floats,
    build: Build,
    on_iterate: OnIterate | None = None,
    resume: Iterate | None = None,
) -> Fit:
    """Estimate as ``solver.fit`` does; elastic gears and noisy sensors of a replayed robot get what they need.

    Elastic gears leave the loops a decibel of margin: from a torque constant that is a third too large the model is
    unstable, and says nothing of anything else. There a model with rigid gears comes first. Noise of the sensors is
    measured at the solution, which then takes it into account.
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
    """Return values that a model with rigid gears finds from ``start``; None where the start will do."""
    robot = problem.parameters
    replayed = any(isinstance(model, ReplayModel) for model in problem.models)
    if not robot.rich.effects.gear or not replayed or _is_near(problem, start):
        return None
    rigid = robot.replace(rich__gear=False)
    places = [j for j, quantity in enumerate(problem.quantities) if quantity.is_on(rigid)]
    stiff = Problem([problem.quantities[j] for j in places], build(rigid), rigid)
    begin = start.copy()

    def tell(iterate: Iterate) -> None:
        if on_iterate is not None:
            whole = begin.copy()
            whole[places] = iterate.x
            on_iterate(Iterate(iterate.number, whole, iterate.cost))

    begin[places] = fit(stiff, start[places], tell).x
    return begin


def _is_near(problem: Problem, start: Floats) -> bool:
    pairs = zip(problem.residuals(start), problem.blocks, strict=True)
    return all(float(np.sqrt(np.mean(array**2))) < NEAR * block.sigma for array, block in pairs)
