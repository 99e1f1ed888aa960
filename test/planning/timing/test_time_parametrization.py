"""Tests of the fastest master within limits that depend on the place, and of the moving average over its speed."""

import logging
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    path_coefficients,
)
from delta3_pacdrive.planning.paths.virtual_master import master_at_distances, plan_master, sample_master
from delta3_pacdrive.planning.timing import time_parametrization
from thoroughness import examples

ROUNDING = (
    1e-6  # relative; halvings of an interval of speeds, and differences of squares that are nearly equal
)
PLACES = 401
FREE = 1e9  # a limit that is never met


def limits_of(distance, speed=FREE, acceleration=FREE, curvature=0.0, motors=None):
    """Limits over a grid; ``motors`` are (inertial, centrifugal, weight, torque), without them no motor matters."""
    count = len(distance)
    columns = [
        np.broadcast_to(np.asarray(value, dtype=float), count).copy()
        for value in (speed, acceleration, curvature)
    ]
    if motors is None:
        motors = (0.0, 0.0, 0.0, FREE)
    tables = [
        np.ascontiguousarray(np.broadcast_to(np.asarray(value, dtype=float), (count, 3))) for value in motors
    ]
    return time_parametrization.PlaceLimits(distance, *columns, *tables)


def waves(rng, distance, low, high, axes=0):
    """Smooth random values between two bounds, shape (n,) or (n, axes)."""
    shape = (3, axes) if axes else (3,)
    phase, wave = rng.uniform(0.0, 2.0 * np.pi, shape), rng.uniform(0.5, 4.0, shape)
    x = distance / distance[-1] * 2.0 * np.pi
    x = x.reshape(-1, 1, 1) if axes else x[:, None]
    value = np.sin(wave * x + phase).mean(axis=1)
    return low + (high - low) * 0.5 * (1.0 + value)


