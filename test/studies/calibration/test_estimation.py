"""Tests of the estimation of arms from measurements of the TCP, also with insufficient measurements."""

import dataclasses
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive.errors import CalibrationError
from delta3_pacdrive.studies.calibration import estimation, model
from measured import NOISE_M, TRUTH, instrument, off_m, planned, probe
from thoroughness import some

ZERO = np.zeros(15)


@pytest.fixture(scope='module')
def poses(robot):
    return planned(robot)


@pytest.fixture(scope='module')
def touches(robot):
    """Return the three touches that determine the zero angles."""
    return planned(robot, 'level', 3, 0, height_m=-0.9)


def estimated(measured, robot, noise_m=NOISE_M):
    return estimation.estimate(model.PointsInBase(measured, robot), noise_m)


def refusal(measured, robot, kind=model.PointsInBase, **more):
    with pytest.raises(CalibrationError) as caught:
        estimation.estimate(kind(measured, robot), NOISE_M, **more)
    return str(caught.value)


def with_row(measured, field, row, value):
    """Return measurements with another row in one of their arrays."""
    values = getattr(measured, field).copy()
    values[row] = value
    return dataclasses.replace(measured, **{field: values})


def test_exact_points_identify_all_arms(poses, robot):
    found = estimated(instrument(poses, robot, noise_m=0.0), robot, 0.0)
    assert found.directions == 15
    assert off_m(ZERO, robot) > 2e-4
    assert off_m(found.x, robot) < 1e-6
    assert found.x == pytest.approx(TRUTH, abs=2e-5)


def test_noisy_points_make_the_tcp_right_on_poses_that_were_not_used(poses, robot):
    observation = model.PointsInBase(instrument(poses, robot), robot)
    found = estimation.estimate(observation, NOISE_M)
    used, checks = estimation.compared(found, observation)
    assert (used.what, used.count, checks.what, checks.count) == ('used', 24, 'not used', 8)
    assert checks.before_rms_m > 2e-4
    assert checks.after_rms_m < 3.0 * NOISE_M  # mostly the noise of three coordinates
    assert off_m(found.x, robot) < 0.03e-3
    assert found.expected_m[1] < 0.03e-3 < found.expected_m[0]
    assert 0.7 < found.scatter < 1.3


def test_95_per_cent_intervals_hold_the_truth(poses, robot):
    held = []
    for seed in range(40):
        found = estimated(instrument(poses, robot, seed=seed), robot)
        held += [
            abs(one.value - truth) < one.half_width for one, truth in zip(found.estimates, TRUTH, strict=True)
        ]
    assert np.mean(held) >= 0.9


def test_a_calibrated_controller_is_calibrated_again_from_where_it_is(poses, robot):
    once = estimated(instrument(poses, robot), robot)
    document = {f'kinematics__{name}': value for name, value in model.document_of(once.x).items()}
    again = estimated(
        instrument(poses, robot.replace(**document), noise_m=0.0), robot.replace(**document), 0.0
    )
    assert off_m(again.x, robot) < 2e-6


def test_corrections_are_written_in_the_units_of_the_parameters(robot):
    named = model.document_of(TRUTH)
    changed = robot.replace(**{f'kinematics__{name}': value for name, value in named.items()})
    assert model.corrections_of(changed.kinematics) == pytest.approx(TRUTH, abs=1e-9)


def test_instrument_at_any_position_identifies_all_but_a_common_rotation(poses, robot):
    measured = instrument(poses, robot, noise_m=0.0)
    seen = Rotation.from_rotvec([0.3, -0.5, 1.0]).apply(measured.points_m) + np.array([1.0, -2.0, 0.5])
    found = estimation.estimate(
        model.PointsInFrame(dataclasses.replace(measured, points_m=seen), robot), 0.0, is_placed=False
    )
    assert {'alpha_1', 'alpha_2', 'alpha_3'} in [
        set(re.findall(r'\w+_\d', line)) for line in found.combinations
    ]
    assert not any(one.is_identified for one in found.estimates if one.symbol == 'alpha')
    assert off_m(found.x, robot, is_placed=False) < 0.1 * off_m(ZERO, robot, is_placed=False)


