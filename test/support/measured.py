"""Measurements of a robot with deviating arms by its kinematics, without drives and gears."""

import functools

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.studies.calibration import estimation, model, planning
from delta3_pacdrive.studies.calibration.study import Measurements, Method, Requirements

TRUTH = np.concatenate(
    [
        np.array([1e-4, -0.5e-4, 0.7e-4, -1.5e-4, 1e-4, 0.5e-4, 0.8e-4, -1e-4, 0.3e-4]),
        np.radians([0.02, -0.015, 0.01, 0.015, -0.02, 0.01]),
    ]
)
NOISE_M = 2e-5


@functools.cache
def planned(robot, method='base', number=24, checks=8, **more):
    """Return the poses of a calibration."""
    return planning.plan(
        Requirements(Method(method), number, checks, more.pop('noise_m', NOISE_M), **more), robot
    )


def instrument(poses, robot, truth=TRUTH, noise_m=NOISE_M, seed=1):
    """Return points of an instrument in the frame base."""
    shafts = estimation.shafts_of(poses.points_m, robot)
    noise = noise_m * np.random.default_rng(seed).standard_normal(shafts.shape)
    return Measurements(
        shafts + robot.kinematics.corrections.angle_rad,
        model.tcp(shafts, truth, robot) + noise,
        poses.checks,
        (),
        poses.diameters_m,
    )


def probe(poses, robot, truth=TRUTH, noise_m=NOISE_M, seed=1):
    """Return touches: shaft positions with the true TCP on the surface, up to the noise."""
    shafts = estimation.shafts_of(poses.points_m, robot)
    noise = noise_m * np.random.default_rng(seed).standard_normal((len(shafts), 1))
    wanted = poses.points_m + noise * poses.directions
    for _ in range(6):
        off = wanted - model.tcp(shafts, truth, robot)
        jacobian = kinematics.jacobian(shafts, poses.points_m, robot)
        shafts = shafts + np.linalg.solve(jacobian, off[..., None])[..., 0]
    angles = shafts + robot.kinematics.corrections.angle_rad
    return Measurements(angles, np.full_like(angles, np.nan), poses.checks, poses.objects, poses.diameters_m)


def off_m(x, robot, truth=TRUTH, is_placed=True):
    """Return how far a TCP with corrections x is from the true one, rms over the workspace [m]."""
    places = estimation.workspace(robot)
    shafts = estimation.shafts_of(places, robot)
    off = model.tcp(shafts, x, robot) - model.tcp(shafts, truth, robot)
    if not is_placed:
        off = estimation.unplaced(off.reshape(-1, 1), places).reshape(-1, 3)
    return float(np.sqrt((off**2).sum(axis=1).mean()))
