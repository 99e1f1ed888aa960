"""Tests of the poses that a calibration plans."""

from collections import Counter

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.planning.limits.capability import REACHED, capability
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program_planner import plan
from delta3_pacdrive.studies.calibration import estimation, model, planning, simulated
from measured import planned

SEED = 20090420
METHODS = [('base', 24), ('frame', 30), ('plane', 60), ('ball', 60)]


def worth(points, robot):
    """Logarithm of the determinant of the information of an instrument's points about the arms."""
    moves = model.sensitivity(estimation.shafts_of(points, robot), robot) * model.SCALES / 2e-5
    rows = moves.reshape(-1, 15)
    return np.linalg.slogdet(np.eye(15) + rows.T @ rows)[1]


def test_planned_poses_identify_more_than_random_ones(robot):
    poses = planned(robot)
    chosen = worth(poses.points_m[~poses.checks], robot)
    print(f'seed {SEED}')
    random, places = np.random.default_rng(SEED), estimation.workspace(robot)
    places = places[planning.pressed(places, robot)]
    drawn = [worth(places[random.choice(len(places), 24, replace=False)], robot) for _ in range(50)]
    assert chosen > max(drawn) + 1.0


def test_more_poses_and_less_noise_make_the_tcp_more_certain(robot):
    few, many = (planned(robot, number=number).expected_m[0] for number in (12, 48))
    quiet = planned(robot, number=12, noise_m=5e-6).expected_m[0]
    assert many < 0.7 * few
    assert quiet < 0.7 * few


@pytest.mark.parametrize(('method', 'number'), METHODS)
def test_requested_number_of_poses_is_planned_within_the_limits(method, number, robot):
    poses = planned(robot, method, number)
    assert (~poses.checks).sum() == number
    assert poses.checks.sum() == 8
    assert len(np.unique(poses.points_m.round(6), axis=0)) == number + 8
    assert (capability(poses.points_m, robot).limit == REACHED).all()
    document = simulated.program(poses, 'poses')
    program = program_file.parse(document, robot.motion)
    assert plan(program, robot.motion.home_m, robot).plan.duration_s > 0.0


@pytest.mark.parametrize(('method', 'number'), METHODS)
def test_the_weight_presses_every_gear_to_its_usual_flank(method, number, robot):
    poses = planned(robot, method, number)
    torque = dynamics.gravity(kinematics.inverse(poses.points_m, robot), robot)
    assert torque.max() < -planning.PRESSED_N_M


@pytest.mark.parametrize(('method', 'count'), [('plane', 3), ('ball', 10)])
def test_every_object_is_touched_often_enough_to_give_more_than_its_position(method, count, robot):
    poses = planned(robot, method, 60)
    touched = Counter(name for name, check in zip(poses.objects, poses.checks, strict=True) if not check)
    assert len(touched) == count
    assert min(touched.values()) >= 5
    assert set(poses.objects) == set(touched)


def test_three_touches_identify_each_zero_angle_separately(robot):
    poses = planned(robot, 'level', 3, 0, height_m=-0.9)
    assert poses.points_m[:, 2] == pytest.approx([-0.9] * 3)
    slopes = model.sensitivity(estimation.shafts_of(poses.points_m, robot), robot)[:, 2, 12:]
    assert np.linalg.cond(slopes) < 5.0


@pytest.mark.parametrize(
    ('method', 'number', 'checks', 'sentence'),
    [
        ('base', 5, 0, '5 poses are too few for the method base, at least 6 are needed'),
        ('base', 400, 8, '400 poses and 8 checks are more than the'),
        ('plane', 12, 0, '12 poses are too few for the method plane, at least 20 are needed'),
    ],
)
def test_impossible_numbers_of_poses_are_rejected(method, number, checks, sentence, robot):
    with pytest.raises(CalibrationError, match=sentence):
        planned(robot, method, number, checks)


@pytest.mark.parametrize(
    ('method', 'least'), [('base', 6), ('frame', 8), ('plane', 20), ('ball', 20), ('level', 1)]
)
def test_the_least_number_of_poses_of_a_method_is_planned_and_one_less_is_rejected(method, least, robot):
    more = {'height_m': -0.9} if method == 'level' else {}
    assert len(planned(robot, method, least, 0, **more).points_m) == least
    with pytest.raises(
        CalibrationError, match=f'{least - 1} poses are too few .* at least {least} are needed$'
    ):
        planned(robot, method, least - 1, 0, **more)


def test_the_uncertainty_of_the_tcp_is_the_rms_of_its_distance_over_the_workspace(robot):
    """Certain figures but one: the TCP is off as far as that one moves it."""
    places = estimation.workspace(robot)
    shafts = estimation.shafts_of(places, robot)
    for free in (0, 4, 8, 11, 12):
        x = np.zeros(15)
        x[free] = 0.7 * model.SCALES[free]
        off = model.tcp(shafts, x, robot) - model.tcp(shafts, 0.0 * x, robot)
        expected = np.sqrt((np.linalg.norm(off, axis=1) ** 2).mean())
        covariance = np.array([[0.7**2]])
        assert estimation.expected_m(covariance, robot, [free], True) == pytest.approx(expected, rel=1e-2)


def test_a_touch_has_the_angles_at_which_the_probe_meets_the_surface(robot):
    """A probe creeps by 20 um in a bus cycle; the place within it counts."""
    poses = planned(robot, 'level', 3, 0, height_m=-0.9)
    found = simulated.touches(poses, robot, 0.0, 0, -0.9)
    heights = kinematics.forward(found.angles_rad, robot)[:, 2]
    assert heights == pytest.approx([-0.9] * 3, abs=2e-6)


def test_a_plane_that_the_robot_does_not_reach_is_rejected(robot):
    with pytest.raises(CalibrationError, match='more than the 0 candidates'):
        planned(robot, 'level', 3, 0, height_m=-2.0)
