"""Tests of the transformation task (thesis 6, 7.3): commands on path and grid, following error, cycles."""

import itertools
import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.curves import line
from delta3_pacdrive.planning.paths.move import OUTPUTS, Move, MoveKind
from delta3_pacdrive.planning.paths.virtual_master import plan_master
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.robot.sercos.bus_time import HISTORY, NEVER
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_MEASURE, CONTROL_ON, CONTROL_PROGRAM

GEAR, K_M, CYCLE_S = 32.0, 0.78, 1e-3
INCREMENT_RAD = math.tau / 2**19
# half an increment of three arms through J, whose largest singular value is 2.18 l_A in the workspace
GRID_M = math.sqrt(3.0) * 0.5 * INCREMENT_RAD / GEAR * 2.18 * 0.4
SPEED = 1e-3  # relative, on the cruise
ROUNDING = 1e-12
START, END = (0.0, 0.0, -0.75), (0.3, 0.1, -0.85)


def ready_task(robot, end=END, **limits):
    """Return a task at rest at ``START`` on the grid, with one line to ``end`` loaded, and its plan."""
    task = Transformation(robot)
    theta = kinematics.inverse(START, robot.kinematics)
    motors = np.round(theta * GEAR / INCREMENT_RAD) * INCREMENT_RAD
    tcp = task.locate(motors)
    document = {'moves': [{'move_l': {'to_m': list(end), **limits}}]}
    plan = program_planner.plan(programs.parse(document, robot.motion), tcp, robot).plan
    task.load(plan)
    return task, plan, motors


def tcp_of(motors, robot):
    return kinematics.forward(np.asarray(motors) / GEAR, robot.kinematics)


def commands_of(task, cycles):
    return np.array([task.command(k).motors.copy() for k in range(cycles)])


def test_command_before_the_start_equals_the_motor_positions_to_the_last_bit(robot):
    task, _, motors = ready_task(robot)
    task.start(50)
    assert np.abs(commands_of(task, 50) - motors).max() == pytest.approx(0.0, abs=1e-15 * GEAR)


def test_commands_lie_on_the_increment_grid(robot):
    task, _, _ = ready_task(robot)
    end = task.start(10)
    increments = commands_of(task, end + 10) / INCREMENT_RAD
    assert np.abs(increments - np.round(increments)).max() < 1e-6


def test_commands_lie_on_the_straight_line_within_an_increment(robot):
    task, _, motors = ready_task(robot)
    end = task.start(10)
    tcp = tcp_of(commands_of(task, end + 10), robot)
    start = tcp_of(motors, robot)
    direction = (np.array(END) - start) / np.linalg.norm(np.array(END) - start)
    along = (tcp - start) @ direction
    assert np.linalg.norm(tcp - start - along[:, None] * direction, axis=1).max() < GRID_M
    assert (np.diff(along) > -2.0 * GRID_M).all()
    assert np.linalg.norm(tcp[-1] - END) < GRID_M


def test_on_the_cruise_the_tcp_keeps_its_speed(robot):
    task, plan, _ = ready_task(robot, speed_m_s=1.2)
    end = task.start(0)
    phases = plan.move(0).master
    (n,) = np.flatnonzero((phases[:-1, 3] == 0.0) & (phases[:-1, 4] == 0.0))
    begins, ends = (round(time / CYCLE_S) for time in phases[n : n + 2, 0])
    points = []
    for k in range(end):
        task.command(k)
        points.append(task.state['tcp'][0].copy())
    speeds = np.linalg.norm(np.diff(points[begins + 1 : ends - 1], axis=0), axis=1) / CYCLE_S
    assert len(speeds) > 50
    assert np.abs(speeds / 1.2 - 1.0).max() < SPEED
    assert task.progress()[0] == 0


