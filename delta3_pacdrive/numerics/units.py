"""Text of quantities in common units."""

from collections.abc import Iterable


def millimetres(place_m: Iterable[float]) -> str:
    """Return a position [m] in millimetres; values rounded to zero have no sign."""
    x, y, z = (round(1e3 * float(value), 3) + 0.0 for value in place_m)
    return f'({x:.3f}, {y:.3f}, {z:.3f}) mm'
