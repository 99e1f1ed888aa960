"""Tests of a run with an oscilloscope in every drive against the simulation."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.studies.runs import oscilloscope as oscilloscope_run
from delta3_pacdrive.studies.runs.oscilloscope import Oscilloscope

PICK = {
    'payload_kg': 0.0,
    'moves': [
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 2.0}},
        {'move_l': {'to_m': [0.05, 0.0, -0.78], 'speed_m_s': 1.0}},
        {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
        {'move_l': {'to_m': [0.0, 0.0, -0.75], 'speed_m_s': 1.0}},
    ],
}


@pytest.mark.parametrize('feed_forward', ['inertia', 'model'])
def test_run_has_the_bits_of_the_simulation_also_with_a_gripped_payload(feed_forward, robot):
    finest = oscilloscope_run.finest(robot.replace(control__feed_forward=feed_forward))
    program = programs.parse(PICK, finest.motion)
    trace = simulation.run(program, finest)
    found = oscilloscope_run.run(program, finest, lambda *_: None, 'run')
    cycles = len(found.answers)
    np.testing.assert_array_equal(found.answers[:, 0], trace['motor_position'][:cycles])
    np.testing.assert_array_equal(found.tcp_error, trace['tcp_error'][:cycles])


def test_a_robot_that_is_not_homed_is_rejected():
    robot = parameters.load('model+uncommissioned')
    program = programs.parse(PICK, robot.motion)
    with pytest.raises(RunError, match='the axes are not homed'):
        oscilloscope_run.run(program, robot, lambda *_: None, 'run')


def test_non_numeric_field_is_rejected_by_name(robot):
    with pytest.raises(ValueError, match='brake_release is an integer field'):
        Oscilloscope(Robot(robot), 1, ['speed_reference', 'brake_release'])