@pytest.mark.parametrize('cycle_time_s', [1e-3, 2e-3, 4e-3])
def test_end_cycle_is_the_first_with_the_tcp_at_rest_at_the_end(cycle_time_s, robot):
    changed = robot.replace(bus__cycle_time_s=cycle_time_s)
    task, plan, _ = ready_task(changed)
    end = task.start(7)
    assert (end - 8) * cycle_time_s < plan.duration_s <= (end - 7) * cycle_time_s
    assert (task.end_cycle, task.last_cycle) == (end, end + SETTLE_CYCLES - 1)
    points = []
    for k in range(end + 2):
        task.command(k)
        points.append(task.state['tcp'][0].copy())
    assert np.linalg.norm(points[end] - END) < ROUNDING
    assert np.array_equal(points[end], points[end + 1])
    assert not np.array_equal(points[end - 1], points[end])
    assert np.array_equal(points[7], points[6])
    assert not np.array_equal(points[8], points[7])


def test_a_program_that_lasts_whole_cycles_ends_in_the_last_of_them(robot):
    task = Transformation(robot)
    task.locate(kinematics.inverse(START, robot.kinematics) * GEAR)
    master = plan_master(0.1, 1.0, 10.0, math.inf)  # 0.2 s
    assert master[-1, 0] == pytest.approx(0.2, rel=1e-15)
    task.load(Plan.of([Move(MoveKind.LINE, master, line(START, (0.1, 0.0, -0.75)).segments)]))
    assert task.start(0) == 200


def test_a_start_without_a_program_is_rejected_and_a_new_program_waits(robot):
    task = Transformation(robot)
    assert not task.loaded
    with pytest.raises(RunError, match='no program is loaded'):
        task.start(5)
    task, plan, motors = ready_task(robot)
    assert task.loaded
    task.start(3)
    task.load(plan)
    assert np.abs(commands_of(task, 20) - motors).max() < 1e-12


def test_a_program_can_start_again_after_its_end(robot):
    task, _, _ = ready_task(robot)
    end = task.start(0)
    first = commands_of(task, end)
    again = task.start(end + 100)
    assert again == 2 * end + 100
    second = np.array([task.command(k).motors.copy() for k in range(end + 100, again)])
    assert np.array_equal(first, second)
    assert task.figures().measured_cycles == 0


def test_the_control_word_marks_the_cycles_of_a_program_and_those_that_count(robot):
    task, _, _ = ready_task(robot)
    assert task.control(50) == CONTROL_ON
    last = task.start(100) + SETTLE_CYCLES - 1
    marks = {k: task.control(k) & CONTROL_MEASURE for k in (99, 100, last, last + 1)}
    assert marks == {99: 0, 100: CONTROL_MEASURE, last: CONTROL_MEASURE, last + 1: CONTROL_PROGRAM}
    # compiled stretches end where the word changes
    assert task.next_event(30) == 100
    assert task.next_event(100) == last + 1
    assert task.next_event(last + 1) == NEVER
    commands_of(task, 150)
    held = task.hold()
    assert task.control(task.last_cycle) & CONTROL_MEASURE == CONTROL_MEASURE
    assert task.last_cycle < last
    assert task.control(task.last_cycle + 1) & CONTROL_MEASURE == CONTROL_PROGRAM, held
    task.clear_program()
    assert task.control(last) == CONTROL_ON


def test_the_control_word_enables_from_its_cycle_on(robot):
    task = Transformation(robot)
    assert task.control(10**9) == CONTROL_ON
    task.enable(20)
    assert [task.control(k) for k in (0, 19, 20, 21)] == [
        CONTROL_ON,
        CONTROL_ON,
        CONTROL_ENABLE,
        CONTROL_ENABLE,
    ]


def test_a_point_that_no_arm_reaches_has_no_command(robot):
    task = Transformation(robot)
    task.locate(kinematics.inverse(START, robot.kinematics) * GEAR)
    master = plan_master(2.0, 1.0, 10.0, math.inf)
    task.load(Plan.of([Move(MoveKind.LINE, master, line(START, (0, 0, -2.75)).segments)]))
    end = task.start(0)
    assert np.isfinite(task.command(0).motors).all()
    assert np.isnan(task.command(end).motors).all()


