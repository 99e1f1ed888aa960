"""Legs of a move: the curves of its statements, joined with rounded corners."""

from dataclasses import dataclass

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import curves
from delta3_pacdrive.motion.curves import COINCIDENT_M, Curve
from delta3_pacdrive.motion.limits import Limits
from delta3_pacdrive.motion.plan import MoveKind


@dataclass(frozen=True)
class Leg:
    """One statement's stretch of a move: its curve, limits, and what it is called in sentences."""

    curve: Curve
    limits: Limits
    blend_m: float
    strict: bool
    kind: MoveKind
    name: str


def blended(legs: list[Leg]) -> tuple[Curve, list[float], list[tuple[float, Limits]]]:
    """Join legs with rounded corners.

    Returns the curve, the distance of each leg's end (the middle of its blend) on it, and stretches (end, limits).
    """
    pieces: list[Curve] = []
    ends: list[float] = []
    stretches: list[tuple[float, Limits]] = []
    length, cut = 0.0, 0.0
    for n, leg in enumerate(legs):
        radius = leg.blend_m if n + 1 < len(legs) else 0.0
        free = leg.curve.length_m - cut - radius
        if free < -COINCIDENT_M:
            raise ProgramError(
                f'{leg.name}: its blends overlap: {cut:g} m at its start and {radius:g} m at its end on a length of '
                f'{leg.curve.length_m:.4g} m'
            )
        if radius > 0.0 and radius > legs[n + 1].curve.length_m:
            raise ProgramError(
                f'{leg.name}: blend_m is {radius:g}, but the next move is only {legs[n + 1].curve.length_m:.4g} m long'
            )
        if free > COINCIDENT_M:
            pieces.append(leg.curve.part(cut, leg.curve.length_m - radius))
            length += pieces[-1].length_m
            stretches.append((length, leg.limits))
        if radius > 0.0:
            try:
                corner = curves.blend(leg.curve, legs[n + 1].curve, radius)
            except ProgramError as error:
                raise ProgramError(f'{leg.name}: {error}') from None
            pieces.append(corner)
            ends.append(length + 0.5 * corner.length_m)
            length += corner.length_m
            stretches.append((length, lower(leg.limits, legs[n + 1].limits)))
        else:
            ends.append(length)
        cut = radius
    curve = curves.joined(pieces) if len(pieces) > 1 else pieces[0]
    return curve, ends, stretches


def lower(a: Limits, b: Limits) -> Limits:
    """Return the lower ones of two limits."""
    return Limits(
        min(a.speed_m_s, b.speed_m_s),
        min(a.acceleration_m_s2, b.acceleration_m_s2),
        min(a.jerk_m_s3, b.jerk_m_s3),
    )
