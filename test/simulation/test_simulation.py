"""Tests of whole runs of the machine without ROS: experiment 1, its errors and currents, and equal bits."""

import json
import math

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.errors import ProgramError, RunError, TraceError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.simulation import run
from delta3_pacdrive.simulation.robot import Robot

GEAR = 32.0
INCREMENT_RAD = math.tau / 2**19
END_M = 0.02e-3  # settled position; friction may hold the shafts a few increments off
ALIGNED_M = (0.098e-3, 0.100e-3)  # the study found 0.103 mm with another profile of the same size
PEAK_A = (1.05, 1.07)  # in the AT; the study found 0.80 A with 0.5 kg and 11 m/s2; ours accelerates with 12
PEAK_OF_SAMPLES_A = (1.16, 1.19)


@pytest.fixture(scope='module')
def experiment1(robot):
    return programs.load('experiment1', robot.motion)


@pytest.fixture(scope='module')
def trace(experiment1, robot):
    return run(experiment1, robot)


def short_program(robot, **fields):
    moves = [{'move_l': {'to_m': [0.05, 0.05, -0.80]}}, {'move_l': {'to_m': [0.0, 0.0, -0.75]}}]
    return programs.parse({'moves': moves, **fields}, robot.motion)


def tcp_of(trace, name, robot):
    return kinematics.forward(trace[name] / GEAR, robot.kinematics)


def error_against_command(trace, robot, latency_cycles):
    """Norm of true TCP against the command of ``latency_cycles`` before [m], over the program."""
    command = tcp_of(trace, 'motor_command', robot)
    actual = tcp_of(trace, 'shaft_position', robot)
    cycles = np.arange(len(command))
    due = [np.interp(cycles - latency_cycles, cycles, column) for column in command.T]
    return np.linalg.norm(np.transpose(due) - actual, axis=1)[130:]


def test_experiment_1_ends_where_it_should(trace, robot):
    final = tcp_of(trace, 'shaft_position', robot)[-1]
    assert np.linalg.norm(final - robot.motion.home_m) < END_M
    assert np.linalg.norm(np.array(trace.meta['figures']['final_tcp_m']) - robot.motion.home_m) < END_M


def test_experiment_1_passes_over_its_points(trace, robot):
    tcp = tcp_of(trace, 'shaft_position', robot)
    for place in [(0.0, 0.0, -0.735), (0.3, 0.0, -0.735), (0.3, 0.0, -0.8)]:
        assert (
            np.linalg.norm(tcp - place, axis=1).min() < 0.1e-3
        )  # a corner is a point of rest: the aligned error
    assert np.abs(tcp[:, 1]).max() < 1e-6  # theta_2 = theta_3: y stays zero (11.2.1)
    assert tcp[:, 2].max() < -0.735 + 0.1e-3


def test_the_tcp_follows_within_the_studied_error(trace, robot):
    figures = trace.meta['figures']
    assert ALIGNED_M[0] < figures['tcp_error_max_m'] < ALIGNED_M[1]
    assert figures['tcp_error_rms_m'] == pytest.approx(0.471 * figures['tcp_error_max_m'], rel=0.01)
    own = error_against_command(trace, robot, 1.75).max()
    assert own == pytest.approx(figures['tcp_error_max_m'], rel=0.02)  # true shafts here, encoders there


def test_the_latency_that_minimises_the_error_is_one_cycle_and_three_quarters(trace, robot):
    latencies = np.arange(1.0, 2.51, 0.05)
    rms = [np.sqrt((error_against_command(trace, robot, latency) ** 2).mean()) for latency in latencies]
    assert latencies[np.argmin(rms)] == pytest.approx(1.75, abs=0.06)
    assert error_against_command(trace, robot, 0.0).max() == pytest.approx(
        1.75e-3 * 1.5, rel=0.05
    )  # the raw error


def test_the_following_error_is_free_of_the_dead_time(trace):
    error_deg = np.degrees(np.abs(trace['following_error']).max())
    assert 0.020 < error_deg < 0.022  # the study found 0.018 deg with, and 0.40 deg without


