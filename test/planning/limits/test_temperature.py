"""Tests of the temperatures of the motors: two bodies, copper and magnets, S1 curve, and plan against run."""

import json
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from delta3_pacdrive import simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.cli.output import currents_used
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.parameters import config_directory, load
from delta3_pacdrive.planning.limits.temperature import (
    HeatLoad,
    Losses,
    Temperatures,
    continuous_torque,
    course,
    heat_load,
    sampled_heat_load,
    steady_state,
)
from delta3_pacdrive.planning.program import file_reader
from delta3_pacdrive.robot.motor_heat import BURNT_DEGC
from delta3_pacdrive.studies.places.planning import evaluation, report
from delta3_pacdrive.studies.runs.derived_signals import loads_of_round

STEP_ERROR_K = 0.05  # of the integration in steps of 4.5 s, for a transient of 90 s
S1_ERROR_K = 0.05  # the thermal resistances have three digits
SHIFT_S = 8 * 3600.0


@pytest.fixture(scope='module')
def robot():
    """Return the robot with the model-based controller."""
    return load('model')


@pytest.fixture(scope='module')
def hall(robot):
    """Return the robot at the ambient temperature of catalogues."""
    return robot.replace(thermal__ambient_degc=40.0)


@pytest.fixture(scope='module')
def linear(robot):
    """Return a robot whose losses do not depend on temperatures."""
    return robot.replace(
        thermal__copper_coefficient_1_k=0.0,
        thermal__magnet_coefficient_1_k=0.0,
        thermal__warm_friction_share=1.0,
        thermal__ambient_degc=20.0,
    )


@pytest.fixture(scope='module')
def packaging(robot):
    """Return a packaged program."""
    return file_reader.load(config_directory() / 'programs' / 'packaging.yaml', robot.motion)


def at_rest(current_a, iron_w=0.0):
    """Losses of a current, which is that for K_m at the reference temperature."""
    return Losses(current_a**2, 0.0, 0.0, iron_w, 0.0, 0.0)


def turning(torque_n_m, speed_rad_s, robot):
    """Load of three motors with a constant torque at a constant speed, when the gears are warm."""
    motor, thermal = robot.motor, robot.thermal
    cold = (1.0 - thermal.warm_friction_share) * motor.viscous_friction_n_m_s_rad * speed_rad_s
    current = (torque_n_m + cold) / motor.torque_constant_n_m_a * np.ones((5, 3))
    return sampled_heat_load(
        np.linspace(0.0, 2.0, 5), speed_rad_s * np.ones((5, 3)), current, current**2, robot
    )


def test_constant_losses_heat_two_bodies_as_the_linear_equations(linear):
    """The matrix exponential of the heat balance, for a loss of 40.5 W in the winding and 20 W in the housing."""
    thermal, found = linear.thermal, course(at_rest(np.sqrt(10.0), iron_w=20.0), linear)
    inner, outer = thermal.winding_to_housing_k_w, thermal.housing_to_ambient_k_w
    winding, housing = thermal.winding_time_constant_s / inner, thermal.housing_time_constant_s / outer
    flow = np.array([[-1 / inner, 1 / inner], [1 / inner, -1 / inner - 1 / outer]])
    matrix = flow / np.array([[winding], [housing]])
    final = 20.0 + np.linalg.solve(-flow, [40.5, 20.0])
    for time_s in (9.0, 90.0, 900.0, 9000.0, SHIFT_S):
        expected = final + expm(matrix * time_s) @ (20.0 - final)
        n = round(time_s / found.time_s[1])
        assert found.time_s[n] == pytest.approx(time_s)
        assert abs(found.winding_degc[n] - expected[0]) < STEP_ERROR_K
        assert abs(found.housing_degc[n] - expected[1]) < STEP_ERROR_K
    assert steady_state(at_rest(np.sqrt(10.0), iron_w=20.0), linear) == pytest.approx(tuple(final))


