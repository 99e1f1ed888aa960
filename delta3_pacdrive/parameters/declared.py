"""Declarations of parameters: the text and the range of each, which every reader enforces."""

import math
from dataclasses import field
from typing import Any


def quantity(description: str, low: float = -math.inf, high: float = math.inf, **more: Any) -> Any:
    """Declare a field with the text and the closed range that every reader of it enforces.

    A value with a ``default`` may be missing in a file.
    """
    return field(metadata={'description': description, 'low': low, 'high': high}, **more)


def positive(description: str, high: float = math.inf, **more: Any) -> Any:
    """Declare a number above zero."""
    return quantity(description, math.nextafter(0.0, 1.0), high, **more)


def switch(description: str) -> Any:
    """Declare what is on or off."""
    return quantity(description, False, True)


def choice(description: str, choices: tuple[str, ...]) -> Any:
    """Declare a word out of several; the first is the default."""
    metadata = {'description': f'{description}: {" or ".join(choices)}', 'choices': choices}
    return field(default=choices[0], metadata=metadata)
