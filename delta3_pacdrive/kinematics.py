"""Kinematics of the Delta-3 robot (thesis 4.2 to 4.6; corrections: docs/student/errata.md).

Frame ``base``: origin in the centre of the base plate, z up. Arm i lies in the vertical plane at azimuth alpha_i; its
angle theta_i is 0 when it points outward and positive downward. R = R_A - R_B (4.1: the plate shrinks to a point).
The kernels take l_A, l_B and R of each arm, because built and calibrated robots deviate slightly from the drawing.

    elbow        C_i = (R + l_A cos theta_i) u_i - l_A sin theta_i z
    forearm      s_i = X - C_i,  |s_i| = l_B                                   (4.4, 4.5)
    arm tangent  b_i = dC_i/dtheta_i = -l_A (sin theta_i u_i + cos theta_i z)  (4.9)

The scalar kernels work on 3-tuples and are used in the control loops; the array functions wrap them.

Arguments of the functions and kernels here:

``p``, ``pdot``
    Positions of the plate, which is the TCP, [m] and velocities [m/s] in the frame ``base``, shape (3,); of functions
    (..., 3).
``theta``, ``thetadot``
    Arm angles [rad] and speeds [rad/s], shape (3,); of functions (..., 3).
``kinematics``
    The parameters of a robot, or their group ``kinematics``.
``i``
    Number of an arm, 0 to 2.
``g``, ``geometry_record``
    One record ``GEOMETRY``, and an array with one record, shape (1,).
``elbow_in``
    Whether the elbow points inward.
``cosine``, ``sine``
    Numbers: cosine and sine of an arm angle.
``c1``, ``c2``, ``c3``
    Elbows [m], shape (3,).
``l_b``
    Lengths of the forearms [m], shape (3,).
``side``
    Number: -1 below the elbow plane, +1 above.
``sb``
    Number s_i.b_i [m^2/rad].
``s``, ``b``
    Forearm vectors s_i [m] and arm tangents b_i [m/rad] of the three arms, shape (3, 3), or of one, shape (3,).
``points``, ``angles``
    Rows of positions [m] and of arm angles [rad], shape (n, 3).
``out``
    Receives the results, one for each row, shape (n, ...).
"""

import math
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, cross, difference, dot, triple
from delta3_pacdrive.parameters import ArmDeviations, Kinematics, Parameters

Lengths = Kinematics | Parameters
Unreachable = Literal['raise', 'nan']  # handling of points without a solution

GEOMETRY = np.dtype(
    [
        ('l_a', 'f8', (3,)),
        ('l_b', 'f8', (3,)),
        ('r', 'f8', (3,)),
        ('cos_alpha', 'f8', (3,)),
        ('sin_alpha', 'f8', (3,)),
    ]
)


def geometry(kinematics: Lengths, deviations: ArmDeviations | None = None) -> NDArray[Any]:
    """Return the constants of the kernels, an array with one ``GEOMETRY``.

    Parameters
    ----------
    kinematics
        The parameters of a robot, or their group ``kinematics``.
    deviations
        Deviations of the arms from the drawing (default: the corrections of the controller).

    """
    lengths = kinematics.kinematics if isinstance(kinematics, Parameters) else kinematics
    return _geometry(lengths, deviations).copy()


@lru_cache(maxsize=16)
def _geometry(kinematics: Kinematics, deviations: ArmDeviations | None) -> NDArray[Any]:
    deviations = kinematics.corrections if deviations is None else deviations
    record = np.zeros(1, GEOMETRY)
    azimuth = np.array(kinematics.drawn_azimuth_rad) + deviations.azimuth_rad
    record['l_a'] = kinematics.upper_arm_length_m
    record['l_b'] = kinematics.forearm_length_m
    record['r'] = kinematics.radius_difference_m
    record['l_a'] += deviations.upper_arm_m
    record['l_b'] += deviations.forearm_m
    record['r'] += deviations.radius_m
    record['cos_alpha'] = np.cos(azimuth)
    record['sin_alpha'] = np.sin(azimuth)
    return record


@kernel
def sideways(i, p, g):
    """Distance y_i of the plate from the plane of arm i, signed [m]."""
    return p[1] * g.cos_alpha[i] - p[0] * g.sin_alpha[i]


