"""Joint motion from TCP motion through the Jacobian (4.12 to 4.16), with exact or inexact lengths of P1.

    thetadot  = J^-1 Xdot                        (4.12)
    thetaddot = J^-1 (Xddot - Jdot thetadot)     (4.16)

J = S^-1 D depends on joint angles and TCP position (4.13). With s_i = X - C_i, neither s_i nor b_i contains l_B: if
both come from the recording, as in 11.2, the length of the forearms has no effect.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from delta3_pacdrive.errors import ParameterError, SingularityError
from delta3_pacdrive.kinematics import forward, geometry, inverse, jacobian, jacobian_dot
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion

# lengths of P1 by their symbols in the thesis
LENGTHS = {
    'l_A': 'upper_arm_length_m',
    'l_B': 'forearm_length_m',
    'R_A': 'base_radius_m',
    'R_B': 'plate_radius_m',
}


class Pose(StrEnum):
    """Source of the angles and positions at which the Jacobian is evaluated."""

    RECORDED = 'recorded'  # both recorded (11.2)
    FORWARD = 'forward'  # recorded angles, positions by forward kinematics (4.5, last sentence)
    INVERSE = 'inverse'  # recorded positions, angles by inverse kinematics


@dataclass(frozen=True)
class JointMotion:
    """Joint velocities [rad/s] and accelerations [rad/s^2]; shapes (n, 3)."""

    velocity: Floats
    acceleration: Floats


def inexact(kinematics: Kinematics, errors: Mapping[str, float]) -> Kinematics:
    """Return a geometry whose lengths are off by ``errors`` [m], by symbol.

    Raises
    ------
    ParameterError
        A symbol is unknown, or a length would not be positive.

    """
    values = {}
    for symbol, error in errors.items():
        if symbol not in LENGTHS:
            raise ParameterError(f'{symbol} is not a length of P1, expected one of {", ".join(LENGTHS)}')
        nominal = getattr(kinematics, LENGTHS[symbol])
        if not nominal + error > 0.0:
            raise ParameterError(
                f'{symbol} would be {nominal + error:g} m with its error of {error:g} m, not positive'
            )
        values[LENGTHS[symbol]] = nominal + error
    return dataclasses.replace(kinematics, **values)


def posed(theta: Floats, tcp: Floats, kinematics: Kinematics, pose: Pose) -> tuple[Floats, Floats]:
    """Return angles [rad] and positions [m] according to ``pose``; shapes (n, 3); raises UnreachableError."""
    if pose is Pose.FORWARD:
        return theta, forward(theta, kinematics)
    if pose is Pose.INVERSE:
        return inverse(tcp, kinematics), tcp
    return theta, tcp


def joint_motion(motion: Motion, kinematics: Kinematics, pose: Pose = Pose.RECORDED) -> JointMotion:
    """Compute joint velocities and accelerations through the Jacobian of a geometry.

    The acceleration uses the computed velocity.

    Raises
    ------
    UnreachableError
        A pose is not reachable with the geometry.
    SingularityError
        The Jacobian of a pose is singular.

    """
    theta, tcp = posed(motion.theta, motion.tcp, kinematics, pose)
    j = jacobian(theta, tcp, kinematics)
    velocity = solve(j, motion.tcp_velocity)
    j_dot = jacobian_dot(theta, velocity, tcp, motion.tcp_velocity, kinematics)
    return JointMotion(velocity, solve(j, motion.tcp_acceleration - product(j_dot, velocity)))


def without_jacobian_dot(motion: Motion, kinematics: Kinematics) -> Floats:
    """Return the joint accelerations [rad/s^2] of (4.16) without Jdot; shape (n, 3)."""
    return solve(jacobian(motion.theta, motion.tcp, kinematics), motion.tcp_acceleration)


def with_printed_jacobian_dot(motion: Motion, kinematics: Kinematics) -> Floats:
    """Return the joint accelerations [rad/s^2] with (4.15) as printed, + Sdot J instead of - Sdot J; shape (n, 3)."""
    g = geometry(kinematics)[0]
    u = np.stack([g['cos_alpha'], g['sin_alpha'], np.zeros(3)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    cosine, sine = np.cos(motion.theta)[..., None], np.sin(motion.theta)[..., None]
    l_a, r = g['l_a'][:, None], g['r'][:, None]
    s = motion.tcp[:, None] - (r * u + l_a * (cosine * u - sine * up))
    b = -l_a * (sine * u + cosine * up)
    j = jacobian(motion.theta, motion.tcp, kinematics)
    velocity = solve(j, motion.tcp_velocity)
    s_dot = motion.tcp_velocity[:, None] - b * velocity[..., None]
    right = jacobian_dot(motion.theta, velocity, motion.tcp, motion.tcp_velocity, kinematics)
    printed = right + 2.0 * np.linalg.solve(s, s_dot @ j)
    return solve(j, motion.tcp_acceleration - product(printed, velocity))


def product(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply matrices (n, 3, 3) by vectors (n, 3)."""
    return np.asarray(np.einsum('nij,nj->ni', matrices, vectors))


def solve(matrices: Floats, vectors: Floats) -> Floats:
    """Solve systems with matrices (n, 3, 3) and right-hand sides (n, 3); raises SingularityError."""
    try:
        return np.asarray(np.linalg.solve(matrices, vectors[..., None])[..., 0])
    except np.linalg.LinAlgError:
        raise SingularityError('the Jacobian of a pose on the trajectory is singular') from None