def test_a_hot_winding_follows_its_equations_while_the_gears_warm_up(hall):
    """Another integrator, with errors below 1e-6 K; every coefficient is that of the guide."""

    def rates(time_s, state):
        winding, housing = state
        share = 0.6 + 0.4 * np.exp(-time_s / 3600.0)
        square = 7.0 + 2.0 * share * 0.8 + share**2 * 1.5
        copper = 4.05 * square * (1.0 + 0.00393 * (winding - 20.0)) / (1.0 - 0.0011 * (winding - 20.0)) ** 2
        flow = (winding - housing) / 0.35
        direct = 8.0 + 0.3 * (10.0 + share * 20.0)
        return (copper - flow) * 0.35 / 90.0, (flow + direct - (housing - 40.0) / 0.648) * 0.648 / 2400.0

    found = course(Losses(7.0, 0.8, 1.5, 8.0, 10.0, 20.0), hall)
    expected = solve_ivp(
        rates, (0.0, SHIFT_S), (40.0, 40.0), 'LSODA', t_eval=found.time_s, rtol=1e-9, atol=1e-9
    ).y
    assert expected[0].max() > 100.0
    assert np.abs(found.winding_degc - expected[0]).max() < STEP_ERROR_K
    assert np.abs(found.housing_degc - expected[1]).max() < STEP_ERROR_K


def test_the_nominal_current_at_rest_reaches_the_limit_of_the_winding(hall):
    """S1 at standstill: 4.1 A flow in the hot motor, whose K_m is 13.2 % smaller."""
    weakened = 1.0 - 0.0011 * 120.0
    final, _ = steady_state(at_rest(weakened * hall.motor.nominal_current_a), hall)
    assert abs(final - 140.0) < S1_ERROR_K
    torque = float(continuous_torque(0.0, hall))
    assert torque == pytest.approx(weakened * 0.78 * 4.1, rel=1e-3)


def test_hot_copper_has_half_as_much_loss_again(hall):
    """The same 140 degC follow from 1.5 R I^2 at the resistance of hot copper."""
    loss_w = 1.5 * 2.7 * 4.1**2 * (1.0 + 0.00393 * 120.0)
    assert loss_w * (0.35 + 0.648) == pytest.approx(100.0, abs=S1_ERROR_K)


def test_continuous_torque_falls_with_the_speed_and_heats_to_the_limit(hall):
    speed = np.linspace(0.0, hall.motor.max_speed_rad_s, 9)
    torque = continuous_torque(speed, hall)
    assert (np.diff(torque) < 0.0).all()
    assert 0.5 < torque[-1] / torque[0] < 0.8
    for one, at in zip(torque.tolist(), speed.tolist(), strict=True):
        found, _ = steady_state(turning(one, at, hall).losses(1, hall.thermal), hall)
        assert found == pytest.approx(140.0, abs=1e-6)
    assert continuous_torque(-speed, hall).tolist() == torque.tolist()
    assert float(continuous_torque(1.001 * hall.motor.max_speed_rad_s, hall)) == 0.0
    lossy = hall.replace(thermal__iron_loss_w=200.0)
    assert float(continuous_torque(hall.motor.max_speed_rad_s, lossy)) == 0.0


def test_a_winding_runs_away_if_its_loss_grows_faster_than_the_heat_that_leaves(hall):
    """1.5 R I^2 (R_wh + R_ha) = 67.9 K, which the loss at 20 degC multiplies by more than it is cooled."""
    found = course(at_rest(4.1), hall)
    assert steady_state(at_rest(4.1), hall) == (np.inf, np.inf)
    assert found.winding_degc[-1] == BURNT_DEGC
    assert 0.0 < found.limit_reached_s < found.time_s[-1] < SHIFT_S
    constant = hall.replace(thermal__copper_coefficient_1_k=0.0, thermal__magnet_coefficient_1_k=0.0)
    assert steady_state(at_rest(4.1), constant)[0] == pytest.approx(40.0 + 1.5 * 2.7 * 4.1**2 * 0.998)
    temperatures = turning(4.1 * 0.78, 0.0, hall).temperatures(hall)
    assert temperatures.steady_winding_degc == (None, None, None)
    assert temperatures.text == 'winding of motor 1 over 300 degC (limit 140) within 8 h at 40 degC ambient'


