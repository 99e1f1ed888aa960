"""Tests of a complete calibration of the built robot in simulation, and of its files."""

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.simulation import run
from delta3_pacdrive.studies.calibration import estimation, figures, measurement_file, model, simulated
from delta3_pacdrive.studies.calibration.run import Study
from delta3_pacdrive.studies.calibration.study import Measurements, Method, Requirements, Result, Settings
from delta3_pacdrive.studies.framework.study import silent
from measured import TRUTH, planned
from reports_read import curves, read_line

GOAL_M = 0.03e-3


def study(folder, method='base', number=24, checks=8, noise_m=2e-5, simulate='rich', chosen=None, **more):
    wanted = Requirements(Method(method), number, checks, noise_m, **more)
    return Study(Settings(chosen, simulate, wanted, 0), folder, 'delta3 calibrate', silent)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('calibration')


@pytest.fixture(scope='module')
def summary(folder):
    return study(folder).fit(None)


@pytest.fixture(scope='module')
def calibrated(summary):
    """Return the robot as its new parameter file has it."""
    return parameters.load(summary['parameter_file'])


def left(summary, what):
    return next(one for one in summary['left'] if one['what'].startswith(what))


def test_the_true_tcp_of_the_built_robot_is_right_on_poses_that_were_not_used(summary):
    true = left(summary, 'true TCP with gears loaded')
    print({key: round(1e3 * value, 4) for key, value in true.items() if key.endswith('_m')}, 'mm')
    assert 0.2e-3 < true['before_rms_m'] < 0.35e-3
    assert true['after_rms_m'] < GOAL_M
    assert left(summary, 'not used')['count'] == 8
    assert left(summary, 'not used')['after_rms_m'] < 3.0 * 2e-5


def test_limiting_quantity_is_reported(summary):
    limits = {one['what'].partition(',')[0]: one['size_m'] for one in summary['limits_m']}
    assert limits['non-geometric effects'] < 0.015e-3
    assert limits['increments of the encoders'] < 1e-6
    assert limits['measuring noise'] < GOAL_M
    # where the weight changes the flank, the backlash of a gear at the end of its arm
    backlash = limits['backlash of the gears']
    assert backlash == pytest.approx(2.9e-4 * 0.4)
    assert GOAL_M < left(summary, 'true TCP over the whole')['after_rms_m'] < backlash


def test_every_interval_contains_the_built_value(summary):
    for figure in summary['figures']:
        assert abs(figure['value'] - figure['truth']) < figure['half_width_95'], figure['symbol']


def test_the_head_of_the_parameter_file_gives_each_correction_and_its_interval_in_mm_or_deg(summary):
    lines = Path(summary['parameter_file']).read_text(encoding='utf-8').splitlines()
    for one in summary['figures']:
        unit, scale = ('deg', np.degrees(1.0)) if one['unit'] == 'rad' else ('mm', 1e3)
        words = f'{one["symbol"]}: correction'
        read_line(lines, words, [scale * one['value'], scale * one['half_width_95']])
        assert any(words in line and f' {unit}' in line for line in lines)


def test_intervals_contain_the_built_values_at_any_noise():
    robot = parameters.load('rich')
    poses = planned(robot)
    exact = simulated.points(poses, robot, Method.BASE, 0.0, 0)
    random, held, off = np.random.default_rng(20090421), [], []
    for _ in range(25):
        noise = 2e-5 * random.standard_normal(exact.points_m.shape)
        measured = dataclasses.replace(exact, points_m=exact.points_m + noise)
        found = estimation.estimate(model.PointsInBase(measured, robot), 2e-5)
        held += [
            abs(one.value - truth) < one.half_width for one, truth in zip(found.estimates, TRUTH, strict=True)
        ]
        true = (model.tcp(exact.angles_rad, found.x, robot) - exact.points_m)[exact.checks]
        off.append(np.sqrt((true**2).sum(axis=1).mean()))
    print(f'{100 * np.mean(held):.0f} % of the intervals, {1e3 * max(off):.4f} mm at most')
    assert 0.9 <= np.mean(held) <= 1.0
    assert max(off) < GOAL_M


def test_every_command_accepts_a_parameter_file(calibrated, summary, robot):
    program = programs.load('experiment1', robot.motion)
    errors = []
    for one in (parameters.load('rich'), calibrated):
        trace = run(program, one)
        errors.append(np.sqrt(((trace['tcp_true'] - trace['tcp_actual']) ** 2).sum(axis=1).mean()))
    assert errors[0] > 0.25e-3
    assert errors[1] < 0.4 * errors[0]  # what is left are the gears in motion
    text = Path(summary['parameter_file']).read_text('utf-8').splitlines()
    assert '# command: delta3 calibrate' in text
    assert sum(line.startswith('# l_A_1: correction') and '+-' in line for line in text) == 1


