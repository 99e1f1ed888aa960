"""Tests of the conversion of motion primitives to programs, with messages of any type that has their fields."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.ros.wire.motion_primitives import (
    CIRCULAR_CARTESIAN,
    LINEAR_CARTESIAN,
    LINEAR_JOINT,
    MOTIONS_MAX,
    sequence_program,
)

LENGTHS = parameters.load().kinematics
HOME = np.array([0.0, 0.0, -0.75])


def pose(*point: float, frame: str = '', **turn: float) -> PoseStamped:
    found = PoseStamped()
    found.header.frame_id = frame
    found.pose.position.x, found.pose.position.y, found.pose.position.z = point
    for name, value in turn.items():
        setattr(found.pose.orientation, name, value)
    return found


A, B, NOWHERE = pose(0.1, 0.0, -0.8), pose(0.0, 0.1, -0.8, frame='base'), pose(np.nan, 0.0, 0.0)


def primitive(kind: int, poses: Any = (), joints: Any = (), radius: float = 0.0, **arguments: float) -> Any:
    return SimpleNamespace(
        type=kind,
        poses=list(poses),
        joint_positions=list(joints),
        blend_radius=radius,
        additional_arguments=[SimpleNamespace(name=name, value=value) for name, value in arguments.items()],
    )


def line(end: PoseStamped = A, **fields: Any) -> Any:
    return primitive(LINEAR_CARTESIAN, [end], **fields)


def joint(*angles: float, **fields: Any) -> Any:
    return primitive(LINEAR_JOINT, joints=angles or (0.4, 0.5, 0.6), **fields)


def program(*motions: Any) -> Any:
    return json.loads(sequence_program(motions, HOME, LENGTHS))


def test_poses_of_a_robot_with_a_prefix_of_frames_name_its_base() -> None:
    motions = [line(pose(0.1, 0.0, -0.8, frame='cell2/base')), line()]
    assert json.loads(sequence_program(motions, HOME, LENGTHS, 'cell2/base')) == program(line(), line())
    with pytest.raises(ProgramError, match='must be "cell2/base"'):
        sequence_program([line(B)], HOME, LENGTHS, 'cell2/base')


def test_each_primitive_becomes_one_statement_from_the_position_of_the_robot() -> None:
    circle = primitive(CIRCULAR_CARTESIAN, [A, B], velocity=0.3)
    found = program(line(velocity=0.5, acceleration=2.0), line(pose(-0.1, 0.0, -0.8), radius=0.01), circle)
    assert found['start_m'] == HOME.tolist()
    assert found['moves'] == [
        {'move_l': {'to_m': [0.1, 0.0, -0.8], 'speed_m_s': 0.5, 'acceleration_m_s2': 2.0, 'blend_m': 0.0}},
        {'move_l': {'to_m': [-0.1, 0.0, -0.8], 'blend_m': 0.01}},
        {'move_c': {'via_m': [0.0, 0.1, -0.8], 'to_m': [0.1, 0.0, -0.8], 'speed_m_s': 0.3, 'blend_m': 0.0}},
    ]


def test_a_joint_motion_starts_at_the_angles_that_the_sequence_has_reached() -> None:
    found = program(
        line(), joint(velocity=0.5, acceleration=2.0), joint(0.4, 0.5, 0.5, move_time=3.0), line()
    )
    first, second = (found['moves'][n]['joints']['points'] for n in (1, 2))
    start, end = kinematics.inverse((0.1, 0.0, -0.8), LENGTHS), np.array([0.4, 0.5, 0.6])
    speed = np.array(first[0]['speeds_rad_s'])
    assert np.abs(speed).max() == pytest.approx(0.5)
    assert speed / 0.5 == pytest.approx((end - start) / np.abs(end - start).max())
    assert first[-1]['angles_rad'] == [0.4, 0.5, 0.6]
    assert (second[-1]['time_s'], second[-1]['angles_rad']) == (pytest.approx(3.0), [0.4, 0.5, 0.5])


def test_move_time_replaces_velocity_and_acceleration() -> None:
    (move,) = program(line(pose(0.0, 0.0, -0.85), velocity=0.0, acceleration=9.0, move_time=2.0))['moves']
    assert move['move_l']['strict']
    assert move['move_l']['speed_m_s'] == pytest.approx(0.075)
    (unused,) = program(line(velocity=0.5, move_time=0.0))['moves']
    assert unused['move_l']['speed_m_s'] == 0.5


def test_the_radius_of_the_last_primitive_has_no_effect() -> None:
    (move,) = program(joint(velocity=0.7, acceleration=1.0, move_time=2.0, radius=3.0))['moves']
    assert move['joints']['points'][-1]['time_s'] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ('motions', 'reason'),
    [
        ([], 'the sequence has no motions; to stop, cancel the goal'),
        ([line()] * (MOTIONS_MAX + 1), 'the sequence has 1025 motions, the limit is 1024'),
        ([line(), primitive(-1)], 'motions[1]: type -1 is not supported, expected one of LINEAR_JOINT (0), LINEAR_'),
        ([joint(0.1, 0.2, 0.3, 0.4, 0.5, 0.6, velocity=0.7)], '3 joint_positions, one per arm, but has 6 values'),
        ([primitive(LINEAR_JOINT, [A])], 'LINEAR_JOINT needs 3 joint_positions, one per arm, but has 0 values'),
        ([joint(0.1, np.inf, 0.3)], 'but must be finite'),
        ([joint(velocity=0.7)], 'motions[0]: LINEAR_JOINT needs velocity and acceleration, or move_time'),
        ([joint(velocity=0.7, acceleration=0.0)], 'acceleration is 0, but must be above 0'),
        ([joint(radius=0.1, move_time=1.0), line()], 'LINEAR_JOINT begins and ends at rest, but a blend_radius is'),
        ([line(radius=0.1), joint(move_time=1.0)], 'motions[1]: LINEAR_JOINT begins and ends at rest'),
        ([line(radius=0.1), line(B, move_time=1.0)], 'motions[1]: a motion with move_time begins and ends at rest'),
        ([primitive(LINEAR_CARTESIAN, joints=(0.1, 0.2, 0.3))], 'LINEAR_CARTESIAN needs one pose, but has 0'),
        ([primitive(LINEAR_CARTESIAN, [A, B])], 'LINEAR_CARTESIAN needs one pose, but has 2'),
        ([primitive(CIRCULAR_CARTESIAN, [A])], 'CIRCULAR_CARTESIAN needs two poses, end and circle point, but has 1'),
        ([primitive(CIRCULAR_CARTESIAN, [A, B], move_time=1.0)], 'CIRCULAR_CARTESIAN does not support move_time'),
        ([line(NOWHERE)], 'poses[0] is at '),
        ([line(pose(0.1, 0.0, -0.8, frame='tool'))], "frame_id is 'tool', but must be"),
        ([line(pose(0.1, 0.0, -0.8, x=1.0, w=0.0))], 'poses[0] has an orientation, but the plate cannot rotate'),
        ([line(radius=-1.0)], 'blend_radius is -1 m, but must be finite and at least 0'),
        ([line(velocity=-1.0)], 'velocity is -1, but must be finite and at least 0'),
        ([line(velocity=0.0)], 'velocity is 0, but must be above 0'),
        ([line(jerk=1.0)], "unknown argument 'jerk', expected one of velocity, acceleration, move_time"),
    ],
)  # fmt: skip
def test_invalid_sequence_is_rejected_with_its_error(motions: Any, reason: str) -> None:
    with pytest.raises(ProgramError) as caught:
        program(*motions)
    assert reason in str(caught.value)
