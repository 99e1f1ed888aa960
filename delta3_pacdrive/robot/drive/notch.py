"""Two notch filters of the current reference, before its limit, which suppress the excitation of resonances.

    N(s) = (s^2 + 2 g D w s + w^2) / (s^2 + 2 D w s + w^2),  w = 2 pi f

discretized by the bilinear transformation with the centre exactly at f. The depth ``g`` is the fraction of the
amplitude that passes at the centre. Slow signals pass unchanged, delayed by the dead time 2 D (1 - g) / w.

The state consists of signals, not of sums of products, so that a changed filter continues from the same values.
"""

import math

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters.notch import Notch

# suffixes of a filter's constants
COEFFICIENTS = ('b0', 'b1', 'b2', 'a1', 'a2')


def coefficients(filter_: Notch, period_s: float) -> tuple[float, float, float, float, float]:
    """Return b0, b1, b2, a1, a2 of y = b0 x + b1 x' + b2 x'' - a1 y' - a2 y''; y = x without a filter."""
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
    """Output current [A] of both filters for the current ``asked`` by the loops."""
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
    """Set the filters to the steady state of a constant current."""
    s.current_asked = s.current_asked_before = current
    s.notched_once = s.notched_once_before = current
    s.notched_twice = s.notched_twice_before = current
