"""Fits of built robots, and search for missing effects in a model that does not explain its data.

Effects can compensate one another, so none is judged alone. All effects of the group are switched on and estimated
together with the free quantities. Effects without which the residuals do not grow are removed, and the others are
fitted once more.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.estimation.model_check import ModelCheck, check
from delta3_pacdrive.studies.estimation.problem import Model, Problem
from delta3_pacdrive.studies.estimation.quantities import (
    TABLE,
    Group,
    Quantity,
    values_of,
    with_effects_of,
    with_values,
)
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from delta3_pacdrive.studies.estimation.solver import Fit, Iterate, OnIterate, fit
from delta3_pacdrive.studies.framework.study import OnProgress

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


RODS = 'forearm_rods'  # a switch without a quantity
NEEDED = 0.01  # smallest relative growth of the sum of squares without a necessary effect
TEXTS = {
    'friction': 'stiction and Stribeck effect',
    'gear': 'elastic gears with backlash',
    'ripple': 'cogging and ripple of K_m',
    'sensors': 'gains and offsets of the current sensors',
    'geometry': 'separate lengths and angles of each arm',
    RODS: 'forearms as rods',
}


@dataclass(frozen=True)
class MissingEffect:
    """Missing effect, and the rms of the residuals without it [sensor noise]."""

    effect: str
    rms_without: float

    @property
    def text(self) -> str:
        """Description of the effect."""
        return TEXTS[self.effect]


@dataclass(frozen=True)
class BetterModel:
    """Model with the missing effects."""

    robot: Parameters  # parameters with the estimated values
    problem: Problem
    fit: Fit
    check: ModelCheck
    lacking: tuple[MissingEffect, ...]  # missing effects, the most important first
    rms_plain: float  # rms of the residuals without the effects [sensor noise]
    rms: float  # the same with the effects

    @property
    def sentence(self) -> str:
        """The missing effects, as a sentence."""
        named = '; '.join(f'{one.text} ({one.rms_without:.2g} without)' for one in self.lacking)
        holds = 'explain the data' if self.check.holds else 'still do not explain the data'
        return (
            f'missing: {named or "nothing that could be fitted"}; '
            f'residuals of {self.rms_plain:.2g} times the sensor noise become {self.rms:.2g} and {holds}'
        )


def search(
    group: Group,
    build: Build,
    robot: Parameters,
    first: tuple[tuple[Quantity, ...], Floats],
    known: Sequence[str],
    on_progress: OnProgress,
) -> BetterModel | None:
    """Fit the effects that may be missing; None if there are none, or if they explain no more.

    ``first`` are the free quantities and their estimates without the effects.
    """
    held = set(group.named(known))
    more = tuple(
        q for s in group.built if s not in held and not (q := TABLE[s]).is_on(robot) and q not in first[0]
    )
    if not more:
        return None
    effects = tuple(dict.fromkeys(q.effect for q in more))
    built = with_effects_of(robot, more)
    if 'geometry' not in effects and not robot.rich.effects.forearm_rods:
        built, effects = built.replace(rich__forearm_rods=True), (*effects, RODS)
    # start from the values of the first model
    start = {q.symbol: float(v) for q, v in zip(first[0], first[1], strict=True)}
    for number in range(2):
        on_progress('the model does not explain the data; searching for missing effects', number, 2)
        free = (*first[0], *(q for q in more if q.is_on(built)))
        problem = Problem(free, build(built), with_values(built, {}))
        begin = np.array([start.get(q.symbol, q.read(built)) for q in free])
        found = fit_built(problem, begin, build)
        without = {effect: _cost(found, problem, build, built, effect) for effect in effects}
        cost = _sum(found.residuals, problem)
        needless = [effect for effect, other in without.items() if other <= (1.0 + NEEDED) * cost]
        if not needless or number == 1:
            break
        start |= {q.symbol: float(v) for q, v in zip(free, found.x, strict=True)}
        effects = tuple(effect for effect in effects if effect not in needless)
        built = built.replace(**{f'rich__{effect}': False for effect in needless})
        if not effects:
            return None
    count = sum(array.size for array in found.residuals)
    plain = _sum([array for model in build(robot) for array in model.residuals(
        values_of(robot) | {q.symbol: float(v) for q, v in zip(first[0], first[1], strict=True)})], problem,
        build(robot))  # fmt: skip
    lacking = [MissingEffect(effect, float(np.sqrt(without[effect] / count))) for effect in effects]
    values = {q.symbol: float(v) for q, v in zip(problem.quantities, found.x, strict=True)}
    return BetterModel(
        robot=with_values(built, values),
        problem=problem,
        fit=found,
        check=check(problem, found),
        lacking=tuple(sorted(lacking, key=lambda one: -one.rms_without)),
        rms_plain=float(np.sqrt(plain)),
        rms=float(np.sqrt(cost / count)),
    )


def _sum(residuals: Sequence[Floats], problem: Problem, models: Sequence[Model] = ()) -> float:
    """Return the sum of squares [sensor noise], or their mean for ``models`` with other signals."""
    blocks = [block for model in models for block in model.blocks] or problem.blocks
    total = float(sum(((a / b.sigma) ** 2).sum() for a, b in zip(residuals, blocks, strict=True)))
    return total / sum(array.size for array in residuals) if models else total


def _cost(found: Fit, problem: Problem, build: Build, built: Parameters, effect: str) -> float:
    """Return the sum of squares without an effect, minimised over the other quantities to first order."""
    values = problem.values(found.x)
    bare: Mapping[str, float] = values | {
        q.symbol: 0.0 for q in TABLE.values() if q.is_error and q.effect == effect
    }
    models = build(built.replace(**{f'rich__{effect}': False}))
    blocks = problem.blocks
    own = [j for j in found.identifiability.estimated if problem.quantities[j].effect != effect]
    residuals = [array for model in models for array in model.residuals(bare)]
    slopes = problem.jacobian(found.x, own)
    r = np.concatenate([a.ravel() / b.sigma for a, b in zip(residuals, blocks, strict=True)])
    j = np.concatenate([a.reshape(-1, len(own)) / b.sigma for a, b in zip(slopes, blocks, strict=True)])
    step = np.linalg.lstsq(j, -r, rcond=None)[0]
    left = r + j @ step
    return float(left @ left)
