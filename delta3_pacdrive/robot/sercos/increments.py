"""Motor increments of encoders and of commands on the bus (thesis 8.1: 2^19 per revolution).

Arguments of the functions and kernels:

``position``, ``positions``
    Motor shaft [rad]; several, shape (n,).
``increments_per_rad``
    Resolution [1/rad].
``value``
    Number.
``out``
    Results, shape (n,).
"""

import math

from delta3_pacdrive.numerics.kernel import kernel

INTEGER_MAX = 2.0**62  # approximate range of integers


@kernel
def _whole(value):
    """Largest integer not above a value, as a float; values beyond the integer range are returned unchanged.

    Replaces ``numpy.floor``, which compilers for other devices do not support for scalars.
    """
    return float(math.floor(value)) if abs(value) < INTEGER_MAX else value


@kernel
def to_increments(position, increments_per_rad):
    """Nearest increment of a shaft position [rad], as a float."""
    return _whole(position * increments_per_rad + 0.5)


@kernel
def on_grid(position, increments_per_rad):
    """Shaft position [rad] rounded to the nearest increment."""
    return to_increments(position, increments_per_rad) / increments_per_rad


@kernel
def all_on_grid(positions, increments_per_rad, out):
    """Shaft positions [rad] rounded to the nearest increments."""
    for n in range(len(positions)):
        out[n] = on_grid(positions[n], increments_per_rad)