@pytest.mark.parametrize('current_a', [0.0, 1.0, 3.0])
def test_the_ambient_temperature_is_added_to_constant_losses(current_a, linear):
    warmer = linear.replace(thermal__ambient_degc=40.0)
    one, other = (course(at_rest(current_a), robot) for robot in (linear, warmer))
    assert np.allclose(other.winding_degc - one.winding_degc, 20.0, rtol=0.0, atol=1e-9)
    assert np.allclose(other.housing_degc - one.housing_degc, 20.0, rtol=0.0, atol=1e-9)


def test_a_hotter_hall_heats_copper_by_more_than_its_difference(robot, hall):
    cool, warm = (steady_state(at_rest(3.0), one)[0] for one in (robot, hall))
    assert 15.0 < warm - cool < 40.0


def test_a_motor_without_losses_keeps_the_ambient_temperature(robot):
    found = HeatLoad(np.zeros((3, 3, 3)), *np.zeros((3, 3)), 0.0).temperatures(robot, 1.5)
    assert found.winding_degc == found.housing_degc == found.steady_winding_degc == (25.0, 25.0, 25.0)
    assert found.limit_reached_h == (None, None, None)
    assert found.override_permanent == 1.5
    assert found.warnings() == []


def test_the_time_to_the_limit_is_that_of_the_warming(linear):
    """A winding alone, without resistance of the housing: T = T_end (1 - exp(-t/90 s)) from 0 K to 60 K."""
    alone = linear.replace(
        thermal__winding_to_housing_k_w=1.0,
        thermal__housing_to_ambient_k_w=0.01,
        thermal__winding_limit_degc=80.0,
        thermal__shift_h=1.0,
    )
    current = np.sqrt(120.0 / 1.01 / 4.05)
    found = course(at_rest(current), alone)
    assert found.limit_reached_s == pytest.approx(90.0 * np.log(2.0), rel=0.02)
    assert course(at_rest(0.7 * current), alone).limit_reached_s is None


def test_the_viscous_friction_of_a_gear_falls_as_its_oil_warms_up(robot):
    viscous = Losses(4.0, 1.0, 2.0, 5.0, 10.0, 20.0)
    assert viscous.square_a2(1.0) == 8.0
    assert viscous.square_a2(0.6) == pytest.approx(4.0 + 1.2 + 0.72)
    assert viscous.housing_w(0.6, robot.thermal) == pytest.approx(5.0 + 0.3 * (10.0 + 12.0))
    cold = robot.replace(thermal__warm_friction_share=1.0)
    assert steady_state(viscous, robot)[0] < steady_state(viscous, cold)[0]
    # with warm friction from the start, the first minutes are cooler
    slow, fast = (
        course(viscous, robot.replace(thermal__warm_up_time_constant_s=time_s)) for time_s in (1e5, 1.0)
    )
    assert slow.winding_degc[200] > fast.winding_degc[200] + 1.0
    assert fast.winding_degc[-1] == pytest.approx(steady_state(viscous, robot)[0], abs=0.1)


@pytest.mark.parametrize('override', [0.5, 0.8, 1.2])
def test_losses_at_an_override_are_those_of_the_faster_motion(override, robot):
    """A harmonic motion against gravity with viscous friction, sampled at both speeds."""
    robot = robot.replace(motor__static_friction_n_m=0.0)
    phase, motor = np.linspace(0.0, 2.0 * np.pi, 2001), robot.motor

    def load_at(rate):
        shaft, turn = 200.0 * rate * np.cos(phase), phase[:, None] * np.ones(3)
        standing = 1.0 + 0.5 * np.sin(turn)
        standing += motor.viscous_friction_n_m_s_rad / motor.torque_constant_n_m_a * shaft[:, None]
        moving = -4.0 * rate**2 * np.sin(turn)
        return heat_load(
            SimpleNamespace(
                time_s=phase / (10.0 * rate),
                motor_speed_rad_s=shaft[:, None] * np.ones(3),
                standing_current_a=standing,
                motor_current_a=standing + moving,
            ),
            robot,
        )

    found = load_at(1.0).losses(2, robot.thermal, override)
    assert asdict(found) == pytest.approx(asdict(load_at(override).losses(2, robot.thermal)), abs=1e-9)