@pytest.mark.parametrize('method', some(['plane', 'ball'], ['plane']))
def test_touches_of_a_freely_placed_object_identify_the_shape_of_the_error(method, robot):
    poses = planned(robot, method, 60)
    observation = model.Touches(probe(poses, robot, noise_m=5e-6), robot)
    found = estimation.estimate(observation, 5e-6, is_placed=False)
    assert found.directions < 15
    assert found.combinations
    assert off_m(found.x, robot, is_placed=False) < 0.7 * off_m(ZERO, robot, is_placed=False)
    _, checks = estimation.compared(found, observation)
    assert checks.after_rms_m < 0.7 * checks.before_rms_m


# zero angles


def test_three_touches_identify_the_homing_error_of_each_arm(touches, robot):
    homing = np.concatenate([np.zeros(12), np.radians([0.5, -0.8, 1.2])])
    observation = model.Touches(probe(touches, robot, homing), robot, height_m=-0.9)
    found = estimation.estimate(observation, NOISE_M, model.ZEROS)
    assert [(one.symbol, one.arm) for one in found.estimates] == [('theta', 1), ('theta', 2), ('theta', 3)]
    assert np.degrees(found.x[12:]) == pytest.approx([0.5, -0.8, 1.2], abs=0.01)
    for one, truth in zip(found.estimates, homing[12:], strict=True):
        assert abs(one.value - truth) < one.half_width


def test_three_touches_of_one_arm_can_be_contradictory(touches, robot):
    homing = np.concatenate([np.zeros(13), np.radians([-0.8]), np.zeros(1)])
    measured = probe(touches, robot, homing, noise_m=0.0)
    free = (model.ZEROS[1],)
    found = estimation.estimate(model.Touches(measured, robot, height_m=-0.9), NOISE_M, free)
    assert np.degrees(found.x[13]) == pytest.approx(-0.8, abs=1e-3)
    assert found.freedom == 2
    with pytest.raises(CalibrationError, match='contradict one another'):
        estimation.estimate(model.Touches(measured, robot, height_m=-0.9), NOISE_M, (model.ZEROS[0],))


def test_uncalibrated_lengths_are_in_the_intervals_of_zero_angles(touches, robot):
    measured = probe(touches, robot, noise_m=0.0)
    found = estimation.estimate(model.Touches(measured, robot, height_m=-0.9), NOISE_M, model.ZEROS)
    for one, truth in zip(found.estimates, TRUTH[12:], strict=True):
        assert abs(one.value - truth) < one.half_width
    known = robot.replace(kinematics__upper_arm_correction_m=[1e-9, 0.0, 0.0])
    sure = estimation.estimate(model.Touches(measured, known, height_m=-0.9), NOISE_M, model.ZEROS)
    assert all(
        a.half_width < 0.7 * b.half_width for a, b in zip(sure.estimates, found.estimates, strict=True)
    )


# refusals


@pytest.mark.parametrize('off_mm', [0.3, 1.0])
def test_a_measurement_that_the_others_contradict_is_named(off_mm, poses, robot):
    measured = instrument(poses, robot)
    row = int(np.flatnonzero(~measured.checks)[7])
    wrong = with_row(measured, 'points_m', row, measured.points_m[row] + np.array([0.0, 1e-3 * off_mm, 0.0]))
    sentence = refusal(wrong, robot)
    assert 'the measurements contradict one another' in sentence
    named = re.search(rf'measurement {row + 1} deviates by ([\d.]+) mm from the others', sentence)
    assert float(named[1]) == pytest.approx(off_mm, abs=0.15)


def test_underestimated_noise_is_a_contradiction_and_overestimated_is_not(poses, robot):
    measured = instrument(poses, robot, noise_m=2e-4)
    assert '--noise' in refusal(measured, robot)
    assert estimated(measured, robot, 2e-4).scatter == pytest.approx(1.0, abs=0.3)


def test_insufficient_measurements_are_distinguished_from_sufficient_ones(poses, robot):
    measured = instrument(poses, robot)
    few = dataclasses.replace(measured, checks=np.arange(len(measured.checks)) >= 4)
    assert refusal(few, robot) == (
        '4 measurements are too few: they give 12 equations for 15 parameters of the arms and leave no degrees of '
        'freedom'
    )


def test_poses_in_a_corner_identify_too_little(robot):
    poses = planned(robot)
    near = dataclasses.replace(poses, points_m=np.array([0.1, 0.1, -0.8]) + 0.005 * poses.points_m)
    sentence = refusal(instrument(near, robot), robot)
    assert sentence.startswith('the measurements are insufficient')
    assert 'their poses span' in sentence