def test_the_motors_draw_the_studied_current(trace):
    peak = np.abs(trace['current']).max()
    assert PEAK_A[0] < peak < PEAK_A[1]
    figures = trace.meta['figures']
    assert max(figures['at_current_peak_a']) == pytest.approx(peak, rel=1e-12)
    assert 0.455 < max(figures['at_current_rms_a']) < 0.465  # the study: 0.40 A
    assert PEAK_OF_SAMPLES_A[0] < max(figures['current_peak_a']) < PEAK_OF_SAMPLES_A[1]
    assert 0.475 < max(figures['current_rms_a']) < 0.485
    assert np.abs(trace['current'][:, 1] - trace['current'][:, 2]).max() < 1e-12  # theta_2 = theta_3


def test_the_encoder_reads_the_true_shaft_and_the_trace_holds_every_signal(trace):
    assert set(trace.signals) == {*SIGNALS, *CURRENT_SIGNALS, *TRUE_SIGNALS}
    cycles = trace.meta['end_cycle'] + SETTLE_CYCLES
    assert trace.time_s.tolist() == [k * 1e-3 for k in range(cycles)]
    for name in trace.signals:
        assert trace[name].shape == (cycles, 3)
        assert np.isfinite(trace[name]).all()
    assert np.abs(trace['motor_position'] - trace['shaft_position']).max() < 0.5001 * INCREMENT_RAD
    with pytest.raises(TraceError, match='no signal temperature'):
        trace['temperature']


def test_two_runs_are_the_same_to_the_last_bit(experiment1, trace, robot):
    again = run(experiment1, robot)
    assert again.meta == trace.meta
    for name in trace.signals:
        assert again[name].tobytes() == trace[name].tobytes()


def test_one_more_idle_cycle_is_another_run(robot):
    program = short_program(robot)
    one, other = run(program, robot), run(program, robot.replace(motion__start_cycle=121))
    assert len(other.time_s) == len(one.time_s) + 1
    assert other['motor_command'][1:].tobytes() == one['motor_command'].tobytes()
    assert np.abs(other['shaft_position'][1:] - one['shaft_position']).max() < 20 * INCREMENT_RAD


@pytest.mark.parametrize('cycle_time_s', [2e-3, 4e-3])
def test_slower_bus_cycles_run_as_well(cycle_time_s, robot):
    slow = robot.replace(bus__cycle_time_s=cycle_time_s, bus__exchange_period_s=125e-6)
    trace = run(short_program(slow), slow)
    final = tcp_of(trace, 'shaft_position', robot)[-1]
    assert np.linalg.norm(final - robot.motion.home_m) < END_M
    # CT on the bus and CT - T_pos of interpolation, in cycles
    latency = 1.0 + (cycle_time_s - 250e-6) / cycle_time_s
    assert error_against_command(trace, slow, latency)[:-10].max() < 0.3e-3 * (cycle_time_s / 1e-3) ** 2
    assert trace.meta['figures']['tcp_error_max_m'] < 0.12e-3


@pytest.mark.parametrize('exchange_period_s', [125e-6, 250e-6, 500e-6])
def test_shorter_exchanges_give_the_same_motion(exchange_period_s, experiment1, trace, robot):
    finer = run(experiment1, robot.replace(bus__exchange_period_s=exchange_period_s))
    assert finer['motor_command'].tobytes() == trace['motor_command'].tobytes()
    assert finer['shaft_position'].tobytes() != trace['shaft_position'].tobytes()
    distance = np.linalg.norm(
        tcp_of(finer, 'shaft_position', robot) - tcp_of(trace, 'shaft_position', robot), axis=1
    )
    assert distance.max() < 0.01e-3


def test_a_program_that_starts_elsewhere_finds_the_robot_there(robot):
    start = [0.1, -0.2, -0.85]
    trace = run(short_program(robot, start_m=start), robot)
    assert tcp_of(trace, 'shaft_position', robot)[0] == pytest.approx(start, abs=1e-12)
    assert np.linalg.norm(tcp_of(trace, 'shaft_position', robot)[-1] - robot.motion.home_m) < END_M


def test_payload_and_feed_forward_matter_as_they_should(experiment1, trace, robot):
    heavy = run(experiment1, robot.replace(dynamics__payload_mass_kg=2.0))
    assert 1.2 < np.abs(heavy['current']).max() / np.abs(trace['current']).max() < 1.8
    blind = run(
        experiment1, robot.replace(drive__velocity_feedforward=0.0, drive__following_error_limit_rad=100.0)
    )
    lag = error_against_command(blind, robot, 1.75).max()
    assert 0.015 < lag < 0.03  # about v / K_Ppos: the study found 23 mm


