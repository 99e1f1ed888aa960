"""The estimation of chapter 9 again: why least squares on the closed loop gave its initial values back.

Model and measurement are compared as in Table 10-1, in what the bus shows once per cycle: arm angles, arm speeds and
currents of the closed loop, in SI units and without weights; free are R, L, F_v, F_s and I_m of P4. Derivatives are
forward differences; the step that was used is not known, so several are tried, among them the usual one, the square
root of the machine's precision. Four facts explain the outcome:

1. The loop sees its shafts through encoders. One reading that tips over to the next increment sends the loops along
   another course within the increments: the difference quotient is that course, divided by the step.
2. Quotients that are too steep by orders of magnitude ask for steps that are too short by as much: the initial values
   are returned, the right ones as well as those that are 30 % off.
3. Unweighted, with parameters whose sizes differ by five decades, one tolerance means another thing for each of them.
4. The current loop lets the winding's current follow its reference whatever R and L are: hardly a trace of R, and
   little of L, reaches signals that are sampled once per bus cycle.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from delta3_pacdrive.analysis.estimation.measurement import NOISE
from delta3_pacdrive.analysis.estimation.problem import Problem
from delta3_pacdrive.analysis.estimation.quantities import TABLE, start_values, values_of
from delta3_pacdrive.analysis.estimation.replay_model import Replay, ReplayModel
from delta3_pacdrive.analysis.estimation.solver import Fit, Iterate, OnIterate, fit
from delta3_pacdrive.analysis.study import OnProgress, silent
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace

SYMBOLS = ('R', 'L', 'F_v', 'F_s', 'I_m')
FREED = tuple(TABLE[symbol] for symbol in (*SYMBOLS, 'K_m'))  # that the same signals are then estimated from
DEFAULT_STEP = math.sqrt(np.finfo(np.float64).eps)
STEPS = (DEFAULT_STEP, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
TRUE_STEP = 1e-3  # of quotients through an ideal encoder, in the middle of the range where they agree
# tolerances on the function, the step and the gradient are the solver's usual ones
LIMITS: dict[str, Any] = {'ftol': 1e-6, 'xtol': 1e-6, 'gtol': 1e-6, 'max_nfev': 30}
ATTEMPT_STEPS = (DEFAULT_STEP, 1e-5, 1e-4, 1e-2)
BOUNDS = (1e-3, 1e2)  # of an attempt, as multiples of the start
OFF = 0.3  # of the starts that are not right
AT_MINIMUM, FOUND = 0.1, 0.05  # of the cost above the least; of the values beside the right ones
STUCK = 5e-3  # relative change below which an attempt has returned its initial values
FACTORS = tuple(np.linspace(0.5, 1.5, 11).tolist())
SIGNALS = ('motor_position', 'motor_speed', 'current')


@dataclass(frozen=True)
class Quotient:
    """A quotient is the change of the current by one step of one quantity, over the step.

    Attributes
    ----------
    symbol
        Of the quantity.
    step
        Share of its value.
    through_encoder, ideal
        Length of the quotient in deviations of the current's noise, per 100 %: with the encoder's increments, and
        with an encoder without increments.
    agreement
        Cosine between the quotient through the encoder and the true slope: 1 the same direction, 0 chance.
    increments
        Largest change of a shaft position by the step.

    """

    symbol: str
    step: float
    through_encoder: float
    ideal: float
    agreement: float
    increments: float


@dataclass(frozen=True)
class Attempt:
    """An attempt is an estimation with the usual settings.

    Attributes
    ----------
    step
        Of the difference quotients, share of a value.
    off
        Share by which it started beside the right values.
    start, values
        Initial and returned values [SI] in the order of ``SYMBOLS``.
    moved
        Relative changes of the values.
    cost_start, cost
        Half the sum of squares before and after.
    evaluations
        Simulations.
    message
        Of the solver.

    """

    step: float
    off: float
    start: tuple[float, ...]
    values: tuple[float, ...]
    moved: tuple[float, ...]
    cost_start: float
    cost: float
    evaluations: int
    message: str

    @property
    def error(self) -> float:
        """Largest relative distance of a value from the right one, which the start was ``off`` beside."""
        return max(abs((1.0 + self.off) * (1.0 + moved) - 1.0) for moved in self.moved)


@dataclass(frozen=True)
class ThesisStudy:
    """The study holds all that explains the outcome of chapter 9.

    Attributes
    ----------
    quotients
        For every quantity and step.
    profiles
        Cost over the factor of one quantity, the others being right, less its minimum: in sums of squares of the
        current over its noise; through an ideal encoder.
    attempts
        With several steps, from values that are off and from the right ones.
    recorded
        Whose data these are.
    cure
        With an ideal encoder in the model, scales, weights and steps that fit, and K_m free besides.
    problem
        That of the cure.
    built
        Attempts on data of a built robot, from which the model differs.

    """

    quotients: tuple[Quotient, ...]
    profiles: dict[str, tuple[float, ...]]
    attempts: tuple[Attempt, ...]
    cure: Fit
    problem: Problem
    built: tuple[Attempt, ...] = ()
    recorded: str = 'the model'

    @property
    def trials(self) -> list['Trial']:
        """All attempts, with what came of each, by the data they were made on."""
        return _trials(self.recorded, self.attempts) + _trials('a built robot', self.built)


@dataclass(frozen=True)
class Trial:
    """A trial says what came of an attempt.

    Attributes
    ----------
    data
        Whose signals they are.
    attempt
        What was tried.
    outcome
        What came of it, in words.
    excess
        Cost that is left, of the least of all attempts on these data.

    """

    data: str
    attempt: Attempt
    outcome: str
    excess: float

    @property
    def sentence(self) -> str:
        """One line of the table in words."""
        own = self.attempt
        begin = f'{100.0 * own.off:g} % off' if own.off else 'at the right values'
        return (
            f'data of {self.data}, step {own.step:.2g}, start {begin}: moved by at most '
            f'{100.0 * max(map(abs, own.moved)):.2g} %, ends at most {100.0 * own.error:.2g} % beside the right values '
            f'with {self.excess:.3g} times the least cost: {self.outcome}'
        )


def study(
    trace: Trace,
    parameters: Parameters,
    off: float = 0.3,
    on_progress: OnProgress = silent,
    on_iterate: OnIterate | None = None,
    resume: Iterate | None = None,
    built: Trace | None = None,
    recorded: str = 'the model',
) -> ThesisStudy:
    """Estimate from a recording as chapter 9 did, and as one should.

    Raises
    ------
    EstimationError
        The recording has not one sample per bus cycle, with the commands of the shafts.

    """
    off = off or OFF
    quotients = quotients_of(trace, parameters, on_progress)
    profiles = _profiles(trace, parameters, on_progress)
    attempts = _attempts(trace, parameters, off, on_progress)
    others = () if built is None else _attempts(built, parameters, off, on_progress)
    on_progress('with scales and slopes', 0, 1)
    problem = Problem(FREED, [ReplayModel(trace, parameters)], parameters)
    cure = fit(problem, start_values(FREED, parameters, off), on_iterate, resume)
    return ThesisStudy(tuple(quotients), profiles, attempts, cure, problem, others, recorded)


def _attempts(
    trace: Trace, parameters: Parameters, off: float, on_progress: OnProgress
) -> tuple[Attempt, ...]:
    found = []
    cases = [(step, share) for step in ATTEMPT_STEPS for share in (off, 0.0)]
    for number, (step, share) in enumerate(cases):
        on_progress('usual settings', number, len(cases))
        found.append(attempt_once(trace, parameters, step, share))
    return tuple(found)


def _trials(data: str, attempts: Sequence[Attempt]) -> list[Trial]:
    least = min((a.cost for a in attempts), default=1.0)
    return [Trial(data, a, _outcome(a, a.cost / least), a.cost / least) for a in attempts]


def _outcome(attempt: Attempt, excess: float) -> str:
    """Say which explanation holds of an attempt: that of the thesis, that of the steps, or none."""
    came_back = max(map(abs, attempt.moved)) < STUCK
    is_least = excess < 1.0 + AT_MINIMUM
    if came_back and is_least:
        return 'came back, and was in a minimum, as the thesis supposes'
    if came_back:
        return 'came back outside of a minimum: quotients with such a step point nowhere'
    if attempt.error < FOUND:
        return 'found the right values'
    if is_least:
        return 'went to wrong values that fit best: the signals or the model do not tell them'
    return 'went astray'


def explanation(study: ThesisStudy) -> list[str]:
    """Say in words, with the figures of a study, why the estimation came to nothing."""
    off = max(a.off for a in study.attempts)
    lost = [q for q in study.quotients if 1e-5 <= q.step <= 1e-3]
    slopes = {q.symbol: q.ideal for q in study.quotients if q.step == TRUE_STEP}
    excess = [q.through_encoder / slopes[q.symbol] for q in lost]
    stuck = [a for a in study.attempts if max(map(abs, a.moved)) < STUCK]
    best = min(study.attempts, key=lambda a: a.cost)
    sentences = [
        f'With steps from 1e-5 to 1e-3 the difference quotients through the encoders are {min(excess):.2g} to '
        f'{max(excess):.2g} times as long as the true slopes and stand nearly at right angles to them '
        f'(cosine at most {max(abs(q.agreement) for q in lost):.2g}): '
        'a single reading that tips over sends the loops along another course.',
        f'A change by 100 % moves the current of all bus cycles together by {slopes["R"]:.2g} (R), '
        f'{slopes["L"]:.2g} (L), {slopes["F_v"]:.2g} (F_v), {slopes["F_s"]:.2g} (F_s) and {slopes["I_m"]:.2g} (I_m) '
        'standard deviations of its noise: the current loop hides the winding.',
    ]
    off_and_stuck = [a for a in stuck if a.off]
    if off_and_stuck:
        sentences.append(
            f'Of {sum(a.off > 0.0 for a in study.attempts)} estimations that began {100.0 * off:g} % off, '
            f'{len(off_and_stuck)} moved by less than {100.0 * STUCK:g} %: the initial values came back, '
            f'at {min(a.cost for a in off_and_stuck) / best.cost:.2g} times the least cost and more.'
        )
    sentences += [trial.sentence for trial in study.trials]
    return sentences


def quotients_of(
    trace: Trace,
    parameters: Parameters,
    on_progress: OnProgress = silent,
    symbols: Sequence[str] = SYMBOLS,
    steps: Sequence[float] = STEPS,
) -> list[Quotient]:
    """Return difference quotients of the replayed current, through encoders and without."""
    values = values_of(parameters)
    rough, ideal = Replay(trace, parameters, ideal_encoder=False), Replay(trace, parameters)
    before, before_ideal = rough.run({}), ideal.run({})
    per_rad = parameters.bus.increments_per_rev / math.tau
    out, done, total = [], 0, len(symbols) * len(steps)
    for symbol in symbols:
        true = _change(ideal, symbol, values, TRUE_STEP, before_ideal) / TRUE_STEP
        for step in steps:
            after = rough.run({symbol: values[symbol] * (1.0 + step)})
            seen = (after['current'] - before['current']) / step
            smooth = _change(ideal, symbol, values, step, before_ideal) / step
            length = float(np.linalg.norm(seen))
            out.append(
                Quotient(
                    symbol,
                    step,
                    length / NOISE.current_a,
                    float(np.linalg.norm(smooth)) / NOISE.current_a,
                    float((seen * true).sum()) / max(length * float(np.linalg.norm(true)), 1e-300),
                    float(np.abs(after['motor_position'] - before['motor_position']).max()) * per_rad,
                )
            )
            done += 1
            on_progress('difference quotients', done, total)
    return out


def _change(
    replay: Replay, symbol: str, values: Mapping[str, float], step: float, before: Mapping[str, Floats]
) -> Floats:
    return replay.run({symbol: values[symbol] * (1.0 + step)})['current'] - before['current']


def _profiles(trace: Trace, parameters: Parameters, on_progress: OnProgress) -> dict[str, tuple[float, ...]]:
    values, model = values_of(parameters), ReplayModel(trace, parameters)
    profiles = {}
    for number, symbol in enumerate(SYMBOLS):
        costs = []
        for factor in FACTORS:
            error = model.residuals(values | {symbol: factor * values[symbol]})[0]
            costs.append(float(((error / NOISE.current_a) ** 2).sum()))
            on_progress('profiles', number * len(FACTORS) + len(costs), len(SYMBOLS) * len(FACTORS))
        profiles[symbol] = tuple(cost - min(costs) for cost in costs)
    return profiles


def attempt_once(trace: Trace, parameters: Parameters, step: float, off: float) -> Attempt:
    """Estimate from the closed loop's signals in SI units with the usual settings and a step of the quotients."""
    replay = Replay(trace, parameters, ideal_encoder=False)
    ratio = parameters.dynamics.gear_ratio
    measured = [trace[name][replay.rows] for name in SIGNALS]
    shares = (1.0 / ratio, 1.0 / ratio, 1.0)

    def residuals(x: Floats) -> Floats:
        model = replay.run(dict(zip(SYMBOLS, x.tolist(), strict=True)))
        compared = zip(SIGNALS, measured, shares, strict=True)
        return np.concatenate([((model[name] - own) * share).ravel() for name, own, share in compared])

    start = start_values([TABLE[symbol] for symbol in SYMBOLS], parameters, off)
    bounds = (BOUNDS[0] * start, BOUNDS[1] * start)
    solution = least_squares(residuals, start, '2-point', bounds=bounds, diff_step=step, **LIMITS)
    first = residuals(start)
    return Attempt(
        step,
        off,
        tuple(start.tolist()),
        tuple(solution.x.tolist()),
        tuple((solution.x / start - 1.0).tolist()),
        0.5 * float(first @ first),
        float(solution.cost),
        int(solution.nfev) + len(start) * int(solution.njev),
        str(solution.message).rstrip('.').replace('`', ''),
    )
