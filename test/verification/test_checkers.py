"""Tests of the checkers: each reports a broken robot and passes a sound one."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('sensor_msgs', reason='the checkers read ROS messages')

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import Code, FaultCode, Reason, RefusedError, RobotFault, RunError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.verification.fault_catalogue.cases import Case, Outcome, State, cases
from delta3_pacdrive.verification.fault_catalogue.observer import judge_reference
from delta3_pacdrive.verification.fault_catalogue.signatures import (
    AxisRecord,
    burdened,
    coupling_of_arms,
    loaded,
    misread,
    sagged,
)
from delta3_pacdrive.verification.invariants import Growth, Invariants, growth_of
from delta3_pacdrive.verification.operator import AutomatedOperator
from delta3_pacdrive.verification.soak.runner import Figures, Violation
from delta3_pacdrive.verification.telegram_log import AT, MDT, SHAFTS, Telegrams

GEAR = 32.0
HOME = (0.0, 0.0, -0.75)
AWAY = (0.2, 0.0, -0.75)
CYCLES = 200
SESSION = b'3fa9'
I_PEAK_N_M = 17.0 * 0.78
RPM_MAX = 6000.0 * math.tau / 60.0


def telegrams(values, first=100, session=SESSION):
    values = np.asarray(values, dtype=np.float64)
    cycles = np.arange(first, first + len(values))
    return Telegrams(cycles, [session] * len(values), cycles - first + 1, cycles * 1e-3, values)


def shafts_at(points, robot, speed=0.0):
    """Return the nine shaft values for TCP positions (n, 3)."""
    theta = kinematics.inverse(points, robot.kinematics) * GEAR
    return np.column_stack([theta, np.full_like(theta, speed), np.zeros_like(theta)])


def line(robot):
    """Return a smooth way from home to the other end, in cycles."""
    share = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, CYCLES))
    return np.array(HOME) + share[:, None] * (np.array(AWAY) - np.array(HOME))


def sound(robot):
    """Return the telegrams of an undisturbed program that is driven without an error."""
    points = line(robot)
    commands = kinematics.inverse(points, robot.kinematics) * GEAR
    # the shafts are where the commands were 1.75 cycles before
    cycles = np.arange(CYCLES)
    theta = np.column_stack([np.interp(cycles - 1.75, cycles, axis) for axis in commands.T])
    shafts = np.column_stack([theta, np.gradient(theta, 1e-3, axis=0), np.zeros_like(theta)])
    shafts[-3:, :3] = commands[-1]
    commands[-3:] = commands[-1]
    at = np.column_stack([theta[:, 0], np.zeros(CYCLES), np.full(CYCLES, 0.3)])
    return {SHAFTS: telegrams(shafts), MDT: telegrams(commands), **{topic: telegrams(at) for topic in AT}}


@pytest.fixture
def said():
    return []


@pytest.fixture
def invariants(robot, said):
    return Invariants(robot, lambda sentence, cycle: said.append((sentence, cycle)))


def changed(one, row, column, value):
    values = one.values.copy()
    values[row, column] = value
    return replace(one, values=values)


# soak: what must always hold


def test_a_sound_robot_violates_nothing(invariants, said, robot):
    for topic, one in sound(robot).items():
        invariants.check(topic, one)
    error, end = invariants.check_undisturbed(sound(robot), AWAY)
    assert said == []
    assert error < 2e-4  # where the last commands are held
    assert end < 1e-9


@pytest.mark.parametrize(
    ('cycles', 'violated'),
    [
        ([100, 101, 101], 'bus cycle 101 after 101'),
        ([100, 101, 100], 'bus cycle 100 after 101'),
        ([100, 101, 103], 'bus cycle 103 after 101'),
    ],
)
def test_stopped_reversed_or_jumping_bus_time_is_a_violation(cycles, violated, invariants, said, robot):
    one = telegrams(shafts_at([HOME] * 3, robot))
    invariants.check(SHAFTS, replace(one, cycles=np.array(cycles)))
    assert said == [(f'{SHAFTS}: {violated}', cycles[-1])]


@pytest.mark.parametrize(
    ('cycles', 'numbers', 'unseen', 'violations'),
    [
        ([100, 101, 103], [7, 8, 10], 1, 0),  # what was published between them has not come
        ([100, 101, 803], [7, 8, 710], 701, 0),
        ([100, 101, 104], [7, 8, 10], 1, 1),  # and bus time has jumped meanwhile
        ([100, 101, 102], [7, 8, 10], 1, 1),  # or stood
        ([100, 101, 103], [7, 8, 1], 0, 1),  # a sender that began anew is none that was not heard
    ],
)
def test_messages_missed_by_the_reader_are_counted_and_not_violations(
    cycles, numbers, unseen, violations, invariants, said, robot
):
    one = telegrams(shafts_at([HOME] * 3, robot))
    invariants.check(SHAFTS, replace(one, cycles=np.array(cycles), numbers=np.array(numbers)))
    assert invariants.unseen == dict.fromkeys([SHAFTS, MDT, *AT], 0) | {SHAFTS: unseen}
    assert len(said) == violations


def test_bus_time_may_jump_only_where_the_bus_was_phased_up(invariants, said, robot):
    rows = shafts_at([HOME] * 2, robot)
    invariants.check(SHAFTS, telegrams(rows, 100))
    invariants.check(SHAFTS, telegrams(rows, 500, b'0001'))
    assert said == []
    invariants.check(SHAFTS, telegrams(rows, 503, b'0001'))
    assert [sentence for sentence, _ in said] == [f'{SHAFTS}: bus cycle 503 after 501']
    invariants.check(SHAFTS, telegrams(rows, 300, b'0002'))
    assert len(said) == 2  # never back, whoever counts


@pytest.mark.parametrize(
    ('column', 'value', 'what'),
    [
        (0, math.radians(108.5) * GEAR, 'an arm is at'),  # 3 degrees into the end stop at 105
        (2, math.radians(-58.5) * GEAR, 'an arm is at'),
        (4, 1.02 * 1.1 * 1.5 * RPM_MAX, 'a shaft turns at'),  # what an encoder would take for implausible
        (5, -1.02 * 1.1 * 1.5 * RPM_MAX, 'a shaft turns at'),
        (1, math.nan, 'an arm is at'),
    ],
)
def test_a_shaft_beyond_what_is_physically_possible_is_a_violation(
    column, value, what, invariants, said, robot
):
    one = telegrams(shafts_at([HOME] * 10, robot))
    invariants.check(SHAFTS, one)
    assert said == []
    invariants.check(SHAFTS, changed(telegrams(one.values, 110), 7, column, value))
    ((sentence, cycle),) = said
    assert sentence.startswith(what)
    assert cycle == 117


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_torque_beyond_that_of_a_blocking_end_stage_is_a_violation(sign, invariants, said):
    at = np.column_stack([np.zeros(5), np.zeros(5), np.full(5, sign * 1.29 * I_PEAK_N_M)])
    invariants.check(AT[1], telegrams(at))
    assert said == []
    at[3, 2] = sign * 1.31 * I_PEAK_N_M
    invariants.check(AT[1], telegrams(at, 105))
    assert [cycle for _, cycle in said] == [108]
    assert said[0][0].startswith(f'{AT[1]}: torque')


@pytest.mark.parametrize(
    ('point', 'what'),
    [
        ((0.602, 0.0, -0.8), 'the TCP is commanded to a radius of'),
        ((0.0, 0.0, -0.698), 'the TCP is commanded to z'),
        ((0.0, 0.0, -0.952), 'the TCP is commanded to z'),
    ],
)
def test_a_command_out_of_the_workspace_is_a_violation(point, what, invariants, said, robot):
    commands = kinematics.inverse([HOME, HOME, point, HOME], robot.kinematics) * GEAR
    invariants.check(MDT, telegrams(commands))
    ((sentence, cycle),) = said
    assert sentence.startswith(what)
    assert cycle == 102


# soak: what holds while nothing disturbs


@pytest.mark.parametrize(
    ('topic', 'column', 'value', 'what'),
    [
        (SHAFTS, 1, math.radians(96.0) * GEAR, 'an arm is at'),  # half a degree beyond 95
        (SHAFTS, 4, 1.01 * RPM_MAX, 'a shaft turns at'),
        (AT[2], 2, 1.01 * I_PEAK_N_M, f'{AT[2]}: torque'),
    ],
)
def test_an_undisturbed_program_keeps_the_nominal_limits(topic, column, value, what, invariants, said, robot):
    recorded = sound(robot)
    recorded[topic] = changed(recorded[topic], 50, column, value)
    invariants.check_undisturbed(recorded, AWAY)
    assert any(sentence.startswith(what) and cycle == 150 for sentence, cycle in said), said


def test_motion_of_a_hard_stop_is_allowed(invariants, said, robot):
    one = telegrams(shafts_at([HOME] * 5, robot))
    invariants.check(SHAFTS, changed(one, 3, 0, math.radians(107.9) * GEAR))  # leans on its end stop
    edge = (0.6005, 0.0, -0.8)  # a stop that ends outside its workspace
    commands = kinematics.inverse([HOME, edge, (0.0, 0.0, -0.6995)], robot.kinematics) * GEAR
    invariants.check(MDT, telegrams(commands))
    assert said == []


def test_shafts_without_received_commands_may_be_anywhere(invariants, said, robot):
    recorded = sound(robot)
    late = recorded[MDT]
    recorded[MDT] = Telegrams(
        late.cycles[100:], late.frames[100:], late.numbers[100:], late.received_s[100:], late.values[100:]
    )
    error, _ = invariants.check_undisturbed(recorded, AWAY)
    assert said == []
    assert error < 2e-4


def test_an_undisturbed_program_keeps_to_its_commands(invariants, said, robot):
    recorded = sound(robot)
    off = recorded[SHAFTS].values[80, 0] + 2e-3 / 0.4 * GEAR  # 2 mm at the elbow
    recorded[SHAFTS] = changed(recorded[SHAFTS], 80, 0, off)
    error, _ = invariants.check_undisturbed(recorded, AWAY)
    ((sentence, cycle),) = said
    assert re_number(sentence, 'the true TCP is {} mm from its command') == pytest.approx(
        error * 1e3, abs=1e-3
    )
    assert error > 1.5e-3
    assert cycle == 180


def test_an_undisturbed_program_ends_where_it_should(invariants, said, robot):
    _, off = invariants.check_undisturbed(sound(robot), (0.2, 0.0, -0.75002))
    assert off == pytest.approx(2e-5, rel=1e-3)
    ((sentence, _),) = said
    assert re_number(sentence, 'the program ends {} mm off') == pytest.approx(0.02, rel=1e-2)


def re_number(sentence, form):
    before, after = form.split('{}')
    assert sentence.startswith(before), sentence
    assert sentence.endswith(after), sentence
    return float(sentence[len(before) : len(sentence) - len(after)])


@pytest.mark.parametrize(
    ('lost', 'injected', 'complete', 'violated'),
    [
        (0, 0, True, False),
        (3, 3, True, False),
        (4, 3, True, True),
        (4, 3, False, True),
        (2, 3, True, True),
        (2, 3, False, False),
    ],
)
def test_losses_are_those_that_were_injected(lost, injected, complete, violated, invariants, said):
    invariants.check_losses('AT', lost, injected, complete, 7)
    assert said == ([(f'AT: {lost} lost, {injected} were injected', 7)] if violated else [])


@pytest.mark.parametrize(
    ('slope', 'half_width', 'cycles', 'violated'),
    [
        (5.0, 0.0, 100_000, False),
        (5.01, 0.0, 100_000, True),
        (5.9, 1.0, 100_000, False),
        (5.9, 0.89, 100_000, True),
        (50.0, 0.0, 99_999, False),
        (50.0, float('inf'), 200_000, False),
    ],
)
def test_memory_grows_too_fast_when_the_whole_interval_exceeds_5_mb_in_100_000_cycles(
    slope, half_width, cycles, violated, invariants, said
):
    invariants.check_memory(Growth(slope, half_width, cycles), 3)
    assert bool(said) == violated


def test_growth_of_memory_is_that_of_a_line_despite_single_samples():
    chance = np.random.default_rng(7)
    cycles = np.arange(0, 400_000, 2_000)
    for slope in (0.0, 3.0, 8.0):
        noise = np.repeat(chance.normal(0.0, 0.5, 40), 5)  # memory grows in steps
        growth = growth_of(cycles.tolist(), (500.0 + slope * cycles / 1e5 + noise).tolist())
        assert abs(growth.slope_mb - slope) < growth.half_width_mb < 1.0
        assert growth.cycles == 398_000


def test_too_few_samples_do_not_judge_the_growth_of_memory():
    assert growth_of([], []).cycles == 0
    assert growth_of(list(range(15)), [1.0] * 15).cycles == 0
    assert growth_of([7] * 20, [1.0] * 20).cycles == 0
    assert growth_of(list(range(16)), [1.0] * 16).cycles == 15


def test_soak_checks_every_telegram_against_the_invariants(robot):
    figures = Figures(programs=1)

    def violate(sentence, cycle):
        figures.violations.append(Violation(sentence, 1, 'real', 1, cycle, ''))

    taken = sound(robot)
    Invariants(robot, violate).check_all(taken)
    assert figures.violations == []
    assert figures.ok
    broken = taken | {AT[0]: changed(taken[AT[0]], 20, 2, 99.0)}
    Invariants(robot, violate).check_all(broken)
    assert [violation.cycle for violation in figures.violations] == [120]
    assert not figures.ok


def test_soak_is_ok_if_programs_ran_invariants_held_and_every_fault_was_survived():
    good = Figures(programs=3, injected=2, survived=2)
    assert good.ok
    assert not replace(good, programs=0).ok
    assert not replace(good, survived=1).ok
    assert not replace(good, violations=[Violation('x', 1, 'real', 1, 1, '')]).ok
    assert replace(good, cycles=1000, unseen=100).ok
    assert not replace(good, cycles=1000, unseen=101).ok  # nobody has looked


# catalogue: evidence

QUIET = 400


def record(**changes):
    """Return an axis that holds a small load, torque like coupling, without errors."""
    load = np.full(QUIET, 0.3)
    fields = {
        'read': np.zeros(QUIET),
        'torque': load,
        'position': np.zeros(QUIET),
        'speed': np.zeros(QUIET),
        'coupling': load,
    }
    return AxisRecord(**fields | changes)


def test_evidence_is_empty_for_a_sound_axis():
    for evidence in (misread, sagged, burdened, loaded):
        assert evidence(record()) == '', evidence.__name__
    # a shaft that its motor turns does not sag; one that hangs in its brake without torque stands
    moving = record(speed=np.full(QUIET, 30.0))
    assert sagged(moving) == ''
    assert sagged(record(torque=np.zeros(QUIET), speed=np.full(QUIET, 0.4))) == ''
    assert misread(record(read=np.full(QUIET, 0.9e-4))) == ''
    assert burdened(record(torque=np.full(QUIET, 1.2))) == ''
    assert loaded(record(coupling=np.full(QUIET, -0.9))) == ''


def test_evidence_names_deviation_and_amount():
    assert misread(record(read=np.linspace(0.0, -0.05, QUIET))) == 'reads up to 0.0500 rad wrong'
    falls = record(torque=np.zeros(QUIET), speed=np.linspace(0.0, -3.0, QUIET))
    assert sagged(falls) == 'turns at 3.0 rad/s under its brake'
    assert burdened(record(torque=np.full(QUIET, -2.5))) == 'needs 2.80 N m more than its load'
    assert loaded(record(coupling=np.full(QUIET, -1.75))) == 'carries 1.75 N m'


def test_evidence_of_a_load_needs_more_than_a_single_cycle():
    spike = np.full(QUIET, 0.3)
    spike[100] = 5.0
    assert burdened(record(torque=spike)) == ''
    assert loaded(record(coupling=spike)) == ''
    # a load that the brake holds, without torque, burdens no motor
    assert burdened(record(torque=np.zeros(QUIET), coupling=np.full(QUIET, 2.0))) == ''


def test_evidence_counts_from_the_fault_on():
    shafts, answers = np.zeros((10, 9)), np.zeros((10, 3))
    answers[:5, 0] = 1.0  # before the fault
    answers[5:, 2] = 0.5
    shafts[:, 7] = np.arange(10)
    found = AxisRecord.of({SHAFTS: telegrams(shafts), AT[1]: telegrams(answers, 98)}, 1, 103)
    # answers of cycles 98 to 107, shafts of 100 to 109: known together from 103 to 107
    assert found.coupling.tolist() == [3.0, 4.0, 5.0, 6.0, 7.0]
    assert found.torque.tolist() == [0.5] * 5
    assert misread(found) == ''


# catalogue: what became of a case

EXPECTED = Case({'fault': 'encoder_failure', 'axis': 'axis2'}, State.MOVING, '8171')
HARMLESS = Case({'fault': 'drop_mdt', 'axis': 'axis2'}, State.MOVING)
TOLD = RobotFault(
    FaultCode.DRIVE,
    'axis2 reports a fault in bus cycle 7: 8171 encoder unreadable (class 3, reaction AD)',
    'axis2',
    8171,
    7,
)


@pytest.mark.parametrize(
    ('outcome', 'expected'),
    [
        (Outcome(EXPECTED, reported=TOLD, recovered_s=1.0), True),
        (Outcome(EXPECTED, reported=TOLD), False),  # not overcome
        (Outcome(EXPECTED, reported=replace(TOLD, number=8905), recovered_s=1.0), False),
        (Outcome(EXPECTED, evidence='reads wrong', recovered_s=1.0), False),  # nothing was reported
        (Outcome(EXPECTED, reported=TOLD, recovered_s=1.0, problem='the fault missed the stop'), False),
        (Outcome(HARMLESS, evidence='1 lost', recovered_s=1.0), True),
        (Outcome(HARMLESS, recovered_s=1.0), False),  # nobody has seen it
        (Outcome(HARMLESS, reported=TOLD, evidence='1 lost', recovered_s=1.0), False),
    ],
)
def test_a_case_is_as_expected_if_it_led_to_that_was_seen_and_was_overcome(outcome, expected):
    assert outcome.as_expected is expected
    assert outcome.to_row()['ok'] is expected


def test_catalogue_gives_the_outcome_of_each_fault_in_each_state():
    every = {case.line: case for case in cases()}
    assert every['kill unit_robot moving'].expected == 'unit_robot'
    assert every['kill unit_robot standing'].expected == ''
    assert every['freeze axis1 0.2 starting'].expected == '8506'
    assert every['kill transformation_task starting'].expected == ''
    assert {case.expected for case in every.values() if case.state == State.STOPPED_BY_FAULT} == {
        FaultCode.EMERGENCY_STOP,
        '8506',
    }
    assert every['encoder_failure axis2 moving'].lasts
    assert not every['brake_worn axis1 1 for 0.1 s moving'].lasts
    assert not every['drop_mdt axis1 moving'].lasts
    assert not every['payload_lost moving'].lasts
    chosen = cases(only='held')
    assert chosen
    assert {case.state for case in chosen} == {State.HELD}


def test_a_robot_with_a_rotary_axis_has_the_cases_of_its_drive_as_well():
    with_axis, without = cases(rotary=['axis4']), cases()
    assert with_axis[: len(without)] == without
    of_tool = with_axis[len(without) :]
    assert {case.target for case in of_tool} == {'axis4'}
    assert len({case.line for case in with_axis}) == len(with_axis)
    tried = {(case.kind, case.state) for case in of_tool}
    kinds = {'drop_mdt', 'drop_at', 'encoder_failure', 'encoder_jump', 'encoder_drift', 'winding_short', 'dc_link',
             'brake_stuck', 'overload', 'freeze', 'kill'}  # fmt: skip
    assert tried >= {(kind, state) for kind in kinds for state in State if state != State.STARTING}
    assert {'8111', '8902', '8905', '8171', '8112', '8506', '8909', '8910', 'axis4'} <= {
        case.expected for case in of_tool
    }
    assert 'winding_short axis4 moving' in [case.line for case in cases(short=True, rotary=['axis4'])]
    with pytest.raises(
        RunError, match=r"contains the text 'axis4': the robot has no axis4 .* \(rotary.present"
    ):
        cases(only='axis4')


def test_a_second_rotary_axis_has_the_cases_of_the_first():
    one, two = ({case.line for case in cases(rotary=axes)} for axes in (['axis4'], ['axis4', 'axis5']))
    assert two - one == {line.replace('axis4', 'axis5') for line in one if 'axis4' in line}
    assert 'drop_at axis5 x2 held' in [case.line for case in cases(short=True, rotary=['axis4', 'axis5'])]
    with pytest.raises(
        RunError, match=r"contains the text 'axis5': the robot has no axis5 .* \(rotary_2.present"
    ):
        cases(only='axis5', rotary=['axis4'])


def test_the_record_of_a_fourth_axis_is_its_own():
    shafts, answers = np.zeros((10, 12)), np.zeros((10, 3))
    shafts[:] = 10.0 * np.arange(12)
    answers[:, 0], answers[:, 2] = 30.0, 0.5
    found = AxisRecord.of({SHAFTS: telegrams(shafts), 'sercos/at/axis4': telegrams(answers)}, 3, 100)
    assert misread(found) == ''
    assert (set(found.speed), set(found.coupling)) == ({70.0}, {110.0})
    assert coupling_of_arms(shafts)[0].tolist() == [80.0, 90.0, 100.0]
    assert coupling_of_arms(shafts[:, :9])[0].tolist() == [60.0, 70.0, 80.0]
    # a small motor has small loads
    light = replace(found, coupling=np.full(10, 0.6))
    assert loaded(light) == 'carries 0.60 N m'
    assert loaded(record(coupling=np.full(10, 0.6))) == ''


class Operated(AutomatedOperator):
    """An operator of a simulated robot."""

    progress = MotionProgress(in_torque=True)

    def __init__(self, state, fault, in_torque):
        self.operator = SimpleNamespace(state=state)
        self.progress = MotionProgress(fault=fault, in_torque=in_torque)


@pytest.mark.parametrize(
    ('state', 'fault', 'in_torque', 'stands'),
    [
        ('idle', '', True, True),
        ('stopped', '', True, True),
        ('moving', '', True, False),
        ('stopping', '', True, False),
        ('error', '8171', True, False),
        ('error', '8171', False, True),
    ],
)
def test_robot_without_motion_is_at_rest(state, fault, in_torque, stands):
    assert Operated(state, fault, in_torque).is_at_rest() is stands


def told_to_start(*answers):
    """Return an operator of an idle robot with these replies of the planner, and its requests."""
    one, asked, left = Operated('idle', '', True), [], list(answers)

    def call(name):
        asked.append(name)
        if name == 'start' and (code := left.pop(0)) is not None:
            raise RefusedError(Reason(code, 'not now'))
        one.operator.state_changes += 1

    one.operator = SimpleNamespace(
        state='idle', state_changes=0, call=call, send_program=lambda _: '', wait_until=lambda *_: None
    )
    return one, asked


def test_planner_that_has_hung_is_queried_until_it_is_accepted(monkeypatch):
    monkeypatch.setattr(Operated, 'fresh', lambda self: self.progress)
    one, asked = told_to_start(Code.BUS, Code.BUS, None)
    one.drive([{'dwell': {'time_s': 0.1}}])
    assert asked == ['start'] * 3


def test_a_program_that_may_not_start_does_not_wait_before_the_next_one(monkeypatch):
    monkeypatch.setattr(Operated, 'fresh', lambda self: self.progress)
    one, asked = told_to_start(Code.STATE)
    with pytest.raises(RefusedError):
        one.drive([{'dwell': {'time_s': 0.1}}])
    assert asked == ['start', 'clear']
    one, asked = told_to_start(Code.BUS)
    one.progress = MotionProgress(fault='axis1 silent', in_torque=True)
    with pytest.raises(RefusedError):
        one.drive([{'dwell': {'time_s': 0.1}}])
    assert asked == ['start', 'clear']


def test_the_reference_move_after_a_recovery_is_judged(robot):
    home, away = np.array(HOME), np.array(AWAY)
    way = line(robot)
    way = np.vstack([way, way[::-1]])
    assert judge_reference(way, home, away, '') < 1e-12
    beside = way.copy()
    beside[100, 2] += 0.15e-3
    assert judge_reference(beside, home, away, '') == pytest.approx(0.15e-3, rel=1e-6)
    beside[100, 2] += 0.1e-3
    with pytest.raises(RunError, match=r'is 0\.250 mm off its line'):
        judge_reference(beside, home, away, '')
    short = way[:-1] + (way[-1] - way[-2])
    short[-1] = (4e-5, 0.0, -0.75)
    with pytest.raises(RunError, match=r'ends 0\.040 mm off'):
        judge_reference(short, home, away, '')
    with pytest.raises(RunError, match='ended with a fault: 8111'):
        judge_reference(way, home, away, '8111')
