"""Whether a program has arrived: its final TCP, by the encoders, against the end of its plan."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

# The packaged programs end within 0.014 mm of their plan, those of the built robot within 0.05 mm.
ARRIVAL_TOLERANCE_M = 1e-4


def end_error_m(final_tcp_m: Sequence[float], planned_end_m: Sequence[float]) -> float:
    """Distance [m] of the final TCP from the end of the plan."""
    return math.dist(final_tcp_m, planned_end_m)


def why_not_arrived(final_tcp_m: Sequence[float], planned_end_m: Sequence[float]) -> str | None:
    """Return a sentence if the final TCP [m] is too far off the end of the plan [m], None if the robot has arrived.

    A robot that cannot be located any more (not a finite TCP) has not arrived.
    """
    off = end_error_m(final_tcp_m, planned_end_m)
    if off <= ARRIVAL_TOLERANCE_M:
        return None
    x, y, z = planned_end_m
    return (
        f'the program has not arrived: the final TCP is {off * 1e3:.3f} mm off its planned end '
        f'({x:g}, {y:g}, {z:g}) m, more than {ARRIVAL_TOLERANCE_M * 1e3:g} mm'
    )
