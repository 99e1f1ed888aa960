"""Tests of the figures of a run against independent computations from the trace."""

import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters, simulation
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs

GEAR = 32.0
CYCLE_S = 1e-3
EXACT = 1e-12  # sums in another order
BENT = {
    'start_m': [0.0, 0.0, -0.78],
    'moves': [
        {'move_l': {'to_m': [0.15, -0.1, -0.8], 'blend_m': 0.02}},
        {'move_l': {'to_m': [-0.1, 0.1, -0.82]}},
        {'dwell': {'time_s': 0.02}},
        {'move_l': {'to_m': [0.0, 0.2, -0.78]}},
    ],
}


def run(robot, *faults, **fields):
    return simulation.run(programs.parse(BENT | {'faults': list(faults)} | fields, robot.motion), robot)


@pytest.fixture(scope='module')
def trace(robot):
    return run(robot)


def measured(trace):
    """Return the rows of the program and of its settling."""
    return slice(trace.meta['start_cycle'], trace.meta['end_cycle'] + SETTLE_CYCLES)


def test_maximum_and_rms_of_the_tcp_error_are_those_of_its_length(trace):
    length = np.linalg.norm(trace['tcp_error'][measured(trace)], axis=1)
    figures = trace.meta['figures']
    assert figures['tcp_error_max_m'] == pytest.approx(length.max(), rel=EXACT)
    assert figures['tcp_error_rms_m'] == pytest.approx(math.sqrt((length**2).mean()), rel=EXACT)
    assert figures['measured_cycles'] == len(length)
    # otherwise one could stand for the other
    assert figures['tcp_error_rms_m'] < 0.8 * figures['tcp_error_max_m']


def test_peak_and_rms_of_the_currents_in_the_at_are_those_of_each_axis(trace):
    current = trace['current'][measured(trace)]
    figures = trace.meta['figures']
    peak, rms = np.abs(current).max(axis=0), np.sqrt((current**2).mean(axis=0))
    assert figures['at_current_peak_a'] == pytest.approx(peak.tolist(), rel=EXACT)
    assert figures['at_current_rms_a'] == pytest.approx(rms.tolist(), rel=EXACT)
    assert (
        current.min(axis=0) < -1.45 * current.max(axis=0)
    ).all()  # the peaks are negative: 1.49 times at least


def test_peak_and_rms_of_the_currents_are_those_of_all_samples_of_each_axis(trace):
    low, high, rms = (trace[name][measured(trace)] for name in ('current_min', 'current_max', 'current_rms'))
    peak = np.maximum(-low, high).max(axis=0)
    figures = trace.meta['figures']
    assert figures['current_peak_a'] == peak.tolist()
    assert figures['current_rms_a'] == pytest.approx(np.sqrt((rms**2).mean(axis=0)).tolist(), rel=EXACT)
    # the AT tell one sample of sixteen, after the pulse with which each cycle begins
    assert (peak > 1.05 * np.array(figures['at_current_peak_a'])).all()


def test_the_largest_following_error_may_be_of_either_sign(trace, robot):
    error = trace['following_error'][measured(trace)]
    assert trace.meta['figures']['following_error_max_rad'] == pytest.approx(np.abs(error).max(), rel=EXACT)
    task = Transformation(robot)
    for sign in (1.0, -1.0):
        # a plate that stands off by some angle, ahead or behind
        program = programs.parse({'moves': [{'dwell': {'time_s': 0.01}}]}, robot.motion)
        home = kinematics.inverse(robot.motion.home_m, robot.kinematics) * GEAR
        task.locate(home)
        task.load(program_planner.plan(program, robot.motion.home_m, robot).plan)
        first = task.next_cycle
        task.start(first)
        for cycle in range(first, first + 20):
            task.command(cycle)
            task.receive(cycle, home - sign * 0.032, np.zeros(3))
        # the step counts 1 + 2.75 times in the cycle after it: it is taken for a speed and extrapolated
        assert task.figures().following_error_max_rad == pytest.approx(3.75e-3, rel=1e-6)


def test_final_tcp_shows_a_robot_off_its_target_by_the_encoders(robot):
    drift = {'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': 0.05, 'after_s': 0.2}
    trace = run(robot, drift, moves=[*BENT['moves'], {'dwell': {'time_s': 0.01}}])
    assert trace.meta['stopped'] == ''
    final = np.array(trace.meta['figures']['final_tcp_m'])
    encoders = kinematics.forward(trace['motor_position'][-1] / GEAR, robot.kinematics)
    assert final == pytest.approx(encoders, abs=1e-12)
    assert np.linalg.norm(final - trace['tcp_command'][-1]) > 1e-8  # standing, a few increments off


def test_robot_that_does_not_follow_is_not_reported_at_its_target(robot):
    task = Transformation(robot)
    home = kinematics.inverse(robot.motion.home_m, robot.kinematics) * GEAR
    task.locate(home)
    program = programs.parse({'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.8]}}]}, robot.motion)
    task.load(program_planner.plan(program, robot.motion.home_m, robot).plan)
    task.start(0)
    for cycle in range(task.last_cycle + 1):
        task.command(cycle)
        task.receive(cycle, home, np.zeros(3))
    figures = task.figures()
    assert figures.final_tcp_m == pytest.approx(list(robot.motion.home_m), abs=1e-9)
    assert figures.tcp_error_max_m == pytest.approx(
        math.dist((0.1, 0.0, -0.8), robot.motion.home_m), rel=1e-9
    )


@pytest.mark.parametrize('rich', [False, True])
def test_trace_names_its_robot_and_simulation(rich, robot):
    built = (parameters.load('rich') if rich else robot).replace(
        bus__cycle_time_s=2e-3, bus__exchange_period_s=250e-6, dynamics__gear_in=30.0
    )
    short = {'start_m': [0.0, 0.0, -0.75], 'moves': [{'move_l': {'to_m': [0.0, 0.0, -0.76]}}], 'repeat': 1}
    trace = simulation.run(programs.parse(short, built.motion), built)
    assert trace.meta['rich'] is rich
    assert trace.meta['cycle_time_s'] == 2e-3
    assert trace.meta['exchange_period_s'] == 250e-6
    assert trace.meta['gear_ratio'] == 30.0
    assert trace.meta['checksum'] == built.checksum
    assert np.diff(trace.time_s) == pytest.approx(2e-3)
    assert trace.meta['end_cycle'] - trace.meta['start_cycle'] == math.ceil(trace.meta['program_s'] / 2e-3)


def test_lost_ats_of_all_axes_are_reported(robot):
    lost = [
        {'fault': 'drop_at', 'axis': axis, 'after_s': 0.1 * n}
        for n, axis in enumerate(('axis1', 'axis1', 'axis2', 'axis3'), 1)
    ]
    assert run(robot, *lost).meta['lost_telegrams'] == 4


def test_an_emergency_stop_brakes_from_its_own_cycle_on(robot):
    at = 150
    stopped = run(robot, {'fault': 'emergency_stop', 'after_s': at * CYCLE_S})
    free = run(robot)
    rows = min(len(stopped.time_s), len(free.time_s))
    differs = (stopped['motor_command'][:rows] != free['motor_command'][:rows]).any(axis=1)
    first = int(np.flatnonzero(differs)[0])
    # the jerk of the stop moves the command by less than an increment in the first cycles
    assert at <= first - stopped.meta['start_cycle'] <= at + 3
