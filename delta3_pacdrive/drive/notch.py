"""Two notch filters in the current reference, in front of its limit: they take away what excites a resonance.

    N(s) = (s^2 + 2 g D w s + w^2) / (s^2 + 2 D w s + w^2),  w = 2 pi f

made discrete by the bilinear transformation, so that the centre is exactly at f. ``g`` is the depth: the share of the
amplitude that passes at the centre. What is slow passes as it is, late by the dead time 2 D (1 - g) / w.

The filters keep signals, not sums of products: another filter goes on from the values of the last one.
"""

import math

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters.notch import Notch

# of one filter, as its constants end
COEFFICIENTS = ('b0', 'b1', 'b2', 'a1', 'a2')


def coefficients(filter_: Notch, period_s: float) -> tuple[float, float, float, float, float]:
    """Return b0, b1, b2, a1, a2 of y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''; without a filter y = x."""
    if filter_.frequency_hz == 0.0:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    slow = 1.0 / math.tan(math.pi * filter_.frequency_hz * period_s)
    bend, width = slow * slow, 2.0 * filter_.damping * slow
    scale = 1.0 / (bend + width + 1.0)
    middle = 2.0 * (1.0 - bend) * scale
    passed = width * filter_.depth
    return (
        (bend + passed + 1.0) * scale,
        middle,
        (bend - passed + 1.0) * scale,
        middle,
        (bend - width + 1.0) * scale,
    )


@kernel
def notched(asked, s, c):
    """Current [A] behind both filters; ``asked`` is what the loops ask for."""
    once = (
        c.notch_1_b0 * asked
        + c.notch_1_b1 * s.current_asked
        + c.notch_1_b2 * s.current_asked_before
        - c.notch_1_a1 * s.notched_once
        - c.notch_1_a2 * s.notched_once_before
    )
    twice = (
        c.notch_2_b0 * once
        + c.notch_2_b1 * s.notched_once
        + c.notch_2_b2 * s.notched_once_before
        - c.notch_2_a1 * s.notched_twice
        - c.notch_2_a2 * s.notched_twice_before
    )
    s.current_asked_before, s.current_asked = s.current_asked, asked
    s.notched_once_before, s.notched_once = s.notched_once, once
    s.notched_twice_before, s.notched_twice = s.notched_twice, twice
    return twice


@kernel
def settle_notches(current, s):
    """Let the filters be as if a current had been asked for, and had left them, all the time."""
    s.current_asked = s.current_asked_before = current
    s.notched_once = s.notched_once_before = current
    s.notched_twice = s.notched_twice_before = current
