"""Singular values of 3x3 matrices by one-sided Jacobi rotations: accurate to rounding, including small values.

``a``, ``b``, ``c``
    Columns of a matrix, shape (3,).
"""

import math

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import combine, dot

SWEEPS_MAX = 12  # about five suffice
ORTHOGONAL = 1e-15  # cosine of two columns considered orthogonal


@kernel
def _rotated(a, b):
    """Return two columns rotated in their plane until they are orthogonal, and whether they already were."""
    aa, bb, ab = dot(a, a), dot(b, b), dot(a, b)
    if abs(ab) <= ORTHOGONAL * math.sqrt(aa * bb):
        return a, b, True
    zeta = (bb - aa) / (2.0 * ab)
    tangent = 1.0 / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
    if zeta < 0.0:
        tangent = -tangent
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    return combine(cosine, a, -sine, b, 0.0, a), combine(sine, a, cosine, b, 0.0, a), False


@kernel
def singular_values(a, b, c):
    """Singular values, the largest first."""
    for _ in range(SWEEPS_MAX):
        a, b, first = _rotated(a, b)
        a, c, second = _rotated(a, c)
        b, c, third = _rotated(b, c)
        if first and second and third:
            break
    aa, bb, cc = dot(a, a), dot(b, b), dot(c, c)
    middle = max(min(aa, bb), min(max(aa, bb), cc))
    return math.sqrt(max(aa, bb, cc)), math.sqrt(middle), math.sqrt(min(aa, bb, cc))
