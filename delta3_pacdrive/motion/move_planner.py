"""The fastest master over a path that keeps every limit of the TCP and of the motors, with limited jerk."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import time_parametrization
from delta3_pacdrive.motion.curves import Curve
from delta3_pacdrive.motion.excess import LimitViolation, limit_violation, require_holdable
from delta3_pacdrive.motion.limits import highest_motor_speed, legal_coefficients
from delta3_pacdrive.motion.move_grid import GRID_M, Course, Stretches, laid_out, worse_of_both
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.path_dynamics import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    PathDynamics,
    tcp_motion,
    timed_dynamics,
)
from delta3_pacdrive.motion.thermal_load import ThermalLoad, thermal_load
from delta3_pacdrive.motion.virtual_master import end_acceleration, master_at_distances
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

MOVE_MAX_S = 3600.0
SHARES_MAX = 6  # halvings of the share of the acceleration that a jerk-limited master uses
WINDOW_MIN_S = 1e-3  # shortest time in which a smoothed master changes its acceleration
# what is left after planning with local limits is taken from the time of the whole move
NEARLY_KEPT = 1.0 + 5e-4
ROUNDS_MAX = 8  # of planning with local limits, before all of the move is made slower
# a move of several statements that would be slower by more is planned again on the fine grid
NEARLY_KEPT_BLENDED, NEARLY_KEPT_FINE = 1.0 + 1e-4, 1.0 + 2e-5
# rounds on the fine grid, and those of them in which acceleration and jerk lower the speed in bends only
FINE_ROUNDS_MAX, FINE_ROUNDS_STEADY = 24, 12
FINE_TAPS = 12  # smallest number of samples of the speed in a window
FINE_SHARE, FINE_MIN_M = 1 / 16, 1e-6  # first step: share of the way in a window at the lowest speed
FINE_WIDER = 1.05  # are valleys of the speed in the next round, if the TCP is too fast beside one
FINE_REACH = 1.5  # windows around a place in which the acceleration is lowered
BEND_SHARES = 1.0, 0.25  # of a window that valleys of the speed in bends last; the faster one is chosen
CURVATURE_SHARE, JERK_SHARE = 0.98, 0.8  # of the TCP's limits that may be used up by the path's bend alone


def require_end_of_time(duration_s: float) -> None:
    """Refuse a move that would take too long; raises ProgramError."""
    if not duration_s <= MOVE_MAX_S:
        raise ProgramError(f'it would take {duration_s:.3g} s, the limit is {MOVE_MAX_S:g} s')


class _Timed(NamedTuple):
    """A timing of a move: its phases, the factor of time that they need, and whether no place slows down others."""

    phases: Floats
    factor: float
    share: float  # of the acceleration that it may use
    is_local: bool

    @property
    def duration_s(self) -> float:
        return float(self.phases[-1, 0]) * self.factor


class MovePlanner:
    """Planner of one move: its grid, what the path asks there, and the limits that hold there.

    Parameters
    ----------
    curve
        The path.
    stretches
        Where limits end to hold [m], and the limits, in the order of the path.
    payloads
        Where a payload begins to be carried [m], and the payload [kg], in the order of the path.
    parameters
        Of the robot.
    returning
        Whether the path may begin beyond limits.

    """

    def __init__(
        self,
        curve: Curve,
        stretches: Stretches,
        payloads: Sequence[tuple[float, float]],
        parameters: Parameters,
        returning: bool = False,
    ) -> None:
        self.curve, self._parameters = curve, parameters
        self._stretches, self._payloads, self._returning = tuple(stretches), payloads, returning
        self._lay_out(0.0)

    def _lay_out(self, step_m: float) -> None:
        """Evaluate path and limits on the grid, or on the fine grid that begins with a step [m]."""
        self._is_fine = step_m > 0.0
        changes, carried = zip(*self._payloads, strict=True)
        table, length = self.curve.segments.tobytes(), self.curve.length_m
        course = Course(table, length, self._stretches, changes[1:], step_m, self.curve)
        self.distance, self.places, self.samples, payload, limits = laid_out(course)
        speed, self.acceleration, self.jerk = limits
        self.speed = np.minimum(speed, self._parameters.motion.tcp_speed_limit_m_s)
        self._coefficients = legal_coefficients(
            self.places, self.samples, payload, carried, self._parameters, self._returning
        )
        self._evaluated: tuple[Floats, PathDynamics] | None = None

    def dynamics(self, phases: Floats) -> PathDynamics:
        """Evaluate a master on both sides of the places of the grid; of the same phases once."""
        if self._evaluated is None or self._evaluated[0] is not phases:
            self._evaluated = phases, self._dynamics(phases)
        return self._evaluated[1]

    def _dynamics(self, phases: Floats) -> PathDynamics:
        times, master = self._master(phases)
        return timed_dynamics(times, master, self.samples, self._coefficients, self._parameters)

    def _master(self, phases: Floats) -> tuple[Floats, Floats]:
        """Times and master at the places of the grid, shapes (n,) and (n, 4)."""
        passed = master_at_distances(self.places, phases)
        master = np.ascontiguousarray(passed[:, 1:])
        # the end is reached, as the start is left, with the acceleration and the jerk of the phase beside it
        master[-1, 2], master[-1, 3] = end_acceleration(phases), phases[-2, 4]
        return passed[:, 0], master

    def limit_violation(self, dynamics: PathDynamics) -> LimitViolation:
        """Compare a timed motion with the limits of the grid."""
        return limit_violation(dynamics, self._parameters, (self.speed, self.acceleration, self.jerk))

    def place_limits(
        self, with_motors: bool, speed: Floats, acceleration: Floats
    ) -> time_parametrization.PlaceLimits:
        """Limits of every place for ``timing``."""
        motor, coefficients = self._parameters.motor, self._coefficients[::2]
        second = np.linalg.norm(self.samples[::2, 2], axis=1)
        third = worse_of_both(np.linalg.norm(self.samples[:, 3], axis=1))
        with np.errstate(divide='ignore'):
            caps = [
                speed,
                np.sqrt(CURVATURE_SHARE * acceleration / second),
                (JERK_SHARE * self.jerk[::2] / third) ** (1.0 / 3.0),
            ]
        torque = np.full((len(speed), 3), np.inf)
        if with_motors:
            shaft = np.abs(coefficients[:, RATE]) * self._parameters.dynamics.gear_ratio
            with np.errstate(divide='ignore'):
                caps.append((highest_motor_speed(self._parameters) / shaft).min(axis=1))
            fastest = np.minimum.reduce(caps)[:, None]
            friction = motor.static_friction_n_m + motor.viscous_friction_n_m_s_rad * shaft * fastest
            torque = motor.torque_constant_n_m_a * motor.peak_current_a - friction
        return time_parametrization.PlaceLimits(
            self.distance,
            np.minimum.reduce(caps),
            acceleration,
            second,
            np.ascontiguousarray(coefficients[:, INERTIAL]),
            np.ascontiguousarray(coefficients[:, CENTRIFUGAL]),
            np.ascontiguousarray(coefficients[:, WEIGHT]),
            torque,
        )

    def fastest(self, with_motors: bool) -> Floats:
        """Phases of the fastest master within the limits of every place.

        Where some places would make the whole move slower, or lower the speed beyond them, the grid is too coarse for
        their limits: the move is planned again on the fine grid.
        """
        if not self._is_fine:
            found = self._fastest_of_shares(with_motors)
            if found.is_local:
                return time_parametrization.slowed(found.phases, found.factor)
            self._share = found.share
            self._lay_out(self._first_step(with_motors))
        tried = (self._timed_finely(with_motors, self._share, one) for one in BEND_SHARES)
        found = min(tried, key=lambda one: one.duration_s)
        return time_parametrization.slowed(found.phases, found.factor)

    def _first_step(self, with_motors: bool) -> float:
        """First step of the fine grid [m]: it resolves the way in half a window where the limits are lowest."""
        speed, acceleration = self.speed[::2], self.acceleration[::2]
        lowest = float(self.place_limits(with_motors, speed, acceleration).speed_m_s.min())
        _, window = self._jerk_and_window(acceleration)
        return max(FINE_SHARE * window * lowest, FINE_MIN_M) if window else GRID_M

    def _fastest_of_shares(self, with_motors: bool) -> '_Timed':
        """Return the fastest timing on the present grid.

        A jerk-limited master on a short way cannot use all of the acceleration, and is faster if it does not try to.
        """
        jerk, most = float(self.jerk.min()), float(self.acceleration.max())
        if not math.isfinite(jerk):
            return self._timed(with_motors, 1.0)
        # the peak of the acceleration of a free master from rest to rest over this length
        share = min(float(np.cbrt(0.5 * jerk**2 * self.curve.length_m)) / most, 1.0)
        best = self._timed(with_motors, share)
        for _ in range(SHARES_MAX):
            share *= 0.5
            other = self._timed(with_motors, share)
            if other.duration_s >= best.duration_s:
                break
            best = other
        return best

    def _timed(self, with_motors: bool, share: float) -> '_Timed':
        """Return the fastest timing on the grid that uses no more than a share of the acceleration."""
        speed, acceleration = self.speed[::2].copy(), share * self.acceleration[::2]
        jerk, window = self._jerk_and_window(acceleration)
        best = _Timed(np.empty((0, 5)), math.inf, share, False)
        for n in range(ROUNDS_MAX):
            place_limits = self.place_limits(with_motors, speed, acceleration)
            profile = self._holdable(time_parametrization.fastest(place_limits, window), window)
            phases, jerk_found = time_parametrization.smoothed(self.distance, profile, jerk, window)
            stretch, _ = self._needed(with_motors, phases)
            factor = max(float(stretch.max()), 1.0)
            if math.isfinite(jerk):
                factor = max(factor, (jerk_found / jerk) ** (1.0 / 3.0))
            if factor < best.factor:
                best = _Timed(phases, factor, share, self._is_local(n, factor))
            if factor <= NEARLY_KEPT:
                break
            window *= max(jerk_found / jerk, 1.0) if math.isfinite(jerk) else 1.0
            worst = _spread(np.maximum(stretch, 1.0))
            relief = time_parametrization.widened(self.distance, worst, profile, window)
            speed /= relief
            acceleration /= relief**2
        return best

    def _timed_finely(self, with_motors: bool, share: float, bend_share: float) -> '_Timed':
        """Return the fastest timing on the fine grid, as ``_timed``; no place costs speed where its limits do not hold.

        Valleys of the speed in bends last as long as a share of the window at first. A limit of acceleration or jerk
        lowers the acceleration around its place, and the speed in bends only, as the speed between two limits of
        speed must not undershoot.
        """
        acceleration = share * self.acceleration[::2]
        jerk, window = self._jerk_and_window(acceleration)
        along = worse_of_both(
            np.linalg.norm(self.samples[:, 1], axis=1)
        )  # 1, but for the rounding of the path
        steady = self.speed[::2] / np.maximum(along, 1.0)
        speed = self.place_limits(with_motors, steady, acceleration).speed_m_s
        bent = speed < steady
        wider = 1.0 + 1.0 / FINE_TAPS  # the speed is interpolated between two samples of the average
        best = _Timed(np.empty((0, 5)), math.inf, share, False)
        for n in range(FINE_ROUNDS_MAX):
            place_limits = self.place_limits(with_motors, speed, acceleration)
            profile = time_parametrization.fastest(place_limits, wider * window, steady, bend_share)
            self._holdable(profile, window)
            phases, _ = time_parametrization.smoothed(self.distance, profile, jerk, window, FINE_TAPS)
            stretch, speed_used = self._needed(with_motors, phases)
            factor = max(float(stretch.max()), 1.0)
            if factor < best.factor:
                best = _Timed(phases, factor, share, True)
            if factor <= NEARLY_KEPT_FINE:
                break
            worst = np.maximum(stretch, 1.0)
            # the jerk at a place is the difference of the accelerations half a window before it and behind it
            reach = FINE_REACH * window
            acceleration /= time_parametrization.widened(self.distance, _spread(worst), profile, reach) ** 2
            if n < FINE_ROUNDS_STEADY:
                wider *= FINE_WIDER if ((speed_used > NEARLY_KEPT_FINE) & ~bent).any() else 1.0
                worst = np.where(bent, worst, 1.0)
            speed /= time_parametrization.widened(self.distance, _spread(worst), profile, window)
        return best

    def _jerk_and_window(self, acceleration: Floats) -> tuple[float, float]:
        """Jerk [m/s^3], and how long it takes to reach an acceleration by it [s]: 0 if it is infinite."""
        jerk = float(self.jerk.min())
        return jerk, max(float(acceleration.max()) / jerk, WINDOW_MIN_S) if math.isfinite(jerk) else 0.0

    def _holdable(self, profile: Floats, window: float) -> Floats:
        """Return a profile of the speed; refuse one that stands still somewhere, or takes too long."""
        if not len(profile) or not profile[1:-1].all():
            require_holdable(limit_violation(self._standing(), self._parameters))
            raise ProgramError('a motor cannot hold the arm somewhere on the path')
        require_end_of_time(time_parametrization.duration(self.distance, profile) + window)
        return profile

    def _needed(self, with_motors: bool, phases: Floats) -> tuple[Floats, Floats]:
        """Factor of time that each place asks for, and the share of the limit of speed there, shapes (n,)."""
        if with_motors:
            d = self.dynamics(phases)
            found = self.limit_violation(d)
            needed, speed = found.stretch, d.tcp_speed_m_s
            if not math.isfinite(found.worst):
                raise ProgramError(found.text)
        else:
            speed, acceleration, jerk = tcp_motion(self.samples, *self._master(phases)[1].T[1:])
            by_acceleration, by_jerk = np.sqrt(acceleration / self.acceleration), np.cbrt(jerk / self.jerk)
            needed = np.maximum.reduce([speed / self.speed, by_acceleration, by_jerk])
        stretch = np.maximum(worse_of_both(needed), self._stretch_at_joints(phases))
        return stretch, worse_of_both(speed / self.speed)

    def _is_local(self, rounds: int, factor: float) -> bool:
        """Whether no place costs speed elsewhere after so many rounds of lower limits."""
        if len(self._stretches) == 1:
            return factor <= NEARLY_KEPT
        return rounds == 0 and factor <= NEARLY_KEPT_BLENDED

    def bound_s(self) -> float:
        """Shortest time [s] that limits of speed and acceleration and the motors allow, whatever the jerk."""
        limits = self.place_limits(True, self.speed[::2], self.acceleration[::2])
        return time_parametrization.duration(self.distance, time_parametrization.fastest(limits))

    def _standing(self) -> PathDynamics:
        """Evaluate standstill at every place of the grid."""
        master = np.zeros((len(self.places), 4))
        master[:, 0] = self.places
        return timed_dynamics(master[:, 1], master, self.samples, self._coefficients, self._parameters)

    def stretch(self, phases: Floats) -> tuple[float, str]:
        """Factor of time that a master needs to keep every limit, below 1 if it keeps them all, and why."""
        found = self.limit_violation(self.dynamics(phases))
        return max(found.worst, float(self._stretch_at_joints(phases).max())), found.text

    def _stretch_at_joints(self, phases: Floats) -> Floats:
        """Factor of time that the TCP's limits ask for where phases meet, given to the places of the grid around."""
        t, s, v = np.diff(phases[:, 0]), phases[1:-1, 1], phases[1:-1, 2]
        samples = sample_path(s, self.curve.segments)
        after = np.searchsorted(self.distance, s).clip(1, len(self.distance) - 1)
        limit = 2 * after  # the same place among those of both sides
        stretch = np.ones(len(self.distance))
        end = phases[:-1, 3] + t * phases[:-1, 4]
        for a, j in ((phases[1:-1, 3], phases[1:-1, 4]), (end[:-1], phases[:-2, 4])):
            _, acceleration, jerk = tcp_motion(samples, v, a, j)
            by_jerk = np.cbrt(jerk / self.jerk[limit])
            needed = np.maximum(np.sqrt(acceleration / self.acceleration[limit]), by_jerk)
            np.maximum.at(stretch, after, needed)
            np.maximum.at(stretch, after - 1, needed)
        return stretch

    def load(self, phases: Floats) -> ThermalLoad:
        """Sum up what a master asks of the motors."""
        d = self.dynamics(phases)
        weights = np.gradient(d.time_s) if len(d.time_s) > 1 else np.ones(1)
        return thermal_load(d, weights, float(phases[-1, 0]), self._parameters)


def _spread(relief: Floats) -> Floats:
    """Return the larger of each value and its neighbours: a limit that moves a little still meets its place."""
    padded = np.pad(relief, 2, mode='edge')
    return np.asarray(np.maximum.reduce([padded[n : n + len(relief)] for n in range(5)]))
