"""Tests of the load of arms and motors on a path."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import (
    CURVATURE,
    RATE,
    THETA,
    path_coefficients,
    timed_dynamics,
)
from delta3_pacdrive.planning.paths.virtual_master import master_at_distances, plan_master, sample_master
from planned import GEAR, HOME, dwell, output, plan

CURVES = {
    'line': curves.line(HOME, (0.3, 0.2, -0.9)),
    'circle': curves.arc(HOME, (0.1, 0.1, -0.8), (0.2, -0.1, -0.9)),
    'spline': curves.spline([HOME, (0.1, 0.1, -0.8), (0.2, 0.0, -0.9), (0.1, -0.2, -0.8)]),
}


@pytest.mark.parametrize('kind', CURVES)
@pytest.mark.parametrize('payload_kg', [0.0, 0.5, 4.0])
def test_demand_is_the_derivative_of_inverse_kinematics_over_time(kind, payload_kg, robot):
    curve = CURVES[kind]
    master = plan_master(curve.length_m, 1.5, 15.0, 600.0)
    h = 1e-4
    times = np.linspace(0.01, master[-1, 0] - 0.01, 400)
    # away from the phases' ends, where the jerk jumps, and the pieces' joints, where the third derivative does
    at = sample_master(times, master)
    joints = np.concatenate([master_at_distances(curve.segments[:, 0], master)[:, 0], master[:, 0]])
    inner = np.abs(times[:, None] - joints).min(axis=1) > 2.0 * h
    times, at = times[inner], at[inner]
    samples = sample_path(at[:, 0], curve.segments)
    coefficients = path_coefficients(samples, np.zeros(len(at), np.int64), (payload_kg,), robot)
    d = timed_dynamics(times, at, samples, coefficients, robot)
    arm_speed = coefficients[:, RATE] * at[:, 1:2]
    arm_acceleration = coefficients[:, CURVATURE] * at[:, 1:2] ** 2 + coefficients[:, RATE] * at[:, 2:3]

    def theta_at(shift):
        s = sample_master(times + shift, master)[:, 0]
        return kinematics.inverse(sample_path(s, curve.segments)[:, 0], robot.kinematics)

    rate = (theta_at(h) - theta_at(-h)) / (2.0 * h)
    acceleration = (theta_at(h) + theta_at(-h) - 2.0 * theta_at(0.0)) / h**2
    assert np.abs(arm_speed - rate).max() < 1e-4  # second order in h
    assert np.abs(arm_acceleration - acceleration).max() < 1e-2
    assert np.array_equal(d.motor_speed_rad_s, GEAR * arm_speed)
    loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
    torque = dynamics.inverse(coefficients[:, THETA], arm_speed, arm_acceleration, loaded) / GEAR
    torque += 0.10 * np.tanh(d.motor_speed_rad_s) + 3.0e-4 * d.motor_speed_rad_s
    assert np.abs(d.motor_current_a - torque / 0.78).max() < 1e-9


def test_a_resting_robot_draws_the_holding_current(robot):
    planned = plan(robot, [dwell(0.25)])
    assert planned.rms_current_a == pytest.approx(
        [0.2782] * 3, abs=1e-4
    )  # the parameter study's 0.28 A at home
    move = planned.plan.move(0)
    assert (move.duration_s, move.length_m, move.kind) == (0.25, 0.0, MoveKind.DWELL)


@given(payload_kg=st.floats(0.0, 3.0))
def test_the_payload_weighs_on_the_motors(payload_kg, robot):
    theta = kinematics.inverse(HOME, robot.kinematics)
    weight = dynamics.gravity(theta, robot.replace(dynamics__payload_mass_kg=payload_kg)) / GEAR / 0.78
    for planned in (
        plan(robot, [dwell(1.0)], payload_kg=payload_kg),
        plan(robot, [output(payload_kg=payload_kg), dwell(1.0)]),
    ):
        assert planned.rms_current_a == pytest.approx(np.abs(weight).tolist(), rel=1e-3, abs=1e-4)
