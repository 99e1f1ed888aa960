"""Tests of the notch filters in the current reference: frequency response and changes of parameters."""

import math

import numpy as np
import pytest
from scipy import signal

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.drive.arrays import STATE, drive_constants
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.notch import notched
from delta3_pacdrive.robot.drive.register import Register
from delta3_pacdrive.robot.sercos.service_channel import Access, Operation, ServiceError, parse_idn
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, Phase
from drive_bench import Bench, enabled_drive, ramp

PERIOD_S = 125e-6  # of the velocity loop
ONE = {'drive__notch_1_frequency_hz': 210.0, 'drive__notch_1_damping': 0.7, 'drive__notch_1_depth': 0.05}
TWO = {'drive__notch_2_frequency_hz': 900.0, 'drive__notch_2_damping': 0.3, 'drive__notch_2_depth': 0.4}
SAMPLES = 4096


@kernel
def _filter(values, states, constants, behind):
    for k in range(values.shape[0]):
        behind[k] = notched(values[k], states[0], constants[0])


def filtered(values, robot, states=None):
    """Return the filtered references of a drive for these currents."""
    behind = np.empty(len(values))
    _filter(values, np.zeros(1, STATE) if states is None else states, drive_constants(robot), behind)
    return behind


def of_scipy(frequency, damping, depth):
    """Return the same filter by scipy: the analog one, its frequency bent, through the bilinear transformation."""
    rate = 1.0 / PERIOD_S
    w = 2.0 * rate * math.tan(math.pi * frequency / rate)
    return signal.bilinear([1.0, 2.0 * damping * depth * w, w * w], [1.0, 2.0 * damping * w, w * w], rate)


@pytest.mark.parametrize('which', [ONE, TWO, ONE | TWO], ids=['first', 'second', 'both'])
def test_the_frequency_response_is_that_of_scipy(which, robot):
    impulse = np.zeros(SAMPLES)
    impulse[0] = 1.0
    frequencies = np.fft.rfftfreq(SAMPLES, PERIOD_S)
    found = np.fft.rfft(filtered(impulse, robot.replace(**which)))
    expected = np.ones(len(frequencies), dtype=complex)
    for values, place in ((ONE, 'drive__notch_1_frequency_hz'), (TWO, 'drive__notch_2_frequency_hz')):
        if place in which:
            expected *= signal.freqz(*of_scipy(*values.values()), frequencies, fs=1.0 / PERIOD_S)[1]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize('depth', [0.001, 0.05, 1.0])
def test_notch_gain_is_its_depth_at_the_centre_and_one_at_zero_frequency(depth, robot):
    deep = robot.replace(**ONE | {'drive__notch_1_depth': depth, 'drive__notch_1_frequency_hz': 200.0})
    time_s = PERIOD_S * np.arange(SAMPLES)
    behind = filtered(np.sin(math.tau * 200.0 * time_s), deep)
    assert np.abs(behind[-40:]).max() == pytest.approx(depth, abs=1e-9)  # a period of the sine has 40 samples
    assert filtered(np.full(SAMPLES, 3.0), deep)[-1] == pytest.approx(3.0, rel=1e-12)


def test_ramp_is_delayed_by_the_dead_time_of_the_feed_forward(robot):
    both = robot.replace(**ONE | TWO)
    slow = np.arange(SAMPLES) * PERIOD_S
    late_s = float((slow - filtered(slow, both))[-1])
    assert both.torque_dead_time_s - robot.torque_dead_time_s == pytest.approx(late_s, rel=1e-9)
    assert late_s == pytest.approx(1.008e-3 + 0.064e-3, rel=0.03)  # 2 D (1 - depth) / w of each


def test_filter_without_frequency_is_off_at_any_damping_and_depth(robot):
    idle = robot.replace(
        drive__notch_1_damping=0.02,
        drive__notch_1_depth=0.9,
        drive__notch_2_damping=2.0,
        drive__notch_2_depth=1e-3,
    )
    plain, other = (Bench(r).run(100).run(60, ramp(0.05, 1.0)) for r in (robot, idle))
    assert np.array(plain.currents).tobytes() == np.array(other.currents).tobytes()
    assert np.array(plain.shafts).tobytes() == np.array(other.shafts).tobytes()
    assert idle.torque_dead_time_s == robot.torque_dead_time_s


def test_single_second_filter_has_the_bits_of_a_single_first_one(robot):
    values = np.random.default_rng(1).normal(size=200)
    names = ('frequency_hz', 'damping', 'depth')
    first, second = (
        robot.replace(
            **{f'drive__notch_{n}_{name}': v for name, v in zip(names, (300.0, 0.4, 0.2), strict=True)}
        )
        for n in (1, 2)
    )
    np.testing.assert_array_equal(filtered(values, first), filtered(values, second))


