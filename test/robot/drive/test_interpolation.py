"""Tests of the fine interpolation of set points: linear as in the thesis, cubic with continuous speed."""

import math

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from drive_bench import INCREMENT_RAD

WAIT = 60  # cycles, after which a drive is enabled and follows


def wave(cycle_s, amplitude=0.5, hertz=3.0):
    return lambda n: amplitude * (1.0 - math.cos(math.tau * hertz * n * cycle_s))


def follow(robot, command, cycles, lost=()):
    """Let a drive with a fixed shaft follow commands; return set points and their speeds in steps of T_pos."""
    drive = MC4(robot.replace(bus__exchange_period_s=250e-6, drive__position_gain_rad_s_rad=0.0))
    steps = round(robot.bus.cycle_time_s / 250e-6)
    reference, speed, current = [], [], []
    for cycle in range(WAIT + cycles):
        if cycle - WAIT in lost:
            drive.extrapolate_cycle(0.0, 0.0, 0.0)
        else:
            drive.begin_cycle(command(max(cycle - WAIT, 0)), CONTROL_ENABLE, 0.0, 0.0, 0.0)
        for _ in range(steps):
            drive.run_period(0.0, 0.0, 0.0)
            state = drive.state[0]
            if cycle >= WAIT:
                reference.append(float(state['reference']))
                speed.append(float(state['speed_reference']))
                current.append(float(state['current_reference']))
    return np.array(reference), np.array(speed), np.array(current)


@pytest.fixture(params=[1e-3, 2e-3, 4e-3], ids=lambda s: f'{1e3 * s:g} ms')
def slow(request, robot):
    return robot.replace(bus__cycle_time_s=request.param, drive__following_error_limit_rad=100.0)


def cubic_of(robot):
    return robot.replace(drive__interpolation='cubic')


def test_both_pass_through_the_same_set_points_at_the_same_times(slow):
    command, steps = wave(slow.bus.cycle_time_s), round(slow.bus.cycle_time_s / 250e-6)
    linear, _, _ = follow(slow, command, 30)
    cubic, _, _ = follow(cubic_of(slow), command, 30)
    due = [command(n) for n in range(29)]
    np.testing.assert_allclose(cubic[2 * steps - 1 :: steps], due, atol=1e-14)
    np.testing.assert_allclose(linear[2 * steps - 1 :: steps], due, atol=1e-14)
    assert cubic_of(slow).set_point_delay_cycles == slow.set_point_delay_cycles


def test_the_cubic_set_point_is_the_curve_between_the_commands(slow):
    cycle_s = slow.bus.cycle_time_s
    command, steps = wave(cycle_s), round(cycle_s / 250e-6)
    exact = np.array([command((n + 1) / steps - 2) for n in range(30 * steps)])
    inner = slice(4 * steps, None)
    off = [np.abs(follow(one, command, 30)[0] - exact)[inner].max() for one in (slow, cubic_of(slow))]
    # chords cut a cosine by a T^2 / 8, the cubics by its fourth derivative
    rate = math.tau * 3.0
    chord = 0.5 * (rate * cycle_s) ** 2 / 8.0
    assert off[0] == pytest.approx(chord, rel=0.05)
    assert off[1] < 0.02 * off[0]


def test_the_speed_feed_forward_is_a_stair_or_continuous(slow):
    cycle_s = slow.bus.cycle_time_s
    command, steps = wave(cycle_s), round(cycle_s / 250e-6)
    acceleration = 0.5 * (math.tau * 3.0) ** 2
    inner = slice(4 * steps, None)
    linear = np.abs(np.diff(follow(slow, command, 30)[1]))[inner]
    cubic = np.abs(np.diff(follow(cubic_of(slow), command, 30)[1]))[inner]
    assert linear.max() == pytest.approx(
        acceleration * cycle_s, rel=0.05
    )  # all of it at the start of a cycle
    assert cubic.max() == pytest.approx(acceleration * 250e-6, rel=0.05)  # in even steps


