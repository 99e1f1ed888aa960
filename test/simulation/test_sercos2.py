"""Tests of runs with the timing of SERCOS II: every set point takes effect one bus cycle later, with the same bits."""

import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters, simulation
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS
from delta3_pacdrive.simulation.cycle import SimulatedOperation
from delta3_pacdrive.simulation.robot import Robot

# of the motors; the TCP by forward kinematics follows from the positions
FEEDBACK = ('motor_position', 'motor_speed', 'current', 'tcp_actual', 'shaft_position', *CURRENT_SIGNALS)
LINE = [{'move_l': {'to_m': [0.3, 0.1, -0.85], 'speed_m_s': 1.0}}]
TURN = [{'move_l': {'to_m': [0.1, 0.0, -0.8], 'speed_m_s': 1.0, 'turn_deg': 90.0}}]


def both(source, moves, **fields):
    """Return runs with the timing of the thesis and with that of SERCOS II."""
    thesis = parameters.load(source)
    robots = thesis, thesis.replace(bus__timing='sercos2')
    return [
        simulation.run(programs.parse({'moves': moves, **fields}, robot.motion), robot) for robot in robots
    ]


@pytest.mark.parametrize(
    ('source', 'moves'),
    [('delta3', LINE), ('model', LINE), ('model+rotary', TURN)],
)
def test_the_robot_does_the_same_one_cycle_later(source, moves):
    before, after = both(source, moves)
    assert after['motor_command'].tobytes() == before['motor_command'].tobytes()
    for name in FEEDBACK:
        assert after[name][1:].tobytes() == before[name][:-1].tobytes(), name
    # the error without the dead time is the same, so the controller removes all of it
    assert after['tcp_error'][1:].tobytes() == before['tcp_error'][:-1].tobytes()
    if 'turn_true' in before.signals:
        assert after['turn_true'][1:].tobytes() == before['turn_true'][:-1].tobytes()
        assert np.abs(before['turn_true']).max() > 1.5


@pytest.mark.parametrize('cycle_time_s', [1e-3, 2e-3, 4e-3])
def test_the_raw_error_is_that_of_one_more_cycle(cycle_time_s):
    raw = {}
    for source in ('delta3', 'delta3+sercos2'):
        robot = parameters.load(source).replace(bus__cycle_time_s=cycle_time_s, bus__exchange_period_s=125e-6)
        trace = simulation.run(programs.parse({'moves': LINE}, robot.motion), robot)
        raw[source] = np.linalg.norm(trace['tcp_command'] - trace['tcp_actual'], axis=1).max()
    assert robot.set_point_delay_cycles == 3.0 - 250e-6 / cycle_time_s
    assert raw['delta3+sercos2'] - raw['delta3'] == pytest.approx(1.0 * cycle_time_s, rel=0.01)  # at 1 m/s


def test_the_latency_that_minimises_the_error_is_two_cycles_and_three_quarters():
    _, trace = both('delta3', LINE)
    robot = parameters.load()
    shafts = trace['shaft_position'] / robot.dynamics.gear_ratio
    command, actual = trace['tcp_command'], kinematics.forward(shafts, robot.kinematics)
    cycles = np.arange(len(command))

    def rms(latency):
        due = np.transpose([np.interp(cycles - latency, cycles, column) for column in command.T])
        return math.sqrt(((due - actual)[130:] ** 2).sum(axis=1).mean())

    latencies = np.arange(2.0, 3.51, 0.05)
    assert latencies[np.argmin([rms(one) for one in latencies])] == pytest.approx(2.75, abs=0.06)


@pytest.mark.parametrize('source', ['delta3', 'model'])
def test_a_lost_mdt_is_bridged_as_one_cycle_before(source):
    fault = {'fault': 'drop_mdt', 'axis': 'axis2', 'after_s': 0.2}
    before, after = both(source, LINE, faults=[fault])
    assert (after.meta['lost_telegrams'], after.meta['stopped']) == (before.meta['lost_telegrams'], '')
    assert after['motor_position'][1:].tobytes() == before['motor_position'][:-1].tobytes()
    whole, _ = both(source, LINE)
    assert np.abs(before['motor_position'] - whole['motor_position']).max() > 0.0


def test_two_lost_mdt_stop_the_drive_in_the_same_cycle():
    fault = {'fault': 'drop_mdt', 'axis': 'axis2', 'cycles': 2, 'after_s': 0.2}
    before, after = both('delta3', LINE, faults=[fault])
    assert '8112 telegram invalid' in after.meta['stopped']
    assert after.meta['stop_cycle'] == before.meta['stop_cycle']


def test_the_built_robot_is_as_exact():
    figures = [trace.meta['figures']['tcp_error_max_m'] for trace in both('built+model', LINE)]
    assert figures[1] == pytest.approx(figures[0], rel=0.05)  # other noise of the sensors in each cycle


def test_the_robot_must_be_in_position_after_the_longer_dead_time():
    thesis, later = parameters.load('delta3'), parameters.load('delta3+sercos2')
    assert later.shortest_wait_s == pytest.approx(thesis.shortest_wait_s + 1e-3, rel=1e-12)


@pytest.mark.parametrize(('kind', 'counted'), [('drop_mdt', (2, 2)), ('corrupt_mdt', (0, 2))])
def test_a_garbled_mdt_still_synchronises(kind, counted):
    """Each loss counter counts its own telegram: S-0-0028 the MST, S-0-0029 the MDT."""
    robot = parameters.load()
    faults = [{'fault': kind, 'axis': 'axis2', 'after_s': after_s} for after_s in (0.1, 0.2)]
    program = programs.parse({'moves': LINE, 'faults': faults}, robot.motion)
    machine, task = Robot(robot), Transformation(robot)
    task.load(program_planner.plan(program, task.locate(machine.encoder_positions()), robot).plan)
    task.enable(robot.motion.enable_cycle)
    task.start(robot.motion.start_cycle)
    SimulatedOperation(machine, task, program.faults, robot).run()
    for drive, expected in zip(machine.drives, ((0, 0), counted, (0, 0)), strict=True):
        assert (int(drive.state['mst_losses'][0]), int(drive.state['mdt_losses'][0])) == expected
