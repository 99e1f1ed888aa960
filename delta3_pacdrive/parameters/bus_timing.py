"""Times of the telegrams in a SERCOS II cycle, as a master computes them in CP2 (IEC 61491).

The master synchronisation telegram (MST) begins a cycle, and its end is the origin of all times. Each drive sends its
AT at its own time t1, then the master sends the MDT with one data record for each drive at t2. The drives acquire their
feedback at t4 and access the commands at t3.

A telegram is an HDLC frame: opening flag, address (8 bit), message, check sequence (16 bit), closing flag. The line
code is NRZI with a zero inserted after five ones, at most one bit in five of all but the flags. The order of the
telegrams, and the conditions between their times, are those of drive manuals (AX2000-B750: IDN 3 to 10, 87 to 90).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from delta3_pacdrive.parameters.records import Bus

BAUD_RATES_MBIT_S = (2, 4, 8, 16)
FLAG_BITS = 16  # opening and closing flag
ADDRESS_AND_CHECK_BITS = 24
MST_BITS = 8  # the communication phase
WORDS_BYTES = 4  # control or status word, and service word, of a data record
STUFFED_EVERY = 5
FIBRE_DELAY_US_M = 0.005  # refractive index 1.5
# times of a drive [us] (C: AX2000-B750, defaults of S-0-0003, 0004, 0005, 0088, 0090)
AT_START_MIN_US = 40  # t1min, S-0-0003
SEND_TO_RECEIVE_US = 40  # tATMT, S-0-0004: from the end of its AT to the MDT
FEEDBACK_US = 200  # t5, S-0-0005: from the acquisition of the feedback to the end of the next MST
RECEIVE_TO_RECEIVE_US = 50  # tMTSY, S-0-0088: from the end of the MDT to the MST
COMMAND_PROCESSING_US = 50  # tMTSG, S-0-0090: from the end of the MDT to access to its commands
# cyclic data: IDN and bytes
AT_DATA = (('S-0-0051', 4), ('S-0-0040', 4), ('S-0-0084', 2))
MDT_DATA, TORQUE_DATA = (('S-0-0047', 4),), (('S-0-0081', 2),)
PAYLOAD_BYTES = 4  # in the MDT; no IDN of the standard


@dataclass(frozen=True)
class BusTiming:
    """Times of a bus cycle [us] from the end of its MST; one entry per drive in tuples.

    Attributes
    ----------
    mst_us, at_us, mdt_us
        Lengths of the telegrams.
    ring_us
        Delay of the ring: fibres and drives.
    t1_us, t2_us
        Start times of the ATs and of the MDT.
    t3_us, t4_us
        Time at which commands become valid, and of feedback acquisition.
    record_positions, mdt_bytes
        Position of the first byte of each data record in the MDT, from 1, and length of all records.
    shortest_cycle_us
        Shortest cycle into which all telegrams fit.

    """

    mst_us: float
    at_us: tuple[float, ...]
    mdt_us: float
    ring_us: float
    t1_us: tuple[int, ...]
    t2_us: int
    t3_us: int
    t4_us: int
    record_positions: tuple[int, ...]
    mdt_bytes: int
    shortest_cycle_us: int

    @property
    def text(self) -> str:
        """The times as one line."""
        starts = ', '.join(map(str, self.t1_us))
        return (
            f'AT from {starts} us, MDT from {self.t2_us} us, set points valid at {self.t3_us} us, shortest cycle '
            f'{self.shortest_cycle_us} us'
        )


def telegram_us(message_bits: int, baud_rate_mbit_s: float) -> float:
    """Return the longest duration [us] of a telegram: its frame with the most inserted bits."""
    bits = ADDRESS_AND_CHECK_BITS + message_bits
    return (FLAG_BITS + bits + bits // STUFFED_EVERY) / baud_rate_mbit_s


def cyclic_bytes(sends_torque: bool) -> tuple[int, int]:
    """Return the cyclic data [bytes] of an AT, and of a data record of the MDT, of this robot."""
    mdt = MDT_DATA + TORQUE_DATA * sends_torque
    return sum(size for _, size in AT_DATA), sum(size for _, size in mdt) + PAYLOAD_BYTES


def bus_timing(bus: Bus, at_bytes: Sequence[int], record_bytes: Sequence[int]) -> BusTiming:
    """Return the times of a cycle.

    Parameters
    ----------
    bus
        Cycle time, baud rate, fibres, delay of a drive and jitter.
    at_bytes, record_bytes
        Cyclic data in the AT of each drive, and in its data record of the MDT, without status, control and service
        words.

    """
    rate, jitter_us = bus.baud_rate_mbit_s, 1e6 * bus.jitter_s
    records = [WORDS_BYTES + count for count in record_bytes]
    mst_us, mdt_us = telegram_us(MST_BITS, rate), telegram_us(8 * sum(records), rate)
    ring_us = FIBRE_DELAY_US_M * bus.fibre_length_m + 1e6 * bus.slave_delay_s * len(at_bytes)
    at_us, t1_us, end_us = [], [], float(AT_START_MIN_US)
    for count in at_bytes:
        at_us.append(telegram_us(8 * (WORDS_BYTES + count), rate))
        t1_us.append(math.ceil(end_us))
        end_us = t1_us[-1] + at_us[-1] + 2.0 * jitter_us
    # the last drive must be ready to receive, and its AT must have arrived at the master
    t2_us = math.ceil(end_us + max(SEND_TO_RECEIVE_US, ring_us))
    mdt_end_us = t2_us + mdt_us + jitter_us
    shortest_us = math.ceil(
        max(
            mdt_end_us + COMMAND_PROCESSING_US + FEEDBACK_US,
            mdt_end_us + RECEIVE_TO_RECEIVE_US + mst_us + jitter_us,
        )
    )
    # commands and feedback change at the same instant in all drives
    valid_us = round(1e6 * bus.cycle_time_s) - FEEDBACK_US
    positions = [1 + sum(records[:number]) for number in range(len(records))]
    return BusTiming(
        mst_us,
        tuple(at_us),
        mdt_us,
        ring_us,
        tuple(t1_us),
        t2_us,
        valid_us,
        valid_us,
        tuple(positions),
        sum(records),
        shortest_us,
    )


def too_short(bus: Bus, timing: BusTiming) -> str:
    """Return the sentence that the telegrams do not fit into the cycle, empty if they do."""
    cycle_us = 1e6 * bus.cycle_time_s
    if timing.shortest_cycle_us <= cycle_us + 1e-6:
        return ''
    return (
        f'bus.cycle_time_s is {bus.cycle_time_s:g}, but the telegrams of {len(timing.at_us)} drives at '
        f'{bus.baud_rate_mbit_s} Mbit/s need {1e-6 * timing.shortest_cycle_us:.6f} s with bus.timing sercos2: '
        'choose a longer cycle or a higher bus.baud_rate_mbit_s'
    )