def test_the_permanent_override_heats_the_winding_to_its_limit(hall):
    load_a2_s = np.zeros((3, 3, 3))
    load_a2_s[0] = np.diag([2.0, 0.0, 9.0])
    motion = HeatLoad(load_a2_s, *np.zeros((3, 3)), 1.0)
    found = motion.override_permanent(hall, 1.5)
    assert 1.0 < found < 1.5
    below, above = (
        steady_state(motion.losses(0, hall.thermal, one), hall)[0] for one in (found, found + 2e-3)
    )
    assert below <= 140.0 < above
    assert motion.override_permanent(hall, 1.0) == 1.0
    load_a2_s[1, 0, 0] = 4.1**2
    assert HeatLoad(load_a2_s, *np.zeros((3, 3)), 1.0).override_permanent(hall, 1.0) == 0.0


def test_repetitions_of_a_motion_have_its_temperatures(robot):
    one = turning(1.5, 200.0, robot)
    assert one.times(7.0).temperatures(robot).winding_degc == pytest.approx(
        one.temperatures(robot).winding_degc
    )
    half = (one + turning(0.0, 0.0, robot)).losses(0, robot.thermal)
    assert asdict(half) == pytest.approx({k: v / 2 for k, v in asdict(one.losses(0, robot.thermal)).items()})


def test_plan_and_run_answer_alike(packaging, robot):
    planned = evaluation.of_program(packaging, robot)
    trace = simulation.run(packaging, robot)
    found = Temperatures(**loads_of_round(trace, robot, packaging.repeat)['temperature'])
    for name in ('winding_degc', 'housing_degc', 'steady_winding_degc'):
        expected = getattr(planned.temperature, name)
        assert getattr(found, name) == pytest.approx(expected, abs=2.0)  # the drives smooth the peaks
    assert found.override_permanent == 1.0  # at most that of the run
    square = [of.rest_a2 + 2.0 * of.mixed_a2 + of.viscous_a2 for of in _losses(packaging, robot)]
    assert np.sqrt(square) == pytest.approx(planned.planned.rms_current_a, rel=5e-3)


def _losses(program, robot):
    """Mean losses of the motors in the executed program."""
    trace = simulation.run(program, robot)
    own = slice(trace.meta['start_cycle'], trace.meta['end_cycle'] + 1)
    rows = (trace[name][own] for name in ('shaft_speed', 'current', 'current_rms'))
    speed, current, rms = (np.asarray(one, dtype=np.float64) for one in rows)
    load = sampled_heat_load(trace.time_s[own], speed, current, rms**2, robot)
    return [load.losses(n, robot.thermal) for n in range(3)]


def test_a_program_that_is_too_hot_is_warned_of(packaging, robot):
    hot = robot.replace(thermal__ambient_degc=75.0, thermal__winding_limit_degc=100.0)
    found = evaluation.of_program(packaging, hot)
    document = report.document(found, hot)
    reached = document['temperature']['limit_reached_h']
    assert reached[0] > 0.0
    assert reached[1:] == [None, None]
    (sentence,) = [one for one in document['warnings'] if 'winding' in one]
    assert sentence.startswith('the winding of motor 1 reaches 100 degC after ')
    assert sentence.endswith(' at 75 degC ambient if this repeats without a pause')
    assert document['temperature']['override_permanent'] < 1.0
    assert found.temperature.hottest == 0
    assert any(found.temperature.text in line for line in report.text(found, hot))
    used = currents_used(
        {
            'current_rms_a': [1.0] * 3,
            'current_peak_a': [2.0] * 3,
            'temperature': asdict(found.temperature),
        },
        hot,
    )
    assert used['warnings'] == [sentence]


