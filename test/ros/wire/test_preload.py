"""Tests of modules loaded before the nodes are forked: nodes and their log messages load no others."""

import json

import pytest

from new_interpreter import printed

NODES = """
import inspect, json, sys
from rclpy.parameter import Parameter
from delta3_pacdrive.ros.wire import preload
from delta3_pacdrive.ros.nodes import mc4_drive, plant, transformation_task, unit_robot
import rclpy

preload.load_type_support()
preload.know_modules()
loaded, known = set(sys.modules), len(inspect.modulesbyfile)
rclpy.init()
nodes = [
    plant.PlantNode(),
    mc4_drive.MC4DriveNode(parameter_overrides=[Parameter('axis', value=1)]),
    transformation_task.TransformationTaskNode(),
    unit_robot.UnitRobotNode(),
]
print(json.dumps([sorted(set(sys.modules) - loaded), len(inspect.modulesbyfile) - known]))
for node in nodes:
    node.destroy_node()
rclpy.shutdown()
"""


@pytest.fixture(scope='module')
def late():
    """Return the modules that four nodes load at their start, the number of file searches, and the log."""
    told, logged = printed(NODES)
    return *json.loads(told), logged


def test_no_node_loads_the_type_support_of_its_messages(late):
    modules, _, _ = late
    assert [
        name for name in modules if '_interfaces' in name or 'typesupport' in name or '_msgs' in name
    ] == []


def test_a_node_that_logs_a_line_does_not_walk_all_modules(late):
    _, looked_for, logged = late
    assert '[unit_robot]: waiting for transformation_task' in logged
    assert looked_for == 0
