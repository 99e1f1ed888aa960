"""Tests of the master's monitor of the drives: states, silence, and stops after faults."""

import numpy as np
import pytest

from delta3_pacdrive.control.cycle.transformation import DISABLE_CYCLES, Transformation
from delta3_pacdrive.numerics.kernel import interpreted
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.buffers import AnswerBuffer
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.losses import CLEARING_CYCLES, Losses, count_telegram, count_telegrams
from delta3_pacdrive.robot.sercos.watchdog import (
    ANSWER_SILENT_S,
    BUS_SILENT_S,
    DRIVE_SILENT_S,
    MASTER_SILENT_S,
    Watchdog,
)
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_MEASURE, CONTROL_ON, Status

FOLLOWS = int(Status.IN_TORQUE | Status.FOLLOWS_COMMAND)


@pytest.fixture
def master(robot):
    result = AxisMonitor(robot)
    result.begin()
    for axis in range(3):
        result.accept(axis, (1.0, 2.0, 3.0), FOLLOWS)
    assert result.check(0, NEVER) is None
    return result


def test_a_lost_answer_is_extrapolated_at_constant_speed_and_counted(master, robot):
    master.extrapolate(1)
    assert master.positions[1] == 1.0 + 2.0 * robot.bus.cycle_time_s
    assert master.losses == [0, 1, 0]
    assert master.check(7, NEVER) is None


def test_two_lost_in_a_row_are_8506_and_two_apart_are_not(master):
    master.extrapolate(2)
    master.accept(2, (1.0, 2.0, 3.0), FOLLOWS)
    master.extrapolate(2)
    assert master.check(9, NEVER) is None
    master.extrapolate(2)
    assert master.check(10, NEVER).fault.sentence == 'axis3: two AT lost in a row in bus cycle 10 (8506)'


def test_error_status_is_reported_once_with_axis_and_cycle(master):
    master.accept(0, (1.0, 2.0, 3.0), FOLLOWS | int(Status.ERROR))
    assert master.check(4, NEVER).fault.sentence == 'axis1 reports a fault in bus cycle 4'
    assert master.faulty() == [0]
    assert master.check(5, NEVER) is None


def test_a_program_needs_torque_from_its_first_cycle_on(master):
    master.accept(1, (1.0, 2.0, 3.0), int(Status.READY_TO_ENABLE))
    assert master.check(99, 100) is None
    assert (
        master.check(100, 100).fault.sentence
        == 'axis2 is not enabled in bus cycle 100, in which a program runs'
    )


def test_an_absent_axis_is_neither_checked_nor_counted(master):
    master.drop(1)
    for cycle in range(5):
        master.extrapolate(1)
        assert master.check(cycle, 0) is None
    assert master.losses[1] == 0
    master.begin()
    assert master.absent == set()


def test_timeouts_let_the_best_informed_participant_decide_first():
    # a drive sees that the master is gone before the plant takes the drive for dead
    assert MASTER_SILENT_S < DRIVE_SILENT_S - 0.5
    # with a dead drive the plant goes on first; then the master knows who is missing before the others miss the master
    assert ANSWER_SILENT_S < MASTER_SILENT_S - 0.25
    assert DRIVE_SILENT_S + ANSWER_SILENT_S < BUS_SILENT_S


def test_a_watch_measures_silence_between_its_looks():
    watch = Watchdog(0.2)
    watch.silence_s(10.0)
    watch.received(10.05)
    assert watch.silence_s(10.2) == pytest.approx(0.15)
    assert watch.silence_s(10.4) == pytest.approx(0.35)


def test_late_poll_proves_little():
    watch = Watchdog(0.2)
    watch.received(10.0)
    assert watch.silence_s(13.0) == pytest.approx(0.4)
    assert watch.silence_s(13.2) == pytest.approx(0.6)


@pytest.mark.parametrize('period_s', [0.04, 0.2])
def test_a_partner_that_is_dead_is_found_by_a_watch_that_is_always_late(period_s):
    watch = Watchdog(period_s)
    watch.received(0.0)
    looks = [watch.silence_s(1.0 * second) for second in range(1, 30)]
    assert looks == sorted(looks)
    assert looks[-1] > 2.0 * BUS_SILENT_S


# the stop ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def task(robot):
    """Return a task that is driving along x from cycle 10 on."""
    result = Transformation(robot)
    tcp = result.locate(np.zeros(3))
    line = program_file.parse(
        {'moves': [{'move_l': {'to_m': {'by_m': [0.0, 0.0, -0.1]}, 'speed_m_s': 0.5}}]}, robot.motion
    )
    result.load(program_planner.plan(line, tcp, robot).plan)
    result.enable(0)
    result.start(10)
    return result


