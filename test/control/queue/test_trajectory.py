"""Tests of requested trajectories of arm angles: start, late points and stops."""

import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.actions import Ordered, Replied, Reported, Revoked
from delta3_pacdrive.control.messages import EXACT, ORDER, REPLACEMENT, SMOOTHED
from delta3_pacdrive.control.queue.planner import VERDICT_S
from delta3_pacdrive.control.queue.planning_job import Job
from delta3_pacdrive.control.queue.trajectory import (
    LEAD_PER_POINT_S,
    LEAD_S,
    OUTDATED,
    REPLACE_LEADS,
    SOON,
    WINDOW_LEAD_S,
    TrajectoryRequest,
)
from delta3_pacdrive.errors import Code, ProgramError, TelegramError
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.plan import Plan
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


def test_a_robot_that_executes_moves_accepts_no_trajectory(client, robot):
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


# replacing the running trajectory


def positions_only(robot, by=0.1, time_s=0.25, stamp_s=0.0):
    """Return the text of a request of one point without speeds."""
    angles = (kinematics.inverse(HOME, robot.kinematics) + by).tolist()
    return TrajectoryRequest(stamp_s, [{'time_s': time_s, 'angles_rad': angles}]).to_json()


def running(client, robot, time_s=1.0):
    """Let a trajectory run for 50 cycles; return its timeline and request."""
    request = client.ask('trajectory', trajectory(robot, time_s=time_s, by=0.2))
    client.plan()
    ordered = client.do(Ordered)
    client.verdict(ordered.number)
    assert client.answer()[0] is None
    client.say(state='moving', order=ordered.number)
    timeline = Timeline(Plan.of(ordered.moves), robot.bus.cycle_time_s)
    timeline.start(client.cycle, ordered.row[1])
    client.follow(timeline.profile, 1)
    client.cycle += 50
    return timeline, request


def phases(client):
    """Take the reports of requests; return their identities and states."""
    reports = [action.report for action in client.planner.actions if isinstance(action, Reported)]
    client.planner.actions = [one for one in client.planner.actions if not isinstance(one, Reported)]
    return [(report.id, report.state) for report in reports]


def lead(points=1):
    return REPLACE_LEADS[0] + round(points * LEAD_PER_POINT_S / CYCLE_S + 0.5)


def test_a_trajectory_replaces_the_running_one_from_its_state_at_the_start(client, robot):
    timeline, first = running(client, robot)
    phases(client)
    second = client.ask('trajectory', positions_only(robot))
    client.plan()
    ordered = client.do(Ordered)
    cycle = client.cycle + lead()
    assert (ordered.kind, ordered.row[:2]) == (REPLACEMENT, (cycle, 1.0))
    (move,) = ordered.moves
    now = timeline.at(cycle)
    begins = timeline.plan.move(0).sample([now.distance_m])[0]
    assert move.sample([0.0])[0, 0] == pytest.approx(begins[0], abs=1e-9)
    assert move.length_m == 0.25
    assert client.none(Replied)
    client.verdict(ordered.number)
    assert client.answer() == (None, 'replaced by "joint_trajectory": 1 move, 0.250 s')
    assert (first.identity, 'aborted') in phases(client)
    # the end of the second one is reported, and the third one replaces it
    client.say(state='moving', order=ordered.number)
    assert client.planner.trajectory.settles(second.identity)
    assert client.planner.trajectory.supersedes(first.identity)
    client.cycle += 40
    client.ask('trajectory', positions_only(robot))
    client.plan()
    assert client.do(Ordered).kind == REPLACEMENT


def test_a_replacement_at_half_the_override_begins_with_the_motion_of_the_robot(client, robot):
    client.ask('override', '50')
    assert client.answer()[0] is None
    timeline, _ = running(client, robot)
    client.ask('trajectory', trajectory(robot, by=0.1))
    client.plan()
    ordered = client.do(Ordered)
    assert ordered.row[1] == 0.5
    now = timeline.at(int(ordered.row[0]))
    _, before, *_ = timeline.plan.move(0).sample([now.distance_m])[0]
    _, after, *_ = ordered.moves[0].sample([0.0])[0]
    assert 0.5 * after == pytest.approx(now.speed_m_s * before, abs=1e-9)


def test_a_replacement_with_a_stamp_begins_in_its_bus_cycle(client, robot):
    running(client, robot)
    client.ask('trajectory', trajectory(robot, stamp_s=1.5, by=0.1))
    client.plan()
    assert client.do(Ordered).row[0] == 1500.0


def test_a_replacement_after_the_end_of_the_running_trajectory_begins_from_rest(client, robot):
    timeline, _ = running(client, robot)
    client.ask('trajectory', trajectory(robot, stamp_s=3.5, by=0.1))
    client.plan()
    assert client.none(Ordered)
    client.cycle = timeline.end_cycle + 5
    end = tuple(timeline.plan.end_m().tolist())
    client.say(state='idle', located=2, tcp_m=end, cycle=client.cycle)
    client.plan()
    ordered = client.do(Ordered)
    assert (ordered.kind, ordered.row[0]) == (EXACT, 3500.0)


