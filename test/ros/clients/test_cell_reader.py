"""Tests of the reader of the cell: late subscription, and foreign messages."""

import json
from typing import Any

import pytest
from diagnostic_msgs.srv import AddDiagnostics
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.ros.clients.cell_reader import CellReader
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.view.values import InputFacts

TCP = (0.0, 0.0, -0.8)
STAY = {'cycle': 5, 'how': 'riding', 'at_m': [0.0, 0.0, -0.9], 'angle_rad': 0.0, 'belt': 'line', 'count': 0}
PART = {
    'number': 0, 'type': 'bar', 'source': 'line', 'outcome': 'waiting', 'reason': '', 'picked_cycle': -1,
    'pick_error_m': [0, 0, 0], 'hold_use': 0, 'hold_needed_n': 0, 'hold_force_n': 0, 'hold_cycle': -1,
    'released_cycle': -1, 'where': '', 'place': -1, 'place_error_m': [0, 0, 0], 'size_m': [0.06, 0.04, 0.02],
    'stays': [STAY],
}  # fmt: skip


def scene(name: str = 'line') -> String:
    belt = {'kind': 'belt', 'name': name, 'at_m': [0, 0, -0.9], 'angle_rad': 0, 'size_m': [1, 0.3]}
    return String(data=json.dumps({'cell': 'c', 'things': [belt | {'increments_per_m': 1000.0}]}))


def parts(*numbers: int) -> String:
    told = [PART | {'number': number} for number in numbers]
    about = {'cell': 'c', 'inputs': [], 'belts': ['line']}
    return String(data=json.dumps({'cycle': 5, **about, 'parts': told, 'misses': []}))


def values(time_s: int, **told: float) -> JointState:
    message = JointState(name=list(told), position=[float(value) for value in told.values()])
    message.header.stamp.sec = time_s
    return message


class Plant(Node):
    """Publishes a cell, and replies to requests for its inputs."""

    def __init__(self, **options: Any) -> None:
        super().__init__('plant', **options)
        self.scene, self.parts = interfaces.SCENE.publisher(self), interfaces.PARTS.publisher(self)
        self.belts, self.inputs = interfaces.BELTS.publisher(self), interfaces.INPUTS.publisher(self)
        self.answer = '{"inputs": {"start": {"forced": true}, "part": {"forced": false}}}'
        interfaces.INPUT.servers(self, self._answer)

        self.asked = 0

    def _answer(self, _: Any, response: AddDiagnostics.Response) -> AddDiagnostics.Response:
        self.asked += 1
        response.success, response.message = True, self.answer
        return response


@pytest.fixture
def plant(graph: Any) -> Plant:
    made: Plant = graph.add(Plant)
    return made


@pytest.fixture
def reader(graph: Any) -> CellReader:
    return CellReader(graph.add(PollingNode, 'reader'))


def looked(graph: Any, reader: CellReader, condition: Any, what: str) -> None:
    """Let the view look until it knows something."""

    def known() -> Any:
        reader.read()
        reader.update_inputs()
        return condition()

    graph.spin_until(known, what)


def numbers(reader: CellReader) -> list[int]:
    found = reader.at(0.0, TCP)
    return [] if found is None else [part.number for part in found.parts]


def test_late_view_receives_the_cell_and_its_parts(graph: Any, plant: Plant) -> None:
    plant.scene.publish(scene())
    for number in range(120):
        plant.parts.publish(parts(number))
    late = CellReader(graph.add(PollingNode, 'reader'))
    looked(graph, late, lambda: len(numbers(late)) == 120, 'all parts')
    assert numbers(late) == list(range(120))
    assert [thing.name for thing in late.now.things] == ['line']


def test_parts_move_with_the_encoder_count_of_the_newest_message(
    graph: Any, plant: Plant, reader: CellReader
) -> None:
    plant.scene.publish(scene())
    plant.parts.publish(parts(0))
    looked(graph, reader, lambda: numbers(reader), 'the part')

    def way() -> Any:
        plant.belts.publish(values(1, line=70.0))
        plant.belts.publish(values(2, line=250.0))
        found = reader.at(2.0, TCP)
        return found is not None and found.ways_m.get('line') == pytest.approx(0.25)

    looked(graph, reader, way, 'the count')
    found = reader.at(2.0, TCP)
    assert found is not None
    assert found.parts[0].at_m == pytest.approx((0.25, 0.0, -0.9))


def test_inputs_are_reported_with_those_set_by_a_client(graph: Any, plant: Plant, reader: CellReader) -> None:
    plant.scene.publish(scene())

    def told(*expected: InputFacts) -> bool:
        plant.inputs.publish(values(1, start=1.0, part=0.0))
        return reader.inputs == expected

    looked(graph, reader, lambda: told(InputFacts('start', True, True), InputFacts('part', False)), 'both')
    for answer in ('[1]', '{"inputs": {"part": 3}}', '[' * 100_000):
        plant.answer, before = answer, plant.asked
        looked(graph, reader, lambda: told() or plant.asked > before + 1, 'two answers that are none')  # noqa: B023
        assert reader.inputs == (InputFacts('start', True, True), InputFacts('part', False))
    plant.answer = '{"inputs": {"start": {"forced": false}, "part": {"forced": "yes"}}}'
    looked(
        graph, reader, lambda: told(InputFacts('start', True), InputFacts('part', False)), 'none that is set'
    )


def test_cell_descriptions_of_other_publishers_are_ignored(
    graph: Any, plant: Plant, reader: CellReader
) -> None:
    plant.scene.publish(scene())
    plant.parts.publish(parts(0))
    looked(graph, reader, lambda: numbers(reader) == [0], 'the part')
    for text in ('', '[' * 100_000, 'x' * (5 * 1024 * 1024)):
        plant.parts.publish(String(data=text))
    for message in (
        JointState(name=['line'], position=[]),
        JointState(name=['line', 'line'], position=[1.0, 2.0]),
        JointState(name=['line'], position=[float('nan')]),
        JointState(name=['line'], position=[1e300]),
        JointState(name=['line'] * 100, position=[1.0] * 100),
    ):
        plant.belts.publish(message)
        plant.inputs.publish(message)
        graph.spin_for(0.02)
        reader.read()
        reader.update_inputs()
    plant.parts.publish(parts(1))
    looked(graph, reader, lambda: numbers(reader) == [0, 1], 'the next part')
    found = reader.at(0.0, TCP)
    assert found is not None
    assert found.ways_m == {}
    assert reader.inputs == ()


def test_cell_is_removed_with_its_robot_and_the_next_robot_has_its_own(
    graph: Any, plant: Plant, reader: CellReader
) -> None:
    plant.scene.publish(scene())
    plant.parts.publish(parts(0, 1))

    def told() -> bool:
        plant.inputs.publish(values(1, start=1.0))
        return bool(reader.inputs) and numbers(reader) == [0, 1]

    looked(graph, reader, told, 'the cell')
    graph.remove(plant)
    looked(graph, reader, lambda: not reader.now.things, 'a cell that is gone')
    assert (reader.at(0.0, TCP), reader.inputs) == (None, ())
    another = graph.add(Plant)
    another.scene.publish(scene('another'))
    another.parts.publish(parts(0))
    looked(graph, reader, lambda: numbers(reader) == [0], 'another cell')
    assert [thing.name for thing in reader.now.things] == ['another']
