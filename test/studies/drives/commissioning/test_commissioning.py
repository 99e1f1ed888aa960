"""Tests of the commissioning by excitation, on simulated drives: measurement, proposal and verification of gains."""

import contextlib
import json
from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters
from delta3_pacdrive.errors import ProgramError, TuningError
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.studies.drives.commissioning.mechanics import friction_strokes, identify
from delta3_pacdrive.studies.drives.commissioning.responses import responses, stroke
from delta3_pacdrive.studies.drives.commissioning.run import SHORT_DB, SHORT_DEG, Study
from delta3_pacdrive.studies.drives.commissioning.strokes import Strokes
from delta3_pacdrive.studies.drives.commissioning.study import Settings
from delta3_pacdrive.studies.drives.tuning.proposal import margins_kept, spread
from delta3_pacdrive.studies.framework.study import silent
from simulated_commissioning import SimulatedRobot

ROBOT = parameters.load()
SPEED_RAD_S = 5.0  # of the excited stroke
SAME_DEG, SAME_DB = (
    1.0,
    0.4,
)  # between measured plants and difference equations, which agree within errors of lines
GAINS = ('position_gain_rad_s_rad', 'velocity_gain_a_s_rad', 'velocity_integral_gain_a_rad')


def study(robot, folder, **settings):
    return Study(Settings(**settings), folder, 'delta3 tune', silent, lambda: contextlib.nullcontext(robot))


def measured(robot, axis):
    pose = robot.angles_rad()[axis] * robot.parameters.dynamics.gear_ratio
    return responses(robot.record(stroke(axis), True), pose, robot.parameters)


@pytest.fixture(scope='module')
def nominal(tmp_path_factory):
    """Return the report of a nominal robot with gains applied for the usual margins, the robot and its folder."""
    robot, folder = SimulatedRobot(ROBOT), tmp_path_factory.mktemp('nominal')
    return study(robot, folder, propose=True, apply=True).run(), robot, folder


def test_inertia_and_friction_are_those_of_the_plant(nominal):
    document, robot, _ = nominal
    masses = dynamics.mass_matrix(np.array(robot.angles_rad()), ROBOT) / ROBOT.dynamics.gear_ratio**2
    for axis, found in enumerate(document['mechanics']):
        inertia, static, viscous = (
            found[name] for name in ('inertia_kg_m2', 'static_friction_n_m', 'viscous_friction_n_m_s_rad')
        )
        assert found['model_inertia_kg_m2'] == pytest.approx(masses[axis, axis])
        for interval, true, width in (
            (inertia, masses[axis, axis], 0.01),
            (static, ROBOT.motor.static_friction_n_m, 0.01),
            (viscous, ROBOT.motor.viscous_friction_n_m_s_rad, 0.1),
        ):
            assert interval['low'] <= true <= interval['high']
            assert interval['high'] - interval['low'] < width * true
        assert found['gear'] is None


def test_margins_over_the_workspace_are_those_of_the_difference_equations(nominal):
    document, _, _ = nominal
    before = margins_kept(ROBOT, spread(ROBOT, 2.0), SPEED_RAD_S)
    found = document['workspace']['before']
    assert found['phase_deg'] == pytest.approx(before.phase_deg, abs=SAME_DEG)
    assert found['gain_db'] == pytest.approx(before.gain_db, abs=SAME_DB)


def test_applied_gains_keep_the_margins_and_are_in_all_drives(nominal):
    document, robot, folder = nominal
    after, proposal = document['workspace']['after'], document['proposal']
    assert (proposal['targets']['phase_deg'], proposal['targets']['gain_db']) == (45.0, 6.0)
    assert after['stable']
    assert after['phase_deg'] > 45.0 - SHORT_DEG
    assert after['gain_db'] > 6.0 - SHORT_DB
    assert document['outcome']['kept']
    for axis in DRIVES:
        for name in GAINS:
            assert getattr(robot.values[axis].drive, name) == proposal['gains'][name]
    kept = margins_kept(robot.values['axis1'], spread(ROBOT, 2.0), SPEED_RAD_S)
    assert kept.phase_deg > 45.0 - SAME_DEG
    assert kept.gain_db > 6.0 - SAME_DB
    assert json.loads((folder / 'applied.json').read_text())['robot']['before']['axis2'][GAINS[0]] == 60.0


def test_report_has_all_files_and_shows_before_and_after(nominal):
    document, _, folder = nominal
    names = {'report.json', 'index.html', 'gains.yaml', 'margins.csv', 'mechanics.csv', 'inertia.png'}
    names |= {
        f'{kind}_{when}.{end}'
        for kind, end in (('loop', 'png'), ('responses', 'csv'))
        for when in ('before', 'after')
    }
    assert {path.rpartition('/')[2] for path in document['files']} == names
    assert all((folder / name).stat().st_size for name in names)
    assert [(row['gains'], row['axis']) for row in document['margins']] == [
        (gains, axis) for gains in ('before', 'after') for axis in (1, 2, 3)
    ]
    page = (folder / 'index.html').read_text()
    assert 'static friction' in page
    assert 'outside the interval' not in page  # every value of the model is explained


