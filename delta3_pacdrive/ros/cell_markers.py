"""RViz markers of the cell: belts with windows, boxes, supplies, sensors and parts."""

from collections.abc import Sequence

from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker

from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.ros.robot_markers import marker_of, point_of
from delta3_pacdrive.scene.parts import Colour
from delta3_pacdrive.view.values import CellInstant

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
