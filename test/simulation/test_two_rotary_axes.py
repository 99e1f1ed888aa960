"""Tests of a robot of five axes: two rotary axes turn the tool with the same code as one."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.recording.signals import TURN_SIGNALS
from delta3_pacdrive.simulation.robot import Robot
from delta3_pacdrive.simulation.stepped import SteppedOperation

START, THERE = [-0.1525, 0.0, -0.85], [0.1525, 0.0, -0.85]
ANGLES_DEG = [90.0, -40.0]
LINE = [{'move_l': {'to_m': THERE, 'turn_deg': ANGLES_DEG, 'speed_m_s': 0.5}}]


def program(machine, moves=LINE, **head):
    return programs.parse({'start_m': START, **head, 'moves': moves}, machine.motion)


@pytest.fixture(scope='module', params=['model', 'rich'])
def machine(request):
    return parameters.load(f'{request.param}+rotary_2')


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


def test_equal_axes_with_equal_commands_have_equal_bits():
    machine = parameters.load('model').replace(rotary__present=True, rotary_2__present=True)
    trace = simulation.run(
        program(machine, [{'move_l': LINE[0]['move_l'] | {'turn_deg': [70, 70]}}]), machine
    )
    for name in TURN_SIGNALS:
        assert np.array_equal(trace[name], trace[f'{name}_2']), name


def test_hold_and_override_keep_both_angles_with_the_path(machine):
    placed = simulation.placed(machine, program(machine))
    robot, task = Robot(placed), Transformation(placed)
    plan = program_planner.plan(program(machine), task.locate(robot.encoder_positions()), placed).plan
    task.enable(20)
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
    'fault', [{'fault': 'encoder_failure'}, {'fault': 'overload', 'torque_n_m': 5.0, 'for_s': 0.02}]
)
def test_a_fault_of_the_fifth_axis_stops_the_robot_on_its_path(fault, machine):
    faults = [fault | {'axis': 'axis5', 'after_s': 0.3}]
    trace = simulation.run(program(machine, faults=faults), machine)
    assert trace.meta['stop_source'] == 'axis5'
    assert START[0] < trace['tcp_command'][-1, 0] < THERE[0]
    for name in ('turn_true', 'turn_true_2'):
        assert np.ptp(trace[name][-100:, 0]) < 1e-3  # the brakes hold
