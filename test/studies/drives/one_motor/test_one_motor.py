"""Tests of a single motor (8.2): one MC-4, one motor, a load in place of the arms."""

import dataclasses
import json

import numpy as np
import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.studies.drives.one_motor import figures, report
from delta3_pacdrive.studies.drives.one_motor.run import run_motor
from delta3_pacdrive.studies.framework.study import silent
from reports_read import curves

ROTOR = 0.807e-4  # kg m2
GEAR = 32.0


@pytest.fixture(scope='module')
def short(robot):
    return program_file.parse(
        {'start_m': [0.0, 0.0, -0.75], 'moves': [{'move_l': {'to_m': [0.06, 0.03, -0.79]}}]}, robot.motion
    )


def single(short, robot, **motor):
    changed = robot.replace(**{f'motor__{name}': value for name, value in motor.items()})
    return run_motor(short, changed, 2, silent)


@pytest.fixture(scope='module')
def as_in_robot(short, robot):
    return single(short, robot, coupling_effect=1.0)


def test_with_the_coupling_of_the_arms_the_motor_moves_as_in_the_robot(as_in_robot):
    """I_Load is A_bar less the rotor: the rest is d (4.29), held for two steps here."""
    rows = as_in_robot.driven
    apart = np.abs(as_in_robot.position - as_in_robot.in_robot)[rows]
    assert np.ptp(as_in_robot.position[rows]) > 3.0
    assert apart.max() < 2e-4
    assert as_in_robot.inertia_kg_m2 == pytest.approx(ROTOR + 0.86 / GEAR**2)


def test_torque_less_friction_load_and_coupling_accelerates_the_shaft(short, robot, as_in_robot):
    found = single(short, robot, coupling_effect=0.5, load_torque_n_m=6.4, load_inertia_kg_m2=0.3)
    rest = found.torque - found.friction - found.load - found.coupling
    rows = found.driven
    mean, felt = (values[rows].reshape(-1, 2).mean(axis=1) for values in (rest, found.acceleration))
    # the friction is that of the start of a period, the acceleration that of the middle
    np.testing.assert_allclose(mean[:-1], found.inertia_kg_m2 * felt[:-1], atol=0.01)
    assert found.load == pytest.approx(6.4 / GEAR)
    # beside the load it feels half of what the arms of the robot make it feel
    np.testing.assert_allclose(found.coupling, 0.5 * as_in_robot.coupling, atol=1e-9)
    assert found.inertia_kg_m2 == pytest.approx(ROTOR + 0.3 / GEAR**2)
    # it has nearly come to rest at last: the motor holds load and half of the coupling
    assert found.torque[-1] == pytest.approx(
        found.load[-1] + found.coupling[-1] + found.friction[-1], abs=6e-3
    )


def test_holding_torque_is_zero_without_load_torque_and_coupling(short, robot):
    alone = single(short, robot)
    assert abs(alone.current[-1]) < 0.02
    assert not alone.coupling.any()
    assert not alone.load.any()
    assert np.abs(alone.position - alone.in_robot)[alone.driven].max() < 0.02


def test_effective_current_and_phase_currents_are_one(as_in_robot):
    phases = as_in_robot.phase_currents
    np.testing.assert_allclose(phases.sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.sqrt((phases**2).sum(axis=1) / 3.0), np.abs(as_in_robot.current), atol=1e-9)


SIGNALS = {
    'time [s]': 'time_s', 'command [rad]': 'command', 'reference [rad]': 'reference', 'position [rad]': 'position',
    'speed [rad/s]': 'speed', 'current [A]': 'current', 'voltage [V]': 'voltage', 'torque [N m]': 'torque',
    'friction [N m]': 'friction', 'load [N m]': 'load', 'coupling [N m]': 'coupling',
}  # fmt: skip


def test_the_table_has_each_signal_under_its_name_every_period_of_the_position_loop(as_in_robot):
    (table,) = report.tables(as_in_robot)
    columns = dict(zip(table.header, np.array(table.rows).T, strict=True))
    assert np.diff(columns['time [s]']) == pytest.approx(250e-6)
    for heading, name in SIGNALS.items():
        np.testing.assert_array_equal(columns.pop(heading), getattr(as_in_robot, name)[::4])
    phases = np.stack([columns.pop(f'I{n}s [A]') for n in (1, 2, 3)], axis=-1)
    np.testing.assert_array_equal(phases, as_in_robot.phase_currents[::4])
    assert not columns


def test_largest_values_are_those_of_either_sign(as_in_robot):
    names = ('current', 'speed', 'voltage', 'position_error')
    other = dataclasses.replace(as_in_robot, **{name: -getattr(as_in_robot, name) for name in names})
    one, mirrored = report.summary(as_in_robot), report.summary(other)
    for key in ('current_peak_a', 'speed_max_rad_s', 'voltage_max_v', 'position_error_max_rad'):
        assert one[key] == mirrored[key] > 0.0, key
    assert mirrored['final_error_rad'] == -one['final_error_rad']


