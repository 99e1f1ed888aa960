"""Motor increments of the encoder and of the commands on the bus (thesis 8.1: 2^19 per revolution).

Arguments of the functions and kernels here:

``position``, ``positions``
    Motor shaft [rad]; several, shape (n,).
``increments_per_rad``
    Resolution [1/rad].
``value``
    Number.
``out``
    Takes the results, shape (n,).
"""

import math

from delta3_pacdrive.numerics.kernel import kernel

INTEGER_MAX = 2.0**62  # of numbers that an integer holds, about


@kernel
def _whole(value):
    """Largest whole number up to a value, as a float; what no integer holds is whole already, or none.

    ``numpy.floor`` is the same, but no compiler for other devices has it for single numbers.
    """
    return float(math.floor(value)) if abs(value) < INTEGER_MAX else value


@kernel
def to_increments(position, increments_per_rad):
    """Nearest increment, as a whole float, of a shaft position [rad]."""
    return _whole(position * increments_per_rad + 0.5)


@kernel
def on_grid(position, increments_per_rad):
    """Shaft position [rad] moved to the nearest increment."""
    return to_increments(position, increments_per_rad) / increments_per_rad


@kernel
def all_on_grid(positions, increments_per_rad, out):
    """Shaft positions [rad] moved to the nearest increments."""
    for n in range(len(positions)):
        out[n] = on_grid(positions[n], increments_per_rad)
