"""Quantities in the units of people."""

from collections.abc import Iterable


def millimetres(place_m: Iterable[float]) -> str:
    """Return a place [m] in millimetres; what is rounded to zero has no sign."""
    x, y, z = (round(1e3 * float(value), 3) + 0.0 for value in place_m)
    return f'({x:.3f}, {y:.3f}, {z:.3f}) mm'
