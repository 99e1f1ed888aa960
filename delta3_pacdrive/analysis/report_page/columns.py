"""Columns of numbers as text in a page: rounded to a resolution that nobody misses, differenced, deflated, base64.

A column becomes whole numbers, multiples of its resolution. Motions are smooth, so that their first, second or third
differences are small; negative ones become odd, the others even (zigzag), and the bytes of equal weight stand together.
What deflates best is taken. A reader goes the same way back, in 32 bits that wrap around: inflate, put four bytes
together, undo the zigzag, add up as often as ``order`` says, multiply by ``resolution``. The smallest number, -2^31,
stands for nothing: a cycle that the recording lacks.
"""

import base64
import math
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats

LARGEST = 2**31 - 1
NOTHING = -(2**31)
ORDERS = range(4)
# of signals whose unit says too little, and of others by their unit: finer than what drives, plots or eyes tell apart
RESOLUTIONS = {'tcp_error': 1e-8, 'following_error': 1e-8}
OF_UNITS = {
    'rad': 1e-7, 'rad/s': 1e-3, 'rad/s2': 1e-2, 'A': 1e-4, 'm': 1e-8, 'm/s': 1e-6, 'm/s2': 1e-3, 'N m': 1e-4, 'V': 1e-3,
    'N': 1e-3, 'Pa': 1.0, 'kg': 1e-5, 's': 1e-6, 'bits': 1.0, 'increments': 1.0,
}  # fmt: skip
OTHERWISE = 1e-6
ON_GRID = ('motor_command', 'motor_position')  # lie on the grid of increments: nothing is lost


def resolution_of(name: str, unit: str, increments_per_rev: int) -> float:
    """Return the step to which a signal is rounded in a page."""
    if name in ON_GRID:
        return math.tau / increments_per_rev
    return RESOLUTIONS.get(name) or OF_UNITS.get(unit, OTHERWISE)


def packed(values: Floats, resolution: float) -> dict[str, Any]:
    """Return columns of numbers, shape (n, columns), as a document for JSON.

    Numbers that are too large for the resolution make it coarser; those that are not finite become nothing.

    """
    largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
    resolution = max(resolution, largest / LARGEST * (1.0 + 1e-6))
    whole = np.full(values.shape, NOTHING, dtype=np.int64)
    finite = np.isfinite(values)
    whole[finite] = np.rint(values[finite] / resolution).astype(np.int64)
    candidates = [_deflated(np.ascontiguousarray(whole.T), order) for order in ORDERS]
    order = int(np.argmin([len(one) for one in candidates]))
    return {
        'resolution': resolution,
        'order': order,
        'columns': values.shape[1],
        'data': base64.b64encode(candidates[order]).decode('ascii'),
    }


def _deflated(whole: NDArray[np.int64], order: int) -> bytes:
    """Return the differences of whole numbers (columns, n), their bytes sorted by weight, deflated."""
    for _ in range(order):
        whole = np.diff(whole, axis=1, prepend=0)
    wrapped = whole.astype(np.uint64).astype(np.uint32).view(np.int32)
    zigzag = ((wrapped << 1) ^ (wrapped >> 31)).view(np.uint8).reshape(len(whole), -1, 4)
    return zlib.compress(np.ascontiguousarray(zigzag.transpose(0, 2, 1)).tobytes(), 9)