def test_a_drive_that_trips_ends_the_run_with_its_name_and_cause(experiment1, robot):
    with pytest.raises(RunError, match=r'axis[123] is not enabled in bus cycle \d+: 8111 .*following error'):
        run(experiment1, robot.replace(drive__following_error_limit_rad=0.00125))


def test_a_program_cannot_start_before_the_drives_are_enabled(experiment1, robot):
    with pytest.raises(RunError, match=r'axis1 is not enabled in bus cycle 30: enabling'):
        run(experiment1, robot.replace(motion__start_cycle=30))
    with pytest.raises(RunError, match='must not be negative'):
        run(experiment1, robot.replace(motion__start_cycle=-1))


def test_a_program_beyond_a_limit_moves_nothing(robot):
    with pytest.raises(ProgramError, match='distance from the z axis'):
        run(programs.parse({'moves': [{'move_l': {'to_m': [0.9, 0, -0.8]}}]}, robot.motion), robot)


def test_robot_is_at_rest_while_it_is_not_enabled(robot):
    standing = Robot(robot)
    start = standing.plant.shafts()[:6]
    commands = np.array(standing.encoder_positions())
    for _ in range(100):
        standing.cycle(commands, 0)
    assert standing.plant.shafts()[:6] == start
    assert not standing.answers[2].any()


def test_batch_of_bus_cycles_has_the_bits_of_single_ones(robot):
    at_once, one_by_one = Robot(robot), Robot(robot)
    commands = np.array(at_once.encoder_positions()) + np.linspace(0.0, 0.02, 300)[:, None]
    expected = []
    for row in commands:
        one_by_one.cycle(row, CONTROL_ENABLE)
        expected.append(one_by_one.answers.copy())
    assert at_once.run(commands, CONTROL_ENABLE).tobytes() == np.array(expected).tobytes()
    assert at_once.plant.state.tobytes() == one_by_one.plant.state.tobytes()


def test_a_trace_survives_its_file_to_the_last_bit(trace, tmp_path):
    trace.save(tmp_path / 'run.npz')
    back = Trace.load(tmp_path / 'run.npz')
    assert back.meta == trace.meta
    assert back.time_s.tobytes() == trace.time_s.tobytes()
    for name in trace.signals:
        assert back[name].tobytes() == trace[name].tobytes()


def test_truncated_or_damaged_trace_file_is_rejected_with_one_message(trace, tmp_path):
    path = tmp_path / 'run.npz'
    trace.save(path)
    content = path.read_bytes()
    damaged = bytearray(content)
    damaged[len(content) // 2] ^= 0xFF
    for wrong in (content[:100], content[: len(content) // 2], content[:-1], bytes(damaged)):
        path.write_bytes(wrong)
        with pytest.raises(TraceError) as caught:
            Trace.load(path)
        assert str(path) in str(caught.value)
        assert '\n' not in str(caught.value)


@pytest.mark.parametrize('content', [None, b'', b'not an archive', b'PK\x05\x06' + bytes(18)])
def test_invalid_trace_file_is_rejected_with_one_message(content, tmp_path):
    path = tmp_path / 'run.npz'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(TraceError) as caught:
        Trace.load(path)
    assert str(path) in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(('option', 'period_s'), [([], 1e-3), (['--exchange-period', '125e-6'], 125e-6)])
def test_command_simulates_with_the_requested_exchange_period(
    option, period_s, experiment1, robot, tmp_path, capsys
):
    assert main(['simulate', *option, '--trace', str(tmp_path / 'run.npz'), '--json']) == 0
    result, back = json.loads(capsys.readouterr().out), Trace.load(tmp_path / 'run.npz')
    own = run(experiment1, robot.replace(bus__exchange_period_s=period_s))
    assert back.meta['exchange_period_s'] == period_s
    for name in own.signals:
        assert back[name].tobytes() == own[name].tobytes()
    # what is printed is what happened
    assert result['cycles'] == len(own.time_s)
    assert result['bus_time_s'] == pytest.approx(own.time_s[-1] + robot.bus.cycle_time_s)
    norms = np.linalg.norm(own['tcp_error'], axis=1)
    assert result['tcp_error_max_m'] == pytest.approx(norms.max(), rel=1e-9)
