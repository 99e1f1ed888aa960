"""Facts about arriving: a program that ends off its plan says so and fails."""

import json
import math

import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.motion import arrival
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.motion.arrival import ARRIVAL_TOLERANCE_M

END_M = [0.1, 0.0, -0.8]
# too much for the gains, which are tuned to the rated 2 kg: the plate sags for a while after the end
HEAVY = """
name: heavy
start_m: [0.0, 0.0, -0.75]
payload_kg: 10
moves:
  - move_l: {to_m: [0.0, 0.55, -0.9], speed_m_s: 0.5}
"""


def off(distance_m):
    return [END_M[0], END_M[1] + 0.6 * distance_m, END_M[2] - 0.8 * distance_m]


def test_within_the_tolerance_the_robot_has_arrived_and_beyond_it_has_not():
    assert arrival.why_not_arrived(off(0.999 * ARRIVAL_TOLERANCE_M), END_M) is None
    told = arrival.why_not_arrived(off(1.001 * ARRIVAL_TOLERANCE_M), END_M)
    assert told is not None
    assert '0.100 mm off its planned end (0.1, 0, -0.8) m' in told
    assert arrival.end_error_m(off(0.003), END_M) == pytest.approx(0.003, rel=1e-9)


def test_a_robot_that_cannot_be_located_has_not_arrived():
    assert arrival.why_not_arrived([math.nan, 0.0, 0.0], END_M) is not None


@pytest.mark.parametrize('name', ['experiment1', 'packaging', 'excitation'])
def test_packaged_programs_arrive_with_room(name, robot):
    meta = simulation.run(programs.load(name, robot.motion), robot).meta
    assert (
        arrival.end_error_m(meta['figures']['final_tcp_m'], meta['planned_end_m']) < 0.2 * ARRIVAL_TOLERANCE_M
    )


def test_the_planned_end_is_that_of_the_program_and_not_of_the_first_move(robot):
    moves = [{'move_l': {'to_m': [0.1, 0.0, -0.8]}}, {'move_l': {'to_m': [0.0, 0.1, -0.78]}}]
    program = programs.parse({'start_m': [0.0, 0.0, -0.75], 'moves': moves}, robot.motion)
    assert simulation.run(program, robot).meta['planned_end_m'] == pytest.approx([0.0, 0.1, -0.78], abs=1e-9)


def test_a_simulation_that_does_not_arrive_says_so_and_fails(tmp_path, capsys):
    path, trace = tmp_path / 'heavy.yaml', tmp_path / 'heavy.npz'
    path.write_text(HEAVY)
    thesis = ['--parameters', 'delta3']  # whose controller does not know of the payload
    assert main(['simulate', str(path), '--json', '--trace', str(trace), *thesis]) == 1
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result['ok'] is False
    assert result['end_error_m'] > ARRIVAL_TOLERANCE_M
    assert 'has not arrived' in result['error']
    assert f'error: {result["error"]}' in printed.err
    assert trace.exists()  # what went wrong can be looked at
    assert main(['simulate', str(path), *thesis]) == 1
    assert 'heavy: not arrived' in capsys.readouterr().out


def test_a_simulation_that_arrives_succeeds(capsys):
    assert main(['simulate', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['ok'] is True
    assert 'error' not in result
    assert result['end_error_m'] < ARRIVAL_TOLERANCE_M