@kernel
def swing_sine(i, p, g):
    """Sine |y_i|/l_B of the sideways swing of forearm i."""
    return min(abs(sideways(i, p, g)) / g.l_b[i], 1.0)


@kernel
def arm_angle(p, i, g, elbow_in):
    """Angle of arm ``i`` for the plate at ``p``; nan if out of reach (4.4).

    E cos theta + F sin theta = K has the half-angle solutions tan(theta/2) = (F -+ w)/(E + K) = (K - E)/(F +- w),
    w^2 = E^2 + F^2 - K^2; the form without cancellation is evaluated. The upper sign is the elbow-out branch, in which
    the robot works. The angle is in (-pi, pi].
    """
    l_a, l_b = g.l_a[i], g.l_b[i]
    x = p[0] * g.cos_alpha[i] + p[1] * g.sin_alpha[i] - g.r[i]
    y = sideways(i, p, g)
    e, f = 2.0 * l_a * x, -2.0 * l_a * p[2]
    k = x * x + y * y + p[2] * p[2] + l_a * l_a - l_b * l_b
    radicand = e * e + f * f - k * k
    if not radicand >= 0.0:
        return math.nan
    w = math.sqrt(radicand)
    if elbow_in:
        w = -w
    opposite, adjacent = (k - e, f + w) if f * w >= 0.0 else (f - w, e + k)
    if adjacent == 0.0:
        return math.pi if opposite != 0.0 else 0.0
    return 2.0 * math.atan(opposite / adjacent)


@kernel
def arm_angles(p, g):
    """Elbow-out angles of the three arms; nan where an arm cannot reach."""
    return (arm_angle(p, 0, g, False), arm_angle(p, 1, g, False), arm_angle(p, 2, g, False))


@kernel
def elbow(i, cosine, sine, g):
    """Elbow C_i for the cosine and sine of the arm angle."""
    reach = g.r[i] + g.l_a[i] * cosine
    return (reach * g.cos_alpha[i], reach * g.sin_alpha[i], -g.l_a[i] * sine)


@kernel
def plate_from_elbows(c1, c2, c3, l_b, side):
    """Intersection of three spheres of radii l_B (4.3), below (``side`` = -1) or above (+1) the elbow plane.

    Nan where the spheres do not meet or the elbows are collinear.
    """
    p = difference(c2, c1)
    q = difference(c3, c1)
    w = cross(p, q)
    w2 = dot(w, w)
    if w2 == 0.0:
        return (math.nan, math.nan, math.nan)
    radius2 = l_b[0] * l_b[0]
    pp = dot(p, p) + (radius2 - l_b[1] * l_b[1])
    qq = dot(q, q) + (radius2 - l_b[2] * l_b[2])
    per_w2 = 1.0 / w2
    o = combine(0.5 * qq * per_w2, cross(w, p), 0.5 * pp * per_w2, cross(q, w), 0.0, w)
    height2 = radius2 - dot(o, o)
    if not height2 >= 0.0:
        return (math.nan, math.nan, math.nan)
    along = side * math.sqrt(height2 * per_w2)
    if w[2] < 0.0:
        along = -along
    return combine(1.0, c1, 1.0, o, along, w)


@kernel
def plate_position(theta, g):
    """Position of the plate for three arm angles, below the elbow plane (4.3)."""
    c1 = elbow(0, math.cos(theta[0]), math.sin(theta[0]), g)
    c2 = elbow(1, math.cos(theta[1]), math.sin(theta[1]), g)
    c3 = elbow(2, math.cos(theta[2]), math.sin(theta[2]), g)
    return plate_from_elbows(c1, c2, c3, g.l_b, -1.0)


@kernel
def arm_tangent(i, cosine, sine, g):
    """b_i, derivative of elbow i by its angle (4.9, corrected)."""
    return (-g.l_a[i] * sine * g.cos_alpha[i], -g.l_a[i] * sine * g.sin_alpha[i], -g.l_a[i] * cosine)


@kernel
def upper_arm(i, p, s, g):
    """C_i - R u_i, the upper arm, from plate position and forearm vector; bdot_i = -(C_i - R u_i) thetadot_i."""
    return (p[0] - s[0] - g.r[i] * g.cos_alpha[i], p[1] - s[1] - g.r[i] * g.sin_alpha[i], p[2] - s[2])


