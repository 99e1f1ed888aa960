"""Tests of a robot of five axes: two rotary axes turn the tool with the same code as one."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.recording.signals import TURN_SIGNALS
from delta3_pacdrive.scripting.simulated_link import SteppedOperation
from delta3_pacdrive.simulation.robot import Robot

START, THERE = [-0.1525, 0.0, -0.85], [0.1525, 0.0, -0.85]
ANGLES_DEG = [90.0, -40.0]
OTHER = {  # of the second axis: no value of its motor, gear and loops is that of the first one
    'peak_current_a': 5.0,
    'gear_ratio': 7.0,
    'rotor_inertia_kg_m2': 0.5e-4,
    'tool_inertia_kg_m2': 9.0e-3,
    'part_gyration_radius_m': 0.11,
    'torque_constant_n_m_a': 0.7,
    'winding_resistance_ohm': 7.0,
    'winding_inductance_h': 16.0e-3,
    'pole_pairs': 4,
    'viscous_friction_n_m_s_rad': 2.0e-4,
    'static_friction_n_m': 0.05,
    'brake_torque_n_m': 2.5,
    'backlash_deg': 0.02,
    'bar_stiffness_n_m_rad': 900.0,
    'bar_damping_n_m_s_rad': 0.5,
    'position_gain_rad_s_rad': 90.0,
    'velocity_gain_a_s_rad': 0.2,
    'velocity_integral_gain_a_rad': 12.0,
    'current_gain_v_a': 40.0,
    'current_integral_gain_v_a_s': 20_000.0,
    'following_error_limit_deg': 1.0,
    'position_window_deg': 0.06,
    'angle_max_deg': 300.0,
}
LINE = [{'move_l': {'to_m': THERE, 'turn_deg': ANGLES_DEG, 'speed_m_s': 0.5}}]


def program(machine, moves=LINE, **head):
    return programs.parse({'start_m': START, **head, 'moves': moves}, machine.motion)


@pytest.fixture(scope='module', params=['model', 'rich'])
def machine(request):
    return with_axes(request.param, {}, OTHER)


def with_axes(name, first, second):
    """Return a robot with two rotary axes that have these values of their own."""
    own = {f'rotary__{key}': value for key, value in first.items()}
    own |= {f'rotary_2__{key}': value for key, value in second.items()}
    return parameters.load(name).replace(rotary__present=True, rotary_2__present=True, **own)


@pytest.fixture(scope='module')
def trace(machine):
    return simulation.run(program(machine), machine)


def test_both_angles_reach_their_targets_with_the_tcp(trace, machine):
    assert trace.meta['stopped'] == ''
    for suffix, angle in zip(('', '_2'), ANGLES_DEG, strict=True):
        assert math.degrees(trace[f'turn_true{suffix}'][-1, 0]) == pytest.approx(angle, abs=0.1)
        assert 0.0 < trace.meta['figures'][f'turn_error_max_rad{suffix}'] < math.radians(2.0)
        assert trace.meta['figures'][f'turn_place_error_max_rad{suffix}'] < math.radians(0.1)
    share = [
        trace[f'turn_command{suffix}'][:, 0] / math.radians(angle)
        for suffix, angle in zip(('', '_2'), ANGLES_DEG, strict=True)
    ]
    assert share[0] == pytest.approx(share[1], abs=1e-5)


def test_second_axis_does_not_affect_the_others(trace, machine):
    one = machine.replace(rotary_2__present=False)
    alone = simulation.run(program(one, [{'move_l': LINE[0]['move_l'] | {'turn_deg': ANGLES_DEG[0]}}]), one)
    assert trace.signals.keys() - alone.signals.keys() == {f'{name}_2' for name in TURN_SIGNALS}
    for name, values in alone.signals.items():
        assert np.array_equal(trace[name], values), name


def test_single_bus_cycles_give_the_bits_of_a_compiled_stretch(trace, machine):
    one_by_one = simulation.run(program(machine), machine, signals=('payload',))
    for name, values in trace.signals.items():
        assert np.array_equal(values, one_by_one[name]), name
    assert one_by_one.meta['figures'] == trace.meta['figures']


# a load beyond the torque of both motors stops the robot and moves the shaft against its brake
@pytest.mark.parametrize(('name', 'loads_n_m'), [('model', []), ('rich', []), ('model', [4.0])])
def test_axes_in_exchanged_order_exchange_their_signals_and_figures(name, loads_n_m):
    one, other = {'home_deg': 5.0}, OTHER | {'home_deg': -20.0}
    runs = []
    for axis, axes, angles in (('axis5', (one, other), [70, -30]), ('axis4', (other, one), [-30, 70])):
        machine = with_axes(name, *axes)
        machine = machine.replace(rich__sensors=False)  # their errors are not those of the other encoder
        overload = {'fault': 'overload', 'axis': axis, 'after_s': 0.3, 'for_s': 1.0}
        faults = [overload | {'torque_n_m': load} for load in loads_n_m]
        moves = [{'move_l': LINE[0]['move_l'] | {'turn_deg': angles}}]
        runs.append(simulation.run(program(machine, moves, payload_kg=0.5, faults=faults), machine))
        assert runs[-1].meta['stop_source'] == (axis if faults else '')
    for signal in TURN_SIGNALS:
        for suffix, exchanged in (('', '_2'), ('_2', '')):
            assert np.array_equal(runs[0][signal + suffix], runs[1][signal + exchanged]), signal
    figures = [found.meta['figures'] for found in runs]
    turns = [figure for figure in figures[0] if f'{figure}_2' in figures[0]]
    assert len(turns) == 5
    for figure in turns:
        assert figures[0][figure] == figures[1][f'{figure}_2'], figure
        assert figures[0][f'{figure}_2'] == figures[1][figure], figure


def test_the_motor_of_each_axis_accelerates_its_own_inertia():
    frictionless = {'static_friction_n_m': 0.0, 'viscous_friction_n_m_s_rad': 0.0}
    machine = with_axes('model', frictionless, OTHER | frictionless)
    moves = [{'turn': {'to_deg': [90, 90]}}, {'dwell': {'time_s': 0.05}}]
    trace = simulation.run(program(machine, moves, payload_kg=0.5), machine)
    for suffix, rotary in zip(('', '_2'), machine.rotary_axes, strict=True):
        torque = rotary.torque_constant_n_m_a * trace[f'turn_current{suffix}'][:, 0]
        impulse = torque[trace[f'turn_command{suffix}'][:, 0] < math.radians(45.0)].sum() * 1e-3
        fastest = trace[f'turn_speed{suffix}'].max()
        inertia = rotary.rotor_inertia_kg_m2 * rotary.gear_ratio**2 + rotary.inertia_kg_m2(0.5)
        assert impulse * rotary.gear_ratio / fastest == pytest.approx(inertia, rel=0.03)


@pytest.mark.parametrize('number', [0, 1])
def test_a_program_ends_only_with_both_axes_in_position(number):
    narrow = {'position_window_deg': 1e-6}  # less than the friction of the motor leaves
    machine = with_axes('model', *((narrow, {}), ({}, narrow))[number])
    meta = simulation.run(program(machine, [{'turn': {'to_deg': [60, 60]}}]), machine).meta
    assert f'axis{4 + number} is ' in meta['stopped']
    assert 'not in position 0.5 s after' in meta['stopped']


def test_hold_and_override_keep_both_angles_with_the_path(machine):
    placed = simulation.placed(machine, program(machine))
    robot, task = Robot(placed), Transformation(placed)
    plan = program_planner.plan(program(machine), task.locate(robot.encoder_positions()), placed).plan
    task.enable(20)
    elsewhere = program_planner.plan(program(machine, start_turn_deg=[0, 5]), START, placed).plan
    with pytest.raises(ProgramError, match='the tool at 5 deg, but it is at 0 deg'):
        task.load(elsewhere)
    task.load(plan)
    task.start(placed.motion.start_cycle)
    stepped = SteppedOperation(robot, task, placed, lambda cycle: 0, lambda: None)

    def off_the_path():
        number, distance, _ = task.progress()
        due = task.timeline.plan.move(number).turns_rad(distance)
        return [axis.angle_rad - angle for axis, angle in zip(task.rotary, due, strict=True)]

    stepped.go_to(placed.motion.start_cycle + 300)
    task.hold()
    stepped.go_to(placed.motion.start_cycle + 500)
    held = [axis.angle_rad for axis in task.rotary]
    assert off_the_path() == pytest.approx([0.0, 0.0], abs=1e-12)
    assert held[0] / held[1] == pytest.approx(ANGLES_DEG[0] / ANGLES_DEG[1], rel=1e-3)
    stepped.go_to(placed.motion.start_cycle + 550)
    assert [axis.angle_rad for axis in task.rotary] == held
    task.change(resume(task.timeline, task.next_cycle, 0.5))
    stepped.go_to(placed.motion.start_cycle + 700)
    assert off_the_path() == pytest.approx([0.0, 0.0], abs=1e-12)
    stepped.go_to(task.end_cycle + 50)
    assert np.degrees(task.turns_rad) == pytest.approx(ANGLES_DEG, rel=1e-12)


@pytest.mark.parametrize(
    'fault', [{'fault': 'encoder_failure'}, {'fault': 'overload', 'torque_n_m': 7.0, 'for_s': 0.02}]
)
def test_a_fault_of_the_fifth_axis_stops_the_robot_on_its_path(fault, machine):
    faults = [fault | {'axis': 'axis5', 'after_s': 0.3}]
    trace = simulation.run(program(machine, faults=faults), machine)
    assert trace.meta['stop_source'] == 'axis5'
    assert START[0] < trace['tcp_command'][-1, 0] < THERE[0]
    for name in ('turn_true', 'turn_true_2'):
        assert np.ptp(trace[name][-100:, 0]) < 1e-3  # the brakes hold