def test_the_following_error_of_a_drive_1_75_cycles_late_is_zero_at_constant_joint_speed(robot):
    """7.3: the actual angle, one cycle old and 1.75 cycles late, is extrapolated by 2.75 cycles."""
    task = Transformation(robot)
    theta, rate = np.array([0.1, 0.2, 0.3]), np.array([1e-3, -2e-3, 3e-3])  # rad, rad per cycle
    task.locate((theta - 1.75 * rate) * GEAR)
    for k in range(200):
        task.state['theta_history'][0, k % HISTORY] = theta + k * rate
        answer = task.receive(k, (theta + (k - 1.75) * rate) * GEAR, np.zeros(3))
        if k >= 2:
            assert np.abs(answer['following_error']).max() < ROUNDING
        assert np.abs(answer['theta'] - theta - (k - 1.75) * rate).max() < ROUNDING


def late_answers(robot, delay_cycles, lag=0):
    """Run a program with perfect drives that are late; receive each answer ``lag`` cycles after its command."""
    task, plan, motors = ready_task(robot)
    end = task.start(10)
    path = Transformation(robot)
    path.locate(motors)
    path.load(plan)
    path.start(10)
    theta = []
    for k in range(end + 50):
        path.command(k)
        theta.append(path.state['theta_history'][0, k % HISTORY].copy())
    theta = np.array(theta)
    # between two cycles the fine interpolation moves on the chord
    whole, share = int(delay_cycles), delay_cycles % 1.0
    k = np.arange(len(theta))
    actual = (1.0 - share) * theta[np.maximum(k - whole, 0)] + share * theta[np.maximum(k - whole - 1, 0)]
    answers = []
    for cycle in range(len(theta) + lag):
        if cycle < len(theta):
            task.command(cycle)
        if cycle >= lag:
            answers.append(
                task.receive(cycle - lag, actual[cycle - lag] * GEAR, np.array([K_M, -2.0 * K_M, 0.0])).copy()
            )
    return np.array(answers), theta, task


def test_the_following_error_of_a_planned_move_is_the_formula_of_7_3(robot):
    answers, reference, _ = late_answers(robot, 1.75)
    actual = answers['theta']
    expected = reference[2:] - (actual[1:-1] + 2.75 * (actual[1:-1] - actual[:-2]))
    assert np.abs(answers['following_error'][2:] - expected).max() < ROUNDING
    # what is left is the acceleration over the extrapolated time: n (n + 1) / 2 cycles squared
    acceleration = np.abs(np.diff(reference, 2, axis=0)).max()
    assert np.abs(answers['following_error']).max() < 1.1 * 0.5 * 2.75 * 3.75 * acceleration


def test_the_tcp_error_of_a_drive_1_75_cycles_late_is_zero_with_the_delay_removed(robot):
    answers, _, task = late_answers(robot, 1.75)
    # the arms move on a chord of joint space, the TCP's command on one of its own: they differ by a T^2 / 8
    assert np.linalg.norm(answers['tcp_error'], axis=1).max() < 40.0 * CYCLE_S**2 / 8.0
    late = answers['tcp_command'] - answers['tcp_actual']
    assert np.linalg.norm(late, axis=1).max() == pytest.approx(1.75e-3 * 1.5, rel=0.01)
    assert task.figures().tcp_error_max_m < 1e-5


@pytest.mark.parametrize('delay', [0.75, 2.75])
def test_another_delay_shows_as_an_error_along_the_path(delay, robot):
    answers, _, _ = late_answers(robot, delay)
    error = np.linalg.norm(answers['tcp_error'], axis=1).max()
    assert error == pytest.approx(abs(delay - 1.75) * CYCLE_S * 1.5, rel=0.02)


@pytest.mark.parametrize('lag', [1, 8, 16])
def test_ats_delayed_by_cycles_give_the_same_bits(lag, robot):
    at_once, _, task = late_answers(robot, 1.75)
    later, _, task_later = late_answers(robot, 1.75, lag)
    assert at_once.tobytes() == later.tobytes()
    assert task.figures() == task_later.figures()