@kernel
def forearms(theta, p, g):
    """Forearm vectors s_1..3 and arm tangents b_1..3."""
    cosines = (math.cos(theta[0]), math.cos(theta[1]), math.cos(theta[2]))
    sines = (math.sin(theta[0]), math.sin(theta[1]), math.sin(theta[2]))
    s = (
        difference(p, elbow(0, cosines[0], sines[0], g)),
        difference(p, elbow(1, cosines[1], sines[1], g)),
        difference(p, elbow(2, cosines[2], sines[2], g)),
    )
    b = (
        arm_tangent(0, cosines[0], sines[0], g),
        arm_tangent(1, cosines[1], sines[1], g),
        arm_tangent(2, cosines[2], sines[2], g),
    )
    return s, b


@kernel
def inverse_columns(s):
    """Columns of S^-1 times det S, and det S, for the matrix with rows s_i."""
    n1 = cross(s[1], s[2])
    n2 = cross(s[2], s[0])
    n3 = cross(s[0], s[1])
    return n1, n2, n3, dot(s[0], n1)


@kernel
def serial_distance(i, sb, g):
    """Distance from the serial singularity of arm i: s_i.b_i/(l_A l_B)."""
    return sb / (g.l_a[i] * g.l_b[i])


@kernel
def parallel_distance(s, g):
    """Distance from the parallel singularity: |det S|/l_B^3."""
    return abs(inverse_columns(s)[3]) / (g.l_b[0] * g.l_b[1] * g.l_b[2])


@kernel
def pose(theta, g):
    """Plate position, forearm vectors s_1..3 and arm tangents b_1..3 for three arm angles (4.3, 4.5, 4.9)."""
    cosines = (math.cos(theta[0]), math.cos(theta[1]), math.cos(theta[2]))
    sines = (math.sin(theta[0]), math.sin(theta[1]), math.sin(theta[2]))
    c1 = elbow(0, cosines[0], sines[0], g)
    c2 = elbow(1, cosines[1], sines[1], g)
    c3 = elbow(2, cosines[2], sines[2], g)
    p = plate_from_elbows(c1, c2, c3, g.l_b, -1.0)
    s = (difference(p, c1), difference(p, c2), difference(p, c3))
    b = (
        arm_tangent(0, cosines[0], sines[0], g),
        arm_tangent(1, cosines[1], sines[1], g),
        arm_tangent(2, cosines[2], sines[2], g),
    )
    return p, s, b


@kernel
def jacobian_columns(s, b):
    """Columns of J = S^-1 D (4.13)."""
    n1, n2, n3, determinant = inverse_columns(s)
    zero = (0.0, 0.0, 0.0)
    j1 = combine(dot(s[0], b[0]) / determinant, n1, 0.0, zero, 0.0, zero)
    j2 = combine(dot(s[1], b[1]) / determinant, n2, 0.0, zero, 0.0, zero)
    j3 = combine(dot(s[2], b[2]) / determinant, n3, 0.0, zero, 0.0, zero)
    return j1, j2, j3


@kernel
def _inverse_all(points, out, geometry_record):
    """Fill ``out`` with the angles of both branches of each arm, shape (n, 3, 2); nan if out of reach."""
    for n in range(points.shape[0]):
        p = triple(points[n])
        for i in range(3):
            for branch in range(2):
                out[n, i, branch] = arm_angle(p, i, geometry_record[0], branch == 1)


@kernel
def _inverse(points, out, geometry_record):
    """Fill ``out``; return the first row with a nan, or -1."""
    bad = -1
    for n in range(points.shape[0]):
        angles = arm_angles(triple(points[n]), geometry_record[0])
        for i in range(3):
            out[n, i] = angles[i]
        if bad < 0 and math.isnan(angles[0] + angles[1] + angles[2]):
            bad = n
    return bad


@kernel
def _forward(angles, side, out, geometry_record):
    """Fill ``out``; return the first row with a nan, or -1."""
    bad = -1
    g = geometry_record[0]
    for n in range(angles.shape[0]):
        theta = triple(angles[n])
        c1 = elbow(0, math.cos(theta[0]), math.sin(theta[0]), g)
        c2 = elbow(1, math.cos(theta[1]), math.sin(theta[1]), g)
        c3 = elbow(2, math.cos(theta[2]), math.sin(theta[2]), g)
        point = plate_from_elbows(c1, c2, c3, g.l_b, side)
        for axis in range(3):
            out[n, axis] = point[axis]
        if bad < 0 and math.isnan(point[0]):
            bad = n
    return bad