def commands(task, first, last):
    """Return commanded TCP and control words of cycles, without the bits about current figures."""
    places, controls = [], []
    for cycle in range(first, last):
        task.command(cycle)
        places.append(task.state['tcp'][0].copy())
        controls.append(task.control(cycle) & ~CONTROL_MEASURE)
    return np.array(places), controls


def test_stop_starts_at_its_cycle_ends_on_the_path_and_then_disables_torque(task):
    undisturbed, _ = commands(task, 0, 100)
    task.stop_at(120)
    before, controls = commands(task, 100, 120)
    assert not task.held
    assert controls == [CONTROL_ENABLE] * 20
    stopping, controls = commands(task, 120, 400)
    stands = task.end_cycle
    assert 120 < stands < 250
    off = controls.index(CONTROL_ON) + 120
    assert off == stands + DISABLE_CYCLES
    assert set(controls[off - 120 :]) == {CONTROL_ON}
    places = np.vstack([undisturbed, before, stopping])
    assert np.abs(places[:, :2] - places[0, :2]).max() < 1e-9
    assert (places[stands:] == places[stands]).all()
    # downwards until it stands, and nowhere back
    assert (np.diff(places[:, 2]) <= 1e-12).all()
    assert 0.0 < places[0, 2] - places[-1, 2] < 0.1


@pytest.mark.parametrize('cycles', [(300, 150), (150, 300)])
def test_earlier_of_two_stops_is_valid_in_any_order_of_requests(cycles, task):
    for cycle in cycles:
        task.stop_at(cycle)
    commands(task, 0, 160)
    assert task.held
    assert task.profile.cycle == 150


def test_stop_at_rest_only_removes_the_torque(task):
    task.clear_program()
    task.stop_at(20)
    places, controls = commands(task, 0, 100)
    assert (places == places[0]).all()
    assert controls.index(CONTROL_ON) == 20 + DISABLE_CYCLES


def test_a_stop_before_a_program_begins_gives_it_up(task):
    task.stop_at(5)
    places, _ = commands(task, 0, 200)
    assert (places == places[0]).all()
    assert not task.loaded


def test_giving_up_forgets_the_stop_as_well(task):
    task.stop_at(50)
    task.clear()
    task.enable(60)
    _, controls = commands(task, 0, 200)
    assert controls[100] == CONTROL_ENABLE


def test_repeated_requests_do_not_postpone_the_removal_of_torque(task):
    task.stop_at(120)
    commands(task, 0, 121)
    controls = []
    for cycle in range(121, 400):
        task.stop_at(cycle)
        controls += commands(task, cycle, cycle + 1)[1]
    assert controls.index(CONTROL_ON) + 121 == task.end_cycle + DISABLE_CYCLES


def test_stop_cancels_a_pending_return_to_the_plan(task):
    commands(task, 0, 100)
    task.hold()
    commands(task, 100, 400)
    assert task.held
    way_back = resume(task.timeline, 420, 1.0)
    task.change(way_back)
    task.stop_at(405)
    places, controls = commands(task, 400, 900)
    assert (places == places[0]).all()
    assert controls[-1] == CONTROL_ON


def test_a_stop_cancels_an_enabling_that_has_not_begun(robot):
    task = Transformation(robot)
    task.locate(np.zeros(3))
    task.enable(50)
    task.stop_at(10)
    _, controls = commands(task, 0, 200)
    assert set(controls) == {CONTROL_ON}


def test_stop_for_a_lost_axis_is_hard_even_during_another_stop(robot):
    ends = {}
    for kind in ('soft', 'hard', 'soft, then hard'):
        task = Transformation(robot)
        tcp = task.locate(np.zeros(3))
        slow = {'to_m': {'by_m': [0.0, 0.0, -0.1]}, 'speed_m_s': 0.5, 'acceleration_m_s2': 2.0}
        task.load(
            program_planner.plan(
                program_file.parse({'moves': [{'move_l': slow}]}, robot.motion), tcp, robot
            ).plan
        )
        task.enable(0)
        task.start(10)
        commands(task, 0, 190)
        task.stop_at(190, hard=kind == 'hard')
        commands(task, 190, 200)
        if kind == 'soft, then hard':
            task.stop_at(200, hard=True)
        commands(task, 200, 205)
        ends[kind] = task.end_cycle
    assert ends['hard'] < 200
    assert ends['soft, then hard'] < 210
    assert ends['soft'] > 250


