"""Time-optimal motion of one axis within limits of speed, acceleration and jerk.

A profile is a table of phases (n, 5) of constant jerk: time [s], distance [m], speed [m/s], acceleration [m/s^2], jerk
[m/s^3]; phases of zero duration are omitted, and the last row is the end.

Between two states the acceleration rises from a_0 to a peak a_p, falls to a trough a_t and rises to a_f, or the same
with opposite signs. A peak or trough at the limit A is held for a time h_p or h_t. The change of speed from v_0 to
v_f gives one of them from the other,

    a_p^2 + A J h_p = a_t^2 + A J h_t + J (v_f - v_0) + (a_0^2 - a_f^2) / 2,

and the distance gives the other one as the root of a function of one variable. The speed has its maximum where the
falling acceleration is zero; if that exceeds the speed limit, the profile cruises at the limit.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats

State = tuple[float, float, float]
Candidate = tuple[float, tuple[float, ...]]  # distance error, and durations
JERK_SIGNS = (1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0)
STEPS_MAX = 300  # of the root search
REACHED = 1e-12  # distance error [m], relative beyond 1 m, that counts as zero
ROUNDING = 1e-9  # relative tolerance of the limits for start and end


def rest_to_rest(length_m: float, limits: State) -> Floats:
    """Return the fastest profile over a length from rest to rest; an infinite jerk gives constant accelerations.

    The terms are evaluated in the order of ruckig, so that both have the same bits where ruckig has a solution.
    """
    speed, acceleration, jerk = limits
    start = (0.0, 0.0, 0.0)
    square = acceleration * acceleration
    if math.isinf(jerk * jerk):
        peak = math.sqrt(2.0 * square * length_m / (2.0 * acceleration))
        if peak <= speed:
            rise = peak / acceleration
            return _constant_accelerations(start, (rise, 0.0, rise), acceleration)
        rise = speed / acceleration
        cruise = speed * (2.0 * acceleration) / (-2.0 * square) + length_m / speed
        return _constant_accelerations(start, (rise, max(cruise, 0.0), rise), acceleration)
    ramp = acceleration / jerk
    held = (jerk * speed - square) / (acceleration * jerk)
    if held >= 0.0:
        lack = square * (acceleration * speed - jerk * length_m) + acceleration * jerk * speed * speed
        cruise = -12.0 * jerk * lack / (12.0 * acceleration * acceleration * (jerk * jerk) * speed)
    else:
        ramp, held = math.sqrt(speed / jerk), 0.0
        cruise = length_m / speed - 2.0 * ramp
    if cruise > 0.0:
        return _phases(start, (ramp, held, ramp, cruise, ramp, held, ramp), jerk, {3: 0.0})
    fall = math.cbrt(4.0 * length_m / jerk)  # from the peak of the acceleration to its trough
    if 0.5 * fall * jerk <= acceleration:
        # one step of Newton's method
        fall -= (
            3.0 * (jerk * jerk) * (-4.0 * length_m + jerk * fall * fall * fall) / (12.0 * (jerk * jerk))
        ) / (3.0 * (jerk * fall * fall) / 4.0)
        return _phases(start, (0.5 * fall, 0.0, fall, 0.0, 0.0, 0.0, 0.5 * fall), jerk)
    ramp = acceleration / jerk
    power = square * (3.0 * acceleration * acceleration * acceleration)
    root = (
        math.sqrt(power / (3.0 * acceleration * (jerk * jerk)) + 4.0 * (square * length_m / acceleration))
        / 2.0
    )
    held = max(root / acceleration - 3.0 * acceleration / (2.0 * jerk), 0.0)
    fixed = {1: acceleration, 3: 0.0, 5: -acceleration}
    return _phases(start, (ramp, held, ramp, 0.0, ramp, held, ramp), jerk, fixed)


def to_rest(start: State, acceleration_max: float, jerk_max: float) -> Floats:
    """Return the fastest profile from a state (distance, speed, acceleration) to rest at an arbitrary distance."""
    _, v, a = start
    if math.isinf(jerk_max):
        return _constant_accelerations(
            start, (abs(v) / acceleration_max,), -math.copysign(acceleration_max, v)
        )
    jerk = jerk_max if 2.0 * jerk_max * v + a * abs(a) < 0.0 else -jerk_max
    limit = math.copysign(acceleration_max, jerk)
    peak = math.copysign(math.sqrt(max(a * a / 2.0 - jerk * v, 0.0)), jerk)
    if abs(peak) <= acceleration_max:
        return _phases(start, ((peak - a) / jerk, 0.0, peak / jerk), jerk)
    held = a * a / (2.0 * limit * jerk) - limit / jerk - v / limit
    return _phases(start, ((limit - a) / jerk, held, limit / jerk), jerk)


def between(start: State, end: State, limits: State) -> Floats:
    """Return the fastest profile between two states (distance, speed, acceleration).

    With an infinite jerk, accelerations are constant, and the accelerations of both states are ignored.

    Raises
    ------
    ProgramError
        A state exceeds a limit, or its acceleration implies an earlier or later speed beyond the limit.

    """
    speed, acceleration, jerk = limits
    way, (_, v, a), (_, v_end, a_end) = end[0] - start[0], start, end
    if math.isinf(jerk):
        a = a_end = 0.0
    extremes = (v, v_end, v + a * abs(a) / (2.0 * jerk), v_end - a_end * abs(a_end) / (2.0 * jerk))
    if not (
        max(map(abs, extremes)) <= speed * (1.0 + ROUNDING)
        and max(abs(a), abs(a_end)) <= acceleration * (1.0 + ROUNDING)
    ):
        raise ProgramError(
            f'no profile from {v:g} m/s, {a:g} m/s2 to {v_end:g} m/s, {a_end:g} m/s2 within {speed:g} m/s, '
            f'{acceleration:g} m/s2, {jerk:g} m/s3'
        )
    candidates = _constant if math.isinf(jerk) else _rising
    found = []
    for sign in (1.0, -1.0):
        request = (sign * way, sign * v, sign * a, sign * v_end, sign * a_end)
        for miss, durations in candidates(request, limits):
            found.append(
                (miss if miss > REACHED * max(abs(way), 1.0) else 0.0, sum(durations), sign, durations)
            )
    _, _, sign, durations = min(found)
    if math.isinf(jerk):
        rows = _constant_accelerations((start[0], v, 0.0), durations, sign * acceleration)
    else:
        rows = _phases(start, durations, sign * jerk)
    rows[-1] = rows[-1, 0], end[0], v_end, a_end, 0.0
    return rows


def _rising(request: tuple[float, ...], limits: State) -> Iterator[Candidate]:
    """Yield candidates that start with positive jerk.

    The request is distance, speed and acceleration at the start, speed and acceleration at the end.
    """
    way, v, a, v_end, a_end = request
    speed, limit, jerk = limits
    surplus = (
        jerk * (v_end - v) + (a * a - a_end * a_end) / 2.0
    )  # square of the peak minus that of the trough

    def through_zero(root: float) -> tuple[float, ...]:
        """Return the durations for a peak above and a trough below zero; the square of the peak grows with ``root``."""
        rise = lowest + root * root
        fall = max(rise - surplus, 0.0)
        peak, trough = min(math.sqrt(rise), limit), min(math.sqrt(fall), limit)
        held, held_later = (rise - peak * peak) / (limit * jerk), (fall - trough * trough) / (limit * jerk)
        return (peak - a) / jerk, held, peak / jerk, 0.0, trough / jerk, held_later, (trough + a_end) / jerk

    def above_zero(trough: float) -> tuple[float, ...]:
        rise = surplus + trough * trough
        peak = min(math.sqrt(rise), limit)
        held = (rise - peak * peak) / (limit * jerk)
        return (peak - a) / jerk, held, (peak - trough) / jerk, 0.0, 0.0, 0.0, (a_end - trough) / jerk

    def below_zero(peak: float) -> tuple[float, ...]:
        fall = peak * peak - surplus
        trough = min(math.sqrt(fall), limit)
        held = (fall - trough * trough) / (limit * jerk)
        return (-peak - a) / jerk, 0.0, (trough - peak) / jerk, 0.0, 0.0, held, (trough + a_end) / jerk

    jerks = tuple(sign * jerk for sign in JERK_SIGNS)

    def excess(durations: Sequence[float]) -> float:
        """Return the distance covered beyond the required one."""
        s, v_now, a_now = -way, v, a
        for t, j in zip(durations, jerks, strict=True):
            if t > 0.0:
                change = t * j
                s += t * (v_now + t * (a_now / 2.0 + change / 6.0))
                v_now += t * (a_now + change / 2.0)
                a_now += change
        return s

    lowest = max(0.0, surplus, a * abs(a), surplus - a_end * abs(a_end))
    highest = math.sqrt(max(jerk * (speed - v) + a * a / 2.0 - lowest, 0.0))
    yield _solved(through_zero, excess, 0.0, highest, v + (lowest + highest**2 - a * a / 2.0) / jerk)
    if surplus > 0.0 and a_end > 0.0:
        trough = math.sqrt(max(a * abs(a) - surplus, 0.0))
        if trough <= a_end:
            yield _solved(above_zero, excess, a_end, trough, 0.0)
    if surplus < 0.0 and a < 0.0:
        peak = math.sqrt(max(surplus - a_end * abs(a_end), 0.0))
        if peak <= -a:
            yield _solved(below_zero, excess, -a, peak, 0.0)


def _solved(
    durations_of: Callable[[float], tuple[float, ...]],
    excess: Callable[[Sequence[float]], float],
    first: float,
    last: float,
    cruise_speed: float,
) -> Candidate:
    """Return durations with zero excess between the shortest and the longest profile, which may cruise."""
    shortest = durations_of(first)
    low = excess(shortest)
    if low >= 0.0:
        return low, shortest
    longest = durations_of(last)
    high = excess(longest)
    if high <= 0.0:
        if cruise_speed > 0.0:
            return 0.0, (*longest[:3], -high / cruise_speed, *longest[4:])
        return -high, longest
    x0, x1, below, durations = first, last, False, shortest
    for step in range(STEPS_MAX):
        # regula falsi (Illinois); every fourth step bisects, which bounds the number of steps
        x = x0 - low * (x1 - x0) / (high - low)
        if step % 4 == 3 or not min(x0, x1) < x < max(x0, x1):
            x = 0.5 * (x0 + x1)
        if x in (x0, x1):
            break
        durations = durations_of(x)
        value = excess(durations)
        if value == 0.0:
            break
        if value < 0.0:
            if below:
                high *= 0.5
            x0, low, below = x, value, True
        else:
            if not below:
                low *= 0.5
            x1, high, below = x, value, False
    return 0.0, durations


def _constant(request: tuple[float, ...], limits: State) -> Iterator[Candidate]:
    """Yield candidates of constant accelerations that start with a positive one."""
    way, v, _, v_end, _ = request
    speed, acceleration, _ = limits
    square, top = acceleration * way + (v * v + v_end * v_end) / 2.0, max(v, v_end)
    yield (
        abs(top * top - square) / acceleration,
        ((top - v) / acceleration, 0.0, (top - v_end) / acceleration),
    )
    root = math.sqrt(max(square, 0.0))
    for peak in (root, -root):
        if square >= 0.0 and peak > top:
            most = min(peak, max(speed, top))
            cruise = (square - most * most) / (acceleration * most) if peak > most else 0.0
            yield 0.0, ((most - v) / acceleration, cruise, (most - v_end) / acceleration)


def _constant_accelerations(start: State, durations: Sequence[float], acceleration: float) -> Floats:
    """Return a profile of acceleration, cruising and deceleration with given durations."""
    rows: list[tuple[float, ...]] = []
    time, (s, v, _) = 0.0, start
    for t, a in zip(durations, (acceleration, 0.0, -acceleration), strict=False):
        if time + t > time:
            rows.append((time, s, v, a, 0.0))
            time, s, v = time + t, s + t * (v + t * a / 2.0), v + t * a
    rows.append((time, s, v, 0.0, 0.0))
    return np.array(rows)


def _phases(start: State, durations: Sequence[float], jerk: float, fixed: Mapping[int, float] = {}) -> Floats:
    """Return a profile from the durations of its phases; ``fixed`` overrides initial accelerations by phase number."""
    rows: list[tuple[float, ...]] = []
    time, (s, v, a) = 0.0, start
    for n, (t, sign) in enumerate(zip(durations, JERK_SIGNS, strict=False)):
        a, j = fixed.get(n, a), sign * jerk
        if time + t > time:
            rows.append((time, s, v, a, j))
            s, v, a = s + t * (v + t * (a / 2.0 + t * j / 6.0)), v + t * (a + t * j / 2.0), a + t * j
            time += t
    rows.append((time, s, v, a, 0.0))
    return np.array(rows)
