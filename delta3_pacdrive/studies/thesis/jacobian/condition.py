"""Deviation over the condition of J: poses on rays from the middle of the workspace to the first singularity.

Errors of the lengths change J to J'. The joint velocities then deviate by (J'^-1 J - 1) thetadot; the spectral norm of
this matrix is the relative deviation in the worst direction of motion, to first order
|J^-1 dJ| <= cond(J) |dJ| / |J|. A ray ends at a serial singularity, where an arm is stretched (s_i.b_i = 0), or at a
parallel one, where det S and with it det J changes its sign.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.kinematics import inverse, inverse_all, jacobian, singularity
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.thesis.jacobian.mapping import LENGTHS, Pose, inexact, posed
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion

HEIGHTS = 6  # of the rays, between top and bottom of the workspace
AZIMUTHS = 25  # over 120 degrees, the symmetry of the arms
RADII = 13  # of the poses in the workspace
GAPS = 41  # poses per ray, evenly in the logarithm of the distance to its end
GAP_MIN = 1e-4  # distance of the last pose from the end, as share of the ray
STEP_M = 1e-7  # much smaller than the least distance from a singularity
BISECTIONS = 50
FITTED = 10.0  # exponents are fitted to poses with a larger condition
BAND = (5.0, 50.0, 95.0)  # percentiles


@dataclass(frozen=True)
class Sweep:
    """Deviations per millimetre at n poses in the workspace and beyond, up to its singularities."""

    tcp: Floats  # m, shape (n, 3)
    gap_m: Floats  # distance to the end of the ray, shape (n,)
    serial_end: NDArray[np.bool_]  # the ray ends at a serial singularity, else a parallel one, shape (n,)
    condition: Floats  # of J, shape (n,)
    serial: Floats  # least s_i.b_i/(l_A l_B) of the arms, shape (n,)
    parallel: Floats  # |det S|/l_B^3, shape (n,)
    per_mm: dict[
        Pose, Floats
    ]  # largest deviation over the directions of motion [%/mm], shape (n, len(LENGTHS))

    def total(self, pose: Pose) -> Floats:
        """Return the root of the sum of squares over the lengths, each 1 mm off [%]; shape (n,)."""
        return np.asarray(np.linalg.norm(self.per_mm[pose], axis=1))


def sweep(kinematics: Kinematics) -> Sweep:
    """Return the deviations on rays in all directions at several heights."""
    z = np.linspace(kinematics.workspace_bottom_m, kinematics.workspace_top_m, HEIGHTS)
    azimuth = np.linspace(0.0, math.tau / 3.0, AZIMUTHS)
    z, azimuth = (grid.ravel() for grid in np.meshgrid(z, azimuth, indexing='ij'))
    starts = np.stack([0.0 * z, 0.0 * z, z], axis=-1)
    directions = np.stack([np.cos(azimuth), np.sin(azimuth), 0.0 * z], axis=-1)
    return along(starts, directions, kinematics)


def along(starts: Floats, directions: Floats, kinematics: Kinematics) -> Sweep:
    """Return the deviations on rays from points [m] in directions of length 1; shapes (r, 3)."""
    length = limits(starts, directions, kinematics)
    beyond = starts + (1.0 + GAP_MIN) * length[:, None] * directions
    serial_end = np.repeat(np.isnan(inverse_all(beyond, kinematics)[:, 0]).any(axis=1), GAPS)
    gap = (length[:, None] * np.geomspace(1.0, GAP_MIN, GAPS)).ravel()
    whole, start, direction = (np.repeat(values, GAPS, axis=0) for values in (length, starts, directions))
    tcp = start + (whole - gap)[:, None] * direction
    theta = inverse(tcp, kinematics)
    j = jacobian(theta, tcp, kinematics)
    serial, parallel = singularity(theta, tcp, kinematics)
    per_mm = {pose: np.stack(_slopes(theta, tcp, j, pose, kinematics), axis=-1) for pose in Pose}
    return Sweep(
        tcp=tcp,
        gap_m=gap,
        serial_end=serial_end,
        condition=np.linalg.cond(j),
        serial=serial.min(axis=1),
        parallel=parallel,
        per_mm=per_mm,
    )


def limits(starts: Floats, directions: Floats, kinematics: Kinematics) -> Floats:
    """Return the distance [m] from points along unit vectors to the first singularity; shapes (r, 3) -> (r,)."""
    low = np.zeros(len(starts))
    high = np.full(len(starts), kinematics.upper_arm_length_m + kinematics.forearm_length_m)
    handedness = np.linalg.det(jacobian(inverse(starts, kinematics), starts, kinematics))
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        regular = _regular(starts + middle[:, None] * directions, handedness, kinematics)
        low, high = np.where(regular, middle, low), np.where(regular, high, middle)
    return low


def of_motion(motion: Motion, kinematics: Kinematics) -> Floats:
    """Return the condition number of the Jacobian in every sample; shape (n,)."""
    return np.asarray(np.linalg.cond(jacobian(motion.theta, motion.tcp, kinematics)))


def worst_direction(theta: Floats, tcp: Floats, kinematics: Kinematics, pose: Pose) -> Floats:
    """Return the deviation [%] in the worst direction, each length 1 mm off, independently; shapes (n, 3) -> (n,)."""
    slopes = _slopes(theta, tcp, jacobian(theta, tcp, kinematics), pose, kinematics)
    return np.asarray(np.linalg.norm(slopes, axis=0))


def exponents(found: Sweep) -> dict[str, dict[str, float]]:
    """Return exponents p of deviation ~ cond(J)^p above ``FITTED``, by pose and kind of singularity."""
    far = found.condition > FITTED
    kinds = {'serial': far & found.serial_end, 'parallel': far & ~found.serial_end, 'all': far}
    return {
        pose.value: {
            kind: float(np.polyfit(np.log(found.condition[rows]), np.log(found.total(pose)[rows]), 1)[0])
            for kind, rows in kinds.items()
            if np.count_nonzero(rows) > 1
        }
        for pose in Pose
    }


def decades(found: Sweep, per_decade: int = 1) -> list[dict[str, Any]]:
    """Return median, 5th and 95th percentile of the deviation [%] per bin of the condition, by pose; no empty bins."""
    numbers = np.floor(per_decade * np.log10(found.condition)).astype(np.int64)
    rows = []
    for number in np.unique(numbers):
        own = numbers == number
        row: dict[str, Any] = {
            'from': float(10.0 ** (number / per_decade)),
            'to': float(10.0 ** ((number + 1) / per_decade)),
            'poses': int(own.sum()),
        }
        for pose in Pose:
            low, middle, high = np.percentile(found.total(pose)[own], BAND)
            row[pose.value] = {'p5': float(low), 'median': float(middle), 'p95': float(high)}
        rows.append(row)
    return rows


def workspace(kinematics: Kinematics) -> dict[str, Any]:
    """Return condition and deviation [%] within the workspace of P1, by pose."""
    z = np.linspace(kinematics.workspace_bottom_m, kinematics.workspace_top_m, HEIGHTS)
    azimuth = np.linspace(0.0, math.tau / 3.0, AZIMUTHS)
    radius = np.linspace(0.0, 0.5 * kinematics.workspace_diameter_m, RADII)
    z, azimuth, radius = (grid.ravel() for grid in np.meshgrid(z, azimuth, radius))
    tcp = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
    theta = inverse(tcp, kinematics)
    own = np.linalg.cond(jacobian(theta, tcp, kinematics))
    result: dict[str, Any] = {'condition': {'min': float(own.min()), 'max': float(own.max())}}
    for pose in Pose:
        worst = worst_direction(theta, tcp, kinematics, pose)
        result[pose.value] = {
            'least': float(worst.min()),
            'median': float(np.median(worst)),
            'largest': float(worst.max()),
        }
    return result


def _regular(points: Floats, handedness: Floats, kinematics: Kinematics) -> NDArray[np.bool_]:
    """Return whether points (r, 3) are reachable with this sign of the determinant of J (r,); shape (r,)."""
    theta = inverse_all(points, kinematics)[:, 0]
    regular: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(theta), axis=1)
    j = jacobian(theta[regular], points[regular], kinematics)
    with np.errstate(invalid='ignore'):  # det S is exactly 0: not regular
        regular[regular] = np.linalg.det(j) * handedness[regular] > 0.0
    return regular


def _slopes(theta: Floats, tcp: Floats, j: Floats, pose: Pose, kinematics: Kinematics) -> list[Floats]:
    """Return the deviation [%/mm] in the worst direction of motion per error of each length; shapes (n,)."""
    slopes = []
    for symbol in LENGTHS:
        quotients = []
        for step in (STEP_M, -STEP_M):
            wrong = inexact(kinematics, {symbol: step})
            angles, positions = posed(theta, tcp, wrong, pose)
            quotients.append(np.linalg.solve(jacobian(angles, positions, wrong), j))
        change = (quotients[0] - quotients[1]) / (2.0 * STEP_M)
        slopes.append(np.asarray(0.1 * np.linalg.norm(change, 2, axis=(1, 2))))  # 100 % and 1 mm
    return slopes