@kernel
def _jacobian(angles, points, out, geometry_record):
    """Fill ``out`` with J, shape (n, 3, 3)."""
    for n in range(angles.shape[0]):
        s, b = forearms(triple(angles[n]), triple(points[n]), geometry_record[0])
        columns = jacobian_columns(s, b)
        for i in range(3):
            for axis in range(3):
                out[n, axis, i] = columns[i][axis]


@kernel
def _singularity(angles, points, out, geometry_record):
    """Fill ``out`` with the distances from the three serial singularities and the parallel one, shape (n, 4)."""
    g = geometry_record[0]
    for n in range(angles.shape[0]):
        s, b = forearms(triple(angles[n]), triple(points[n]), g)
        for i in range(3):
            out[n, i] = serial_distance(i, dot(s[i], b[i]), g)
        out[n, 3] = parallel_distance(s, g)


@kernel
def _swing_sines(points, out, geometry_record):
    """Fill ``out`` with the sines of the sideways swing of the three forearms, shape (n, 3)."""
    for n in range(points.shape[0]):
        for i in range(3):
            out[n, i] = swing_sine(i, triple(points[n]), geometry_record[0])


def rows(values: ArrayLike, name: str) -> tuple[Floats, tuple[int, ...]]:
    """Return ``values`` of shape (..., 3) as contiguous rows (n, 3), and the leading shape.

    Raises
    ------
    ValueError
        Another shape; ``name`` is used in the message.

    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f'{name} must have shape (..., 3), not {array.shape}')
    return np.ascontiguousarray(array.reshape(-1, 3)), array.shape[:-1]


def _pairs(theta: ArrayLike, p: ArrayLike) -> tuple[Floats, Floats, tuple[int, ...]]:
    """Return arm angles and positions of shapes (..., 3), broadcast against each other, as rows."""
    theta, p = np.broadcast_arrays(np.asarray(theta, dtype=np.float64), np.asarray(p, dtype=np.float64))
    (angles, shape), (points, _) = rows(theta, 'theta'), rows(p, 'p')
    return angles, points, shape


def _is_nan(unreachable: Unreachable) -> bool:
    if unreachable not in ('raise', 'nan'):
        raise ValueError(f'unreachable must be "raise" or "nan", not {unreachable!r}')
    return unreachable == 'nan'


def inverse(p: ArrayLike, kinematics: Lengths, *, unreachable: Unreachable = 'raise') -> Floats:
    """Return arm angles of the elbow-out branch for TCP positions (4.4).

    Parameters
    ----------
    p
        TCP positions [m] in the frame ``base``, shape (..., 3).
    kinematics
        The parameters of a robot, or their group ``kinematics``.
    unreachable
        ``raise`` an error, or return ``nan`` for unreachable positions.

    Returns
    -------
    Floats
        Arm angles [rad], 0 = horizontal, positive downward, shape (..., 3).

    Raises
    ------
    UnreachableError
        A position is out of reach; names the first one and its first arm.

    """
    points, shape = rows(p, 'p')
    theta = np.empty_like(points)
    n = _inverse(points, theta, geometry(kinematics))
    if n >= 0 and _is_nan(unreachable):
        theta[np.isnan(theta).any(axis=1)] = np.nan
    elif n >= 0:
        i = np.flatnonzero(np.isnan(theta[n]))[0]
        x, y, z = points[n]
        place = f'position {n} ' if len(points) > 1 else ''
        raise UnreachableError(f'{place}({x:g}, {y:g}, {z:g}) m is out of reach of arm {i + 1}')
    return theta.reshape(*shape, 3)


def inverse_all(p: ArrayLike, kinematics: Lengths) -> Floats:
    """Return all eight solutions (Fig. 4.6) for TCP positions, shape (..., 3) -> (..., 8, 3); nan if out of reach.

    Bit i of the solution's number means that the elbow of arm i + 1 points inward; solution 0 is that of ``inverse``.
    """
    points, shape = rows(p, 'p')
    branches = np.empty((len(points), 3, 2))
    _inverse_all(points, branches, geometry(kinematics))
    number = np.arange(8)
    theta = np.stack([branches[:, i, (number >> i) & 1] for i in range(3)], axis=-1)
    return theta.reshape(*shape, 8, 3)


def forward(
    theta: ArrayLike, kinematics: Lengths, *, above: bool = False, unreachable: Unreachable = 'raise'
) -> Floats:
    """Return TCP positions for arm angles (4.3).

    Parameters
    ----------
    theta
        Arm angles [rad], 0 = horizontal, positive downward, shape (..., 3).
    kinematics
        The parameters of a robot, or their group ``kinematics``.
    above
        Return the solution above the elbow plane instead of that below it.
    unreachable
        ``raise`` an error, or return ``nan`` for angles without a solution.

    Returns
    -------
    Floats
        TCP positions [m] in the frame ``base``, shape (..., 3).

    Raises
    ------
    UnreachableError
        The forearms do not meet for a triple of angles.

    """
    angles, shape = rows(theta, 'theta')
    points = np.empty_like(angles)
    n = _forward(angles, 1.0 if above else -1.0, points, geometry(kinematics))
    if n >= 0 and not _is_nan(unreachable):
        degrees = ', '.join(f'{angle:.3f}' for angle in np.degrees(angles[n]))
        raise UnreachableError(f'the forearms do not meet at arm angles ({degrees}) deg')
    return points.reshape(*shape, 3)


def jacobian(theta: ArrayLike, p: ArrayLike, kinematics: Lengths) -> Floats:
    """Return the Jacobian J = S^-1 D with Xdot = J thetadot (4.12, 4.13); shapes (..., 3), (..., 3) -> (..., 3, 3)."""
    angles, points, shape = _pairs(theta, p)
    out = np.empty((len(angles), 3, 3))
    _jacobian(angles, points, out, geometry(kinematics))
    return out.reshape(*shape, 3, 3)


def jacobian_dot(
    theta: ArrayLike, thetadot: ArrayLike, p: ArrayLike, pdot: ArrayLike, kinematics: Lengths
) -> Floats:
    """Return the derivative Jdot = S^-1 (Ddot - Sdot J) (4.15, corrected); shapes (..., 3) -> (..., 3, 3).

    sdot_i = Xdot - b_i thetadot_i and Ddot_ii = sdot_i.b_i + s_i.bdot_i, with bdot_i = -(C_i - R u_i) thetadot_i.
    """
    theta, thetadot, p, pdot = (np.asarray(a, dtype=np.float64) for a in (theta, thetadot, p, pdot))
    g = geometry(kinematics)[0]
    u = np.stack([g['cos_alpha'], g['sin_alpha'], np.zeros(3)], axis=-1)
    z = np.array([0.0, 0.0, 1.0])
    cosine, sine = np.cos(theta)[..., None], np.sin(theta)[..., None]
    l_a, r = g['l_a'][:, None], g['r'][:, None]
    arm = l_a * (cosine * u - sine * z)
    s = p[..., None, :] - (r * u + arm)
    b = -l_a * (sine * u + cosine * z)
    s_dot = pdot[..., None, :] - b * thetadot[..., None]
    b_dot = -arm * thetadot[..., None]
    d_dot = (s_dot * b).sum(axis=-1) + (s * b_dot).sum(axis=-1)
    bracket = d_dot[..., None] * np.eye(3) - s_dot @ jacobian(theta, p, kinematics)
    return np.asarray(np.linalg.solve(s, bracket))


def singularity(theta: ArrayLike, p: ArrayLike, kinematics: Lengths) -> tuple[Floats, Floats]:
    """Return normalised distances from singularities: s_i.b_i/(l_A l_B) (..., 3) and |det S|/l_B^3 (...)."""
    angles, points, shape = _pairs(theta, p)
    out = np.empty((len(angles), 4))
    _singularity(angles, points, out, geometry(kinematics))
    return out[:, :3].reshape(*shape, 3), out[:, 3].reshape(shape)


def forearm_swing(p: ArrayLike, kinematics: Lengths) -> Floats:
    """Return the sideways swing asin(|y_i|/l_B) [rad] of the three forearms for TCP positions (..., 3)."""
    points, shape = rows(p, 'p')
    sines = np.empty_like(points)
    _swing_sines(points, sines, geometry(kinematics))
    return np.asarray(np.arcsin(sines).reshape(*shape, 3))
