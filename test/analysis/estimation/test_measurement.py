"""Facts about the signals that parameters are estimated from, and about programs that excite them."""

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.analysis.estimation import excitation, measurement
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.recording import trace_csv

# measurement


def test_the_oscilloscope_sees_the_simulation_to_the_last_bit(program, scope, robot):
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


def test_the_same_seed_is_the_same_noise_and_no_noise_is_none(bus, robot):
    one, again, other = (measurement.with_noise(bus, robot, 1.0, seed) for seed in (3, 3, 4))
    assert one['current'].tobytes() == again['current'].tobytes() != other['current'].tobytes()
    assert np.std(one['current'] - bus['current']) == pytest.approx(measurement.NOISE.current_a, rel=0.05)
    quiet = measurement.with_noise(bus, robot, 0.0, 3)
    assert all(quiet[name].tobytes() == bus[name].tobytes() for name in bus.signals)


def test_a_program_that_changes_the_payload_is_no_measurement(robot):
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


def test_a_design_improves_and_the_same_seed_designs_the_same(robot):
    one, again = (excitation.design('geometry', robot, seed=5, tries=3, refinements=8) for _ in range(2))
    assert one.document == again.document
    assert one.condition <= one.first_condition
    assert one.evaluations >= 11
    programs.parse(one.document, robot.motion)


# CSV traces


def test_a_csv_trace_comes_back_to_the_last_bit(bus, tmp_path):
    back = trace_csv.read(trace_csv.write(bus, tmp_path / 'run.csv'))
    assert back.meta == bus.meta
    assert back.time_s.tobytes() == bus.time_s.tobytes()
    for name in bus.signals:
        assert back[name].tobytes() == bus[name].tobytes()