def test_figure_8_2_shows_each_signal_in_the_unit_of_its_axis(as_in_robot):
    found, rows = as_in_robot, as_in_robot.driven
    expected = {
        ('position [rad]', 'command on the bus'): found.command,
        ('position [rad]', 'shaft'): found.position,
        ('deviation [mrad]', 'set point less shaft'): 1e3 * (found.reference - found.position),
        ('deviation [mrad]', 'shaft in the robot less this one'): 1e3 * (found.in_robot - found.position),
        ('speed [rad/s]', 'reference'): found.speed_reference,
        ('speed [rad/s]', 'shaft'): found.speed,
        ('current [A]', 'reference'): found.current_reference,
        ('current [A]', '$I_{eff}$'): found.current,
    }
    drawn = {
        (unit, label): values for (_, unit, label), values in curves(figures.motor_and_drive(found)).items()
    }
    for key, values in expected.items():
        np.testing.assert_allclose(drawn[key], values[rows], rtol=1e-12, atol=1e-12, err_msg=str(key))


def test_figures_8_3_and_8_4_show_the_currents_and_the_torques_by_their_names(as_in_robot):
    found, rows = as_in_robot, as_in_robot.driven
    rest = found.torque - found.friction - found.load - found.coupling
    for figure, expected in (
        (figures.phase_currents, {f'$I_{{{n + 1}s}}$': found.phase_currents[:, n] for n in range(3)}),
        (figures.phase_currents, {'$I_{eff}$': found.current, 'of a phase, rms': found.voltage}),
        (figures.torques, {'$K_m I_{eff}$': found.torque, 'friction': found.friction, 'remainder': rest}),
        (figures.torques, {r'$\tau_{load} / k_r$': found.load, 'CE d': found.coupling}),
        (figures.torques, {'inertia times acceleration': found.inertia_kg_m2 * found.acceleration}),
    ):
        drawn = {label: values for (*_, label), values in curves(figure(found)).items()}
        for label, values in expected.items():
            np.testing.assert_allclose(drawn[label], values[rows], err_msg=label)


def test_the_folder_has_figures_8_2_to_8_4_and_the_trace_reads_back(tmp_path, capsys):
    trace = tmp_path / 'motor.npz'
    arguments = ['--axis', '3', '--coupling', '1', '--output', str(tmp_path / 'out'), '--trace', str(trace)]
    assert main(['simulate', 'experiment2', '--one-motor', *arguments, '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert {path.name for path in (tmp_path / 'out').glob('*.png')} == {
        'figure_8_2_motor_and_drive.png',
        'figure_8_3_phase_currents.png',
        'figure_8_4_torques.png',
    }
    assert (document['axis'], document['coupling_effect']) == (3, 1.0)
    assert document['from_robot_max_rad'] < 2e-4
    loaded = trace_file.load(trace)
    rows = loaded.time_s >= loaded.meta['start_cycle'] * loaded.meta['cycle_time_s'] - 1e-9
    assert np.abs(loaded['current'][rows, 2]).max() == document['current_peak_a']
    assert not loaded['current'][:, :2].any()
    assert loaded['phase_current'].any(axis=0).all()


def test_the_load_of_the_command_line_is_the_load_of_the_motor(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'short.yaml').write_text('moves: [{move_l: {to_m: [0.02, 0.0, -0.76]}}]\n', encoding='utf-8')
    load = ['--load-inertia', '0.3', '--load-torque', '6.4']
    assert main(['simulate', 'short.yaml', '--one-motor', *load, '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document['load_inertia_kg_m2'], document['load_torque_n_m']) == (0.3, 6.4)
    assert document['shaft_inertia_kg_m2'] == pytest.approx(ROTOR + 0.3 / GEAR**2)
    assert (tmp_path / 'one_motor' / 'index.html').exists()  # where nothing else is asked for


def test_a_trace_as_csv_holds_the_same_numbers(as_in_robot, tmp_path):
    trace = report.trace(as_in_robot)
    trace_file.save(trace, tmp_path / 'motor.csv')
    again = trace_file.load(tmp_path / 'motor.csv')
    assert set(again.signals) == set(trace.signals)
    for name in trace.signals:
        np.testing.assert_array_equal(again[name], trace[name])


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (['--one-motor', '--parameters', 'rich'], 'rich.gear'),
        (['--one-motor', '--exchange-period', '250e-6'], '--exchange-period is not for --one-motor'),
        (['pick_with_faults.yaml', '--one-motor'], 'injects faults'),
    ],
)
def test_program_unsuited_for_a_single_motor_is_rejected_with_one_message(
    arguments, told, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'pick_with_faults.yaml').write_text(
        'moves:\n- dwell: {time_s: 0.1}\nfaults:\n- {fault: drop_mdt, axis: axis1, after_s: 0.05}\n',
        encoding='utf-8',
    )
    assert main(['simulate', *arguments]) == 1
    assert told in capsys.readouterr().err.splitlines()[-1]


def test_options_of_a_single_motor_are_for_it_alone(capsys):
    with pytest.raises(SystemExit):
        main(['simulate', '--coupling', '1'])
    assert '--coupling requires --one-motor' in capsys.readouterr().err
