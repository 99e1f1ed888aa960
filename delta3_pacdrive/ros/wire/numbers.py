"""Labelled arrays of numbers as messages."""

from array import array
from typing import Any

import numpy as np
from std_msgs.msg import Float64MultiArray, MultiArrayDimension


def numbers(values: Any, label: str) -> Float64MultiArray:
    """Return a row of numbers as a message."""
    row = np.asarray(values, dtype=np.float64)
    message = Float64MultiArray(data=array('d', row.tobytes()))
    message.layout.dim = [MultiArrayDimension(label=label, size=len(row), stride=len(row))]
    return message


def row_of(message: Float64MultiArray) -> tuple[str, Any]:
    """Return the label and the row of a message made by ``numbers``."""
    label = message.layout.dim[0].label if message.layout.dim else ''
    return label, np.frombuffer(message.data, dtype=np.float64)
