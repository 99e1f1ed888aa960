"""Simple solids in the frame of their part."""

import math
from dataclasses import dataclass
from typing import Any

Position = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w

UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
ALONG_X: Quaternion = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))  # rotates the z axis of a shape to x
ALONG_Y: Quaternion = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # rotates it to y


def about_z(angle_rad: float) -> Quaternion:
    """Return the rotation about z by an angle."""
    return (0.0, 0.0, math.sin(0.5 * angle_rad), math.cos(0.5 * angle_rad))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the rotation ``q`` followed by ``p``."""
    (a, b, c, d), (x, y, z, w) = p, q
    return (
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    )


@dataclass(frozen=True)
class Shape:
    """A solid centred at ``position_m``, rotated by ``quaternion`` (x, y, z, w)."""

    position_m: Position = (0.0, 0.0, 0.0)
    quaternion: Quaternion = UPRIGHT

    @property
    def kind(self) -> str:
        """Name in documents: box, cylinder or sphere."""
        return type(self).__name__.lower()

    def document(self) -> dict[str, Any]:
        """Return kind, position and sizes, ready for JSON."""
        return {'kind': self.kind} | {
            name: list(value) if isinstance(value, tuple) else value for name, value in vars(self).items()
        }


@dataclass(frozen=True)
class Box(Shape):
    """A box with edges along x, y and z."""

    size_m: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder along z."""

    radius_m: float = 1.0
    length_m: float = 1.0


@dataclass(frozen=True)
class Sphere(Shape):
    """A sphere."""

    radius_m: float = 1.0