def random_limits(seed, length):
    """Limits of a path that bends, and of motors that can always hold their weight with a third to spare."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, length, PLACES)
    torque = waves(rng, s, 5.0, 10.0, axes=3)
    return limits_of(
        s,
        waves(rng, s, 0.2, 3.0),
        waves(rng, s, 2.0, 30.0),
        waves(rng, s, -3.0, 20.0).clip(0.0),
        (
            waves(rng, s, -2.0, 2.0, axes=3),
            waves(rng, s, -3.0, 3.0, axes=3),
            waves(rng, s, -3.0, 3.0, axes=3),
            torque,
        ),
    )


def tangential(limits, speed):
    """Acceleration between neighbouring grid points, from the difference of the squares of the speed."""
    return np.diff(speed**2) / (2.0 * np.diff(limits.distance_m))


# fastest


@settings(max_examples=examples(60))
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0))
def test_the_fastest_master_keeps_every_limit_at_every_place(seed, length):
    limits = random_limits(seed, length)
    v = time_parametrization.fastest(limits)
    assert v[0] == v[-1] == 0.0
    assert (v[1:-1] > 0.0).all()
    assert (v <= limits.speed_m_s * (1.0 + ROUNDING)).all()
    a = tangential(limits, v)
    x = v[:-1] ** 2
    total = np.hypot(a, limits.curvature_1_m[:-1] * x)
    assert (total <= limits.acceleration_m_s2[:-1] * (1.0 + ROUNDING)).all()
    torque = limits.inertial[:-1] * a[:, None] + limits.centrifugal[:-1] * x[:, None] + limits.weight[:-1]
    assert (np.abs(torque) <= limits.torque_n_m[:-1] * (1.0 + ROUNDING)).all()


@settings(max_examples=examples(60))
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0))
def test_at_every_place_the_fastest_master_meets_a_limit(seed, length):
    """Bang-bang: speed, acceleration or a motor is at its limit everywhere, else it could be driven faster."""
    limits = random_limits(seed, length)
    v = time_parametrization.fastest(limits)
    a, x = tangential(limits, v), v[:-1] ** 2
    torque = limits.inertial[:-1] * a[:, None] + limits.centrifugal[:-1] * x[:, None] + limits.weight[:-1]
    used = np.maximum.reduce(
        [
            v[1:] / limits.speed_m_s[1:],
            np.hypot(a, limits.curvature_1_m[:-1] * x) / limits.acceleration_m_s2[:-1],
            (np.abs(torque) / limits.torque_n_m[:-1]).max(axis=1),
            # the speed itself may be bounded by the bend: nothing is left for an acceleration
            limits.curvature_1_m[1:] * v[1:] ** 2 / limits.acceleration_m_s2[1:],
            limits.curvature_1_m[:-1] * x / limits.acceleration_m_s2[:-1],
        ]
    )
    # where phases change, in one grid interval, less is used
    assert np.mean(used > 0.97) > 0.9


@settings(max_examples=examples(60))
@given(st.floats(0.01, 2.0), st.floats(0.05, 10.0), st.floats(0.5, 200.0))
def test_on_a_free_line_it_is_the_trapezoid_of_the_closed_formula(length, speed, acceleration):
    limits = limits_of(np.linspace(0.0, length, PLACES), speed, acceleration)
    v = time_parametrization.fastest(limits)
    if length >= speed**2 / acceleration:
        expected = length / speed + speed / acceleration
    else:
        expected = 2.0 * math.sqrt(length / acceleration)
    # a corner of the speed falls between two grid points: at half speed, say, over one of them, at each end
    corners = 2.0 * limits.distance_m[1] / v.max()
    assert (
        expected * (1.0 - ROUNDING)
        <= time_parametrization.duration(limits.distance_m, v)
        <= expected + corners
    )
    along = np.minimum(limits.distance_m, length - limits.distance_m)
    assert np.abs(v - np.minimum(speed, np.sqrt(2.0 * acceleration * along))).max() < 1e-6 * speed + ROUNDING


@given(st.floats(0.02, 0.5), st.floats(1.0, 50.0))
def test_on_a_circle_it_is_the_closed_solution(radius, acceleration):
    """d(v^2)/ds = 2 sqrt(a^2 - (v^2/r)^2): v^2 = a r sin(2 s/r), until the circle takes all of the acceleration."""
    length = 2.5 * radius
    limits = limits_of(np.linspace(0.0, length, PLACES), FREE, acceleration, 1.0 / radius)
    cap = np.full(PLACES, math.sqrt(acceleration * radius))
    limits = limits_of(limits.distance_m, cap, acceleration, 1.0 / radius)
    along = np.minimum(limits.distance_m, length - limits.distance_m) / radius
    expected = acceleration * radius * np.sin(2.0 * np.minimum(along, np.pi / 4.0))
    found = time_parametrization.fastest(limits) ** 2
    # one step of the grid is 2.5 r / 400 long, and the square of the speed rises by 2 a on it
    assert np.abs(found - expected).max() < 2.0 * acceleration * 2.5 * radius / 400


def test_motors_that_cannot_hold_their_weight_have_no_master():
    s = np.linspace(0.0, 1.0, 50)
    weight = np.where((s > 0.4) & (s < 0.6), 2.0, 0.5)[:, None] * np.ones(3)
    assert len(time_parametrization.fastest(limits_of(s, 1.0, 10.0, 0.0, (0.0, 0.0, weight, 1.0)))) == 0
    assert (
        len(time_parametrization.fastest(limits_of(s, 1.0, 10.0, 0.0, (0.0, 0.0, 0.49 * weight, 1.0)))) == 50
    )


@pytest.mark.parametrize(
    'curve',
    [
        curves.arc((-0.3, 0.0, -0.8), (0.0, 0.3, -0.9), (0.3, 0.0, -0.8)),
        curves.spline(
            [(0, 0, -0.75), (0.2, 0.1, -0.9), (0.1, -0.2, -0.8), (-0.3, 0, -0.85), (0, 0.3, -0.75)]
        ),
        curves.line((-0.3, 0.0, -0.8), (0.3, 0.2, -0.9)),
    ],
    ids=['arc', 'spline', 'line'],
)
def test_with_motor_limits_it_is_as_fast_as_toppra_finds(curve, robot):
    """Second engine: TOPP-RA on the path of the arm angles, with the torques of ``dynamics.inverse``."""
    toppra = pytest.importorskip('toppra')
    toppra.setup_logging('ERROR')
    logging.getLogger('toppra').setLevel(logging.ERROR)
    s = np.linspace(0.0, curve.length_m, PLACES)
    gear = robot.dynamics.gear_ratio
    torque = 0.3 * robot.motor.peak_current_a * robot.motor.torque_constant_n_m_a
    arm_speed = 0.6 * robot.motor.max_speed_rad_s / gear

    payload = robot.dynamics.payload_mass_kg
    coefficients = path_coefficients(
        sample_path(s, curve.segments), np.zeros(PLACES, np.int64), (payload,), robot
    )
    cap = (arm_speed / np.abs(coefficients[:, RATE])).min(axis=1)
    motors = (coefficients[:, INERTIAL], coefficients[:, CENTRIFUGAL], coefficients[:, WEIGHT], torque)
    ours = time_parametrization.duration(s, time_parametrization.fastest(limits_of(s, cap, motors=motors)))

    fine = np.linspace(0.0, curve.length_m, 2001)
    theta = kinematics.inverse(sample_path(fine, curve.segments)[:, 0], robot.kinematics)
    both = np.array([[-1.0, 1.0]] * 3)
    constraints = [
        toppra.constraint.JointVelocityConstraint(arm_speed * both),
        toppra.constraint.JointTorqueConstraint(
            lambda q, qd, qdd: dynamics.inverse(q, qd, qdd, robot) / gear,
            torque * both,
            np.zeros(3),
            discretization_scheme=toppra.constraint.DiscretizationType.Collocation,
        ),
    ]
    path = toppra.SplineInterpolator(fine, theta)
    engine = toppra.algorithm.TOPPRA(constraints, path, gridpoints=s, solver_wrapper='seidel')
    _, speed, _ = engine.compute_parameterization(0.0, 0.0)
    theirs = float((2.0 * np.diff(s) / (speed[1:] + speed[:-1])).sum())
    assert ours == pytest.approx(theirs, rel=1e-3)  # their path is a spline through the angles


# smoothed


def steps_of_speed(rng, length):
    """A grid with stretches of different speed limits."""
    s = np.linspace(0.0, length, PLACES)
    edges = np.sort(rng.uniform(0.0, length, 4))
    return s, rng.uniform(0.2, 2.0, 5)[np.searchsorted(edges, s)]


@settings(max_examples=examples(60))
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 2.0), st.floats(2.0, 30.0), st.floats(100.0, 5000.0))
def test_a_smoothed_master_keeps_speed_acceleration_and_jerk_from_rest_to_rest(
    seed, length, acceleration, jerk
):
    window = acceleration / jerk
    s, speed = steps_of_speed(np.random.default_rng(seed), length)
    profile = time_parametrization.fastest(limits_of(s, speed, acceleration), window)
    phases, found = time_parametrization.smoothed(s, profile, jerk, window)
    assert phases[0, :3].tolist() == [0.0, 0.0, 0.0]
    assert phases[-1].tolist()[1:] == [length, 0.0, 0.0, 0.0]
    times = np.linspace(0.0, phases[-1, 0], 2000)
    d, v, a, j = sample_master(times, phases).T
    assert np.abs(a).max() <= acceleration * 1.001  # stretched to the exact length
    assert (v >= -1e-9).all()
    assert (np.diff(d) >= -1e-12).all()
    assert np.abs(j).max() <= found * (1.0 + ROUNDING)
    # peaks and valleys last as long as the window only to a grid point; never is a whole step more than from -a to a
    assert found <= 2.002 * jerk
    # the limit of the place holds, within the length of one grid interval
    near = np.maximum(np.interp(d - s[1], s, speed), np.interp(d + s[1], s, speed))
    assert (v <= np.maximum(near, np.interp(d, s, speed)) * 1.01).all()


@settings(max_examples=examples(60))
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 2.0), st.floats(2.0, 30.0), st.floats(100.0, 5000.0))
def test_a_smoothed_master_has_no_jump(seed, length, acceleration, jerk):
    window = acceleration / jerk
    s, speed = steps_of_speed(np.random.default_rng(seed), length)
    phases, _ = time_parametrization.smoothed(
        s, time_parametrization.fastest(limits_of(s, speed, acceleration), window), jerk, window
    )
    t = np.diff(phases[:, 0])
    _, d, v, a, j = phases[:-1].T
    assert (t > 0.0).all()
    assert np.abs(d + t * (v + t * (a / 2.0 + t * j / 6.0)) - phases[1:, 1]).max() < 1e-9 * length
    assert np.abs(v + t * (a + t * j / 2.0) - phases[1:, 2]).max() < 1e-9
    assert np.abs(a + t * j - phases[1:, 3]).max() < 1e-6 * acceleration


@given(st.floats(0.1, 2.0), st.floats(0.2, 2.0), st.floats(2.0, 30.0), st.floats(100.0, 5000.0))
def test_duration_of_smoothing_on_a_free_line_agrees_with_the_closed_formula(
    length, speed, acceleration, jerk
):
    """The jerk-limited master that reaches its speed takes a/j longer: the moving average of it is that master."""
    jerk = max(jerk, 1.001 * acceleration**2 / speed)
    window = acceleration / jerk
    assume(length > 1.001 * speed * (speed / acceleration + window))
    s = np.linspace(0.0, length, PLACES)
    profile = time_parametrization.fastest(limits_of(s, speed, acceleration), window)
    phases, _ = time_parametrization.smoothed(s, profile, jerk, window)
    expected = plan_master(length, speed, acceleration, jerk)
    # one grid interval at each end may be driven at half speed; the even samples of the average end up to one later
    corners = 2.0 * s[1] / speed + time_parametrization.SAMPLE_S
    assert expected[-1, 0] * (1.0 - ROUNDING) <= phases[-1, 0] <= expected[-1, 0] + corners
    # and it is that master, but for the corners: as far behind it at half of the way as they take time
    middle = [master_at_distances([0.5 * length], rows)[0] for rows in (phases, expected)]
    assert abs(middle[0][0] - middle[1][0]) <= corners
    assert middle[0][2] == pytest.approx(speed, rel=1e-2)


@given(st.integers(0, 2**32 - 1))
def test_smoothing_is_the_moving_average_over_time(seed):
    rng = np.random.default_rng(seed)
    s, speed = steps_of_speed(rng, 1.0)
    window = rng.uniform(0.02, 0.1)
    profile = time_parametrization.fastest(limits_of(s, speed, 10.0), window)
    phases, _ = time_parametrization.smoothed(s, profile, 10.0 / window, window)
    # the same by brute force, on a grid of 1/4000 of the time
    at = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(s) / (profile[1:] + profile[:-1]))])
    times = np.linspace(0.0, phases[-1, 0], 4001)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (profile[1:] + profile[:-1]) * np.diff(at))])

    def way_at(t):
        n = np.clip(np.searchsorted(at, t, side='right') - 1, 0, len(s) - 2)
        u = np.clip(t - at[n], 0.0, at[n + 1] - at[n])
        slope = (profile[n + 1] - profile[n]) / (at[n + 1] - at[n])
        return way[n] + u * (profile[n] + 0.5 * u * slope)

    averaged = (way_at(times) - way_at(times - window)) / window
    # up to 4 ms lie between the samples of the average: the speed between them is off by a t^2 / 8
    assert np.abs(sample_master(times, phases)[:, 1] - averaged).max() < 10.0 * 4e-3**2 + 0.005 * speed.max()


@given(st.integers(0, 2**32 - 1))
def test_without_a_window_the_accelerations_keep_their_steps(seed):
    s, speed = steps_of_speed(np.random.default_rng(seed), 1.0)
    profile = time_parametrization.fastest(limits_of(s, speed, 10.0))
    phases, jerk = time_parametrization.smoothed(s, profile, math.inf, 0.0)
    assert jerk == 0.0
    assert not phases[:, 4].any()
    assert phases[-1, 0] == pytest.approx(time_parametrization.duration(s, profile), rel=1e-12)
    assert np.abs(phases[:, 3]).max() <= 10.0 * (1.0 + ROUNDING)
    assert phases[-1, 1] == 1.0


@given(
    st.floats(1.0, 100.0),
    st.floats(0.01, 2.0),
    st.floats(0.05, 10.0),
    st.floats(0.5, 200.0),
    st.floats(10.0, 1e5),
)
def test_a_slowed_master_passes_the_same_places_later_by_a_factor(factor, length, speed, acceleration, jerk):
    phases = plan_master(length, speed, acceleration, jerk)
    slow = time_parametrization.slowed(phases, factor)
    times = np.linspace(0.0, phases[-1, 0], 100)
    s, v, a, j = sample_master(times, phases).T
    slow_s, slow_v, slow_a, slow_j = sample_master(times * factor, slow).T
    assert slow[-1, 0] == pytest.approx(factor * phases[-1, 0], rel=1e-12)
    assert np.abs(slow_s - s).max() < 1e-9 * length
    assert np.abs(slow_v * factor - v).max() < 1e-9 * speed
    assert np.abs(slow_a * factor**2 - a)[:-1].max() < 1e-6 * acceleration
    assert set(np.round(slow[:, 4] * factor**3 / jerk, 6)) <= {-1.0, 0.0, 1.0}
    assert slow_j.shape == j.shape
