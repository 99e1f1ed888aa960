"""Tests of the meeting of robot and part on a belt: time, place, method and rejected meetings."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.belts.meeting import (
    AHEAD_S,
    BeltAxes,
    Meeting,
    Work,
    first_moved_s,
    meet,
    offset_on,
    require_feasible,
)
from delta3_pacdrive.belts.synchronization import ZERO, Miss, MissReason, Motion, TrackLimits, TrackWindow
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program.model import Dwell, MoveL, Program, Target
from delta3_pacdrive.planning.program_planner import plan

LIMITS = TrackLimits(4.0, 60.0, 8000.0)
WINDOW = TrackWindow(0.4, 1.0)
REFERENCE_M = 0.7
WORK = Work(first_s=0.2, whole_s=0.4)
STANDS = Motion(ZERO)


def met(part_m, speed, work=WORK, offset=STANDS):
    return meet(part_m, speed, offset, work, REFERENCE_M, WINDOW, LIMITS)


def test_part_in_the_window_is_met_at_the_end_of_the_first_move():
    found = met(0.5, 0.5)
    assert isinstance(found, Meeting)
    assert found.wait_s == 0.0
    lasts = max(found.way.duration_s + AHEAD_S, WORK.first_s)
    assert found.pad_s == pytest.approx(lasts - WORK.first_s)
    assert found.met_m == pytest.approx(0.5 + 0.5 * lasts)
    assert found.done_m == pytest.approx(found.met_m + 0.5 * (WORK.whole_s - WORK.first_s))


def test_a_plan_that_is_too_quick_begins_later_so_that_the_robot_is_on_the_belt_before():
    found = met(0.3, 1.0, Work(0.05, 0.1))
    assert found.pad_s == pytest.approx(found.way.duration_s + AHEAD_S - 0.05)


@pytest.mark.parametrize('speed', [0.1, 0.7, 1.4])
def test_arriving_part_is_met_at_the_beginning_of_the_window(speed):
    found = met(-0.5, speed)
    assert found.wait_s > 0.0
    assert found.met_m == pytest.approx(WINDOW.begin_m, abs=1e-6)


def test_belt_offset_starts_from_the_previous_motion_and_ends_with_the_part():
    before = Motion((0.05, -0.02, 0.01), (0.3, 0.0, 0.0))
    found = met(0.5, 0.8, offset=before)
    at_first = offset_on(found, 0.0, REFERENCE_M)
    assert at_first.place == pytest.approx(before.place, abs=1e-12)
    assert at_first.velocity == pytest.approx(before.velocity, abs=1e-12)
    lasts = found.way.duration_s
    assert offset_on(found, lasts, REFERENCE_M).place == pytest.approx(
        (0.5 + 0.8 * lasts - REFERENCE_M, 0, 0)
    )
    assert offset_on(found, lasts, REFERENCE_M).velocity == pytest.approx((0.8, 0.0, 0.0))


REFUSED = {
    MissReason.GONE: (0.9, 1.0, 'the window ends at 1000.0 mm'),
    MissReason.NOT_COMING: (0.2, 0.0, 'the belt is at rest with the part at 200.0 mm'),
    MissReason.BACKWARDS: (0.5, -0.2, 'the belt runs backwards, at 0.2 m/s'),
    MissReason.TOO_FAST: (0.5, 4.0, 'the belt runs at 4 m/s, the robot at 4 m/s at most'),
}


@pytest.mark.parametrize('reason', REFUSED)
def test_infeasible_meeting_is_rejected_before_motion(reason):
    place, speed, sentence = REFUSED[reason]
    found = met(place, speed)
    assert isinstance(found, Miss)
    assert found.reason is reason
    assert sentence in found.sentence


def test_part_beyond_the_window_is_lost_for_any_belt_motion():
    assert met(1.1, 0.0).sentence == 'the part is at 1100.0 mm, the window ends at 1000.0 mm'


def test_the_last_part_that_can_be_met_is_done_at_the_end_of_the_window():
    low, high = 0.4, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if isinstance(met(middle, 0.5), Meeting) else (low, middle)
    assert met(low, 0.5).done_m == pytest.approx(WINDOW.end_m, abs=1e-6)


def test_part_on_a_belt_at_rest_in_the_window_is_met_in_place():
    found = met(0.7, 0.0)
    assert (found.met_m, found.done_m, found.wait_s) == (0.7, 0.7, 0.0)


def test_positions_on_a_belt_and_its_axes_convert_to_base_and_back():
    belt = BeltAxes('line', (0.1, 0.2, -0.8), math.pi / 2.0, 1e5)
    assert belt.place_m(0.3, 0.1) == pytest.approx((0.0, 0.5, -0.8))
    motion = Motion((0.1, 0.2, 0.3), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert np.allclose(belt.of_base(belt.to_base(motion)), motion)


@pytest.fixture(scope='module')
def robot():
    return parameters.load(parameters.MODEL_CONTROLLER)


def planned(robot, *to, dwell_s=0.1):
    limits = Limits(2.0, 20.0, 2000.0)
    moves = (Dwell(dwell_s), *(MoveL(limits=limits, to=Target(place)) for place in to))
    return plan(Program('work', moves), (0.0, 0.0, -0.8), robot).plan


def test_first_tracking_move_with_length_synchronizes(robot):
    work = planned(robot, (0.1, 0.0, -0.8), (0.1, 0.0, -0.85))
    assert first_moved_s(work) == pytest.approx(float(work.tables.starts[2]))
    assert 0.1 < first_moved_s(work) < work.duration_s


def test_a_plan_that_is_carried_out_of_the_workspace_is_rejected_with_the_instant(robot):
    work = planned(robot, (0.3, 0.0, -0.8))
    with pytest.raises(
        ProgramError, match=r'the distance from the z axis is .* s after its start on the belt'
    ):
        require_feasible(work, 0.0, work.duration_s, lambda _: Motion((0.4, 0.0, 0.0)), robot, 1.0)


def test_plan_that_overloads_a_motor_only_with_the_belt_is_rejected(robot):
    work = planned(robot, (0.2, 0.0, -0.8))
    end = work.duration_s
    require_feasible(work, 0.0, end, lambda _: STANDS, robot, 1.0)
    with pytest.raises(ProgramError, match=r'of motor \d would be .* the limit is'):
        require_feasible(work, 0.0, end, lambda _: Motion(ZERO, (12.0, 0.0, 0.0)), robot, 1.0)
