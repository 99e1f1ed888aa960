"""The cell around the robot in 3D: fixtures, moving belts and parts."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.scene.shapes import Cylinder
from delta3_pacdrive.view.figure import about_zy, mesh_of
from delta3_pacdrive.view.values import PARTS_MAX, CellInstant, PartPlace

ROOT = '/cell'
THINGS_MAX = 400  # drawn; more would slow down browsers
SLAB_M = 0.012  # thickness of a belt, below its surface
AREA_M = 0.001  # thickness of an area on it
MARKS_M, MARKS_MAX = 0.1, 500  # approximate distance of the marks on a belt, and their maximum number
EDGE, MARK = 2.5, 1.5  # pixels
FIRST_PARTS = 16  # initial capacity; grows by a factor of four
GONE_M = 1e-6  # size of an unused box

BELT, MARKS = (60, 66, 78), (150, 156, 168)
# colour, opacity and height above the surface of a belt [m]; areas may overlap
AREAS = {
    Kind.WINDOW: ((47, 158, 91), 0.28, 0.001),
    Kind.CAMERA: ((112, 72, 232), 0.30, 0.002),
    Kind.BARRIER: ((217, 45, 58), 0.85, 0.003),
    Kind.SENSOR: ((224, 138, 0), 0.45, 0.004),
}
FRAMES = {Kind.BOX: (58, 134, 255), Kind.SUPPLY: (11, 114, 133)}
TYPES = ((200, 112, 30), (30, 112, 200), (84, 148, 40), (178, 60, 124), (104, 72, 200), (30, 146, 146))
_CUBE = (
    np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]),
    np.array(
        [
            *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
            *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
        ]
    ),
)


class _Belt:
    """A slab with marks that move with its surface."""

    def __init__(self, scene: Any, path: str, belt: Thing) -> None:
        self._shift_m = 0.0
        length, width = belt.size_m
        count = min(max(1, round(length / MARKS_M)), MARKS_MAX)
        self._pitch_m = length / count
        x, y, z = belt.at_m
        scene.add_box(
            path, BELT, (length, width, SLAB_M), position=(x, y, z - 0.5 * SLAB_M),
            wxyz=about_zy(belt.angle_rad, 0.0), cast_shadow=False,
        )  # fmt: skip
        points = np.zeros((count, 2, 3), dtype=np.float32)  # relative to the centre of the slab
        points[:, :, 0] = (np.arange(count) * self._pitch_m - 0.5 * length)[:, None]
        points[:, :, 1] = [-0.5 * width, 0.5 * width]
        self._marks = scene.add_line_segments(
            f'{path}/marks', points, MARKS, thickness=MARK, thickness_units='screen', position=self._shifted()
        )

    def _shifted(self) -> tuple[float, float, float]:
        return (self._shift_m, 0.0, 0.5 * SLAB_M + 0.5 * AREA_M)

    def move(self, way_m: float) -> None:
        """Move the marks with the surface, which has travelled this distance."""
        shift = way_m % self._pitch_m if self._pitch_m > 0.0 else 0.0
        if shift != self._shift_m:
            self._shift_m = shift
            self._marks.position = self._shifted()


class _Parts:
    """All parts as one batch of boxes: one message per picture for any number of parts."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self._colours: dict[str, tuple[int, int, int]] = {}  # by type
        self._room = 0
        self._handle: Any = None
        self._last: dict[str, Floats] = {}

    def place(self, parts: Sequence[PartPlace]) -> None:
        """Pose the newest ``PARTS_MAX`` parts."""
        parts = parts[-PARTS_MAX:]
        if len(parts) > self._room:
            self._grow(parts)
        if self._handle is None:
            return
        for name, rows in self._rows(parts).items():
            if not np.array_equal(rows, self._last[name]):
                self._last[name] = rows
                setattr(self._handle, name, rows)

    def _grow(self, parts: Sequence[PartPlace]) -> None:
        """Increase the capacity; colours sent right after a new batch may be lost in a browser."""
        self._room = max(self._room, FIRST_PARTS)
        while self._room < len(parts):
            self._room *= 4
        self._last = self._rows(parts)
        self._handle = self._scene.add_batched_meshes_simple(
            f'{ROOT}/parts', *_CUBE, lod='off', flat_shading=True, cast_shadow=False, receive_shadow=False,
            **self._last,
        )  # fmt: skip

    def _rows(self, parts: Sequence[PartPlace]) -> dict[str, Any]:
        """Return the attributes of the batch, one row per box."""
        n = len(parts)
        positions, scales = (
            np.zeros((self._room, 3), np.float32),
            np.full((self._room, 3), GONE_M, np.float32),
        )
        turns, colours = np.zeros((self._room, 4), np.float32), np.zeros((self._room, 3), np.uint8)
        turns[:, 0] = 1.0
        if n:
            positions[:n] = [part.at_m for part in parts]
            scales[:n] = [part.size_m for part in parts]
            positions[:n, 2] += 0.5 * scales[:n, 2]
            half = 0.5 * np.array([part.angle_rad for part in parts])
            turns[:n, 0], turns[:n, 3] = np.cos(half), np.sin(half)
            colours[:n] = [self._colour(part.type) for part in parts]
        return {
            'batched_positions': positions,
            'batched_wxyzs': turns,
            'batched_scales': scales,
            'batched_colors': colours,
        }

    def _colour(self, kind: str) -> tuple[int, int, int]:
        return self._colours.setdefault(kind, TYPES[len(self._colours) % len(TYPES)])


