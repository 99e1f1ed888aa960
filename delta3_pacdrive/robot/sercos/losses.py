"""Monitoring of lost telegrams, MDTs and ATs: two in a row or ten in a window are a fault (Schneider, message 8112).

Every ``CLEARING_CYCLES`` consecutive telegrams clear one loss of the window: ten evenly spread losses in fewer than a
thousand cycles are a fault. Drives and master use the same counters: ``s`` is the state of a drive, or the ``Losses``
of one axis in the master.

Arguments of the functions and kernels:

``s``, ``losses``
    Record or ``Losses`` with the counters.
``telegrams``
    Number of telegrams.
"""

from dataclasses import dataclass

from delta3_pacdrive.numerics.kernel import kernel

LOSSES_IN_A_ROW, LOSSES_IN_WINDOW = 2, 10
NO_ANSWER = 8506  # diagnostic message of the master for missing ATs
CLEARING_CYCLES = 100


@dataclass
class Losses:
    """Loss counters of the telegrams of one partner."""

    losses_in_a_row: int = 0
    losses_in_window: int = 0
    good_cycles: int = 0  # since the last loss or the last clearing


@kernel
def count_telegram(s):
    """Count a received telegram."""
    s.losses_in_a_row = 0
    s.good_cycles += 1
    if s.good_cycles >= CLEARING_CYCLES:
        s.good_cycles = 0
        s.losses_in_window = max(0, s.losses_in_window - 1)


def count_telegrams(losses: Losses, telegrams: int) -> None:
    """Count consecutive received telegrams."""
    if telegrams:
        losses.losses_in_a_row = 0
        cleared, losses.good_cycles = divmod(losses.good_cycles + telegrams, CLEARING_CYCLES)
        losses.losses_in_window = max(0, losses.losses_in_window - cleared)


@kernel
def count_loss(s):
    """Count a lost telegram."""
    s.losses_in_a_row += 1
    s.losses_in_window += 1
    s.good_cycles = 0


@kernel
def too_many(s):
    """Whether the losses amount to a fault."""
    return s.losses_in_a_row >= LOSSES_IN_A_ROW or s.losses_in_window >= LOSSES_IN_WINDOW
