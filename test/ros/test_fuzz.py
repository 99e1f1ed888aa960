"""Tests of random messages to planner and task: no crash, no unrequested motion, and a ready robot."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, PoseStamped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Path
from std_msgs.msg import Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

from delta3_pacdrive import parameters
from delta3_pacdrive.control.messages import ORDER
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.numbers import numbers
from delta3_pacdrive.ros.wire.qos import LATCHED, PLAN, REQUEST
from trajectories import AXES, message

HOME = (0.0, 0.0, -0.75)
FUZZ = settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])

anything = st.floats(allow_nan=True, allow_infinity=True)
near = st.floats(-1.0, 1.0)
coordinates = st.one_of(near, anything)
points = st.tuples(coordinates, coordinates, coordinates)
frames = st.sampled_from(['base', '', 'world', 'base\n'])
KEYS = [
    'moves',
    'move_l',
    'move_c',
    'move_sb',
    'joints',
    'angles_rad',
    'speeds_rad_s',
    'dwell',
    'cubic',
    'output',
    'to_m',
    'via_m',
    'through_m',
    'by_m',
    'point',
    'limits',
    'repeat',
    'time_s',
    'blend_m',
    'points',
    'payload_kg',
    'name',
    'value',
]
leaves = st.one_of(st.none(), st.booleans(), st.integers(), anything, st.text(max_size=8))
documents = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(
            st.sampled_from(KEYS),
            inner,
            max_size=4,
        ),
    ),
    max_leaves=12,
)
texts = st.one_of(st.text(max_size=200), documents.map(repr))


def point_message(frame: str, point: tuple[float, float, float]) -> PointStamped:
    message = PointStamped()
    message.header.frame_id = frame
    message.point.x, message.point.y, message.point.z = point
    return message


def path_message(frame: str, places: list[tuple[float, float, float]]) -> Path:
    message = Path()
    message.header.frame_id = frame
    for place in places:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = place
        message.poses.append(pose)
    return message


def string_message(text: str) -> String:
    """Return a text as a message, without characters that cannot be sent."""
    return String(data=text.replace('\0', '').encode('utf-8', 'replace').decode())


REQUESTS = {
    'program': (String, texts.map(string_message)),
    'move_l': (PointStamped, st.builds(point_message, frames, points)),
    'move_c': (Path, st.builds(path_message, frames, st.lists(points, max_size=4))),
    'move_sb': (Path, st.builds(path_message, frames, st.lists(points, max_size=120))),
    'override': (Float64, st.one_of(anything, st.floats(0.0, 200.0)).map(lambda value: Float64(data=value))),
}


@pytest.fixture
def robot(graph: Any) -> Any:
    task = graph.robot(motion__start_cycle=-1)
    graph.add(UnitRobotNode, motion__start_cycle=-1)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    return task


def assert_ready(graph: Any, task: Any) -> None:
    """Check that the bus runs without a fault and that the TCP has not moved."""
    cycles = task.progress().cycles
    graph.spin_until(lambda: task.progress().cycles > cycles, 'the next cycle')
    facts = task.progress()
    assert (facts.state, facts.fault) == ('idle', '')
    assert np.abs(task.controller.task.state['tcp'][0] - HOME).max() < 1e-6


@pytest.mark.parametrize('topic', REQUESTS)
def test_no_request_kills_the_planner_or_moves_the_robot(topic: str, robot: Any, graph: Any) -> None:
    kind, messages = REQUESTS[topic]
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    publisher = graph.listener.create_publisher(kind, f'unit_robot/{topic}', REQUEST)
    graph.spin_until(publisher.get_subscription_count, 'the planner')

    @FUZZ
    @given(message=messages)
    def each(message: Any) -> None:
        heard = len(answers)
        publisher.publish(message)
        graph.spin_until(lambda: len(answers) > heard, 'the answer')
        verdict, _, sentence = answers[-1].data.partition(': ')
        assert verdict in ('accepted', 'refused')
        assert 0 < len(sentence) < 1500
        assert '\n' not in sentence

    each()
    assert_ready(graph, robot)


numbers_of_a_point = st.one_of(
    st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3), st.lists(anything, max_size=4)
)
trajectory_points = st.lists(
    st.tuples(
        st.floats(0.0, 2.0),
        st.fixed_dictionaries(
            {'positions': numbers_of_a_point},
            optional={'velocities': st.just([0.0] * 3), 'effort': numbers_of_a_point},
        ),
    ),
    max_size=4,
).map(lambda found: sorted(found, key=lambda point: point[0]))
trajectories = st.builds(
    lambda found, names, stamp: message(*found, names=names, stamp=stamp),
    trajectory_points,
    st.one_of(st.permutations(AXES), st.lists(st.sampled_from([*AXES, '']), max_size=4)),
    st.builds(Time, sec=st.sampled_from([0, 0, 0, -1, 1, 2**31 - 1])),
)


def test_no_trajectory_kills_the_planner_and_every_accepted_one_is_driven_to_its_end(
    robot: Any, graph: Any
) -> None:
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    publisher = graph.listener.create_publisher(JointTrajectory, 'joint_trajectory', REQUEST)
    graph.spin_until(publisher.get_subscription_count, 'the planner')

    @FUZZ
    @given(trajectory=trajectories)
    def each(trajectory: JointTrajectory) -> None:
        heard = len(answers)
        publisher.publish(trajectory)
        graph.spin_until(lambda: len(answers) > heard, 'the answer')
        verdict, _, sentence = answers[-1].data.partition(': ')
        assert verdict in ('accepted', 'refused')
        assert 0 < len(sentence) < 1500
        assert '\n' not in sentence
        graph.spin_until(lambda: robot.progress().state == 'idle', 'rest')
        assert robot.progress().fault == ''

    each()


ARC = {'move_c': {'via_m': [0.1, 0.1, -0.8], 'to_m': [0.2, 0.0, -0.8]}}
ARMS = {
    'joints': {'points': [{'time_s': 1.0, 'angles_rad': [0.3, 0.4, 0.2], 'speeds_rad_s': [0.0, 0.0, 0.0]}]}
}


def good_row(statement: dict[str, Any]) -> list[float]:
    parameters_ = parameters.load()
    document = {'moves': [statement]}
    plan = program_planner.plan(
        programs.parse(document, parameters_.motion), (0.0, 0.01, -0.76), parameters_
    ).plan
    return list(plan.moves[0].to_array(0, 1).tolist())


GOOD = {'ARC': good_row(ARC), 'JOINTS': good_row(ARMS)}


def rows(good: list[float]) -> Any:
    """Return rows of any numbers, and of good ones with one that is not, or cut off."""
    return st.one_of(
        st.lists(anything, max_size=80),
        st.tuples(st.integers(0, len(good) - 1), anything).map(
            lambda t: [*good[: t[0]], t[1], *good[t[0] + 1 :]]
        ),
        st.integers(0, len(good)).map(lambda n: good[:n]),
    )


orders = st.lists(st.one_of(st.integers(-2, 5).map(float), anything), max_size=8)


@pytest.mark.parametrize('kind', GOOD)
def test_plan_or_motion_profile_of_another_publisher_neither_kills_the_task_nor_moves_the_robot(
    kind: str, robot: Any, graph: Any
) -> None:
    plan = graph.listener.create_publisher(Float64MultiArray, 'motion/plan', PLAN)
    change = graph.listener.create_publisher(Float64MultiArray, 'motion/change', PLAN)
    graph.spin_until(lambda: plan.get_subscription_count() and change.get_subscription_count(), 'the task')

    count = itertools.count(1)
    row_of, ordered, profile = (graph.label(what, 0).removesuffix('0') for what in (kind, ORDER, 'COURSE'))

    @FUZZ
    @given(row=rows(GOOD[kind]), order=orders)
    def each(row: list[float], order: list[float]) -> None:
        number = next(count)  # as the robot's own planner would count
        plan.publish(numbers(row, f'{row_of}{number}'))
        plan.publish(numbers(order, f'{ordered}{number}'))
        change.publish(numbers(row, f'{profile}{2 * number}'))
        change.publish(numbers(order, f'{profile}{2 * number + 1}'))
        # the plan starts 14 mm away from the robot, so that even a faultless one must be refused
        assert_ready(graph, robot)

    each()


@pytest.mark.parametrize('kind', GOOD)
def test_the_good_plan_would_be_taken_where_it_starts(kind: str) -> None:
    """The fuzzed rows differ from something that is accepted."""
    from delta3_pacdrive.planning.paths.move import Move

    move, number, count = Move.from_array(GOOD[kind], parameters.load().kinematics)
    assert (number, count) == (0, 1)
    assert math.isfinite(move.duration_s)
