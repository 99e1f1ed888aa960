"""Repetition of the estimation of chapter 9: why least squares on the closed loop returned its initial values.

As in Table 10-1, model and measurement are compared in arm angles, arm speeds and currents of the closed loop, sampled
once per bus cycle, in SI units and unweighted. R, L, F_v, F_s and I_m of P4 are free. Derivatives are forward
differences. The step is not documented, so several are tried, including the usual one, the square root of the machine
precision. Four facts explain the result:

1. The loop reads its shafts through encoders. A single reading that changes by one increment changes the trajectory of
   the loops within the increments, and the difference quotient is that change divided by the step.
2. Quotients that are too steep by orders of magnitude make the steps too short by the same factor. The initial values
   are returned, the true ones as well as those that are 30 % off.
3. Without weights, and with parameters that differ by five decades, one tolerance has a different meaning for each.
4. The current loop makes the current follow its reference regardless of R and L. Hardly any information on R, and
   little on L, reaches signals sampled once per bus cycle.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from scipy.optimize import least_squares

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation.measurement import NOISE
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import TABLE, start_values, values_of
from delta3_pacdrive.studies.estimation.replay_model import Replay, ReplayModel
from delta3_pacdrive.studies.estimation.solver import Fit, Iterate, OnIterate, fit
from delta3_pacdrive.studies.framework.columns import Column
from delta3_pacdrive.studies.framework.study import OnProgress, silent

SYMBOLS = ('R', 'L', 'F_v', 'F_s', 'I_m')
FREED = tuple(TABLE[symbol] for symbol in (*SYMBOLS, 'K_m'))  # estimated from the same signals afterwards
DEFAULT_STEP = math.sqrt(np.finfo(np.float64).eps)
STEPS = (DEFAULT_STEP, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
TRUE_STEP = 1e-3  # with an ideal encoder, in the middle of the range where quotients agree
# default tolerances of the solver on function, step and gradient
LIMITS: dict[str, Any] = {'ftol': 1e-6, 'xtol': 1e-6, 'gtol': 1e-6, 'max_nfev': 30}
ATTEMPT_STEPS = (DEFAULT_STEP, 1e-5, 1e-4, 1e-2)
BOUNDS = (1e-3, 1e2)  # of an attempt, as multiples of the start
OFF = 0.3  # relative error of the wrong start values
AT_MINIMUM, FOUND = 0.1, 0.05  # relative excess of the cost; relative error of the values
STUCK = 5e-3  # relative change below which an attempt has returned its initial values
FACTORS = tuple(np.linspace(0.5, 1.5, 11).tolist())
SIGNALS = ('motor_position', 'motor_speed', 'current')


@dataclass(frozen=True)
class Quotient:
    """Difference quotient of the current with respect to one quantity."""

    symbol: Annotated[str, Column('quantity')]
    step: Annotated[float, Column('step [1]')]  # share of the value
    # length with encoder increments [standard deviations of the noise per 100 %]
    through_encoder: Annotated[float, Column('quotient through encoder [noise per 100 %]')]
    ideal: Annotated[float, Column('quotient with ideal encoder [noise per 100 %]')]  # with an ideal encoder
    # cosine between quotient and true slope: 1 same direction, 0 chance
    agreement: Annotated[float, Column('cosine to the true slope [1]')]
    increments: Annotated[float, Column('largest change of a shaft [increments]')]  # of a shaft position


@dataclass(frozen=True)
class Attempt:
    """Estimation with default settings."""

    step: float  # of the difference quotients, share of a value
    off: float  # relative error of the start values
    start: tuple[float, ...]  # initial values [SI] in the order of SYMBOLS
    values: tuple[float, ...]  # returned values [SI]
    moved: tuple[float, ...]  # relative changes
    cost_start: float  # half the sum of squares before
    cost: float  # half the sum of squares after
    evaluations: int  # number of simulations
    message: str

    @property
    def error(self) -> float:
        """Largest relative error of a value."""
        return max(abs((1.0 + self.off) * (1.0 + moved) - 1.0) for moved in self.moved)


@dataclass(frozen=True)
class ThesisStudy:
    """Analysis of the result of chapter 9."""

    quotients: tuple[Quotient, ...]  # for each quantity and step
    # cost over the factor of one quantity, less its minimum [noise^2], with an ideal encoder
    profiles: dict[str, tuple[float, ...]]
    attempts: tuple[Attempt, ...]  # with several steps, from wrong and from true values
    cure: Fit  # with ideal encoder, scales, weights, suitable steps, and K_m free
    problem: Problem  # problem of the cure
    built: tuple[Attempt, ...] = ()  # attempts on data of a built robot, which differs from the model
    recorded: str = 'the model'  # source of the data

    @property
    def trials(self) -> list['Trial']:
        """All attempts with their outcomes."""
        return _trials(self.recorded, self.attempts) + _trials('a built robot', self.built)


@dataclass(frozen=True)
class Trial:
    """Outcome of an attempt."""

    data: str  # source of the signals
    attempt: Attempt
    outcome: str
    excess: float  # remaining cost relative to the smallest cost of all attempts on these data

    @property
    def sentence(self) -> str:
        """The outcome as a sentence."""
        own = self.attempt
        begin = f'{100.0 * own.off:g} % off' if own.off else 'at the true values'
        return (
            f'data of {self.data}, step {own.step:.2g}, start {begin}: moved by at most '
            f'{100.0 * max(map(abs, own.moved)):.2g} %, final error at most {100.0 * own.error:.2g} % '
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
) -> ThesisStudy:
    """Estimate from a recording as in chapter 9, and with correct settings.

    Raises
    ------
    EstimationError
        The recording does not contain one sample per bus cycle with the commands of the shafts.

    """
    off = off or OFF
    quotients = quotients_of(trace, parameters, on_progress)
    profiles = _profiles(trace, parameters, on_progress)
    attempts = _attempts(trace, parameters, off, on_progress)
    others = () if built is None else _attempts(built, parameters, off, on_progress)
    on_progress('with scales and slopes', 0, 1)
    problem = Problem(FREED, [ReplayModel(trace, parameters)], parameters)
    cure = fit(problem, start_values(FREED, parameters, off), on_iterate, resume)
    return ThesisStudy(
        quotients=tuple(quotients),
        profiles=profiles,
        attempts=attempts,
        cure=cure,
        problem=problem,
        built=others,
        recorded=trace.meta.get('input', 'the model'),
    )


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
    """Return the outcome of an attempt in words."""
    came_back = max(map(abs, attempt.moved)) < STUCK
    is_least = excess < 1.0 + AT_MINIMUM
    if came_back and is_least:
        return 'returned the start values at a minimum, as the thesis assumes'
    if came_back:
        return 'returned the start values outside a minimum: quotients with such a step are meaningless'
    if attempt.error < FOUND:
        return 'found the true values'
    if is_least:
        return 'found wrong values of best fit: the signals or the model do not identify them'
    return 'diverged'


def explanation(study: ThesisStudy) -> list[str]:
    """Return the explanation of the result of chapter 9 with the figures of a study, as sentences."""
    off = max(a.off for a in study.attempts)
    lost = [q for q in study.quotients if 1e-5 <= q.step <= 1e-3]
    slopes = {q.symbol: q.ideal for q in study.quotients if q.step == TRUE_STEP}
    excess = [q.through_encoder / slopes[q.symbol] for q in lost]
    stuck = [a for a in study.attempts if max(map(abs, a.moved)) < STUCK]
    best = min(study.attempts, key=lambda a: a.cost)
    sentences = [
        f'With steps from 1e-5 to 1e-3 the difference quotients through the encoders are {min(excess):.2g} to '
        f'{max(excess):.2g} times as long as the true slopes and nearly perpendicular to them '
        f'(cosine at most {max(abs(q.agreement) for q in lost):.2g}): '
        'one changed encoder reading changes the trajectory of the loops.',
        f'A change by 100 % changes the current of all bus cycles by {slopes["R"]:.2g} (R), '
        f'{slopes["L"]:.2g} (L), {slopes["F_v"]:.2g} (F_v), {slopes["F_s"]:.2g} (F_s) and {slopes["I_m"]:.2g} (I_m) '
        'standard deviations of its noise in total: the current loop hides the winding.',
    ]
    off_and_stuck = [a for a in stuck if a.off]
    if off_and_stuck:
        sentences.append(
            f'Of {sum(a.off > 0.0 for a in study.attempts)} estimations that began {100.0 * off:g} % off, '
            f'{len(off_and_stuck)} moved by less than {100.0 * STUCK:g} % and returned the initial values, '
            f'at {min(a.cost for a in off_and_stuck) / best.cost:.2g} times the least cost or more.'
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
    """Return difference quotients of the replayed current, with encoders and with ideal encoders."""
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
                    symbol=symbol,
                    step=step,
                    through_encoder=length / NOISE.current_a,
                    ideal=float(np.linalg.norm(smooth)) / NOISE.current_a,
                    agreement=float((seen * true).sum()) / max(length * float(np.linalg.norm(true)), 1e-300),
                    increments=float(np.abs(after['motor_position'] - before['motor_position']).max())
                    * per_rad,
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
    """Estimate from the closed-loop signals in SI units with default settings and a step of the quotients."""
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
        step=step,
        off=off,
        start=tuple(start.tolist()),
        values=tuple(solution.x.tolist()),
        moved=tuple((solution.x / start - 1.0).tolist()),
        cost_start=0.5 * float(first @ first),
        cost=float(solution.cost),
        evaluations=int(solution.nfev) + len(start) * int(solution.njev),
        message=str(solution.message).rstrip('.').replace('`', ''),
    )
