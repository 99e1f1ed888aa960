"""Tests of path and goal tolerances of trajectories: one report with axis, value and limit."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.actions import (
    Arrival,
    Ordered,
    Replied,
    Reported,
    Revoked,
    Settled,
)
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.tolerances import Tolerances, ToleranceWatch
from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.model import JointPoint, Joints, Limits, MoveL, Program, Target
from planner_client import Client

CYCLE_S = 1e-3
HOME = (0.0, 0.0, -0.75)
START = 100
DELAY = 1.75  # cycles
STILL = (0.0, 0.0, 0.0)
TIGHT = Tolerances(path_rad=(0.0, 0.01, 0.0), goal_rad=(0.002, 0.0, 0.0), goal_time_s=0.5)


@pytest.fixture(scope='module')
def timeline(robot):
    """Return a trajectory of a second, in bus time."""
    angles = kinematics.inverse(HOME, robot.kinematics) + 0.2
    program = Program('joints', (Joints((JointPoint(1.0, tuple(angles.tolist()), STILL),)),))
    found = Timeline(program_planner.plan(program, HOME, robot).plan, CYCLE_S)
    found.start(START)
    return found


def answered(timeline, cycle, *off):
    """Return where arms are that follow as drives do, but for an error each."""
    samples = sample_path([(cycle - START) * CYCLE_S], timeline.plan.move(0).segments)[0]
    return samples[0] - DELAY * CYCLE_S * samples[1] + np.array(off)


def test_arms_with_the_following_error_of_drives_violate_no_invariant(robot, timeline):
    watch = ToleranceWatch(Tolerances(path_rad=(1e-9, 1e-9, 1e-9)), robot)
    for cycle in range(START, timeline.end_cycle, 10):
        assert watch.follow(1, timeline, cycle, answered(timeline, cycle, 0.0)) is None


def test_arm_off_its_path_is_reported_once(robot, timeline):
    watch = ToleranceWatch(TIGHT, robot)
    assert watch.follow(1, timeline, 400, answered(timeline, 400, 0.5, 0.0099, 0.5)) is None
    reason = watch.follow(1, timeline, 500, answered(timeline, 500, 0.0, -0.0125, 0.0))
    assert reason is not None
    assert reason.sentence == (
        'path tolerance violated: axis2 is 0.0125 rad off at 0.400 s of the trajectory, the limit is 0.01 rad'
    )
    assert watch.follow(1, timeline, 510, answered(timeline, 510, 0.0, -0.0125, 0.0)) is None
    assert watch.follow(2, timeline, 510, answered(timeline, 510, 0.0, -0.0125, 0.0)) is not None


def test_tolerances_are_monitored_only_during_their_trajectory(robot, timeline):
    watch = ToleranceWatch(TIGHT, robot)
    assert watch.follow(1, timeline, START - 1, np.full(3, 9.0)) is None
    line = Program('line', (MoveL(Target((0.0, 0.0, -0.8)), limits=Limits(1.0, 10.0, 500.0)),))
    other = Timeline(program_planner.plan(line, HOME, robot).plan, CYCLE_S)
    other.start(START)
    assert watch.follow(1, other, START + 50, np.full(3, 9.0)) is None
    assert watch.settle(other.end_cycle + 1000, np.full(3, 9.0), np.zeros(3)) is None


def at_the_end(robot, timeline, tolerances=TIGHT):
    """Return a watch at the end of a trajectory, and the goal."""
    watch = ToleranceWatch(tolerances, robot)
    last = timeline.end_cycle - 1
    assert watch.follow(1, timeline, last, answered(timeline, last, 0.0)) is None
    return watch, sample_path([1.0], timeline.plan.move(0).segments)[0, 0]


def test_arm_at_the_goal_in_time_is_accepted(robot, timeline):
    watch, goal = at_the_end(robot, timeline)
    end = timeline.end_cycle
    assert watch.settle(end + 400, goal + 0.1, np.zeros(3)) is None
    assert watch.settle(end + 450, goal + np.array([0.0019, 0.1, 0.1]), np.zeros(3)) is None
    assert watch.settle(end + 900, goal + 0.1, np.zeros(3)) is None  # that is over


def test_arm_off_the_goal_after_the_goal_time_is_reported_once(robot, timeline):
    watch, goal = at_the_end(robot, timeline)
    end = timeline.end_cycle
    assert watch.settle(end + 499, goal + 0.1, np.zeros(3)) is None
    reason = watch.settle(end + 500, goal + np.array([0.003, 0.1, 0.1]), np.zeros(3))
    assert reason is not None
    assert reason.sentence == (
        'goal tolerance violated: axis1 is 0.003 rad off 0.5 s after the last point, the limit is 0.002 rad'
    )
    assert watch.settle(end + 501, goal + 0.1, np.zeros(3)) is None


def test_moving_arm_after_the_goal_time_is_reported(robot, timeline):
    watch, goal = at_the_end(robot, timeline)
    reason = watch.settle(timeline.end_cycle + 500, goal, np.array([0.0, 0.0, -0.02]))
    assert reason is not None
    assert reason.sentence == (
        'goal time violated: axis3 still moves at 0.02 rad/s 0.5 s after the last point, the limit is 0.01 rad/s'
    )


def test_a_trajectory_that_is_held_has_no_goal(robot, timeline):
    held = timeline.copy()
    held.change(held.stop(600))
    watch = ToleranceWatch(TIGHT, robot)
    watch.follow(1, held, 620, answered(timeline, 620, 0.0))
    assert watch.settle(held.end_cycle + 10_000, np.zeros(3), np.ones(3)) is None


def test_goal_is_not_monitored_without_a_goal_time(robot, timeline):
    tolerances = Tolerances(goal_rad=(0.001, 0.001, 0.001))
    assert not tolerances.any
    watch, goal = at_the_end(robot, timeline, tolerances)
    assert watch.settle(timeline.end_cycle + 10**6, goal + 1.0, np.zeros(3)) is None


def driven(robot):
    """Return a client whose planner monitors tolerances and executes a trajectory, in bus time."""
    client = Client(robot)
    client.planner = Planner(robot, client.status.planner, None, lambda: client.cycle, TIGHT)
    client.say()
    angles = (kinematics.inverse(HOME, robot.kinematics) + 0.2).tolist()
    point = {'time_s': 1.0, 'angles_rad': angles, 'speeds_rad_s': [0, 0, 0]}
    client.ask('trajectory', TrajectoryRequest(0.0, [point]).to_json())
    client.plan()
    ordered = client.do(Ordered)
    client.verdict(ordered.number)
    client.answer()
    client.say(state='moving', order=ordered.number)
    timeline = Timeline(Plan.of(ordered.moves), CYCLE_S)
    timeline.start(START)
    client.follow(timeline.profile, 1)
    client.planner.actions.clear()
    return client, timeline, ordered.number


def test_a_trajectory_that_a_fault_has_stopped_has_no_goal(robot):
    client, timeline, _ = driven(robot)
    client.planner.trajectory.observe(300, answered(timeline, 300, 0.0), np.zeros(3))
    client.say(state='error', refusal='there is a fault: axis1', refusal_code='fault')
    client.planner.actions.clear()
    for cycle in (310, timeline.end_cycle + 10, timeline.end_cycle + 5000):
        client.planner.trajectory.observe(cycle, answered(timeline, 300, 0.0), np.zeros(3))
    client.say(state='idle', refusal='', refusal_code='', located=2)
    client.planner.trajectory.observe(timeline.end_cycle + 6000, answered(timeline, 300, 0.0), np.zeros(3))
    assert client.none(Replied)


def test_trajectory_that_ends_off_its_goal_is_reported(robot):
    client, timeline, _ = driven(robot)
    last = timeline.end_cycle - 1
    client.planner.trajectory.observe(last, answered(timeline, last, 0.0), np.zeros(3))
    client.say(state='idle', located=2, cycle=timeline.end_cycle + 5)
    client.planner.trajectory.observe(timeline.end_cycle + 600, answered(timeline, last, 0.1), np.zeros(3))
    assert 'goal tolerance violated: axis1 is 0.1' in client.do(Replied).reason.sentence


def test_planner_stops_a_trajectory_off_its_path_with_the_reason(robot):
    client, timeline, number = driven(robot)
    client.planner.trajectory.observe(300, answered(timeline, 300, 0.0), np.zeros(3))
    assert client.planner.actions == []
    for cycle in (400, 410):
        client.planner.trajectory.observe(cycle, answered(timeline, cycle, 0.0, 0.05, 0.0), np.zeros(3))
    assert client.do(Revoked).number == number
    assert 'path tolerance violated: axis2 is 0.05 rad off' in client.do(Replied).reason.sentence
    report = client.do(Reported).report
    assert (report.state, report.sentence[:23]) == ('aborted', 'path tolerance violated')


# tolerances of one trajectory


def test_tolerances_of_a_trajectory_count_for_it_and_no_other(robot, timeline):
    watch = ToleranceWatch(Tolerances(), robot)
    watch.begin(1, TIGHT)
    assert watch.follow(1, timeline, 500, answered(timeline, 500, 0.0, -0.0125, 0.0)) is not None
    watch.begin(2, None)
    assert watch.follow(2, timeline, 500, answered(timeline, 500, 0.0, -0.0125, 0.0)) is None
    assert not watch.active


def test_goal_completes_although_its_feedback_is_not_read(robot, timeline):
    watch = ToleranceWatch(Tolerances(), robot)
    watch.begin(1, TIGHT)
    watch.arrive(timeline)
    assert watch.waits
    goal = sample_path([1.0], timeline.plan.move(0).segments)[0, 0]
    assert watch.settle(timeline.end_cycle + 1, goal, np.zeros(3)) is None
    assert not watch.waits
    watch.arrive(timeline)  # it has been looked at to the end
    assert not watch.waits


def test_tolerances_are_restored_from_a_request():
    text = TrajectoryRequest(1.0, [], TIGHT).to_json()
    assert TrajectoryRequest.from_json(text).tolerances == TIGHT


@pytest.mark.parametrize(
    ('changed', 'reason'),
    [
        ({'path_rad': [0.1, 0.1]}, 'path_rad of the tolerances must be a list of 3 numbers'),
        (
            {'goal_rad': [0.1, 0.1, -1.0]},
            'goal_rad of the tolerances is -1.0, but must be at least 0',
        ),
        ({'goal_time_s': True}, 'goal_time_s of the tolerances is True'),
        ({'stopped_rad_s': float('inf')}, 'stopped_rad_s of the tolerances is inf'),
        ({'more': 1}, 'tolerances must have the keys'),
    ],
)
def test_invalid_tolerances_are_rejected(changed, reason):
    with pytest.raises(TelegramError, match=reason):
        Tolerances.from_fields(TIGHT.to_fields() | changed)


class Robot:
    """A planner whose trajectory has own tolerances and is executed to its end."""

    def __init__(self, robot, tolerances):
        self.client = client = Client(robot)
        angles = (kinematics.inverse(HOME, robot.kinematics) + 0.2).tolist()
        point = {'time_s': 1.0, 'angles_rad': angles, 'speeds_rad_s': [0, 0, 0]}
        self.request = client.ask('trajectory', TrajectoryRequest(0.0, [point], tolerances).to_json())
        client.plan()
        ordered = client.do(Ordered)
        client.verdict(ordered.number)
        client.say(state='moving', order=ordered.number)
        self.timeline = Timeline(Plan.of(ordered.moves), CYCLE_S)
        self.timeline.start(START)
        client.follow(self.timeline.profile, 1)
        self.goal = np.array(angles)

    def end(self):
        self.client.cycle = self.timeline.end_cycle
        self.client.say(state='idle', cycle=self.timeline.end_cycle, located=self.client.status.located + 1)


@pytest.mark.parametrize(
    ('off', 'arrival'), [(0.0019, Arrival.REACHED), (0.003, Arrival.OFF_GOAL)], ids=['reached', 'off']
)
def test_trajectory_client_receives_whether_the_arms_reached_the_goal(robot, off, arrival):
    moved = Robot(robot, TIGHT)
    client, identity = moved.client, moved.request.identity
    followed = []
    client.planner.trajectory.observe(START + 400, answered(moved.timeline, START + 400, 0.0), np.zeros(3))
    followed.append(client.planner.trajectory.followed())
    assert (followed[0].cycle, followed[0].time_s) == (START + 400, pytest.approx(0.4))
    assert followed[0].due[0] == pytest.approx(followed[0].actual[0], abs=1e-5)
    moved.end()
    assert client.planner.trajectory.settles(identity)
    assert client.none(Settled)
    late = moved.timeline.end_cycle + 500
    client.planner.trajectory.observe(late, moved.goal + np.array([off, 0.1, 0.1]), np.zeros(3))
    settled = client.do(Settled)
    assert (settled.identity, settled.arrival) == (identity, arrival)
    assert not client.planner.trajectory.settles(identity)


def test_a_goal_that_is_waited_for_is_given_up_for_another_program(robot):
    moved = Robot(robot, Tolerances(goal_rad=(1e-6, 0.0, 0.0)))
    moved.end()
    client = moved.client
    client.planner.trajectory.observe(moved.timeline.end_cycle + 10**6, moved.goal + 0.1, np.zeros(3))
    assert client.none(Settled)  # without a goal time it is waited for
    client.planner.actions.clear()
    ordered = client.order()
    client.verdict(ordered.number)
    settled = client.do(Settled)
    assert (settled.identity, settled.arrival) == (moved.request.identity, Arrival.CANCELLED)
