"""Tests of the picture of a robot with individually calibrated arms."""

from xml.etree import ElementTree as ET

import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive.scene.parts import Sizes, parts
from delta3_pacdrive.scene.poses import frames, poses
from delta3_pacdrive.scene.urdf import urdf
from scenes import rods, workspace

CLOSED = 1e-9  # [m]


@pytest.fixture(scope='module')
def calibrated(robot):
    return robot.replace(
        kinematics__upper_arm_correction_m=[0.003, -0.002, 0.001],
        kinematics__forearm_correction_m=[-0.004, 0.003, 0.002],
        kinematics__radius_correction_m=[0.002, 0.001, -0.003],
        kinematics__arm_azimuth_correction_deg=[0.4, -0.5, 0.2],
    )


def test_every_loop_closes_with_the_lengths_of_its_arm(calibrated):
    k = calibrated.kinematics
    _, joint = frames(calibrated)
    found = poses(workspace(calibrated, 200, 20), calibrated)
    for i, side, name in rods():
        place, turned = found.of(name)
        end = place + Rotation.from_quat(turned).apply([k.forearm_lengths_m[i], 0.0, 0.0])
        plate, _ = found.of('plate')
        assert end == pytest.approx(plate + joint[i, 0 if side > 0 else 1], abs=CLOSED)
        half = 0.5 * Sizes.of(k).rod_distance_m
        hip, angle = found.of(f'arm{i + 1}')
        elbow = hip + Rotation.from_quat(angle).apply([k.upper_arm_lengths_m[i], side * half, 0.0])
        assert place == pytest.approx(elbow, abs=CLOSED)


def test_shapes_have_the_lengths_of_their_arm(calibrated):
    named = {part.name: part for part in parts(calibrated)}
    k = calibrated.kinematics
    assert [named[f'arm{i}'].shapes[1].length_m for i in (1, 2, 3)] == list(k.upper_arm_lengths_m)
    assert [named[f'forearm{i}b'].shapes[0].length_m for i in (1, 2, 3)] == list(k.forearm_lengths_m)


def test_urdf_describes_every_arm(calibrated):
    k = calibrated.kinematics
    places = {
        joint.get('name'): joint.find('origin') for joint in ET.fromstring(urdf(calibrated)).iter('joint')
    }
    for i in range(3):
        for rod in (f'forearm{i + 1}a', f'forearm{i + 1}b'):
            assert float(places[f'{rod}_end_fixed'].get('xyz').split()[0]) == k.forearm_lengths_m[i]
            assert float(places[f'{rod}_pitch'].get('xyz').split()[0]) == k.upper_arm_lengths_m[i]
        assert float(places[f'motor{i + 1}_fixed'].get('rpy').split()[2]) == k.arm_azimuth_rad[i]
