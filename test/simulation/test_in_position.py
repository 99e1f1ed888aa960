"""Tests of the end of runs: the robot is in position, or the run fails with a message."""

import json
import math

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program import file_reader as programs
from planned import dwell, output, parse, plan, refusal, to

# where the motors hold least
FAR = (0.0, 0.55, -0.9)
# 10 kg that the controller of the thesis does not know of: the plate sags for a while after the end
HEAVY = """
name: heavy
start_m: [0.0, 0.0, -0.75]
payload_kg: 10
moves:
  - move_l: {to_m: [0.0, 0.55, -0.9], speed_m_s: 0.5}
"""
THESIS = ['--parameters', 'delta3']
END_M = 2e-5  # packaged programs end so near their plans


def far(robot):
    return parse(robot, [to(*FAR, speed_m_s=0.5)], start_m=[0.0, 0.0, -0.75])


def hung(robot, kg):
    """Return a robot with something heavy on its plate that its controller knows nothing of."""
    return robot.replace(dynamics__plate_mass_kg=robot.dynamics.plate_mass_kg + kg)


def off(trace):
    """Largest angle of a motor off its command [rad], in each cycle."""
    return np.abs(trace['motor_command'] - trace['motor_position']).max(axis=1)


def test_a_robot_with_25_kg_on_it_is_not_in_position_and_is_stopped(robot):
    meta = simulation.run(far(robot), robot, machine=hung(robot, 25.0)).meta
    assert (
        'not in position 0.5 s after the set points came to rest at the end of the program' in meta['stopped']
    )
    assert meta['stop_source'] in ('axis1', 'axis2', 'axis3')


def test_a_program_ends_when_the_robot_is_in_position(robot):
    exact = simulation.run(far(robot), robot)
    assert len(exact.time_s) == exact.meta['end_cycle'] + SETTLE_CYCLES
    heavy = simulation.run(far(robot), robot, machine=hung(robot, 10.0))
    assert heavy.meta['stopped'] == ''
    assert len(heavy.time_s) > len(exact.time_s)
    cycles = robot.in_position_cycles
    assert (off(heavy)[-cycles:] <= robot.drive.position_window_rad).all()
    assert off(heavy)[-cycles - 1] > robot.drive.position_window_rad
    assert heavy.meta['figures']['final_tcp_m'] == heavy['tcp_actual'][-1].tolist()


@pytest.mark.parametrize(
    ('name', 'value'), [('drive__position_window_rad', 0.1), ('motion__in_position_time_s', 0.05)]
)
def test_window_and_time_decide_when_that_is(name, value, robot):
    machine = hung(robot, 10.0)
    default = simulation.run(far(robot), robot, machine=machine)
    changed = simulation.run(
        far(robot.replace(**{name: value})), robot.replace(**{name: value}), machine=machine
    )
    more = len(changed.time_s) - len(default.time_s)
    assert more >= 40 if name.endswith('time_s') else more < 0


def test_a_timeout_shorter_than_the_settling_decides_at_its_end(robot):
    impatient = robot.replace(motion__in_position_timeout_s=0.0)
    meta = simulation.run(far(impatient), impatient, machine=hung(robot, 10.0)).meta
    assert 'not in position 0.099 s after' in meta['stopped']


def test_an_exact_stop_that_waits_holds_the_motion_until_the_robot_is_there(robot):
    moves = [to(*FAR, speed_m_s=0.5, in_position=True), output(), to(0.0, 0.5, -0.9)]
    program = parse(robot, moves, start_m=[0.0, 0.0, -0.75])
    light = simulation.run(program, robot)
    heavy = simulation.run(program, robot, machine=hung(robot, 10.0))
    stands = np.array(
        [(np.linalg.norm(trace['tcp_command'] - FAR, axis=1) < 1e-9).sum() for trace in (light, heavy)]
    )
    assert stands[0] == pytest.approx(robot.shortest_wait_s / robot.bus.cycle_time_s, abs=1)
    assert stands[1] > stands[0] + 100
    left = int(np.flatnonzero(np.linalg.norm(heavy['tcp_command'] - FAR, axis=1) < 1e-9)[-1])
    seen = left - robot.bus.outstanding_cycles_max  # the answers that tell of it
    window = robot.drive.position_window_rad
    assert (off(heavy)[seen - robot.in_position_cycles + 1 : seen + 1] <= window).all()
    assert off(heavy)[seen - robot.in_position_cycles] > window


