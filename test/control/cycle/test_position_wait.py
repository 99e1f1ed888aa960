"""Tests of the position window: programs end and exact stops finish with every drive within its window."""

from typing import Any

import numpy as np
import pytest
import yaml

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.stages import Event, PositionWait, Schedule
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import Code, FaultCode
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.sercos.bus_time import NEVER

STOP = [0.05, 0.0, -0.75]
# an exact stop, an output that belongs to it, and a way on
PROGRAM = """
in_position: {waits}
moves:
- move_l: {{to_m: [0.05, 0.0, -0.75]}}
- output: {{name: gripper, value: true}}
- move_l: {{to_m: [0.05, 0.05, -0.75]}}
"""
EDGES = 3  # cycles at both ends in which the TCP is less than a nanometre off
WINDOW_RAD, TIME_S, TIMEOUT_S = 0.01, 0.02, 0.3


@pytest.fixture
def robot(robot: Parameters) -> Parameters:
    return robot.replace(
        drive__position_window_rad=WINDOW_RAD,
        motion__in_position_time_s=TIME_S,
        motion__in_position_timeout_s=TIMEOUT_S,
    )


@pytest.fixture
def rig(rig: Any) -> Any:
    assert rig.do('enable')[0]
    return rig


def drive(rig: Any, waits: bool = True) -> None:
    """Start the program and drive it up to the set points of its first stop."""
    assert rig.ask('program', PROGRAM.format(waits='true' if waits else 'false'))[0]
    assert rig.ask('start')[0]
    until(rig, lambda: bool(np.allclose(rig.task.state['tcp'][0], STOP, atol=1e-9)))


def until(rig: Any, happened: Any, most: int = 2000) -> int:
    """Let cycles pass until something has happened; return how many."""
    for cycles in range(most):
        if happened():
            return cycles
        rig.run(1)
    raise AssertionError('it never happened')


def stands_at_the_stop(rig: Any) -> bool:
    return bool(np.allclose(rig.task.state['tcp'][0], STOP, atol=1e-9))


@pytest.mark.parametrize('percent', [100, 50])
def test_early_robot_waits_for_its_planned_time(percent: int, rig: Any, robot: Parameters) -> None:
    assert rig.ask('override', str(percent))[0]
    drive(rig)
    waited = until(rig, lambda: not stands_at_the_stop(rig))
    planned = robot.shortest_wait_s / robot.bus.cycle_time_s * 100.0 / percent
    assert waited == pytest.approx(planned, abs=EDGES * 100.0 / percent)
    until(rig, lambda: rig.state.motion == 'idle')
    assert rig.state.finished


def test_output_at_a_stop_does_not_wait_by_default(rig: Any) -> None:
    rig.off_rad = 2.0 * WINDOW_RAD
    drive(rig, waits=False)
    assert until(rig, lambda: not stands_at_the_stop(rig)) <= 2


