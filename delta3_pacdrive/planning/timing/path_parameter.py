"""A smooth parameter u in 0..1 of a path: it runs slowly where the path curves sharply, and as t^3 at both ends.

Equal steps of u give a grid of distances that is coarse on long pieces and has several points on each short piece. The
spacing changes geometrically, so that a smooth function of the distance is smooth over u.
"""

from typing import NamedTuple

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths.curves import Curve

RAMP_M = 0.25  # length of the cubic run-up at each end, at most half of the path
POINTS_MIN, POINTS_MAX, POINT_M = 200, 6000, 1.6e-3
PER_PIECE = 12  # minimum number of grid points on a piece
NEWTON = 8  # Newton steps of the inversion of u(x)
INVERTED = 2001  # points of the table that supplies its start values


class PathParameter(NamedTuple):
    """Distance on an even grid of u with three derivatives by u, and the grading of the grid density."""

    u: Floats
    distance_m: Floats
    first: Floats
    second: Floats
    third: Floats
    grading: Floats  # |derivative of the logarithm of the density by u|


def path_parameter(curve: Curve) -> PathParameter:
    """Return the parameter of a path."""
    length = curve.length_m
    ramp = float(np.clip(RAMP_M / length, 0.01, 0.5))
    count = int(np.clip(length / POINT_M, POINTS_MIN, POINTS_MAX))
    centres, widths, heights = _clusters(curve, ramp, count)

    def place(x: Floats) -> Floats:
        return np.asarray(x + (np.arcsinh((x[:, None] - centres) / widths) + origin) @ (heights * widths))

    def density(x: Floats) -> Floats:
        z = (x[:, None] - centres) / widths
        return np.asarray(1.0 + np.sqrt(1.0 / (1.0 + z * z)) @ heights)

    origin = np.arcsinh(centres / widths)
    whole = float(place(np.ones(1))[0])
    u = np.linspace(0.0, 1.0, min(int(count * whole), POINTS_MAX) + 1)
    near = (centres[:, None] + widths[:, None] * np.sinh(np.linspace(-8.0, 8.0, 65))).ravel()
    guesses = np.unique(np.concatenate([np.linspace(0.0, 1.0, INVERTED), near[(near > 0.0) & (near < 1.0)]]))
    x = np.interp(u * whole, place(guesses), guesses)
    for _ in range(NEWTON):
        x = np.clip(x - (place(x) - u * whole) / density(x), 0.0, 1.0)
    x[0], x[-1] = 0.0, 1.0
    rho = density(x)
    rho1, rho2 = _density_changes(x, centres, widths, heights)
    x1 = whole / rho
    x2 = -rho1 * x1**2 / rho
    x3 = -(rho2 * x1**3 + 3.0 * rho1 * x1 * x2) / rho
    s, s1, s2, s3 = (length * one for one in _ramped(x, ramp))
    s[-1] = length
    return PathParameter(
        u,
        s,
        s1 * x1,
        second=s2 * x1**2 + s1 * x2,
        third=s3 * x1**3 + 3.0 * s2 * x1 * x2 + s1 * x3,
        grading=np.abs(x2 / x1),
    )


def _ramped(x: Floats, ramp: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Relative distance in 0..1 and three derivatives; the speed rises as r^2 (6 - 8 r + 3 r^2) at both ends."""
    past_middle = x > 0.5
    away = np.where(past_middle, 1.0 - x, x)
    r = np.minimum(away / ramp, 1.0)
    speed = 1.0 / (1.0 - 0.8 * ramp)
    way = speed * (ramp * r**3 * (2.0 - 2.0 * r + 0.6 * r**2) + np.maximum(away - ramp, 0.0))
    sign = np.where(past_middle, -1.0, 1.0)
    return (
        np.where(past_middle, 1.0 - way, way),
        speed * r**2 * (6.0 - 8.0 * r + 3.0 * r**2),
        sign * speed * 12.0 * r * (1.0 - r) ** 2 / ramp,
        speed * 12.0 * (1.0 - r) * (1.0 - 3.0 * r) / ramp**2,
    )


def _density_changes(x: Floats, centres: Floats, widths: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """First two derivatives of the grid density."""
    z = (x[:, None] - centres) / widths
    one = 1.0 / (1.0 + z * z)
    root = np.sqrt(one)
    return (-z * root * one) @ (heights / widths), ((2.0 * z * z - 1.0) * root * one * one) @ (
        heights / widths**2
    )


def _clusters(curve: Curve, ramp: float, count: int) -> tuple[Floats, Floats, Floats]:
    """Centres, widths and heights of the density peaks that give short pieces enough grid points."""
    fine = np.linspace(0.0, 1.0, INVERTED)
    edges = np.append(curve.segments[:, 0], curve.length_m)
    at = np.interp(edges, curve.length_m * _ramped(fine, ramp)[0], fine)
    middles, widths = 0.5 * (at[1:] + at[:-1]), np.maximum(np.diff(at), 1e-6)
    found: list[tuple[float, float, float]] = []
    for n in np.argsort(widths):
        centre, width = float(middles[n]), float(widths[n])
        present = 1.0 + sum(h / np.hypot(1.0, (centre - c) / w) for c, w, h in found)
        lacking = PER_PIECE / (count * width) - present
        if lacking > 0.0:
            found.append((centre, width, lacking))
    centres, wide, heights = np.array(found).reshape(-1, 3).T
    return centres, wide, heights