@pytest.mark.parametrize(
    ('reached_h', 'text'), [(2.34, '2.3 h'), (1.0, '1.0 h'), (0.75, '45 min'), (0.001, '4 s')]
)
def test_times_are_in_hours_minutes_or_seconds(reached_h, text):
    found = Temperatures(40.0, 140.0, 8.0, (150.0,), (90.0,), (reached_h,), (None,), 0.999)
    assert found.warnings() == [
        f'the winding of motor 1 reaches 140 degC after {text} at 40 degC ambient if this repeats without a pause'
    ]
    assert found.text.endswith('; permanently possible up to 99 % override')


def test_a_file_without_the_group_has_its_values(tmp_path, robot):
    text = (config_directory() / 'delta3.yaml').read_text(encoding='utf-8')
    old = tmp_path / 'old.yaml'
    old.write_text(text[: text.index('    thermal:')], encoding='utf-8')
    assert load(old) == load()
    assert load(old).checksum == load().replace(thermal__ambient_degc=35.0).checksum


@pytest.mark.parametrize(('ambient', 'limit', 'valid'), [(60.0, 60.0, False), (59.999, 60.0, True)])
def test_the_surroundings_are_cooler_than_the_limit(ambient, limit, valid, robot):
    values = {'thermal.ambient_degc': ambient, 'thermal.winding_limit_degc': limit}
    if valid:
        assert robot.replaced(values).thermal.ambient_degc == ambient
        return
    with pytest.raises(ParameterError, match=r'thermal.ambient_degc is 60, but must be less than'):
        robot.replaced(values)


TURN = {
    'start_m': [0.0, 0.0, -0.78],
    'repeat': 20,
    'moves': [
        {'move_l': {'to_m': [0.1, 0.0, -0.78], 'turn_deg': 180.0}},
        {'move_l': {'to_m': [0.0, 0.0, -0.78], 'turn_deg': 0.0}},
    ],
}


def test_plan_and_run_answer_alike_for_the_motor_of_a_rotary_axis(robot):
    turning = robot.replace(rotary__present=True)
    program = file_reader.parse(TURN, turning.motion)
    planned = evaluation.of_program(program, turning).temperature
    found = Temperatures(**loads_of_round(simulation.run(program, turning), turning, 20)['temperature'])
    assert len(planned.winding_degc) == len(found.winding_degc) == 4
    assert planned.winding_degc[3] > 26.0
    assert found.winding_degc == pytest.approx(planned.winding_degc, abs=2.0)
    assert planned.hottest == int(np.argmax(planned.winding_degc))


def test_a_rotary_axis_limits_the_permanent_override(robot):
    weak = robot.replace(rotary__present=True, rotary__tool_inertia_kg_m2=0.08, thermal__ambient_degc=60.0)
    found = evaluation.of_program(file_reader.parse(TURN, weak.motion), weak).temperature
    assert found.hottest == 3
    assert found.override_permanent < 1.0
    assert found.warnings()[0].startswith('the winding of motor 4 reaches 140 degC')


def test_the_permanent_override_of_a_run_is_that_of_its_plan(robot, packaging):
    hot = robot.replace(thermal__ambient_degc=75.0, thermal__winding_limit_degc=100.0)
    planned = evaluation.of_program(packaging, hot).temperature.override_permanent
    trace = simulation.run(packaging, hot)
    found = loads_of_round(trace, hot, packaging.repeat)['temperature']['override_permanent']
    assert 0.5 < planned < 0.95
    assert found == pytest.approx(planned, abs=0.02)


@pytest.mark.parametrize('command', ['plan', 'simulate'])
def test_ambient_is_the_temperature_of_the_surroundings(command, capsys):
    arguments = [command, 'experiment1', '--ambient', '35', '--json']
    assert main(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['temperature']['ambient_degc'] == 35.0
    assert document['temperature']['winding_degc'][0] > 35.0
    for bad in ('-40.1', '80.1', 'warm'):
        with pytest.raises(SystemExit):
            main([command, 'experiment1', '--ambient', bad])
        assert 'between -40 and 80 degC' in capsys.readouterr().err or bad == 'warm'
