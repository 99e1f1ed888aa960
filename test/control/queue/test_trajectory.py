"""Tests of requested trajectories of arm angles: start, late points and stops."""

import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.actions import Ordered, Replied, Revoked
from delta3_pacdrive.control.messages import EXACT, ORDER
from delta3_pacdrive.control.queue.planner import VERDICT_S
from delta3_pacdrive.control.queue.planning_job import Job
from delta3_pacdrive.control.queue.trajectory import LEAD_PER_POINT_S, LEAD_S, SOON, TrajectoryRequest
from delta3_pacdrive.errors import Code, ProgramError, TelegramError
from delta3_pacdrive.planning.paths.move import MoveKind
from planner_client import LINE, Client

CYCLE_S = 1e-3
NEWEST = 5000
HOME = (0.0, 0.0, -0.75)


def points(*times):
    """Return points at times, at any place."""
    return [{'time_s': time, 'angles_rad': [time, 0.0, 0.0]} for time in times]


def due(stamp_s, *times):
    """Return the cycle at which a trajectory begins, and the times of its points."""
    cycle, program = TrajectoryRequest(stamp_s, points(*times)).due(NEWEST, CYCLE_S)
    (move,) = program['moves']
    return cycle, [point['time_s'] for point in move['joints']['points']]


@pytest.fixture
def client(robot):
    return Client(robot)


def trajectory(robot, stamp_s=0.0, time_s=1.0, by=0.1):
    """Return the text of a request that lowers all arms."""
    angles = (kinematics.inverse(HOME, robot.kinematics) + by).tolist()
    return TrajectoryRequest(
        stamp_s, [{'time_s': time_s, 'angles_rad': angles, 'speeds_rad_s': [0, 0, 0]}]
    ).to_json()


# when


def test_without_a_stamp_it_begins_as_soon_as_possible():
    assert due(0.0, 0.5, 1.0) == (SOON, [0.5, 1.0])


@pytest.mark.parametrize(('stamp_s', 'cycle'), [(6.0, 6000), (5.9991, 6000), (5.203, 5203)])
def test_a_stamp_ahead_is_the_bus_time_of_its_start(stamp_s, cycle):
    assert due(stamp_s, 0.0, 1.0) == (cycle, [0.0, 1.0])


def test_points_that_are_late_are_dropped_and_the_others_keep_their_bus_time():
    cycle, times = due(4.0, 0.5, 1.2, 1.3, 2.0)
    assert cycle * CYCLE_S == pytest.approx(5.0 + LEAD_S + 4 * LEAD_PER_POINT_S)
    assert times == pytest.approx([1.3 - 1.206, 2.0 - 1.206])


def test_a_trajectory_that_is_over_is_rejected_with_its_times():
    with pytest.raises(ProgramError) as caught:
        due(2.0, 0.5, 1.5)
    assert str(caught.value) == (
        'it is over: header.stamp is 2.000 s, the last point 1.500 s later, '
        'the robot could begin at 5.203 s of bus time'
    )


def test_a_stamp_of_a_wall_clock_is_rejected():
    with pytest.raises(
        ProgramError, match=r'header\.stamp is 1\.76e\+09 s, but bus time is 5\.000 s, .*not wall-clock time'
    ):
        due(1.76e9, 1.0)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('no json', 'is not a trajectory'),
        ('[]', 'must have the keys stamp_s, points'),
        (
            '{"stamp_s": 0, "points": [], "tolerances": 1}',
            'tolerances must have the keys path_rad, goal_rad, ',
        ),
        ('{"stamp_s": 0}', 'must have the keys stamp_s, points'),
        ('{"stamp_s": -1, "points": []}', 'stamp_s of a trajectory is -1, but must be at least 0'),
        ('{"stamp_s": NaN, "points": []}', 'stamp_s of a trajectory is '),
        ('{"stamp_s": true, "points": []}', 'stamp_s of a trajectory is '),
        ('{"stamp_s": 0, "points": {}}', 'points of a trajectory is '),
    ],
)
def test_invalid_trajectory_is_rejected(text, reason):
    with pytest.raises(TelegramError, match=reason):
        TrajectoryRequest.from_json(text)


def test_a_late_trajectory_of_points_without_times_is_rejected():
    with pytest.raises(ProgramError, match='is not a point with a time_s'):
        TrajectoryRequest(1.0, [{'angles_rad': [0, 0, 0]}]).due(NEWEST, CYCLE_S)


# the planner


def test_trajectory_is_planned_and_sent_for_its_bus_cycle(client, robot):
    client.ask('trajectory', trajectory(robot, stamp_s=10.0))
    client.plan()
    ordered = client.do(Ordered)
    assert (ordered.kind, ordered.row[0]) == (EXACT, 10_000.0)
    assert [move.kind for move in ordered.moves] == [MoveKind.JOINTS]
    client.verdict(ordered.number)
    assert client.answer() == (None, 'started "joint_trajectory": 1 move, 1.000 s')


