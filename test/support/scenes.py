"""Places, robots and rods for the tests of the picture of the robot."""

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.scene.parts import ARMS

SEED = 20090418
ROBOTS = {
    'default': {},
    'short and wide': {
        'kinematics__upper_arm_length_m': 0.25,
        'kinematics__forearm_length_m': 0.7,
        'kinematics__base_radius_m': 0.3,
        'kinematics__plate_radius_m': 0.02,
        'kinematics__workspace_diameter_m': 0.6,
        'kinematics__workspace_top_m': -0.45,
        'kinematics__workspace_bottom_m': -0.6,
    },
    'turned, with unequal directions': {'kinematics__arm_azimuth_deg': (30.0, 140.0, 275.0)},
}


def workspace(robot, count=2000, border=500):
    """Angles of places in the workspace and on its border that all arms reach, shape (n, 3)."""
    print(f'seed {SEED}')
    random, k = np.random.default_rng(SEED), robot.kinematics
    radius = (
        0.5 * k.workspace_diameter_m * np.sqrt(np.append(random.uniform(0.0, 1.0, count), np.ones(border)))
    )
    azimuth = random.uniform(-np.pi, np.pi, count + border)
    z = random.uniform(k.workspace_bottom_m, k.workspace_top_m, count + border)
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
    theta = kinematics.inverse(points, robot, unreachable='nan')
    theta = theta[np.isfinite(theta).all(axis=1)]
    assert len(theta) > (count + border) // 2
    return theta


def rods():
    """Number of the arm, sign of the side, and name of each rod."""
    return [
        (i, side, f'forearm{arm}{rod}') for i, arm in enumerate(ARMS) for side, rod in ((1, 'a'), (-1, 'b'))
    ]
