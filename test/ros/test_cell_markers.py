"""Tests of the cell as markers: poses of things and parts, and removal of old markers."""

import math
from dataclasses import replace

import pytest
from visualization_msgs.msg import Marker

from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.ros.robot_markers import PARTS_MAX, SLAB_M, CellMarkers
from delta3_pacdrive.view.values import CellInstant, PartPlace

BELT = Thing(Kind.BELT, 'line', (0.1, 0.2, -0.87), math.pi / 2.0, (1.5, 0.4), 1000.0)
SENSOR = Thing(Kind.SENSOR, 'there', (0.0, 0.0, -0.87), 0.0, (0.02, 0.02))
PART = PartPlace(7, 'bar', (0.06, 0.04, 0.02), (0.1, 0.2, -0.87), math.pi / 2.0)


def named(markers: list[Marker]) -> dict[tuple[str, int], Marker]:
    return {(marker.ns, marker.id): marker for marker in markers}


def test_belt_is_drawn_as_a_slab_with_the_part_on_its_surface() -> None:
    markers = CellMarkers()
    belt, sensor = markers.still([BELT, SENSOR])
    (part,) = markers.parts(CellInstant((PART,)))
    assert belt.pose.position.z + 0.5 * belt.scale.z == pytest.approx(-0.87)
    assert (belt.scale.x, belt.scale.y, belt.scale.z) == (1.5, 0.4, SLAB_M)
    assert part.pose.position.z - 0.5 * part.scale.z == pytest.approx(-0.87)
    assert (part.pose.orientation.z, part.pose.orientation.w) == pytest.approx((2**-0.5, 2**-0.5))
    assert (belt.type, sensor.type) == (Marker.CUBE, Marker.CYLINDER)


def test_markers_of_removed_things_are_deleted_once() -> None:
    markers = CellMarkers()
    markers.still([BELT, SENSOR])
    markers.parts(CellInstant((PART,)))
    for now in (markers.still([BELT]), markers.parts(CellInstant())):
        assert [one.action for one in now if one.action == Marker.DELETE] == [Marker.DELETE]
    assert [one.action for one in (*markers.still([BELT]), *markers.parts(None))] == [Marker.ADD]


def test_every_marker_has_its_own_name_and_number_and_they_are_bounded() -> None:
    things = [replace(BELT, kind=kind) for kind in Kind]
    many = CellInstant(tuple(replace(PART, number=n) for n in range(PARTS_MAX + 50)))
    found = named([*CellMarkers().still(things), *(parts := CellMarkers().parts(many))])
    assert len(found) == len(things) + len(parts)
    assert len(parts) == PARTS_MAX
    assert ('cell/parts', PARTS_MAX + 49) in found
