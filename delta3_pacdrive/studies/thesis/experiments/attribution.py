"""Attribution of the difference between robot and model to the effects that the model lacks.

Every combination of the robot's effects is simulated on the same program. The attributed number v of a run is the mean
square of a signal's deviation from the model, or a statistic such as the largest TCP error. For each effect:

- alone:     v with this effect only, less v without any;
- left out:  v with all effects, less v with all but this one;
- share:     its Shapley value, the mean increase of v over all orders in which the effects can be switched on.

The Shapley values sum to v(all) - v(none); the remainder of robot - model is due to other parameters, such as the
exchange period. If effects superpose, the Shapley value of a mean square is mean(d_i d): the part of the deviation d
that is correlated with the effect's own d_i. It is negative for an effect that compensates others.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flatten
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.studies.framework.study import OnProgress
from delta3_pacdrive.studies.thesis.experiments.compared_signals import QUANTITIES, Run
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison


@dataclass(frozen=True)
class Effect:
    """Physical effect that the thesis does not model."""

    text: str
    switch: str  # in the group rich; without magnitudes it is the whole effect
    magnitudes: tuple[str, ...] = ()  # of this effect, if several share a switch


EFFECTS = {
    'forearm_rods': Effect('forearms as rods', 'forearm_rods'),
    'gear': Effect('elastic gears with backlash', 'gear'),
    'friction': Effect('stiction and Stribeck', 'friction'),
    'cogging': Effect('cogging', 'ripple', ('cogging_torque_n_m',)),
    'torque_ripple': Effect('ripple of K_m', 'ripple', ('torque_ripple',)),
    'current_sensors': Effect(
        'current sensors', 'sensors', ('current_gain_error', 'current_offset_a', 'current_noise_a')
    ),
    'encoders': Effect('encoders', 'sensors', ('encoder_noise_rad', 'encoder_error_rad')),
    'geometry': Effect('geometric errors', 'geometry'),
    'parallelogram': Effect('rods and tilt of the plate', 'parallelogram'),
    'frame': Effect('machine frame', 'frame'),
    'elastic_rods': Effect('elastic rods', 'elastic_rods'),
}

# attributed numbers in addition to the deviation of each signal: (signal, statistic)
EXPLAINED = tuple(
    (name, statistic)
    for name in ('current', 'tcp_error_norm', 'tcp_error_norm_true')
    for statistic in ('max', 'rms')
)


@dataclass(frozen=True)
class Outcome:
    """Number of a run [SI] and its attribution to effects."""

    signal: str  # one of QUANTITIES
    # 'deviation': mean square of the deviation from the model; 'max', 'rms': of the signal itself
    statistic: str
    model: float  # number of the model; 0 for a deviation
    robot: float
    other: float  # contribution of parameters other than the effects
    alone: dict[str, float]  # by effect, as are left_out and share
    left_out: dict[str, float]
    share: dict[str, float]

    @property
    def total(self) -> float:
        """Difference to be explained."""
        return self.robot - self.model

    @property
    def unit(self) -> str:
        """Unit of the numbers."""
        unit = QUANTITIES[self.signal].unit
        return f'({unit})^2' if self.statistic == 'deviation' else unit

    def percent(self, value: float) -> float | None:
        """Share of a deviation; None for statistics, whose changes may cancel."""
        if self.statistic != 'deviation' or self.total <= 0.0:
            return None
        return 100.0 * value / self.total


@dataclass(frozen=True)
class Attribution:
    """Attribution of the difference between a robot and its model."""

    effects: tuple[str, ...]  # effects of the robot in the order of EFFECTS
    other_parameters: tuple[str, ...]  # parameters other than the effects that differ
    simulations: int  # number of runs
    outcomes: dict[tuple[str, str], Outcome]  # by signal and statistic


def effects_of(robot: Parameters) -> tuple[str, ...]:
    """Return the effects of a robot that are switched on and have a magnitude."""
    rich = robot.rich.effects
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if getattr(rich, effect.switch)
        and (not effect.magnitudes or any(np.any(getattr(rich, m)) for m in effect.magnitudes))
    )


def with_effects(robot: Parameters, chosen: Iterable[str]) -> Parameters:
    """Return the robot with those of its effects that are ``chosen``, otherwise unchanged."""
    kept = set(chosen).intersection(effects_of(robot))
    values: dict[str, object] = {
        f'rich__{effect.switch}': any(EFFECTS[name].switch == effect.switch for name in kept)
        for effect in EFFECTS.values()
    }
    for name, effect in EFFECTS.items():
        if name not in kept:
            for magnitude in effect.magnitudes:
                value = getattr(robot.rich, magnitude)
                values[f'rich__{magnitude}'] = [0.0] * 3 if isinstance(value, tuple) else 0.0
    return robot.replace(**values)


def shapley(values: Floats) -> Floats:
    """Return the Shapley values of n players; raises ValueError.

    Parameters
    ----------
    values
        Value of every coalition, shape (2^n, ...): player i is in coalition m if bit i of m is set.

    Returns
    -------
    array
        Shape (n, ...); the sum is ``values[-1] - values[0]``.

    """
    players = len(values).bit_length() - 1
    if len(values) != 1 << players:
        raise ValueError(f'the number of coalitions is {len(values)}, but must be a power of two')
    masks = np.arange(len(values))
    sizes = np.array([int(mask).bit_count() for mask in masks])
    found = np.zeros((players, *values.shape[1:]))
    for i in range(players):
        without = masks[(masks >> i) & 1 == 0]
        weights = np.array([1.0 / (players * math.comb(players - 1, size)) for size in sizes[without]])
        found[i] = np.tensordot(weights, values[without | (1 << i)] - values[without], 1)
    return found


def attribute(
    program: Program, model: Run, model_parameters: Parameters, robot: Parameters, on_progress: OnProgress
) -> Attribution:
    """Simulate every combination of the robot's effects and attribute its difference from the model.

    Raises
    ------
    RunError
        The robot cannot run the program with some of its effects; the message names them.

    """
    effects = effects_of(robot)
    count = 1 << len(effects)
    rows = []
    plans: dict[bytes, Planned] = {}

    def planned(program: Program, tcp_m: Floats, parameters: Parameters) -> Planned:
        """Plan once per start position; effects change the measured position, but nothing else in a plan."""
        place = tcp_m.tobytes()
        if place not in plans:
            plans[place] = program_planner.plan(program, tcp_m, parameters)
        return plans[place]

    for mask in range(count):
        on_progress(f'effects, {count} simulations', mask, count)
        chosen = [name for i, name in enumerate(effects) if mask >> i & 1]
        parameters = with_effects(robot, chosen)
        try:
            trace = simulation.run(program, parameters, planner=planned)
        except RunError as error:
            raise RunError(f'robot with {", ".join(chosen) or "no effect"}: {error}') from error
        rows.append(_numbers(Comparison.of(model, Run.of(trace, parameters))))
    on_progress(f'effects, {count} simulations', count, count)
    of_model = _numbers(Comparison.of(model, model))
    table = {key: np.array([row[key] for row in rows]) for key in of_model}
    outcomes = {key: outcome_of(key, effects, of_model[key], values) for key, values in table.items()}
    return Attribution(effects, _other_parameters(model_parameters, robot), count, outcomes)


def _numbers(comparison: Comparison) -> dict[tuple[str, str], float]:
    """Return the attributed numbers of one run."""
    numbers = {(name, 'deviation'): comparison.mean_square_deviation(name) for name in comparison.names}
    for name, statistic in EXPLAINED:
        largest, square = map(comparison.measured, comparison.extent(comparison.robot, name))
        found = np.abs(largest).max() if statistic == 'max' else math.sqrt((square**2).mean())
        numbers[name, statistic] = float(found)
    return numbers


def outcome_of(key: tuple[str, str], effects: Sequence[str], of_model: float, values: Floats) -> Outcome:
    """Return the attribution from the values of all subsets of effects; bit i of an index is effect i."""
    every = len(values) - 1
    return Outcome(
        signal=key[0],
        statistic=key[1],
        model=of_model,
        robot=float(values[every]),
        other=float(values[0] - of_model),
        alone={name: float(values[1 << i] - values[0]) for i, name in enumerate(effects)},
        left_out={name: float(values[every] - values[every ^ (1 << i)]) for i, name in enumerate(effects)},
        share=dict(zip(effects, shapley(values).tolist(), strict=True)),
    )


def _other_parameters(model: Parameters, robot: Parameters) -> tuple[str, ...]:
    bare, flat = flatten(with_effects(robot, ()), absent=True), flatten(model, absent=True)
    return tuple(name for name in flat if not name.startswith('rich.') and flat[name] != bare[name])
