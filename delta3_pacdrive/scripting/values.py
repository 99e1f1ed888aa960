"""Conversion and range checks of argument values."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ProgramError, shown

TIMEOUT_S = 10.0  # default timeout for inputs and parts
TIME_MAX_S = 3600.0  # maximum time of a wait


def plain(value: Any) -> Any:
    """Convert tuples, arrays and numpy numbers to the plain types of a program file."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def number(name: str, value: Any, low: float, high: float, unit: str = '') -> float:
    """Check that a value is a number within limits; raises ProgramError."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise ProgramError(f'{name} is {shown(value)}, but must be a number')
    if not low <= value <= high:
        raise ProgramError(f'{name} is {value:g}{unit}, but must be between {low:g} and {high:g}{unit}')
    return float(value)
