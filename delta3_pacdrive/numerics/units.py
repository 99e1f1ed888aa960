"""Text of quantities in common units, and names of the values of several axes."""

from collections.abc import Iterable


def millimetres(place_m: Iterable[float]) -> str:
    """Return a position [m] in millimetres; values rounded to zero have no sign."""
    x, y, z = (round(1e3 * float(value), 3) + 0.0 for value in place_m)
    return f'({x:.3f}, {y:.3f}, {z:.3f}) mm'


ROTARY_AXES_MAX = (
    2  # of a robot; here because the help of commands, which loads no parameters, lists their signals
)


def numbered(name: str, number: int) -> str:
    """Return the name of a value of rotary axis ``number``, from 0: ``name``, ``name_2``."""
    return f'{name}_{number + 1}' if number else name
