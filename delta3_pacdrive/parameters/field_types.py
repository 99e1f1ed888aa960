"""Field declarations of parameters with description and range."""

import math
from dataclasses import field
from typing import Any


def quantity(description: str, low: float = -math.inf, high: float = math.inf, **more: Any) -> Any:
    """Declare a field with its description and closed range; a value with a ``default`` is optional in files."""
    return field(metadata={'description': description, 'low': low, 'high': high}, **more)


def positive(description: str, high: float = math.inf, **more: Any) -> Any:
    """Declare a number above zero."""
    return quantity(description, math.nextafter(0.0, 1.0), high, **more)


def switch(description: str) -> Any:
    """Declare a boolean."""
    return quantity(description, False, True)


def choice(description: str, choices: tuple[str, ...]) -> Any:
    """Declare a string out of several; the first is the default."""
    metadata = {'description': f'{description}: {" or ".join(choices)}', 'choices': choices}
    return field(default=choices[0], metadata=metadata)
