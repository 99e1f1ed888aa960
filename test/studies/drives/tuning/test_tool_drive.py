"""Tests of the tuning of the drive of a rotary axis: load, loops, gains and their effect on a turn."""

import math

import numpy as np
import pytest
import yaml

from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.simulation import run
from delta3_pacdrive.studies.drives.loops.analysis import LOOPS, OperatingPoint, analyse, linear_loop
from delta3_pacdrive.studies.drives.loops.tuned_drive import HALF_TURN, tuned_drive
from delta3_pacdrive.studies.drives.tuning import drive_settings as settings
from delta3_pacdrive.studies.drives.tuning import effect
from delta3_pacdrive.studies.drives.tuning.run import Study
from delta3_pacdrive.studies.drives.tuning.study import Settings

GEAR, TOOL, PART_RADIUS_M, BAR = 10.0, 4.0e-3, 0.05, 600.0  # of the packaged parameters
SPEED_RAD_S = 10.0
DECIBELS, DEGREES = 1.0, 3.0  # between the drive on the bench and linear loops, as for the arms


@pytest.fixture(scope='module')
def turning():
    return parameters.load('model+rotary')


@pytest.fixture(scope='module')
def built():
    return parameters.load('rich+rotary')


def study_of(tmp_path, **chosen):
    return Study(Settings('rotary', axis=4, **chosen), tmp_path / 'tuning', '', lambda *_: None)


def test_inertia_of_rotor_bar_tool_and_part_is_independent_of_the_arms(turning):
    drive = tuned_drive(4, turning)
    for payload_kg in (0.0, 0.5, 2.0):
        load = drive.load(None, turning.replace(dynamics__payload_mass_kg=payload_kg))
        inertia = 0.33e-4 + (TOOL + payload_kg * PART_RADIUS_M**2) / GEAR**2
        assert load.inertia_kg_m2 == pytest.approx(inertia, rel=1e-12)
        assert load.gravity_n_m == 0.0
    lightest, heaviest = drive.extremes(turning.replace(dynamics__payload_mass_kg=3.0))
    assert lightest.name == 'tool with no part'
    assert heaviest.name == 'tool with a part of 3 kg'


@pytest.mark.long
def test_the_real_drive_on_the_bench_agrees_with_its_linear_loops(built):
    drive = tuned_drive(4, built)
    operation = OperatingPoint(drive.load(None, built), SPEED_RAD_S)
    loops = analyse(drive.in_loops(built), operation, lambda *_: None)
    assert all(loop.stable and not loop.fault for loop in loops)
    for loop in loops:
        measured = loop.measured_open
        seen = measured.in_band
        linear = np.interp(
            np.log(measured.frequencies_hz[seen]),
            np.log(loop.frequencies_hz),
            20 * np.log10(np.abs(loop.open_loop)),
        )
        off = np.abs(20 * np.log10(np.abs(measured.values[seen])) - linear)
        assert off.max() < DECIBELS, loop.name


def test_the_bar_of_a_built_robot_gives(built, turning):
    """The velocity loop does not reach the resonance of tool and part on the bar with a resting motor shaft."""
    drive, velocity = tuned_drive(4, built), LOOPS[1]
    operation = OperatingPoint(drive.load(None, built), SPEED_RAD_S)
    elastic, rigid = (linear_loop(velocity, drive.in_loops(robot), operation) for robot in (built, turning))
    swing_hz = math.sqrt(BAR / (TOOL + 0.5 * PART_RADIUS_M**2)) / math.tau
    band = (elastic.frequencies_hz > 25.0) & (elastic.frequencies_hz < 100.0)
    weakest = elastic.frequencies_hz[band][np.abs(elastic.open_loop[band]).argmin()]
    assert weakest == pytest.approx(swing_hz, rel=0.03)
    assert elastic.margins.gain_margin_db < rigid.margins.gain_margin_db - 3.0


@pytest.mark.parametrize(('axis', 'group', 'other'), [(4, 'rotary', 'rotary_2'), (5, 'rotary_2', 'rotary')])
def test_written_gains_are_those_of_the_addressed_drive(axis, group, other, turning):
    robot = turning.replace(rotary_2__present=True)
    changed = settings.apply(
        [settings.parse(text, axis) for text in ('K_Pvel=0.2', 'S-0-0101=0.01', 'velocity_filter_s=4e-4')],
        robot,
    )
    assert changed.drive.velocity_gain_a_s_rad == robot.drive.velocity_gain_a_s_rad
    assert getattr(changed, other) == getattr(robot, other)
    own = getattr(changed, group)
    assert own.velocity_gain_a_s_rad == 0.2
    assert own.velocity_integral_gain_a_rad == pytest.approx(20.0)
    assert changed.drive.velocity_filter_s == 4e-4  # that of all drives
    swept = settings.parse_sweep('K_Ppos=50:100:2', axis)
    assert [getattr(one.apply(robot), group).position_gain_rad_s_rad for one in swept] == [50.0, 100.0]