def test_program_continues_after_the_settling_time_in_the_windows(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 1.01 * WINDOW_RAD
    rig.run(100)
    assert stands_at_the_stop(rig)
    rig.off_rad = 0.99 * WINDOW_RAD
    rig.run(19)
    rig.off_rad = -1.01 * WINDOW_RAD  # not long enough
    rig.run(50)
    assert stands_at_the_stop(rig)
    rig.off_rad = -0.99 * WINDOW_RAD
    waited = until(rig, lambda: not stands_at_the_stop(rig))
    assert waited == 20 + rig.robot.bus.outstanding_cycles_max + 1
    until(rig, lambda: rig.state.motion == 'idle')
    assert rig.state.finished


def test_passing_through_the_windows_does_not_count_as_in_position(rig: Any) -> None:
    drive(rig)  # exactly where the set points are
    assert stands_at_the_stop(rig)
    rig.run(round(TIME_S / rig.robot.bus.cycle_time_s) - 8)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(100)
    assert stands_at_the_stop(rig)


def test_output_at_a_stop_switches_when_the_robot_is_in_position(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(100)
    assert rig.task.outputs == 0
    rig.off_rad = 0.0
    rig.run(60)
    assert rig.task.outputs == 1


def test_robot_that_does_not_stop_in_time_is_stopped_with_a_message(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    waited = until(rig, lambda: rig.state.fault is not None)
    assert waited == pytest.approx(TIMEOUT_S / rig.robot.bus.cycle_time_s, abs=2)
    fault = rig.state.fault
    assert (fault.code, fault.source) == (FaultCode.NOT_IN_POSITION, 'axis2')
    assert str(fault) == (
        'not in position 0.3 s after the set points came to rest at the end of move 1: axis2 is 0.02 rad off, the '
        'position window (S-0-0057) is 0.01 rad'
    )
    rig.run(100)
    assert stands_at_the_stop(rig)
    assert rig.state.without_torque


def test_program_without_a_present_robot_ends_later_or_never(rig: Any) -> None:
    drive(rig, waits=False)
    rig.off_rad = 2.0 * WINDOW_RAD
    until(rig, lambda: rig.next_cycle > rig.task.end_cycle + SETTLE_CYCLES + 50)
    assert rig.state.motion == 'moving'
    rig.off_rad = 0.0
    assert until(rig, lambda: rig.state.motion == 'idle') == round(TIME_S / rig.robot.bus.cycle_time_s)
    assert rig.state.finished
    rig.off_rad = 2.0 * WINDOW_RAD
    assert rig.ask('program', 'moves: [{move_l: {to_m: [0.0, 0.0, -0.78]}}]')[0]
    assert rig.ask('start')[0]
    until(rig, lambda: rig.state.fault is not None)
    assert 'at the end of the program: axis2 is 0.02 rad off' in str(rig.state.fault)
    assert not rig.state.finished
    accepted, sentence = rig.ask('start')
    assert not accepted
    assert 'not in position' in sentence


def test_wait_is_reported_as_settling(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(50)
    assert rig.task.settling(rig.answered - 1)
    rig.off_rad = 0.0
    until(rig, lambda: not stands_at_the_stop(rig))
    rig.run(5)
    assert not rig.task.settling(rig.answered - 1)
    until(rig, lambda: rig.next_cycle > rig.task.end_cycle + 1)
    assert rig.task.settling(rig.answered - 1)
    until(rig, lambda: rig.state.motion == 'idle')
    assert not rig.task.settling(rig.answered - 1)


def test_a_wait_can_be_held_and_resumed_and_waits_on(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(50)
    assert rig.do('hold')[0]
    rig.run(2 * round(TIMEOUT_S / rig.robot.bus.cycle_time_s))  # who is held is not late
    assert rig.state.motion == 'stopped'
    assert rig.ask('resume')[0]
    rig.run(100)
    assert (rig.state.motion, stands_at_the_stop(rig)) == ('moving', True)
    rig.off_rad = 0.0
    until(rig, lambda: rig.state.motion == 'idle')
    assert rig.state.finished


def test_an_override_in_a_wait_neither_ends_nor_forgets_it(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(30)
    assert rig.ask('override', '150') == (True, 'override 150 %')
    rig.run(270)  # longer than the rest of the wait would take at 150 %
    assert stands_at_the_stop(rig)
    rig.off_rad = 0.0
    assert (
        until(rig, lambda: not stands_at_the_stop(rig))
        <= 2 * rig.robot.shortest_wait_s / rig.robot.bus.cycle_time_s
    )
    assert rig.task.profile.override == 1.5
    until(rig, lambda: rig.state.motion == 'idle')


def test_moves_after_a_wait_are_executed_after_it(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(30)
    assert rig.ask('move', 'moves: [{move_l: {to_m: [0.0, 0.0, -0.78]}}]')[0]
    rig.run(100)
    assert stands_at_the_stop(rig)
    rig.off_rad = 0.0
    until(rig, lambda: rig.state.motion == 'idle')
    assert rig.task.state['tcp'][0] == pytest.approx([0.0, 0.0, -0.78], abs=1e-9)


def test_abort_of_a_wait_leaves_the_robot_idle_in_place(rig: Any) -> None:
    drive(rig)
    rig.off_rad = 2.0 * WINDOW_RAD
    rig.run(30)
    assert rig.do('abort')[0]
    until(rig, lambda: rig.state.motion == 'idle')
    assert stands_at_the_stop(rig)
    assert rig.state.fault is None
    accepted, sentence = rig.ask('resume')
    assert (accepted, Code.STATE.value in sentence or 'only a stopped' in sentence) == (False, True)


def test_a_program_that_is_given_up_before_its_start_waits_at_no_stop(robot: Parameters) -> None:
    task = Transformation(robot)
    here = task.locate(kinematics.inverse(robot.motion.home_m, robot.kinematics) * robot.dynamics.gear_ratio)
    program = programs.parse(yaml.safe_load(PROGRAM.format(waits='true')), robot.motion)
    task.load(program_planner.plan(program, here, robot).plan)
    task.start(100)
    task.stop_at(50)
    for cycle in range(3000):
        task.command(cycle)
    assert (task.loaded, task.end_cycle, task.own_profile) == (False, NEVER, None)


def test_robot_running_for_too_short_a_time_is_reported(robot):
    impatient = robot.replace(motion__in_position_timeout_s=0.004)
    off = np.array([0.0, 2.2e-5, 0.0])
    schedule = Schedule({event: lambda *_: None for event in Event})
    fault = PositionWait(impatient, schedule).fault(104, 100, 'at the end of the program', off, within=2)
    assert str(fault) == (
        'not in position 0.004 s after the set points came to rest at the end of the program: all drives are within '
        'their position windows (S-0-0057) for only 2 bus cycles, 20 are needed'
    )
    assert not fault.sources
