"""Kinematics of the planar two-link arm that introduces chapter 3 of the thesis.

Base frame: origin in the first joint, x and y in the plane of the arm. theta_1 is the angle of the lower arm (length a)
to the x axis, theta_2 the angle of the upper arm (length b) to the lower arm, both counter-clockwise. As printed, (3.1)
measures theta_2 from the x axis; (3.2), (3.6) and its inverse Jacobian use the relative angle, as does this module.

    elbow     (a cos theta_1, a sin theta_1)
    tool      elbow + (b cos(theta_1 + theta_2), b sin(theta_1 + theta_2))     (3.1, corrected)
    det J     a b sin theta_2, singular where it vanishes: theta_2 = 0 and pi  (3.3)
"""

import math
from dataclasses import dataclass, fields
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ParameterError, SingularityError, UnreachableError, shown
from delta3_pacdrive.numerics.types import Floats

LENGTH_MIN_M, LENGTH_MAX_M = 1e-3, 1e3
ROUNDING = 1e-12  # relative to the reach: tolerance for a point on its boundary
SINGULAR_SINE = math.sqrt(ROUNDING)  # below, inverse kinematics cannot distinguish theta_2 from 0 or pi


@dataclass(frozen=True)
class TwoLinkArm:
    """Lengths of the two links; raises ParameterError unless both are from 1 mm to 1 km."""

    lower_arm_length_m: float = 0.4  # a
    upper_arm_length_m: float = 0.3  # b

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, int | float) or not LENGTH_MIN_M <= value <= LENGTH_MAX_M:
                raise ParameterError(
                    f'{field.name} is {shown(value)}, but must be a number from {LENGTH_MIN_M:g} to {LENGTH_MAX_M:g}'
                )

    @property
    def outer_reach_m(self) -> float:
        """A + b: distance of the tool from the base with the arm stretched (theta_2 = 0)."""
        return self.lower_arm_length_m + self.upper_arm_length_m

    @property
    def inner_reach_m(self) -> float:
        """|a - b|: distance of the tool from the base with the arm folded (theta_2 = pi)."""
        return abs(self.lower_arm_length_m - self.upper_arm_length_m)


class Branch(Enum):
    """Solutions of the inverse kinematics (Fig. 3.4), named after their shape for a tool on the side of +x."""

    ELBOW_UP = 'elbow up'  # theta_2 <= 0: elbow to the left of the line from base to tool
    ELBOW_DOWN = 'elbow down'  # theta_2 >= 0: elbow to the right