def test_the_folder_holds_tables_figures_and_the_measurements(summary, folder, calibrated):
    names = {path.name for path in folder.iterdir()}
    assert {'calibrated.yaml', 'measurements.csv', 'corrections.csv', 'residuals.csv', 'index.html'} <= names
    assert {'poses.png', 'left.png', 'corrections.png'} <= names
    assert json.loads((folder / 'report.json').read_text(encoding='utf-8'))['directions'] == 15
    assert calibrated.kinematics.upper_arm_correction_m != (0.0, 0.0, 0.0)


def test_the_residuals_of_each_use_in_the_table_are_those_of_the_summary(summary, folder):
    with (folder / 'residuals.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith('#')))
    assert [int(row['measurement']) for row in rows] == list(range(1, 33))
    for use, what in (('fit', 'used'), ('check', 'not used')):
        one = left(summary, what)
        for key in ('before', 'after'):
            values = np.array([float(row[f'{key} [m]']) for row in rows if row['use'] == use])
            assert len(values) == one['count']
            assert np.sqrt((values**2).mean()) == pytest.approx(one[f'{key}_rms_m'], rel=1e-6)
            assert values.max() == pytest.approx(one[f'{key}_max_m'], rel=1e-6)


def test_the_figure_of_the_residuals_has_each_measurement_under_its_label():
    checks, before, after = (
        np.array([False, True, False]),
        np.array([3e-4, 2e-4, 1e-4]),
        np.array([3e-5, 2e-5, 1e-5]),
    )
    nothing = np.full((3, 3), np.nan)
    measured = Measurements(nothing, nothing, checks, (), nothing[:, 0])
    found = Result((), (), 0, 0, (), 1.0, 0.0, (), measured, nothing, (before, after), {})
    drawn = {
        label: values
        for (_, unit, label), values in curves(figures.residuals(found)).items()
        if '[mm]' in unit
    }
    assert drawn.keys() == {'before, used', 'before, not used', 'after, used', 'after, not used'}
    assert drawn['before, used'] == pytest.approx([0.3, 0.1])
    assert drawn['before, not used'] == pytest.approx([0.2])
    assert drawn['after, used'] == pytest.approx([0.03, 0.01])
    assert drawn['after, not used'] == pytest.approx([0.02])


def test_the_table_that_it_leaves_gives_the_same_again(summary, folder, tmp_path):
    again = study(tmp_path, simulate=None, chosen='rich').fit(folder / 'measurements.csv')
    for name, values in summary['corrections'].items():
        assert again['corrections'][name] == pytest.approx(values, abs=2e-7)
    assert [one['what'] for one in again['left']] == ['used', 'not used']
    assert again['figures'][0]['truth'] is None


@pytest.mark.long
def test_a_calibrated_robot_is_calibrated_already(summary, tmp_path):
    again = study(tmp_path, chosen=summary['parameter_file']).fit(None)
    assert left(again, 'true TCP with gears loaded')['before_rms_m'] < GOAL_M
    assert left(again, 'true TCP with gears loaded')['after_rms_m'] < GOAL_M


@pytest.mark.long
def test_homing_error_of_each_arm_follows_from_three_touches(summary, calibrated, tmp_path):
    """The lengths are calibrated; then each motor is homed anew, and misses."""
    missed = [0.3, -0.5, 0.2]
    angles = np.array(calibrated.rich.arm_angle_error_deg) + missed
    machine = parameters.write(
        calibrated.replace(rich__arm_angle_error_deg=angles.tolist()), tmp_path / 'm.yaml'
    )
    homed = study(tmp_path / 'home', 'level', 3, 0, simulate=str(machine), height_m=-0.9).fit(None)
    found = np.degrees([one['value'] for one in homed['figures']])
    before = np.degrees([one['before'] for one in homed['figures']])
    assert found - before == pytest.approx(missed, abs=0.015)
    true = left(homed, 'true TCP with gears loaded')
    assert true['before_rms_m'] > 1e-3
    assert true['after_rms_m'] < 0.1e-3


@pytest.mark.long
@pytest.mark.parametrize('method', ['plane', 'ball'])
def test_touches_make_the_shape_of_the_motion_right(method, tmp_path):
    found = study(tmp_path, method, 40, 4, noise_m=1e-5).fit(None)
    true = left(found, 'true TCP, its shape, with gears loaded')
    assert true['after_rms_m'] < true['before_rms_m']
    assert found['method'] == method
    measured = measurement_file.read(tmp_path / 'measurements.csv')
    assert len(measured.objects) == 44


def test_angles_of_another_controller_are_rejected(summary, folder, tmp_path):
    with pytest.raises(CalibrationError, match='contains angles of a controller with other parameters'):
        study(tmp_path, simulate=None).fit(folder / 'measurements.csv')


def test_points_are_not_touches(summary, folder, tmp_path):
    with pytest.raises(CalibrationError, match='contains points, not touches'):
        study(tmp_path, 'level', 3, 0, simulate=None, chosen='rich', height_m=-0.9).fit(
            folder / 'measurements.csv'
        )
