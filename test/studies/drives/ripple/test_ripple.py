"""Tests of the ripple of the currents: values in the AT, true values, and the course within a bus cycle."""

import csv
import json
import math

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.drives.ripple import figures, run
from delta3_pacdrive.studies.drives.ripple.study import Results
from delta3_pacdrive.studies.framework.study import silent
from delta3_pacdrive.studies.runs.run_signals import AFTER_S

# peak and rms of all samples of motor 1 in experiment 1, exact exchange, linear [A]
FOUND = {1e-3: (1.18, 0.48), 2e-3: (1.39, 0.49), 4e-3: (2.08, 0.55)}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Make the study of experiment 1; return its folder."""
    path = tmp_path_factory.mktemp('ripple')
    assert main(['ripple', '--output', str(path), '--json']) == 0
    return path


@pytest.fixture(scope='module')
def document(folder):
    return json.loads((folder / 'report.json').read_text(encoding='utf-8'))


def case_of(document, cycle_time_s, interpolation):
    (found,) = (
        case
        for case in document['cases']
        if (case['cycle_time_s'], case['interpolation']) == (cycle_time_s, interpolation)
    )
    return found


@pytest.mark.parametrize('cycle_time_s', FOUND)
def test_all_samples_show_twice_the_current_where_the_at_show_half(cycle_time_s, document):
    linear, cubic = (case_of(document, cycle_time_s, name) for name in ('linear', 'cubic'))
    found = linear['current_peak_a'][0], linear['current_rms_a'][0]
    assert found == pytest.approx(FOUND[cycle_time_s], abs=0.005)
    assert linear['at_current_peak_a'][0] < found[0]
    # with continuous speed the bus cycle does not matter, and the AT tell what there is
    assert cubic['current_peak_a'][0] == pytest.approx(1.105, abs=0.01)
    assert cubic['current_rms_a'][0] == pytest.approx(0.48, abs=0.005)
    assert cubic['at_current_peak_a'][0] == pytest.approx(cubic['current_peak_a'][0], rel=0.01)
    assert cubic['jerk_rad_s3'][0] < 0.2 * linear['jerk_rad_s3'][0]
    assert cubic['tcp_error_max_m'] < linear['tcp_error_max_m']
    assert linear['set_point_delay_s'] == cubic['set_point_delay_s'] == 2.0 * cycle_time_s - 250e-6


def test_the_jerk_grows_with_the_bus_cycle_only_with_linear_interpolation(document):
    linear, cubic = (
        [case_of(document, s, name)['jerk_rad_s3'][0] for s in FOUND] for name in ('linear', 'cubic')
    )
    assert linear[0] < 0.6 * linear[1] < 0.6 * linear[2]
    assert max(cubic) < 1.2 * min(cubic)


def test_the_table_has_a_row_for_each_case_and_axis_with_the_numbers_of_the_report(folder, document):
    lines = (folder / 'ripple.csv').read_text(encoding='utf-8').splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith('#')))
    assert len(rows) == 3 * len(document['cases']) == 18
    for n, row in enumerate(rows):
        case, axis = document['cases'][n // 3], n % 3
        assert int(row['axis']) == axis + 1
        assert row['interpolation'] == case['interpolation']
        for title, key in (
            ('AT peak [A]', 'at_current_peak_a'), ('AT rms [A]', 'at_current_rms_a'), ('peak [A]', 'current_peak_a'),
            ('rms [A]', 'current_rms_a'), ('jerk [rad/s3]', 'jerk_rad_s3'),
        ):  # fmt: skip
            assert float(row[title]) == pytest.approx(case[key][axis], rel=1e-6), title


def test_there_is_a_picture_for_each_cycle_time_and_one_of_all_currents(folder):
    names = {path.name for path in folder.glob('*.png')}
    assert names == {'currents.png', *(f'inside_a_cycle_{n}ms.png' for n in (1, 2, 4))}


def test_the_jerk_is_that_of_the_torque_above_100_hz(robot):
    time_s = np.arange(16000) / 16e3
    slow, fast = 5.0 * np.sin(math.tau * 20.0 * time_s), 0.1 * np.sin(math.tau * 500.0 * time_s)
    found = np.sqrt(np.mean(run.jerk(np.column_stack([slow + fast, slow, fast]), robot) ** 2, axis=0))
    arm = robot.motor.torque_constant_n_m_a * 32.0 / robot.drive.observer_arm_inertia_kg_m2
    expected = arm * 0.1 * math.tau * 500.0 / math.sqrt(2.0)
    assert found == pytest.approx([expected, 0.0, expected], rel=0.01, abs=0.02 * expected)


@pytest.fixture(scope='module')
def short(robot):
    return program_file.parse({'moves': [{'move_l': {'to_m': [0.1, 0.05, -0.8]}}]}, robot.motion)


def test_the_samples_are_those_of_the_simulation_with_the_exact_exchange(short, robot):
    case = run.measure(short, robot, 2, silent)
    trace = simulation.run(short, robot.replace(bus__exchange_period_s=125e-6))
    start = trace.meta['start_cycle']
    rows = slice(start, trace.meta['end_cycle'] + round(AFTER_S / 1e-3))
    of_cycles = case.samples.current.reshape(-1, 16)
    for name, values in (('min', of_cycles.min(axis=1)), ('max', of_cycles.max(axis=1))):
        assert values.tolist() == trace[f'current_{name}'][rows, 1].tolist()
    np.testing.assert_allclose(of_cycles.mean(axis=1), trace['current_mean'][rows, 1], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(case.samples.at_current, trace['current'][rows, 1], rtol=1e-12)
    # AT(k + 1) tells the last sample of cycle k
    np.testing.assert_allclose(case.samples.at_current[1:], of_cycles[:-1, -1], rtol=1e-12)
    peak = np.maximum(trace['current_max'], -trace['current_min'])[rows].max(axis=0)
    assert case.current_peak_a == peak.tolist()
    assert case.tcp_error_max_m == np.linalg.norm(trace['tcp_error'][rows], axis=1).max()


def test_the_picture_shows_one_cycle_before_and_one_after_with_the_samples_of_the_at(short, robot):
    case = run.measure(short, robot, 1, silent)
    figure = figures.inside_a_cycle(Results('short', 1, (case,), 0.02), [case])
    current = figure.axes[2]
    every, told = current.get_lines()[1:3]
    assert len(every.get_xdata()) == 3 * 16
    assert told.get_xdata().tolist() == pytest.approx([-1.0, 0.0, 1.0, 2.0])
    at = dict(zip(np.round(told.get_xdata(), 6), told.get_ydata(), strict=True))
    samples = dict(zip(np.round(every.get_xdata(), 6), every.get_ydata(), strict=True))
    for time_ms in (0.0, 1.0, 2.0):
        assert at[time_ms] == pytest.approx(samples[time_ms], rel=1e-12)


def test_requested_motor_is_shown(tmp_path, capsys):
    program, folder = tmp_path / 'short.yaml', tmp_path / 'out'
    program.write_text('moves: [{move_l: {to_m: [0.1, 0.05, -0.8]}}]\n')
    case = ['--cycle-time', '1', '--interpolation', 'linear', '--axis', '3']
    assert main(['ripple', str(program), *case, '--output', str(folder)]) == 0
    printed = [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]
    document = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    (found,) = document['cases']
    assert printed[0].endswith(', motor 3')
    assert f'{found["current_peak_a"][2]:.2f} / {found["current_rms_a"][2]:.2f}' in ' '.join(printed)
    assert document['axis'] == 3


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (
            ['--at', '50', '--cycle-time', '4', '--interpolation', 'cubic'],
            '--at is 50 s, but the program runs from 0',
        ),
        (['no_such_program'], 'no_such_program'),
    ],
)
def test_invalid_input_of_the_ripple_study_is_rejected_with_one_message(arguments, told, tmp_path, capsys):
    assert main(['ripple', *arguments, '--output', str(tmp_path / 'out')]) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith('error: ')
    assert told in error


def test_a_program_with_faults_is_rejected(tmp_path, capsys):
    program = tmp_path / 'program.yaml'
    program.write_text(
        'moves: [{dwell: {time_s: 0.1}}]\nfaults: [{fault: drop_mdt, axis: axis1, after_s: 0.05}]\n'
    )
    assert main(['ripple', str(program), '--output', str(tmp_path / 'out')]) == 1
    assert 'injects faults' in capsys.readouterr().err
