"""Tests of time-optimal moves of the coupled robot: drives, motors and arms against the plan."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning.limits.gear_load import OVERLOADED
from delta3_pacdrive.planning.limits.limits import phase_voltage_max
from delta3_pacdrive.planning.program.file_reader import load
from delta3_pacdrive.studies.runs.derived_signals import added

OVER = 1.01  # of a limit: what the loops add to the commanded torque
HEIGHT_M = 0.045


def pick(start, end, payload_kg, limits):
    """Return a program from one place to another in an arch of three lines."""
    (x, y, z), (to_x, to_y, to_z) = start, end
    return f"""
limits: {{{limits}}}
payload_kg: {payload_kg}
time_optimal: true
start_m: {[x, y, z]}
moves:
  - move_l: {{to_m: {[x, y, z + HEIGHT_M]}, blend_m: 0.02}}
  - move_l: {{to_m: {[to_x, to_y, to_z + HEIGHT_M]}, blend_m: 0.02}}
  - move_l: {{to_m: {[to_x, to_y, to_z]}}}
  - dwell: {{time_s: 20.0}}
"""


@pytest.mark.parametrize('geared', [False, True], ids=['motors', 'gears'])
@pytest.mark.parametrize(
    ('start', 'end', 'payload_kg', 'limits'),
    [
        ((-0.15, 0.0, -0.85), (0.15, 0.0, -0.85), 8.0, 'torque_rate_n_m_s: 1000.0'),
        ((0.2, -0.2, -0.9), (-0.1, 0.2, -0.82), 5.0, 'torque_rate_n_m_s: 1000.0'),
        ((-0.15, 0.0, -0.85), (0.15, 0.1, -0.9), 0.5, 'jerk_m_s3: 20000.0'),
        ((0.2, 0.1, -0.8), (-0.2, -0.1, -0.9), 2.0, 'jerk_m_s3: 20000.0'),
        ((-0.15, 0.0, -0.85), (0.15, 0.0, -0.85), 8.0, 'jerk_m_s3: 20000.0'),
        ((0.2, -0.2, -0.9), (-0.1, 0.2, -0.82), 10.0, 'jerk_m_s3: 20000.0'),
    ],
)
def test_no_limit_is_exceeded_by_more_than_a_hundredth(start, end, payload_kg, limits, geared, tmp_path):
    robot = parameters.load('model').replace(gear__limit_moves=geared)
    (tmp_path / 'pick.yaml').write_text(pick(start, end, payload_kg, limits), encoding='utf-8')
    program = load(tmp_path / 'pick.yaml', robot.motion)
    trace = simulation.run(program, robot, signals=('drive_voltage',))
    current = np.maximum(trace['current_max'], -trace['current_min']).max()
    assert current <= OVER * robot.motor.peak_current_a
    assert np.abs(trace['shaft_speed']).max() <= OVER * robot.motor.max_speed_rad_s
    assert np.abs(trace['drive_voltage']).max() <= OVER * phase_voltage_max(robot)
    rms = np.sqrt(np.mean(trace['current_rms'] ** 2, axis=0)).max()
    assert rms <= OVER * robot.motor.nominal_current_a
    if geared:
        torque = np.abs(added(trace)['gear_torque']).max()
        assert torque <= (1.0 + OVERLOADED) * robot.gear.acceleration_torque_n_m
    elif payload_kg > 4.0:  # it is the peak torque that keeps these from being faster
        assert current >= 0.97 * robot.motor.peak_current_a