def test_the_effect_is_that_on_the_turn(turning):
    drive = tuned_drive(4, turning)
    program = drive.program(None, turning)
    assert program.name == HALF_TURN
    found = effect.run(program, turning, drive)
    trace = run(program, turning)
    first = trace.meta['start_cycle']
    np.testing.assert_array_equal(found.following_error_rad, GEAR * trace['turn_error'][first:])
    assert found.axes == (4,)
    assert found.current_peak_a == trace.meta['figures']['turn_current_peak_a'] > 1.0
    assert found.current_rms_a == trace.meta['figures']['turn_current_rms_a']
    weak = turning.replace(rotary__position_gain_rad_s_rad=30.0, control__feed_forward='inertia')
    assert effect.run(program, weak, drive).following_error_max_rad > 2.0 * found.following_error_max_rad


def test_the_second_axis_has_its_own_load_turn_and_errors(turning):
    robot = turning.replace(
        rotary_2__present=True, rotary_2__gear_ratio=7.0, rotary_2__tool_inertia_kg_m2=9e-3
    )
    drive = tuned_drive(5, robot)
    assert drive.in_loops(robot).dynamics.gear_ratio == 7.0
    assert drive.load(None, robot).inertia_kg_m2 == robot.rotary_2.shaft_inertia_kg_m2(0.5)
    program = drive.program(None, robot)
    found, trace = effect.run(program, robot, drive), run(program, robot)
    assert np.ptp(trace['turn_command']) == 0.0
    assert np.ptp(trace['turn_command_2']) == pytest.approx(math.pi)
    first = trace.meta['start_cycle']
    np.testing.assert_array_equal(found.following_error_rad, 7.0 * trace['turn_error_2'][first:])
    assert found.axes == (5,)
    assert found.current_peak_a == trace.meta['figures']['turn_current_peak_a_2'] > 1.0
    with pytest.raises(
        TuningError, match=r'^--axis is 5, but the robot has no axis5 for a rotary axis \(rotary_2'
    ):
        tuned_drive(5, turning)


def test_options_for_absent_axes_are_rejected(tmp_path):
    with pytest.raises(
        TuningError, match=r'^--axis is 4, but the robot has no axis4 for a rotary axis \(rotary.present is'
    ):
        Study(Settings('model', axis=4), tmp_path / 'tuning', '', lambda *_: None)
    with pytest.raises(
        TuningError, match=r'^--pose is for the arms: the load of the tool is the same everywhere'
    ):
        study_of(tmp_path, pose_m=(0.0, 0.0, -0.8))
    with pytest.raises(
        TuningError,
        match=r'^experiment1 does not turn the tool by axis4: it cannot show the effect on its drive',
    ):
        study_of(tmp_path, program='experiment1')
    turned = {'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.8], 'turn_deg': 90}}]}
    (tmp_path / 'turned.yaml').write_text(yaml.safe_dump(turned))
    assert study_of(tmp_path, program=str(tmp_path / 'turned.yaml')).program.statements[0].turns
    second = Settings('rotary_2', axis=5, program=str(tmp_path / 'turned.yaml'))
    with pytest.raises(TuningError, match=r'turned.yaml does not turn the tool by axis5'):
        Study(second, tmp_path / 'tuning', '', lambda *_: None)
    assert not (tmp_path / 'tuning').exists()


@pytest.mark.parametrize(
    'more', [['--pose', '0', '0', '-0.8'], ['--propose'], ['--excite', 'a.npz'], ['--recording', 'a.npz']]
)
def test_options_for_the_arms_are_rejected_for_other_axes(more, capsys):
    with pytest.raises(SystemExit):
        main(['tune', '--axis', '4', '--parameters', 'rotary', *more])
    assert f'error: {more[0]} applies to the arms only, not to --axis 4' in capsys.readouterr().err


def test_folder_describes_the_drive_of_the_tool(tmp_path, capsys):
    folder = tmp_path / 'tuning'
    command = ['tune', '--axis', '4', '--parameters', 'rotary', '--set', 'K_Ppos=60', '--output', str(folder)]
    assert main(command) == 0
    text = capsys.readouterr().out
    assert text.startswith('tool with a part of 0.5 kg: 0.855e-4 kg m2 and 0.000 N m at the shaft')
    assert 'rotary.position_gain_rad_s_rad: 100 before, 60 after\n' in text
    assert '  half a turn and back\n' in text
    assert 'before: following error 4 [rad]' in (folder / 'following_error.csv').read_text()
    assert (folder / 'effect.png').exists()
