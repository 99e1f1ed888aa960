"""Tests of the linear model of the loops with both fine interpolations against the drive."""

import math

import numpy as np
import pytest

from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.studies.drives.loops.loops import Entry, Shaft, linear_cascade

HELD = Shaft(math.inf, 0.0, 250e-6)  # the shaft does not turn
STEP_RAD = 0.01
CYCLES, WAIT = 8, 60


@pytest.mark.parametrize('cycle_s', [1e-3, 2e-3, 4e-3])
@pytest.mark.parametrize('interpolation', ['linear', 'cubic'])
@pytest.mark.parametrize('timing', ['thesis', 'sercos2'])
def test_the_answer_to_one_command_is_that_of_the_drive(timing, interpolation, cycle_s, robot):
    own = robot.replace(
        bus__timing=timing,
        bus__cycle_time_s=cycle_s,
        bus__exchange_period_s=250e-6,
        drive__interpolation=interpolation,
        drive__following_error_limit_rad=100.0,
    )
    drive, found = MC4(own), []
    for cycle in range(WAIT + CYCLES):
        drive.begin_cycle(STEP_RAD if cycle == WAIT else 0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        for _ in range(round(cycle_s / 250e-6)):
            drive.run_period(0.0, 0.0, 0.0)
            if cycle >= WAIT:
                found.append(float(drive.state['speed_reference'][0]))
    cascade, steps = linear_cascade(own, HELD, Entry.COMMAND), round(cycle_s / own.drive.current_period_s)
    told = np.zeros(CYCLES * steps)
    told[:steps] = STEP_RAD  # the MDT of a single cycle
    answer = cascade.run(told)[:, cascade.outputs.index('speed_reference')]
    # at the end of every period of the position loop
    np.testing.assert_allclose(answer[3::4], found, atol=1e-9)
