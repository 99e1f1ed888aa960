"""When lost telegrams are a fault: two in a row, or ten in a window (Schneider, diagnostic message 8112); both ways.

One loss of the window is cleared with every ``CLEARING_CYCLES`` telegrams in a row that come: ten losses in less
than a thousand cycles, evenly spread, are a fault. Drives and master count alike: ``s`` is the record of a drive, or
the ``Losses`` of one axis at the master.

Arguments of the functions and kernels here:

``s``, ``losses``
    Record or ``Losses`` with the counters.
``telegrams``
    Number of telegrams.
"""

from dataclasses import dataclass

from delta3_pacdrive.numerics.kernel import kernel

LOSSES_IN_A_ROW, LOSSES_IN_WINDOW = 2, 10
NO_ANSWER = 8506  # diagnostic message of the master that misses answers
CLEARING_CYCLES = 100


@dataclass
class Losses:
    """These counters tell of the losses among the telegrams of one partner."""

    losses_in_a_row: int = 0
    losses_in_window: int = 0
    good_cycles: int = 0  # since the last loss, or since one was cleared


@kernel
def count_telegram(s):
    """Count a telegram that came."""
    s.losses_in_a_row = 0
    s.good_cycles += 1
    if s.good_cycles >= CLEARING_CYCLES:
        s.good_cycles = 0
        s.losses_in_window = max(0, s.losses_in_window - 1)


def count_telegrams(losses: Losses, telegrams: int) -> None:
    """Count telegrams that came one after the other, as ``count_telegram`` does one by one."""
    if telegrams:
        losses.losses_in_a_row = 0
        cleared, losses.good_cycles = divmod(losses.good_cycles + telegrams, CLEARING_CYCLES)
        losses.losses_in_window = max(0, losses.losses_in_window - cleared)


@kernel
def count_loss(s):
    """Count a telegram that did not come."""
    s.losses_in_a_row += 1
    s.losses_in_window += 1
    s.good_cycles = 0


@kernel
def too_many(s):
    """Whether the losses are a fault."""
    return s.losses_in_a_row >= LOSSES_IN_A_ROW or s.losses_in_window >= LOSSES_IN_WINDOW
