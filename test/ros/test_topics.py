"""Tests of the published topics against their telegrams, and of their subscribers."""

import io
import json
import math
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, Vector3Stamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, LATCHED_FROM_MANY, REPORT
from delta3_pacdrive.scene.joints import joint_motion
from delta3_pacdrive.scene.parts import RODS
from delta3_pacdrive.scene.urdf import urdf

ROBOT = parameters.load()
RATIO = ROBOT.dynamics.gear_ratio
ON_REQUEST = {'motion__start_cycle': -1}
CLOSED_M = 1e-7  # the reader of URDF leaves a joint where it was if it has moved by less than 1e-8
# what is told of the TCP in every cycle
TCP_TOPICS = {row.name: row.type for row in interfaces.TOPICS if row.name.startswith('tcp/')}
# a way on which every arm turns up and down, and something is gripped
PROGRAM = """
moves:
- move_l: {to_m: [0.15, 0.0, -0.75]}
- output: {name: gripper, value: true, payload_kg: 0.25}
- move_l: {to_m: [0.0, 0.1, -0.85]}
"""


def cycle_of(message: Any) -> int:
    return int(message.header.stamp.sec * 1000 + message.header.stamp.nanosec // 1_000_000)


def numbers_of(message: Any) -> list[float]:
    if isinstance(message, JointState):
        return [*message.position, *message.velocity, *message.effort]
    vector = message.point if isinstance(message, PointStamped) else message.vector
    return [vector.x, vector.y, vector.z]


class Driven:
    """A robot that has driven a program, with all that it said meanwhile."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        kinds = {
            'sercos/mdt': JointState,
            **{f'sercos/at/{axis}': JointState for axis in DRIVES},
            'following_error': JointState,
            **TCP_TOPICS,
            'motion/master': Vector3Stamped,
            'joint_states': JointState,
        }
        self.heard = {topic: graph.listen(kind, topic, CYCLIC_PUBLISHER) for topic, kind in kinds.items()}
        self.phases = graph.listen(JointState, 'axis2/phase_current', CYCLIC_PUBLISHER)
        self.reports = graph.listen(String, 'motion/progress', REPORT)
        self.values = graph.listen(JointState, 'motion/progress/values', REPORT)
        self.task = graph.robot(**ON_REQUEST)
        self.planner = graph.add(UnitRobotNode, **ON_REQUEST)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')
        self.operator.take_control('Anna')
        self.operator.send_program(PROGRAM)
        self.operator.call('start')
        graph.spin_until(lambda: self.task.progress().finished, 'the end')
        graph.spin_until(lambda: self.operator.state == 'idle', 'its word')
        known = len(self.reports)
        graph.spin_until(lambda: len(self.reports) > known + 1, 'a report of the end')

    def rows(self, topic: str) -> dict[int, list[float]]:
        """Return the numbers of a topic by bus cycle."""
        return {cycle_of(m): numbers_of(m) for m in self.heard[topic] if m.header.stamp.sec >= 0}

    def answers(self) -> dict[int, np.ndarray]:
        """Return position, speed and torque of the three motors by bus cycle, shape (3, 3)."""
        rows = [self.rows(f'sercos/at/{axis}') for axis in DRIVES]
        return {
            cycle: np.array([row[cycle] for row in rows]).T for cycle in set.intersection(*map(set, rows))
        }


@pytest.fixture(scope='module')
def driven(shared_graph: Any) -> Driven:
    return Driven(shared_graph)


def test_places_and_errors_belong_to_the_telegrams_of_their_stamp(driven: Driven) -> None:
    answers = driven.answers()
    command, actual, error = (driven.rows(f'tcp/{name}') for name in ('command', 'actual', 'error'))
    following = driven.rows('following_error')
    cycles = sorted(set(answers) & set(actual) & set(command) & set(error) & set(following))[20:]
    assert len(cycles) > 200
    theta = np.array([answers[cycle][0] for cycle in cycles]) / RATIO
    places = np.array([actual[cycle] for cycle in cycles])
    assert np.abs(kinematics.forward(theta, ROBOT.kinematics) - places).max() < 1e-12
    known = sorted(command)
    due = np.array(cycles) - ROBOT.set_point_delay_cycles
    columns = np.array([command[cycle] for cycle in known]).T
    wanted = np.column_stack([np.interp(due, known, column) for column in columns])
    errors = np.array([error[cycle] for cycle in cycles])
    assert np.abs(wanted - places - errors).max() < 1e-9
    assert np.abs(errors).max() > 1e-5  # large enough to have a sign
    off = np.abs([following[cycle] for cycle in cycles])
    assert 1e-6 < off.max() < 5e-3


def test_joint_states_have_angles_speeds_and_torques_of_their_stamp_at_100_hz(driven: Driven) -> None:
    answers, joints = driven.answers(), driven.rows('joint_states')
    cycles = sorted(set(answers) & set(joints))
    assert len(cycles) > 20
    assert {cycle % 10 for cycle in joints} == {0}
    for cycle in cycles:
        position, speed, torque = answers[cycle]
        told = np.reshape(joints[cycle], (3, len(JOINTS)))
        expected = [position / RATIO, speed / RATIO, torque * RATIO]
        assert told[:, :3] == pytest.approx(np.array(expected), abs=1e-12)
    assert max(abs(answers[cycle][1]).max() for cycle in cycles) > 10.0


def test_joint_states_have_the_passive_joints_after_the_axes(driven: Driven) -> None:
    assert {tuple(message.name) for message in driven.heard['joint_states']} == {JOINTS}
    joints = driven.rows('joint_states')
    assert len(joints) > 20
    for row in joints.values():
        position, speed, torque = np.reshape(row, (3, len(JOINTS)))
        wanted, rates = joint_motion(position[:3], speed[:3], ROBOT)
        assert position == pytest.approx(wanted, abs=1e-12)
        assert speed == pytest.approx(rates, abs=1e-12)
        assert not torque[3:].any()
    assert np.ptp([row[JOINTS.index('forearm2b_swing')] for row in joints.values()]) > 0.05


def test_late_subscribers_receive_the_urdf_of_the_robot(driven: Driven) -> None:
    heard = driven.graph.listen(String, 'robot_description', LATCHED)
    driven.graph.spin_until(lambda: heard, 'the description')
    assert heard[0].data == urdf(ROBOT)


def test_the_tree_of_the_description_closes_with_the_joint_states(driven: Driven) -> None:
    """Use a third-party reader of URDF as a stock robot_state_publisher does with both."""
    yourdfpy = pytest.importorskip('yourdfpy', reason='the reader of URDF, yourdfpy, is not installed')
    described = driven.graph.listen(String, 'robot_description', LATCHED)
    driven.graph.spin_until(lambda: described, 'the description')
    model = yourdfpy.URDF.load(io.BytesIO(described[0].data.encode()), load_meshes=False)
    messages = [m for m in driven.heard['joint_states'] if m.header.stamp.sec >= 0]
    for message in messages[:: max(1, len(messages) // 20)]:
        model.update_cfg(dict(zip(message.name, message.position, strict=True)))
        for rod in RODS:
            end, joint = (
                model.get_transform(name, 'base')[:3, 3] for name in (f'forearm{rod}_end', f'plate_{rod}')
            )
            assert np.abs(end - joint).max() < CLOSED_M


def test_phase_currents_are_those_of_torque_and_angle(driven: Driven) -> None:
    answers = driven.answers()
    messages = {cycle_of(message): message for message in driven.phases}
    cycles = sorted(set(answers) & set(messages))
    assert len(cycles) > 50
    turned = 0.0
    for cycle in cycles:
        position, _, torque = answers[cycle]
        peak = math.sqrt(2.0) * torque[1] / ROBOT.motor.torque_constant_n_m_a
        angle = ROBOT.motor.pole_pairs * position[1]
        told = dict(zip(messages[cycle].name, messages[cycle].effort, strict=True))
        for number, name in enumerate(('I1s', 'I2s', 'I3s')):
            shifted = angle - number * 2.0 * math.pi / 3.0
            assert told[name] == pytest.approx(-peak * math.sin(shifted), abs=0.05)
        turned = max(turned, abs(told['I1s'] - told['I2s']))
    assert turned > 0.5


def test_report_has_time_position_and_following_error_of_its_cycle(driven: Driven) -> None:
    reports = [json.loads(message.data) for message in driven.reports]
    actual, following = driven.rows('tcp/actual'), driven.rows('following_error')
    looked = 0
    for report in reports:
        cycle = report['cycles'] - 1
        if cycle in actual and cycle in following:
            looked += 1
            assert report['bus_time_s'] == pytest.approx(report['cycles'] * 1e-3)
            assert report['tcp_m'] == pytest.approx(actual[cycle], abs=1e-12)
            assert report['following_error_rad'] == pytest.approx(np.abs(following[cycle]).max(), abs=1e-15)
    assert looked > 3


def test_values_of_progress_are_the_numbers_of_the_report_at_their_stamp(driven: Driven) -> None:
    reports = [MotionProgress.from_json(message.data) for message in driven.reports]
    numbers = {report.cycles - 1: report.numbers() for report in reports}
    shared = [message for message in driven.values if cycle_of(message) in numbers]
    assert len(shared) > 3
    for message in shared:
        wanted = numbers[cycle_of(message)]
        assert list(message.name) == [*wanted]
        found = dict(zip(message.name, message.position, strict=True))
        # the other numbers may change between the two messages
        for name in ('cycles', 'bus_time_s', 'tcp_x_m', 'tcp_y_m', 'tcp_z_m', 'following_error_rad'):
            assert found[name] == wanted[name], name
    assert min(message.header.stamp.sec for message in driven.values) >= 0


def test_incomplete_report_is_ignored(driven: Driven) -> None:
    text = driven.reports[-1].data
    facts = json.loads(text)
    assert MotionProgress.from_json(text).to_json() == text
    for key in driven.task.progress().to_fields():
        with pytest.raises(TelegramError):
            MotionProgress.from_fields({name: facts[name] for name in facts if name != key})


def test_figures_arrive_at_the_end_of_a_program(driven: Driven) -> None:
    report = json.loads(driven.reports[-1].data)
    assert report['finished']
    assert report['figures']['final_tcp_m'] == pytest.approx([0.0, 0.1, -0.85], abs=1e-5)


def test_round_trip_is_within_the_outstanding_cycles(driven: Driven) -> None:
    """The mean time from an MDT to its AT is that of a cycle times the cycles that are under way (Little's law)."""
    progress = driven.task.progress()
    cycle_ms = progress.wall_time_s / progress.cycles * 1e3
    longest = cycle_ms * (ROBOT.bus.outstanding_cycles_max + 1)
    assert 0.0 < driven.task.statistics()['mdt_to_last_at_ms']['p50'] < 2.0 * longest


LATCHED_TOPICS = {
    'motion/state': String,
    'motion/located': PointStamped,
    'outputs': JointState,
    'motion/status': String,
    'motion/course': Float64MultiArray,
    'control/operator': String,
    'unit_robot/state': String,
    'unit_robot/answer': String,
    'unit_robot/queue': String,
    'unit_robot/queue/values': DiagnosticArray,
    'sercos/phase': Header,
}


def test_late_subscribers_receive_the_present_state(driven: Driven) -> None:
    heard = {topic: driven.graph.listen(kind, topic, LATCHED) for topic, kind in LATCHED_TOPICS.items()}
    present = driven.graph.listen(DiagnosticStatus, 'sercos/participants', LATCHED_FROM_MANY)
    driven.graph.spin_until(lambda: all(heard.values()) and len(present) >= 4, 'all that is latched')
    assert heard['motion/state'][-1].data == heard['unit_robot/state'][-1].data == 'idle'
    assert heard['control/operator'][-1].data.startswith('Anna, ')
    gripped = dict(zip(heard['outputs'][-1].name, heard['outputs'][-1].position, strict=True))
    assert (gripped['gripper'], gripped['payload_kg']) == (1.0, 0.25)
    queue = {item.key: item.value for item in heard['unit_robot/queue/values'][-1].status[0].values}
    assert queue['identity'] == driven.operator.queue.identity
    place = heard['motion/located'][-1]
    assert numbers_of(place) == pytest.approx([0.0, 0.1, -0.85], abs=1e-5)
    began, ended = heard['motion/course'][-1].data[0], cycle_of(place)
    assert began + 200 < ended <= driven.task.controller.answered


def test_planner_and_operator_send_heartbeats_with_rising_numbers(driven: Driven) -> None:
    beats = {
        topic: driven.graph.listen(Header, topic, REPORT) for topic in ('unit_robot/alive', 'control/alive')
    }
    driven.graph.spin_until(lambda: all(len(found) >= 3 for found in beats.values()), 'three beats of each')
    for found in beats.values():
        assert len({message.frame_id for message in found}) == 1
        numbers = [message.stamp.sec for message in found]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    planner, _, publisher = interfaces.read_heartbeat(beats['unit_robot/alive'][-1])
    assert planner == driven.operator.queue.identity
    assert {publisher} == interfaces.publishers_of(driven.graph.listener, interfaces.PLANNER_ALIVE)
