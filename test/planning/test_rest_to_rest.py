"""Tests of motions from rest to rest in a given time, or within a speed and an acceleration."""

import json
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.planning.joint_trajectory import at_rest, joint_trajectory
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.program import file_reader
from delta3_pacdrive.planning.program.model import JointPoint
from delta3_pacdrive.planning.program_planner import plan
from delta3_pacdrive.planning.rest_to_rest import JOINTS_MIN_S, PEAK, joint_points, joint_ramps, line_limits

ROBOT = parameters.load()
HOME = (0.0, 0.0, -0.75)
START = kinematics.inverse(HOME, ROBOT.kinematics)
WAY = np.array([0.3, -0.1, 0.0])  # the first arm moves farthest
ROUNDING_S = 1e-9


def samples(speed: float, acceleration: float) -> tuple[Any, Any]:
    """Return times [s] and angles with their derivatives of a motion by WAY."""
    points = joint_points(START, START + WAY, *joint_ramps(0.3, speed, acceleration))
    path = joint_trajectory([JointPoint(**point) for point in points], at_rest(START))
    times = np.linspace(0.0, path.duration_s, 2001)
    return times, sample_path(times, path.segments)


@pytest.mark.parametrize('time_s', [0.5, 1.0, 7.3])
def test_a_line_takes_its_time(time_s: float) -> None:
    end = [0.1, 0.05, -0.8]
    length = float(np.linalg.norm(np.subtract(end, HOME)))
    move = {'to_m': end, **line_limits(length, time_s), 'strict': True}
    program = file_reader.parse({'moves': [{'move_l': json.loads(json.dumps(move))}]}, ROBOT.motion)
    assert plan(program, HOME, ROBOT).plan.duration_s == pytest.approx(time_s, abs=ROUNDING_S)


@pytest.mark.parametrize(('speed', 'acceleration'), [(0.2, 1.0), (5.0, 1.0), (0.3, 0.4501)])
def test_the_farthest_arm_reaches_the_speed_or_the_acceleration(speed: float, acceleration: float) -> None:
    _, angles = samples(speed, acceleration)
    most = np.abs(angles[:, 1:3, 0]).max(axis=0)
    assert most[0] <= speed * (1.0 + 1e-9)
    assert most[1] <= acceleration * (1.0 + 1e-9)
    assert max(most[0] / speed, most[1] / acceleration) == pytest.approx(1.0, abs=1e-3)


def test_arms_have_the_same_share_of_their_way_at_each_time() -> None:
    _, angles = samples(0.2, 1.0)
    shares = (angles[:, 0, :2] - START[:2]) / WAY[:2]
    assert shares[:, 0] == pytest.approx(shares[:, 1], abs=1e-9)
    assert shares[-1] == pytest.approx(1.0)
    assert np.abs(angles[[0, -1], 1:3]).max() == pytest.approx(0.0, abs=1e-9)


def test_arms_take_a_given_time() -> None:
    points = joint_points(START, START + WAY, PEAK * 0.3 / 2.0, 2.0 / 3.0)
    assert [point['time_s'] for point in points] == pytest.approx([2.0 / 3.0, 4.0 / 3.0, 2.0])


def test_a_motion_to_the_present_angles_only_waits() -> None:
    (point,) = joint_points(START, START, *joint_ramps(0.0, 1.0, 1.0))
    assert (point['time_s'], point['angles_rad']) == (JOINTS_MIN_S, START.tolist())
