"""Tests of figures of the motor current: over the samples of a bus cycle, and over cycles marked by the master."""

import math

import numpy as np
import pytest

from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_MEASURE, CONTROL_PROGRAM
from drive_bench import enabled_drive

EXACT = 1e-12
MEASURE, PROGRAM = CONTROL_ENABLE | CONTROL_MEASURE, CONTROL_ENABLE | CONTROL_PROGRAM


def drive_cycles(drive, controls, step=0.03, exchanges=1):
    """Run a bus cycle for each control word, with commands that swing; return the samples, shape (cycles, samples)."""
    samples = []
    for n, control in enumerate(controls):
        command = step * math.sin(0.7 * n)
        if control is None:
            drive.extrapolate_cycle(0.0, 0.0, 0.0)
        else:
            drive.begin_cycle(command, control, 0.0, 0.0, 0.0)
        own = []
        for _ in range(exchanges):
            drive.run_period(0.0, 0.0, 0.0)
            own.extend(drive.currents.tolist())
        samples.append(own)
    return np.array(samples)


def figures_of(samples):
    return np.abs(samples).max(), math.sqrt((samples**2).mean())


@pytest.mark.parametrize('exchange_s', [1e-3, 250e-6, 125e-6])
def test_the_figures_of_a_cycle_are_those_of_all_its_samples(exchange_s, robot):
    drive = enabled_drive(robot.replace(bus__exchange_period_s=exchange_s))
    for n in range(8):
        samples = drive_cycles(drive, [CONTROL_ENABLE] * (n + 1), exchanges=round(1e-3 / exchange_s))[-1]
        state = drive.state[0]
        assert len(samples) == 16
        assert float(state['cycle_sum']) / 16 == pytest.approx(samples.mean(), rel=EXACT)
        assert float(state['cycle_square']) / 16 == pytest.approx((samples**2).mean(), rel=EXACT)
        assert (float(state['cycle_min']), float(state['cycle_max'])) == (samples.min(), samples.max())


def test_a_program_has_the_currents_of_the_cycles_that_are_marked_and_no_others(robot):
    drive = enabled_drive(robot)
    drive_cycles(drive, [CONTROL_ENABLE] * 3, step=0.1)  # larger currents, before
    marked = drive_cycles(drive, [MEASURE] * 20)
    assert drive.program_current() == pytest.approx(figures_of(marked), rel=EXACT)
    drive_cycles(drive, [PROGRAM] * 3, step=0.1)  # and after
    assert drive.program_current() == pytest.approx(figures_of(marked), rel=EXACT)
    assert [float(drive.state[name][0]) for name in ('last_peak', 'last_rms')] == list(
        drive.program_current()
    )


def test_the_bits_belong_to_the_bus_cycle_of_their_mdt(robot):
    drive = enabled_drive(robot)
    samples = drive_cycles(drive, [CONTROL_ENABLE, MEASURE, PROGRAM])
    assert drive.program_current() == pytest.approx(figures_of(samples[1]), rel=EXACT)


def test_held_program_keeps_its_figures_and_the_next_one_resets_them(robot):
    drive = enabled_drive(robot)
    first = drive_cycles(drive, [MEASURE] * 10)
    drive_cycles(drive, [PROGRAM] * 5, step=0.1)
    rest = drive_cycles(drive, [MEASURE] * 10)
    both = np.concatenate([first, rest])
    assert drive.program_current() == pytest.approx(figures_of(both), rel=EXACT)
    drive_cycles(drive, [CONTROL_ENABLE])
    told = [float(drive.state[name][0]) for name in ('last_peak', 'last_rms')]
    assert told == pytest.approx(figures_of(both), rel=EXACT)
    second = drive_cycles(drive, [MEASURE] * 4, step=0.01)
    assert drive.program_current() == pytest.approx(figures_of(second), rel=EXACT)
    # what was told stays until the window of the second one ends: there is time to read it
    assert told == [float(drive.state[name][0]) for name in ('last_peak', 'last_rms')]


def test_a_lost_mdt_changes_no_mark(robot):
    drive = enabled_drive(robot)
    samples = drive_cycles(drive, [MEASURE] * 5 + [None] + [MEASURE] * 5)
    assert drive.program_current() == pytest.approx(figures_of(samples), rel=EXACT)


def test_the_load_of_the_motor_is_that_of_all_samples_not_of_the_one_in_the_at(robot):
    drive, nominal = enabled_drive(robot), robot.motor.nominal_current_a
    drive.state['overload'] = 1.0
    samples = drive_cycles(drive, [CONTROL_ENABLE] * 12, step=0.3)
    drive_cycles(drive, [CONTROL_ENABLE])  # the load of a cycle is known when the next one begins
    expected = 1.0 + (((samples / nominal) ** 2).mean(axis=1) - 1.0).sum() * 1e-3
    at = 1.0 + ((samples[:, -1] / nominal) ** 2 - 1.0).sum() * 1e-3
    before = float(drive.state['overload'][0])
    # the cycle that ``enabled_drive`` left counts as well
    assert abs(before - expected) < 2e-3
    assert abs(before - at) > 1e-2
