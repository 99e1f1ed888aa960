"""Curves of moves: line, arc, spline, blends, and the cubic of chapter 5; all as tables of pieces (``path``).

Every curve is C2 and parametrised by arc length; the error of curves derived from splines is of fifth order in the
length of the pieces: each piece is the quintic with position, unit tangent and curvature of the curve at both ends.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths.path import DEGREE, SEGMENT_COLUMNS, sample_path

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

COINCIDENT_M = 1e-6  # points closer than this are identical
ARC_POINT_RAD = 0.05  # angle between the points of a circle: the cubic is accurate to 2e-8 R
ARC_POINT_M = 0.02
COLLINEAR = 1e-6  # sine of the angle at the circle point below which three points are collinear
ARC_RADIUS_MAX_M = 100.0
UNEVEN = 2e-4  # allowed deviation of |dp/ds| from 1
# smaller for bends below UNEVEN_TURN_RAD, in proportion to the angle: the deviation causes jerk, as the bend does
UNEVEN_TURN_RAD, UNEVEN_MIN = 0.25, 1e-7
SMOOTH_RAD, SMOOTH_1_M = 1e-6, 0.05  # jumps of direction and curvature that need no rounding
HALVINGS_MAX = 9
SPLINE_POINTS_MAX = 100
TURN_MAX_RAD = np.radians(175.0)  # sharpest corner that can be blended
# parameter speed at the ends of a blend relative to its radius: straight corner, and decrease per rad of turn;
# chosen by trial to balance curvature and its rate of change
BLEND_REACH, BLEND_REACH_PER_RAD = 1.9, 0.25

# positions of a curve [m], shape (n, 3), and two derivatives by its parameter (n,)
Curve3 = Sequence[Callable[[Floats], Floats]]


@dataclass(frozen=True)
class Curve:
    """A path parametrised by distance, and its length [m]."""

    segments: Floats
    length_m: float

    def at(self, distance_m: float) -> Floats:
        """Return position and first three derivatives at a distance, shape (4, 3)."""
        return np.asarray(sample_path([distance_m], self.segments)[0])

    def part(self, start_m: float, end_m: float) -> 'Curve':
        """Return the part between two distances."""
        if start_m == 0.0 and end_m == self.length_m:
            return self
        inside = (self.segments[:, 0] > start_m) & (self.segments[:, 0] < end_m)
        first = np.searchsorted(self.segments[:, 0], start_m, side='right') - 1
        rows = np.vstack([_shifted(self.segments[first], start_m), self.segments[inside]])
        rows[:, 0] -= start_m
        return Curve(rows, end_m - start_m)


def _shifted(segment: Floats, start: float) -> Floats:
    """Return the same polynomial expanded at another distance."""
    row = segment.copy()
    row[0] = start
    u = start - segment[0]
    # c_k' = sum over n of (n over k) c_n u^(n - k)
    powers = [
        [comb(n, k) * u ** (n - k) if n >= k else 0.0 for n in range(DEGREE + 1)] for k in range(DEGREE + 1)
    ]
    for axis in range(3):
        columns = slice(1 + 6 * axis, 7 + 6 * axis)
        row[columns] = np.array(powers) @ segment[columns]
    return row


def joined(curves: list[Curve]) -> Curve:
    """Concatenate curves."""
    tables, length = [], 0.0
    for curve in curves:
        table = curve.segments.copy()
        table[:, 0] += length
        tables.append(table)
        length += curve.length_m
    return Curve(np.vstack(tables), length)


def line(start: ArrayLike, end: ArrayLike) -> Curve:
    """Return the straight line between two points [m] (6.1)."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    segment = np.zeros((1, SEGMENT_COLUMNS))
    segment[0, 1::6] = a
    if length > 0.0:
        segment[0, 2::6] = (b - a) / length
    return Curve(segment, length)


def point(position: ArrayLike) -> Curve:
    """Return a curve of zero length at a point [m]."""
    return line(position, position)


