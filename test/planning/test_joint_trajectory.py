"""Tests of trajectories of arm angles: polynomials, resulting TCP motion and rejections."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.limits.limits import check_reach, legal_tcp
from delta3_pacdrive.planning.paths.move import Move, MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.program import file_reader as programs

HOME = (0.0, 0.0, -0.75)
EXACT = 1e-12
STILL = [0.0, 0.0, 0.0]


@pytest.fixture(scope='module')
def home(robot):
    """Return the arm angles at the start."""
    return kinematics.inverse(HOME, robot.kinematics)


def moved(angles, *by):
    """Return arm angles, moved by an angle each."""
    return angles + np.array(by)


def planned(robot, points, more=(), **options):
    """Plan a trajectory from the home point, and following moves."""
    document = {'moves': [{'joints': {'points': points}}, *more]}
    return program_planner.plan(programs.parse(document, robot.motion), HOME, robot, **options)


def point(time_s, angles, speeds=None, accelerations=None):
    """Return a point as programs have it."""
    found = {'time_s': time_s, 'angles_rad': np.asarray(angles).tolist()}
    if speeds is not None:
        found['speeds_rad_s'] = list(speeds)
    if accelerations is not None:
        found['accelerations_rad_s2'] = list(accelerations)
    return found


def refusal(robot, *points):
    """Return the message of a rejected trajectory."""
    with pytest.raises(ProgramError) as caught:
        planned(robot, list(points))
    sentence = str(caught.value)
    assert '\n' not in sentence
    assert len(sentence) < 250
    return sentence


# between points


def test_speeds_make_the_cubic_of_scipy(robot, home):
    times = [0.0, 0.5, 0.8, 1.5]
    angles = np.array([home, moved(home, 0.1, 0.2, 0.0), moved(home, 0.2, 0.2, 0.1), home + 0.15])
    speeds = np.array([STILL, [0.3, 0.1, -0.2], [0.1, -0.2, 0.3], STILL])
    points = [point(t, a, v) for t, a, v in zip(times[1:], angles[1:], speeds[1:], strict=True)]
    move = planned(robot, points).plan.move(0)
    expected = CubicHermiteSpline(times, angles, speeds)
    at = np.linspace(0.0, 1.5, 400)
    assert move.kind == MoveKind.JOINTS
    assert sample_path(at, move.segments)[:, 0] == pytest.approx(expected(at), abs=EXACT)
    assert sample_path(at, move.segments)[:, 1] == pytest.approx(expected(at, 1), abs=100 * EXACT)


def test_accelerations_make_the_quintic_of_scipy(robot, home):
    times = [0.0, 0.4, 1.0]
    rows = [
        [home, STILL, STILL],
        [moved(home, 0.1, 0.15, 0.05), [0.3, 0.2, -0.1], [1.0, -1.0, 0.5]],
        [home + 0.2, STILL, STILL],
    ]
    move = planned(robot, [point(t, *row) for t, row in zip(times[1:], rows[1:], strict=True)]).plan.move(0)
    expected = BPoly.from_derivatives(times, np.array(rows))
    at = np.linspace(0.0, 1.0, 400)
    samples = sample_path(at, move.segments)
    assert samples[:, 0] == pytest.approx(expected(at), abs=EXACT)
    assert samples[:, 2] == pytest.approx(expected.derivative(2)(at), abs=1e4 * EXACT)


def test_positions_alone_make_straight_lines_as_the_joint_trajectory_controller_has_them(robot, home):
    move = planned(robot, [point(1.0, home + 0.1), point(2.0, moved(home, 0.15, 0.2, 0.1))]).plan.move(0)
    at = np.linspace(0.0, 2.0, 101)
    expected = np.stack(
        [
            np.interp(at, [0.0, 1.0, 2.0], [h, h + 0.1, h + end])
            for h, end in zip(home, (0.15, 0.2, 0.1), strict=True)
        ],
        axis=1,
    )
    assert sample_path(at, move.segments)[:, 0] == pytest.approx(expected, abs=EXACT)


def test_derivative_given_at_only_one_of_two_points_is_ignored_between_them(robot, home):
    points = [point(1.0, home + 0.1, STILL, STILL), point(2.0, home + 0.2, STILL), point(3.0, home + 0.3)]
    segments = planned(robot, points).plan.move(0).segments
    degrees = [int(np.flatnonzero(np.abs(row[1:7]) > 0.0).max()) for row in segments]
    assert degrees == [5, 3, 1]


# in space


def test_tcp_and_its_derivatives_are_those_of_the_arms(robot, home):
    move = planned(
        robot, [point(0.6, moved(home, 0.2, 0.1, 0.3), [0.2, 0.1, 0.0]), point(1.2, home + 0.2, STILL)]
    ).plan.move(0)
    at, step = np.linspace(0.01, 0.59, 60), 1e-5
    here, after, before = (move.sample(at + by) for by in (0.0, step, -step))
    theta, rate = sample_path(at, move.segments)[:, :2].swapaxes(0, 1)
    assert here[:, 0] == pytest.approx(kinematics.forward(theta, robot), abs=EXACT)
    jacobian = kinematics.jacobian(theta, here[:, 0], robot)
    assert here[:, 1] == pytest.approx(np.einsum('nij,nj->ni', jacobian, rate), abs=EXACT)
    for order in (1, 2, 3):
        change = (after[:, order - 1] - before[:, order - 1]) / (2.0 * step)
        assert here[:, order] == pytest.approx(change, rel=1e-6, abs=1e-7)


def test_moves_continue_at_the_end_of_a_trajectory_and_vice_versa(robot, home):
    target = moved(home, 0.2, 0.1, 0.15)
    found = planned(
        robot,
        [point(0.8, target, STILL)],
        [
            {'output': {'name': 'gripper', 'value': True}},
            {'move_l': {'to_m': [0.0, 0.0, -0.8]}},
            {
                'joints': {
                    'points': [
                        point(0.0, kinematics.inverse((0.0, 0.0, -0.8), robot)),
                        point(0.9, home, STILL),
                    ]
                }
            },
        ],
    )
    assert [move.kind for move in found.plan.moves] == [MoveKind.JOINTS, MoveKind.LINE, MoveKind.JOINTS]
    assert found.plan.move(1).start_m() == pytest.approx(kinematics.forward(target, robot), abs=EXACT)
    assert found.plan.end_m() == pytest.approx(HOME, abs=EXACT)


def test_a_first_point_at_time_0_may_be_as_inexact_as_a_reading(robot, home):
    move = planned(robot, [point(0.0, home + 0.9e-3), point(1.0, home + 0.1)]).plan.move(0)
    assert move.start_m() == pytest.approx(HOME, abs=EXACT)


# messages


def test_a_message_brings_a_trajectory_back_to_the_last_bit(robot, home):
    move = planned(robot, [point(0.5, home + 0.1, STILL), point(1.0, home, STILL)]).plan.move(0)
    back, _, _ = Move.from_array(move.to_array(0, 1), robot.kinematics)
    at = np.linspace(0.0, 1.0, 50)
    assert np.array_equal(back.sample(at), move.sample(at))
    check_reach(back, robot)


def test_unknown_robot_has_no_tcp(robot, home):
    move = planned(robot, [point(0.5, home + 0.1, STILL)]).plan.move(0)
    back, _, _ = Move.from_array(move.to_array(0, 1))
    assert np.isnan(back.end_m()).all()


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (3.0, 'the angle of arm 1 is '),
        (-0.5, 'z is -0.6761 m at 0.0000 s, the limit is -0.7 m'),
        (float('nan'), 'finite'),
    ],
)
def test_trajectory_of_another_publisher_is_rejected_like_any_such_plan(change, reason, robot, home):
    move = planned(robot, [point(0.5, home + 0.1, STILL)]).plan.move(0)
    row = move.to_array(0, 1)
    row[-18] += change  # the constant of the first arm
    with pytest.raises(ProgramError, match=reason):
        check_reach(Move.from_array(row, robot.kinematics)[0], robot)


# refusals


@pytest.mark.parametrize(
    ('times', 'reason'),
    [
        ([0.5, 0.5], 'point 2 is at 0.5 s, not after point 1 at 0.5 s'),
        ([0.5, 0.7, 0.6], 'point 3 is at 0.6 s, not after point 2 at 0.7 s'),
        ([0.0], 'the only point is at time 0'),
    ],
)
def test_times_must_increase(times, reason, robot, home):
    assert reason in refusal(robot, *(point(time, home, STILL) for time in times))


def test_first_point_at_time_0_must_be_the_position_of_the_robot(robot, home):
    sentence = refusal(robot, point(0.0, moved(home, 0.0, 0.01, 0.0)), point(1.0, home))
    assert 'point 1 at time 0 has arm 2 at -0.0529375 rad, but its angle is -0.0629375 rad' in sentence
    assert sentence.endswith('the limit of the difference is 0.001 rad')


def test_the_end_must_be_at_rest(robot, home):
    sentence = refusal(robot, point(0.5, home + 0.1, [0.0, 0.0, 0.2]))
    assert 'point 1, the last one, has a speed of 0.2 rad/s of arm 3, but must be at rest' in sentence


@pytest.mark.parametrize(
    ('points', 'reason'),
    [
        ([(1.0, 2.0, 1)], 'the angle of arm 1 is 111 deg at 1.0000 s, before point 1, the limit is 95 deg'),
        ([(0.5, 0.1, 1), (2.0, 0.7, 1)], 'z is '),
        ([(0.02, 0.1, 1)], 'motor 1 would be '),
        ([(0.1, 0.2, 0)], 'for a jump of speed by 2 rad/s within a bus cycle at point 1, the limit is '),
    ],
)  # fmt: skip
def test_limits_of_arms_workspace_and_motors_are_kept_between_points_too(points, reason, robot, home):
    sentence = refusal(
        robot, *(point(time, home + by, STILL if smooth else None) for time, by, smooth in points)
    )
    assert reason in sentence


def test_a_trajectory_between_legal_points_that_swings_out_is_rejected_at_its_place(robot, home):
    sentence = refusal(robot, point(0.4, home + 0.1, [6.0, 6.0, 6.0]), point(0.8, home + 0.1, STILL))
    assert 'before point ' in sentence


def test_arm_angles_take_no_cap_of_speed(robot, home):
    program = programs.parse({'moves': [{'joints': {'points': [point(1.0, home)]}}]}, robot.motion)
    with pytest.raises(ProgramError, match=r'moves\[0\]\.joints: its duration is fixed'):
        program_planner.capped(program, (0.1, 0.0, 0.0))


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ({'points': []}, 'moves[0].joints.points holds 0 entries, but must hold 1 to 30000'),
        ({'points': [point(1.0, STILL)] * 30_001}, 'holds 30001 entries, but must hold 1 to 30000'),
        ({'points': [{'time_s': 1.0}]}, 'moves[0].joints.points[0]: missing key angles_rad'),
        ({'points': [{'time_s': -1.0, 'angles_rad': STILL}]}, 'points[0].time_s is -1, but must be between 0 and 3600'),
        ({'points': [{'time_s': 1.0, 'angles_rad': [0.0, 1.0]}]}, 'angles_rad must be a list of 3 numbers [rad]'),
        ({'points': [{'time_s': 1.0, 'angles_rad': STILL, 'effort': STILL}]}, "unknown key 'effort'"),
        ({'points': [{'time_s': 1.0, 'angles_rad': [0.0, float('inf'), 0.0]}]}, 'must be finite'),
    ],
)  # fmt: skip
def test_file_error_names_the_invalid_point(content, reason, robot):
    with pytest.raises(ProgramError) as caught:
        programs.parse({'moves': [{'joints': content}]}, robot.motion)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ('other', 'angle', 'reason'),
    [
        ({'arm_angle_max_deg': 170.0}, 2.7, 'the elbow of arm 1 points inward here'),
        ({'forearm_length_m': 0.5}, 0.0, 'the forearms do not meet here'),
    ],
)
def test_angles_of_no_pose_that_is_worked_in_are_rejected(other, angle, reason, robot):
    # end stops far away
    dynamics = replace(robot.dynamics, end_stop_max_deg=175.0)
    strange = replace(robot, kinematics=replace(robot.kinematics, **other), dynamics=dynamics)
    angles = np.zeros((2, 4, 3))
    angles[1, 0] = angle
    with pytest.raises(ProgramError, match=reason):
        legal_tcp(np.arange(2.0), angles, lambda n: 'here', strange)
