"""Tests of loops around an elastic gear, linear and on the bench, and of disturbances of a drive."""

import math

import numpy as np
import pytest

from delta3_pacdrive.parameters import load
from delta3_pacdrive.studies.drives.loops.analysis import (
    OperatingPoint,
    analyse,
    deviation,
    exact_shaft,
    exchanged_shaft,
    linear_cascade_loop,
)
from delta3_pacdrive.studies.drives.loops.bench import Bench, Place
from delta3_pacdrive.studies.drives.loops.disturbance import LOAD_N_M, encoder_noise_rad, rejection
from delta3_pacdrive.studies.drives.loops.load import Load, extremes, gear_of, load_at
from delta3_pacdrive.studies.drives.loops.loops import Entry, linear_cascade
from delta3_pacdrive.studies.drives.loops.response import margins
from thoroughness import some

SPEED_RAD_S = 10.0
RATIO = 32.0


@pytest.fixture(scope='module')
def built():
    return load('rich')


@pytest.fixture(scope='module')
def home(built):
    return load_at(built.motion.home_m, 0, built)


def test_gear_model_is_that_of_the_built_robot_at_the_motor_and_absent_for_a_nominal_robot(built, robot):
    gear = gear_of(built)
    assert gear.stiffness_n_m_rad == pytest.approx(100000.0 / RATIO**2)
    assert gear.damping_n_m_s_rad == pytest.approx(15.0 / RATIO**2)
    assert gear.rotor_kg_m2 == pytest.approx(0.58e-4 + 0.227e-4)
    assert gear_of(robot) is None
    assert gear_of(built.replace(rich__gear=False)) is None


def test_motor_oscillates_against_its_arm_at_the_frequency_of_spring_and_inertias(built, home):
    gear, arm = gear_of(built), home.inertia_kg_m2 - gear_of(built).rotor_kg_m2
    loops = linear_cascade(built, exact_shaft(built, home, SPEED_RAD_S), Entry.CURRENT_SET_POINT)
    frequencies = np.geomspace(40.0, 600.0, 2000)
    size = np.abs(loops.respond(frequencies, 'speed', 2)) * frequencies
    with_rotor = math.sqrt(gear.stiffness_n_m_rad * (1.0 / gear.rotor_kg_m2 + 1.0 / arm)) / math.tau
    alone = math.sqrt(gear.stiffness_n_m_rad / arm) / math.tau
    assert frequencies[np.argmax(size)] == pytest.approx(with_rotor, rel=0.03)
    below = frequencies < 0.8 * with_rotor
    assert frequencies[below][np.argmin(size[below])] == pytest.approx(alone, rel=0.03)


def test_a_gear_that_hardly_gives_leaves_the_loops_of_a_rigid_one(built, home):
    stiff = built.replace(rich__gear_stiffness_n_m_rad=1e7, rich__gear_damping_n_m_s_rad=500.0)
    rigid = built.replace(rich__gear=False)
    frequencies = np.geomspace(2.0, 250.0, 100)  # the spring of the stiff one swings at 2 kHz

    def sensitivity(robot):
        shaft = exact_shaft(robot, home, SPEED_RAD_S)
        return linear_cascade(robot, shaft, Entry.CURRENT).respond(frequencies, 'current_asked', 2)

    np.testing.assert_allclose(sensitivity(stiff), sensitivity(rigid), rtol=0.05)


def test_default_gains_leave_the_built_robot_hardly_more_than_a_decibel(built):
    left = {
        load_.name: linear_cascade_loop(built, exchanged_shaft(built, load_, SPEED_RAD_S))
        for load_ in extremes(built)
    }
    least = min(loop.margins.gain_margin_db for loop in left.values())
    assert all(loop.stable for loop in left.values())
    assert 0.5 < least < 2.0
    rigid = built.replace(rich__gear=False)
    for load_ in extremes(rigid):
        assert (
            linear_cascade_loop(rigid, exchanged_shaft(rigid, load_, SPEED_RAD_S)).margins.gain_margin_db
            > 7.0
        )


