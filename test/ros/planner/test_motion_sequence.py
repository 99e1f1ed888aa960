"""Tests of the action ``motion_sequence``, with goals as in the tests of motion_primitives_forward_controller."""

import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient

from trajectories import GEAR, HALF_INCREMENT, HOME, Cell

ACTION = 'unit_robot/motion_sequence'
LAST_COMMAND = 1.01 * 2.0 * HALF_INCREMENT  # rounding of commands to increments


class Driver:
    """A client of the action."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.graph = cell, cell.graph
        self.type = importlib.import_module('control_msgs.action').ExecuteMotionPrimitiveSequence
        self.messages = importlib.import_module('control_msgs.msg')
        self.indices: list[int] = []
        self.client = ActionClient(self.graph.listener, self.type, ACTION)
        self.graph.spin_until(self.client.server_is_ready, 'the action')

    def joint(self, positions: Any, radius: float = 0.0, **arguments: float) -> Any:
        return self._primitive(
            'LINEAR_JOINT', radius, arguments, joint_positions=[float(q) for q in positions]
        )

    def line(self, *point: float, radius: float = 0.0, **arguments: float) -> Any:
        return self._primitive('LINEAR_CARTESIAN', radius, arguments, poses=[_pose(point)])

    def circle(self, end: Any, via: Any, **arguments: float) -> Any:
        return self._primitive('CIRCULAR_CARTESIAN', 0.0, arguments, poses=[_pose(end), _pose(via)])

    def _primitive(self, kind: str, radius: float, arguments: dict[str, float], **target: Any) -> Any:
        found = self.messages.MotionPrimitive(blend_radius=radius, **target)
        found.type = getattr(found, kind)
        found.additional_arguments = [
            self.messages.MotionArgument(name=name, value=value) for name, value in arguments.items()
        ]
        return found

    def ask(self, *motions: Any) -> Any:
        """Send a goal; returns its handle."""
        goal = self.type.Goal()
        goal.trajectory.motions = list(motions)
        sent = self.client.send_goal_async(
            goal,
            feedback_callback=lambda told: self.indices.append(told.feedback.current_primitive_index),
        )
        self.graph.spin_until(sent.done, 'the goal')
        return sent.result()

    def end(self, handle: Any) -> tuple[int, int, str]:
        """Return state, error code and sentence with which a goal ends."""
        assert handle.accepted
        asked = handle.get_result_async()
        self.graph.spin_until(asked.done, 'the result')
        result = asked.result().result
        return asked.result().status, result.error_code, result.error_string


def _pose(point: Any) -> PoseStamped:
    found = PoseStamped()
    found.pose.position.x, found.pose.position.y, found.pose.position.z = point
    return found


@pytest.fixture
def driver(control_msgs: Any, graph: Any) -> Iterator[Driver]:
    found = Driver(Cell(graph))
    yield found
    found.client.destroy()


SUCCEEDED = (GoalStatus.STATUS_SUCCEEDED, 0, 'the motion primitives were executed')


def test_a_single_joint_motion_ends_at_its_angles(driver: Driver) -> None:
    by = [0.1, 0.2, 0.15]
    motion = driver.joint(HOME + by, radius=3.0, velocity=0.7, acceleration=1.0, move_time=2.0)
    assert driver.end(driver.ask(motion)) == SUCCEEDED
    assert driver.cell.missed(by) <= LAST_COMMAND
    assert driver.cell.answers[-1].data == 'accepted: started "motion sequence": 1 move, 2.000 s'


def test_a_sequence_of_all_types_reports_the_index_of_its_primitive(driver: Driver) -> None:
    motions = [
        driver.joint(HOME + 0.1, velocity=0.5, acceleration=2.0),
        driver.line(0.1, 0.0, -0.8, radius=0.02, velocity=0.3),
        driver.line(0.1, 0.1, -0.8, velocity=0.3, acceleration=5.0),
        driver.circle((-0.1, 0.1, -0.8), (0.0, 0.15, -0.8), velocity=0.3),
        driver.line(0.0, 0.0, -0.75, move_time=1.0),
    ]
    assert driver.end(driver.ask(*motions)) == SUCCEEDED
    assert driver.cell.missed(0.0) <= GEAR * 1e-6 + LAST_COMMAND
    assert driver.indices[-1] == 4
    assert driver.indices == sorted(set(driver.indices))
    assert len(driver.indices) > 2


def test_an_invalid_sequence_is_rejected_with_one_sentence(driver: Driver) -> None:
    answers = driver.cell.answers
    assert not driver.ask(driver.joint([0.1, 0.2, 0.3, 0.4, 0.5, 0.6], velocity=0.7)).accepted
    sentence = 'motions[0]: LINEAR_JOINT needs 3 joint_positions, one per arm, but has 6 values'
    assert answers[-1].data == f'refused: {sentence}'
    assert not driver.ask(driver.messages.MotionPrimitive()).accepted
    assert answers[-1].data.startswith('refused: motions[0]: type -1 is not supported')
    assert not driver.ask(driver.line(3.0, 0.0, -0.8)).accepted
    assert answers[-1].data.startswith('refused: ')
    assert driver.cell.operator.state == 'idle'
    assert driver.end(driver.ask(driver.line(0.1, 0.0, -0.8))) == SUCCEEDED


def test_a_second_sequence_is_rejected_and_cancelling_stops_the_first_one_on_its_path(driver: Driver) -> None:
    first = driver.ask(driver.line(0.2, 0.0, -0.75, move_time=20.0), driver.line(0.2, 0.2, -0.75))
    driver.graph.spin_until(lambda: driver.cell.missed(0.0) > GEAR * 0.01, 'motion')
    assert not driver.ask(driver.line(0.1, 0.0, -0.8)).accepted
    assert 'the robot is moving' in driver.cell.answers[-1].data
    cancelled = first.cancel_goal_async()
    driver.graph.spin_until(cancelled.done, 'the cancellation')
    status, _, sentence = driver.end(first)
    assert (status, sentence) == (GoalStatus.STATUS_CANCELED, 'the program was aborted')
    stopped = np.array(driver.cell.commands[-1].position) / GEAR
    # on the line along x, the second and third arm have equal angles
    assert stopped[1] == pytest.approx(stopped[2], abs=1e-5)
    assert driver.end(driver.ask(driver.line(0.0, 0.0, -0.75))) == SUCCEEDED


def test_an_abort_ends_a_sequence_as_invalid(driver: Driver) -> None:
    first = driver.ask(driver.line(0.2, 0.0, -0.75, move_time=20.0))
    driver.cell.wait_for('moving')
    driver.cell.operator.call('abort')
    status, code, _ = driver.end(first)
    assert (status, code) == (GoalStatus.STATUS_ABORTED, driver.type.Result.INVALID_GOAL)
