"""Tests of the cell of a plant node by topic: inputs, rejected bags, and poses of parts for pictures."""

from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import KeyValue
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PoseArray
from std_msgs.msg import String

from delta3_pacdrive import parameters
from delta3_pacdrive.control.messages import Status
from delta3_pacdrive.ros.plant_cell import InputRequests, PlantCell
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import interfaces

CELL = """
inputs: {start: {}, part: {}}
parts: {bar: {mass_kg: 0.2, size_mm: [60, 40, 20], friction: 0.5}}
belts:
  line:
    origin_mm: [-300, 100, -870]
    direction_deg: 90
    length_mm: 1000
    encoder: {bits: 14, circumference_mm: 200}
    speed: [{after_s: 0, speed_m_s: 1.0, acceleration_m_s2: 100}]
    stream: {part: bar, count: 1, spacing_mm: 100}
    camera: {at_mm: 100, length_mm: 100, every_mm: 110, latency_s: 0.05}
"""
STATUS = Status('aaaa', '', 1, '', 'idle', 'CP4', '', '', 1, (0.0, 0.0, -0.8), 0, '', '', 0, 0, 0, 100)


class Plant:
    """The cell of a plant whose bus advances on request of the test."""

    def __init__(self, graph: Any, path: Path) -> None:
        self.graph, self.node = graph, graph.add(RobotNode, 'plant')
        self.cell = PlantCell(self.node, str(path), 0, parameters.load())
        self.cell.receive_for(SimpleNamespace(slave=SimpleNamespace(session=b'aaaa', cyclic=True)))  # type: ignore[arg-type]
        self.requests = InputRequests(self.node, self.cell.around)
        self.inputs = interfaces.SET_INPUT.publisher(graph.listener)
        self.status = interfaces.STATUS.publisher(graph.listener)
        graph.spin_until(
            lambda: self.node.count_publishers(interfaces.SET_INPUT.name) == 1, 'who sets inputs'
        )

    def step(self) -> None:
        self.cell.around.step(self.cell.around.cycle + 1, (0.0, 0.0, -0.8))

    def forced(self) -> dict[str, bool]:
        told = self.cell.around.to_dict()['inputs']
        return {name: one['value'] for name, one in told.items() if one['forced']}

    def set(self, key: str, value: str) -> None:
        self.inputs.publish(KeyValue(key=key, value=value))


@pytest.fixture
def plant(graph: Any, tmp_path: Path) -> Plant:
    path = tmp_path / 'cell.yaml'
    path.write_text(CELL, encoding='utf-8')
    return Plant(graph, path)


def test_input_forced_by_topic_is_valid_until_its_release(graph: Any, plant: Plant) -> None:
    plant.set('start', 'on')
    plant.set('moon', 'on')
    plant.set('part', 'maybe')

    def told(expected: dict[str, bool]) -> bool:
        plant.step()
        return plant.forced() == expected

    graph.spin_until(lambda: told({'start': True}), 'the input')
    plant.set('start', 'auto')
    graph.spin_until(lambda: told({}), 'its own value')


def test_topic_commands_during_playback_are_rejected_and_services_continue(graph: Any, plant: Plant) -> None:
    refused: list[str] = []
    plant.node.get_logger().error = refused.append
    serials = count(1)

    def asked() -> bool:
        serial = next(
            serials
        )  # in turn of this robot, and of one that is played back: the newest alone is kept
        told = replace(STATUS, session='ab'[serial % 2] * 4, previous='', serial=serial)
        plant.status.publish(String(data=told.to_json()))
        plant.set('start', 'on')
        return bool(refused)

    graph.spin_until(asked, 'a refusal')
    assert 'a recording is played back here' in refused[-1]
    client = interfaces.INPUT.client(graph.listener)
    graph.spin_until(client.service_is_ready, 'the service')
    asked_service = client.call_async(AddDiagnostics.Request(load_namespace='{name: part, value: true}'))
    graph.spin_until(asked_service.done, 'its answer')
    assert asked_service.result().success


def test_parts_in_a_picture_are_poses_under_the_time_of_the_picture(graph: Any, plant: Plant) -> None:
    seen: list[PoseArray] = []
    interfaces.SEEN.subscription(graph.listener, seen.append)
    graph.spin_until(lambda: plant.node.count_subscribers(interfaces.SEEN.name) == 1, 'who looks')

    def found() -> bool:
        for _ in range(10 if plant.cell.around.cycle < 400 else 0):
            plant.step()
        return bool(seen)

    graph.spin_until(found, 'a picture with a part')
    (message,) = seen
    (pose,) = message.poses
    assert message.header.frame_id == 'base'
    # the belt goes 1 mm in a bus cycle, and 5 mm less while it starts: the picture is taken at 110 mm
    assert message.header.stamp.nanosec == pytest.approx(115e6, abs=1e6)
    assert message.header.stamp.sec == 0
    # across the belt is -x of the base, along it y
    assert [pose.position.x, pose.position.y, pose.position.z] == pytest.approx(
        [-0.3, 0.1 + 0.11, -0.87], abs=1.5e-3
    )
    assert [pose.orientation.z, pose.orientation.w] == pytest.approx([2**-0.5, 2**-0.5])
