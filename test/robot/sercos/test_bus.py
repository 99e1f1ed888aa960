"""Tests of the bus (thesis 2.2.3, 8.1): time stamps, agreement in phase CP2, scheduler, increments, words."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, NANOSECONDS, Clock
from delta3_pacdrive.robot.sercos.configuration_check import PARTICIPANTS, Identity, disagreements, missing
from delta3_pacdrive.robot.sercos.increments import all_on_grid, on_grid, to_increments
from delta3_pacdrive.robot.sercos.scheduler import CycleScheduler, Histogram
from delta3_pacdrive.robot.sercos.words import (
    CONTROL_ENABLE,
    CONTROL_OFF,
    CONTROL_ON,
    Class1,
    Class2,
    Class3,
    Control,
    Interface,
    OperationMode,
    Phase,
    Status,
    in_torque,
)

YEARS_S = 60 * 365 * 24 * 3600  # beyond that a stamp's 32 bit seconds end
PERIODS_S = [1e-3, 2e-3, 4e-3, 500e-6, 250e-6, 125e-6]
PER_RAD = 2**19 / math.tau


# stamps


@pytest.mark.parametrize('period_s', PERIODS_S)
@given(st.integers(0, YEARS_S * 250))
def test_a_stamp_returns_to_its_count_over_years_of_cycles(period_s, count):
    clock = Clock(period_s)
    sec, nanosec = clock.stamp(count)
    assert 0 <= nanosec < NANOSECONDS
    assert sec * NANOSECONDS + nanosec == count * round(period_s * 1e9)
    assert clock.count(sec, nanosec) == count


def test_the_stamp_of_a_cycle_is_its_number_times_the_cycle_time():
    assert Clock(1e-3).stamp(1_234_567) == (1234, 567_000_000)
    assert Clock(125e-6).stamp(3) == (0, 375_000)
    assert Clock(4e-3).count(8, 4_000_000) == 2001


@pytest.mark.parametrize('period_s', PERIODS_S)
@given(st.integers(0, 2**31 - 1), st.integers(0, NANOSECONDS - 1))
def test_a_stamp_off_the_grid_is_rejected(period_s, sec, nanosec):
    clock = Clock(period_s)
    if (sec * NANOSECONDS + nanosec) % clock.period_ns:
        with pytest.raises(
            TelegramError, match=f'{sec}.{nanosec:09d} s is not a multiple of {clock.period_ns} ns'
        ):
            clock.count(sec, nanosec)
    else:
        assert clock.stamp(clock.count(sec, nanosec)) == (sec, nanosec)


@pytest.mark.parametrize('nanosec', [NANOSECONDS, 2 * NANOSECONDS, -1_000_000])
def test_nanoseconds_beyond_a_second_are_rejected(nanosec):
    with pytest.raises(TelegramError):
        Clock(1e-3).count(5, nanosec)


def test_telegrams_outside_cyclic_operation_have_the_count_minus_one():
    assert Clock(1e-3).count(ACYCLIC_SEC, 0) == -1
    assert Clock(1e-3).count(ACYCLIC_SEC, 123) == -1


# phases


def test_participants_that_are_not_there_are_named_in_order():
    assert missing({}) == ['axis1', 'axis2', 'axis3', 'plant']
    assert missing(dict.fromkeys(('plant', 'axis1', 'axis3'))) == ['axis2']
    assert missing(dict.fromkeys(PARTICIPANTS)) == []


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'bus__exchange_period_s': 500e-6}, 'axis2 has exchange_period_s 0.0005, but the master has 0.001'),
        ({'bus__increments_per_rev': 4096}, 'axis2 has increments_per_rev 4096, but the master has 524288'),
        ({'dynamics__gear_in': 20.0}, 'axis2 has gear_ratio 20.0, but the master has 32.0'),
        ({'bus__cycle_time_s': 2e-3}, 'axis2 has cycle_time_s 0.002, but the master has 0.001'),
    ],
)
def test_a_participant_with_other_parameters_is_named_with_both_values(change, sentence, robot):
    master, other = Identity.of(robot), Identity.of(robot.replace(**change))
    assert disagreements(master, {'axis1': master, 'axis2': other, 'plant': master}) == [sentence]


def test_any_other_value_shows_in_the_checksum(robot):
    master, other = Identity.of(robot), Identity.of(robot.replace(drive__velocity_gain_a_s_rad=0.36))
    (sentence,) = disagreements(master, {'plant': other})
    assert 'plant has parameter_checksum' in sentence
    assert other.parameter_checksum in sentence
    assert master.parameter_checksum in sentence
    assert sentence.endswith('(drive.velocity_gain_a_s_rad is 0.36 there, 0.35 here)')
    assert disagreements(master, dict.fromkeys(PARTICIPANTS, Identity.of(robot))) == []


# scheduler


def test_paced_cycles_start_at_their_due_times():
    scheduler = CycleScheduler(1e-3, 8)
    assert scheduler.may_start(0, 0, 100.0)
    assert not scheduler.may_start(1, 0, 100.0009)
    assert scheduler.may_start(1, 0, 100.00101)
    assert scheduler.late_s == pytest.approx(1e-5, abs=1e-9)
    assert not scheduler.may_start(2, 0, 100.00199)
    assert scheduler.may_start(2, 0, 100.00201)
    assert (scheduler.overruns, scheduler.slip_s) == (0, 0.0)


def test_due_times_do_not_drift_with_late_starts():
    scheduler, now = CycleScheduler(1e-3, 8), 50.0
    assert scheduler.may_start(0, 0, now)
    for cycle in range(1, 10_000):
        now = 50.0 + cycle * 1e-3 + 0.4e-3
        assert not scheduler.may_start(cycle, 0, 50.0 + cycle * 1e-3 - 1e-5)
        assert scheduler.may_start(cycle, 0, now)
    assert scheduler.late_s == pytest.approx(0.4e-3, abs=1e-9)
    assert scheduler.slip_s == 0.0


def test_delayed_cycle_counts_one_overrun_for_any_number_of_queries():
    scheduler = CycleScheduler(1e-3, 4)
    assert scheduler.may_start(0, 0, 0.0)
    assert not scheduler.may_start(1, 4, 0.0005)  # not due: no overrun
    for n in range(10):
        assert not scheduler.may_start(1, 4, 0.0011 + n * 1e-4)
    assert scheduler.overruns == 1
    assert scheduler.may_start(1, 3, 0.0022)
    assert not scheduler.may_start(2, 4, 0.0023)
    assert scheduler.overruns == 2


def test_late_cycles_are_caught_up():
    scheduler = CycleScheduler(1e-3, 8)
    assert scheduler.may_start(0, 0, 0.0)
    for cycle in range(1, 6):  # all due at once after a pause of 5 ms
        assert scheduler.may_start(cycle, 0, 0.0052)
    assert not scheduler.may_start(6, 0, 0.0052)
    assert scheduler.may_start(6, 0, 0.0061)
    assert scheduler.slip_s == 0.0


def test_late_schedule_with_belts_slips_immediately_and_is_on_time_again():
    scheduler = CycleScheduler(1e-3, 8, catches_up=False)
    scheduler.begin(0, 0.0)
    assert scheduler.may_start(0, 0, 0.0)
    assert not scheduler.may_start(1, 8, 0.0012)  # the belts of cycle 0 are not told yet
    assert scheduler.overruns == 1
    assert scheduler.may_start(1, 1, 0.0032)
    assert scheduler.slip_s == pytest.approx(0.002)
    assert not scheduler.may_start(2, 1, 0.0033)
    assert scheduler.may_start(2, 1, 0.0042)
    assert (scheduler.overruns, scheduler.late_s) == (1, pytest.approx(0.0002))


def test_a_schedule_that_lags_too_far_slips_for_good_and_skips_nothing():
    scheduler = CycleScheduler(1e-3, 8)
    assert scheduler.may_start(0, 0, 0.0)
    assert scheduler.may_start(1, 0, 1.0)  # due at 1 ms: 999 ms late, 8 ms may be caught up
    assert scheduler.slip_s == pytest.approx(0.991)
    assert scheduler.late_s == pytest.approx(0.999)  # what is given up was late as well
    started = [cycle for cycle in range(2, 30) if scheduler.may_start(cycle, 0, 1.0)]
    assert started == list(range(2, 10))
    assert not scheduler.may_start(10, 0, 1.0)
    assert scheduler.may_start(10, 0, 1.0011)
    assert scheduler.slip_s == pytest.approx(0.991)


def test_a_schedule_that_slips_keeps_together_with_the_ticks_of_its_timer():
    scheduler = CycleScheduler(1e-3, 4)
    scheduler.begin(0, 10.0)
    assert not scheduler.may_start(0, 0, 9.9999)
    assert scheduler.may_start(0, 0, 10.00005)
    assert scheduler.may_start(1, 0, 10.01763)  # due at 10.001: 16.63 ms late, 4 ms may be caught up
    assert scheduler.slip_s == pytest.approx(0.013)
    late = [cycle for cycle in range(2, 30) if scheduler.may_start(cycle, 0, 10.01763)]
    assert late == [2, 3, 4]
    assert scheduler.may_start(5, 0, 10.01805)  # the next tick finds the next cycle
    assert scheduler.late_s == pytest.approx(5e-5, abs=1e-9)


def test_without_a_clock_cycles_start_as_soon_as_answers_allow():
    scheduler = CycleScheduler(0.0, 2)
    assert scheduler.may_start(0, 0, 5.0)
    assert scheduler.may_start(1, 1, 5.0)
    assert not scheduler.may_start(2, 2, 5.0)
    assert scheduler.may_start(2, 1, 4.0)
    assert (scheduler.overruns, scheduler.slip_s, scheduler.late_s) == (0, 0.0, 0.0)


def test_a_run_may_begin_at_any_cycle():
    scheduler = CycleScheduler(2e-3, 8)
    assert scheduler.may_start(1000, 0, 7.0)
    assert not scheduler.may_start(1001, 0, 7.0019)
    assert scheduler.may_start(1001, 0, 7.0021)


# histogram


@pytest.mark.parametrize(('longest_s', 'width_s'), [(0.099, Histogram.BIN_S), (99.9, Histogram.WIDE_S)])
@given(data=st.data(), share=st.floats(0.001, 1.0))
def test_percentiles_are_those_of_the_durations_to_the_width_of_a_bin(longest_s, width_s, data, share):
    durations = data.draw(st.lists(st.floats(0.0, longest_s), min_size=1, max_size=200))
    histogram = Histogram()
    for duration in durations:
        histogram.add(duration)
    (found,) = histogram.percentiles([share])
    exact = np.percentile(durations, 100.0 * share, method='inverted_cdf')
    assert exact - 1e-12 <= found <= exact + width_s + 1e-12
    assert found <= max(durations)


def test_percentiles_of_a_known_distribution():
    histogram = Histogram()
    for n in range(1, 1001):
        histogram.add(n * 20e-6)
    expected = [0.01, 0.0198, 0.01998, 0.02]
    bin_s = 1.001 * histogram.BIN_S  # a duration on an edge may fall into either bin
    assert histogram.percentiles([0.5, 0.99, 0.999, 1.0]) == pytest.approx(expected, abs=bin_s)
    summary = histogram.summary_ms()
    assert list(summary) == ['p50', 'p99', 'p99.9', 'max']
    assert list(summary.values()) == pytest.approx([1e3 * value for value in expected], abs=1e3 * bin_s)


def test_durations_outside_the_bins_are_kept_by_their_maximum():
    histogram = Histogram()
    assert histogram.percentiles([0.5]) == [0.0]
    histogram.add(-1.0)
    assert histogram.percentiles([0.5]) == [0.0]
    histogram.add(500.0)
    histogram.add(700.0)
    assert histogram.percentiles([0.9]) == [700.0]
    assert histogram.max_s == 700.0


# increments and words


@given(st.floats(-25_000.0, 25_000.0))
def test_the_grid_has_2_to_the_19_increments_per_revolution_and_is_its_own_nearest(position):
    increments = to_increments(position, PER_RAD)
    assert increments == math.floor(increments)
    assert abs(increments - position * PER_RAD) <= 0.5 + 1e-6
    moved = on_grid(position, PER_RAD)
    assert on_grid(moved, PER_RAD) == moved
    assert to_increments(moved, PER_RAD) == increments


def test_one_revolution_is_2_to_the_19_increments():
    assert to_increments(math.tau, PER_RAD) == 2**19
    assert to_increments(-0.5 * math.tau, PER_RAD) == -(2**18)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_non_finite_position_is_on_no_increment(value):
    assert not math.isfinite(on_grid(value, PER_RAD))


@pytest.mark.parametrize(
    ('status', 'expected'),
    [
        (0, False),
        (Status.READY_FOR_POWER, False),
        (Status.READY_TO_ENABLE, False),
        (Status.IN_TORQUE, True),
        (Status.IN_TORQUE | Status.FOLLOWS_COMMAND, True),
        (Status.IN_TORQUE | Status.WARNING, True),
        (Status.IN_TORQUE | Status.ERROR, False),
    ],
)
def test_a_drive_is_in_torque_with_both_readiness_bits_and_no_error(status, expected):
    assert in_torque(int(status)) is expected


# numbers of bits as the standard has them, each name of each word
SERCOS_BITS = {
    Control: {'DRIVE_ON': 15, 'ENABLE': 14, 'RUN': 13, 'PROGRAM': 7, 'MEASURE': 6},
    Status: {'READY_TO_ENABLE': 15, 'READY_FOR_POWER': 14, 'ERROR': 13, 'WARNING': 12, 'FOLLOWS_COMMAND': 3},
    Class1: {
        'OVERLOAD': 0,
        'DRIVE_TEMPERATURE': 1,
        'MOTOR_TEMPERATURE': 2,
        'FEEDBACK': 5,
        'COMMUTATION': 6,
        'OVER_CURRENT': 7,
        'OVER_VOLTAGE': 8,
        'UNDER_VOLTAGE': 9,
        'POSITION_DEVIATION': 11,
        'COMMUNICATION': 12,
        'OVERTRAVEL': 13,
        'MANUFACTURER': 15,
    },
    Class2: {'OVERLOAD': 0, 'DRIVE_TEMPERATURE': 1, 'MOTOR_TEMPERATURE': 2, 'MANUFACTURER': 15},
    Class3: {'STANDSTILL': 1, 'TORQUE_LIMIT': 4, 'VELOCITY_LIMIT': 5},
    Interface: {'MST_FAILURE': 3, 'MDT_FAILURE': 4},
}


@pytest.mark.parametrize('word', SERCOS_BITS, ids=lambda word: word.__name__)
def test_the_bits_of_the_words_are_those_of_sercos(word):
    single = {name: bit for name, bit in word.__members__.items() if int(bit).bit_count() == 1}
    assert {name: int(bit) for name, bit in single.items()} == {
        name: 2**number for name, number in SERCOS_BITS[word].items()
    }


def test_words_of_several_bits_are_those_of_sercos():
    assert (CONTROL_OFF, CONTROL_ON, CONTROL_ENABLE) == (0x0000, 0x8000, 0xE000)
    assert Status.IN_TORQUE == 0xC000
    assert (OperationMode.POSITION_CONTROL, OperationMode.LAGLESS) == (0x0003, 0x0008)
    assert [int(phase) for phase in Phase] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ('status', 'expected'),
    [(0xC008, True), (0xC000, True), (0xD008, True), (0xE008, False), (0x8000, False), (0x4008, False)],
)
def test_torque_is_read_from_the_words_on_the_bus(status, expected):
    assert in_torque(status) is expected


@pytest.mark.parametrize(
    'value', [0.0, -0.5, 1e300, -1e300, math.inf, -math.inf, math.nan, 2.0**53 - 1.0, 0.49999999999999994]
)
def test_increments_are_those_of_numpy_for_any_shaft(value):
    told = to_increments(value, 1.0)
    assert np.float64(told).tobytes() == np.floor(np.float64(value) + 0.5).tobytes()
    several = np.array([value, 0.3, -7.6])
    out = np.empty(3)
    all_on_grid(several, 4.0, out)
    assert out.tobytes() == (np.floor(several * 4.0 + 0.5) / 4.0).tobytes()
