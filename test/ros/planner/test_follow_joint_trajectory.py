"""Tests of the action ``follow_joint_trajectory``: valid goals, and a client that moves the arms.

The client and the action have the real type of ``control_msgs``. Where that is not installed it is built, from its
fields, with the generators of the ROS wheels.
"""

import importlib
import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration, Time
from rclpy.action import ActionClient
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.control.actions import Arrival
from delta3_pacdrive.control.queue.tolerances import Tolerances
from delta3_pacdrive.errors import Code, ProgramError
from delta3_pacdrive.ros.planner.follow_joint_trajectory import trajectory_request
from delta3_pacdrive.ros.planner.motion_action import error_code_of
from delta3_pacdrive.ros.wire.control_messages import CONTROLLER_STATE, control_type
from delta3_pacdrive.ros.wire.qos import REQUEST
from trajectories import AXES, HALF_INCREMENT, HOME, Cell, message, still

ACTION = 'unit_robot/follow_joint_trajectory'
FOLLOWING_RAD = 5e-3  # largest following error of this motion
OURS = Tolerances(path_rad=(0.1, 0.2, 0.3), goal_rad=(0.01, 0.02, 0.03), goal_time_s=0.5, stopped_rad_s=0.04)


# goals, of any type that has their fields


def tolerance(name: str, position: float, **others: float) -> Any:
    return SimpleNamespace(name=name, position=position, **{'velocity': 0.0, 'acceleration': 0.0, **others})


def goal_of(
    trajectory: JointTrajectory, path: Any = (), goal: Any = (), time: Any = None, **others: Any
) -> Any:
    found = SimpleNamespace(trajectory=trajectory, path_tolerance=path, goal_tolerance=goal, **others)
    found.goal_time_tolerance = time or Duration()
    return found


def test_a_goal_without_tolerances_has_those_of_the_node() -> None:
    request = trajectory_request(goal_of(message((1.0, still(0.1)), stamp=Time(sec=7))), OURS)
    assert (request.stamp_s, len(request.points), request.tolerances) == (7.0, 1, OURS)


def test_the_stamp_of_a_goal_is_converted_to_bus_time() -> None:
    goal = goal_of(message((1.0, still(0.1)), stamp=Time(sec=1_800_000_000)))
    assert trajectory_request(goal, OURS, lambda sec, _: sec - 1_799_999_990.0).stamp_s == 10.0


def test_tolerances_of_a_goal_take_the_place_of_those_of_the_node() -> None:
    asked = goal_of(
        message((1.0, still(0.1))),
        path=[tolerance('axis3', 0.5), tolerance('axis1', -1.0), tolerance('axis2', 0.0)],
        goal=[tolerance('axis2', 0.004, velocity=-1.0)],
        time=Duration(sec=2, nanosec=250_000_000),
    )
    assert trajectory_request(asked, OURS).tolerances == Tolerances(
        path_rad=(0.0, 0.2, 0.5), goal_rad=(0.01, 0.004, 0.03), goal_time_s=2.25, stopped_rad_s=0.04
    )


def test_a_goal_time_of_minus_one_is_for_ever() -> None:
    request = trajectory_request(goal_of(message((1.0, still(0.1))), time=Duration(sec=-1)), OURS)
    assert request.tolerances is not None
    assert request.tolerances.goal_time_s == 0.0


LINE = message((1.0, still(0.1)))


