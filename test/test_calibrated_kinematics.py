"""Tests of kinematics with individual lengths, radii and azimuths of the arms."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics

SEED = 20090419
STEP = 1e-5
DIFFERENCE = 1e-8  # of central differences: step^2 and rounding/step
UPPER_ARM = np.array([0.012, -0.008, 0.003])
FOREARM = np.array([-0.015, 0.01, 0.006])
RADIUS = np.array([0.008, -0.004, -0.012])
AZIMUTH_DEG = [1.5, -2.0, 0.7]


@pytest.fixture(scope='module')
def calibrated(robot):
    return robot.replace(
        kinematics__upper_arm_correction_m=UPPER_ARM.tolist(),
        kinematics__forearm_correction_m=FOREARM.tolist(),
        kinematics__radius_correction_m=RADIUS.tolist(),
        kinematics__arm_azimuth_correction_deg=AZIMUTH_DEG,
    )


@pytest.fixture(scope='module')
def points(robot):
    print(f'seed {SEED}')
    random = np.random.default_rng(SEED)
    angle, radius = random.uniform(-np.pi, np.pi, 300), 0.5 * np.sqrt(random.uniform(0.0, 1.0, 300))
    return np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), random.uniform(-0.95, -0.7, 300)], axis=-1
    )


def elbows(theta, robot):
    """Elbows of an own picture of the machine, shape (..., 3 arms, 3)."""
    k = robot.kinematics
    azimuth = np.radians(np.array(k.arm_azimuth_deg) + AZIMUTH_DEG)
    reach = k.base_radius_m - k.plate_radius_m + RADIUS + (k.upper_arm_length_m + UPPER_ARM) * np.cos(theta)
    down = -(k.upper_arm_length_m + UPPER_ARM) * np.sin(theta)
    return np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), down], axis=-1)


def test_rods_have_the_length_of_their_arm(calibrated, points):
    theta = kinematics.inverse(points, calibrated)
    lengths = np.linalg.norm(points[:, None] - elbows(theta, calibrated), axis=-1)
    assert lengths == pytest.approx(
        np.broadcast_to(calibrated.kinematics.forearm_length_m + FOREARM, lengths.shape), abs=1e-12
    )


def test_forward_undoes_inverse(calibrated, points):
    theta = kinematics.inverse(points, calibrated)
    assert kinematics.forward(theta, calibrated) == pytest.approx(points, abs=1e-11)
    assert np.abs(kinematics.forward(theta, calibrated.replace(kinematics__forearm_correction_m=[0.0] * 3))
                  - points).max() > 1e-3  # fmt: skip


def test_the_jacobian_is_the_slope_of_forward_kinematics(calibrated, points):
    theta = kinematics.inverse(points, calibrated)
    jacobian = kinematics.jacobian(theta, points, calibrated)
    for i, step in enumerate(STEP * np.eye(3)):
        ahead, behind = (kinematics.forward(theta + sign * step, calibrated) for sign in (1.0, -1.0))
        assert jacobian[..., i] == pytest.approx((ahead - behind) / (2.0 * STEP), abs=DIFFERENCE)


def test_its_derivative_is_its_slope_on_a_path(calibrated, points):
    theta, rate = kinematics.inverse(points, calibrated), np.array([0.7, -1.1, 0.4])
    jacobian = kinematics.jacobian(theta, points, calibrated)
    found = kinematics.jacobian_dot(theta, rate, points, jacobian @ rate, calibrated)
    around = [theta + sign * STEP * rate for sign in (1.0, -1.0)]
    ahead, behind = (kinematics.jacobian(t, kinematics.forward(t, calibrated), calibrated) for t in around)
    assert found == pytest.approx((ahead - behind) / (2.0 * STEP), abs=1e-7)
