"""Constant speed along a path, as for dispensing: check of a timed path, and advice when the speed is not feasible."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.limits.limit_reader import BLEND_MIN_M
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.virtual_master import extremes, sample_master
from delta3_pacdrive.planning.timing.blending import PathSegment
from delta3_pacdrive.planning.timing.move_planner import CURVATURE_SHARE, JERK_SHARE

Can = Callable[[list[PathSegment]], bool]  # whether a path can be planned
KEPT = 1e-3  # permitted relative drop of the speed
# a run-up pauses where its acceleration is below a share of its peak, except in its first and last share of the speed
STEADILY, PAUSE = 0.02, 0.01
# relative accuracy of the largest feasible speed, and factors of slightly larger speeds that are tried as well
SPEED_STEP, SPEED_FACTORS = 5e-4, (1.01, 1.005, 1.002, 1.001)
SPEED_DIGITS = 5, 9  # of the advised speed; the second if rounding to the first is not feasible
SPEED_MIN_M_S = 1e-5
BLEND_DIGITS, BLEND_HALVINGS = 4, 24
BLEND_FACTORS = (
    1.0,
    1.02,
    1.05,
    1.1,
    1.2,
    1.5,
    2.0,
    3.0,
    5.0,
)  # times the blends that the curvature requires
BLENDS_NAMED = 10
SAMPLES = 65  # of a blend


class UnevenSpeedError(ProgramError):
    """The speed along a path is not constant; has the distance from the start of the path and the speed there."""

    def __init__(self, sentence: str, place_m: float, speed_m_s: float) -> None:
        super().__init__(sentence)
        self.place_m, self.speed_m_s = place_m, speed_m_s


def is_requested(segments: Sequence[PathSegment]) -> bool:
    """Whether a path requires constant speed; raises ProgramError if its segments contradict this."""
    asked = [segment.constant_speed for segment in segments]
    if not any(asked):
        return False
    first = segments[0]
    for segment in segments:
        if segment.constant_speed != first.constant_speed:
            raise ProgramError(
                f'moves that are joined by blends must have constant_speed all of them or none: {segment.name} differs '
                f'from {first.name}'
            )
        if segment.time_optimal or segment.is_arch:
            kind = 'time-optimal moves' if segment.time_optimal else 'arches'
            raise ProgramError(f'{segment.name}: constant_speed is not for {kind}')
        if segment.limits.speed_m_s != first.limits.speed_m_s:
            raise ProgramError(
                f'a path with constant_speed needs one speed_m_s: {segment.name} has {segment.limits.speed_m_s:g}, '
                f'{first.name} {first.limits.speed_m_s:g}'
            )
    return True


def require(phases: Floats, speed_m_s: float) -> None:
    """Raise UnevenSpeedError unless the speed is constant between run-up and run-out."""
    times = np.unique(np.concatenate([phases[:, 0], extremes(phases)[0]]))
    place, speed, acceleration, _ = sample_master(times, phases).T
    reached = np.flatnonzero(speed >= (1.0 - KEPT) * speed_m_s)
    if not len(reached):
        raise _uneven('reaches only', int(np.argmax(speed)), place, speed)
    first, last = reached[0], reached[-1]
    lowest = first + int(np.argmin(speed[first : last + 1]))
    if speed[lowest] < (1.0 - KEPT) * speed_m_s:
        raise _uneven('falls to', lowest, place, speed)
    steady = (speed > STEADILY * speed_m_s) & (speed < (1.0 - STEADILY) * speed_m_s)
    for own, sign in ((slice(0, first), 1.0), (slice(last + 1, None), -1.0)):
        change = sign * acceleration[own]
        paused = steady[own] & (change <= PAUSE * change.max(initial=0.0))
        if paused.any():
            raise _uneven('stays at', range(len(place))[own][int(np.argmax(paused))], place, speed)


def _uneven(what: str, n: int, place: Floats, speed: Floats) -> UnevenSpeedError:
    sentence = f'the speed {what} {speed[n]:.4g} m/s at {place[n]:.4g} m from its start'
    return UnevenSpeedError(sentence, float(place[n]), float(speed[n]))


def advice(
    error: UnevenSpeedError, segments: list[PathSegment], parts_m: Sequence[float], can: Can
) -> ProgramError:
    """Return the error with its position, the largest constant speed, and blends that allow the requested speed.

    ``parts_m`` are the distances at the end of each segment's part, ``can`` tests whether a path can be planned.
    """
    asked = segments[0].limits.speed_m_s
    number = min(int(np.searchsorted(parts_m, error.place_m)), len(segments) - 1)
    largest = _largest_speed(segments, error.speed_m_s, can)
    speed = (
        f'the largest constant speed is {largest:.{SPEED_DIGITS[-1]}g} m/s'
        if largest
        else 'no constant speed is possible'
    )
    place = f', in {segments[number].name},' if len(segments) > 1 else ','
    return ProgramError(
        f'{error}{place} but constant_speed requires {asked:g} m/s; {speed}, and '
        f'{_blend_text(segments, _larger_blends(segments, number, can))} {asked:g} m/s'
    )


def _blend_text(segments: Sequence[PathSegment], blends_m: Sequence[float]) -> str:
    changed = [
        f'blend_m {blend_m:.{BLEND_DIGITS}g} at {one.name}'
        for one, blend_m in zip(segments, blends_m, strict=False)
        if blend_m > one.blend_m
    ]
    if not changed:
        return 'no blend allows'
    more = len(changed) - BLENDS_NAMED
    named = ', '.join(changed[:BLENDS_NAMED]) + (f' and larger ones at {more} more moves' if more > 0 else '')
    return f'{named} {"allows" if len(changed) == 1 else "allow"}'


def _largest_speed(segments: list[PathSegment], guess: float, can: Can) -> float:
    """Return the largest feasible speed [m/s] below the requested one; 0: none."""

    def possible(speed: float) -> bool:
        return can([replace(one, limits=replace(one.limits, speed_m_s=speed)) for one in segments])

    low, high = 0.0, (asked := segments[0].limits.speed_m_s)
    trial = _rounded(max(min(guess, (1.0 - SPEED_STEP) * high), SPEED_MIN_M_S), SPEED_DIGITS[0], math.floor)
    while not low and trial >= SPEED_MIN_M_S:
        if possible(trial):
            low = trial
        else:
            high, trial = trial, _rounded(0.9 * trial, SPEED_DIGITS[0], math.floor)
    while low and high > (1.0 + SPEED_STEP) * low:
        trial = _rounded(math.sqrt(low * high), SPEED_DIGITS[0], math.floor)
        low, high = (trial, high) if possible(trial) else (low, trial)
    # near its limit the planner may reject a speed but accept a slightly larger one
    while low:
        larger = (factor * low for factor in SPEED_FACTORS if factor * low < asked and possible(factor * low))
        trials = (_rounded(one, digits, math.floor) for one in larger for digits in SPEED_DIGITS)
        found = next((one for one in trials if one > low and possible(one)), 0.0)
        if not found:
            break
        low = found
    return low


def _larger_blends(segments: list[PathSegment], number: int, can: Can) -> list[float]:
    """Return blends [m] with which the path can be planned; empty if larger ones do not help.

    ``number`` is the segment on which the speed drops: the blend at its end is always enlarged.
    """
    if len(segments) == 1:
        return []
    joints = list(pairwise(segments))
    least = [_least_blend(*joint) for joint in joints]
    if not all(least):
        return []
    own = [segment.blend_m for segment in segments]
    number = min(number, len(joints) - 1)
    for factor in BLEND_FACTORS:
        blends = [
            _rounded(factor * blend_m, BLEND_DIGITS, math.ceil) if blend_m > own[n] else own[n]
            for n, blend_m in enumerate(least)
        ]
        if blends[number] == own[number]:
            blends[number] = _rounded(factor * own[number], BLEND_DIGITS, math.ceil)
        blends.append(own[-1])
        if can([replace(one, blend_m=blend_m) for one, blend_m in zip(segments, blends, strict=True)]):
            return blends
    return []


def _least_blend(before: PathSegment, after: PathSegment) -> float:
    """Return the smallest blend [m], at least the current one, that allows the requested speed; 0: none."""
    limits = before.limits.lower(after.limits)

    def allows(radius_m: float) -> bool:
        try:
            corner = curves.blend(before.curve, after.curve, radius_m)
        except ProgramError:
            return False
        samples = sample_path(np.linspace(0.0, corner.length_m, SAMPLES), corner.segments)
        _, _, second, third = np.linalg.norm(samples, axis=2).max(axis=0)
        return bool(
            limits.speed_m_s**2 * second <= CURVATURE_SHARE * limits.acceleration_m_s2
            and limits.speed_m_s**3 * third <= JERK_SHARE * limits.jerk_m_s3
        )

    low, high = max(before.blend_m, BLEND_MIN_M), min(before.curve.length_m, after.curve.length_m)
    if allows(low):
        return low
    if not allows(high):
        return 0.0
    for _ in range(BLEND_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if allows(middle) else (middle, high)
    return high


def _rounded(value: float, digits: int, to: Callable[[float], int]) -> float:
    """Round a positive value to significant digits, up or down."""
    scale = digits - 1 - math.floor(math.log10(value))
    return float(f'{to(round(value * 10.0**scale, 6))}e{-scale}')
