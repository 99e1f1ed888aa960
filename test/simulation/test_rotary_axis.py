"""Tests of the simulation of a robot with a rotary axis: turn along the path, and the fourth drive."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters, scripting, simulation
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.recording.signals import TURN_SIGNALS
from delta3_pacdrive.scripting.simulated_link import SteppedOperation
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.robot import Robot

PICK = [-0.1525, 0.0, -0.85]
AT_THE_PLACE_DEG = 0.1  # that the tool may be off where it arrives
GRID = 1e-4  # [rad]: increments of the encoder over the gear are 1.2e-6


def half_cycles(turn):
    """Two halves of the packaging cycle; on each the tool turns half around, or not."""
    sides = []
    for side, angle in ((1.0, 180.0), (-1.0, 0.0)):
        over = {'to_m': {'by_m': [side * 0.305, 0.0, 0.0]}, 'blend_m': 0.025}
        sides += [
            {'dwell': {'time_s': 0.03}},
            {'move_l': {'to_m': {'by_m': [0.0, 0.0, 0.025]}, 'blend_m': 0.025}},
            {'move_l': over | ({'turn_deg': angle} if turn else {})},
            {'move_l': {'to_m': {'by_m': [0.0, 0.0, -0.025]}}},
        ]
    return sides


def program(moves, robot, **head):
    limits = {'speed_m_s': 4.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20000.0}
    return programs.parse({'start_m': PICK, 'limits': limits, **head, 'moves': moves}, robot.motion)


@pytest.fixture(scope='module')
def machine():
    return parameters.load('model').replace(rotary__present=True)


@pytest.fixture(scope='module')
def turned(machine):
    """A run of the packaging cycle with tool rotation by half a turn and back."""
    return simulation.run(program(half_cycles(turn=True), machine), machine)


def test_half_a_turn_does_not_lengthen_half_a_packaging_cycle_and_is_exact_at_the_place(turned, machine):
    alone = simulation.run(program(half_cycles(turn=False), machine), machine)
    assert turned.meta['program_s'] == alone.meta['program_s']
    assert turned.meta['notices'] == []
    found = math.degrees(turned.meta['figures']['turn_place_error_max_rad'])
    print(f'{found:.4f} deg at the place')
    assert 0.0 < found < AT_THE_PLACE_DEG
    assert np.degrees(turned['turn_true'][:, 0]).max() == pytest.approx(180.0, abs=0.1)


@pytest.mark.parametrize('name', ['delta3', 'rich', 'rich+model'])
def test_the_built_robot_and_the_controller_of_the_thesis_are_as_exact_at_the_place(name):
    machine = parameters.load(name).replace(rotary__present=True)
    trace = simulation.run(program(half_cycles(turn=True), machine), machine)
    assert math.degrees(trace.meta['figures']['turn_place_error_max_rad']) < AT_THE_PLACE_DEG


def test_the_arms_do_not_feel_the_axis(turned, machine):
    """Every bit of their signals is that of a robot without one, on the same path."""
    robot = machine.replace(rotary__present=False)
    alone = simulation.run(program(half_cycles(turn=False), robot), robot)
    of_arms = {name for name in turned.signals if name not in TURN_SIGNALS}
    assert of_arms == alone.signals.keys()
    for name in of_arms:
        assert np.array_equal(turned[name], alone[name]), name


def test_the_signals_of_the_axis_belong_together(turned, machine):
    signals = {name: turned[name][:, 0] for name in TURN_SIGNALS}
    assert {values.shape for values in signals.values()} == {turned.time_s.shape}
    delay = machine.set_point_delay_cycles
    cycles = np.arange(len(turned.time_s))
    due = np.interp(cycles - delay, cycles, signals['turn_command'])
    error = due - signals['turn_position']
    assert signals['turn_error'][4:] == pytest.approx(error[4:], abs=GRID)
    slope = np.gradient(signals['turn_position'], turned.meta['cycle_time_s'])
    assert signals['turn_speed'] == pytest.approx(slope, abs=0.02 * np.abs(slope).max())
    assert signals['turn_true'] == pytest.approx(signals['turn_position'], abs=GRID)  # a rigid bar
    figures = turned.meta['figures']
    start = turned.meta['start_cycle']
    assert figures['turn_current_peak_a'] == np.abs(signals['turn_current'][start:]).max()
    assert figures['turn_error_max_rad'] == np.abs(signals['turn_error'][start:]).max()


def errors_at_the_ends(trace, ends_s, delay):
    """How far the tool is off when the set points of each end are there [rad]: by its encoder, and truly."""
    cycles = np.arange(len(trace.time_s))
    ends = trace.meta['start_cycle'] + np.array(ends_s) / trace.meta['cycle_time_s']
    by_encoder = np.interp(ends + delay, cycles, trace['turn_error'][:, 0])
    truly = np.interp(ends, cycles, trace['turn_command'][:, 0]) - np.interp(
        ends + delay, cycles, trace['turn_true'][:, 0]
    )
    return np.abs(by_encoder), np.abs(truly)


@pytest.mark.parametrize('name', ['delta3', 'rich+model'])
def test_the_figures_of_a_run_are_those_of_its_signals_where_moves_end(name):
    machine = parameters.load(name).replace(rotary__present=True)
    trace = simulation.run(program(half_cycles(turn=True), machine), machine)
    ends = [move['end_s'] for move in trace.meta['moves']]
    by_encoder, truly = errors_at_the_ends(trace, ends, machine.set_point_delay_cycles)
    figures = trace.meta['figures']
    assert figures['turn_encoder_place_error_max_rad'] == pytest.approx(by_encoder.max(), rel=1e-6)
    assert figures['turn_place_error_max_rad'] == pytest.approx(truly.max(), rel=1e-6)
    assert figures['turn_error_max_rad'] > by_encoder.max()


def test_end_of_moves_is_known_at_an_override(machine):
    stepped, _, task = operation(machine, [*LINE, {'dwell': {'time_s': 0.1}}])
    end = task.timeline.plan.tables.starts[1]
    start, delay = machine.motion.start_cycle, machine.set_point_delay_cycles
    stepped.go_to(start + 100)
    task.change(resume(task.timeline, task.next_cycle, 0.5))
    stepped.go_to(task.pending_last_cycle + 1)
    profile = task.timeline.record[0]
    over = profile['cycle'] + (profile['duration'] + (end - profile['time']) / 0.5) / 1e-3
    errors = stepped.signals()['turn_error'][:, 0]
    cycles = np.arange(len(errors))
    rest = (
        profile['cycle']
        + (profile['duration'] + (task.timeline.plan.duration_s - profile['time']) / 0.5) / 1e-3
    )
    wanted = np.abs(np.interp(np.array([over, rest]) + delay, cycles, errors)).max()
    assert over - start > 1.5 * end / 1e-3
    assert task.figures().turns[0].place_error_max_rad == pytest.approx(wanted, rel=1e-6)


def test_second_program_has_separate_figures(machine):
    stepped, _, task = operation(machine, LINE)
    stepped.go_to(task.last_cycle + 1)
    assert task.figures().turns[0].error_max_rad > 1e-5
    task.load(
        program_planner.plan(
            program([{'dwell': {'time_s': 0.05}}], machine, start_m=[0.1525, 0.0, -0.85]),
            task.state['tcp'][0],
            machine,
            turns_rad=task.turns_rad,
        ).plan
    )
    task.start(task.next_cycle + 5)
    stepped.go_to(task.last_cycle + 1)
    figures = task.figures().turns[0]
    assert figures.measured_cycles == 50 + 100
    assert figures.place_error_max_rad <= figures.error_max_rad < 1e-5


def test_axis_current_agrees_with_inertia_and_friction(turned, machine):
    rotary, current = machine.rotary, turned['turn_current'][:, 0]
    acceleration = np.gradient(np.gradient(turned['turn_true'][:, 0])) / turned.meta['cycle_time_s'] ** 2
    torque = rotary.shaft_inertia_kg_m2(0.5) * rotary.gear_ratio * acceleration
    most = np.abs(torque).max() / rotary.torque_constant_n_m_a
    friction = rotary.static_friction_n_m / rotary.torque_constant_n_m_a
    assert np.abs(current).max() == pytest.approx(most + friction, rel=0.15)


def test_model_feed_forward_reduces_the_error_during_motion():
    errors = []
    for name in ('delta3', 'model'):
        machine = parameters.load(name).replace(rotary__present=True)
        trace = simulation.run(program(half_cycles(turn=True), machine), machine)
        errors.append(trace.meta['figures']['turn_error_max_rad'])
    assert errors[1] < 0.5 * errors[0]


def test_a_compiled_stretch_gives_the_bits_of_single_bus_cycles(turned, machine):
    one_by_one = simulation.run(program(half_cycles(turn=True), machine), machine, signals=('payload',))
    for name, values in turned.signals.items():
        assert np.array_equal(values, one_by_one[name]), name
    assert one_by_one.meta['figures'] == turned.meta['figures']


def test_tool_is_at_the_start_of_the_program(machine):
    moves = [{'turn': {'to_deg': -20}}]
    trace = simulation.run(program(moves, machine, start_turn_deg=25), machine)
    angles = np.degrees(trace['turn_true'][:, 0])
    assert angles[0] == pytest.approx(25.0, abs=1e-9)
    assert angles[-1] == pytest.approx(-20.0, abs=0.01)
    assert np.ptp(trace['tcp_command'], axis=0).tolist() == [0.0, 0.0, 0.0]


# hold, override, resume: the tool stays with the path


def operation(machine, moves, **head):
    """Return a robot in a stepped simulation with a program that is started, and its task."""
    one = program(moves, machine, **head)
    placed = simulation.placed(machine, one)
    robot, task = Robot(placed), Transformation(placed)
    planned = program_planner.plan(one, task.locate(robot.encoder_positions()), placed)
    task.enable(20)
    task.load(planned.plan)
    task.start(placed.motion.start_cycle)
    stepped = SteppedOperation(robot, task, placed, lambda cycle: 0, lambda: None)
    return stepped, robot, task


def off_the_path(task):
    """Distance of the tool command from the plan at the distance of the master [rad]."""
    number, distance, _ = task.progress()
    return task.rotary[0].angle_rad - task.timeline.plan.move(number).turns_rad(distance)[0]


LINE = [{'move_l': {'to_m': [0.1525, 0.0, -0.85], 'turn_deg': 180, 'speed_m_s': 0.5}}]


def test_hold_override_and_resume_keep_the_tool_with_the_path(machine):
    stepped, _, task = operation(machine, LINE)
    start = machine.motion.start_cycle
    stepped.go_to(start + 300)
    assert off_the_path(task) == 0.0
    task.hold()
    stepped.go_to(start + 500)
    _, held_at, speed = task.progress()
    assert speed == 0.0
    assert 0.05 < held_at < 0.25
    angle = task.rotary[0].angle_rad
    assert angle == pytest.approx(
        math.pi * held_at / 0.305, rel=1e-5
    )  # the robot stands on its grid at first
    stepped.go_to(start + 550)
    assert task.rotary[0].angle_rad == angle
    task.change(resume(task.timeline, task.next_cycle, 0.5))
    for cycle in range(start + 600, start + 900, 50):
        stepped.go_to(cycle)
        assert abs(off_the_path(task)) < 1e-12
    stepped.go_to(task.end_cycle + 50)
    assert math.degrees(task.rotary[0].angle_rad) == pytest.approx(180.0, rel=1e-12)
    assert math.degrees(task.rotary[0].state['actual'][0]) == pytest.approx(180.0, abs=0.05)


def test_a_pure_turn_is_held_and_resumed_as_any_move(machine):
    stepped, _, task = operation(machine, [{'turn': {'to_deg': 300}}])
    start = machine.motion.start_cycle
    stepped.go_to(start + 60)
    task.hold()
    stepped.go_to(start + 200)
    held_deg = math.degrees(task.rotary[0].angle_rad)
    assert 20.0 < held_deg < 280.0
    task.change(resume(task.timeline, task.next_cycle, 1.0))
    stepped.go_to(task.pending_last_cycle)
    assert math.degrees(task.rotary[0].angle_rad) == pytest.approx(300.0, rel=1e-12)


# faults


def test_an_axis_that_cannot_follow_stops_the_robot_and_is_named(machine):
    weak = machine.replace(rotary__following_error_limit_deg=1e-3, rotary__velocity_gain_a_s_rad=0.02)
    with pytest.raises(RunError, match=r'axis4 is not enabled in bus cycle \d+: .*(8111|following)'):
        simulation.run(program(half_cycles(turn=True), weak), weak)


def test_a_fault_of_the_fourth_drive_stops_the_robot_on_its_path(machine):
    weak = machine.replace(rotary__following_error_limit_deg=1e-3, rotary__velocity_gain_a_s_rad=0.02)
    harmless = [{'fault': 'drop_at', 'axis': 'axis1', 'after_s': 0.01}]
    trace = simulation.run(program(LINE, weak, faults=harmless), weak)
    assert trace.meta['stop_source'] == 'axis4'
    assert trace.meta['stopped'].startswith('axis4 reports a fault in bus cycle ')
    assert 'following' in trace.meta['stopped']
    command, first = trace['tcp_command'], trace.meta['stop_cycle']
    assert np.ptp(command[-100:], axis=0).tolist() == [0.0, 0.0, 0.0]
    assert PICK[0] < command[-1, 0] < 0.15  # somewhere on the line
    assert command[-1, 1:] == pytest.approx(PICK[1:], abs=1e-5)
    assert first < len(command)
    turned = np.degrees(trace['turn_true'][-1, 0])
    assert 0.0 < turned < 180.0
    assert np.ptp(trace['turn_true'][-100:, 0]) == 0.0  # its brake holds it


@pytest.mark.parametrize(
    ('fault', 'told'),
    [
        ({'fault': 'encoder_failure'}, '8171'),
        ({'fault': 'winding_short'}, '8905'),
        ({'fault': 'dc_link', 'voltage_v': 300.0}, ''),
        ({'fault': 'drop_mdt', 'cycles': 2}, '8112'),
        ({'fault': 'drop_at', 'cycles': 2}, 'two AT lost in a row'),
        ({'fault': 'overload', 'torque_n_m': 5.0}, ''),
    ],
)
def test_a_fault_of_the_fourth_axis_that_is_injected_stops_the_robot(fault, told, machine):
    faults = [fault | {'axis': 'axis4', 'after_s': 0.3}]
    trace = simulation.run(program(LINE, machine, faults=faults), machine)
    print(trace.meta['stopped'])
    assert trace.meta['stop_source'] == 'axis4'
    assert told in trace.meta['stopped']
    assert PICK[0] < trace['tcp_command'][-1, 0] < 0.15


def test_one_lost_telegram_of_the_fourth_axis_is_bridged(machine):
    faults = [
        {'fault': 'drop_at', 'axis': 'axis4', 'after_s': 0.2},
        {'fault': 'drop_mdt', 'axis': 'axis4', 'after_s': 0.3},
    ]
    trace = simulation.run(program(LINE, machine, faults=faults), machine)
    assert trace.meta['stopped'] == ''
    assert trace.meta['lost_telegrams'] == 1
    assert math.degrees(trace['turn_true'][-1, 0]) == pytest.approx(180.0, abs=0.02)


def test_a_fault_of_an_axis_that_is_not_there_is_rejected(machine):
    robot = machine.replace(rotary__present=False)
    faults = [{'fault': 'drop_at', 'axis': 'axis4', 'after_s': 0.2}]
    with pytest.raises(ProgramError, match='drop_at axis4: the robot has no axis4 for a rotary axis'):
        simulation.run(program([{'dwell': {'time_s': 0.1}}], robot, faults=faults), robot)


def test_controller_and_machine_must_both_have_the_axis(machine):
    without = machine.replace(rotary__present=False)
    with pytest.raises(RunError, match='must have the same rotary axes'):
        SimulatedOperation(Robot(without), Transformation(machine), (), machine)


def test_plan_from_another_tool_angle_is_not_loaded(machine):
    one = program(LINE, machine)
    plan = program_planner.plan(one, PICK, machine, turns_rad=(0.5,)).plan
    with pytest.raises(ProgramError, match=r'begins with the tool at 28\.6479 deg, but it is at 0 deg'):
        Transformation(machine).load(plan)
    with pytest.raises(ProgramError, match='the robot has no rotary axis'):
        Transformation(machine.replace(rotary__present=False)).load(plan)


# scripts


def test_a_script_turns_the_tool_with_the_same_calls(machine):
    with scripting.simulate(machine, name='turning') as robot:
        robot.turn(to_deg=30)
        robot.move_l(to_mm=[50, 0, -800], turn_deg=90, blend_mm=10)
        robot.move_l(to_mm=[50, 50, -800], turn_deg={'by_deg': 45})
        robot.wait()
        robot.wait_time(0.3)  # what comes then is a program of its own
        robot.move_l(to_mm=[0, 0, -780])
        robot.turn(to_rad=0.0)
    trace = robot.trace
    angles = np.degrees(trace['turn_command'][:, 0])
    assert angles.max() == pytest.approx(135.0, abs=1e-6)
    assert angles[-1] == pytest.approx(0.0, abs=1e-6)
    figures = trace.meta['figures']
    assert figures['turn_error_max_rad'] == np.abs(trace['turn_error'][trace.meta['start_cycle'] :]).max()
    ends = [move['end_s'] for move in trace.meta['moves']]  # of scripts in whole cycles
    by_encoder, _ = errors_at_the_ends(trace, ends, machine.set_point_delay_cycles)
    assert figures['turn_encoder_place_error_max_rad'] == pytest.approx(by_encoder.max(), rel=0.02)
    assert math.degrees(trace.meta['figures']['turn_place_error_max_rad']) < AT_THE_PLACE_DEG
