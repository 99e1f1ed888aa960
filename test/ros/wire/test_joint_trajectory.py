"""Tests of ``joint_trajectory``: valid messages, and a real publisher that moves the arms."""

import json
import math
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.parameter import Parameter
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program.model import JOINT_POINTS_MAX
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.ros.wire.joint_trajectory import TimeOfDay, joint_trajectory
from delta3_pacdrive.ros.wire.qos import REQUEST
from trajectories import HALF_INCREMENT, HOME, Cell, message, still

START_S = 1_800_000_000  # time of day of bus cycle 0
LATE_NS = 300_000  # between a cycle and its publication

# messages


def published(rate: float = 1.0, cycles: int = 1000, every: int = 10) -> TimeOfDay:
    """Return the time of day observed from cycles of 1 ms that are published with different delays."""
    times = TimeOfDay(Clock(1e-3))
    for cycle in range(0, cycles, every):
        late_ns = LATE_NS + cycle % 7 * 200_000
        times.observe(cycle, START_S * 10**9 + round(cycle * 1e6 / rate) + late_ns)
    return times


def test_joints_may_be_in_any_order() -> None:
    fields = {
        'positions': [0.3, 0.1, 0.2],
        'velocities': [3.0, 1.0, 2.0],
        'accelerations': [30.0, 10.0, 20.0],
    }
    (point,) = joint_trajectory(message((1.5, fields), names=['axis3', 'axis1', 'axis2'])).points
    assert point == {
        'time_s': 1.5,
        'angles_rad': [0.1, 0.2, 0.3],
        'speeds_rad_s': [1.0, 2.0, 3.0],
        'accelerations_rad_s2': [10.0, 20.0, 30.0],
    }


def test_a_trajectory_without_points_is_a_stop() -> None:
    assert joint_trajectory(JointTrajectory()).points == []


def test_a_stamp_is_bus_time() -> None:
    asked = message((1.0, still(0.0)), stamp=Time(sec=12, nanosec=500_000_000))
    assert joint_trajectory(asked).stamp_s == 12.5
    assert joint_trajectory(asked, published().bus_time_s).stamp_s == 12.5


@pytest.mark.parametrize('every', [1, 10, 50])
def test_times_of_day_become_bus_time_by_the_earliest_publication(every: int) -> None:
    ahead_s = published(every=every).bus_time_s(START_S + 3, 250_000_000)
    assert ahead_s == pytest.approx(3.25 - LATE_NS * 1e-9, abs=0.4e-3)


def test_bus_time_that_begins_again_counts_from_there() -> None:
    times = published()
    for cycle in range(0, 400, 10):
        times.observe(cycle, (START_S + 60) * 10**9 + cycle * 10**6)
    assert times.bus_time_s(START_S + 61, 0) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ('times', 'sec', 'words'),
    [
        (published(cycles=0), START_S, 'has not run for 0.2 s'),
        (published(cycles=150), START_S, 'has not run for 0.2 s'),
        (published(rate=0.5), START_S + 2, 'runs 0.50 times as fast'),
        (published(rate=5.0, cycles=5000), START_S + 2, 'runs 5.0'),
        (published(), START_S - 2, '2.000 s before bus time 0'),
    ],
)
def test_times_of_day_without_a_bus_time_are_rejected(times: TimeOfDay, sec: int, words: str) -> None:
    with pytest.raises(ProgramError, match='is a time of day') as caught:
        times.bus_time_s(sec, 0)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ('bad', 'reason'),
    [
        (message((1.0, still(0.0)), names=['axis1', 'axis2']), "joint_names are 'axis1, axis2', but must be "),
        (message((1.0, still(0.0)), names=['axis1', 'axis2', 'axis2']), 'joint_names are '),
        (message((1.0, {'positions': [0, 0]})), 'point 1: positions has 2 values, but must have 3'),
        (message((1.0, {})), 'point 1: positions has 0 values, but must have 3'),
        (message((1.0, still(0.0)), (2.0, {'positions': [0, 0, math.nan]})), 'point 2: positions of axis3 is nan'),
        (message((1.0, {'positions': [0, 0, 0], 'velocities': [1]})), 'point 1: velocities has 1 values'),
        (message((1.0, {'positions': [0, 0, 0], 'velocities': [0, math.inf, 0]})), 'point 1: velocities of axis2'),
        (message((1.0, {'positions': [0, 0, 0], 'accelerations': [0, 0, 0]})), 'point 1 has accelerations, but no vel'),
        (message((1.0, {'positions': [0, 0, 0], 'effort': [0, 0, 0]})), 'point 1 has effort, which is not supported'),
        (message((1.0, still(0.0)), (1.0, still(0.1))), 'point 2 is at 1 s, not after point 1 at 1 s'),
        (message((-1.0, still(0.0))), 'point 1: time_from_start is -1 s, but must be at least 0'),
        (message(*((0.1 * n, still(0.0)) for n in range(1, 30_002))), 'has 30001 points, the limit is 30000'),
        (message((1.0, still(0.0)), stamp=Time(sec=-1)), 'header.stamp is -1 s'),
    ],
)  # fmt: skip
def test_invalid_message_is_rejected_with_its_error(bad: JointTrajectory, reason: str) -> None:
    with pytest.raises(ProgramError) as caught:
        joint_trajectory(bad)
    assert reason in str(caught.value)


