"""Poses of the parts of the robot, vectorized over arm angles.

With R_y and R_z for rotations about y and z, and the distance w between the rods of a forearm,

    arm       at R_A u_i,                          rotation R_z(alpha_i) R_y(theta_i)
    forearm   at the elbow, +-w/2 along its axis,  rotation R_z(alpha_i) R_y(theta_i + pitch_i) R_z(swing_i)
    plate     at the TCP,                          no rotation
    tool      at the TCP,                          rotation R_z(turn) of a rotary axis, with the payload

with the angles pitch_i and swing_i of the universal joint at the elbow (``joints``).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive import kinematics
from delta3_pacdrive.kinematics import Unreachable
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.joints import PITCH, SWING, joints
from delta3_pacdrive.scene.parts import ARMS, NAMES, RODS, TURNING_NAMES, Sizes


class Poses(NamedTuple):
    """Poses of all parts in the frame ``base``."""

    position: Floats  # [m], shape (..., parts, 3), in the order of ``parts.names_of``
    quaternion: Floats  # unit quaternions x, y, z, w, shape (..., parts, 4); w is not negative

    def of(self, name: str) -> tuple[Floats, Floats]:
        """Return position [m] and quaternion of the part ``name``, shapes (..., 3) and (..., 4)."""
        number = TURNING_NAMES.index(name)  # the names of all robots come first
        return self.position[..., number, :], self.quaternion[..., number, :]


def frames(parameters: Parameters) -> tuple[Floats, Floats]:
    """Return the positions at which parts are joined.

    Parameters
    ----------
    parameters
        The robot.

    Returns
    -------
    hip
        Middle of the hub of each arm in the frame ``base`` [m], shape (3, 3).
    joint
        Joints of the rods on the plate, in the frame ``plate`` [m], arm by rod, shape (3, 2, 3).

    """
    k = parameters.kinematics
    half = 0.5 * Sizes.of(k).rod_distance_m
    azimuth = np.array(k.arm_azimuth_rad)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=-1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(3)], axis=-1)
    sides = np.array([half, -half])
    joint = k.plate_radius_m * outward[:, None] + sides[:, None] * across[:, None]
    return np.array(k.base_radii_m)[:, None] * outward, joint


def poses(
    theta: ArrayLike,
    parameters: Parameters,
    turn_rad: ArrayLike = 0.0,
    *,
    unreachable: Unreachable = 'raise',
) -> Poses:
    """Compute the poses of all parts for arm angles.

    Parameters
    ----------
    theta
        Arm angles [rad], shape (..., 3).
    parameters
        The robot.
    turn_rad
        Tool angle [rad], shape (...); used only for a robot with a rotary axis.
    unreachable
        ``raise`` an error for angles without a solution, or fill the poses that depend on it with ``nan``.

    Returns
    -------
    Poses
        In the order of ``parts.names_of``, in the frame ``base``.

    Raises
    ------
    UnreachableError
        Forward kinematics has no solution.

    """
    angles, shape = kinematics.rows(theta, 'theta')
    tcp = kinematics.forward(angles, parameters, unreachable=unreachable)
    at = joints(angles, parameters, unreachable='nan')
    hip, joint = frames(parameters)
    azimuth = np.array(parameters.kinematics.arm_azimuth_rad)
    along = np.stack(
        [np.cos(angles) * np.cos(azimuth), np.cos(angles) * np.sin(azimuth), -np.sin(angles)], axis=-1
    )
    elbow = hip + np.array(parameters.kinematics.upper_arm_lengths_m)[:, None] * along
    position = np.zeros((len(angles), len(NAMES), 3))
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (len(angles), len(NAMES), 1))
    motors, arms = ([NAMES.index(f'{kind}{arm}') for arm in ARMS] for kind in ('motor', 'arm'))
    rods = [NAMES.index(f'forearm{rod}') for rod in RODS]
    in_tcp = [NAMES.index(name) for name in ('plate', 'tool', 'payload')]
    position[:, motors] = position[:, arms] = hip
    position[:, rods] = (elbow[:, :, None] + joint - joint.mean(axis=1, keepdims=True)).reshape(
        -1, len(RODS), 3
    )
    position[:, in_tcp] = tcp[:, None]
    quaternion[:, motors] = _turned(azimuth, 0.0 * angles)
    quaternion[:, arms] = _turned(azimuth, angles)
    forearms = _turned(azimuth, angles + at[:, PITCH], at[:, SWING])
    quaternion[:, rods] = np.repeat(forearms, 2, axis=1)
    for _ in tool_bar.bars(parameters):
        turn = np.broadcast_to(np.asarray(turn_rad, dtype=np.float64), shape).reshape(-1)
        quaternion[:, [NAMES.index(name) for name in ('tool', 'payload')]] = tool_bar.about_z(turn)[:, None]
        more = _with_bar(tcp, turn, parameters)
        position, quaternion = (
            np.concatenate([own, added], axis=1)
            for own, added in zip((position, quaternion), more, strict=True)
        )
    count = position.shape[1]
    return Poses(position.reshape(*shape, count, 3), quaternion.reshape(*shape, count, 4))


def _with_bar(tcp: Floats, turn: Floats, parameters: Parameters) -> tuple[Floats, Floats]:
    """Return positions and quaternions of the parts of ``tool_bar``, shapes (n, 4, 3) and (n, 4, 4)."""
    top = np.array([0.0, 0.0, tool_bar.top_m(Sizes.of(parameters.kinematics).tool_height_m)])
    still, bar = np.tile([0.0, 0.0, 0.0, 1.0], (len(tcp), 1)), tool_bar.directed(tcp + top, turn)
    middle = np.zeros_like(tcp)
    position = np.stack([middle, middle, tcp + top, tcp], axis=1)
    return position, np.stack([still, bar, bar, tool_bar.about_z(turn)], axis=1)


def _turned(azimuth: Floats, pitch: Floats, swing: Floats | float = 0.0) -> Floats:
    """Return the rotations R_z(azimuth) R_y(pitch) R_z(swing) as unit quaternions, shape (n, 3, 4).

    The closed form avoids scipy.spatial, whose import takes longer than displaying the robot.
    """
    more, less, half = 0.5 * (azimuth + swing), 0.5 * (azimuth - swing), 0.5 * pitch
    found = np.stack(
        [
            -np.sin(half) * np.sin(less),
            np.sin(half) * np.cos(less),
            np.cos(half) * np.sin(more),
            np.cos(half) * np.cos(more),
        ],
        axis=-1,
    )
    return np.where(found[..., 3:] < 0.0, -found, found)