def arc(start: ArrayLike, via: ArrayLike, end: ArrayLike, angle_rad: float | None = None) -> Curve:
    """Return the circular arc from a start through a circle point to an end [m] (6.2), as a cubic spline.

    With an angle the arc covers exactly this angle; a whole number of turns ends at the start.

    Raises
    ------
    ProgramError
        Two of the points coincide or all three are on a line.

    """
    a, c, b = (np.asarray(p, dtype=np.float64) for p in (start, via, end))
    for name, p, q in (
        ('start and end', a, b),
        ('start and circle point', a, c),
        ('circle point and end', c, b),
    ):
        if np.linalg.norm(p - q) < COINCIDENT_M:
            advice = ': for a full circle give two other points of it, and angle_deg: 360'
            raise ProgramError(f'{name} of the circle coincide{advice if name == "start and end" else ""}')
    u, v = c - a, b - a
    normal = np.cross(u, v)
    sine = np.linalg.norm(normal) / (np.linalg.norm(u) * np.linalg.norm(v))
    if sine < COLLINEAR:
        raise ProgramError('start, circle point and end are on a line: they do not define a circle')
    to_centre = np.cross(np.dot(u, u) * v - np.dot(v, v) * u, normal) / (2.0 * np.dot(normal, normal))
    centre, radius = a + to_centre, float(np.linalg.norm(to_centre))
    if radius > ARC_RADIUS_MAX_M:
        raise ProgramError(f'the circle has a radius of {radius:.4g} m, the limit is {ARC_RADIUS_MAX_M:g} m')
    e1 = -to_centre / radius
    e2 = np.cross(normal / np.linalg.norm(normal), e1)
    # the normal follows the order a, c, b, so that both angles are in (0, 2 pi)
    sweep = float(np.arctan2(np.dot(b - centre, e2), np.dot(b - centre, e1))) % (2.0 * np.pi)
    if angle_rad is not None:
        sweep = angle_rad
        turns = sweep / (2.0 * np.pi)
        is_whole = abs(turns - round(turns)) * radius < COINCIDENT_M * 1e-3
        b = a if is_whole else centre + radius * (np.cos(sweep) * e1 + np.sin(sweep) * e2)
    pieces = int(np.ceil(max(sweep / ARC_POINT_RAD, min(sweep * radius / ARC_POINT_M, 64.0), 4.0)))
    angles = np.linspace(0.0, sweep, pieces + 1)[:, None]
    points = centre + radius * (np.cos(angles) * e1 + np.sin(angles) * e2)
    points[0], points[-1] = a, b
    tangents = -np.sin(angles) * e1 + np.cos(angles) * e2
    spline = _cubic_spline(angles[:, 0] * radius, points, ((1, tangents[0]), (1, tangents[-1])))
    return Curve(_cubic_pieces(spline), sweep * radius)


def _cubic_spline(at: Floats, points: Floats, ends: Any) -> 'CubicSpline':
    from scipy.interpolate import CubicSpline  # the import takes half a second; programs of lines avoid it

    return CubicSpline(at, points, bc_type=ends)


def _cubic_pieces(spline: 'CubicSpline') -> Floats:
    segments = np.zeros((len(spline.x) - 1, SEGMENT_COLUMNS))
    segments[:, 0] = spline.x[:-1]
    for axis in range(3):
        segments[:, 1 + 6 * axis : 5 + 6 * axis] = spline.c[::-1, :, axis].T
    return segments


