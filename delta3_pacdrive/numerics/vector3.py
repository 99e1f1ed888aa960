"""Vectors of three numbers as tuples, for the compiled loops.

``a``, ``b``, ``c``, ``v``
    Vectors, shape (3,), each in its own unit.
``x``, ``y``, ``z``
    Numbers, factors of vectors.
"""

import math

from delta3_pacdrive.numerics.kernel import kernel


@kernel
def triple(a):
    """Return the first three elements of a row as a tuple."""
    return (a[0], a[1], a[2])


@kernel
def dot(a, b):
    """Return the scalar product of ``a`` and ``b``."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def length(a):
    """Return the length of ``a``."""
    return math.sqrt(dot(a, a))


@kernel
def cross(a, b):
    """Return the vector product of ``a`` and ``b``."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def difference(a, b):
    """Return ``a`` - ``b``."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def middle(a, b):
    """Return the mean of ``a`` and ``b``."""
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))


@kernel
def plus(a, x, v):
    """Return ``a`` + ``x`` ``v``."""
    return (a[0] + x * v[0], a[1] + x * v[1], a[2] + x * v[2])


@kernel
def combine(x, a, y, b, z, c):
    """Return ``x`` ``a`` + ``y`` ``b`` + ``z`` ``c``."""
    return (
        x * a[0] + y * b[0] + z * c[0],
        x * a[1] + y * b[1] + z * c[1],
        x * a[2] + y * b[2] + z * c[2],
    )
