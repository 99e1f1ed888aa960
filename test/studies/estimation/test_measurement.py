"""Tests of the signals from which parameters are estimated, and of programs that excite them."""

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation import excitation, measurement

# measurement


def test_oscilloscope_has_the_bits_of_the_simulation(program, scope, robot):
    exact = simulation.run(program, robot.replace(bus__exchange_period_s=125e-6))
    cycles = len(exact.time_s)
    for name in ('shaft_position', 'shaft_speed'):
        assert scope[name][: 16 * cycles : 16].tobytes() == exact[name].tobytes()
    assert np.abs(scope['current'][::16] - exact['current']).max() < 1e-12  # K_m I / K_m in the telegram


def test_current_and_voltage_obey_the_winding(scope, robot):
    motor, rows = robot.motor, measurement.moving_rows(scope)
    current, voltage, speed = (scope[name][rows] for name in ('current', 'phase_voltage', 'motor_speed'))
    final = (voltage - motor.torque_constant_n_m_a / 3.0 * speed) / (motor.winding_resistance_ohm / 2.0)
    decay = np.exp(-62.5e-6 * motor.winding_resistance_ohm / motor.winding_inductance_h)
    assert np.abs((final + (current - final) * decay)[:-1] - current[1:]).max() < 1e-12


def test_same_seed_gives_the_same_noise_and_amplitude_zero_no_noise(bus, robot):
    one, again, other = (measurement.with_noise(bus, robot, 1.0, seed) for seed in (3, 3, 4))
    assert one['current'].tobytes() == again['current'].tobytes() != other['current'].tobytes()
    assert np.std(one['current'] - bus['current']) == pytest.approx(measurement.NOISE.current_a, rel=0.05)
    quiet = measurement.with_noise(bus, robot, 0.0, 3)
    assert all(quiet[name].tobytes() == bus[name].tobytes() for name in bus.signals)


def test_an_encoder_with_noise_reads_the_nearest_increment(robot):
    exact = np.random.default_rng(8).uniform(-30.0, 30.0, (5000, 3))
    trace = Trace(1e-3 * np.arange(5000), {'motor_position': exact}, {})
    sigma = measurement.NOISE.sigmas().get('motor_position', 0.0)
    seen = measurement.with_noise(trace, robot, 1.0, 1)['motor_position']
    increment = 2.0 * np.pi / robot.bus.increments_per_rev
    assert np.abs(seen / increment - np.round(seen / increment)).max() < 1e-6
    assert np.abs((seen - exact).mean()) < 0.05 * increment + sigma / 50.0
    assert np.abs(seen - exact).max() <= 0.5 * increment * (1.0 + 1e-6) + 6.0 * sigma


@pytest.mark.parametrize(('first', 'begin', 'end'), [(0.0, 3, 7), (2e-3, 1, 5), (5e-3, 0, 2)])
def test_the_motion_is_from_the_first_cycle_of_the_program_to_its_last_included(first, begin, end):
    times = first + 1e-3 * np.arange(12)
    trace = Trace(times, {}, {'cycle_time_s': 1e-3, 'start_cycle': 3, 'end_cycle': 7})
    assert measurement.moving_rows(trace) == slice(begin, end + 1)


def test_program_with_payload_changes_is_not_a_measurement(robot):
    with pytest.raises(EstimationError, match='payload'):
        measurement.simulate(programs.load('packaging', robot.motion), robot)


# exciting programs


def test_the_packaged_program_excites_better_than_the_experiments(robot):
    packaged = programs.load('excitation', robot.motion)
    for group in ('masses', 'geometry'):
        own = excitation.quality(packaged, group, robot)
        for name in ('experiment1', 'experiment2', 'experiment3'):
            other = excitation.quality(programs.load(name, robot.motion), group, robot)
            assert own.condition < other.condition
    worst = max(
        f.relative_error for f in excitation.quality(packaged, 'masses', robot).findings if f.symbol == 'F_v'
    )
    assert worst < 0.01


@pytest.mark.parametrize('seed', [1, 2])
def test_an_exciting_curve_is_closed_and_fills_nine_tenths_of_the_workspace(seed, robot):
    points = excitation.curve(np.random.default_rng(seed).standard_normal(18), robot)
    k = robot.kinematics
    assert np.hypot(*points[:, :2].T).max() == pytest.approx(0.45 * k.workspace_diameter_m, abs=1e-4)
    middle, half = (
        (k.workspace_top_m + k.workspace_bottom_m) / 2.0,
        (k.workspace_top_m - k.workspace_bottom_m) / 2.0,
    )
    assert [points[:, 2].min(), points[:, 2].max()] == pytest.approx(
        [middle - 0.9 * half, middle + 0.9 * half], abs=1e-4
    )
    program = programs.parse(excitation.document_of(points, 'curve'), robot.motion)
    fast, _, slow = excitation.document_of(points, 'curve')['moves']
    for move, limits in ((fast, excitation.FAST), (slow, excitation.SLOW)):
        through = move['move_sb']['through_m']
        assert [*map(tuple, through)] == [*map(tuple, points[1:]), tuple(points[0])]
        assert {key: move['move_sb'][key] for key in limits} == limits
    assert excitation.FAST['speed_m_s'] > excitation.SLOW['speed_m_s']
    assert program.start_m == pytest.approx(tuple(points[0]))


@pytest.mark.long
def test_a_design_improves_and_the_same_seed_designs_the_same(robot):
    one, again = (excitation.design('geometry', robot, seed=5, tries=3, refinements=8) for _ in range(2))
    assert one.document == again.document
    assert one.condition <= one.first_condition
    assert one.evaluations >= 11
    programs.parse(one.document, robot.motion)


# CSV traces


def test_csv_trace_is_restored_to_the_last_bit(bus, tmp_path):
    back = trace_csv.read(trace_csv.write(bus, tmp_path / 'run.csv'))
    assert back.meta == bus.meta
    assert back.time_s.tobytes() == bus.time_s.tobytes()
    for name in bus.signals:
        assert back[name].tobytes() == bus[name].tobytes()
