"""Tests of the replay of a recording with the commands of the master, including torques."""

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.studies.estimation.replay_model import Replay

NEAR_A = 0.02  # the replay begins five cycles before the motion, with integrators and friction of a robot that stands


@pytest.mark.parametrize('feed_forward', ['inertia', 'model'])
def test_a_replay_with_the_true_parameters_repeats_the_currents(feed_forward, robot):
    own = robot.replace(control__feed_forward=feed_forward, drive__interpolation='cubic')
    trace = simulation.run(programs.load('experiment1', robot.motion), own)
    replay = Replay(trace, own, ideal_encoder=False)
    current = trace['current'][replay.rows]
    assert np.abs(replay.run({})['current'] - current).max() < NEAR_A
    assert np.abs(current).max() > 50.0 * NEAR_A


def test_commanded_torques_are_required(robot):
    trace = simulation.run(programs.load('experiment1', robot.motion), robot)
    with pytest.raises(EstimationError, match='the trace contains no torque_command'):
        Replay(trace, robot.replace(control__feed_forward='model'))