def test_figures_cover_only_the_program_and_its_settling(robot):
    task, _, _ = ready_task(robot)
    end = task.start(100)
    for k in range(end + 300):
        task.command(k)
        torque = K_M * (5.0 if k < 100 or k > end + 150 else 2.0)
        offset = np.array([0.0, 0.0, 1e-3]) if k == 50 else 0.0  # before the start: not counted
        task.receive(k, task.motors + offset, np.full(3, torque))
    figures = task.figures()
    assert figures.measured_cycles == end - 100 + SETTLE_CYCLES
    assert figures.at_current_peak_a == pytest.approx([2.0] * 3)
    assert figures.at_current_rms_a == pytest.approx([2.0] * 3)
    assert (
        figures.current_peak_a == figures.current_rms_a == [None] * 3
    )  # nobody has told those of all samples
    assert np.linalg.norm(np.array(figures.final_tcp_m) - END) < GRID_M
    # drives without delay lead the delayed command by 1.75 ms
    assert figures.tcp_error_max_m == pytest.approx(1.75e-3 * 1.5, rel=0.01)
    assert 0.0 < figures.tcp_error_rms_m < figures.tcp_error_max_m


def test_locating_gives_the_tcp_of_the_motors(robot):
    task, _, motors = ready_task(robot)
    assert task.locate(motors) == pytest.approx(tcp_of(motors, robot), abs=0.0)
    assert np.linalg.norm(task.locate(motors) - START) < GRID_M


def test_a_start_in_a_cycle_that_is_over_is_rejected(robot):
    task, _, _ = ready_task(robot)
    commands_of(task, 30)
    with pytest.raises(RunError, match='bus cycle 29 is over, the next one is 30'):
        task.start(29)
    assert task.start(30) > 30


def loaded(robot, moves, **fields):
    """Return a task at rest at ``START`` with a program loaded, and its plan."""
    task = Transformation(robot)
    tcp = task.locate(kinematics.inverse(START, robot.kinematics) * GEAR)
    plan = program_planner.plan(programs.parse({'moves': moves, **fields}, robot.motion), tcp, robot).plan
    task.load(plan)
    return task, plan