def _periods(drive, command, count):
    """Run single periods of a bus cycle on a shaft that is held at 0; return the current reference after each."""
    found = []
    for n in range(count):
        if n % 16 == 0:
            drive.begin_cycle(command, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        drive.run_sample(0.0, 0.0, 0.0)
        found.append(float(drive.state['current_reference'][0]))
    return np.array(found)


@pytest.mark.parametrize(
    ('before', 'after'),
    [({}, ONE), (ONE, {}), (ONE, TWO), (ONE, ONE | {'drive__notch_1_frequency_hz': 50.0}), (ONE | TWO, {})],
)
def test_filters_that_change_while_the_current_rises_leave_no_jump(before, after, robot):
    exact = robot.replace(bus__exchange_period_s=125e-6)
    drive = enabled_drive(exact.replace(**before))
    # the speed error makes the integrator rise evenly; the filters are behind it by a gap that a change could jump over
    rising = np.concatenate([_periods(drive, 0.03, 16) for _ in range(60)])
    gap = abs(float(drive.state['current_asked'][0] - drive.state['notched_twice'][0]))
    drive.configure(exact.replace(**after))
    next_one = _periods(drive, 0.03, 2)[-1]
    usual = np.abs(np.diff(rising[-16:])).max()
    assert abs(next_one - rising[-1]) <= usual * (1.0 + 1e-9)
    if before:
        assert gap > 5.0 * usual  # otherwise nothing could have jumped


def test_a_drive_without_integral_gain_keeps_nothing_of_filters_that_change(robot):
    exact = robot.replace(bus__exchange_period_s=125e-6, drive__velocity_integral_gain_a_rad=0.0)
    drive = enabled_drive(exact.replace(**ONE))
    for n in range(20):
        _periods(drive, 0.05 * n, 16)
    assert float(drive.state['current_asked'][0]) != float(drive.state['notched_twice'][0])
    before = float(drive.state['velocity_integral'][0])
    drive.configure(exact.replace(**TWO))
    assert float(drive.state['velocity_integral'][0]) == before


def test_unchanged_filters_continue_during_a_change_of_gain(robot):
    exact = robot.replace(bus__exchange_period_s=125e-6, **ONE)
    one, other = enabled_drive(exact), enabled_drive(exact)
    for drive in (one, other):
        for n in range(3):
            _periods(drive, 0.05 * n, 16)
    other.configure(exact.replace(drive__following_error_limit_rad=0.5))
    assert _periods(one, 0.15, 16).tobytes() == _periods(other, 0.15, 16).tobytes()


def test_current_limit_holds_after_the_filters_and_stops_the_integrator(robot):
    limited = robot.replace(drive__torque_limit_n_m=0.78, bus__exchange_period_s=125e-6, **ONE)
    drive = enabled_drive(limited)
    for n in range(20):
        assert np.abs(_periods(drive, 0.1 * (n + 1), 16)).max() <= 1.0 + 1e-12
    stands = float(drive.state['velocity_integral'][0])
    assert _periods(drive, 2.1, 16)[-1] == pytest.approx(1.0)
    assert float(drive.state['velocity_integral'][0]) == stands


@pytest.mark.parametrize('frequency', [-1.0, 0.5, 9.99, 3200.1, 4000.0])
@pytest.mark.parametrize('number', [1, 2])
def test_a_frequency_that_the_loop_cannot_filter_is_rejected_with_its_bounds(number, frequency, robot):
    with pytest.raises(ParameterError, match=f'drive.notch_{number}_frequency_hz'):
        robot.replace(**{f'drive__notch_{number}_frequency_hz': frequency})
    with pytest.raises(ParameterError, match=r'0 \(off\) or between 10 Hz and 3200 Hz, 0.4 of the rate'):
        robot.replace(drive__notch_1_frequency_hz=3201.0)


def test_the_service_channel_sets_a_filter_and_rejects_a_frequency_between_off_and_ten_hertz(robot):
    drive = MC4(robot)
    register = Register(robot, lambda name: float(drive.state[name][0]), drive.configure, drive.clear_fault)

    def write(text, value):
        return register.serve(Access(parse_idn(text), Operation.WRITE, value), Phase.CP4).error

    assert write('P-0-0033', 210.0) == ServiceError.NONE
    assert drive.constants['notches'][0] == 1
    assert write('P-0-0036', 5.0) == ServiceError.INVALID
    assert 'between 10 Hz and 3200 Hz' in register.refusal
    assert write('P-0-0035', 0.0) == ServiceError.TOO_SMALL
    assert write('P-0-0034', 2.5) == ServiceError.TOO_LARGE
    assert write('P-0-0033', 0.0) == ServiceError.NONE
    assert drive.constants['notches'][0] == 0
