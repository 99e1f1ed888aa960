"""Tests of the robot in three dimensions: its parts are connected as in the scene."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.scene.poses import poses
from delta3_pacdrive.view.figure import Figure

pytest.importorskip('trimesh', reason='the page needs the extra "view"')

PLACES = ((0.0, 0.0, -0.75), (0.3, -0.2, -0.9), (-0.25, 0.35, -0.8))


class Scene:
    """A scene that stores its contents by path."""

    def __init__(self):
        self.nodes = {}

    def __getattr__(self, name):
        def add(path, *_, position=(0.0, 0.0, 0.0), wxyz=(1.0, 0.0, 0.0, 0.0), visible=True, **more):
            node = SimpleNamespace(position=position, wxyz=wxyz, visible=visible, remove=lambda: None, **more)
            self.nodes[path] = node
            return node

        return add

    def pose(self, path):
        """Return place and rotation of a node in the world."""
        place, turn = np.zeros(3), Rotation.identity()
        parts = path.strip('/').split('/')
        for n in range(2, len(parts) + 1):
            node = self.nodes['/' + '/'.join(parts[:n])]
            place = place + turn.apply(node.position)
            turn = turn * Rotation.from_quat(np.roll(node.wxyz, -1))
        return place, turn


@pytest.mark.parametrize('place', PLACES)
def test_arms_rods_and_plate_are_where_the_scene_has_them(place, robot):
    scene = Scene()
    figure = Figure(scene, robot)
    theta = kinematics.inverse(np.array(place), robot)
    figure.place(theta, np.array(place), None)
    expected = poses(theta, robot)
    paths = {f'arm{arm}': f'/robot/arm{arm}' for arm in (1, 2, 3)}
    paths |= {f'forearm{arm}{rod}': f'/robot/arm{arm}/forearm{arm}{rod}' for arm in (1, 2, 3) for rod in 'ab'}
    paths['plate'] = '/robot/plate'
    for name, path in paths.items():
        there, quaternion = expected.of(name)
        position, turn = scene.pose(path)
        assert position == pytest.approx(there, abs=1e-9), name
        assert (turn * Rotation.from_quat(quaternion).inv()).magnitude() < 1e-7, name


@pytest.mark.parametrize('place', PLACES)
def test_tool_and_bar_of_a_rotary_axis_are_where_the_scene_has_them(place, robot):
    turning, scene, turns = robot.replace(rotary__present=True), Scene(), (2.1, -0.4)
    figure = Figure(scene, turning)
    figure.carry(0.5)
    theta, tcp = kinematics.inverse(np.array(place), turning), np.array(place)
    figure.place(theta, tcp, tcp, turns)
    paths = {'bar_tube': 'bar_tube', 'bar_rod': 'bar_rod', 'plate': 'plate/plate'}
    paths |= {part: f'plate/turned/{part}' for part in ('tool', 'pointer', 'payload')}
    for body, turn in zip(('robot', 'ghost'), turns, strict=True):
        expected = poses(theta, turning, turn)
        for name, path in paths.items():
            if (body, name) == ('ghost', 'payload'):
                continue
            position, quaternion = scene.pose(f'/{body}/{path}')
            there, turned = expected.of(name)
            assert position == pytest.approx(there, abs=1e-9), name
            assert (quaternion * Rotation.from_quat(turned).inv()).magnitude() < 1e-7, name
    assert '/robot/motor4' in scene.nodes
    figure.place(theta, tcp, None, turns)
    assert not scene.nodes['/ghost/bar_rod'].visible
    assert scene.nodes['/robot/bar_rod'].visible


def test_a_ghost_that_no_arms_reach_is_only_a_plate(robot):
    scene = Scene()
    figure = Figure(scene, robot)
    here, far = np.array([0.0, 0.0, -0.75]), np.array([3.0, 0.0, -0.75])
    theta = kinematics.inverse(here, robot)
    figure.place(theta, here, far)
    assert scene.nodes['/ghost/plate'].visible
    assert not scene.nodes['/ghost/arm1'].visible
    assert scene.nodes['/robot/arm1'].visible
    assert scene.nodes['/error'].points.tolist() == [[here.tolist(), far.tolist()]]
    figure.place(theta, here, here + 0.01)
    assert scene.nodes['/ghost/arm1'].visible
    figure.place(theta, here, None)
    assert not scene.nodes['/ghost/plate'].visible
    assert not scene.nodes['/ghost/arm1'].visible


def test_fault_flashes_at_its_axis(robot):
    scene = Scene()
    figure = Figure(scene, robot)
    lit = lambda: {path for path, node in scene.nodes.items() if path.startswith('/alarm/') and node.visible}  # noqa: E731
    figure.alarm(('axis2',), 'axis2: too hot', True)
    assert lit() == {'/alarm/axis2', '/alarm/sentence'}
    figure.alarm(('axis2',), 'axis2: too hot', False)
    assert lit() == {'/alarm/sentence'}
    figure.alarm((), 'emergency stop', True)
    assert lit() == {'/alarm/robot', '/alarm/sentence'}
    figure.alarm((), '', True)
    assert lit() == set()
