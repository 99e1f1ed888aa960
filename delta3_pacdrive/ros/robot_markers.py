"""RViz and Foxglove markers of the robot: its parts, workspace, paths, commanded TCP and TCP error.

All markers are in the frame of the base, which the node enters: neither transforms nor a robot model are required.

Markers of the cell: belts with windows, boxes, supplies, sensors and parts.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.scene.parts import TURNING_NAMES, Colour, Part, parts
from delta3_pacdrive.scene.poses import poses
from delta3_pacdrive.scene.shapes import Box, Cylinder, Shape, Sphere
from delta3_pacdrive.view.values import CellInstant

PLANNED: Colour = (0.25, 0.55, 0.90, 0.9)
TRAVELLED: Colour = (0.15, 0.70, 0.35, 0.9)
COMMAND: Colour = (0.25, 0.55, 0.90, 0.5)
ERROR: Colour = (0.90, 0.15, 0.15, 1.0)
LINE_M, ERROR_LINE_M, COMMAND_M = 0.003, 0.006, 0.03
POINT_M = 2e-3  # minimum distance between two points of a line
POINTS_MAX = 2000  # per line; the travelled path discards its oldest points
THINGS_MAX, PARTS_MAX = 400, 400  # maximum number of markers
SLAB_M, AREA_M = 0.012, 0.002  # thickness of a belt below its surface, and of areas
PART: Colour = (0.78, 0.44, 0.12, 1.0)
# colour, and height above the surface [m]: areas may overlap
AREAS: dict[Kind, tuple[Colour, float]] = {
    Kind.BELT: ((0.24, 0.26, 0.31, 1.0), -0.5 * SLAB_M),
    Kind.WINDOW: ((0.18, 0.62, 0.36, 0.35), 0.001),
    Kind.CAMERA: ((0.44, 0.28, 0.91, 0.35), 0.002),
    Kind.BARRIER: ((0.85, 0.18, 0.23, 0.85), 0.003),
    Kind.SENSOR: ((0.88, 0.54, 0.0, 0.5), 0.004),
    Kind.BOX: ((0.23, 0.53, 1.0, 0.35), -0.5 * AREA_M),
    Kind.SUPPLY: ((0.04, 0.45, 0.52, 0.5), -0.5 * AREA_M),
}


class _Group:
    """Solids that are posed together."""

    def __init__(self, chosen: Iterable[Part]) -> None:
        rows = [(part, number, shape) for part in chosen for number, shape in enumerate(part.shapes)]
        self._parts = [TURNING_NAMES.index(part.name) for part, _, _ in rows]
        self._place = np.array([shape.position_m for _, _, shape in rows])
        self._turned = Rotation.from_quat([shape.quaternion for _, _, shape in rows])
        self.markers = [_solid(part, number, shape) for part, number, shape in rows]

    def placed(self, theta: ArrayLike, turn_rad: float, parameters: Parameters) -> list[Marker]:
        """Return the markers at arm angles and a tool angle [rad]; none if forward kinematics has no solution."""
        found = poses(theta, parameters, turn_rad, unreachable='nan')
        turned, places = found.quaternion[self._parts], found.position[self._parts]
        if not np.isfinite(places).all():
            return []
        part = Rotation.from_quat(turned)
        places += part.apply(self._place)
        for marker, place, quaternion in zip(
            self.markers, places.tolist(), (part * self._turned).as_quat().tolist(), strict=True
        ):
            position, orientation = marker.pose.position, marker.pose.orientation
            position.x, position.y, position.z = place
            orientation.x, orientation.y, orientation.z, orientation.w = quaternion
        return self.markers


class RobotMarkers:
    """The markers of one robot; methods return the markers to publish."""

    def __init__(self, parameters: Parameters, error_magnification: float) -> None:
        self._parameters, self._magnification = parameters, error_magnification
        all_parts = parts(parameters)
        self._still = _Group(part for part in all_parts if not part.moves)
        self._moving = _Group(part for part in all_parts if part.moves and part.name != 'payload')
        self._payload: _Group | None = None
        self._planned: Floats = np.empty((0, 3))
        self._travelled: deque[Point] = deque(maxlen=POINTS_MAX)
        self._last = np.full(3, math.inf)
        self.carry(parameters.dynamics.payload_mass_kg)

    # inputs -----------------------------------------------------------------------------------------------------------

    def carry(self, payload_kg: float) -> list[Marker]:
        """Set the payload [kg]; returns the deletions of the previous one."""
        before = self._payload.markers if self._payload else []
        carried = [part for part in parts(self._parameters, payload_kg) if part.name == 'payload']
        self._payload = _Group(carried) if carried else None
        for marker in [] if carried else before:
            marker.action = Marker.DELETE
        return [] if carried else before

    def plan(self, points_m: Floats) -> None:
        """Set the planned path [m], shape (n, 3)."""
        self._planned = points_m[:: max(1, math.ceil(len(points_m) / POINTS_MAX))]

    def travel(self, tcp_m: Floats) -> None:
        """Append a position [m], shape (3,), to the travelled path."""
        if np.isfinite(tcp_m).all() and not np.linalg.norm(tcp_m - self._last) < POINT_M:
            self._last = tcp_m
            self._travelled.append(point_of(tcp_m))

    # markers ----------------------------------------------------------------------------------------------------------

    def still(self) -> list[Marker]:
        """Return base, motors, workspace and planned path, which rarely change."""
        planned = _line('path_planned', [point_of(place) for place in self._planned], PLANNED, LINE_M)
        # fixed parts have the same pose for all arm angles
        return [*self._still.placed(np.zeros(3), 0.0, self._parameters), planned]

    def robot(self, theta: Floats, turn_rad: float = 0.0) -> list[Marker]:
        """Return the moving parts at arm angles [rad], shape (3,), and a tool angle [rad].

        The list is empty if forward kinematics has no solution.
        """
        groups = [self._moving, self._payload] if self._payload else [self._moving]
        return [marker for group in groups for marker in group.placed(theta, turn_rad, self._parameters)]

    def travelled(self) -> list[Marker]:
        """Return the travelled path."""
        return [_line('path_travelled', list(self._travelled), TRAVELLED, LINE_M)]

    def error(self, tcp_m: Floats, command_m: Floats, error_m: Floats) -> list[Marker]:
        """Return the commanded TCP, and the line from the TCP along the magnified error; all [m], shape (3,)."""
        command = marker_of('tcp_command', 0, Marker.SPHERE, COMMAND)
        command.pose.position = point_of(command_m)
        command.scale = Vector3(x=COMMAND_M, y=COMMAND_M, z=COMMAND_M)
        end = tcp_m + self._magnification * error_m
        return [command, _line('tcp_error', [point_of(tcp_m), point_of(end)], ERROR, ERROR_LINE_M)]


def _solid(part: Part, number: int, shape: Shape) -> Marker:
    match shape:
        case Box():
            kind, scale = Marker.CUBE, shape.size_m
        case Cylinder():
            width = 2.0 * shape.radius_m
            kind, scale = Marker.CYLINDER, (width, width, shape.length_m)
        case Sphere():
            width = 2.0 * shape.radius_m
            kind, scale = Marker.SPHERE, (width, width, width)
        case _:
            raise TypeError(f'there is no marker for a {shape.kind}')
    marker = marker_of(part.name, number, kind, part.colour)
    marker.scale.x, marker.scale.y, marker.scale.z = scale
    return marker


def _line(name: str, points: list[Point], colour: Colour, width_m: float) -> Marker:
    marker = marker_of(name, 0, Marker.LINE_STRIP, colour)
    # RViz warns about a line of a single point
    marker.action = Marker.ADD if len(points) > 1 else Marker.DELETE
    marker.points = points
    marker.scale.x = width_m
    return marker


def marker_of(name: str, number: int, kind: int, colour: Colour) -> Marker:
    """Return a marker, without frame."""
    red, green, blue, opacity = colour
    marker = Marker(ns=name, id=number, type=kind, color=ColorRGBA(r=red, g=green, b=blue, a=opacity))
    marker.pose.orientation.w = 1.0
    return marker


def point_of(place: Sequence[float] | Floats) -> Point:
    """Return a position as a message."""
    x, y, z = place
    return Point(x=float(x), y=float(y), z=float(z))


class CellMarkers:
    """The markers of one cell; methods return the markers to publish."""

    def __init__(self) -> None:
        self._still: set[tuple[str, int]] = set()  # published fixtures
        self._parts: set[tuple[str, int]] = set()

    def still(self, things: Sequence[Thing]) -> list[Marker]:
        """Return markers of the fixtures, and deletions of removed ones."""
        found = [_thing(number, thing) for number, thing in enumerate(things[:THINGS_MAX])]
        gone, self._still = _deletions(self._still, found)
        return [*gone, *found]

    def parts(self, now: CellInstant | None) -> list[Marker]:
        """Return markers of the newest parts, and deletions of removed ones."""
        found = []
        for part in () if now is None else now.parts[-PARTS_MAX:]:
            x, y, z = part.at_m
            marker = marker_of('cell/parts', part.number, Marker.CUBE, PART)
            _lay(marker, (x, y, z + 0.5 * part.size_m[2]), part.angle_rad, part.size_m)
            found.append(marker)
        gone, self._parts = _deletions(self._parts, found)
        return [*gone, *found]


def _thing(number: int, thing: Thing) -> Marker:
    colour, height_m = AREAS[thing.kind]
    shape = Marker.CYLINDER if thing.kind is Kind.SENSOR else Marker.CUBE
    marker = marker_of(f'cell/{thing.kind}', number, shape, colour)
    x, y, z = thing.at_m
    thickness = SLAB_M if thing.kind is Kind.BELT else AREA_M
    _lay(marker, (x, y, z + height_m), thing.angle_rad, (*thing.size_m, thickness))
    return marker


def _lay(
    marker: Marker, at_m: tuple[float, float, float], angle_rad: float, size_m: tuple[float, float, float]
) -> None:
    """Set centre, rotation about the vertical and size of a marker."""
    marker.pose.position = point_of(at_m)
    q = marker.pose.orientation
    q.x, q.y, q.z, q.w = Rotation.from_euler('z', angle_rad).as_quat().tolist()
    marker.scale.x, marker.scale.y, marker.scale.z = size_m


def _deletions(
    shown: set[tuple[str, int]], now: Sequence[Marker]
) -> tuple[list[Marker], set[tuple[str, int]]]:
    """Return the deletions of markers that are no longer shown, and the keys of the current ones."""
    names = {(marker.ns, marker.id) for marker in now}
    gone = [marker_of(name, number, Marker.CUBE, PART) for name, number in sorted(shown - names)]
    for marker in gone:
        marker.action = Marker.DELETE
    return gone, names
