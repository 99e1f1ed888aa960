"""Tests of a load step in loops that exchange values with their plant at intervals."""

import pytest

from delta3_pacdrive.studies.drives.loops.analysis import exact_shaft, exchanged_shaft
from delta3_pacdrive.studies.drives.loops.disturbance import rejection
from delta3_pacdrive.studies.drives.loops.load import load_at


def test_drive_with_one_plant_exchange_per_cycle_bears_a_load_nearly_as_well(robot):
    here = load_at(robot.motion.home_m, 0, robot)
    always, seldom = (rejection(robot, shaft(robot, here, 10.0)) for shaft in (exact_shaft, exchanged_shaft))
    assert seldom.peak_rad == pytest.approx(always.peak_rad, rel=0.05)
    assert seldom.back_s == pytest.approx(always.back_s, rel=0.1)