@pytest.mark.parametrize('notch', some([0.0, 210.0], [210.0]))
def test_drive_on_the_bench_with_elastic_gear_agrees_with_its_linear_loops(notch, built, home):
    filtered = built.replace(drive__notch_1_frequency_hz=notch, drive__notch_1_damping=0.7)
    # free of noise and ripple: what is left differs by the loops alone
    clean = filtered.replace(rich__sensors=False, rich__ripple=False)
    for loop in analyse(clean, OperatingPoint(home, SPEED_RAD_S), lambda *_: None)[1:]:
        assert loop.stable
        measured = loop.measured_open
        linear = np.interp(np.log(measured.frequencies_hz), np.log(loop.frequencies_hz), loop.open_loop)
        apart = deviation(measured, linear)
        assert apart['up_to_hz'] > 400.0
        assert apart['decibels'] < 1.0
        assert apart['degrees'] < 8.0


@pytest.mark.parametrize('name', ['delta3', 'rich'])
def test_load_step_on_the_bench_follows_the_difference_equations(name):
    robot = load(name).replace(rich__sensors=False, bus__exchange_period_s=125e-6)
    here = load_at(robot.motion.home_m, 0, robot)
    bench = Bench(robot, here, Place.POSITION, SPEED_RAD_S)
    period, count = robot.drive.current_period_s, 16 * 250
    before = bench.run(np.zeros(16))
    bench.add_load(LOAD_N_M)
    run = bench.run(np.zeros(count))
    ramp = before['position'][-1] + SPEED_RAD_S * period * np.arange(1, count + 1)
    moved = run['position'] - ramp
    linear = rejection(robot, exact_shaft(robot, here, SPEED_RAD_S))
    assert moved.max() == pytest.approx(linear.peak_rad, rel=0.03)
    assert np.argmax(moved) * period == pytest.approx(linear.peak_s, abs=0.6e-3)
    outside = np.flatnonzero(np.abs(moved) > 0.05 * moved.max())
    assert (outside[-1] + 1) * period == pytest.approx(linear.back_s, rel=0.05)


def test_more_integral_gain_brings_a_loaded_shaft_back_sooner_and_an_unstable_drive_has_no_figures(
    robot, home
):
    shaft = exact_shaft(robot, home, SPEED_RAD_S)
    usual, more = (
        rejection(robot.replace(drive__velocity_integral_gain_a_rad=gain), shaft) for gain in (20.0, 40.0)
    )
    assert more.peak_rad < usual.peak_rad
    assert more.back_s < usual.back_s
    assert rejection(robot.replace(drive__velocity_gain_a_s_rad=5.0), shaft) is None


def test_encoder_noise_causes_the_reported_current(built):
    noisy = built.replace(
        rich__gear=False, rich__friction=False, rich__ripple=False, rich__encoder_error_rad=0.0,
        rich__current_noise_a=0.0, rich__current_offset_a=[0.0] * 3, rich__current_gain_error=[0.0] * 3,
    )  # fmt: skip
    mode = Load('some', 6.0e-4)
    told = rejection(noisy, exact_shaft(noisy, mode, SPEED_RAD_S)).noise_a
    run = Bench(noisy, mode, Place.POSITION, SPEED_RAD_S).run(np.zeros(16 * 600))
    found = float(np.std(run['current_reference'][::2]))
    assert told == pytest.approx(found, rel=0.1)
    assert encoder_noise_rad(noisy) == pytest.approx(math.hypot(1.2e-5 / 3**0.5, math.tau / 2**19 / 12**0.5))


def test_the_phase_margin_is_that_of_the_crossing_nearest_to_minus_one():
    w = np.geomspace(1.0, 1000.0, 20000)
    s = 1j * w
    # the resonance passes 1 on both sides of a whole turn, far from -1
    loop = 10.0 / s * np.exp(-s * math.pi / 100.0) / (1.0 + 0.04 * s / 100.0 + (s / 100.0) ** 2)
    crossings = np.flatnonzero(np.diff(np.sign(np.abs(loop) - 1.0)))
    assert len(crossings) == 3
    over = [(math.degrees(np.angle(loop[k])) + 360.0) % 360.0 - 180.0 for k in crossings]
    assert 60.0 < over[0] < 0.9 * min(abs(over[1]), abs(over[2]))
    assert min(over) < -60.0  # the smallest number is not the nearest
    assert margins(w / math.tau, loop).phase_margin_deg == pytest.approx(over[0], abs=0.2)