@pytest.mark.parametrize(
    ('bad', 'reason'),
    [
        (goal_of(JointTrajectory()), 'the trajectory has no points; to stop, cancel the goal'),
        (goal_of(message((1.0, {'positions': [0, 0]}))), 'point 1: positions has 2 values'),
        (goal_of(LINE, path=[tolerance('axis1', -2.0)]), 'path_tolerance of axis1 is -2, but must be above 0, 0 (the '),
        (goal_of(LINE, goal=[tolerance('axis1', np.nan)]), 'goal_tolerance of axis1 is nan'),
        (goal_of(LINE, goal=[tolerance('axis1', np.inf)]), 'goal_tolerance of axis1 is inf'),
        (goal_of(LINE, path=[tolerance('axis2', 0.1, velocity=0.5)]), 'path_tolerance of axis2 has velocity 0.5, but'),
        (goal_of(LINE, goal=[tolerance('axis2', 0.1, acceleration=2.0)]), 'goal_tolerance of axis2 has acceleration 2'),
        (goal_of(LINE, time=Duration(sec=-2)), 'goal_time_tolerance is -2, but must be'),
        (goal_of(message((1.0, still(0.1)), names=['a', 'b', 'c'])), "joint_names are 'a, b, c'"),
        (goal_of(LINE, path=[tolerance('elbow', 0.1)]), "path_tolerance names 'elbow'"),
        (goal_of(LINE, component_path_tolerance=[1]), 'component_path_tolerance is not supported'),
        (
            goal_of(LINE, multi_dof_trajectory=SimpleNamespace(joint_names=['base'], points=[])),
            'multi_dof_trajectory is not supported',
        ),
    ],
)  # fmt: skip
def test_invalid_goal_is_rejected_with_its_error(bad: Any, reason: str) -> None:
    with pytest.raises(ProgramError) as caught:
        trajectory_request(bad, OURS)
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ('code', 'name'),
    [
        (Arrival.OFF_PATH, 'PATH_TOLERANCE_VIOLATED'),
        (Arrival.OFF_GOAL, 'GOAL_TOLERANCE_VIOLATED'),
        (Arrival.CANCELLED, 'INVALID_GOAL'),
        (Code.CONTENT, 'INVALID_GOAL'),
        (Code.STATE, 'INVALID_GOAL'),
        (Code.CONTROL, 'INVALID_GOAL'),
        (Code.FAULT, 'INVALID_GOAL'),
    ],
)
def test_a_reason_is_one_of_the_error_codes_of_the_action(code: Code | Arrival, name: str) -> None:
    assert error_code_of(code) == name


# a robot


def services(graph: Any) -> list[str]:
    return [name for name, _ in graph.listener.get_service_names_and_types()]


@pytest.mark.skipif(
    control_type('FollowJointTrajectory') is not None,
    reason='control_msgs is installed: the action is there',
)
def test_without_control_msgs_only_the_action_is_missing(graph: Any) -> None:
    cell = Cell(graph)
    assert cell.send(message((0.5, still(0.1)))).startswith('accepted')
    assert not [name for name in services(graph) if 'follow_joint_trajectory' in name]


