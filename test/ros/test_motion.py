"""Tests of moves by any ROS client: queue, start, hold, resume, override, abort, outputs, rejections, over real DDS."""

import itertools
import json
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseStamped, Vector3Stamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from std_srvs.srv import Trigger

from delta3_pacdrive import parameters
from delta3_pacdrive.control.messages import ORDER
from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.numbers import numbers
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, PLAN, PLAN_LATECOMER, REQUEST

CYCLE_S = 1e-3
ALONG = 0.2  # m
LATER = 4000  # bus cycles
START_M = 1e-7  # the robot stands where its encoders' increments say
LINE = f'moves: [{{move_l: {{to_m: [{ALONG}, 0.0, -0.75], speed_m_s: 0.5}}}}]'
LONG = f'moves: [{{move_l: {{to_m: [{ALONG}, 0.0, -0.75], speed_m_s: 0.2}}}}]'


class Cell:
    """A robot without a clock, its planner and an operator."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
        self.master = graph.listen(Vector3Stamped, 'motion/master', CYCLIC_PUBLISHER)
        self.profiles = graph.listen(Float64MultiArray, 'motion/course', LATCHED)
        self.outputs = graph.listen(JointState, 'outputs', LATCHED)
        self.answers = graph.listen(String, 'unit_robot/answer', LATCHED)
        self.task = graph.robot(motion__start_cycle=-1)
        self.planner = graph.add(UnitRobotNode, motion__start_cycle=-1)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def start(self, text: str) -> None:
        """Queue a program, start it and wait until it moves."""
        self.operator.send_program(text)
        self.operator.call('start')
        self.graph.spin_until(lambda: self.operator.state == 'moving', 'the motion')

    def wait_for(self, state: str) -> None:
        """Wait until the robot is in a state."""
        self.graph.spin_until(lambda: self.operator.state == state, state)

    def reach(self, share: float) -> None:
        """Wait until the master has done a share of the line."""
        self.graph.spin_until(lambda: self.task.progress().master_m > share * ALONG, f'{share} of the line')

    def path(self) -> np.ndarray:
        """Return commanded positions, cycle by cycle; no cycle is missing."""
        cyclic = [m for m in self.commands if m.header.stamp.sec >= 0]
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in cyclic]
        assert all(b - a == 1_000_000 for a, b in itertools.pairwise(stamps))
        return np.array([[m.point.x, m.point.y, m.point.z] for m in cyclic])


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def limits() -> tuple[float, float]:
    motion = parameters.load().motion
    return motion.acceleration_max_m_s2, motion.jerk_max_m_s3


def assert_smooth(path: np.ndarray, factor: float = 1.0) -> None:
    """Differences of the commands, averages over three cycles at most, keep the limits of the move."""
    acceleration_max, jerk_max = limits()
    acceleration = np.linalg.norm(np.diff(path, 2, axis=0), axis=1) / CYCLE_S**2
    jerk = np.linalg.norm(np.diff(path, 3, axis=0), axis=1) / CYCLE_S**3
    assert acceleration.max() <= acceleration_max * factor**2 * (1 + 1e-3)
    # a third difference of positions that are rounded to 1e-16 m
    assert jerk.max() <= jerk_max * factor**3 * (1 + 1e-2)


def test_held_program_rests_on_its_line_and_continues_to_its_end(cell: Cell) -> None:
    cell.start(LONG)
    cell.reach(0.3)
    assert 'stops from bus cycle' in cell.operator.call('hold')
    cell.wait_for('stopped')
    stood = cell.task.progress().master_m
    assert 0.3 * ALONG < stood < ALONG
    assert 'stopped' in refusal(cell, lambda: cell.operator.call('hold'))
    assert 'stopped' in refusal(cell, lambda: cell.operator.call('start'))
    cell.graph.spin_until(lambda: cell.task.progress().master_m == stood, 'standstill')
    cell.operator.call('resume')
    cell.wait_for('idle')
    path = cell.path()
    assert path[-1] == pytest.approx([ALONG, 0.0, -0.75], abs=1e-12)
    assert np.abs(path[:, 1:] - [0.0, -0.75]).max() < START_M
    assert np.diff(path[:, 0]).min() > -1e-12
    assert_smooth(path)
    # it stood for a while in the middle
    assert ((path[1:, 0] == path[:-1, 0]) & (path[1:, 0] > 0.01) & (path[1:, 0] < 0.99 * ALONG)).sum() > 10
    profiles = [list(message.data) for message in cell.profiles]
    assert [profile[3] for profile in profiles] == [0.0, 1.0, 0.0]  # start, held, resumed


def test_override_changes_the_speed_without_leaving_the_path(cell: Cell) -> None:
    cell.start(LONG)
    for share, percent in ((0.15, 50.0), (0.35, 150.0), (0.6, 100.0)):
        cell.reach(share)
        cell.operator.override(percent)
    cell.wait_for('idle')
    path = cell.path()
    assert path[-1] == pytest.approx([ALONG, 0.0, -0.75], abs=1e-12)
    assert np.abs(path[:, 1:] - [0.0, -0.75]).max() < START_M
    assert_smooth(path, 1.5)
    speeds = np.diff(path[:, 0]) / CYCLE_S
    for share in (0.1, 0.2, 0.3):  # 50, 100 and 150 % of 0.2 m/s were all driven for a while
        assert (np.abs(speeds - share) < 1e-6).sum() > 10, share
    assert speeds.max() < 0.3 + 1e-6


def test_aborted_program_is_cleared_and_the_next_one_starts_at_the_position_of_the_robot(cell: Cell) -> None:
    cell.start(LONG)
    cell.reach(0.2)
    cell.operator.call('abort')
    cell.wait_for('idle')
    x = cell.task.progress().master_m
    assert 'idle' in refusal(cell, lambda: cell.operator.call('resume'))
    cell.start('moves: [{move_l: {to_m: {by_m: [0.0, 0.05, 0.0]}}}]')
    cell.wait_for('idle')
    path = cell.path()
    assert path[-1] == pytest.approx([x, 0.05, -0.75], abs=START_M)
    assert_smooth(path)


def test_outputs_and_payload_change_in_the_cycle_in_which_the_master_passes_their_place(cell: Cell) -> None:
    text = (
        'payload_kg: 0.0\n'
        'moves:\n'
        f'- move_l: {{to_m: [{ALONG}, 0.0, -0.75]}}\n'
        '- output: {name: gripper, value: true, before_m: 0.05, payload_kg: 0.25}\n'
        '- output: {name: output2, value: true}\n'
    )
    cell.start(text)
    cell.wait_for('idle')
    passed = next(m for m in cell.master if m.vector.x >= ALONG - 0.05)
    gripped = next(m for m in cell.outputs if m.position[0] == 1.0)
    assert gripped.header.stamp == passed.header.stamp
    assert dict(zip(gripped.name, gripped.position, strict=True))['payload_kg'] == 0.25
    ended = next(m for m in cell.master if m.vector.x > ALONG / 2 and m.vector.y == 0.0)
    last = next(m for m in cell.outputs if m.position[2] == 1.0)
    assert last.header.stamp == ended.header.stamp
    assert cell.outputs[-1].position[:3].tolist() == [1.0, 0.0, 1.0]


def test_moves_are_accepted_as_messages_of_standard_types(cell: Cell) -> None:
    def pose(x: float, y: float, z: float) -> PoseStamped:
        made = PoseStamped()
        made.pose.position.x, made.pose.position.y, made.pose.position.z = x, y, z
        return made

    listener = cell.graph.listener
    line = listener.create_publisher(PointStamped, 'unit_robot/move_l', REQUEST)
    circle = listener.create_publisher(Path, 'unit_robot/move_c', REQUEST)
    spline = listener.create_publisher(Path, 'unit_robot/move_sb', REQUEST)
    publishers = (line, circle, spline)
    cell.graph.spin_until(lambda: all(p.get_subscription_count() for p in publishers), 'the planner')
    target = PointStamped()
    target.header.frame_id = 'base'
    target.point.x, target.point.z = 0.1, -0.8
    arc, through = Path(), Path()
    arc.header.frame_id = through.header.frame_id = 'base'
    arc.poses = [pose(0.0, 0.1, -0.8), pose(-0.1, 0.0, -0.8)]
    through.poses = [pose(0.0, -0.1, -0.82), pose(0.1, 0.0, -0.84), pose(0.0, 0.0, -0.8)]
    line.publish(target)
    circle.publish(arc)
    cell.graph.spin_until(lambda: '2 moves' in cell.answers[-1].data if cell.answers else False, 'two moves')
    spline.publish(through)
    cell.graph.spin_until(lambda: '3 moves' in cell.answers[-1].data, 'three moves')
    cell.operator.call('start')
    cell.wait_for('moving')
    cell.wait_for('idle')
    path = cell.path()
    assert path[-1] == pytest.approx([0.0, 0.0, -0.8], abs=1e-9)
    begun = 0
    for place in (
        [0.1, 0.0, -0.8],
        [0.0, 0.1, -0.8],
        [-0.1, 0.0, -0.8],
        [0.0, -0.1, -0.82],
        [0.1, 0.0, -0.84],
    ):
        # half of a cycle's way at 1.5 m/s; one after the other, the circle half round
        near = np.flatnonzero(np.linalg.norm(path[begun:] - place, axis=1) < 0.8e-3)
        assert len(near), place
        begun += int(near[0])
    assert path[:, 1].min() > -0.15
    half = path[: int(np.argmax(path[:, 0] < -0.0999))]
    assert half[:, 1].min() > -1e-6  # the circle does not go on below


def refusal(cell: Cell, action: Any) -> str:
    """Return the message of a rejected request."""
    with pytest.raises((ProgramError, RunError)) as caught:
        action()
    sentence = str(caught.value)
    assert '\n' not in sentence
    assert 0 < len(sentence) < 600
    return sentence


BAD_PROGRAMS = [
    ('moves: [{move_l: {to_m: [0.7, 0, -0.8]}}]', 'the distance from the z axis is 0.7'),
    ('moves: [{move_l: {to_m: [0.1, 0, -800]}}]', 'are these millimetres?'),
    ('moves: [{move_l: {to_m: [.nan, 0, -0.8]}}]', 'not nan'),
    ('moves: [{move_l: {to_m: [0, 0, -0.75]}}]', 'already at'),
    ('moves: [{move_c: {via_m: [0.1, 0, -0.75], to_m: [0.2, 0, -0.75]}}]', 'on a line'),
    ('moves: [{move_sb: {through_m: []}}]', 'must hold 1 to 100'),
    ('moves: []', 'at least one move'),
    ('a: &a [*a]', 'not valid YAML'),
    ('no_such_program', 'must be a mapping'),
    ('[' * 3000, 'not valid YAML'),
]


def test_invalid_program_gives_one_message_and_leaves_the_robot_ready(cell: Cell) -> None:
    for text, reason in BAD_PROGRAMS:
        assert reason in refusal(cell, lambda text=text: cell.operator.send_program(text)), text[:100]
        assert 'no moves are in the queue' in refusal(cell, lambda: cell.operator.call('start'))
    cell.start(LINE)
    cell.wait_for('idle')
    assert cell.path()[-1] == pytest.approx([ALONG, 0.0, -0.75], abs=1e-12)


def test_invalid_move_leaves_the_queue_unchanged(cell: Cell) -> None:
    cell.operator.send_program(LINE)
    refusal(cell, lambda: cell.operator.send_program('moves: [{move_l: {to_m: [0, 0, -0.5]}}]'))
    cell.operator.call('start')
    cell.wait_for('moving')
    assert 'moving' in refusal(cell, lambda: cell.operator.send_program(LINE))
    assert 'moving' in refusal(cell, lambda: cell.operator.call('resume'))
    cell.wait_for('idle')
    assert cell.task.progress().moves == 1


def test_an_override_out_of_range_is_rejected(cell: Cell) -> None:
    for percent in (0.0, 0.5, 151.0, -20.0, math.nan, math.inf):
        assert 'must be between 1 and 150' in refusal(cell, partial(cell.operator.override, percent)), percent


def test_a_point_in_another_frame_is_rejected(cell: Cell) -> None:
    publisher = cell.graph.listener.create_publisher(PointStamped, 'unit_robot/move_l', REQUEST)
    cell.graph.spin_until(publisher.get_subscription_count, 'the planner')
    stranger = PointStamped()
    stranger.header.frame_id = 'world'
    stranger.point.z = -0.8
    publisher.publish(stranger)
    cell.graph.spin_until(lambda: cell.answers, 'the answer')
    assert cell.answers[-1].data == 'refused: frame_id is \'world\', but must be "base"'


def test_a_path_with_a_pose_in_another_frame_is_rejected(cell: Cell) -> None:
    publisher = cell.graph.listener.create_publisher(Path, 'unit_robot/move_c', REQUEST)
    cell.graph.spin_until(publisher.get_subscription_count, 'the planner')
    stranger = Path(poses=[PoseStamped(), PoseStamped()])
    stranger.header.frame_id = 'base'
    stranger.poses[1].header.frame_id = 'world'
    publisher.publish(stranger)
    cell.graph.spin_until(lambda: cell.answers, 'the answer')
    assert cell.answers[-1].data == 'refused: frame_id is \'world\', but must be "base"'


def test_late_subscriber_gets_the_active_plan(cell: Cell) -> None:
    cell.start(LONG)
    rows = cell.graph.listen(Float64MultiArray, 'motion/plan', PLAN_LATECOMER)
    cell.graph.spin_until(lambda: len(rows) == 2, 'the line and the order of it')
    line, order = (row.layout.dim[0].label.split()[0] for row in rows)
    assert (line, order) == ('LINE', ORDER)
    assert cell.operator.state == 'moving'


def test_damaged_plans_and_motion_profiles_of_another_publisher_move_nothing(cell: Cell) -> None:
    refusals = cell.graph.listen(String, 'motion/refusal', REQUEST)
    plan = cell.graph.listener.create_publisher(Float64MultiArray, 'motion/plan', PLAN)
    change = cell.graph.listener.create_publisher(Float64MultiArray, 'motion/change', PLAN)
    cell.graph.spin_until(
        lambda: plan.get_subscription_count() and change.get_subscription_count(), 'the task'
    )
    robot = parameters.load()
    document = {'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.8]}}]}
    moved = program_planner.plan(programs.parse(document, robot.motion), (0.0, 0.0, -0.74), robot).plan.moves[
        0
    ]
    profile = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    order = [-1, 1.0, 0.0]
    messages = [
        (plan, [numbers([], cell.graph.label('LINE', 1)), numbers(order, cell.graph.label(ORDER, 1))]),
        (
            plan,
            [
                numbers([math.nan] * 40, cell.graph.label('LINE', 2)),
                numbers(order, cell.graph.label(ORDER, 2)),
            ],
        ),
        (plan, [numbers(order, cell.graph.label(ORDER, 3))]),
        (
            plan,
            [
                numbers(moved.to_array(0, 1), cell.graph.label('LINE', 4)),
                numbers(order, cell.graph.label(ORDER, 4)),
            ],
        ),
        (plan, [numbers(order, ORDER)]),
        (change, [numbers([], cell.graph.label('COURSE', 5))]),
        (change, [numbers(profile, cell.graph.label('COURSE', 6))]),
    ]
    for publisher, rows in messages:
        for row in rows:
            publisher.publish(row)
    cell.graph.spin_until(lambda: len(refusals) >= len(messages), 'a refusal of each')
    sentences = ' | '.join(m.data for m in refusals)
    for reason in (
        'a plan message must be a row of finite numbers',
        'an order came without moves',
        '10.000 mm away',
        "'ORDER' is not a label",
        'a motion profile must be a row of finite numbers',
        'the robot is idle',
    ):
        assert reason in sentences
    assert cell.operator.state == 'idle'
    assert np.abs(np.diff(cell.path(), axis=0)).max() == 0.0
    cell.start(LINE)
    cell.wait_for('idle')


def test_a_path_whose_pose_turns_the_plate_is_rejected(cell: Cell) -> None:
    publisher = cell.graph.listener.create_publisher(Path, 'unit_robot/move_sb', REQUEST)
    cell.graph.spin_until(publisher.get_subscription_count, 'the planner')
    turned = Path(poses=[PoseStamped()])
    turned.header.frame_id = 'base'
    turned.poses[0].pose.position.z = -0.8
    turned.poses[0].pose.orientation.x = 0.1
    publisher.publish(turned)
    cell.graph.spin_until(lambda: cell.answers, 'the answer')
    assert cell.answers[-1].data == 'refused: poses[0] has an orientation, but the plate cannot rotate'


def test_progress_reports_state_move_master_and_remaining_time(cell: Cell) -> None:
    texts = cell.graph.listen(String, 'motion/progress')
    cell.start(LONG)
    cell.reach(0.5)
    cell.graph.spin_until(
        lambda: texts and 0.0 < json.loads(texts[-1].data)['master_m'] < ALONG, 'progress on the way'
    )
    facts = json.loads(texts[-1].data)
    assert facts['state'] == 'moving'
    assert (facts['move'], facts['moves']) == (0, 1)
    assert facts['remaining_s'] == pytest.approx((ALONG - facts['master_m']) / 0.2, abs=0.1)


def test_services_without_a_planner_hold_and_abort_still_work(graph: Any) -> None:
    task = graph.robot(motion__start_cycle=-1)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    for name in ('hold', 'abort'):
        response = graph.call(Trigger, name, Trigger.Request())
        assert (response.success, response.message) == (False, 'the robot is idle')


def test_an_override_while_idle_is_that_of_the_next_program(cell: Cell) -> None:
    publisher = cell.graph.listener.create_publisher(Float64, 'unit_robot/override', REQUEST)
    cell.graph.spin_until(publisher.get_subscription_count, 'the planner')
    publisher.publish(Float64(data=50.0))
    cell.graph.spin_until(lambda: cell.answers and 'override 50' in cell.answers[-1].data, 'the answer')
    cell.start(LONG)
    cell.wait_for('idle')
    speeds = np.diff(cell.path()[:, 0]) / CYCLE_S
    assert speeds.max() == pytest.approx(0.1, abs=1e-6)


def test_a_program_that_is_held_before_it_begins_can_be_resumed(graph: Any, tmp_path: Any) -> None:
    file = tmp_path / 'line.yaml'
    file.write_text('moves: [{move_l: {to_m: [0.1, 0.0, -0.75]}}]')
    commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
    task = graph.robot(motion__start_cycle=LATER)
    graph.add(UnitRobotNode, program=str(file), motion__start_cycle=LATER)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: operator.state == 'moving', 'the order')
    operator.call('hold')
    graph.spin_until(lambda: operator.state == 'stopped', 'standstill')
    assert abs(task.progress().cycles - LATER) <= parameters.load().bus.outstanding_cycles_max
    assert operator.call('resume') == 'resumed'
    graph.spin_until(lambda: operator.state == 'idle', 'the end')
    point = commands[-1].point
    assert [point.x, point.y, point.z] == pytest.approx([0.1, 0.0, -0.75], abs=1e-6)


@pytest.mark.long
def test_a_program_of_thousands_of_different_moves_costs_no_bus_cycle_and_can_be_given_up(cell: Cell) -> None:
    angles = np.radians(37.0 * np.arange(2000))
    radii = 0.02 + 1e-5 * np.arange(2000)
    moves = [
        f'{{move_l: {{to_m: [{r * math.cos(a):.6f}, {r * math.sin(a):.6f}, -0.75]}}}}'
        for r, a in zip(radii, angles, strict=True)
    ]
    accepted = cell.operator.send_program(f'moves: [{", ".join(moves)}]')
    assert '2000 moves' in accepted
    cell.operator.call('start')
    cell.graph.spin_until(lambda: cell.task.progress().move > 5, 'some of its moves', 60.0)
    assert cell.task.progress().lost_telegrams == 0
    cell.operator.call('abort')
    cell.wait_for('idle')
    assert_smooth(cell.path())