def test_plan_reports_the_shortest_wait(robot):
    quick, waits = (
        plan(robot, [to(0.1, 0.0, -0.8, in_position=p), to(0.0, 0.0, -0.8)]) for p in (False, True)
    )
    assert waits.plan.duration_s - quick.plan.duration_s == pytest.approx(robot.shortest_wait_s, abs=1e-12)
    kinds = [move.kind.name for move in waits.plan.moves]
    assert kinds == ['LINE', 'IN_POSITION', 'LINE']


def test_of_a_whole_program_every_exact_stop_waits_and_no_blend(robot):
    moves = [
        to(0.1, 0.0, -0.8, blend_m=0.02),
        to(0.1, 0.1, -0.8),
        dwell(0.1),
        to(0.0, 0.0, -0.8, in_position=False),
    ]
    program = parse(robot, moves, in_position=True)
    assert [getattr(one, 'in_position', None) for one in program.statements] == [False, True, None, False]


def test_a_blend_cannot_wait(robot):
    moves = [to(0.1, 0.0, -0.8, blend_m=0.02, in_position=True), to(0.1, 0.1, -0.8)]
    assert 'moves[0].move_l.in_position: the robot does not stop at a blend' in refusal(parse, robot, moves)
    with pytest.raises(ProgramError, match='in_position'):
        parse(robot, [to(0.1, 0.0, -0.8, in_position='yes')])


def test_output_before_the_end_of_a_waiting_stop_keeps_its_time(robot):
    moves = [
        to(0.1, 0.0, -0.8, in_position=True),
        output(before_m=0.01),
        output('output1'),
        to(0.0, 0.0, -0.8),
    ]
    first, wait, last = plan(robot, moves).plan.moves
    assert [len(move.events) for move in (first, wait, last)] == [1, 0, 1]
    ending = plan(robot, moves[:-1]).plan.moves
    assert [len(move.events) for move in ending] == [1, 1]


@pytest.mark.parametrize('name', ['experiment1', 'packaging', 'excitation'])
def test_packaged_programs_end_where_they_should(name, robot):
    meta = simulation.run(programs.load(name, robot.motion), robot).meta
    assert math.dist(meta['figures']['final_tcp_m'], meta['planned_end_m']) < END_M


def test_the_planned_end_is_that_of_the_program_and_not_of_the_first_move(robot):
    program = parse(robot, [to(0.1, 0.0, -0.8), to(0.0, 0.1, -0.78)], start_m=[0.0, 0.0, -0.75])
    assert simulation.run(program, robot).meta['planned_end_m'] == pytest.approx([0.0, 0.1, -0.78], abs=1e-9)


@pytest.fixture
def impatient(tmp_path):
    """Options that give the robot no time."""
    path = tmp_path / 'impatient.yaml'
    path.write_text('/**:\n  ros__parameters:\n    motion: {in_position_timeout_s: 0.0}\n')
    return ['--parameters', f'delta3+{path}']


def test_simulation_that_misses_its_position_reports_it_and_fails(impatient, tmp_path, capsys):
    path, trace = tmp_path / 'heavy.yaml', tmp_path / 'heavy.npz'
    path.write_text(HEAVY)
    assert main(['simulate', str(path), '--json', '--trace', str(trace), *impatient]) == 1
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result['ok'] is False
    assert 'not in position' in result['error']
    assert f'error: {result["error"]}' in printed.err
    assert trace.exists()  # what went wrong can be looked at


def test_simulation_that_reaches_its_position_succeeds(tmp_path, capsys):
    path = tmp_path / 'heavy.yaml'
    path.write_text(HEAVY)
    assert main(['simulate', str(path), '--json', *THESIS]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['ok'] is True
    assert 'error' not in result
    assert 0.0 < result['end_error_m'] < 1e-3