def test_ten_answers_lost_one_by_one_in_a_window_are_a_fault_nine_are_not(master):
    said = []
    for cycle in range(40):
        if cycle % 2:
            master.accept(1, [0.0, 0.0, 0.0], FOLLOWS)
        else:
            master.extrapolate(1)
        said.append(master.check(cycle, 10**6))
    assert said[:18] == [None] * 18
    assert said[18].fault.sentence == 'axis2: ten AT lost in a window in bus cycle 18 (8506)'
    master.clear_losses()
    master.accept(1, [0.0, 0.0, 0.0], FOLLOWS)
    assert master.check(40, 10**6) is None


def test_only_answers_in_a_row_make_a_loss_forgotten(master):
    for _ in range(9):
        master.extrapolate(1)
        for _ in range(CLEARING_CYCLES - 1):
            master.accept(1, (1.0, 2.0, 3.0), FOLLOWS)
        assert master.check(7, NEVER) is None
    master.extrapolate(1)
    assert master.check(8, NEVER).fault.sentence == 'axis2: ten AT lost in a window in bus cycle 8 (8506)'


def test_a_loss_is_forgotten_with_a_hundred_good_answers(master):
    for cycle in range(0, 3000, 101):
        master.extrapolate(2)
        assert master.check(cycle, 10**6) is None
        for _ in range(100):
            master.accept(2, [0.0, 0.0, 0.0], FOLLOWS)


@pytest.mark.parametrize(('follows', 'not_following'), [(0, True), (int(Status.FOLLOWS_COMMAND), False)])
def test_faulted_axis_follows_only_with_the_bit_of_its_status(follows, not_following, master):
    master.accept(0, [0.0, 0.0, 0.0], int(Status.ERROR | Status.IN_TORQUE) | follows)
    fault = master.check(7, 10**6)
    assert (fault.fault.sentence, fault.not_following) == (
        'axis1 reports a fault in bus cycle 7',
        not_following,
    )


# buffer ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def buffer():
    result = AnswerBuffer()
    result.begin(100)
    return result


def test_a_cycle_is_complete_when_the_answers_of_all_three_drives_are_there(buffer):
    for index in range(3):
        assert not buffer.is_complete(100)
        assert buffer.behind(100) == list(range(index, 3))
        assert buffer.put(index, 100, f'of {index}')
    assert buffer.is_complete(100)
    assert not buffer.is_complete(101)
    assert buffer.get(100) == ['of 0', 'of 1', 'of 2']
    assert buffer.lost == buffer.repeated == 0


def test_later_at_of_a_drive_marks_earlier_ones_as_lost(buffer):
    buffer.put(0, 102, 'later')
    buffer.put(1, 100, None)
    assert buffer.lost == 3
    assert buffer.expected == [103, 101, 100]
    assert buffer.ahead(100) == 3
    buffer.put(2, 100, 'c')
    assert buffer.get(100) == [None, None, 'c']


def test_the_same_answer_twice_is_counted_and_a_different_one_contradicts(buffer):
    assert buffer.put(0, 100, 'a')
    assert buffer.put(0, 100, 'a')
    assert buffer.repeated == 1
    assert not buffer.put(0, 100, 'another')
    assert buffer.put(0, 99, 'of a cycle that is over')
    for index in (1, 2):
        buffer.put(index, 100, 'b')
    assert buffer.get(100)[0] == 'a'


def test_removed_axis_is_not_waited_for(buffer):
    for index in (0, 2):
        buffer.put(index, 100, 'x')
    buffer.drop(1)
    assert buffer.is_complete(100)
    assert buffer.get(100) == ['x', None, 'x']
    assert buffer.ahead(100) == 1
    assert buffer.lost == 0


@pytest.mark.parametrize('telegrams', [0, 1, 99, 100, 101, 250, 1003])
@pytest.mark.parametrize('good', [0, 1, 99])
def test_many_answers_count_as_they_would_one_by_one(telegrams, good):
    at_once, one_by_one = Losses(1, 5, good), Losses(1, 5, good)
    count_telegrams(at_once, telegrams)
    for _ in range(telegrams):
        interpreted(count_telegram)(one_by_one)
    assert at_once == one_by_one


def test_answers_of_many_cycles_have_the_effect_of_the_last_one(master):
    answers = np.arange(9.0).reshape(3, 3)
    master.accept_cycles(7, answers, [FOLLOWS, FOLLOWS, 0])
    assert master.positions.tolist() == [0.0, 1.0, 2.0]
    assert master.speeds == [3.0, 4.0, 5.0]
    assert master.torques.tolist() == [6.0, 7.0, 8.0]
    assert not master.is_checked(master.status)
    master.check(7, NEVER)
    assert master.is_checked(master.status)