def test_a_replacement_that_came_after_its_end_is_planned_again_with_a_longer_lead(client, robot):
    running(client, robot, time_s=5.0)
    client.ask('trajectory', positions_only(robot))
    client.plan()
    client.verdict(client.do(Ordered).number, 'late', 'its last bus cycle is over')
    client.plan()
    assert client.do(Ordered).row[0] == client.cycle + lead() - REPLACE_LEADS[0] + REPLACE_LEADS[1]
    assert client.none(Replied)


def test_a_rejected_replacement_leaves_the_running_trajectory(client, robot):
    timeline, first = running(client, robot)
    client.ask('trajectory', positions_only(robot, by=2.0))
    client.plan()
    assert 'the angle of arm 1' in client.answer()[0].sentence
    client.ask('trajectory', positions_only(robot))
    client.plan()
    client.verdict(client.do(Ordered).number, 'state', 'the program is being aborted')
    assert client.answer()[0].code == Code.STATE
    assert client.planner.trajectory.settles(first.identity)
    client.ask('trajectory', positions_only(robot))
    client.plan()
    start = client.do(Ordered).moves[0].sample([0.0])[0, 0]
    now = timeline.at(client.cycle + lead())
    assert start == pytest.approx(timeline.plan.move(0).sample([now.distance_m])[0, 0], abs=1e-9)


def test_of_waiting_trajectories_of_one_sender_the_newest_counts(client, robot):
    running(client, robot, time_s=5.0)
    requests = [client.ask('trajectory', positions_only(robot)) for _ in range(3)]
    client.plan()
    client.verdict(client.do(Ordered).number)
    answers = {
        action.request.number: action.reason
        for action in client.planner.actions
        if isinstance(action, Replied)
    }
    assert answers == {requests[0].number: None, requests[1].number: OUTDATED}
    client.plan()
    assert client.do(Ordered).kind == REPLACEMENT


def test_an_operator_who_loses_control_does_not_replace_the_trajectory(client, robot):
    client.say(operator='op', operator_name='Ada', control=1)
    running(client, robot)
    client.ask('trajectory', positions_only(robot))
    job = client.do(Job)
    client.say(operator='eve', operator_name='Eve', control=2, losses=1)
    assert client.do(Replied).reason.code == Code.CONTROL
    assert job.number
    assert client.none(Ordered)


def test_a_trajectory_that_jumps_is_smoothed_and_one_with_speeds_is_not(client, robot):
    client.ask('trajectory', positions_only(robot, by=0.3))
    client.plan()
    assert client.do(Ordered).kind == SMOOTHED


def test_a_trajectory_with_speeds_that_needs_too_much_torque_is_rejected(client, robot):
    client.ask('trajectory', trajectory(robot, time_s=0.04, by=0.3))
    client.plan()
    assert client.answer()[0].code == Code.CONTENT
    assert client.none(Ordered)


def test_the_rest_of_a_smoothed_trajectory_is_smoothed_when_it_is_resumed_after_a_fault(client, robot):
    running(client, robot, time_s=5.0)
    client.ask('trajectory', positions_only(robot, time_s=3.0))
    client.plan()
    ordered = client.do(Ordered)
    client.verdict(ordered.number)
    assert client.answer()[0] is None
    client.say(state='moving', order=ordered.number)
    replaced = Timeline(Plan.of(ordered.moves), robot.bus.cycle_time_s)
    replaced.start(int(ordered.row[0]), ordered.row[1])
    client.cycle += 500
    client.say(state='error', refusal='there is a fault: axis1', refusal_code='fault')
    client.follow(replaced.stop(client.cycle), 2)
    place = tuple(replaced.plan.move(0).sample([0.5])[0, 0].tolist())
    client.say(state='idle', located=2, tcp_m=place, refusal='', refusal_code='')
    client.ask('resume')
    ordered = client.do(Ordered)
    assert ordered.kind == SMOOTHED
    assert ordered.moves[-1].kind == MoveKind.JOINTS


def test_the_first_window_of_a_stream_begins_as_soon_as_possible_from_rest(client, robot):
    """At bus time 1.000 s, 0.1 s ahead: too late for a start in its bus cycle."""
    client.ask('trajectory', positions_only(robot, by=0.01, time_s=0.1, stamp_s=1.0))
    client.plan()
    ordered = client.do(Ordered)
    assert ordered.row[0] == SOON
    assert ordered.moves[0].length_m == pytest.approx(0.1 - WINDOW_LEAD_S - LEAD_PER_POINT_S, abs=1e-3)


def test_a_window_that_is_over_is_rejected(client, robot):
    client.ask('trajectory', positions_only(robot, time_s=0.02, stamp_s=1.0))
    assert client.answer()[0].code == Code.LATE


def test_a_trajectory_that_ends_in_motion_is_smoothed_to_rest_at_its_last_point(client, robot):
    angles = (kinematics.inverse(HOME, robot.kinematics) + 0.05).tolist()
    point = {'time_s': 0.5, 'angles_rad': angles, 'speeds_rad_s': [0.1, 0.1, 0.1]}
    client.ask('trajectory', TrajectoryRequest(0.0, [point]).to_json())
    client.plan()
    ordered = client.do(Ordered)
    assert ordered.kind == SMOOTHED
    place = kinematics.forward(angles, robot.kinematics)
    assert ordered.moves[0].sample([0.5])[0, 0] == pytest.approx(place, abs=1e-9)