# a robot


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_a_publisher_drives_the_arms_through_points(cell: Cell) -> None:
    through = {'positions': HOME + 0.1, 'velocities': [0.2, 0.2, 0.2], 'accelerations': [0.0, 0.0, 0.0]}
    end = {**still([0.2, 0.1, 0.15]), 'accelerations': [0.0, 0.0, 0.0]}
    assert cell.send(message((0.5, through), (1.0, end))).startswith('accepted: started "joint_trajectory"')
    cell.wait_for('moving')
    cell.wait_for('idle')
    assert cell.missed([0.2, 0.1, 0.15]) <= 1.01 * 2.0 * HALF_INCREMENT
    # the next one begins where this one has ended, with a point at time 0 that is only read from joint states
    assert cell.send(message((0.0, still([0.2002, 0.0999, 0.15])), (0.8, still(0.0)))).startswith('accepted')
    cell.wait_for('moving')
    cell.wait_for('idle')
    assert cell.missed(0.0) <= 1.01 * 2.0 * HALF_INCREMENT


def test_a_rejected_trajectory_is_answered_and_the_next_one_driven(cell: Cell) -> None:
    reports = cell.graph.listen(String, 'unit_robot/requests', REQUEST)
    answer = cell.send(message((1.0, still(2.0))))
    assert 'refused: ' in answer
    assert 'the angle of arm 1 is 111 deg at 1.0000 s, before point 1, the limit is 95 deg' in answer
    assert cell.send(message((1.0, still(0.1)), names=['a', 'b', 'c'])).startswith('refused: joint_names are')
    cell.operator.take_control('somebody')
    assert 'control' in cell.send(message((0.5, still(0.1))))
    cell.operator.release_control()
    cell.graph.spin_until(lambda: len(reports) == 4, 'a report of each')
    told = [json.loads(report.data) for report in reports]
    assert [report['state'] for report in told] == ['planning', 'refused', 'refused', 'refused']
    assert ['refused: ' + report['sentence'] for report in told[1:]] == [a.data for a in cell.answers[-3:]]
    assert len({report['id'] for report in told}) == 3
    assert cell.operator.state == 'idle'
    assert cell.send(message((0.5, still(0.1)))).startswith('accepted: started')
    cell.wait_for('moving')
    cell.wait_for('idle')