def test_heavier_payload_than_that_of_the_parameters_is_found(tmp_path):
    robot = SimulatedRobot(ROBOT, {'dynamics__payload_mass_kg': 1.5})
    response = measured(robot, 1)
    found = identify(response, robot.record(friction_strokes(1), False), robot.angles_rad(), ROBOT)
    heavy = ROBOT.replace(dynamics__payload_mass_kg=1.5)
    true = dynamics.mass_matrix(np.array(robot.angles_rad()), heavy)[1, 1] / ROBOT.dynamics.gear_ratio**2
    assert not found.inertia_kg_m2.contains(found.model_inertia_kg_m2)
    assert found.inertia_kg_m2.value == pytest.approx(
        true, rel=0.02
    )  # the small coupling is that of the model


def test_elastic_gear_is_found_with_rotor_and_antiresonance():
    built = parameters.load('built').replace(bus__exchange_period_s=250e-6)
    robot = SimulatedRobot(built)
    response = measured(robot, 0)
    found = identify(response, robot.record(friction_strokes(0), False), robot.angles_rad(), built)
    assert found.gear is not None
    rotor = built.motor.rotor_inertia_kg_m2 + built.motor.brake_inertia_kg_m2
    stiffness = built.rich.gear_stiffness_n_m_rad / built.dynamics.gear_ratio**2
    arm = found.model_inertia_kg_m2 - rotor
    # the plate couples the arms, which one rotor and one arm do not contain
    assert found.gear.rotor_kg_m2 == pytest.approx(rotor, rel=0.1)
    assert found.gear.antiresonance_hz == pytest.approx(np.sqrt(stiffness / arm) / (2.0 * np.pi), rel=0.1)
    assert found.inertia_kg_m2.contains(found.model_inertia_kg_m2)


def test_failure_after_the_gains_are_written_restores_them(tmp_path):
    robot = SimulatedRobot(ROBOT)
    robot.fails_after_writes = 9
    with pytest.raises(
        ProgramError, match='8111: following error; the previous gains are restored in all drives'
    ):
        study(robot, tmp_path, propose=True, apply=True).run()
    assert len(robot.written) == 18
    assert all(robot.values[axis].drive == ROBOT.drive for axis in DRIVES)
    assert not (tmp_path / 'applied.json').exists()


def test_gains_whose_margins_are_not_measured_again_are_taken_back(tmp_path, monkeypatch):
    class Heavier(SimulatedRobot):
        """A robot whose current loop becomes slow as soon as gains are written."""

        def record(self, strokes, excited):
            if self.written:
                self.plant = {'drive__current_reference_filter_s': 1.5e-3}
            return super().record(strokes, excited)

    robot = Heavier(ROBOT)
    document = study(robot, tmp_path, propose=True, apply=True).run()
    assert not document['outcome']['kept']
    assert 'the previous gains are restored in all drives' in document['outcome']['sentence']
    assert all(robot.values[axis].drive == ROBOT.drive for axis in DRIVES)


def test_drives_with_different_gains_are_rejected_before_a_motion(tmp_path):
    robot = SimulatedRobot(ROBOT)
    robot.write('axis3', 'S-0-0104', 50.0)
    with pytest.raises(TuningError, match=r'axis3 has S-0-0104 = 50 instead of 60 as axis1'):
        study(robot, tmp_path).run()


def test_margins_out_of_range_are_rejected(tmp_path):
    with pytest.raises(TuningError, match='phase margin is 85 deg'):
        study(SimulatedRobot(ROBOT), tmp_path, propose=True, phase_margin_deg=85.0)


def test_record_without_excitation_names_the_axis():
    robot = SimulatedRobot(ROBOT)
    record = robot.record(stroke(2), False)
    pose = robot.angles_rad()[2] * ROBOT.dynamics.gear_ratio
    with pytest.raises(
        TuningError,
        match='axis3 were excited for 0, 0, 0, 0 periods at constant speed; 2 strokes with 4 periods',
    ):
        responses(record, pose, ROBOT)
    empty = replace(record, signals={name: values[:100] for name, values in record.signals.items()})
    with pytest.raises(TuningError, match='axis3 contains no stroke at constant speed'):
        responses(empty, pose, ROBOT)


@pytest.mark.parametrize('speeds', [(5.0,), (12.0, 25.0, 40.0)])
def test_strokes_move_one_arm_around_the_pose_and_return(speeds):
    strokes = Strokes(1, 3.0, speeds)
    pose = kinematics.inverse(ROBOT.motion.home_m, ROBOT.kinematics)
    points = json.loads(strokes.program(pose.tolist(), ROBOT.dynamics.gear_ratio))['moves'][0]['joints'][
        'points'
    ]
    times, angles, rates = (
        np.array([point[name] for point in points]) for name in ('time_s', 'angles_rad', 'speeds_rad_s')
    )
    moved = ROBOT.dynamics.gear_ratio * (angles - pose)
    assert not moved[:, [0, 2]].any()
    assert np.abs(moved).max() == pytest.approx(strokes.reach_rad)
    assert moved[-1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert not rates[-1].any()
    assert times[-1] == strokes.duration_s
    # pieces at constant speed
    fast = np.abs(rates[:, 1]) > 0.0
    both = fast[:-1] & fast[1:]
    speed = np.abs(np.diff(moved[:, 1])[both] / np.diff(times)[both])
    assert speed == pytest.approx(np.repeat(speeds, 2))
