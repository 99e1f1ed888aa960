"""Tests of the published scene of a cell."""

import json

import pytest

from delta3_pacdrive.cell import cell_file, cell_scene
from delta3_pacdrive.cell.cell_scene import Kind
from delta3_pacdrive.cell.world import World
from delta3_pacdrive.errors import TelegramError

DOCUMENT = {
    'name': 'all',
    'parts': {'bar': {'mass_kg': 0.5, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'supplies': {'infeed': {'part': 'bar', 'at_mm': [-100, 0, -870], 'angle_rad': 0.3}},
    'boxes': {
        'tray': {'at_mm': [100, 0, -870], 'columns': 3, 'rows': 2, 'pitch_mm': [80, -60]},
        'place': {'at_mm': [0, 200, -870]},
    },
    'belts': {'line': {
        'origin_m': [-0.4, 0.1, -0.87], 'direction_rad': 1.5707963267948966, 'length_m': 0.8, 'width_m': 0.3,
        'encoder': {'bits': 10, 'circumference_m': 0.5}, 'window_m': [0.3, 0.7], 'barrier': {'at_m': 0.1},
        'camera': {'at_m': 0.2, 'length_m': 0.2, 'every_m': 0.1},
    }},
    'inputs': {'there': {'sensor': {'at_mm': [-100, 0, 0], 'radius_mm': 10}}, 'start': {}},
}  # fmt: skip


@pytest.fixture
def scene():
    """Return the published scene, as received."""
    return json.loads(json.dumps(World(cell_file.parse(DOCUMENT), 1e-3).scene))


def test_every_placed_object_has_its_centre_and_size(scene):
    found = {(thing.kind, thing.name): (*thing.at_m, *thing.size_m) for thing in cell_scene.read(scene)}
    assert found == {
        (Kind.BELT, 'line'): pytest.approx((-0.4, 0.5, -0.87, 0.8, 0.3)),
        (Kind.WINDOW, 'line'): pytest.approx((-0.4, 0.6, -0.87, 0.4, 0.3)),
        (Kind.CAMERA, 'line'): pytest.approx((-0.4, 0.3, -0.87, 0.2, 0.3)),
        (Kind.BARRIER, 'line'): pytest.approx((-0.4, 0.2, -0.87, cell_scene.BEAM_M, 0.3)),
        (Kind.BOX, 'tray'): pytest.approx((0.18, -0.03, -0.87, 0.24, 0.12)),
        (Kind.BOX, 'place'): pytest.approx((0.0, 0.2, -0.87, 0.06, 0.04)),
        (Kind.SUPPLY, 'infeed'): pytest.approx((-0.1, 0.0, -0.87, 0.06, 0.04)),
        (Kind.SENSOR, 'there'): pytest.approx((-0.1, 0.0, 0.0, 0.02, 0.02)),
    }
    assert scene['cell'] == 'all'


def test_belt_is_described_with_direction_and_encoder(scene):
    line = cell_scene.read(scene)[0]
    assert (line.angle_rad, line.increments_per_m) == pytest.approx((1.5707963267948966, 2048.0))


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('kind', 'moon'), ('name', 3), ('at_m', [0, 0]), ('at_m', [0, 0, 'x']), ('at_m', [0, 0, float('nan')]),
        ('at_m', [0, 0, 1e9]), ('at_m', None), ('angle_rad', True), ('size_m', [1]), ('size_m', 7),
        ('increments_per_m', -1.0), ('increments_per_m', 'many'), ('more', 1),
    ],
)  # fmt: skip
def test_invalid_scene_object_is_rejected(scene, name, value):
    scene['things'][0][name] = value
    with pytest.raises(TelegramError, match='is not a valid scene of a cell'):
        cell_scene.read(scene)


@pytest.mark.parametrize(
    'told',
    [None, [], 'x', {}, {'cell': 'a', 'things': 3}, {'cell': 1, 'things': []}, {'cell': 'a', 'things': [[]]},
     {'cell': 'a', 'things': [{}] * (cell_scene.THINGS_MAX + 1)}],
)  # fmt: skip
def test_scene_of_another_publisher_is_rejected(told):
    with pytest.raises(TelegramError, match='is not a valid scene of a cell'):
        cell_scene.read(told)
