"""Tests of the cell in three dimensions: poses of things and parts, and no unchanged data is sent."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.view.cell_figure import MARKS_M, THINGS_MAX, CellFigure
from delta3_pacdrive.view.values import PARTS_MAX, CellInstant, PartPlace

pytest.importorskip('trimesh', reason='the page needs the extra "view"')

TURN = 0.3
BELT = Thing(Kind.BELT, 'line', (0.1, 0.2, -0.9), TURN, (1.0, 0.3), 1000.0)
TINY_M = 1e-3


class Node:
    """A node of a scene that counts its changes."""

    def __init__(self, **given):
        self.__dict__.update(given, told=0)

    def __setattr__(self, name, value):
        self.__dict__.update({name: value, 'told': self.told + 1})

    def remove(self):
        self.visible = False


class Scene:
    """A scene that stores its contents by path."""

    def __init__(self):
        self.nodes = {}

    def __getattr__(self, name):
        def add(path, *given, **more):
            self.nodes[path] = Node(kind=name.removeprefix('add_'), given=given, visible=True, **more)
            return self.nodes[path]

        return add

    def of(self, kind):
        return [node for node in self.nodes.values() if node.kind == kind]

    @property
    def told(self):
        return sum(node.told for node in self.nodes.values())


def part(number, at_m=(0.1, 0.0, -0.9), size_m=(0.06, 0.04, 0.02), angle_rad=0.5, kind='bar'):
    return PartPlace(number, kind, size_m, at_m, angle_rad)


def boxes(scene):
    """Return middle, size and angle of the boxes that represent parts."""
    (batch,) = scene.of('batched_meshes_simple')
    there = batch.batched_scales.min(axis=1) > TINY_M
    angles = 2.0 * np.arctan2(batch.batched_wxyzs[:, 3], batch.batched_wxyzs[:, 0])
    return batch.batched_positions[there], batch.batched_scales[there], angles[there]


def test_parts_are_boxes_on_their_undersides():
    scene = Scene()
    figure = CellFigure(scene, [])
    figure.place(CellInstant((part(0), part(1, (0.0, 0.2, -0.8), (0.1, 0.1, 0.3), -0.2, 'crate'))))
    middles, sizes, angles = boxes(scene)
    np.testing.assert_allclose(middles, [(0.1, 0.0, -0.89), (0.0, 0.2, -0.65)], atol=1e-6)
    np.testing.assert_allclose(sizes, [(0.06, 0.04, 0.02), (0.1, 0.1, 0.3)], atol=1e-6)
    np.testing.assert_allclose(angles, [0.5, -0.2], atol=1e-6)
    (batch,) = scene.of('batched_meshes_simple')
    assert (batch.batched_colors[0] != batch.batched_colors[1]).any()
    figure.place(CellInstant((part(1),)))
    assert len(boxes(scene)[0]) == 1
    figure.place(CellInstant())
    assert len(boxes(scene)[0]) == 0


def test_cell_at_rest_sends_no_data_and_moving_parts_send_little():
    scene = Scene()
    figure = CellFigure(scene, [BELT])
    lying = tuple(part(n) for n in range(10))
    figure.place(CellInstant(lying, {'line': 0.03}))
    before = scene.told
    figure.place(CellInstant(lying, {'line': 0.03}))
    assert scene.told == before
    figure.place(CellInstant(tuple(part(n, (0.2, 0.0, -0.9)) for n in range(10)), {'line': 0.05}))
    assert scene.told == before + 2  # the marks of the belt, and the places of all parts


def test_new_boxes_start_with_their_parts_and_no_message_follows_immediately():
    """A busy browser loses the colours of a message that follows the boxes immediately."""
    scene = Scene()
    figure = CellFigure(scene, [])
    for count in (3, 17):
        before = scene.told
        figure.place(CellInstant(tuple(part(n, (n, 0.0, 0.0)) for n in range(count))))
        assert scene.told == before
        assert boxes(scene)[0][:, 0].tolist() == list(range(count))


def test_there_is_room_for_many_parts_and_the_newest_are_drawn():
    scene = Scene()
    figure = CellFigure(scene, [])
    for count in (3, 17, PARTS_MAX, PARTS_MAX + 500):
        figure.place(CellInstant(tuple(part(n, (n, 0.0, 0.0)) for n in range(count))))
        middles, _, _ = boxes(scene)
        assert middles[:, 0].tolist() == list(range(max(0, count - PARTS_MAX), count))


def test_marks_of_a_belt_move_with_its_surface_and_never_leave_it():
    scene = Scene()
    figure = CellFigure(scene, [BELT])
    (slab,), (marks,) = scene.of('box'), scene.of('line_segments')
    turn = Rotation.from_quat(np.roll(slab.wxyz, -1))
    assert turn.as_euler('xyz') == pytest.approx([0.0, 0.0, TURN])
    assert (slab.position[:2], slab.given[1][:2]) == ((0.1, 0.2), (1.0, 0.3))
    assert slab.position[2] + 0.5 * slab.given[1][2] == pytest.approx(-0.9)  # its surface
    (points,) = (given for given in marks.given if isinstance(given, np.ndarray))
    assert len(points) == round(1.0 / MARKS_M)
    begin = points[:, 0, 0] + marks.position[0]
    for way_m in (0.01, 0.049, 0.0999, 0.1, 3.21, -0.03):
        figure.place(CellInstant((), {'line': way_m, 'another': 1.0}))
        along = points[:, 0, 0] + marks.position[0]
        assert np.abs(along).max() <= 0.5
        off = (along[:, None] - begin[None] - way_m + 0.5 * MARKS_M) % MARKS_M - 0.5 * MARKS_M
        assert np.abs(off).max() < 1e-6
    figure.place(CellInstant((), {'line': float('nan')}))
    assert np.isfinite(marks.position).all()


@pytest.mark.parametrize('kind', [kind for kind in Kind if kind is not Kind.BELT])
def test_every_object_is_at_its_position(kind):
    scene = Scene()
    CellFigure(scene, [Thing(kind, 'it', (0.3, -0.1, -0.85), TURN, (0.2, 0.1))])
    (node,) = [
        node for path, node in scene.nodes.items() if path.startswith(f'/cell/{kind}') and 'name' not in path
    ]
    assert node.position == pytest.approx((0.3, -0.1, -0.85), abs=0.01)
    assert Rotation.from_quat(np.roll(node.wxyz, -1)).as_euler('xyz') == pytest.approx([0.0, 0.0, TURN])
    if node.kind == 'line_segments':
        extent = np.ptp(node.given[0].reshape(-1, 3), axis=0)
    elif node.kind == 'mesh_simple':
        extent = np.ptp(node.given[0], axis=0)
    else:
        extent = np.array(node.dimensions)
    assert extent[:2] == pytest.approx((0.2, 0.2) if kind is Kind.SENSOR else (0.2, 0.1), abs=2e-3)


def test_the_cell_and_the_names_in_it_are_switched_off_apart():
    scene = Scene()
    figure = CellFigure(scene, [BELT, Thing(Kind.BOX, 'tray', (0.0, 0.0, -0.9), 0.0, (0.2, 0.1))])
    assert [node.given for node in scene.of('label')] == [('line',), ('tray',)]
    for cell, labels in ((True, False), (False, True), (True, True)):
        figure.show(cell, labels)
        assert scene.nodes['/cell'].visible is cell
        assert {node.visible for node in scene.of('label')} == {cell and labels}


def test_objects_of_other_publishers_do_not_slow_a_browser_down():
    scene = Scene()
    empty = Thing(Kind.BELT, 'none', (0.0, 0.0, 0.0), 0.0, (0.0, 0.0), 1.0)
    endless = Thing(Kind.BELT, 'endless', (0.0, 0.0, 0.0), 0.0, (1e4, 0.3), 1.0)
    figure = CellFigure(scene, [empty, endless, *[BELT] * 5000])
    figure.place(CellInstant((), {'none': 1.0, 'endless': 1.0}))
    assert len(scene.of('box')) == THINGS_MAX
    for marks in scene.of('line_segments'):
        assert np.isfinite(marks.position).all()
        assert len(marks.given[0]) <= 500
