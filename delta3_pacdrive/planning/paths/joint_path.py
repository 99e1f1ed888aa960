"""Paths in joint space: arm angles as pieces over the master, TCP by forward kinematics.

Derivatives of the TCP follow from s_i = X - C_i of constant length: s.X' = s.C', and so on (4.9).

Arguments of the kernels here:

``angles``
    Arm angles [rad] and their first three derivatives by the master, shape (n, 4, 3).
``out``
    Receives positions and their first three derivatives by the master, shape (n, 4, 3).
``motion``
    Arm angles [rad] and their first two derivatives by the master, three of shape (3,).
``geometry_record``, ``g``
    Array of one ``kinematics.GEOMETRY``, shape (1,), and such a record.
``s``, ``c``
    Forearm vectors [m], and of each elbow its first three derivatives by the master.
``upper``, ``b``, ``rates``
    Upper arm and arm tangent [m], three each; derivatives of its angle, three.
``columns``
    Three columns of S^-1 times det S [m^2], shape (3,) each, and det S [m^3].
``right``
    Right side of S x = right, shape (3,).
"""

import numpy as np

from delta3_pacdrive.kinematics import Lengths, forearms, geometry, inverse_columns, plate_position, upper_arm
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, difference, dot


@kernel
def _elbow_derivatives(upper, b, rates):
    """First three derivatives of an elbow; its tangent changes as b' = -upper, upper' = b."""
    w, a, j = rates
    return (
        combine(w, b, 0.0, b, 0.0, upper),
        combine(a, b, -w * w, upper, 0.0, b),
        combine(j - w * w * w, b, -3.0 * w * a, upper, 0.0, b),
    )


@kernel
def _solved(columns, right):
    """Solve S x = right."""
    n1, n2, n3, determinant = columns
    return combine(right[0] / determinant, n1, right[1] / determinant, n2, right[2] / determinant, n3)


@kernel
def plate_motion(motion, g):
    """Position of the TCP and its first two derivatives by the master for those of the arm angles."""
    theta, rates, bends = motion
    p = plate_position(theta, g)
    s, b = forearms(theta, p, g)
    columns = inverse_columns(s)
    c = (
        _elbow_derivatives(upper_arm(0, p, s[0], g), b[0], (rates[0], bends[0], 0.0)),
        _elbow_derivatives(upper_arm(1, p, s[1], g), b[1], (rates[1], bends[1], 0.0)),
        _elbow_derivatives(upper_arm(2, p, s[2], g), b[2], (rates[2], bends[2], 0.0)),
    )
    first, second, _ = _plate_derivatives(s, c, columns)
    return p, first, second


@kernel
def _plate_derivatives(s, c, columns):
    """First two derivatives of the TCP, and those of the forearms."""
    first = _solved(columns, (dot(s[0], c[0][0]), dot(s[1], c[1][0]), dot(s[2], c[2][0])))
    s1 = (difference(first, c[0][0]), difference(first, c[1][0]), difference(first, c[2][0]))
    right = (
        dot(s[0], c[0][1]) - dot(s1[0], s1[0]),
        dot(s[1], c[1][1]) - dot(s1[1], s1[1]),
        dot(s[2], c[2][1]) - dot(s1[2], s1[2]),
    )
    return first, _solved(columns, right), s1


@kernel
def _tcp_samples(angles, out, geometry_record):
    """Fill ``out`` with the TCP for arm angles; nan where the forearms do not meet."""
    g = geometry_record[0]
    for n in range(angles.shape[0]):
        theta = (angles[n, 0, 0], angles[n, 0, 1], angles[n, 0, 2])
        p = plate_position(theta, g)
        s, b = forearms(theta, p, g)
        columns = inverse_columns(s)
        if not abs(columns[3]) > 0.0:
            out[n] = np.nan
            continue
        c = (
            _elbow_derivatives(
                upper_arm(0, p, s[0], g), b[0], (angles[n, 1, 0], angles[n, 2, 0], angles[n, 3, 0])
            ),
            _elbow_derivatives(
                upper_arm(1, p, s[1], g), b[1], (angles[n, 1, 1], angles[n, 2, 1], angles[n, 3, 1])
            ),
            _elbow_derivatives(
                upper_arm(2, p, s[2], g), b[2], (angles[n, 1, 2], angles[n, 2, 2], angles[n, 3, 2])
            ),
        )
        first, second, s1 = _plate_derivatives(s, c, columns)
        right = (
            dot(s[0], c[0][2]) - 3.0 * dot(s1[0], difference(second, c[0][1])),
            dot(s[1], c[1][2]) - 3.0 * dot(s1[1], difference(second, c[1][1])),
            dot(s[2], c[2][2]) - 3.0 * dot(s1[2], difference(second, c[2][1])),
        )
        third = _solved(columns, right)
        for axis in range(3):
            out[n, 0, axis] = p[axis]
            out[n, 1, axis] = first[axis]
            out[n, 2, axis] = second[axis]
            out[n, 3, axis] = third[axis]


def tcp_samples(angles: Floats, kinematics: Lengths) -> Floats:
    """Return TCP positions [m] and first three derivatives by the master from those of the arm angles, shape (n, 4, 3).

    Rows are nan where the forearms do not meet.
    """
    out = np.empty(angles.shape)
    _tcp_samples(np.ascontiguousarray(angles), out, geometry(kinematics))
    return out
