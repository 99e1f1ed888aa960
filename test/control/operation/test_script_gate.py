"""Tests of the script gate: the bus waits for decisions, which have the same effect on every bus."""

import numpy as np
import pytest

from delta3_pacdrive import scripting
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.operation.script_gate import TRANSITIONS, GateEvent, GateState, ScriptGate
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.scripting.robot import Robot
from script_bus import ScriptBus


@pytest.fixture
def gate(robot):
    return ScriptGate(Transformation(robot), has_clock=False)


def brought_to(gate, state):
    """Bring a gate into a state."""
    if state is not GateState.FREE:
        gate.handle(GateEvent.ATTACH)
    if state is GateState.RUNNING:
        gate.handle(GateEvent.WAIT)
    assert gate.state is state
    return gate


@pytest.mark.parametrize('state', GateState)
@pytest.mark.parametrize('event', GateEvent)
def test_each_row_of_the_table_is_executed_without_side_effects(gate, state, event):
    step = TRANSITIONS.get((state, event))
    held = brought_to(gate, state).handle(event)
    assert gate.state is (state if step is None else step.state)
    assert held is (step is not None and step.holds_robot)


def test_lost_script_stops_the_robot_and_a_finished_one_does_not():
    for state in (GateState.RUNNING, GateState.WAITING):
        assert TRANSITIONS[state, GateEvent.CONTROL_LOST].holds_robot
        assert not TRANSITIONS[state, GateEvent.END].holds_robot
    assert (GateState.FREE, GateEvent.CONTROL_LOST) not in TRANSITIONS


def test_the_bus_waits_only_while_a_script_decides_and_never_for_a_clock(robot, gate):
    assert [
        brought_to(ScriptGate(Transformation(robot), clock), state).closed
        for clock in (False, True)
        for state in GateState
    ] == [False, False, True, False, False, False]


def test_a_wait_ends_with_the_first_answers_that_meet_it(gate):
    gate.attach(10)
    assert (gate.cycle, gate.met) == (9, True)
    gate.wait(WaitCondition(12, 20))
    for cycle in (10, 11):
        gate.answered(cycle)
        assert gate.state is GateState.RUNNING
    gate.answered(12)
    assert (gate.state, gate.cycle, gate.met) == (GateState.WAITING, 12, True)


def test_expired_wait_reports_that_its_condition_was_not_met(gate):
    gate.attach(10)
    gate.wait(WaitCondition(0, 12, inputs_on=1))
    for cycle in (10, 11, 12):
        gate.answered(cycle, inputs=2)
    assert (gate.state, gate.cycle, gate.met) == (GateState.WAITING, 12, False)


def test_condition_already_met_ends_the_wait_immediately(gate):
    gate.attach(10)
    gate.wait(WaitCondition(0, NEVER, inputs_on=1), inputs=1)
    assert (gate.state, gate.cycle, gate.met) == (GateState.WAITING, 9, True)


def test_a_second_script_is_not_attached(gate):
    gate.attach(10)
    gate.wait(WaitCondition(12, 20))
    gate.attach(15)
    assert (gate.state, gate.cycle) == (GateState.RUNNING, 9)


def test_the_robot_is_held_with_the_command_before_the_cycle_of_the_hold(gate):
    gate.attach(10)
    gate.hold_cycle = 15
    assert [gate.commanded(cycle) for cycle in range(12, 17)] == [False, False, True, False, False]


def test_a_hold_of_a_script_that_has_ended_is_forgotten(gate):
    gate.attach(10)
    gate.hold_cycle = 15
    gate.handle(GateEvent.END)
    assert not any(gate.commanded(cycle) for cycle in range(12, 17))


def follow(called):
    """A sequence of moves: rounded, from rest, an output alone, and a rest in which the program ends."""
    called.move_l(to_mm=[100, 0, -800], blend_mm=20)
    called.wait_time(0.02)
    called.move_l(to_mm=[0, 100, -800])
    called.wait(left_s=0.05)
    called.move_l(to_mm=[0, 0, -800])
    called.wait()
    called.output('gripper', True, payload_kg=0.3)
    called.wait_time(0.4)
    called.move_l(to_mm=[0, 50, -800], in_position=True)
    called.move_l(to_mm=[0, 0, -780])


def interrupt(called):
    """Hold, override and resume, and a decision in the cycles in which a program ends."""
    called.move_l(to_mm=[100, 0, -800])
    called.wait_time(0.1)
    called.hold()
    called.wait_time(0.3)
    called.override(50)
    called.move_l(to_mm=[0, 100, -800])
    called.resume()
    called.wait_time(0.1)
    called.override(100)
    called.wait()
    for _ in range(30):  # its last answer comes among these decisions
        called.wait_time(0.005)
    called.move_l(to_mm=[0, 0, -800])
    called.wait()
    called.wait_time(0.088)
    called.move_l(to_mm=[0, 0, -780])


@pytest.mark.parametrize('script', [follow, interrupt])
@pytest.mark.parametrize('changes', [{}, {'control__feed_forward': 'model', 'drive__interpolation': 'cubic'}])
def test_a_script_has_the_same_bits_on_a_bus_with_outstanding_cycles(robot, script, changes):
    robot = robot.replace(**changes)
    with scripting.simulate(robot) as called:
        script(called)
    trace = called.trace
    bus = ScriptBus(robot)
    called = Robot(bus, 'script')
    script(called)
    called.finish()
    assert bus.most_outstanding == robot.bus.outstanding_cycles_max
    cycles = min(len(bus.commands), len(trace.time_s))
    assert cycles > len(trace.time_s) - 10
    assert np.array_equal(np.array(bus.commands[:cycles]), trace['motor_command'][:cycles])
    assert np.array_equal(np.array(bus.answers[:cycles]), trace['motor_position'][:cycles])


def test_a_fault_opens_the_gate_so_that_the_robot_can_stop(robot):
    bus = ScriptBus(robot)
    called = Robot(bus, 'script')
    called.move_l(to_mm=[100, 0, -800], speed_m_s=0.2)
    called.wait_time(0.1)
    sent = len(bus.commands)
    bus.controller.state.emergency_stop()
    bus.controller.poll(1.0)
    for _ in range(1000):
        bus.exchange()
    assert len(bus.commands) > sent + 900
    assert bus.commands[-1] == bus.commands[-2]
