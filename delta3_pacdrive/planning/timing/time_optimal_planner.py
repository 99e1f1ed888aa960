"""Planning of a time-optimal move: conversion of path and limits to the demand of the solver, and of its result.

Arguments of the kernels here:

``phases``
    Phases of a master, shape (n, 5): time [s], distance [m], speed [m/s], acceleration [m/s^2], jerk [m/s^3].
``coefficients``, ``by_distance``
    Demand of the path at the start of the phases, shape (n, 25) (``path_dynamics``), and derivatives of its
    inertial, centrifugal and weight torques by the distance, shape (n, 9).
``out``
    Receives the torque rates [N m/s] at both ends of each phase, shape (n - 1, 2, 3).
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import legal_coefficients, phase_voltage_max
from delta3_pacdrive.planning.limits.violations import joint_stretch, limit_violation, require_holdable
from delta3_pacdrive.planning.paths.curves import Curve
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    gear_coefficients,
    path_coefficients,
)
from delta3_pacdrive.planning.timing import time_optimal
from delta3_pacdrive.planning.timing.barrier import Demand, in_blocks
from delta3_pacdrive.planning.timing.move_grid import Stretches, limits_at, worse_of_both
from delta3_pacdrive.planning.timing.move_planner import NEARLY_KEPT, MovePlanner
from delta3_pacdrive.planning.timing.path_parameter import PathParameter, path_parameter
from delta3_pacdrive.planning.timing.time_parametrization import slowed

USED = 0.999  # of the motor limits, with a reserve for maxima between two grid points
# torque overshoots between grid points increase with the payload: additional reserve
LIGHT_KG, LESS_PER_KG = 4.0, 0.0035
JOINT_ROUNDS_MAX = 6  # of planning, with a lower limit of the acceleration where joints are overloaded
ROUNDS_MAX = 4  # of planning, with a lower jerk limit where it was exceeded between two grid points
SPREAD = 1  # number of grid points around such a position
CHANGE = 0.05  # largest relative change of y between two grid points, in addition to the grading of the grid
BESIDE_M = 1e-6  # half step of numerical derivatives by the distance
M, C = INERTIAL.start, CENTRIFUGAL.start  # first columns
SPEED_MAX = 1e9  # of the squared parameter speed, where the path has zero speed


class TimeOptimalPlanner(MovePlanner):
    """Planner of the fastest master on a path within motor and TCP limits, including jerk or torque rate.

    Parameters
    ----------
    torque_rate_n_m_s
        Largest torque rate of each motor [N m/s], friction excluded; inf: no limit.

    The other parameters are those of ``MovePlanner``.

    """

    def __init__(
        self,
        curve: Curve,
        stretches: Stretches,
        payloads: Sequence[tuple[float, float]],
        parameters: Parameters,
        torque_rate_n_m_s: float = math.inf,
        returning: bool = False,
    ) -> None:
        super().__init__(curve, stretches, payloads, parameters, returning)
        self._torque_rate = torque_rate_n_m_s
        heaviest_kg = max(payload_kg for _, payload_kg in payloads)
        self._torque_used = USED - LESS_PER_KG * max(heaviest_kg - LIGHT_KG, 0.0)
        self._with_gears = False  # whether the torques of the gears are limited
        self._parameter = path_parameter(curve)
        self._samples = sample_path(self._parameter.distance_m, curve.segments)
        self._piece = np.searchsorted(curve.segments[:, 0], self._parameter.distance_m, side='right') - 1
        changes, carried = zip(*payloads, strict=True)
        self._payload = np.searchsorted(changes[1:], self._parameter.distance_m, side='right')
        self._demands = legal_coefficients(
            self._parameter.distance_m,
            self._samples,
            self._payload,
            payloads_kg=carried,
            parameters=parameters,
            returning=returning,
        )
        self._limits = limits_at(self._parameter.distance_m, stretches)
        self._by_distance = (
            self._derivatives(carried) if math.isfinite(torque_rate_n_m_s) else np.empty((0, 9))
        )

    def fastest_of_third_order(self, heat: float = 0.0) -> Floats:
        """Return the phases of the fastest master; ``heat`` is the weight of the motor losses.

        Raises
        ------
        ProgramError
            A motor cannot hold its arm somewhere on the path.

        """
        points = len(self._parameter.u)
        demand, jerk_share = self._demand(), np.ones(points)
        before: Floats | None = None
        best, chosen = math.inf, np.empty((0, 5))
        # an inactive bound changes the result by its rounding: those of TCP speed and gears apply only if needed
        spline = time_optimal.fastest(self._lowered(demand, jerk_share), points, heat)
        highest = self._parameters.motion.tcp_speed_limit_m_s
        if len(spline) and _phases(spline, self._parameter)[:, 2].max() > highest:
            self._limits = (np.minimum(self._limits[0], highest), *self._limits[1:])
            demand = self._demand()
            spline = time_optimal.fastest(self._lowered(demand, jerk_share), points, heat)
        if len(spline) and self._exceeds_gears(spline):
            self._with_gears = True
            demand = self._demand()
            spline = time_optimal.fastest(self._lowered(demand, jerk_share), points, heat)
        for _ in range(JOINT_ROUNDS_MAX):
            if not len(spline) or not self._relieves_joints(spline):
                break
            demand = self._demand()
            spline = time_optimal.fastest(self._lowered(demand, jerk_share), points, heat)
        for n in range(ROUNDS_MAX):
            if n:
                spline = time_optimal.fastest(self._lowered(demand, jerk_share), points, heat, before)
            if not len(spline):
                require_holdable(limit_violation(self._standing(), self._parameters))
                raise ProgramError('a motor cannot hold the arm somewhere on the path')
            phases = _phases(spline, self._parameter)
            stretch = self._third_order_stretch(phases)
            found = max(float(stretch.max()), 1.0)
            if phases[-1, 0] * found < best:
                best, chosen = float(phases[-1, 0]) * found, slowed(phases, found)
            if found <= NEARLY_KEPT:
                break
            jerk_share /= _widened(np.maximum(stretch, 1.0)) ** 3
            before = spline / found**2
        return chosen

    def _exceeds_gears(self, spline: Floats) -> bool:
        """Return whether a motion exceeds the acceleration torque of a gear."""
        if not self._parameters.gear.limit_moves:
            return False
        found = self.dynamics(_phases(spline, self._parameter)).gear_torque_n_m
        return bool(np.abs(found).max() > self._parameters.gear_torque_max_n_m)

    def _relieves_joints(self, spline: Floats) -> bool:
        """Lower the limit of the TCP acceleration where a motion overloads rods, joints or plate; whether it does."""
        if not self._parameters.joints.limit_moves:
            return False
        d = self.dynamics(_phases(spline, self._parameter))
        found = self._at_parameter(worse_of_both(joint_stretch(d, self._parameters)))
        if found.max() <= NEARLY_KEPT:
            return False
        reached = self._at_parameter(worse_of_both(d.tcp_acceleration_m_s2))
        allowed = np.where(found > 1.0, reached / _widened(found) ** 2, np.inf)
        speed, acceleration, jerk = self._limits
        self._limits = speed, np.minimum(acceleration, allowed), jerk
        return True

    def _at_parameter(self, values: Floats) -> Floats:
        """Return values on the grid of distances, at least the adjacent ones, at the grid points of the parameter."""
        distance = self._parameter.distance_m
        found = np.interp(distance, self.distance, values)
        after = np.searchsorted(distance, self.distance)
        np.maximum.at(found, after, values)
        np.maximum.at(found, np.maximum(after - 1, 0), values)
        return found

    def torque_rates(self, phases: Floats) -> Floats:
        """Return the torque rate of each motor [N m/s] at both ends of each grid step, (n - 1, 2, 3), without friction.

        ``phases`` are those of a master with one phase per grid step.
        """
        out = np.empty((len(phases) - 1, 2, 3))
        _torque_rates(np.ascontiguousarray(phases), self._demands, self._by_distance, out)
        return out

    def _derivatives(self, carried: tuple[float, ...]) -> Floats:
        """Return derivatives of inertial, centrifugal and weight torques by the distance, (n, 9), on one path piece."""
        s, segments = self._parameter.distance_m, self.curve.segments
        edges = np.append(segments[:, 0], self.curve.length_m)
        before = np.maximum(s - BESIDE_M, edges[self._piece])
        after = np.minimum(s + BESIDE_M, edges[self._piece + 1])
        columns = np.r_[INERTIAL, CENTRIFUGAL, WEIGHT]
        low, high = (
            path_coefficients(sample_path(one, segments), self._payload, carried, self._parameters)[
                :, columns
            ]
            for one in (before, after)
        )
        return np.asarray((high - low) / (after - before)[:, None])

    def _lowered(self, demand: Demand, jerk_share: Floats) -> Demand:
        """Return a demand with jerk and torque rate relative to their limits, each reduced to a share."""
        jerk, rate = (
            in_blocks(limit * jerk_share)[:, None, None] for limit in (self._limits[2], self._torque_rate)
        )
        return demand._replace(jerked=demand.jerked / jerk, rated=demand.rated / rate)

    def _demand(self) -> Demand:
        """Return the demand of the path relative to its limits, except jerk [m/s^3] and torque rate [N m/s]."""
        p, c, motor = self._parameter, self._demands, self._parameters.motor
        speed, acceleration, jerk = self._limits
        s1, s2, s3 = p.first[:, None], p.second[:, None], p.third[:, None]
        per_y = c[:, INERTIAL] * s2 + c[:, CENTRIFUGAL] * s1**2
        per_change = 0.5 * c[:, INERTIAL] * s1
        shaft = self._parameters.dynamics.gear_ratio * c[:, RATE] * s1
        amount = c[:, WEIGHT] + motor.static_friction_n_m * np.sign(shaft)
        torque = np.stack([per_y, per_change, amount, motor.viscous_friction_n_m_s_rad * shaft], axis=2)
        ohms = motor.winding_resistance_ohm / 2.0 / motor.torque_constant_n_m_a
        voltage = ohms * torque
        voltage[:, :, 3] += motor.torque_constant_n_m_a / 3.0 * shaft
        peak = motor.torque_constant_n_m_a * motor.peak_current_a
        volts = phase_voltage_max(self._parameters)
        bounds = [torque / peak / self._torque_used, voltage / volts / USED]
        if self._with_gears:
            inertial, centrifugal, weight = gear_coefficients(c, self._parameters)
            per_gear = inertial * s2 + centrifugal * s1**2
            gears = np.stack([per_gear, 0.5 * inertial * s1, weight, np.zeros_like(weight)], axis=2)
            bounds.append(gears / self._parameters.gear_torque_max_n_m / self._torque_used)
        bounded = np.concatenate(bounds, axis=1)
        with np.errstate(divide='ignore'):
            turns = (USED * self._parameters.shaft_speed_max_rad_s / np.abs(shaft)).min(axis=1)
            square_max = np.minimum(np.minimum(turns, speed / p.first), math.sqrt(SPEED_MAX)) ** 2
        _, first, second, third = np.moveaxis(self._samples, 1, 0)
        count = len(p.u)
        accelerated, jerked, rated = np.empty((count, 0, 2)), np.empty((count, 0, 3)), np.empty((count, 0, 4))
        if np.isfinite(acceleration).any():
            accelerated = np.zeros((count, 2, 2))
            accelerated[:, 0] = np.stack([p.second, 0.5 * p.first], axis=1)
            accelerated[:, 1, 0] = np.linalg.norm(second, axis=1) * p.first**2
            accelerated /= acceleration[:, None, None]
        if np.isfinite(jerk).any():
            rows = [
                np.stack(
                    [
                        first * s3 + 3.0 * second * s1 * s2 + side * s1**3,
                        1.5 * first * s2 + 1.5 * second * s1**2,
                        0.5 * first * s1,
                    ],
                    axis=2,
                )
                for side in _both_sides(third, self._piece)
            ]
            jerked = np.concatenate(rows, axis=1)
        if math.isfinite(self._torque_rate):
            rows = []
            for side in _both_sides(self._by_distance, self._piece):
                m, bend, weight = side[:, :3], side[:, 3:6], side[:, 6:]
                by_y = m * s1 * s2 + c[:, INERTIAL] * s3 + bend * s1**3 + 2.0 * c[:, CENTRIFUGAL] * s1 * s2
                by_change = 0.5 * (m * s1**2 + c[:, INERTIAL] * s2)
                rows.append(np.stack([by_y, per_y + by_change, per_change, weight * s1], axis=2))
            rated = np.concatenate(rows, axis=1)
        change_max = CHANGE * (count - 1) + 2.0 * p.grading
        parts = (square_max, change_max, bounded, accelerated, jerked, rated)
        return Demand(*(in_blocks(part) for part in parts))

    def _third_order_stretch(self, phases: Floats) -> Floats:
        """Return the time stretch that each grid point of the parameter needs to respect all limits."""
        found = self.limit_violation(self.dynamics(phases))
        places = np.maximum(worse_of_both(found.stretch), self._stretch_at_joints(phases))
        stretch = self._at_parameter(places)
        if math.isfinite(self._torque_rate):
            needed = np.cbrt(np.abs(self.torque_rates(phases)).max(axis=(1, 2)) / self._torque_rate)
            stretch[1:] = np.maximum(stretch[1:], needed)
            stretch[:-1] = np.maximum(stretch[:-1], needed)
        return stretch


@kernel
def _torque_rates(phases, coefficients, by_distance, out):
    """Torque rate of each motor at both ends of each phase."""
    for n in range(out.shape[0]):
        t, jerk, start = phases[n + 1, 0] - phases[n, 0], phases[n, 4], phases[n, 3]
        for end in range(2):
            v, a = phases[n + end, 2], start + t * jerk if end == 1 else start
            for i in range(3):
                m, c = coefficients[n + end, M + i], coefficients[n + end, C + i]
                along = by_distance[n + end, i] * a + by_distance[n + end, 3 + i] * (v * v)
                along += by_distance[n + end, 6 + i]
                out[n, end, i] = v * along + m * jerk + 2.0 * c * v * a


def _both_sides(values: Floats, piece: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return values on both sides of each point, which differ at the ends of path pieces."""
    before, after = values.copy(), values.copy()
    (last,) = np.nonzero(np.diff(piece))  # last points of their pieces
    before[last + 1], after[last] = values[last], values[last + 1]
    return before, after


