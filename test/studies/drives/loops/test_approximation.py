"""Tests of the continuous approximation of the velocity loop, and of its difference from the drive."""

import math

import numpy as np
import pytest

from delta3_pacdrive.studies.drives.loops.analysis import LOOPS, OperatingPoint, exact_shaft, linear_loop
from delta3_pacdrive.studies.drives.loops.approximation import REST, Piece, steps, velocity_loop
from delta3_pacdrive.studies.drives.loops.load import Load, extremes

SPEED_RAD_S = 10.0
# by hand with the figures of PARAMETERS 1.5: crossover [rad/s], phase margin [deg], gain margin [dB]
OF_PAPER = {0.308: (939.0, 59.0, 11.0), 0.654: (442.0, 71.0, 18.0)}


@pytest.mark.parametrize('inertia', OF_PAPER)
def test_the_approximation_is_that_of_the_parameter_study(inertia, robot):
    operation = OperatingPoint(Load('mode', inertia / 32.0**2), SPEED_RAD_S)
    paper = steps(robot, operation)[0]
    crossover, phase, gain = OF_PAPER[inertia]
    at = int(np.argmin(np.abs(np.abs(paper.loop) - 1.0)))
    assert math.tau * paper.frequencies_hz[at] == pytest.approx(crossover, rel=0.02)
    assert math.degrees(np.angle(paper.loop[at])) + 180.0 == pytest.approx(phase, abs=1.5)
    assert paper.gain_margin_db == pytest.approx(gain, abs=0.5)


def test_the_pieces_add_up_to_the_loop_of_the_drive_and_leave_little(robot):
    operation = OperatingPoint(extremes(robot)[0], SPEED_RAD_S)
    found = steps(robot, operation)
    assert [step.name for step in found] == ['', *(piece.value for piece in Piece), REST]
    assert found[0].gain_margin_db == pytest.approx(11.22, abs=0.02)
    assert [step.gained_db for step in found[1:]] == pytest.approx([0.71, 0.85, 0.10, 0.05, 0.11], abs=0.02)
    exact = linear_loop(LOOPS[1], robot, operation).margins.gain_margin_db
    assert found[-1].gain_margin_db == pytest.approx(exact, abs=1e-12)
    assert sum(step.gained_db for step in found) == pytest.approx(exact - found[0].gain_margin_db)


def test_with_all_pieces_the_loop_is_that_of_the_drive_within_a_tenth_of_a_decibel_up_to_its_crossing(robot):
    operation = OperatingPoint(extremes(robot)[0], SPEED_RAD_S)
    exact = linear_loop(LOOPS[1], robot, operation)
    # slower, the current loop of the drive feels the voltage that its shaft induces
    inside = (exact.frequencies_hz > 300.0) & (exact.frequencies_hz < 600.0)
    shaft = exact_shaft(robot, operation.load, SPEED_RAD_S)
    near = velocity_loop(exact.frequencies_hz, robot, shaft, list(Piece))
    apart = 20.0 * np.log10(np.abs(near / exact.open_loop))[inside]
    assert np.abs(apart).max() < 0.1


def test_removing_an_absent_low_pass_gains_no_margin(robot):
    plain = robot.replace(drive__current_reference_filter_s=0.0)
    assert steps(plain, OperatingPoint(extremes(robot)[0], SPEED_RAD_S))[1].gained_db == 0.0