def spline(points: ArrayLike) -> Curve:
    """Return the cubic spline through points [m] of shape (n, 3), n from 2 to 101, in arc length (6.3).

    The points are joined by a natural cubic spline over their chords.

    Raises
    ------
    ProgramError
        There are too many points, two neighbours coincide, or the curve turns back at one.

    """
    p = np.asarray(points, dtype=np.float64)
    if len(p) > SPLINE_POINTS_MAX + 1:
        raise ProgramError(f'it goes through {len(p) - 1} points, the limit is {SPLINE_POINTS_MAX}')
    chords = np.linalg.norm(np.diff(p, axis=0), axis=1)
    if chords.min() < COINCIDENT_M:
        raise ProgramError(f'points {np.argmin(chords)} and {np.argmin(chords) + 1} of the spline coincide')
    if len(p) == 2:
        return line(p[0], p[1])
    u = np.concatenate([[0.0], np.cumsum(chords)])
    cubic = _cubic_spline(u, p, 'natural')
    derivatives = [cubic, cubic.derivative(1), cubic.derivative(2)]
    return by_arc_length(derivatives, u, 'spline')


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def by_arc_length(curve: Curve3, knots: Floats, what: str, uneven: float = UNEVEN) -> Curve:
    """Reparametrise a C2 curve, p(t) and two derivatives, by arc length.

    Intervals between knots are halved until |dp/ds| of every piece is within ``uneven`` of 1.

    Raises
    ------
    ProgramError
        The curve has no tangent at some point, because its speed is zero or it turns back there.

    """
    t = np.asarray(knots, dtype=np.float64)
    for _ in range(HALVINGS_MAX):
        p, first, second = (derivative(t) for derivative in curve)
        speed = np.linalg.norm(first, axis=1)
        if speed.min() > 0.0:
            middle, half = 0.5 * (t[1:] + t[:-1]), 0.5 * np.diff(t)
            inner = curve[1]((middle[:, None] + half[:, None] * _NODES).ravel())
            lengths = half * (np.linalg.norm(inner, axis=1).reshape(len(half), -1) @ _WEIGHTS)
            tangent = first / speed[:, None]
            along = (second * tangent).sum(axis=1, keepdims=True)
            curvature = (second - along * tangent) / speed[:, None] ** 2
            segments = _hermite(p, tangent, curvature, lengths)
            bad = _unevenness(segments, lengths) > uneven
            if not bad.any():
                return Curve(segments, float(lengths.sum()))
        else:
            bad = np.ones(len(t) - 1, dtype=bool)
        t = np.sort(np.concatenate([t, 0.5 * (t[1:] + t[:-1])[bad]]))
    x, y, z = p[np.argmin(speed)]
    raise ProgramError(f'the {what} turns too sharply near ({x:.4f}, {y:.4f}, {z:.4f}) m')


def _hermite(p: Floats, first: Floats, second: Floats, lengths: Floats) -> Floats:
    """Return quintic pieces from position and two derivatives at both ends, and their lengths."""
    h = lengths[:, None]
    p0, p1, v0, v1 = p[:-1], p[1:], first[:-1] * h, first[1:] * h
    a0, a1 = second[:-1] * h**2, second[1:] * h**2
    d = p1 - p0
    coefficients = [
        p0,
        v0 / h,
        0.5 * a0 / h**2,
        (10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1) / h**3,
        (-15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1) / h**4,
        (6.0 * d - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)) / h**5,
    ]
    segments = np.empty((len(lengths), SEGMENT_COLUMNS))
    segments[:, 0] = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    for power, c in enumerate(coefficients):
        segments[:, 1 + power :: DEGREE + 1] = c
    return segments


def _unevenness(segments: Floats, lengths: Floats) -> Floats:
    """Return the largest deviation of |dp/ds| from 1 of each piece."""
    share = np.array([0.15, 0.3, 0.5, 0.7, 0.85])
    distances = (segments[:, :1] + lengths[:, None] * share).ravel()
    speed = np.linalg.norm(sample_path(distances, segments)[:, 1], axis=1)
    return np.asarray(np.abs(speed - 1.0).reshape(len(lengths), -1).max(axis=1))


