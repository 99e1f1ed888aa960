"""Number columns as text in a page: quantized, differenced, deflated, base64-encoded.

A column is converted to integer multiples of its resolution. Motions are smooth, so that their first, second or third
differences are small. Zigzag coding makes negative differences odd and others even; bytes of equal significance are
grouped. The order of differences that deflates best is used. A reader reverses the steps in 32-bit arithmetic with
wrap-around: inflate, reassemble four bytes, undo the zigzag, sum up ``order`` times, multiply by ``resolution``. The
smallest number, -2^31, marks a missing value.
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
# resolutions of signals and of units: finer than drives, plots or eyes can distinguish
RESOLUTIONS = {'tcp_error': 1e-8, 'following_error': 1e-8}
OF_UNITS = {
    'rad': 1e-7, 'rad/s': 1e-3, 'rad/s2': 1e-2, 'A': 1e-4, 'm': 1e-8, 'm/s': 1e-6, 'm/s2': 1e-3, 'N m': 1e-4, 'V': 1e-3,
    'N': 1e-3, 'Pa': 1.0, 'kg': 1e-5, 's': 1e-6, 'bits': 1.0, 'increments': 1.0,
}  # fmt: skip
OTHERWISE = 1e-6
ON_GRID = ('motor_command', 'motor_position')  # multiples of increments: lossless


def resolution_of(name: str, unit: str, increments_per_rev: int) -> float:
    """Return the resolution of a signal in a page."""
    if name in ON_GRID:
        return math.tau / increments_per_rev
    return RESOLUTIONS.get(name) or OF_UNITS.get(unit, OTHERWISE)


def packed(values: Floats, resolution: float) -> dict[str, Any]:
    """Return columns of numbers, shape (n, columns), as a document for JSON.

    The resolution is reduced if numbers are too large for it; numbers that are not finite become ``NOTHING``.
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
    """Return the differences of integers, shape (columns, n), with bytes grouped by significance, deflated."""
    for _ in range(order):
        whole = np.diff(whole, axis=1, prepend=0)
    wrapped = whole.astype(np.uint64).astype(np.uint32).view(np.int32)
    zigzag = ((wrapped << 1) ^ (wrapped >> 31)).view(np.uint8).reshape(len(whole), -1, 4)
    return zlib.compress(np.ascontiguousarray(zigzag.transpose(0, 2, 1)).tobytes(), 9)
