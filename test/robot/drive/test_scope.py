"""Tests of the oscilloscope of a drive: correct signals, without effect on the drive."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.robot.drive.arrays import STATE
from delta3_pacdrive.robot.drive.channels import CHANNELS, channel_named, chosen
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.operation_data import TABLE
from delta3_pacdrive.robot.drive.register import Register
from delta3_pacdrive.robot.drive.scope import DriveScope, decimation_of
from delta3_pacdrive.robot.sercos.service_channel import format_idn
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from drive_bench import enabled_drive

CYCLES = 24


def run(drive, exchanges, scope=None, look=lambda: None):
    """Run bus cycles with commands that swing, a shaft that follows; return AT, brake outputs and all currents."""
    told = []
    for n in range(CYCLES):
        shaft = 0.03 * math.sin(0.7 * n - 1.2), 0.5 * math.cos(0.7 * n), 0.02 * n
        drive.begin_cycle(0.03 * math.sin(0.7 * n), CONTROL_ENABLE, *shaft)
        answer = drive.answer.tolist()
        for k in range(exchanges):
            exchange = n * exchanges + k
            released = drive.run_period(*shaft) if scope is None else scope.run_period(exchange, *shaft)
            told.append((answer, released, drive.currents.tolist()))
            look()
    return told


def scope_of(drive, robot, channels, decimation=1):
    blocks = []
    scope = DriveScope(drive, channels, decimation, lambda: robot, blocks.append)
    return scope, blocks


def rows_of(blocks):
    return np.concatenate([block.values for block in blocks])


@pytest.fixture(params=[1e-3, 250e-6, 125e-6])
def exchanging(request, robot):
    return robot.replace(bus__exchange_period_s=request.param), round(1e-3 / request.param)


@pytest.mark.parametrize('rich', [False, True])
def test_a_drive_that_is_looked_into_does_the_same_to_the_last_bit(rich, exchanging):
    robot, exchanges = exchanging
    if rich:
        if exchanges == 1:
            pytest.skip('an elastic gear needs a shorter exchange period')
        robot = parameters.load('rich').replace(bus__exchange_period_s=robot.bus.exchange_period_s)
    plain, observed = enabled_drive(robot), enabled_drive(robot)
    scope, _ = scope_of(observed, robot, tuple(CHANNELS.values()))
    assert run(plain, exchanges) == run(observed, exchanges, scope)
    for name in STATE.names:
        assert np.array_equal(plain.state[name], observed.state[name], equal_nan=True), name


def test_every_period_of_the_current_loop_is_a_sample_and_its_current_is_that_of_the_telegram(exchanging):
    robot, exchanges = exchanging
    drive = enabled_drive(robot)
    scope, blocks = scope_of(drive, robot, [channel_named('motor_current')])
    told = run(drive, exchanges, scope)
    scope.flush()
    assert rows_of(blocks)[:, 0].tolist() == [value for _, _, currents in told for value in currents]
    assert len(rows_of(blocks)) == 16 * CYCLES


@pytest.mark.parametrize('decimation', [1, 3, 5, 16, 40])
def test_decimation_keeps_every_nth_sample_by_its_number(decimation, exchanging):
    robot, exchanges = exchanging
    names = [channel_named('motor_current'), channel_named('voltage')]
    whole, part = (scope_of(enabled_drive(robot), robot, names, every) for every in (1, decimation))
    for scope, _ in (whole, part):
        run(scope.drive, exchanges, scope)
        scope.flush()
    every, kept = rows_of(whole[1]), rows_of(part[1])
    assert whole[1][0].first == 1
    assert np.array_equal(kept, every[decimation - 1 :: decimation])
    numbers = np.concatenate([block.first + np.arange(len(block.values)) for block in part[1]])
    assert numbers.tolist() == list(range(1, len(kept) + 1))


def test_the_last_sample_of_a_bus_cycle_is_that_of_the_next_at(robot):
    drive = enabled_drive(robot)
    scope, blocks = scope_of(drive, robot, [channel_named('current'), channel_named('S-0-0084')], 16)
    told = run(drive, 1, scope)
    scope.flush()
    rows, torques = rows_of(blocks), np.array([answer[2] for answer, _, _ in told])
    assert rows[:-1, 0] * robot.motor.torque_constant_n_m_a == pytest.approx(torques[1:], rel=1e-15)
    assert rows[:-1, 1] == pytest.approx(torques[1:], rel=1e-15)


def test_channels_of_every_kind_match_the_state_of_the_drive(robot):
    drive = enabled_drive(robot)
    names = [
        'phase_current_1',
        'phase_current_2',
        'phase_current_3',
        'encoder_position',
        'encoder_increments',
        'state',
    ]
    scope, blocks = scope_of(drive, robot, [channel_named(name) for name in names], 16)
    seen = []

    def look():
        state = drive.state[0]
        per_rad = float(drive.constants['increments_per_rad'][0])
        position = float(state['increments']) / per_rad
        seen.append([*drive.phase_currents(), position, float(state['increments']), float(state['state'])])

    run(drive, 1, scope, look)
    scope.flush()
    assert rows_of(blocks).tolist() == seen


def test_phase_voltages_are_one_of_three_phases_of_the_voltage_command(robot):
    drive = enabled_drive(robot)
    names = ['voltage', 'phase_voltage_1', 'phase_voltage_2', 'phase_voltage_3']
    scope, blocks = scope_of(drive, robot, [channel_named(name) for name in names])
    run(drive, 1, scope)
    scope.flush()
    rows = rows_of(blocks)
    assert np.abs(rows[:, 0]).max() > 1.0
    assert rows[:, 1:].sum(axis=1) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(rows[:, 1:], axis=1) / math.sqrt(3.0) == pytest.approx(np.abs(rows[:, 0]))


def test_every_idn_that_is_a_number_is_a_channel_with_the_value_of_the_service_channel(robot):
    drive = enabled_drive(robot)
    register = Register(robot, lambda name: float(drive.state[name][0]), lambda _: None, lambda: True)
    shown = {}
    for idn in TABLE:
        try:
            shown[idn] = channel_named(format_idn(idn))
        except ParameterError:
            assert format_idn(idn) == 'S-0-0014'  # the phase is known to the bus, not to the drive's loops
    scope, blocks = scope_of(drive, robot, list(shown.values()), 16)
    run(drive, 1, scope)
    scope.flush()
    assert blocks[-1].values[-1].tolist() == [register.read(idn).value for idn in shown]


def test_a_parameter_that_is_written_is_shown_from_then_on(robot):
    drive, now = enabled_drive(robot), [robot]
    blocks = []
    scope = DriveScope(drive, [channel_named('S-0-0104')], 16, lambda: now[0], blocks.append)
    for n in range(4):
        if n == 2:
            scope.flush()
            now[0] = robot.replace(drive__position_gain_rad_s_rad=70.0)
        drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
        scope.run_period(n, 0.0, 0.0, 0.0)
    scope.flush()
    assert rows_of(blocks)[:, 0].tolist() == [60.0, 60.0, 70.0, 70.0]


def test_missing_periods_are_a_gap_in_the_numbers(robot):
    drive = MC4(robot)
    scope, blocks = scope_of(drive, robot, [channel_named('voltage')])
    for exchange in (0, 1, 5):
        scope.run_period(exchange, 0.0, 0.0, 0.0)
    scope.flush()
    assert [(block.first, len(block.values)) for block in blocks] == [(1, 32), (81, 16)]


def test_blocks_have_eight_bus_cycles(exchanging):
    robot, exchanges = exchanging
    drive = enabled_drive(robot)
    scope, blocks = scope_of(drive, robot, [channel_named('speed')])
    run(drive, exchanges, scope)
    assert [len(block.values) for block in blocks] == [128] * (CYCLES // 8)


@pytest.mark.parametrize(
    ('rate_hz', 'decimation'),
    [(16_000.0, 1), (8_000.0, 2), (1_000.0, 16), (1.0, 16_000), (15_000.0, 2), (5_000.0, 4)],
)
def test_a_rate_is_every_nth_period(rate_hz, decimation, robot):
    assert decimation_of(rate_hz, robot) == decimation


@pytest.mark.parametrize(
    ('texts', 'sentence'),
    [
        (['axis1.curent'], "no channel 'curent': did you mean current"),
        (['axis6.current'], "'axis6.current' is not a valid channel: expected axis1, axis2, axis3, axis4"),
        (['current'], 'such as axis1.current_reference'),
        (['axis1.current'] * 2, 'axis1.current is given twice'),
        ([], 'shows 1 to 8 channels, not 0'),
        (
            [f'axis{n}.{name}' for n in (1, 2, 3) for name in ('speed', 'current', 'voltage')],
            'to 8 channels, not 9',
        ),
        (['axis1.S-0-4000'], 'cannot show S-0-4000'),
        (['axis1.S-0-0014'], 'cannot show S-0-0014'),
    ],
)
def test_undrawable_input_is_reported_with_one_message(texts, sentence):
    with pytest.raises(ParameterError, match=sentence.replace('.', r'\.')):
        chosen(texts)


def test_every_channel_has_a_unit_and_fields_that_exist():
    assert len(CHANNELS) >= 30
    for name, channel in CHANNELS.items():
        assert name == channel.name
        assert channel.unit
        assert set(channel.sources) <= set(STATE.names)