def test_a_trajectory_is_held_resumed_and_stopped_by_an_empty_one(cell: Cell) -> None:
    # long enough that nothing which is asked for comes after its end, however busy the machine is
    assert cell.send(message((60.0, still(0.2)))).startswith('accepted')
    cell.wait_for('moving')
    cell.operator.call('hold')
    cell.wait_for('stopped')
    assert 'the robot is stopped' in cell.send(message((1.0, still(0.1))))
    cell.operator.call('resume')
    # everybody hears what he is answered: it is not the answer to what is sent next
    cell.graph.spin_until(lambda: cell.answers[-1].data == 'accepted: resumed', 'the answer')
    cell.wait_for('moving')
    # it has hardly begun to move again: the stop may be over before it is answered
    stopping = 'accepted: stops on the path', 'accepted: stopped on the path and aborted'
    assert cell.send(JointTrajectory()) in stopping
    cell.wait_for('idle')
    assert cell.missed(0.2) > HALF_INCREMENT


def test_the_longest_trajectory_is_followed_through_all_its_points(graph: Any) -> None:
    cell = Cell(graph)
    time_s, by = JOINT_POINTS_MAX * 1e-4, 0.3
    rows = []
    for n in range(1, JOINT_POINTS_MAX + 1):
        share = n / JOINT_POINTS_MAX
        speed = by / time_s * 6.0 * share * (1.0 - share)
        angles = HOME + by * share**2 * (3.0 - 2.0 * share)
        rows.append((share * time_s, {'positions': angles, 'velocities': [speed] * 3}))
    assert cell.send(message(*rows)).startswith('accepted')
    cell.wait_for('moving')
    cell.wait_for('idle')
    assert cell.missed(by) <= 1.01 * 2.0 * HALF_INCREMENT


def test_trajectory_beyond_its_path_tolerance_is_stopped_with_the_reason(graph: Any) -> None:
    cell = Cell(graph, constraints__axis2__trajectory=1e-7)
    cell.send(message((2.0, still(0.3))))
    graph.spin_until(lambda: 'path tolerance violated: axis2 is ' in cell.answers[-1].data, 'the violation')
    assert cell.answers[-1].data.endswith('the limit is 1e-07 rad')
    cell.wait_for('idle')
    assert cell.missed(0.3) > HALF_INCREMENT


def test_a_tolerance_that_is_set_at_run_time_applies_from_the_next_trajectory_on(graph: Any) -> None:
    cell = Cell(graph)
    path = 'constraints.axis2.trajectory'
    cell.send(message((0.5, still(0.1))))
    cell.wait_for('moving')
    (done,) = cell.planner.set_parameters([Parameter(path, value=1e-7)])
    assert done.successful
    cell.wait_for('idle')
    assert cell.missed(0.1) <= 1.01 * 2.0 * HALF_INCREMENT
    cell.send(message((2.0, still(0.3))))
    graph.spin_until(lambda: 'path tolerance violated: axis2 is ' in cell.answers[-1].data, 'the violation')
    cell.wait_for('idle')
    for wrong in (-1e-3, 1.5, math.nan, 'wide'):
        assert not cell.planner.set_parameters_atomically([Parameter(path, value=wrong)]).successful
    every = [Parameter(path, value=0.0), Parameter('constraints.goal_time', value=0.5)]
    assert cell.planner.set_parameters_atomically(every).successful
    cell.send(message((0.5, still(0.0))))
    cell.wait_for('moving')
    cell.wait_for('idle')
    assert cell.missed(0.0) <= 1.01 * 2.0 * HALF_INCREMENT


def test_trajectory_within_its_tolerances_reaches_its_goal(graph: Any) -> None:
    every = {
        f'constraints__axis{axis}__{what}': 1e-3 for axis in (1, 2, 3) for what in ('trajectory', 'goal')
    }
    cell = Cell(graph, constraints__goal_time=0.1, **every)
    assert cell.send(message((1.0, still(0.3)))).startswith('accepted')
    cell.wait_for('moving')
    cell.wait_for('idle')
    graph.spin_for(0.5)
    assert cell.answers[-1].data.startswith('accepted')
    assert cell.missed(0.3) <= 1.01 * 2.0 * HALF_INCREMENT
