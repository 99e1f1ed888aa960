"""Tests of the generator of a drive: its signal, and the events that end it."""

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.drive.arrays import EXCITATION_MAX, DriveState
from delta3_pacdrive.robot.drive.diagnostics import DriveFault
from delta3_pacdrive.robot.drive.excitation import PERIOD_S, UNATTENDED_S, Generator, signal_of
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_ON, Control
from drive_bench import enabled_drive, stand

CYCLE_S = 1e-3
CYCLES = 250  # of a period of the signal
HALTED = CONTROL_ENABLE & ~Control.RUN
CREST_MAX = 4.0  # of lines at logarithmic distances, with Schroeder phases


def short(robot, seconds=PERIOD_S):
    return robot.replace(drive__excitation_time_s=seconds)


def is_excited(drive):
    return bool(drive.state['excited'][0])


def excited_cycles(drive, limit=5000, **more):
    """Return the cycles in which the generator adds to the current set point."""
    for cycle in range(limit):
        stand(drive, 0.0, **more)
        if not is_excited(drive):
            return cycle
    raise AssertionError('the generator does not end')


def test_signal_has_the_effective_value_and_whole_periods(robot):
    signal = signal_of(robot)
    one = signal.periods(1)
    assert len(one) * robot.drive.velocity_period_s == pytest.approx(PERIOD_S)
    assert np.sqrt(np.mean(one**2)) == pytest.approx(robot.drive.excitation_rms_a)
    assert np.abs(one).max() < CREST_MAX * robot.drive.excitation_rms_a
    spectrum = np.abs(np.fft.rfft(one)) / len(one)
    excited = np.flatnonzero(spectrum > 1e-9)
    assert np.array_equal(excited, signal.lines)
    assert signal.frequencies_hz[[0, -1]] == pytest.approx([4.0, 1500.0])


@pytest.mark.parametrize('cycle_s', [1e-3, 2e-3, 4e-3])
def test_generator_repeats_its_signal_over_bus_cycles_of_any_length(robot, cycle_s):
    own = robot.replace(bus__cycle_time_s=cycle_s, drive__excitation_time_s=2.0 * PERIOD_S + 3.5 * cycle_s)
    generator, values = Generator(own), []
    while (cycle := generator.next_cycle()) is not None:
        generator.attend()
        values.append(cycle)
    found, one = np.concatenate(values), signal_of(own).periods(1)
    count = round(own.drive.excitation_time_s / own.drive.velocity_period_s)
    assert np.array_equal(found[:count], np.resize(one, count))
    assert not found[count:].any()  # the last bus cycle is completed with 0


def test_generator_adds_to_the_current_set_point_of_an_enabled_drive(robot):
    quiet, drive = enabled_drive(robot), enabled_drive(robot)
    assert drive.start_excitation(robot)
    one = signal_of(robot).periods(1)
    for cycle in range(3):
        for each in (quiet, drive):
            each.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        for sample in range(16):
            for each in (quiet, drive):
                each.run_sample(0.0, 0.0, 0.0)
            added = drive.state['current_asked'][0] - quiet.state['current_asked'][0]
            assert added == pytest.approx(one[8 * cycle + sample // 2], abs=1e-12)
            assert drive.state['current_added'][0] == one[8 * cycle + sample // 2]


def test_generator_ends_after_its_time_and_leaves_no_current(robot):
    drive = enabled_drive(robot)
    assert drive.start_excitation(short(robot))
    assert excited_cycles(drive) == CYCLES
    assert drive.state['current_added'][0] == 0.0
    assert drive.start_excitation(short(robot))  # again


def test_generator_ends_a_time_after_the_last_access_of_its_client(robot):
    drive = enabled_drive(robot)
    drive.start_excitation(short(robot, 60.0))
    stand(drive, 0.0, 500)
    drive.attend_excitation()
    assert excited_cycles(drive) == round(UNATTENDED_S / CYCLE_S)


def test_fault_ends_the_generator_in_its_cycle(robot):
    drive = enabled_drive(robot)
    drive.start_excitation(robot)
    stand(drive, 0.0, 5)
    assert is_excited(drive)
    drive.state['encoder_broken'] = 1
    stand(drive, 0.0)
    assert drive.fault == DriveFault.ENCODER
    assert not is_excited(drive)


@pytest.mark.parametrize('control', [CONTROL_ON, HALTED])
def test_disabling_or_a_halt_ends_the_generator(control, robot):
    drive = enabled_drive(robot)
    drive.start_excitation(robot)
    stand(drive, 0.0, 5)
    stand(drive, 0.0, 2, control=control)
    assert not is_excited(drive)
    stand(drive, 0.0, 200)  # it does not continue when the drive is enabled again
    assert drive.drive_state == DriveState.ENABLED
    assert not is_excited(drive)


def test_lost_telegram_does_not_disturb_the_signal(robot):
    drive = enabled_drive(robot)
    drive.start_excitation(robot)
    stand(drive, 0.0, 3)
    drive.extrapolate_cycle(0.0, 0.0, 0.0)
    drive.run_period(0.0, 0.0, 0.0)
    assert drive.state['current_added'][0] == signal_of(robot).periods(1)[8 * 3 + 7]


def test_generator_starts_in_an_enabled_drive_only_and_only_once(robot):
    drive = MC4(robot)
    assert not drive.start_excitation(robot)
    stand(drive, 0.0, 3, control=CONTROL_ON)
    assert not drive.start_excitation(robot)
    drive = enabled_drive(robot)
    assert drive.start_excitation(robot)
    assert not drive.start_excitation(robot)
    drive.stop_excitation()
    assert drive.start_excitation(robot)
    drive.leave_bus()
    assert not drive.start_excitation(robot)


def test_bus_cycle_with_more_periods_than_the_generator_stores_is_rejected():
    fine = parameters.load().replace(
        bus__cycle_time_s=4e-3, drive__velocity_period_s=15.625e-6, drive__current_period_s=15.625e-6
    )
    assert round(4e-3 / fine.drive.velocity_period_s) > EXCITATION_MAX
    drive = MC4(fine)
    for _ in range(60):
        drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        for _ in range(round(4e-3 / fine.bus.exchange_period_s)):
            drive.run_period(0.0, 0.0, 0.0)
    assert drive.drive_state == DriveState.ENABLED
    assert not drive.start_excitation(fine)
