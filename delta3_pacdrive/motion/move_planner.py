"""The fastest master over a path that keeps every limit of the TCP and of the motors, with limited jerk."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import time_parametrization
from delta3_pacdrive.motion.curves import Curve
from delta3_pacdrive.motion.excess import Excess, excess, require_holdable
from delta3_pacdrive.motion.limits import Limits, highest_motor_speed, legal_coefficients
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

Stretches = Sequence[tuple[float, Limits]]  # of a move: ends [m], and the limits up to there
MOVE_MAX_S = 3600.0
SHARES_MAX = 6  # halvings of the share of the acceleration that a jerk-limited master uses
WINDOW_MIN_S = 1e-3  # shortest time in which a smoothed master changes its acceleration
GRID_MIN, GRID_MAX, GRID_M, GRID_PER_PIECE = 97, 4001, 2.5e-3, 8
BEFORE = 1e-9  # of a move's length: distance between both sides of a place
END_REFINEMENTS = 7  # halvings of the grid towards both ends, where a master starts and stops
# what is left after planning with local limits is taken from the time of the whole move
NEARLY_KEPT = 1.0 + 5e-4
ROUNDS_MAX = 8  # of planning with local limits, before all of the move is made slower
CURVATURE_SHARE, JERK_SHARE = 0.98, 0.8  # of the TCP's limits that may be used up by the path's bend alone


def limits_at(places_m: Floats, stretches: Stretches) -> tuple[Floats, Floats, Floats]:
    """Limits of speed, acceleration and jerk at places on a move, shape (n,)."""
    if len(stretches) == 1:
        only = stretches[0][1]
        every = (only.speed_m_s, only.acceleration_m_s2, only.jerk_m_s3)
        speed, acceleration, jerk = (np.full(len(places_m), limit, np.float64) for limit in every)
        return speed, acceleration, jerk
    # where a stretch ends and the next begins, both limits hold
    ends, limits = zip(*stretches, strict=True)
    table = np.array([astuple(one) for one in limits])
    before, after = (table[np.searchsorted(ends[:-1], places_m, side)] for side in ('left', 'right'))
    speed, acceleration, jerk = np.minimum(before, after).T.copy()
    return speed, acceleration, jerk


def grid(curve: Curve) -> Floats:
    """Distances at which a move is checked: even within each piece of the path, finer towards both ends of the move."""
    edges = np.append(curve.segments[:, 0], curve.length_m)
    lengths = np.diff(edges)
    step = curve.length_m / min(max(GRID_MIN, curve.length_m / GRID_M), GRID_MAX)
    counts = np.maximum(np.ceil(lengths / step), GRID_PER_PIECE).astype(int)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    inner = (np.repeat(edges[:-1], counts) + number * np.repeat(lengths / counts, counts))[1:]
    refined = min(inner[0], curve.length_m - inner[-1]) * 0.5 ** np.arange(END_REFINEMENTS, 0, -1)
    return np.concatenate([edges[:1], refined, inner, curve.length_m - refined[::-1], edges[-1:]])


def require_end_of_time(duration_s: float) -> None:
    """Refuse a move that would take too long; raises ProgramError."""
    if not duration_s <= MOVE_MAX_S:
        raise ProgramError(f'it would take {duration_s:.3g} s, the limit is {MOVE_MAX_S:g} s')


@dataclass(frozen=True)
class _Course:
    """A course is what of a move does not depend on the robot; two are equal if their paths are so to the last bit."""

    table: bytes  # of the path's pieces
    length_m: float
    stretches: tuple[tuple[float, Limits], ...]
    changes_m: tuple[float, ...]  # where other payloads begin to be carried
    curve: Curve = field(compare=False)


@lru_cache(maxsize=64)
def _laid_out(
    course: _Course,
) -> tuple[Floats, Floats, Floats, NDArray[np.int64], tuple[Floats, Floats, Floats]]:
    """Return grid, both sides of its places, samples, payloads and limits there; robots that differ share them."""
    distance = grid(course.curve)
    places = _both_sides(distance)
    samples = sample_path(places, course.curve.segments)
    payload = np.searchsorted(course.changes_m, places, side='right')
    return distance, places, samples, payload, limits_at(places, course.stretches)


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
        changes, carried = zip(*payloads, strict=True)
        course = _Course(curve.segments.tobytes(), curve.length_m, tuple(stretches), changes[1:], curve)
        self.distance, self.places, self.samples, payload, limits = _laid_out(course)
        self.speed, self.acceleration, self.jerk = limits
        self._coefficients = legal_coefficients(
            self.places, self.samples, payload, carried, parameters, returning
        )
        self._evaluated: tuple[Floats, PathDynamics] | None = None

    def dynamics(self, phases: Floats) -> PathDynamics:
        """Evaluate a master on both sides of the places of the grid; of the same phases once."""
        if self._evaluated is None or self._evaluated[0] is not phases:
            self._evaluated = phases, self._dynamics(phases)
        return self._evaluated[1]

    def _dynamics(self, phases: Floats) -> PathDynamics:
        passed = master_at_distances(self.places, phases)
        master = np.ascontiguousarray(passed[:, 1:])
        # the end is reached, as the start is left, with the acceleration and the jerk of the phase beside it
        master[-1, 2], master[-1, 3] = end_acceleration(phases), phases[-2, 4]
        return timed_dynamics(passed[:, 0], master, self.samples, self._coefficients, self._parameters)

    def excess(self, dynamics: PathDynamics) -> Excess:
        """Compare a timed motion with the limits of the grid."""
        return excess(dynamics, self._parameters, (self.speed, self.acceleration, self.jerk))

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

        A jerk-limited master on a short way cannot use all of the acceleration, and is faster if it does not try to.
        """
        jerk, most = float(self.jerk.min()), float(self.acceleration.max())
        if not math.isfinite(jerk):
            return self._fastest(with_motors, 1.0)
        # the peak of the acceleration of a free master from rest to rest over this length
        share = min(float(np.cbrt(0.5 * jerk**2 * self.curve.length_m)) / most, 1.0)
        best = self._fastest(with_motors, share)
        for _ in range(SHARES_MAX):
            share *= 0.5
            other = self._fastest(with_motors, share)
            if other[-1, 0] >= best[-1, 0]:
                break
            best = other
        return best

    def _fastest(self, with_motors: bool, share: float) -> Floats:
        """Phases of the fastest master that uses no more than a share of the acceleration."""
        speed, acceleration = self.speed[::2].copy(), share * self.acceleration[::2]
        jerk = float(self.jerk.min())
        window = max(float(acceleration.max()) / jerk, WINDOW_MIN_S) if math.isfinite(jerk) else 0.0
        best, chosen = math.inf, np.empty((0, 5))
        for _ in range(ROUNDS_MAX):
            profile = time_parametrization.fastest(
                self.place_limits(with_motors, speed, acceleration), window
            )
            if not len(profile) or not profile[1:-1].all():
                require_holdable(excess(self._standing(), self._parameters))
                raise ProgramError('a motor cannot hold the arm somewhere on the path')
            require_end_of_time(time_parametrization.duration(self.distance, profile) + window)
            phases, jerk_found = time_parametrization.smoothed(self.distance, profile, jerk, window)
            d = self.dynamics(phases)
            found = self.excess(d) if with_motors else Excess(self._tcp_stretch(d), str)
            stretch = np.maximum(worse_of_both(found.stretch), self._stretch_at_joints(phases))
            factor = max(
                float(stretch.max()), (jerk_found / jerk) ** (1.0 / 3.0) if math.isfinite(jerk) else 1.0, 1.0
            )
            if not math.isfinite(factor):
                raise ProgramError(found.text)
            if factor < best:
                best, chosen = factor, phases
            if factor <= NEARLY_KEPT:
                break
            window *= max(jerk_found / jerk, 1.0) if math.isfinite(jerk) else 1.0
            relief = time_parametrization.widened(
                self.distance, _spread(np.maximum(stretch, 1.0)), profile, window
            )
            speed /= relief
            acceleration /= relief**2
        return time_parametrization.slowed(chosen, best)

    def bound_s(self) -> float:
        """Shortest time [s] that limits of speed and acceleration and the motors allow, whatever the jerk."""
        limits = self.place_limits(True, self.speed[::2], self.acceleration[::2])
        return time_parametrization.duration(self.distance, time_parametrization.fastest(limits))

    def _standing(self) -> PathDynamics:
        """Evaluate standstill at every place of the grid."""
        master = np.zeros((len(self.places), 4))
        master[:, 0] = self.places
        return timed_dynamics(master[:, 1], master, self.samples, self._coefficients, self._parameters)

    def _tcp_stretch(self, d: PathDynamics) -> Floats:
        """Factor of time that the TCP's limits ask for at each place."""
        speed = d.tcp_speed_m_s / self.speed
        acceleration = np.sqrt(d.tcp_acceleration_m_s2 / self.acceleration)
        return np.asarray(np.maximum.reduce([speed, acceleration, np.cbrt(d.tcp_jerk_m_s3 / self.jerk)]))

    def stretch(self, phases: Floats) -> tuple[float, str]:
        """Factor of time that a master needs to keep every limit, below 1 if it keeps them all, and why."""
        found = self.excess(self.dynamics(phases))
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


def _both_sides(distance: Floats) -> Floats:
    """Return every place of a grid and, but for the first, the place right before it.

    Where a piece of the path or a phase of the master ends, acceleration and jerk differ on both sides.
    """
    before = np.maximum(distance[1:] - BEFORE * distance[-1], 0.5 * (distance[1:] + distance[:-1]))
    return np.concatenate([distance[:1], np.stack([before, distance[1:]], axis=1).ravel()])


def worse_of_both(values: Floats) -> Floats:
    """Return the larger of the values on both sides of each place of a grid."""
    return np.concatenate([values[:1], np.maximum(values[1::2], values[2::2])])


def _spread(relief: Floats) -> Floats:
    """Return the larger of each value and its neighbours: a limit that moves a little still meets its place."""
    padded = np.pad(relief, 2, mode='edge')
    return np.asarray(np.maximum.reduce([padded[n : n + len(relief)] for n in range(5)]))
