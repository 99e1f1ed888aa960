"""Tests of a robot that warms up: heat balance, hot motors, monitoring, faults, rotary axes, and identical bits."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import ParameterError, ProgramError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import acquisition
from delta3_pacdrive.recording.signals import THERMAL_SIGNALS
from delta3_pacdrive.robot.drive.diagnostics import DriveWarning
from delta3_pacdrive.robot.faults.fault import parse
from delta3_pacdrive.robot.plant.temperatures import Temperatures
from delta3_pacdrive.studies.runs.derived_signals import loads_of_round

ROBOT = parameters.load('model+thermal')
LINE = {
    'start_m': [-0.1, 0.0, -0.8],
    'repeat': 4,
    'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.8]}}, {'move_l': {'to_m': [-0.1, 0.0, -0.8]}}],
}
TURN = {
    'start_m': [0.0, 0.0, -0.78],
    'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.78], 'turn_deg': 180.0, 'speed_m_s': 1.0}}],
}
PATH_ERROR_M = 1e-3  # as of an intact robot
S1_ERROR_K = 0.05  # the thermal resistances have three digits
STEP_ERROR_K = 0.02  # of steps of 0.48 s, of a transient of 90 s
CURRENT_A = 3.0
SPEED_RAD_S = 200.0


def run(document=LINE, *faults, robot=ROBOT, signals=(), scope=None, **changes):
    robot = robot.replace(**changes)
    if document == 'packaging':
        injected = tuple(parse(fault, 'fault') for fault in faults)
        program = dataclasses.replace(programs.load(document, robot.motion), faults=injected)
    else:
        program = programs.parse(document | {'faults': list(faults)}, robot.motion)
    return simulation.run(program, robot, signals=signals, acquisition=scope)


def after(cycles, robot, axis=0):
    """Temperatures of an axis after bus cycles with a constant current at a constant speed."""
    bodies, axes = Temperatures(robot), len(robot.axes)
    currents = np.full((4, axes), CURRENT_A)
    rows = [bodies.of_axis(axis)]
    for _ in range(cycles):
        for _ in range(4):
            bodies.collect(currents, [SPEED_RAD_S] * axes)
        bodies.end_cycle()
        rows.append(bodies.of_axis(axis))
    return np.array(rows)


def test_motor_gear_and_heat_sink_warm_up_by_their_heat_balance():
    """Another integrator and the numbers of the guide: 3 A rms, 200 rad/s, 20 min."""
    robot = ROBOT.replace(thermal__time_factor=480.0, thermal__ambient_degc=30.0)

    def rates(time_s, state):
        winding, housing, sink = state
        share = 0.6 + 0.4 * np.exp(-time_s / 3600.0)
        copper = 4.05 * 9.0 * (1.0 + 0.00393 * (winding - 20.0))
        flow = (winding - housing) / 0.35
        motor = robot.motor
        friction = motor.static_friction_n_m * SPEED_RAD_S
        friction += share * motor.viscous_friction_n_m_s_rad * SPEED_RAD_S**2
        direct = 40.0 * (SPEED_RAD_S / motor.max_speed_rad_s) ** 1.5 + 0.3 * friction
        return (
            (copper - flow) * 0.35 / 90.0,
            (flow + direct - (housing - 30.0) / 0.648) * 0.648 / 2400.0,
            (12.0 + 5.0 * 3.0 - (sink - 30.0) / 0.9) * 0.9 / 600.0,
        )

    found = after(2500, robot)
    times = 0.48 * np.arange(2501)
    expected = solve_ivp(
        rates, (0.0, 1200.0), (25.0, 25.0, 30.0), 'LSODA', t_eval=times, rtol=1e-9, atol=1e-9
    ).y.T
    assert expected[-1, 0] > 50.0
    assert np.abs(found[:, :3] - expected).max() < STEP_ERROR_K
    assert found[-1, 3] == pytest.approx(0.6 + 0.4 * np.exp(-1200.0 / 3600.0))


def test_the_time_factor_scales_time_only():
    slow, fast = (
        after(n, ROBOT.replace(thermal__time_factor=k))[-1] for n, k in ((2000, 10.0), (200, 100.0))
    )
    assert fast == pytest.approx(slow, abs=1e-3)


def test_a_motor_with_the_nominal_current_at_rest_reaches_its_limit_for_every_axis():
    """The rotary axis has another motor, whose data follow from its nominal current."""
    robot = ROBOT.replace(thermal__ambient_degc=40.0, thermal__time_factor=1e4, rotary__present=True)
    nominal = [*[robot.motor.nominal_current_a] * 3, robot.rotary.nominal_current_a]
    bodies = Temperatures(robot)
    for _ in range(3000):
        bodies.collect(np.tile(nominal, (4, 1)), [0.0] * 4)
        bodies.end_cycle()
    for axis in range(4):
        assert abs(bodies.of_axis(axis)[0] - 140.0) < S1_ERROR_K


def test_a_hot_motor_needs_more_current_and_voltage_for_the_same_motion():
    cold, hot = (run(thermal__start_degc=degc)['current_rms'][200:, 0] for degc in (20.0, 120.0))
    # K_m is 11 % smaller
    assert hot.mean() / cold.mean() == pytest.approx(1.0 / 0.89, rel=0.01)


def test_a_drive_at_rest_applies_the_voltage_of_the_hot_winding():
    dwell = {'start_m': [-0.1, 0.0, -0.8], 'moves': [{'dwell': {'time_s': 1.0}}]}
    measured = []
    for degc in (20.0, 120.0):
        robot, records = ROBOT.replace(thermal__start_degc=degc), []
        setting = acquisition.setting(robot, ['axis1.voltage', 'axis1.current'], 4000.0, 1.0)
        run(dwell, robot=robot, scope=acquisition.Acquisition(setting, records.append))
        voltage, current = records[0].values[400:].mean(axis=0)  # the motor holds the arm
        measured.append(voltage / current)
    # copper: 0.393 % per kelvin; increments of the encoder change the mean voltage of 0.1 s by 1 %
    assert measured[1] / measured[0] == pytest.approx(1.393, rel=0.01)


def test_warm_gears_need_less_current():
    warm = {
        'thermal__warm_up_time_constant_s': 1.0,
        'thermal__time_factor': 100.0,
        'thermal__start_degc': 20.0,
    }
    warm |= {'thermal__winding_time_constant_s': 1e4, 'thermal__housing_time_constant_s': 1e5}
    robot = ROBOT.replace(motor__viscous_friction_n_m_s_rad=1.6e-3)
    square = [
        np.square(run(robot=robot, thermal__warm_friction_share=share, **warm)['current_rms'][200:]).mean()
        for share in (1.0, 0.2)
    ]
    assert square[1] < 0.97 * square[0]


def test_motors_that_do_not_depend_on_their_temperature_move_with_the_same_bits():
    constant = {f'thermal__{name}_coefficient_1_k': 0.0 for name in ('copper', 'magnet')}
    warm = run(thermal__warm_friction_share=1.0, **constant)
    plain = run(robot=parameters.load('model'))
    assert set(warm.signals) - set(plain.signals) == set(THERMAL_SIGNALS)
    for name, values in plain.signals.items():
        np.testing.assert_array_equal(warm[name], values, err_msg=name)


def test_a_winding_warns_and_then_stops_the_robot_on_its_path():
    rise = {
        'thermal__start_degc': 59.5,
        'thermal__motor_warning_degc': 60.0,
        'thermal__winding_limit_degc': 62.0,
    }
    late = {'fault': 'drop_at', 'axis': 'axis1', 'after_s': 1e4}
    trace = run('packaging', late, signals=['drive_warning'], thermal__time_factor=100.0, **rise)
    assert '8915' in trace.meta['stopped']
    warnings, winding = trace['drive_warning'][:, 0].astype(int), trace['winding_temperature'][:, 0]
    warned = int(np.argmax(warnings & DriveWarning.MOTOR_TEMPERATURE > 0))
    # recorded before the next bus cycle
    assert winding[warned - 1] > 60.0 >= winding[warned - 2]
    assert 62.0 < winding.max() < 62.5
    assert np.abs(trace['tcp_error']).max() < PATH_ERROR_M


def test_a_blocked_fan_lets_the_drive_trip():
    blocked = {'fault': 'fan_blocked', 'axis': 'axis3', 'after_s': 0.1}
    trace = run(LINE | {'repeat': 10}, blocked, thermal__time_factor=1e4, thermal__ambient_degc=35.0)
    assert '8917' in trace.meta['stopped']
    sinks = trace['sink_temperature']
    assert sinks[:, 2].max() > 85.0
    assert sinks[:, :2].max() < 60.0  # with their fans


@pytest.mark.parametrize('excess_k', [110.0, 116.0])
def test_an_injected_excess_acts_from_the_next_bus_cycle_on(excess_k):
    fault = {'fault': 'motor_hot', 'axis': 'axis2', 'excess_k': excess_k, 'after_s': 0.1}
    trace = run(LINE, fault)
    winding, first = trace['winding_temperature'], trace.meta['start_cycle'] + 100
    assert winding[first, 1] < 30.0
    assert winding[first + 1, 1] == pytest.approx(winding[first, 1] + excess_k, abs=0.1)
    assert winding[:, [0, 2]].max() < 30.0
    assert ('8915' in trace.meta['stopped']) == (excess_k > 115.0)


def test_faults_of_temperatures_need_their_model():
    for fault in (
        {'fault': 'motor_hot', 'axis': 'axis1', 'excess_k': 10.0},
        {'fault': 'fan_blocked', 'axis': 'axis1'},
    ):
        with pytest.raises(ProgramError, match=r'temperatures are constant \(thermal\.in_drives is false\)'):
            run(LINE, fault, thermal__in_drives=False)


@pytest.mark.parametrize('document', [LINE, TURN])
def test_oscilloscopes_change_no_bit_of_a_robot_that_warms_up(document):
    changes = {'rotary__present': True, 'thermal__time_factor': 1000.0}
    setting = acquisition.setting(ROBOT.replace(**changes), ['axis1.winding_temperature'], 4000.0, 0.4)
    records = []
    plain = run(document, **changes)
    observed = run(document, scope=acquisition.Acquisition(setting, records.append), **changes)
    for name, values in plain.signals.items():
        np.testing.assert_array_equal(observed[name], values, err_msg=name)
    assert records


def test_run_and_shift_agree(tmp_path):
    """The running drives after a shift in one minute, and the temperatures that the run predicts for it."""
    program = LINE | {'repeat': 60}
    robot = ROBOT.replace(thermal__time_factor=480.0)
    trace = run(program, robot=robot)
    predicted = loads_of_round(trace, robot, 60)['temperature']
    end = trace['winding_temperature'][-1]
    shift_h = 480.0 * trace.time_s[-1] / 3600.0
    assert shift_h > 4.0
    assert end == pytest.approx(predicted['winding_degc'], abs=1.5)


@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (
            {'motor_warning_degc': 140.1},
            r'motor_warning_degc is 140\.1, but must not exceed thermal\.winding_limit',
        ),
        (
            {'sink_limit_degc': 74.0},
            r'sink_warning_degc is 75, but must not exceed thermal\.sink_limit_degc \(74\)',
        ),
        ({'time_factor': 0.5}, r'time_factor'),
    ],
)
def test_invalid_temperatures_are_rejected(values, sentence):
    with pytest.raises(ParameterError, match=sentence):
        ROBOT.replaced({f'thermal.{name}': value for name, value in values.items()})


def test_warnings_at_their_limits_are_valid():
    assert ROBOT.replace(thermal__motor_warning_degc=140.0).thermal.motor_warning_degc == 140.0
