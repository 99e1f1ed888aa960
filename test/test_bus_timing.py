"""Tests of the times of a SERCOS II cycle, against counted bits and the conditions of drive manuals."""

import itertools

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.parameters import Bus
from delta3_pacdrive.parameters.bus_timing import bus_timing, telegram_us, too_short

# a robot's telegrams: three values in an AT, position and payload in the MDT
SHORT, LONG = (10, 8), (16, 16)
RATES = (2, 4, 8, 16)


def ring(rate=16, cycle_time_s=1e-3, **more):
    return Bus(cycle_time_s, 250e-6, 2**19, 8, 'sercos2', rate, **more)


def times(drives, sizes=SHORT, **of_ring):
    bus = ring(**of_ring)
    return bus, bus_timing(bus, [sizes[0]] * drives, [sizes[1]] * drives)


def stuffed(bits):
    """Number of bits on the line: a zero is inserted after five ones."""
    count = ones = 0
    for bit in bits:
        count += 1
        ones = ones + 1 if bit else 0
        if ones == 5:
            count, ones = count + 1, 0
    return count


def test_the_length_of_a_telegram_is_that_of_the_worst_bits():
    generator = np.random.default_rng(4)
    for message_bits in (8, 112, 288):
        framed = message_bits + 8 + 16
        longest = 16 + stuffed([1] * framed)
        assert telegram_us(message_bits, 1) == longest
        random = max(16 + stuffed(row) for row in generator.integers(0, 2, (200, framed)))
        assert random < longest


def test_times_of_the_robot_at_16_mbit_s_by_hand():
    _, found = times(3, jitter_s=1e-6, slave_delay_s=1e-6, fibre_length_m=10.0)
    # AT: 24 bits around 14 bytes, 27 inserted, 16 of the flags: 179 bits; MDT: 24 + 288, 62 and 16: 390 bits
    assert (found.mst_us, found.at_us, found.mdt_us) == (54 / 16, (179 / 16,) * 3, 390 / 16)
    assert found.t1_us == (40, 54, 68)
    assert found.t2_us == 122  # 68 + 11.2 + two jitters + 40 for the last drive to receive
    assert (found.t3_us, found.t4_us) == (800, 800)
    assert (found.record_positions, found.mdt_bytes) == ((1, 13, 25), 36)
    assert found.ring_us == pytest.approx(10.0 * 5e-3 + 3.0, rel=1e-12)


@pytest.mark.parametrize('drives', [1, 3, 5, 8])
@pytest.mark.parametrize('rate', RATES)
def test_the_times_meet_the_conditions_of_the_drives(rate, drives):
    jitter = 2.0
    bus, t = times(drives, rate=rate, cycle_time_s=4e-3, jitter_s=1e-6 * jitter)
    ends = [start + length for start, length in zip(t.t1_us, t.at_us, strict=True)]
    assert t.t1_us[0] >= 40  # S-0-0003
    assert all(begin - jitter >= end + jitter for end, begin in zip(ends, t.t1_us[1:], strict=False))
    # S-0-0089 after the last AT, its jitter, S-0-0004 and the jitter of the MDT
    assert t.t2_us >= ends[-1] + 40 + 2.0 * jitter
    assert t.t2_us >= ends[-1] + t.ring_us  # the master has received it
    # S-0-0089 + MDT + S-0-0090 < S-0-0008 <= S-0-0002
    assert t.t2_us + t.mdt_us + 50 < t.t3_us <= 4000
    assert t.t4_us <= 4000 - 200  # S-0-0005
    # S-0-0089 <= S-0-0002 - S-0-0088 - MDT - MST - jitter
    assert t.t2_us <= 4000 - 50 - t.mdt_us - t.mst_us - 2.0 * jitter
    assert not too_short(bus, t)


@pytest.mark.parametrize(('slower', 'faster'), list(itertools.pairwise(RATES)))
def test_at_twice_the_rate_telegrams_take_half_the_time(slower, faster):
    (_, slow), (_, fast) = times(4, rate=slower), times(4, rate=faster)
    assert (slow.mdt_us, slow.mst_us) == (2.0 * fast.mdt_us, 2.0 * fast.mst_us)
    assert slow.shortest_cycle_us > fast.shortest_cycle_us


def test_a_long_ring_delays_the_mdt():
    (_, near), (_, far) = times(3, fibre_length_m=10.0), times(3, fibre_length_m=20e3)
    assert far.t2_us - near.t2_us == pytest.approx(100.0 + 3.0 - 40.0, abs=1.0)


def test_eight_drives_with_long_telegrams_do_not_fit_at_2_mbit_s():
    bus, found = times(8, LONG, rate=2)
    sentence = too_short(bus, found)
    assert sentence.startswith('bus.cycle_time_s is 0.001, but the telegrams of 8 drives at 2 Mbit/s need ')
    assert f'{1e-6 * found.shortest_cycle_us:.6f} s' in sentence
    assert not too_short(*times(8, LONG, rate=16))
    assert not too_short(*times(8, LONG, rate=2, cycle_time_s=4e-3))


def test_the_shortest_cycle_is_the_limit():
    _, found = times(5, rate=4)
    shortest = found.shortest_cycle_us
    assert not too_short(*times(5, rate=4, cycle_time_s=1e-6 * shortest))
    assert too_short(*times(5, rate=4, cycle_time_s=1e-6 * (shortest - 1)))


def test_a_robot_whose_telegrams_do_not_fit_is_rejected():
    five = parameters.load('rotary_2')
    assert five.replace(bus__timing='sercos2').bus_timing.shortest_cycle_us < 1000
    with pytest.raises(ParameterError, match=r'telegrams of 5 drives at 2 Mbit/s need 0\.001\d* s'):
        five.replace(bus__timing='sercos2', bus__baud_rate_mbit_s=2)
    # the timing of the thesis has no telegrams
    assert five.replace(bus__baud_rate_mbit_s=2).bus_delay_cycles == 1
    with pytest.raises(ParameterError, match=r'bus\.baud_rate_mbit_s is 3, but must be 2, 4, 8 or 16'):
        five.replace(bus__baud_rate_mbit_s=3)


def test_a_torque_in_the_mdt_makes_it_longer():
    thesis, model = parameters.load(), parameters.load('model')
    assert model.bus_timing.mdt_bytes == thesis.bus_timing.mdt_bytes + 3 * 2
