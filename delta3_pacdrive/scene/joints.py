"""Joints of the robot as a tree: angles and speeds of the passive joints, computed from those of the arms.

With u_i outward and t_i along the axis of motor i, and the forearm s_i = X - C_i (4.5), which has the length l_B,

    phi_i    = atan2(-s_i.z, s_i.u_i)                   the forearm in the plane of its arm, as theta_i counts
    pitch_i  = phi_i - theta_i,   swing_i = asin(s_i.t_i / l_B)
    phidot_i = (s_i.z sdot_i.u_i - s_i.u_i sdot_i.z)/(s_i.u_i^2 + s_i.z^2),   sdot_i = Xdot - b_i thetadot_i
    swingdot_i = sdot_i.t_i / (l_B cos swing_i)

pitch_i and swing_i are the angles of the universal joint at the elbow, equal for both rods of a forearm. In the tree
the plate is attached to rod 1a by two joints that compensate the rotation of the rod. The ends of the other five rods
coincide with their joints on the plate.

Arguments of the functions and kernels:

``theta``, ``thetadot``
    Arm angles [rad] and speeds [rad/s], shape (3,); for functions (..., 3).
``parameters``
    Robot, a ``Parameters``.
``unreachable``
    Whether angles without a solution ``raise`` an error, or give passive joints of ``nan``.
``angles``, ``rates``
    Rows of arm angles [rad] and speeds [rad/s], shape (n, 3).
``out``
    Output: positions [rad] and speeds [rad/s] of ``JOINTS``, shape (n, 2, 17).
``geometry_record``
    An array of one ``kinematics.GEOMETRY``, shape (1,).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive import kinematics
from delta3_pacdrive.kinematics import Unreachable, geometry, jacobian_columns, pose
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.telegrams import JOINTS

PITCH, SWING = slice(3, 15, 4), slice(4, 15, 4)  # of rods 1a, 2a, 3a


@kernel
def tree_joints(angles, rates, out, geometry_record):
    """Fill ``out``; passive joints are nan where FK fails."""
    g = geometry_record[0]
    for n in range(angles.shape[0]):
        theta, thetadot = triple(angles[n]), triple(rates[n])
        _, s, b = pose(theta, g)
        j1, j2, j3 = jacobian_columns(s, b)
        xdot = combine(thetadot[0], j1, thetadot[1], j2, thetadot[2], j3)
        for i in range(3):
            sdot = combine(1.0, xdot, -thetadot[i], b[i], 0.0, xdot)
            outward = s[i][0] * g.cos_alpha[i] + s[i][1] * g.sin_alpha[i]
            across = s[i][1] * g.cos_alpha[i] - s[i][0] * g.sin_alpha[i]
            outward_rate = sdot[0] * g.cos_alpha[i] + sdot[1] * g.sin_alpha[i]
            across_rate = sdot[1] * g.cos_alpha[i] - sdot[0] * g.sin_alpha[i]
            square = outward * outward + s[i][2] * s[i][2]
            length = math.sqrt(square)
            # relative to the arm, so that the discontinuity is where the forearm would coincide with the arm
            along = outward * math.cos(theta[i]) - s[i][2] * math.sin(theta[i])
            below = -outward * math.sin(theta[i]) - s[i][2] * math.cos(theta[i])
            turning = (s[i][2] * outward_rate - outward * sdot[2]) / square
            out[n, 0, i], out[n, 1, i] = theta[i], thetadot[i]
            for rod in range(2):
                column = 3 + 4 * i + 2 * rod
                out[n, 0, column], out[n, 1, column] = math.atan2(below, along), turning - thetadot[i]
                out[n, 0, column + 1], out[n, 1, column + 1] = (
                    math.atan2(across, length),
                    across_rate / length,
                )
        for row in range(2):
            out[n, row, 15] = -out[n, row, 4]
            out[n, row, 16] = -(out[n, row, 0] + out[n, row, 3])


def joints(theta: ArrayLike, parameters: Parameters, *, unreachable: Unreachable = 'raise') -> Floats:
    """Positions [rad] of all joints of the tree, in the order of ``JOINTS``, shape (..., 17).

    Raises UnreachableError if forward kinematics has no solution.
    """
    return joint_motion(theta, 0.0, parameters, unreachable=unreachable)[0]


def joint_motion(
    theta: ArrayLike, thetadot: ArrayLike, parameters: Parameters, *, unreachable: Unreachable = 'raise'
) -> tuple[Floats, Floats]:
    """Positions [rad] and speeds [rad/s] of all joints of the tree, in the order of ``JOINTS``, shapes (..., 17).

    Raises UnreachableError if forward kinematics has no solution.
    """
    angles, shape = kinematics.rows(theta, 'theta')
    rates = np.empty_like(angles)
    rates[:] = np.broadcast_to(np.asarray(thetadot, dtype=np.float64), (*shape, 3)).reshape(-1, 3)
    kinematics.forward(angles, parameters, unreachable=unreachable)
    out = np.empty((len(angles), 2, len(JOINTS)))
    tree_joints(angles, rates, out, geometry(parameters))
    return out[:, 0].reshape(*shape, len(JOINTS)), out[:, 1].reshape(*shape, len(JOINTS))
