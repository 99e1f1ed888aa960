"""Frames of work objects, and tools: where the points of a program are, and what of the robot is to reach them.

A frame tells points by an origin and three axes of its own, in its parent or, without one, in ``base``: the origin is
the centre of the base plate, x goes along arm 1, z upwards. The plate of this robot only translates: so a tool is no
frame, but an offset of the working point, the same at every place, and a mass that the robot carries.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.motion.program import Point, point_of
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG

Axes = tuple[Point, Point, Point]
ORTHONORMAL = 1e-9  # largest error of lengths of axes, and of scalar products of two of them
TAUGHT_MIN_M = 1e-3  # between taught points, and of the third from the line through the others
OFFSET_MAX_M = 1.0  # of a tool, on each axis
ALONG_BASE: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Frame:
    """A user frame, or the frame of a work object.

    Attributes
    ----------
    origin_m
        In the parent [m].
    axes
        Its x, y and z axis in the parent: unit vectors at right angles to each other, a right-handed system.
    parent
        The frame in which it is told; None: ``base``.
    name
        In sentences and files.

    Raises
    ------
    ProgramError
        A number is not finite, or the axes are not orthonormal or left-handed.

    """

    origin_m: Point = (0.0, 0.0, 0.0)
    axes: Axes = ALONG_BASE
    parent: 'Frame | None' = None
    name: str = ''

    def __post_init__(self) -> None:
        """Refuse what is no frame."""
        what = _called('frame', self.name)
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
        """Return the frame turned by roll about x, then pitch about y, then yaw about z of its parent [rad] (as URDF).

        Raises
        ------
        ProgramError
            A number is not finite.

        """
        roll, pitch, yaw = _triple((roll_rad, pitch_rad, yaw_rad), f'{_called("frame", name)}: its angles')
        cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
        cy, sy = math.cos(yaw), math.sin(yaw)
        axes = (
            (cy * cp, sy * cp, -sp),
            (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
            (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
        )
        return Frame(_triple(origin_m, f'{_called("frame", name)}: origin_m'), axes, parent, name)

    @staticmethod
    def taught(points_m: ArrayLike, parent: 'Frame | None' = None, name: str = '') -> 'Frame':
        """Return the frame of three taught points, shape (3, 3): its origin, one on its x axis, one beside that.

        The third point is in the xy plane, where y is positive.

        Raises
        ------
        ProgramError
            Points are not finite, closer together than a millimetre, or on one line.

        """
        what = _called('frame', name)
        points = _finite(points_m, (3, 3), f'{what}: its taught points')
        along, beside = points[1] - points[0], points[2] - points[0]
        length = float(np.linalg.norm(along))
        if length < TAUGHT_MIN_M:
            raise ProgramError(
                f'{what}: the point on its x axis is {length * 1e3:.3g} mm from its origin, '
                f'it must be at least {TAUGHT_MIN_M * 1e3:g} mm'
            )
        x = along / length
        away = beside - (beside @ x) * x
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
        """The same frame, told in ``base``."""
        frame = self
        while frame.parent is not None:
            parent = frame.parent
            origin = _told(parent, np.array(frame.origin_m)) + np.array(parent.origin_m)
            axes = _orthonormal(np.stack([_told(parent, np.array(axis)) for axis in frame.axes]))
            frame = Frame(_triple(origin, self.name), _axes(axes), parent.parent, self.name)
        return frame

    @property
    def roll_pitch_yaw_rad(self) -> Point:
        """Angles with which ``turned`` makes its axes in its parent [rad]; roll is 0 where x points along z."""
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
        """Return where points of this frame are in ``base`` [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        frame = self.in_base
        return np.asarray(_told(frame, _points(points_m)) + np.array(frame.origin_m))

    def from_base(self, points_m: ArrayLike) -> Floats:
        """Return points of ``base`` as this frame tells them [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        frame = self.in_base
        return _along(frame, _points(points_m) - np.array(frame.origin_m))

    def directions_to_base(self, vectors: ArrayLike) -> Floats:
        """Return steps or velocities along the axes of this frame as those along ``base``, shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        return _told(self.in_base, _points(vectors))

    def inverse(self) -> 'Frame':
        """Return the frame that tells the points of ``base``: ``inverse().to_base`` is ``from_base``."""
        frame = self.in_base
        origin = _along(frame, -np.array(frame.origin_m))
        return Frame(_triple(origin, self.name), _axes(np.array(frame.axes).T), None, self.name)

    def __matmul__(self, other: 'Frame') -> 'Frame':
        """Return another frame told in this one: (a @ b).to_base(p) = a.to_base(b.to_base(p))."""
        return replace(other.in_base, parent=self).in_base

    def at(self, point_m: ArrayLike, name: str = '') -> 'Frame':
        """Return the frame with the same axes whose origin is a point of this one [m]."""
        return Frame(_triple(point_m, f'{_called("frame", name)}: its place'), parent=self, name=name)


@dataclass(frozen=True)
class Tool:
    """A tool on the plate: its working point is to reach the points of a program, and its mass is carried.

    Attributes
    ----------
    offset_m
        From the TCP of the plate to the working point [m], along the axes of ``base``, as the plate never turns.
    mass_kg
        Counts to the payload.
    name
        In sentences and files.

    Raises
    ------
    ProgramError
        A number is not finite, the working point is farther than a metre away, or the mass is beyond the payloads.

    """

    offset_m: Point = (0.0, 0.0, 0.0)
    mass_kg: float = 0.0
    name: str = ''

    def __post_init__(self) -> None:
        """Refuse what is no tool."""
        what = _called('tool', self.name)
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
        """Return where the TCP of the plate is when the working point is at points [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        return np.asarray(_points(points_m) - np.array(self.offset_m))

    def working_point_m(self, plate_m: ArrayLike) -> Floats:
        """Return where the working point is when the TCP of the plate is at points [m], shapes (..., 3).

        Raises
        ------
        ProgramError
            The last dimension is not 3.

        """
        return np.asarray(_points(plate_m) + np.array(self.offset_m))


def _called(what: str, name: str) -> str:
    return f'{what} {shown(name)}' if name else f'a {what}'


def _finite(values: object, shape: tuple[int, ...], what: str) -> Floats:
    """Return numbers of a shape; refuse others, and what is not finite."""
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


def _told(frame: Frame, vectors: Floats) -> Floats:
    """Return vectors along the axes of a frame as its parent tells them."""
    return _summed(vectors, np.array(frame.axes))


def _along(frame: Frame, vectors: Floats) -> Floats:
    """Return vectors of the parent of a frame along its axes."""
    return _summed(vectors, np.array(frame.axes).T)


def _summed(vectors: Floats, axes: Floats) -> Floats:
    """Return the sums of axes times vectors, always in the same order: the same bits on any machine."""
    x, y, z = axes
    found: Floats = vectors[..., :1] * x + vectors[..., 1:2] * y + vectors[..., 2:] * z
    return found


def _orthonormal(axes: Floats) -> Floats:
    """Take rounding out of axes, so that no chain is too long."""
    return np.asarray(1.5 * axes - 0.5 * (axes @ axes.T) @ axes)


BASE = Frame(name='base')