def test_outputs_switch_in_the_first_cycle_in_which_the_master_has_passed_their_place(robot):
    moves = [
        {'output': {'name': 'output7', 'value': True}},
        {'move_l': {'to_m': [0.2, 0.0, -0.75]}},
        {'output': {'name': 'gripper', 'value': True, 'before_m': 0.08, 'payload_kg': 0.25}},
        {'output': {'name': 'output1', 'value': True}},
        {'dwell': {'time_s': 0.0255}},
        {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
        {'move_l': {'to_m': [0.0, 0.0, -0.75]}},
        {'output': {'name': 'output7', 'value': False}},
    ]
    task, plan = loaded(robot, moves, payload_kg=0.0)
    end = task.start(5)
    seen = []
    for cycle in range(end + 3):
        task.command(cycle)
        move, distance, _ = task.progress()
        seen.append((cycle, move, distance, task.outputs, task.payload))
    bit = {name: 1 << n for n, name in enumerate(OUTPUTS)}

    def first(condition):
        return next(row[0] for row in seen if condition(row))

    assert first(lambda row: row[3] & bit['output7']) == 5
    passes = first(lambda row: row[0] >= 5 and row[2] >= 0.2 - 0.08 - 1e-7)
    assert first(lambda row: row[3] & bit['gripper']) == passes
    assert first(lambda row: row[4] == 0.25) == passes
    dwells = first(lambda row: row[1] == 1)
    assert first(lambda row: row[3] & bit['output1']) == dwells
    leaves = first(lambda row: row[1] == 2)
    assert first(lambda row: row[0] > passes and not row[3] & bit['gripper']) == leaves
    assert first(lambda row: row[0] > 5 and not row[3] & bit['output7']) == end
    assert leaves - dwells in (25, 26)
    assert seen[-1][3:] == (bit['output1'], 0.0)
    assert len(plan) == 3


def test_held_tcp_rests_on_its_line_until_the_program_is_unloaded(robot):
    task, _, _ = ready_task(robot)
    task.start(0)
    commands_of(task, 150)
    profile = task.hold()
    assert profile.cycle == 150
    assert task.held
    standing = task.end_cycle
    assert 150 < standing < 300
    for cycle in range(150, standing + 50):
        task.command(cycle)
    place = task.state['tcp'][0].copy()
    direction = (np.array(END) - START) / np.linalg.norm(np.array(END) - START)
    away = place - START
    assert np.linalg.norm(away - (away @ direction) * direction) < GRID_M
    task.clear_program()
    task.command(standing + 50)
    assert np.array_equal(task.state['tcp'][0], place)


def outputs_over(task, first, last):
    """Rows (cycle, move, distance, outputs, payload) of the cycles between two."""
    rows = []
    for cycle in range(first, last):
        task.command(cycle)
        rows.append((cycle, *task.progress()[:2], task.outputs, task.payload))
    return rows


def test_every_round_of_a_program_switches_its_outputs_at_their_places(robot):
    moves = [
        {'move_l': {'to_m': [0.2, 0.0, -0.75]}},
        {'output': {'name': 'gripper', 'value': True, 'before_m': 0.05, 'payload_kg': 0.7}},
        {'move_l': {'to_m': [0.0, 0.0, -0.75]}},
        {'output': {'name': 'gripper', 'value': False, 'before_m': 0.1, 'payload_kg': 0.0}},
    ]
    task, plan = loaded(robot, moves, repeat=3, payload_kg=0.0)
    assert len(plan) == 6
    end = task.start(0)
    rows = outputs_over(task, 0, end + 2)
    switched = [b for a, b in itertools.pairwise(rows) if a[3] != b[3]]
    assert [(row[1], row[3], row[4]) for row in switched] == [
        (n, (n + 1) % 2, 0.7 * ((n + 1) % 2)) for n in range(6)
    ]
    for row in switched:
        before = rows[row[0] - 1]
        place = 0.15 if row[3] else 0.1
        assert before[1] == row[1]
        assert before[2] < place - ROUNDING <= row[2]


def test_output_after_the_position_of_a_hold_waits_for_the_program(robot):
    moves = [
        {'move_l': {'to_m': [0.3, 0.0, -0.75]}},
        {'output': {'name': 'output2', 'value': True, 'before_m': 0.1}},
        {'dwell': {'time_s': 0.1}},
    ]
    task, _ = loaded(robot, moves)
    end = task.start(0)
    plan_cycle = next(row[0] for row in outputs_over(task, 0, end) if row[3])
    task, _ = loaded(robot, moves)
    task.start(0)
    # far enough before the place that the stop ends before it: 1.5 m/s, 15 m/s2 and 600 m/s3 need 94 mm
    rows = outputs_over(task, 0, plan_cycle - 90)
    task.hold()
    stopped = task.end_cycle
    rows += outputs_over(task, rows[-1][0] + 1, stopped + 200)
    assert rows[-1][2] < 0.2
    assert not any(row[3] for row in rows)
    timeline = task.timeline
    task.change(resume(timeline, stopped + 220, 0.5))
    rows = outputs_over(task, stopped + 200, task.pending_last_cycle)
    n = next(n for n, row in enumerate(rows) if row[3])
    assert rows[n - 1][2] < 0.2 - ROUNDING <= rows[n][2]


def test_the_payload_of_the_first_move_is_gripped_from_the_start(robot):
    task, _ = loaded(robot, [{'move_l': {'to_m': [0.1, 0.0, -0.75]}}], payload_kg=1.23456)
    before = task.payload
    task.start(10)
    assert (before, task.payload) == (robot.dynamics.payload_mass_kg, 1.2346)
    gripped, _ = loaded(
        robot, [{'output': {'name': 'gripper', 'value': True, 'payload_kg': 2.5}}, {'dwell': {'time_s': 1.0}}]
    )
    gripped.start(10)
    gripped.command(10)
    assert gripped.payload == 2.5