def test_a_trajectory_without_a_stamp_begins_whenever_it_can(client, robot):
    client.ask('trajectory', trajectory(robot))
    client.plan()
    ordered = client.do(Ordered)
    assert (ordered.kind, ordered.row[0]) == (ORDER, SOON)


def test_a_trajectory_that_reaches_the_task_too_late_for_its_cycle_is_rejected(client, robot):
    client.ask('trajectory', trajectory(robot, stamp_s=10.0))
    client.plan()
    client.verdict(client.do(Ordered).number, 'late', 'it came too late for bus cycle 10000')
    reason, _ = client.answer()
    assert reason.code == Code.LATE


def test_trajectory_planned_after_its_start_cycle_is_rejected(client, robot):
    client.ask('trajectory', trajectory(robot, stamp_s=10.0))
    client.cycle = 10_000
    client.plan()
    reason, _ = client.answer()
    assert (reason.code, reason.sentence[:15]) == (Code.LATE, 'bus cycle 10000')
    assert client.none(Ordered)


def test_rejected_trajectory_leaves_the_robot_unchanged(client, robot):
    client.ask('trajectory', trajectory(robot, by=2.0))
    client.plan()
    reason, _ = client.answer()
    assert reason.code == Code.CONTENT
    assert 'the angle of arm 1 is 111 deg at 1.0000 s, before point 1' in reason.sentence
    assert client.none(Ordered)
    client.ask('trajectory', trajectory(robot))
    client.plan()
    assert client.do(Ordered)


def test_a_trajectory_needs_an_empty_queue(client, robot):
    client.queue(LINE)
    client.ask('trajectory', trajectory(robot))
    client.say()
    reason, _ = client.answer()
    assert reason.code == Code.STATE
    assert reason.sentence == 'moves are in the queue: a trajectory needs an empty one'
    assert client.planner.queue[0] == 1


def test_moving_robot_accepts_no_other_trajectory(client, robot):
    client.run()
    client.ask('trajectory', trajectory(robot))
    client.say(state='moving')
    reason, _ = client.answer()
    assert (reason.code, reason.sentence[:19]) == (Code.STATE, 'the robot is moving')
    assert client.none(Job)


def test_empty_trajectory_cancels_the_active_order(client):
    client.run()
    number = client.status.order
    client.ask('trajectory', TrajectoryRequest(0.0, []).to_json())
    assert client.do(Revoked).number == number
    assert client.none(Replied)  # it is only asked for
    client.say(state='moving')
    assert client.none(Replied)
    client.say(state='stopping')
    assert client.answer() == (None, 'stops on the path')


ENDS_OF_A_STOP = {
    'held before': (['stopped'], {'state': 'idle', 'located': 2}, 'at rest on the path and aborted'),
    'stopping before': (['stopping'], {'state': 'idle', 'located': 2}, 'stopped on the path and aborted'),
    'held meanwhile': (
        ['moving', 'stopped'],
        {'state': 'idle', 'located': 2},
        'stopped on the path and aborted',
    ),
    'a fault': (
        ['moving'],
        {'state': 'error', 'refusal': 'there is a fault: axis1', 'refusal_code': 'fault'},
        'there is a fault: axis1',
    ),
}


@pytest.mark.parametrize('case', ENDS_OF_A_STOP)
def test_stop_is_answered_after_its_confirmation_with_its_result(case, client):
    states, end, sentence = ENDS_OF_A_STOP[case]
    timeline = client.run()
    client.say(state=states[0])
    if states[0] != 'moving':
        client.follow(timeline.stop(client.cycle), 2)
    client.ask('trajectory', TrajectoryRequest(0.0, []).to_json())
    for state in states:
        client.say(state=state)
        assert client.none(Replied)
    if states == ['moving', 'stopped']:
        client.follow(timeline.stop(client.cycle), 2)
    client.say(**end)
    assert client.answer() == (None, sentence)


def test_program_that_ends_before_its_stop_is_reported(client):
    timeline = client.run()
    client.ask('trajectory', TrajectoryRequest(0.0, []).to_json())
    client.say(state='idle', located=2, cycle=timeline.end_cycle + 5)
    assert client.answer() == (None, 'it was at its end before it could be stopped')


def test_unanswered_stop_is_reported_later_and_the_next_request_is_served(client):
    client.run()
    client.ask('trajectory', TrajectoryRequest(0.0, []).to_json())
    client.now_s += VERDICT_S + 0.1
    client.planner.poll(client.now_s)
    assert client.answer()[0].code == Code.SILENT
    client.ask('clear')
    assert client.answer()[0] is None


def test_empty_trajectory_has_no_effect_at_rest(client):
    client.ask('trajectory', TrajectoryRequest(0.0, []).to_json())
    assert client.answer() == (None, 'nothing runs that could be stopped')
    assert client.none(Revoked)


def test_client_without_control_moves_no_arm(client, robot):
    client.say(operator='other', operator_name='Eve', control=1)
    client.ask('trajectory', trajectory(robot))
    reason = client.do(Replied).reason
    assert reason.code == Code.CONTROL
