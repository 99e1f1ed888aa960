"""Tests of the oscilloscope on the running graph: samples of the simulation, exclusive use and rejections."""

import json
from typing import Any

import numpy as np
import pytest
from std_msgs.msg import String

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.planning.program.model import Dwell, Program
from delta3_pacdrive.recording.acquisition import Acquisition, Record, setting
from delta3_pacdrive.ros.clients import scope_client
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.clients.scope_client import ScopeClient
from delta3_pacdrive.ros.drive import drive_scope
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.wire.qos import REQUEST

PATIENCE_S = 30.0
CHANNELS = [
    'axis1.current_reference', 'axis1.phase_current_2', 'axis1.encoder_increments', 'axis2.voltage',
    'axis2.state', 'axis3.current_integral', 'axis3.position', 'axis3.S-0-0084',
]  # fmt: skip


class Scope:
    """An oscilloscope of a robot without a clock."""

    def __init__(self, graph: Any, channels: list[str], **more: Any) -> None:
        self.robot = parameters.load()
        self.records: list[Record] = []
        self.operator = graph.add(OperatorNode, graph.spin_for)
        asked = {'rate_hz': 16_000.0, 'duration_s': 0.1} | more
        self.client = ScopeClient(self.operator, setting(self.robot, channels, **asked), self.records.append)

    def record(self, patience_s: float = PATIENCE_S) -> Record:
        self.client.record(patience_s)
        return self.records[-1]


@pytest.mark.parametrize('rate_hz', [16_000.0, 3_200.0])
def test_samples_are_those_of_the_simulation_to_the_last_bit(rate_hz: float, graph: Any) -> None:
    graph.robot(('plant', '1', '2', '3'))
    scope = Scope(graph, CHANNELS, rate_hz=rate_hz)
    acquisition = scope.client.arm(PATIENCE_S)  # before bus time begins
    graph.add(TransformationTaskNode, real_time_factor=0.0)
    scope.client.follow(acquisition, PATIENCE_S)
    (found,) = scope.records
    simulated: list[Record] = []
    program = Program('a robot that stands', (Dwell(0.1),))
    simulation.run(program, scope.robot, Acquisition(found.setting, simulated.append))
    assert found.first == simulated[0].first == 1
    np.testing.assert_array_equal(found.values, simulated[0].values)
    assert np.ptp(found.values[:, CHANNELS.index('axis2.state')]) > 0.0  # it was enabled meanwhile


def test_samples_of_a_rotary_axis_are_those_of_the_simulation(graph: Any) -> None:
    own = {'rotary__present': True}
    graph.robot(('plant', '1', '2', '3', '4'), **own)
    channels = [
        'axis4.current_reference',
        'axis4.encoder_increments',
        'axis4.S-0-0104',
        'axis4.state',
        'axis1.voltage',
    ]
    scope = Scope(graph, channels)
    acquisition = scope.client.arm(PATIENCE_S)
    graph.add(TransformationTaskNode, real_time_factor=0.0, **own)
    scope.client.follow(acquisition, PATIENCE_S)
    (found,) = scope.records
    simulated: list[Record] = []
    program = Program('a robot that stands', (Dwell(0.1),))
    simulation.run(program, scope.robot.replace(**own), Acquisition(found.setting, simulated.append))
    assert found.first == simulated[0].first == 1
    np.testing.assert_array_equal(found.values, simulated[0].values)
    assert set(found.values[:, 2]) == {scope.robot.rotary.position_gain_rad_s_rad}
    assert np.ptp(found.values[:, 3]) > 0.0


def test_a_rotary_axis_that_is_not_there_is_rejected_by_the_other_drives(graph: Any) -> None:
    graph.robot()
    for channels in (['axis4.current'], ['axis1.current', 'axis4.current']):
        with pytest.raises(ProgramError, match=r'^the robot has no axis4 for a rotary axis'):
            Scope(graph, channels).record()
    assert len(Scope(graph, ['axis1.current']).record().values) == 1600