def blend(before: Curve, after: Curve, radius_m: float) -> Curve:
    """Round the corner between two curves with a blend that starts and ends at a distance from the corner.

    Position, tangent and curvature match the curves at both ends (C2). Where the curves already meet without a jump of
    direction and curvature, the path stays on them.

    Raises
    ------
    ProgramError
        The corner turns back on itself.

    """
    start, end = before.at(before.length_m - radius_m), after.at(radius_m)
    corner_before, corner_after = before.at(before.length_m), after.at(0.0)
    jumps = np.linalg.norm(corner_after - corner_before, axis=1)
    if jumps[1] <= SMOOTH_RAD and jumps[2] <= SMOOTH_1_M:
        length = before.length_m
        return joined([before.part(length - radius_m, length), after.part(0.0, radius_m)])
    turn = np.arccos(np.clip(np.dot(corner_before[1], corner_after[1]), -1.0, 1.0))
    if turn > TURN_MAX_RAD:
        raise ProgramError('the path turns back at this corner, which cannot be rounded; use blend_m: 0')
    return rounded(start, end, (radius_m, radius_m), turn, 'blend')


def rounded(start: Floats, end: Floats, legs_m: tuple[float, float], turn_rad: float, what: str) -> Curve:
    """Round a corner between two states at a distance before and after it.

    Parameters
    ----------
    start, end
        Position with first two derivatives by the distance, shapes (3, 3) or more.
    legs_m
        Distances of the two from the corner [m].
    turn_rad
        Angle between the directions before and after the corner.
    what
        Name for messages.

    """
    first, last = ((BLEND_REACH - BLEND_REACH_PER_RAD * turn_rad) * leg for leg in legs_m)
    coefficients = _hermite(
        np.array([start[0], end[0]]),
        np.array([start[1] * first, end[1] * last]),
        np.array([start[2] * first**2, end[2] * last**2]),
        np.ones(1),
    )[0]
    place = coefficients[1:].reshape(3, DEGREE + 1).T  # rows of powers
    speed = _derived(place)
    derivatives = place, speed, _derived(speed)
    bend_rad = float(np.arccos(np.clip(np.dot(start[1], end[1]), -1.0, 1.0)))
    uneven = max(UNEVEN * min(bend_rad / UNEVEN_TURN_RAD, 1.0), UNEVEN_MIN)
    evaluated = [partial(_evaluated, rows) for rows in derivatives]
    return by_arc_length(evaluated, np.linspace(0.0, 1.0, 3), what, uneven)


def _derived(coefficients: Floats) -> Floats:
    """Return the derivative of polynomials in rows of powers."""
    return np.asarray(np.arange(1.0, len(coefficients))[:, None] * coefficients[1:])


def _evaluated(coefficients: Floats, t: Floats) -> Floats:
    """Evaluate polynomials in rows of powers at parameters (n,) by Horner's rule; shape (n, polynomials)."""
    value = np.repeat(coefficients[-1:], len(t), axis=0)
    for row in coefficients[-2::-1]:
        value *= t[:, None]
        value += row
    return value


def cubic_coefficients(
    start: Floats, end: Floats, start_speed: Floats, end_speed: Floats, duration_s: float
) -> Floats:
    """Return a_0..a_3 of X(t) = a_0 + a_1 t + a_2 t^2 + a_3 t^3 for given ends (5.7, a_2 corrected); shape (4, 3)."""
    x0, x1, v0, v1 = (np.asarray(a, dtype=np.float64) for a in (start, end, start_speed, end_speed))
    a2 = (3.0 * (x1 - x0) - (2.0 * v0 + v1) * duration_s) / duration_s**2
    a3 = (2.0 * (x0 - x1) + (v0 + v1) * duration_s) / duration_s**3
    return np.array([x0, v0, a2, a3])


def timed_cubic(
    start: Floats, end: Floats, start_speed: Floats, end_speed: Floats, duration_s: float
) -> Curve:
    """Return the cubic of chapter 5 as a curve parametrised by time [s]; its "length" is the duration."""
    segments = np.zeros((1, SEGMENT_COLUMNS))
    for power, c in enumerate(cubic_coefficients(start, end, start_speed, end_speed, duration_s)):
        segments[0, 1 + power :: DEGREE + 1] = c
    return Curve(segments, duration_s)
