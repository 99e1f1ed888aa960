"""Timing of one move: the fastest jerk-limited master within all limits of TCP and motors."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import highest_motor_speed, legal_coefficients
from delta3_pacdrive.planning.limits.violations import LimitViolation, limit_violation, require_holdable
from delta3_pacdrive.planning.paths.curves import Curve
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    PathDynamics,
    gear_coefficients,
    tcp_motion,
    timed_dynamics,
)
from delta3_pacdrive.planning.paths.virtual_master import end_acceleration, master_at_distances
from delta3_pacdrive.planning.thermal_load import ThermalLoad, thermal_load
from delta3_pacdrive.planning.timing import time_parametrization
from delta3_pacdrive.planning.timing.move_grid import GRID_M, GridRequest, Stretches, grid_data, worse_of_both

MOVE_MAX_S = 3600.0
SHARES_MAX = 6  # halvings of the share of the acceleration that a jerk-limited master uses
WINDOW_MIN_S = 1e-3  # shortest smoothing window
# permitted violation after planning with local limits; the whole move is slowed down by it
NEARLY_KEPT = 1.0 + 5e-4
ROUNDS_MAX = 8  # of planning with local limits, before the whole move is slowed down
# a move of several statements with a larger violation is planned again on the fine grid
NEARLY_KEPT_BLENDED, NEARLY_KEPT_FINE = 1.0 + 1e-4, 1.0 + 2e-5
# rounds on the fine grid; in the first ones acceleration and jerk reduce the speed in bends only
FINE_ROUNDS_MAX, FINE_ROUNDS_STEADY = 24, 12
FINE_TAPS = 12  # minimum number of speed samples in a window
FINE_SHARE, FINE_MIN_M = (
    1 / 16,
    1e-6,
)  # first step relative to the distance in a window at the lowest speed, minimum
FINE_WIDER = 1.05  # widening of speed valleys per round, if the TCP is too fast next to one
FINE_REACH = 1.5  # windows around a point in which the acceleration is reduced
BEND_SHARES = 1.0, 0.25  # durations of speed valleys in bends that are tried, relative to the window
CURVATURE_SHARE, JERK_SHARE = 0.98, 0.8  # of the TCP limits that the curvature of the path may use


def require_duration(duration_s: float) -> None:
    """Raise ProgramError if a move takes too long."""
    if not duration_s <= MOVE_MAX_S:
        raise ProgramError(f'it would take {duration_s:.3g} s, the limit is {MOVE_MAX_S:g} s')


class _Timed(NamedTuple):
    """A timing of a move."""

    phases: Floats
    factor: float  # required time stretch
    share: float  # of the acceleration that it may use
    is_local: bool  # whether each limit affects the speed at its own position only

    @property
    def duration_s(self) -> float:
        return float(self.phases[-1, 0]) * self.factor


class MovePlanner:
    """Planner of one move: grid, demand and limits along its path.

    Parameters
    ----------
    curve
        The path.
    stretches
        End of each stretch [m] and its limits, in path order.
    payloads
        Position [m] from which a payload [kg] is carried, in path order.
    parameters
        The parameters of a robot.
    returning
        Whether the path may start beyond limits.

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
        """Evaluate path and limits on the grid, or with a first step [m] on the fine grid."""
        self._is_fine = step_m > 0.0
        changes, carried = zip(*self._payloads, strict=True)
        table, length = self.curve.segments.tobytes(), self.curve.length_m
        request = GridRequest(
            table, length, self._stretches, changes_m=changes[1:], step_m=step_m, curve=self.curve
        )
        self.distance, self.places, self.samples, payload, limits = grid_data(request)
        speed, self.acceleration, self.jerk = limits
        self._carried_kg = np.asarray(carried)[payload]
        self.speed = np.minimum(speed, self._parameters.motion.tcp_speed_limit_m_s)
        self._coefficients = legal_coefficients(
            self.places,
            self.samples,
            payload,
            payloads_kg=carried,
            parameters=self._parameters,
            returning=self._returning,
        )
        self._evaluated: tuple[Floats, PathDynamics] | None = None

    def dynamics(self, phases: Floats) -> PathDynamics:
        """Return the demand for a master on both sides of the grid points; cached for the last phases."""
        if self._evaluated is None or self._evaluated[0] is not phases:
            self._evaluated = phases, self._dynamics(phases)
        return self._evaluated[1]

    def _dynamics(self, phases: Floats) -> PathDynamics:
        times, master = self._master(phases)
        return self._demand_of(times, master)

    def _demand_of(self, times: Floats, master: Floats) -> PathDynamics:
        """Return the demand for times and master at the grid points."""
        robot = self._parameters
        return timed_dynamics(times, master, self.samples, self._coefficients, robot, self._carried_kg)

    def _master(self, phases: Floats) -> tuple[Floats, Floats]:
        """Return times and master at the grid points, shapes (n,) and (n, 4)."""
        passed = master_at_distances(self.places, phases)
        master = np.ascontiguousarray(passed[:, 1:])
        # at the end, use acceleration and jerk of the adjacent phase, as at the start
        master[-1, 2], master[-1, 3] = end_acceleration(phases), phases[-2, 4]
        return passed[:, 0], master

    def limit_violation(self, dynamics: PathDynamics) -> LimitViolation:
        """Compare a timed motion with the limits on the grid."""
        return limit_violation(dynamics, self._parameters, (self.speed, self.acceleration, self.jerk))

    def place_limits(
        self, with_motors: bool, speed: Floats, acceleration: Floats
    ) -> time_parametrization.PlaceLimits:
        """Return the limits at every grid point for ``time_parametrization``."""
        motor, coefficients = self._parameters.motor, self._coefficients[::2]
        second = np.linalg.norm(self.samples[::2, 2], axis=1)
        third = worse_of_both(np.linalg.norm(self.samples[:, 3], axis=1))
        with np.errstate(divide='ignore'):
            caps = [
                speed,
                np.sqrt(CURVATURE_SHARE * acceleration / second),
                (JERK_SHARE * self.jerk[::2] / third) ** (1.0 / 3.0),
            ]
        loads = [coefficients[:, INERTIAL], coefficients[:, CENTRIFUGAL], coefficients[:, WEIGHT]]
        torque = np.full((len(speed), 3), np.inf)
        if with_motors:
            shaft = np.abs(coefficients[:, RATE]) * self._parameters.dynamics.gear_ratio
            with np.errstate(divide='ignore'):
                caps.append((highest_motor_speed(self._parameters) / shaft).min(axis=1))
            fastest = np.minimum.reduce(caps)[:, None]
            friction = motor.static_friction_n_m + motor.viscous_friction_n_m_s_rad * shaft * fastest
            torque = motor.torque_constant_n_m_a * motor.peak_current_a - friction
            if self._parameters.gear.limit_moves:
                gears = gear_coefficients(coefficients, self._parameters)
                loads = [np.concatenate(pair, axis=1) for pair in zip(loads, gears, strict=True)]
                limit = np.full((len(speed), 3), self._parameters.gear_torque_max_n_m)
                torque = np.concatenate([torque, limit], axis=1)
        return time_parametrization.PlaceLimits(
            self.distance,
            np.minimum.reduce(caps),
            acceleration,
            curvature_1_m=second,
            inertial=np.ascontiguousarray(loads[0]),
            centrifugal=np.ascontiguousarray(loads[1]),
            weight=np.ascontiguousarray(loads[2]),
            torque_n_m=torque,
        )

    def fastest(self, with_motors: bool) -> Floats:
        """Return the phases of the fastest master within the limits at every grid point.

        If a limit would slow down the whole move, or reduce the speed away from its position, the grid is too coarse:
        the move is planned again on the fine grid.
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
        """Return the first step of the fine grid [m], which resolves half a window at the lowest speed."""
        speed, acceleration = self.speed[::2], self.acceleration[::2]
        lowest = float(self.place_limits(with_motors, speed, acceleration).speed_m_s.min())
        _, window = self._jerk_and_window(acceleration)
        return max(FINE_SHARE * window * lowest, FINE_MIN_M) if window else GRID_M

    def _fastest_of_shares(self, with_motors: bool) -> '_Timed':
        """Return the fastest timing on the current grid.

        On a short path a jerk-limited master cannot reach the full acceleration, and is faster with a part of it.
        """
        jerk, most = float(self.jerk.min()), float(self.acceleration.max())
        if not math.isfinite(jerk):
            return self._timed(with_motors, 1.0)
        # peak acceleration of an unconstrained jerk-limited master from rest to rest over this length
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
        """Return the fastest timing on the grid that uses at most a share of the acceleration."""
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
        """Return the fastest timing on the fine grid, as ``_timed``, without speed losses away from active limits.

        Speed valleys in bends initially last for a share of the window. An active acceleration or jerk limit reduces
        the acceleration around its position, but the speed in bends only: between two speed limits it must not
        undershoot.
        """
        acceleration = share * self.acceleration[::2]
        jerk, window = self._jerk_and_window(acceleration)
        along = worse_of_both(np.linalg.norm(self.samples[:, 1], axis=1))  # 1 within rounding
        steady = self.speed[::2] / np.maximum(along, 1.0)
        speed = self.place_limits(with_motors, steady, acceleration).speed_m_s
        bent = speed < steady
        wider = 1.0 + 1.0 / FINE_TAPS  # the average is interpolated between two speed samples
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
            # the jerk depends on the accelerations half a window before and after
            reach = FINE_REACH * window
            acceleration /= time_parametrization.widened(self.distance, _spread(worst), profile, reach) ** 2
            if n < FINE_ROUNDS_STEADY:
                wider *= FINE_WIDER if ((speed_used > NEARLY_KEPT_FINE) & ~bent).any() else 1.0
                worst = np.where(bent, worst, 1.0)
            speed /= time_parametrization.widened(self.distance, _spread(worst), profile, window)
        return best

    def _jerk_and_window(self, acceleration: Floats) -> tuple[float, float]:
        """Return the jerk [m/s^3] and the time to reach an acceleration with it [s]; 0 if the jerk is unlimited."""
        jerk = float(self.jerk.min())
        return jerk, max(float(acceleration.max()) / jerk, WINDOW_MIN_S) if math.isfinite(jerk) else 0.0

    def _holdable(self, profile: Floats, window: float) -> Floats:
        """Return a speed profile; raises ProgramError if it stops within the path or takes too long."""
        if not len(profile) or not profile[1:-1].all():
            require_holdable(limit_violation(self._standing(), self._parameters))
            raise ProgramError('a motor cannot hold the arm somewhere on the path')
        require_duration(time_parametrization.duration(self.distance, profile) + window)
        return profile

    def _needed(self, with_motors: bool, phases: Floats) -> tuple[Floats, Floats]:
        """Return the required time stretch and the used share of the speed limit at each grid point, shapes (n,)."""
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
        """Whether no limit costs speed away from its position after a number of rounds."""
        if len(self._stretches) == 1:
            return factor <= NEARLY_KEPT
        return rounds == 0 and factor <= NEARLY_KEPT_BLENDED

    def bound_s(self) -> float:
        """Shortest time [s] within the limits of speed, acceleration and motors, without a jerk limit."""
        limits = self.place_limits(True, self.speed[::2], self.acceleration[::2])
        return time_parametrization.duration(self.distance, time_parametrization.fastest(limits))

    def _standing(self) -> PathDynamics:
        """Evaluate standstill at every grid point."""
        master = np.zeros((len(self.places), 4))
        master[:, 0] = self.places
        return self._demand_of(master[:, 1], master)

    def stretch(self, phases: Floats) -> tuple[float, str]:
        """Return the time stretch that a master requires, below 1 if all limits are kept, and the worst violation."""
        found = self.limit_violation(self.dynamics(phases))
        return max(found.worst, float(self._stretch_at_joints(phases).max())), found.text

    def _stretch_at_joints(self, phases: Floats) -> Floats:
        """Return the time stretch that TCP limits require at phase changes, assigned to the adjacent grid points."""
        t, s, v = np.diff(phases[:, 0]), phases[1:-1, 1], phases[1:-1, 2]
        samples = sample_path(s, self.curve.segments)
        after = np.searchsorted(self.distance, s).clip(1, len(self.distance) - 1)
        limit = 2 * after  # index on the grid with both sides
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
        """Return the thermal load of a master."""
        d = self.dynamics(phases)
        weights = np.gradient(d.time_s) if len(d.time_s) > 1 else np.ones(1)
        return thermal_load(d, weights, float(phases[-1, 0]), self._parameters)


def _spread(relief: Floats) -> Floats:
    """Return the maximum of each value and its neighbours, so that a slightly shifted limit is still covered."""
    padded = np.pad(relief, 2, mode='edge')
    return np.asarray(np.maximum.reduce([padded[n : n + len(relief)] for n in range(5)]))