def test_the_speed_of_the_set_point_is_its_feed_forward(slow):
    reference, speed, _ = follow(cubic_of(slow), wave(slow.bus.cycle_time_s), 30)
    steps = round(slow.bus.cycle_time_s / 250e-6)
    central = (reference[2:] - reference[:-2]) / 500e-6
    inner = slice(4 * steps, -1)
    np.testing.assert_allclose(speed[1:-1][inner], central[inner], atol=2e-3 * np.abs(speed).max())


def test_current_feed_forward_is_a_staircase_or_linear(slow):
    cycle_s = slow.bus.cycle_time_s
    bare = slow.replace(drive__velocity_gain_a_s_rad=0.0, drive__velocity_integral_gain_a_rad=0.0)
    steps, rate = round(cycle_s / 250e-6), math.tau * 3.0
    per_rad_s2 = bare.drive.feedforward_inertia_kg_m2 / bare.motor.torque_constant_n_m_a
    inner = slice(4 * steps, None)
    cycles = round(0.15 / cycle_s)
    linear, cubic = (follow(one, wave(cycle_s), cycles)[2] / per_rad_s2 for one in (bare, cubic_of(bare)))
    # the second difference, at the end of each period of the position loop
    jerk = 0.5 * rate**3
    assert np.abs(np.diff(linear))[inner].max() == pytest.approx(jerk * cycle_s, rel=0.05)
    assert np.abs(np.diff(cubic))[inner].max() == pytest.approx(jerk * 250e-6, rel=0.05)
    time_s = ((np.arange(cycles * steps) + 1) / steps - 2) * cycle_s
    exact = 0.5 * rate**2 * np.cos(rate * time_s)
    np.testing.assert_allclose(cubic[inner], exact[inner], atol=0.01 * 0.5 * rate**2)


def test_a_lost_mdt_breaks_neither_position_nor_speed_of_a_cubic_set_point(slow):
    cycle_s = slow.bus.cycle_time_s
    command = wave(cycle_s)
    reference, speed, _ = follow(cubic_of(slow), command, 30, lost={15})
    acceleration = 0.5 * (math.tau * 3.0) ** 2
    # the extrapolated set point is off by a T^2, and the next one takes that back within two cycles
    assert np.abs(np.diff(speed)).max() < 4.0 * acceleration * cycle_s
    assert np.abs(np.diff(reference)).max() < 2.0 * np.abs(speed).max() * 250e-6


@pytest.mark.parametrize('interpolation', ['linear', 'cubic'])
def test_drive_at_rest_requests_no_speed(interpolation, robot):
    still = robot.replace(drive__interpolation=interpolation)
    reference, speed, current = follow(still, lambda _: 0.25, 10)
    assert (speed[8:] == 0.0).all()
    np.testing.assert_allclose(reference[8:], 0.25, atol=0.5 * INCREMENT_RAD)
    assert np.isfinite(current).all()


@pytest.mark.parametrize('cycle_s', [1e-3, 2e-3, 4e-3])
def test_cubic_interpolation_removes_the_current_pulses_without_effect_on_the_tcp(cycle_s, robot):
    program = program_file.load('experiment1', robot.motion)
    runs = {}
    for name in ('linear', 'cubic'):
        own = robot.replace(bus__cycle_time_s=cycle_s, drive__interpolation=name)
        runs[name] = simulation.run(program, own)
    spread = {
        name: np.sqrt(((trace['current_max'] - trace['current_min']) ** 2).mean())
        for name, trace in runs.items()
    }
    assert spread['cubic'] < 0.35 * spread['linear']
    linear, cubic = (runs[name].meta['figures'] for name in ('linear', 'cubic'))
    assert cubic['tcp_error_max_m'] < 1.001 * linear['tcp_error_max_m']
    # what the AT tell is what there is
    assert cubic['at_current_peak_a'][0] == pytest.approx(cubic['current_peak_a'][0], rel=0.01)
    assert linear['at_current_peak_a'][0] < 0.95 * linear['current_peak_a'][0]
