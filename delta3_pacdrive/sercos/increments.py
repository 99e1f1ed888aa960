"""Motor increments of the encoder and of the commands on the bus (thesis 8.1: 2^19 per revolution).

Arguments of the functions and kernels here:

``position``
    Motor shaft [rad].
``increments_per_rad``
    Resolution [1/rad].
"""

import numpy as np

from delta3_pacdrive.numerics.kernel import kernel


@kernel
def to_increments(position, increments_per_rad):
    """Nearest increment, as a whole float, of a shaft position [rad]."""
    return np.floor(position * increments_per_rad + 0.5)


@kernel
def on_grid(position, increments_per_rad):
    """Shaft position [rad] moved to the nearest increment."""
    return np.floor(position * increments_per_rad + 0.5) / increments_per_rad