class Driver:
    """A client of the action."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.graph, self.feedback = cell, cell.graph, []  # type: ignore[var-annotated]
        self.type = importlib.import_module('control_msgs.action').FollowJointTrajectory
        self.tolerance = importlib.import_module('control_msgs.msg').JointTolerance
        self._requests = self.graph.listen(String, 'unit_robot/requests', REQUEST)
        self.client = ActionClient(self.graph.listener, self.type, ACTION)
        self.graph.spin_until(self.client.server_is_ready, 'the action')

    @property
    def reports(self) -> list[dict[str, Any]]:
        return [json.loads(report.data) for report in self._requests]

    def send(self, trajectory: JointTrajectory, **options: Any) -> Any:
        """Send a goal that is accepted; returns its handle."""
        handle = self.ask(trajectory, **options)
        assert handle.accepted
        return handle

    def rejection(self, trajectory: JointTrajectory, **options: Any) -> str:
        """Send a goal that is rejected; returns the sentence, which everybody can read."""
        known = len(self.reports)
        assert not self.ask(trajectory, **options).accepted
        self.graph.spin_until(lambda: 'refused' in self.states(known), 'the report')
        (refused,) = (report for report in self.reports[known:] if report['state'] == 'refused')
        assert self.cell.answers[-1].data == f'refused: {refused["sentence"]}'
        return str(refused['sentence'])

    def states(self, first: int = 0) -> list[str]:
        return [report['state'] for report in self.reports[first:]]

    def ask(self, trajectory: JointTrajectory, time_s: float = 0.0, **tolerances: dict[str, float]) -> Any:
        """Send a goal; returns its handle."""
        goal = self.type.Goal(trajectory=trajectory)
        goal.goal_time_tolerance = Duration(nanosec=round(time_s * 1e9))
        for kind, positions in tolerances.items():
            found = [self.tolerance(name=name, position=value) for name, value in positions.items()]
            setattr(goal, f'{kind}_tolerance', found)
        sent = self.client.send_goal_async(
            goal, feedback_callback=lambda told: self.feedback.append(told.feedback)
        )
        self.graph.spin_until(sent.done, 'the goal')
        return sent.result()

    def end(self, handle: Any) -> tuple[int, int, str]:
        """Return state, error code and sentence with which a goal ends."""
        asked = handle.get_result_async()
        self.graph.spin_until(asked.done, 'the result')
        result = asked.result().result
        return asked.result().status, result.error_code, result.error_string

    def drive(self, trajectory: JointTrajectory, **options: Any) -> tuple[int, int, str]:
        return self.end(self.send(trajectory, **options))


@pytest.fixture
def driver(control_msgs: Any, graph: Any) -> Iterator[Driver]:
    found = Driver(Cell(graph))
    yield found
    found.client.destroy()


SUCCEEDED = (GoalStatus.STATUS_SUCCEEDED, 0, 'the arms have reached the goal')


def test_client_drives_the_arms_and_receives_progress_and_result(driver: Driver) -> None:
    cell = driver.cell
    end = {**still([0.2, 0.1, 0.15]), 'accelerations': [0.0, 0.0, 0.0]}
    every = dict.fromkeys(AXES, 1e-3)
    assert driver.drive(message((1.5, end)), path=every, goal=every, time_s=0.2) == SUCCEEDED
    assert cell.missed([0.2, 0.1, 0.15]) <= 1.01 * 2.0 * HALF_INCREMENT
    assert driver.feedback
    stamps = []
    for told in driver.feedback:
        assert told.joint_names == AXES
        desired, actual = np.array(told.desired.positions), np.array(told.actual.positions)
        assert np.abs(desired - actual).max() < 1e-3
        assert np.array(told.error.positions) == pytest.approx(desired - actual)
        assert len(told.desired.accelerations) == len(told.actual.velocities) == 3
        stamps.append((told.header.stamp.sec, told.header.stamp.nanosec))
    assert stamps == sorted(set(stamps))
    # the next goal begins where this one has ended, and has no tolerances at all
    assert driver.drive(message((0.8, still(0.0)))) == SUCCEEDED
    assert cell.missed(0.0) <= 1.01 * 2.0 * HALF_INCREMENT


def test_the_state_of_the_controller_contains_expected_and_actual_angles(driver: Driver) -> None:
    kind = importlib.import_module('control_msgs.msg').JointTrajectoryControllerState
    states = driver.graph.listen(kind, CONTROLLER_STATE, REQUEST)
    driver.graph.spin_until(lambda: states, 'a state at rest')
    assert driver.drive(message((1.0, still(0.2)))) == SUCCEEDED
    known = len(states)
    driver.graph.spin_until(lambda: len(states) > known + 2, 'a state at the end')
    for state in states:
        reference, actual = np.array(state.reference.positions), np.array(state.feedback.positions)
        assert (state.joint_names, state.speed_scaling_factor) == (AXES, 1.0)
        assert np.array(state.error.positions) == pytest.approx(reference - actual, abs=1e-12)
        assert np.abs(reference - actual).max() < FOLLOWING_RAD
    stamps = [(state.header.stamp.sec, state.header.stamp.nanosec) for state in states]
    assert stamps == sorted(set(stamps))
    assert max(np.abs(state.feedback.velocities).max() for state in states) > 0.1
    assert states[-1].feedback.positions.tolist() == pytest.approx((HOME + 0.2).tolist(), abs=1e-4)


def test_an_invalid_goal_is_rejected_and_its_reason_published(driver: Driver) -> None:
    cell = driver.cell
    sentence = driver.rejection(message((1.0, still(2.0))))
    assert 'the angle of arm 1 is 111 deg at 1.0000 s, before point 1, the limit is 95 deg' in sentence
    assert driver.states() == ['planning', 'refused']
    assert driver.rejection(message((1.0, still(0.1)), names=['a', 'b', 'c'])).startswith('joint_names are ')
    assert driver.rejection(message((1.0, still(np.nan)))).startswith('point 1: positions of axis1 is nan')
    assert driver.rejection(JointTrajectory()).startswith('the trajectory has no points')
    cell.graph.spin_until(lambda: cell.task.progress().bus_time_s > 1.0, 'bus time')
    late = message((0.5, still(0.1)), stamp=Time(nanosec=1))
    assert driver.rejection(late).startswith('it is over')
    assert len({report['id'] for report in driver.reports}) == 5
    assert cell.operator.state == 'idle'
    assert driver.drive(message((0.8, still(0.1)))) == SUCCEEDED


def test_a_second_goal_replaces_the_first_one_and_stops_on_its_path_when_it_is_cancelled(
    driver: Driver,
) -> None:
    cell = driver.cell
    first = driver.send(message((20.0, still(0.3))))
    cell.wait_for('moving')
    second = driver.send(message((10.0, still(0.1))))
    status, code, sentence = driver.end(first)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, driver.type.Result.INVALID_GOAL)
    assert sentence == 'another program was started'
    assert cell.operator.state == 'moving'
    cancelled = second.cancel_goal_async()
    cell.graph.spin_until(cancelled.done, 'the cancellation')
    assert len(cancelled.result().goals_canceling) == 1
    status, _, sentence = driver.end(second)
    assert (status, sentence) == (GoalStatus.STATUS_CANCELED, 'the program was aborted')
    assert cell.missed(0.3) > HALF_INCREMENT
    assert driver.drive(message((1.0, still(0.1)))) == SUCCEEDED


def test_a_goal_replaced_by_a_message_ends_and_the_arms_come_to_the_last_point(driver: Driver) -> None:
    """Points without speeds, as a slider sends them: each one is followed within the limits of the robot."""
    cell = driver.cell
    goal = driver.send(message((5.0, still(0.1))))
    cell.wait_for('moving')
    for by in (0.3, 0.05, 0.2):
        point = {'positions': HOME + by}
        assert cell.send(message((0.25, point))).startswith('accepted: replaced by "joint_trajectory"')
    assert driver.end(goal)[0] == GoalStatus.STATUS_ABORTED
    cell.wait_for('idle')
    assert cell.missed(0.2) <= HALF_INCREMENT


def test_a_goal_that_a_limit_keeps_from_its_end_is_aborted_at_rest(driver: Driver) -> None:
    """A smoothed robot keeps 0.5 mm from the limits of the workspace."""
    cell = driver.cell
    bottom = kinematics.inverse((0.0, 0.0, -0.9499), parameters.load().kinematics)
    goal = driver.send(message((0.3, {'positions': bottom})))
    status, code, sentence = driver.end(goal)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, driver.type.Result.INVALID_GOAL)
    assert sentence == 'the program was aborted'
    cell.wait_for('idle')
    assert driver.drive(message((2.0, still(0.1)))) == SUCCEEDED


def test_client_without_control_neither_moves_nor_cancels(driver: Driver) -> None:
    cell = driver.cell
    first = driver.send(message((20.0, still(0.3))))
    cell.wait_for('moving')
    cell.operator.take_control('somebody')
    cancelled = first.cancel_goal_async()
    cell.graph.spin_until(cancelled.done, 'the cancellation')
    assert cancelled.result().goals_canceling == []
    assert 'control' in driver.rejection(message((1.0, still(0.1))))
    cell.operator.call('abort')  # whoever sees a danger may stop the robot
    status, code, _ = driver.end(first)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, driver.type.Result.INVALID_GOAL)


def test_a_goal_that_leaves_its_tolerances_ends_with_which_and_by_how_much(driver: Driver) -> None:
    result = driver.type.Result
    status, code, sentence = driver.drive(message((2.0, still(0.3))), path={'axis2': 1e-9})
    assert (status, code) == (GoalStatus.STATUS_ABORTED, result.PATH_TOLERANCE_VIOLATED)
    assert sentence.startswith('path tolerance violated: axis2 is ')
    # the robot has come to rest before the result is sent
    status, code, sentence = driver.drive(message((1.0, still(0.1))), goal={'axis3': 1e-12}, time_s=0.1)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, result.GOAL_TOLERANCE_VIOLATED)
    assert sentence.startswith('goal tolerance violated: axis3 is ')
    assert sentence.endswith('0.1 s after the last point, the limit is 1e-12 rad')
    for _ in range(3):
        _, code, _ = driver.drive(message((2.0, still(0.3))), path={'axis1': 1e-9})
        assert code == result.PATH_TOLERANCE_VIOLATED
    assert driver.drive(message((1.0, still(0.0)))) == SUCCEEDED


def test_a_goal_may_take_a_tolerance_of_the_node_away(control_msgs: Any, graph: Any) -> None:
    driver = Driver(Cell(graph, constraints__axis2__trajectory=1e-9))
    assert driver.drive(message((1.0, still(0.1))), path={'axis2': -1.0}) == SUCCEEDED
    _, code, _ = driver.drive(message((1.0, still(0.0))))
    assert code == driver.type.Result.PATH_TOLERANCE_VIOLATED
    driver.client.destroy()
