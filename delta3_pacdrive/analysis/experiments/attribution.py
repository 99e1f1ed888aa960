"""Which of the effects that the model leaves out explains how much of its distance from the robot.

Every combination of the robot's effects is simulated on the same program. What is explained is a number v of a run:
the mean square of a signal's deviation from the model, or a statistic such as the largest TCP error. For each effect
there is

- alone:     v with this effect only, less v without any;
- left out:  v with all of them, less v with all but this one;
- share:     its Shapley value, the mean of what it adds over all orders in which the effects could be switched on.

The Shapley values add up exactly to v(all) - v(none); what is left of robot - model is due to other parameters, such
as the exchange period. Where effects superpose, the Shapley value of a mean square is mean(d_i d): what of the
deviation d goes along with the effect's own d_i. It can be negative: an effect that compensates others.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import simulation
from delta3_pacdrive.analysis.experiments.compared_signals import QUANTITIES, Run
from delta3_pacdrive.analysis.experiments.comparison import Comparison
from delta3_pacdrive.analysis.study import OnProgress
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, flatten


@dataclass(frozen=True)
class Effect:
    """An effect is something that the thesis leaves out.

    Attributes
    ----------
    text
        In words.
    switch
        In the group ``rich``; an effect without magnitudes is all of it.
    magnitudes
        Of this effect, where several share a switch.

    """

    text: str
    switch: str
    magnitudes: tuple[str, ...] = ()


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
}

# what is explained beside the deviation of each signal: (signal, statistic)
EXPLAINED = tuple(
    (name, statistic)
    for name in ('current', 'tcp_error_norm', 'tcp_error_norm_true')
    for statistic in ('max', 'rms')
)


@dataclass(frozen=True)
class Outcome:
    """An outcome is a number of a run [SI], and what each effect has to do with it.

    Attributes
    ----------
    signal
        One of ``QUANTITIES``.
    statistic
        'deviation': mean square of the deviation from the model; 'max', 'rms': of the signal itself.
    model, robot
        The number of either; of the model itself a deviation is 0.
    other
        What parameters beside the effects explain.
    alone, left_out, share
        By effect.

    """

    signal: str
    statistic: str
    model: float
    robot: float
    other: float
    alone: dict[str, float]
    left_out: dict[str, float]
    share: dict[str, float]

    @property
    def total(self) -> float:
        """What is to be explained."""
        return self.robot - self.model

    @property
    def unit(self) -> str:
        """In which the numbers are."""
        unit = QUANTITIES[self.signal].unit
        return f'({unit})^2' if self.statistic == 'deviation' else unit

    def percent(self, value: float) -> float | None:
        """Share of a deviation; None of statistics, whose changes may cancel."""
        if self.statistic != 'deviation' or self.total <= 0.0:
            return None
        return 100.0 * value / self.total


@dataclass(frozen=True)
class Attribution:
    """An attribution says what explains the difference of a robot from its model.

    Attributes
    ----------
    effects
        Of the robot, in the order of ``EFFECTS``.
    other_parameters
        Names of parameters beside the effects in which robot and model differ.
    simulations
        Runs that it took.
    outcomes
        By signal and statistic.

    """

    effects: tuple[str, ...]
    other_parameters: tuple[str, ...]
    simulations: int
    outcomes: dict[tuple[str, str], Outcome]


def effects_of(robot: Parameters) -> tuple[str, ...]:
    """Return the effects that a robot has: switched on, and with a magnitude."""
    rich = robot.rich.effects
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if getattr(rich, effect.switch)
        and (not effect.magnitudes or any(np.any(getattr(rich, m)) for m in effect.magnitudes))
    )


def with_effects(robot: Parameters, chosen: Iterable[str]) -> Parameters:
    """Return the robot with no more of its effects than ``chosen``, and nothing else changed."""
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
        Worth of every coalition, shape (2^n, ...): player i is in coalition m where bit i of m is set.

    Returns
    -------
    array
        Shape (n, ...); the sum is ``values[-1] - values[0]``.

    """
    players = len(values).bit_length() - 1
    if len(values) != 1 << players:
        raise ValueError(f'{len(values)} coalitions are not those of a whole number of players')
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
    """Simulate every combination of the robot's effects and share out its difference from the model.

    Raises
    ------
    RunError
        The robot cannot run the program with some of its effects; names them.

    """
    effects = effects_of(robot)
    count = 1 << len(effects)
    rows = []
    plans: dict[bytes, Planned] = {}

    def planned(program: Program, tcp_m: Floats, parameters: Parameters) -> Planned:
        """Plan once for each place: effects change what the encoders say of it, but nothing that is planned with."""
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
    """Return what is explained, of one run."""
    numbers = {(name, 'deviation'): comparison.mean_square_deviation(name) for name in comparison.names}
    for name, statistic in EXPLAINED:
        largest, square = map(comparison.measured, comparison.extent(comparison.robot, name))
        found = np.abs(largest).max() if statistic == 'max' else math.sqrt((square**2).mean())
        numbers[name, statistic] = float(found)
    return numbers


def outcome_of(key: tuple[str, str], effects: Sequence[str], of_model: float, values: Floats) -> Outcome:
    """Return what the values of all subsets of effects tell about each effect; bit i of an index is effect i."""
    every = len(values) - 1
    return Outcome(
        *key,
        of_model,
        float(values[every]),
        float(values[0] - of_model),
        {name: float(values[1 << i] - values[0]) for i, name in enumerate(effects)},
        {name: float(values[every] - values[every ^ (1 << i)]) for i, name in enumerate(effects)},
        dict(zip(effects, shapley(values).tolist(), strict=True)),
    )


def _other_parameters(model: Parameters, robot: Parameters) -> tuple[str, ...]:
    bare, flat = flatten(with_effects(robot, ())), flatten(model)
    return tuple(name for name in flat if not name.startswith('rich.') and flat[name] != bare[name])