def elbow(theta: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return the position of the elbow [m] for joint angles [rad]; shapes (..., 2)."""
    theta_1 = _pairs(theta, 'theta')[..., 0]
    return arm.lower_arm_length_m * np.stack([np.cos(theta_1), np.sin(theta_1)], axis=-1)


def forward(theta: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return the position of the tool [m] for joint angles [rad] (3.1, corrected); shapes (..., 2)."""
    return elbow(theta, arm) + arm.upper_arm_length_m * orientation(theta)[..., 0]


def orientation(theta: ArrayLike) -> Floats:
    """Return the tool axes i_2, j_2 in the base frame as columns (3.2, corrected); shapes (..., 2) -> (..., 2, 2)."""
    angle = _pairs(theta, 'theta').sum(axis=-1)
    cosine, sine = np.cos(angle), np.sin(angle)
    return _matrix(((cosine, -sine), (sine, cosine)))


def inverse(p: ArrayLike, arm: TwoLinkArm, branch: Branch | str) -> Floats:
    """Return the joint angles [rad], from -pi to pi, for tool positions [m] (3.2; 3.3 to 3.5); shapes (..., 2).

    With D = cos theta_2 as in (3.4), 2ab(1 - D) = (a + b)^2 - r^2 and 2ab(1 + D) = r^2 - (a - b)^2; their quotient is
    tan^2(theta_2/2). It avoids the cancellation in 1 + D near the base for links of equal length. On the singular
    circles both branches coincide. At the base (a = b only) theta_1 is arbitrary, and the solution for a point on the
    +x axis is returned.

    Raises
    ------
    UnreachableError
        A point is too far from the base or too close to it; the message gives the first one and the limit.

    """
    points = _pairs(p, 'p')
    a, b = arm.lower_arm_length_m, arm.upper_arm_length_m
    outer, inner = arm.outer_reach_m, arm.inner_reach_m
    x, y = points[..., 0], points[..., 1]
    r = np.hypot(x, y)
    _check_reach(points, r, arm)
    to_stretched = np.maximum((outer - r) * (outer + r), 0.0)
    to_folded = np.maximum((r - inner) * (r + inner), 0.0)
    theta_2 = 2.0 * np.arctan2(np.sqrt(to_stretched), np.sqrt(to_folded))
    if Branch(branch) is Branch.ELBOW_UP:
        theta_2 = -theta_2
    theta_1 = np.arctan2(y, x) - np.arctan2(b * np.sin(theta_2), a + b * np.cos(theta_2))
    return np.stack([theta_1 - math.tau * np.rint(theta_1 / math.tau), theta_2], axis=-1)


def jacobian(theta: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return the Jacobian J [m/rad] with xdot = J thetadot (3.6, corrected); shapes (..., 2) -> (..., 2, 2)."""
    (a_x, a_y), (b_x, b_y) = _links(theta, arm)
    return _matrix(((-a_y - b_y, -b_y), (a_x + b_x, b_x)))


def jacobian_inverse(theta: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return the inverse Jacobian [rad/m] with thetadot = J^-1 xdot (3.3); shapes (..., 2) -> (..., 2, 2).

    Raises
    ------
    SingularityError
        A pose has |sin theta_2| < ``SINGULAR_SINE``; the message gives the first one.

    """
    poses = _pairs(theta, 'theta')
    singular = is_singular(poses)
    if singular.any():
        theta_2 = poses[singular][0, 1]
        shape = 'stretched' if math.cos(theta_2) > 0.0 else 'folded'
        raise SingularityError(
            f'{_number(singular, "pose")}theta_2 = {math.degrees(theta_2):z.6g} deg is singular (the arm is {shape}): '
            f'the Jacobian has no inverse'
        )
    (a_x, a_y), (b_x, b_y) = _links(poses, arm)
    adjugate = _matrix(((b_x, b_y), (-a_x - b_x, -a_y - b_y)))
    return np.asarray(adjugate / determinant(poses, arm)[..., None, None])


def determinant(theta: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return det J = a b sin theta_2 [m^2] (3.3), negative with the elbow up; shapes (..., 2) -> (...)."""
    theta_2 = _pairs(theta, 'theta')[..., 1]
    return np.asarray(arm.lower_arm_length_m * arm.upper_arm_length_m * np.sin(theta_2))


def manipulability(theta: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return Yoshikawa's measure sqrt(det(J J^T)) [m^2], here |det J|; shapes (..., 2) -> (...)."""
    return np.asarray(np.abs(determinant(theta, arm)))


def is_singular(theta: ArrayLike) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return whether theta_2 is 0 or pi (3.3), to within ``SINGULAR_SINE``; shapes (..., 2) -> (...)."""
    return np.asarray(np.abs(np.sin(_pairs(theta, 'theta')[..., 1])) < SINGULAR_SINE)


def joint_speeds(theta: ArrayLike, velocity: ArrayLike, arm: TwoLinkArm) -> Floats:
    """Return joint speeds thetadot = J^-1 xdot [rad/s] for tool velocities [m/s] (3.3); shapes (..., 2).

    Raises
    ------
    SingularityError
        As ``jacobian_inverse``.

    """
    columns = _pairs(velocity, 'velocity')[..., None]
    return np.asarray((jacobian_inverse(theta, arm) @ columns)[..., 0])


def _pairs(values: ArrayLike, name: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 2:
        raise ValueError(f'{name} must have shape (..., 2), not {array.shape}')
    return array


def _matrix(rows: tuple[tuple[Floats, Floats], tuple[Floats, Floats]]) -> Floats:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _links(theta: ArrayLike, arm: TwoLinkArm) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return x and y of the lower arm, and of the upper arm, as vectors in the base frame."""
    lower = elbow(theta, arm)
    upper = arm.upper_arm_length_m * orientation(theta)[..., 0]
    return (lower[..., 0], lower[..., 1]), (upper[..., 0], upper[..., 1])


def _number(wrong: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], noun: str) -> str:
    """Return the index of the first wrong element of several as the beginning of a sentence."""
    return f'{noun} {np.flatnonzero(wrong)[0]}: ' if wrong.size > 1 else ''


def _check_reach(points: Floats, r: Floats, arm: TwoLinkArm) -> None:
    outer, inner = arm.outer_reach_m, arm.inner_reach_m
    allowance = ROUNDING * outer
    wrong = ~((r >= inner - allowance) & (r <= outer + allowance))  # nan is wrong, too
    if wrong.any():
        (x, y), distance = points[wrong][0], r[wrong][0]
        limit = (
            f'the folded arm does not reach closer than {inner:.9g} m'
            if distance < inner
            else f'the stretched arm does not reach farther than {outer:.9g} m'
        )
        raise UnreachableError(
            f'{_number(wrong, "point")}({x:g}, {y:g}) m is {distance:.9g} m from the base, but {limit}'
        )