class CellFigure:
    """A cell in a viser scene."""

    def __init__(self, scene: Any, things: Sequence[Thing]) -> None:
        self._scene = scene
        self._labels: list[Any] = []
        self._belts: dict[str, _Belt] = {}
        self._root = scene.add_frame(ROOT, show_axes=False)
        for number, thing in enumerate(things[:THINGS_MAX]):
            self._add(f'{ROOT}/{thing.kind}{number}', thing)
        self._parts = _Parts(scene)

    def _add(self, path: str, thing: Thing) -> None:
        if thing.kind is Kind.BELT:
            self._belts[thing.name] = _Belt(self._scene, path, thing)
        elif thing.kind in FRAMES:
            self._add_frame(path, thing)
        else:
            self._add_area(path, thing)
            return
        length, width = thing.size_m
        dx, dy = -0.5 * length, -0.5 * width  # a corner
        cos, sin = math.cos(thing.angle_rad), math.sin(thing.angle_rad)
        x, y, z = thing.at_m
        corner = (x + cos * dx - sin * dy, y + sin * dx + cos * dy, z)
        self._labels.append(
            self._scene.add_label(f'{path}_name', thing.name, position=corner, anchor='top-left')
        )

    def _add_area(self, path: str, thing: Thing) -> None:
        colour, opacity, above = AREAS[thing.kind]
        length, width = thing.size_m
        x, y, z = thing.at_m
        look: dict[str, Any] = {
            'color': colour, 'opacity': opacity, 'cast_shadow': False, 'receive_shadow': False,
            'position': (x, y, z + above), 'wxyz': about_zy(thing.angle_rad, 0.0),
        }  # fmt: skip
        if thing.kind is Kind.SENSOR:
            self._scene.add_mesh_simple(
                path, *mesh_of([Cylinder(radius_m=0.5 * length, length_m=AREA_M)]), **look
            )
        else:
            self._scene.add_box(path, dimensions=(length, width, AREA_M), **look)

    def _add_frame(self, path: str, thing: Thing) -> None:
        half = 0.5 * np.array(thing.size_m)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
        ring = np.column_stack([corners, np.zeros(len(corners))])
        x, y, z = thing.at_m
        self._scene.add_line_segments(
            path, np.stack([ring[:-1], ring[1:]], axis=1).astype(np.float32), FRAMES[thing.kind], thickness=EDGE,
            thickness_units='screen', position=(x, y, z + AREA_M), wxyz=about_zy(thing.angle_rad, 0.0),
        )  # fmt: skip

    def place(self, instant: CellInstant) -> None:
        """Update belts and parts."""
        for name, way_m in instant.ways_m.items():
            if name in self._belts and math.isfinite(way_m):
                self._belts[name].move(way_m)
        self._parts.place(instant.parts)

    def show(self, visible: bool, labels: bool) -> None:
        """Show or hide the cell and its labels."""
        self._root.visible = visible
        for label in self._labels:
            label.visible = visible and labels

    def remove(self) -> None:
        """Remove the cell from the scene."""
        self._root.remove()