def _widened(values: Floats) -> Floats:
    """Return the maximum of each value and its neighbours."""
    padded = np.pad(values, SPREAD, mode='edge')
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * SPREAD + 1).max(axis=1))


def _phases(c: Floats, p: PathParameter) -> Floats:
    """Return the phases (n, 5) of the master of a spline y, with linear acceleration between grid points."""
    y = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0
    middle = (c[:-3] + 23.0 * (c[1:-2] + c[2:-1]) + c[3:]) / 48.0
    h = p.u[1]
    slowness = 1.0 / np.sqrt(y)
    steps = h / 6.0 * (slowness[1:] + slowness[:-1] + 4.0 / np.sqrt(middle))
    times = np.concatenate([[0.0], np.cumsum(steps)])
    acceleration = p.second * y + 0.25 * p.first * (c[2:] - c[:-2]) / h
    acceleration[0] = acceleration[-1] = 0.0
    # distribute the remaining final speed over the path, least at both ends
    bump = times * (times[-1] - times)
    left = (steps * (acceleration[1:] + acceleration[:-1])).sum() / (steps * (bump[1:] + bump[:-1])).sum()
    acceleration -= left * bump
    jerk = np.diff(acceleration) / steps
    speed = np.concatenate([[0.0], np.cumsum(0.5 * steps * (acceleration[1:] + acceleration[:-1]))])
    way = np.concatenate(
        [[0.0], np.cumsum(steps * (speed[:-1] + steps * (acceleration[:-1] / 2.0 + steps * jerk / 6.0)))]
    )
    length = p.distance_m[-1]
    scale = length / way[-1]
    rows = np.zeros((len(times), 5))
    rows[:, 0], rows[:, 1], rows[:, 2] = times, way * scale, speed * scale
    rows[:-1, 3], rows[:-1, 4] = acceleration[:-1] * scale, jerk * scale
    rows[-1, 1:] = length, 0.0, 0.0, 0.0
    return rows
