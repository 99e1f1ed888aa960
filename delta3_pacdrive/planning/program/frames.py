"""User frames and tools of motion programs.

A frame has an origin and three axes in its parent frame, or in ``base`` if it has no parent: origin at the centre of
the base plate, x along arm 1, z upwards. The plate of a delta robot only translates. A tool is therefore a constant
offset of the working point and a mass, not a frame.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.planning.program.model import Point, point_of

Axes = tuple[Point, Point, Point]
ORTHONORMAL = 1e-9  # allowed error of axis lengths and of scalar products of two axes
TAUGHT_MIN_M = (
    1e-3  # minimum distance of taught points, and of the third one from the line through the others
)
OFFSET_MAX_M = 1.0  # of a tool, per axis
ALONG_BASE: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Frame:
    """A user frame, or the frame of a work object.

    Raises
    ------
    ProgramError
        A number is not finite, or the axes are not orthonormal or left-handed.

    """

    origin_m: Point = (0.0, 0.0, 0.0)  # in the parent
    axes: Axes = ALONG_BASE  # unit vectors x, y, z in the parent: orthogonal, right-handed
    parent: 'Frame | None' = None  # None: ``base``
    name: str = ''

    def __post_init__(self) -> None:
        """Validate origin and axes."""
        what = _label('frame', self.name)
        origin = _triple(self.origin_m, f'{what}: origin_m')
        axes = _finite(self.axes, (3, 3), f'{what}: axes')
        off = float(np.abs(axes @ axes.T - np.eye(3)).max())
        if off > ORTHONORMAL:
            raise ProgramError(
                f'{what}: its axes must be unit vectors at right angles, they are off by {off:.2g}'
            )
        if np.linalg.det(axes) < 0.0:
            raise ProgramError(f'{what}: its axes must be a right-handed system')
        object.__setattr__(self, 'origin_m', origin)
        object.__setattr__(self, 'axes', tuple(tuple(axis) for axis in axes.tolist()))

    @staticmethod
    def turned(
        origin_m: ArrayLike = (0.0, 0.0, 0.0),
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        yaw_rad: float = 0.0,
        parent: 'Frame | None' = None,
        name: str = '',
    ) -> 'Frame':
        """Return a frame rotated about x, y, z of its parent by roll, pitch, yaw [rad], in this order (as in URDF).

        Raises
        ------
        ProgramError
            A number is not finite.

        """
        roll, pitch, yaw = _triple((roll_rad, pitch_rad, yaw_rad), f'{_label("frame", name)}: its angles')
        cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
        cy, sy = math.cos(yaw), math.sin(yaw)
        axes = (
            (cy * cp, sy * cp, -sp),
            (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
            (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
        )
        return Frame(_triple(origin_m, f'{_label("frame", name)}: origin_m'), axes, parent, name)

    @staticmethod
    def taught(points_m: ArrayLike, parent: 'Frame | None' = None, name: str = '') -> 'Frame':
        """Return the frame defined by three taught points [m], shape (3, 3).

        The points are the origin, a point on the x axis, and a point in the xy plane with positive y.

        Raises
        ------
        ProgramError
            Points are not finite, closer together than a millimetre, or on one line.

        """
        what = _label('frame', name)
        points = _finite(points_m, (3, 3), f'{what}: its taught points')
        along, third = points[1] - points[0], points[2] - points[0]
        length = float(np.linalg.norm(along))
        if length < TAUGHT_MIN_M:
            raise ProgramError(
                f'{what}: the point on its x axis is {length * 1e3:.3g} mm from its origin, '
                f'it must be at least {TAUGHT_MIN_M * 1e3:g} mm'
            )
        x = along / length
        away = third - (third @ x) * x
        lever = float(np.linalg.norm(away))
        if lever < TAUGHT_MIN_M:
            raise ProgramError(
                f'{what}: its taught points are on a line: the third is {lever * 1e3:.3g} mm from the line through '
                f'the others, it must be at least {TAUGHT_MIN_M * 1e3:g} mm'
            )
        y = away / lever
        y = y - (y @ x) * x
        y /= np.linalg.norm(y)
        axes = np.stack([x, y, np.cross(x, y)])
        return Frame(_triple(points[0], what), _axes(axes), parent, name)

    @property
    def in_base(self) -> 'Frame':
        """The same frame, expressed in ``base``."""
        frame = self
        while frame.parent is not None:
            parent = frame.parent
            origin = _to_parent(parent, np.array(frame.origin_m)) + np.array(parent.origin_m)
            axes = _orthonormal(np.stack([_to_parent(parent, np.array(axis)) for axis in frame.axes]))
            frame = Frame(_triple(origin, self.name), _axes(axes), parent.parent, self.name)
        return frame

    @property
    def roll_pitch_yaw_rad(self) -> Point:
        """Roll, pitch and yaw of its axes in its parent [rad], as for ``turned``; roll is 0 where x is along z."""
        x, y, z = self.axes
        pitch = math.atan2(-x[2], math.hypot(x[0], x[1]))
        if math.hypot(x[0], x[1]) < ORTHONORMAL:
            return 0.0, pitch, math.atan2(-y[0], y[1])
        return math.atan2(y[2], z[2]), pitch, math.atan2(x[1], x[0])

    @property
    def tilt_rad(self) -> float:
        """Angle between its z axis and that of ``base`` [rad]."""
        z = self.in_base.axes[2]
        return math.atan2(math.hypot(z[0], z[1]), z[2])

    def to_base(self, points_m: ArrayLike) -> Floats:
        """Transform points of this frame to ``base`` [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        frame = self.in_base
        return np.asarray(_to_parent(frame, _points(points_m)) + np.array(frame.origin_m))

    def from_base(self, points_m: ArrayLike) -> Floats:
        """Transform points of ``base`` to this frame [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        frame = self.in_base
        return _from_parent(frame, _points(points_m) - np.array(frame.origin_m))

    def directions_to_base(self, vectors: ArrayLike) -> Floats:
        """Rotate displacements or velocities from this frame to ``base``, shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        return _to_parent(self.in_base, _points(vectors))

    def inverse(self) -> 'Frame':
        """Return the inverse transform: ``inverse().to_base`` is ``from_base``."""
        frame = self.in_base
        origin = _from_parent(frame, -np.array(frame.origin_m))
        return Frame(_triple(origin, self.name), _axes(np.array(frame.axes).T), None, self.name)

    def __matmul__(self, other: 'Frame') -> 'Frame':
        """Return the composition of two frames: (a @ b).to_base(p) = a.to_base(b.to_base(p))."""
        return replace(other.in_base, parent=self).in_base

    def at(self, point_m: ArrayLike, name: str = '') -> 'Frame':
        """Return a frame with the same axes whose origin is a point of this frame [m]."""
        return Frame(_triple(point_m, f'{_label("frame", name)}: its origin'), parent=self, name=name)


@dataclass(frozen=True)
class Tool:
    """A tool on the plate: programs position its working point, and its mass adds to the payload.

    Raises
    ------
    ProgramError
        A number is not finite, an offset exceeds 1 m, or the mass exceeds the maximum payload.

    """

    offset_m: Point = (
        0.0,
        0.0,
        0.0,
    )  # from the TCP of the plate to the working point, along the axes of ``base``
    mass_kg: float = 0.0
    name: str = ''

    def __post_init__(self) -> None:
        """Validate offset and mass."""
        what = _label('tool', self.name)
        offset = _triple(self.offset_m, f'{what}: offset_m')
        if max(abs(value) for value in offset) > OFFSET_MAX_M:
            raise ProgramError(
                f'{what}: offset_m is {shown(list(offset))} m, farther than {OFFSET_MAX_M:g} m: are these millimetres?'
            )
        mass = float(_finite(self.mass_kg, (), f'{what}: mass_kg'))
        if not 0.0 <= mass <= PAYLOAD_MAX_KG:
            raise ProgramError(f'{what}: mass_kg is {mass:g}, but must be between 0 and {PAYLOAD_MAX_KG:g}')
        object.__setattr__(self, 'offset_m', offset)
        object.__setattr__(self, 'mass_kg', mass)

    def plate_m(self, points_m: ArrayLike) -> Floats:
        """Return the TCP positions of the plate for positions of the working point [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        return np.asarray(_points(points_m) - np.array(self.offset_m))

    def working_point_m(self, plate_m: ArrayLike) -> Floats:
        """Return the positions of the working point for TCP positions of the plate [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        return np.asarray(_points(plate_m) + np.array(self.offset_m))


def _label(what: str, name: str) -> str:
    return f'{what} {shown(name)}' if name else f'a {what}'


def _finite(values: object, shape: tuple[int, ...], what: str) -> Floats:
    """Convert to a finite array of a shape; raises ProgramError otherwise."""
    numbers = f'{" x ".join(map(str, shape))} numbers' if shape else 'a number'
    try:
        read = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ProgramError(f'{what} must be {numbers}, not {shown(values)}') from None
    if read.shape != shape:
        raise ProgramError(f'{what} must be {numbers}, not {shown(values)}')
    if not np.isfinite(read).all():
        raise ProgramError(f'{what} must be finite, not {shown(values)}')
    return read


def _triple(values: object, what: str) -> Point:
    return point_of(_finite(values, (3,), what))


def _points(points: ArrayLike) -> Floats:
    read = np.asarray(points, dtype=np.float64)
    if read.ndim < 1 or read.shape[-1] != 3:
        raise ProgramError(f'points must have shape (..., 3), not {read.shape}')
    return read


def _axes(axes: Floats) -> Axes:
    x, y, z = (tuple(axis) for axis in axes.tolist())
    return x, y, z


def _to_parent(frame: Frame, vectors: Floats) -> Floats:
    """Rotate vectors from a frame to its parent."""
    return _summed(vectors, np.array(frame.axes))


def _from_parent(frame: Frame, vectors: Floats) -> Floats:
    """Rotate vectors from the parent of a frame to the frame."""
    return _summed(vectors, np.array(frame.axes).T)


def _summed(vectors: Floats, axes: Floats) -> Floats:
    """Return vectors @ axes, summed in a fixed order for bit-identical results on every machine."""
    x, y, z = axes
    found: Floats = vectors[..., :1] * x + vectors[..., 1:2] * y + vectors[..., 2:] * z
    return found


def _orthonormal(axes: Floats) -> Floats:
    """Remove rounding errors of axes by one Newton step, so that long chains of frames stay orthonormal."""
    return np.asarray(1.5 * axes - 0.5 * (axes @ axes.T) @ axes)


BASE = Frame(name='base')