def test_a_value_that_is_written_triggers_and_is_shown_from_its_bus_cycle_on(graph: Any) -> None:
    task = graph.robot()
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    scope = Scope(graph, ['axis2.S-0-0104', 'axis1.S-0-0104'], trigger='axis2.S-0-0104', pre_trigger_s=0.01)
    acquisition = scope.client.arm(PATIENCE_S)
    scope.operator.drive('axis2 write S-0-0104 72.5')
    scope.client.follow(acquisition, PATIENCE_S)
    (record,) = scope.records
    assert record.trigger == 160
    assert set(record.values[:160, 0]) == {60.0}
    assert set(record.values[160:, 0]) == {72.5}
    assert set(record.values[:, 1]) == {60.0}
    assert (record.first + record.trigger) % 16 == 1  # the first sample of a bus cycle


def test_a_second_oscilloscope_is_rejected_by_the_name_of_the_first_until_that_parts(graph: Any) -> None:
    graph.robot()
    first = Scope(graph, ['axis1.speed'], trigger='axis1.fault')
    first.client.arm(PATIENCE_S)
    with pytest.raises(ProgramError, match=r'^the oscilloscope of axis1 is in use by process \d+ on '):
        Scope(graph, ['axis1.current', 'axis2.current']).record()
    assert len(Scope(graph, ['axis3.current']).record().values) == 1600  # another drive has its own
    first.client.disarm()
    assert len(Scope(graph, ['axis1.current']).record().values) == 1600


def test_client_that_stops_asking_is_dropped(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    graph.robot()
    lost = Scope(graph, ['axis1.speed'], trigger='axis1.fault')
    lost.client.arm(PATIENCE_S)
    monkeypatch.setattr(drive_scope, 'GIVEN_UP_S', 0.2)
    drive = next(node for node in graph.nodes if isinstance(node, MC4DriveNode))
    graph.spin_until(lambda: not drive.scope_armed, 'a drive that gives its oscilloscope up')
    monkeypatch.undo()
    assert len(Scope(graph, ['axis1.speed']).record().values) == 1600


@pytest.mark.timeout(120)  # who waits for ever is told apart
def test_missing_trigger_and_ending_robot_are_reported(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    graph.robot()
    with pytest.raises(
        RunError, match=r'^the trigger did not fire: a fault of a drive was awaited for 0\.3 s$'
    ):
        Scope(graph, ['axis1.speed'], trigger='fault').record(0.3)
    monkeypatch.setattr(scope_client, 'SILENT_S', 0.5)
    scope = Scope(graph, ['axis1.speed'], trigger='fault')
    acquisition = scope.client.arm(PATIENCE_S)
    graph.remove(next(node for node in graph.nodes if isinstance(node, MC4DriveNode)))
    with pytest.raises(
        RunError, match=r'^axis1 has sent no samples for 0\.5 s while a fault of a drive was awaited'
    ):
        scope.client.follow(acquisition, PATIENCE_S)


def test_missing_robot_is_reported(graph: Any) -> None:
    with pytest.raises(RunError, match=r'^no drives with an oscilloscope within 0\.2 s: is a robot up'):
        Scope(graph, ['axis1.speed']).record(0.2)


@pytest.mark.parametrize(
    ('request_', 'refusal'),
    [
        ('no JSON', None),
        ('{}', None),
        ('[1]', None),
        ({'channels': 3}, None),
        ({'channels': {'axis1': [1]}}, None),
        ({'decimation': 0}, None),
        ({'decimation': 1e99}, None),
        ({'decimation': True}, None),
        ({'scope': 'x' * 33}, None),
        ({'channels': {'axis1': ['speed'] * 10}}, None),
        ({'channels': {'axis1': ['sped']}}, "a drive has no channel 'sped': did you mean speed?"),
    ],
)
def test_invalid_request_is_rejected_without_harm(request_: Any, refusal: str | None, graph: Any) -> None:
    task = graph.robot()
    answers = graph.listen(String, 'scope/answer', REQUEST)
    asking = graph.listener.create_publisher(String, 'scope/request', REQUEST)
    graph.spin_until(lambda: asking.get_subscription_count() == 3, 'drives')
    fine = {'scope': 'a', 'name': 'b', 'channels': {'axis1': ['speed']}, 'decimation': 1}
    text = request_ if isinstance(request_, str) else json.dumps(fine | request_)
    asking.publish(String(data=text))
    if refusal is None:
        asking.publish(String(data=json.dumps(fine)))  # the first answer is that to this one
    graph.spin_until(lambda: answers, 'an answer')
    answer = json.loads(answers[0].data)
    assert answer['armed'] == (refusal is None)
    assert answer['refusal'].startswith(refusal or '')
    assert task.progress().fault == ''