@pytest.mark.parametrize(
    ('moved', 'advice'),
    [
        (lambda p: 1e3 * p, 'all measurements agree with the measured coordinates multiplied by 0.001'),
        (lambda p: p / 25.4, 'all measurements agree with the measured coordinates multiplied by 25.4'),
        (lambda p: p + np.array([0.0, 0.0, 0.3]), 'check that robot, frame and units are correct'),
        (lambda p: p[:, ::-1], 'all measurements agree with the measured coordinates in the order z, y, x'),
        (lambda p: p * [1.0, 1.0, -1.0], 'all measurements agree with the opposite sign of the measured z'),
        # the mirror image of a robot is one with two exchanged arms
        (lambda p: p * [1.0, -1.0, 1.0], 'all measurements agree with the arm angles in the order 1, 3, 2'),
    ],
)
def test_points_of_another_frame_or_unit_are_rejected(poses, robot, moved, advice):
    measured = instrument(poses, robot)
    sentence = refusal(dataclasses.replace(measured, points_m=moved(measured.points_m)), robot)
    assert re.match(r'measurement \d+ is [\d.]+ mm from the TCP computed from the arm angles', sentence)
    assert sentence.endswith(advice)


@pytest.mark.parametrize('kind', [model.PointsInBase, model.PointsInFrame])
@pytest.mark.parametrize(
    ('moved', 'advice'),
    [
        (lambda a: a[:, [2, 0, 1]], 'with the arm angles in the order 2, 3, 1'),
        (lambda a: -a, 'with the opposite sign of the arm angles'),
        (np.radians, 'with the arm angles as radians'),
    ],
)
def test_exchanged_axes_signs_and_units_of_the_angles_are_named(poses, robot, kind, moved, advice):
    measured = instrument(poses, robot)
    if kind is model.PointsInFrame and 'order' in advice:
        advice = 'with the arm angles in the order'  # a rotation about z is a rotation of the instrument
        moved = lambda a: a[:, [0, 2, 1]]  # noqa: E731
    sentence = refusal(dataclasses.replace(measured, angles_rad=moved(measured.angles_rad)), robot, kind)
    assert advice in sentence


def test_angles_at_which_the_forearms_do_not_meet_are_named(poses, robot):
    short = robot.replace(kinematics__forearm_length_m=0.5)
    wrong = with_row(instrument(poses, robot), 'angles_rad', 4, np.radians([-40.0, -40.0, -40.0]))
    assert refusal(wrong, short).startswith('measurement ')
    assert 'the forearms do not meet at arm angles' in refusal(wrong, short)


def test_points_on_a_line_do_not_identify_the_rotation_of_the_instrument(poses, robot):
    line = dataclasses.replace(
        poses, points_m=poses.points_m * np.array([1.0, 1e-4, 1e-4]) + [0.0, 0.1, -0.8]
    )
    told = 'the measured points lie on a line and do not determine the rotation of the instrument'
    assert refusal(instrument(line, robot), robot, model.PointsInFrame, is_placed=False) == told
    measured = instrument(poses, robot)
    one = dataclasses.replace(measured, points_m=0.0 * measured.points_m)
    assert refusal(one, robot, model.PointsInFrame, is_placed=False) == told


def test_touches_that_only_locate_an_object_are_rejected(robot):
    poses = planned(robot, 'plane', 60)
    measured = probe(poses, robot)
    line = dataclasses.replace(poses, points_m=poses.points_m * [1.0, 1e-3, 1.0] + [0.0, 0.1, 0.0])
    assert 'lie on a line' in refusal(probe(line, robot), robot, model.Touches)
    first = np.flatnonzero(np.array(measured.objects) == 'plane1')[:3]
    few = dataclasses.replace(measured, checks=~np.isin(np.arange(len(measured.checks)), first))
    rows = ~few.checks
    few = dataclasses.replace(
        few,
        angles_rad=few.angles_rad[rows],
        points_m=few.points_m[rows],
        checks=few.checks[rows],
        objects=('plane1',) * 3,
        diameters_m=few.diameters_m[rows],
    )
    assert refusal(few, robot, model.Touches).startswith(
        '3 touch(es) of plane1 determine no more than its position'
    )
    ball = dataclasses.replace(few, diameters_m=np.full(3, 0.05), objects=('ball',) * 3)
    assert refusal(ball, robot, model.Touches).startswith(
        '3 touch(es) of ball determine no more than its position'
    )
