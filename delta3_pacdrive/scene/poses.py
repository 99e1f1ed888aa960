"""Where the parts of the robot are, and how its joints stand, for any number of arm angles at once.

Kinematics give the TCP; the rest follows from how the parts hang together. With R_y and R_z for rotations about y and
z, and the distance w between the rods of a forearm,

    arm       at R_A u_i,                          turned by R_z(alpha_i) R_y(theta_i)
    forearm   at the elbow, +-w/2 along its axis,  turned by R_z(alpha_i) R_y(theta_i + pitch_i) R_z(swing_i)
    plate     at the TCP,                          never turned

so that pitch_i and swing_i are the angles of the universal joint at the elbow, the same for both rods. A model that is
a tree hangs the plate on rod 1a: its two joints there undo what turned the rod. The other five rods meet their joints
on the plate by themselves.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.kinematics import Unreachable
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.scene.parts import ARMS, NAMES, RODS, Sizes

AXES = tuple(f'axis{arm}' for arm in ARMS)  # the joints of the motors, as in joint_states
PASSIVE = (
    *(f'forearm{rod}_{angle}' for rod in RODS for angle in ('pitch', 'swing')),
    'plate_swing',
    'plate_pitch',
)
JOINTS = (*AXES, *PASSIVE)


class Poses(NamedTuple):
    """Poses of all parts in the frame ``base``.

    Attributes
    ----------
    position
        [m], shape (..., parts, 3), in the order of ``parts.NAMES``.
    quaternion
        Unit quaternions x, y, z, w, shape (..., parts, 4); w is not negative.

    """

    position: Floats
    quaternion: Floats

    def of(self, name: str) -> tuple[Floats, Floats]:
        """Return position [m] and quaternion of the part ``name``, shapes (..., 3) and (..., 4)."""
        number = NAMES.index(name)
        return self.position[..., number, :], self.quaternion[..., number, :]


class _Chain(NamedTuple):
    """The chain at n angle triples: TCP (n, 3), middles of the elbows (n, 3, 3), angles of the forearms (n, 3) each."""

    tcp: Floats
    elbow: Floats
    pitch: Floats
    swing: Floats


def frames(parameters: Parameters) -> tuple[Floats, Floats]:
    """Return where parts are joined.

    Parameters
    ----------
    parameters
        Of the robot.

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
    return k.base_radius_m * outward, joint


def poses(theta: ArrayLike, parameters: Parameters, *, unreachable: Unreachable = 'raise') -> Poses:
    """Poses of all parts for arm angles.

    Parameters
    ----------
    theta
        Arm angles [rad], shape (..., 3).
    parameters
        Of the robot.
    unreachable
        ``raise`` an error for angles that close no chain, or fill the poses of what hangs on them with ``nan``.

    Returns
    -------
    Poses
        Of the parts in the order of ``parts.NAMES``, in the frame ``base``.

    Raises
    ------
    UnreachableError
        The forearms of an angle triple do not meet.

    """
    angles, shape = kinematics.rows(theta, 'theta')
    chain = _chain(angles, parameters, unreachable)
    hip, joint = frames(parameters)
    position = np.zeros((len(angles), len(NAMES), 3))
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (len(angles), len(NAMES), 1))
    motors, arms = ([NAMES.index(f'{kind}{arm}') for arm in ARMS] for kind in ('motor', 'arm'))
    rods = [NAMES.index(f'forearm{rod}') for rod in RODS]
    in_tcp = [NAMES.index(name) for name in ('plate', 'tool', 'payload')]
    position[:, motors] = position[:, arms] = hip
    position[:, rods] = (chain.elbow[:, :, None] + _sideways(joint)).reshape(-1, len(RODS), 3)
    position[:, in_tcp] = chain.tcp[:, None]
    quaternion[:, motors] = _quaternions(_turned(0.0 * angles, parameters))
    quaternion[:, arms] = _quaternions(_turned(angles, parameters))
    forearms = _quaternions(_turned(angles + chain.pitch, parameters, chain.swing))
    quaternion[:, rods] = np.repeat(forearms, 2, axis=1)
    return Poses(position.reshape(*shape, len(NAMES), 3), quaternion.reshape(*shape, len(NAMES), 4))


def joints(theta: ArrayLike, parameters: Parameters, *, unreachable: Unreachable = 'raise') -> Floats:
    """Positions of all joints of the tree for arm angles: what a complete ``joint_states`` tells.

    Parameters
    ----------
    theta
        Arm angles [rad], shape (..., 3).
    parameters
        Of the robot.
    unreachable
        ``raise`` an error for angles that close no chain, or fill their passive joints with ``nan``.

    Returns
    -------
    Floats
        Joint positions [rad] in the order of ``JOINTS``, shape (..., 17): the three axes, pitch and swing of each of
        the six rods at its elbow, swing and pitch of the plate on rod 1a.

    Raises
    ------
    UnreachableError
        The forearms of an angle triple do not meet.

    """
    angles, shape = kinematics.rows(theta, 'theta')
    chain = _chain(angles, parameters, unreachable)
    rods = np.repeat(np.stack([chain.pitch, chain.swing], axis=-1), 2, axis=1)
    plate = np.stack([-chain.swing[:, 0], -(angles[:, 0] + chain.pitch[:, 0])], axis=-1)
    found = np.concatenate([angles, rods.reshape(-1, 2 * len(RODS)), plate], axis=-1)
    return found.reshape(*shape, len(JOINTS))


def _chain(angles: Floats, parameters: Parameters, unreachable: Unreachable) -> _Chain:
    hip, joint = frames(parameters)
    arms = _turned(angles, parameters)
    elbow = hip + arms.apply([parameters.kinematics.upper_arm_length_m, 0.0, 0.0]).reshape(-1, 3, 3)
    tcp = kinematics.forward(angles, parameters, unreachable=unreachable)
    forearm = tcp[:, None] + joint.mean(axis=1) - elbow
    x, y, z = np.moveaxis(arms.inv().apply(forearm.reshape(-1, 3)).reshape(-1, 3, 3), -1, 0)
    return _Chain(tcp, elbow, np.arctan2(-z, x), np.arctan2(y, np.hypot(x, z)))


def _turned(about_y: Floats, parameters: Parameters, about_z: Floats | None = None) -> Rotation:
    """Return the 3 n rotations R_z(alpha_i) R_y R_z for angles of shape (n, 3)."""
    azimuth = np.broadcast_to(parameters.kinematics.arm_azimuth_rad, about_y.shape)
    angles = [azimuth, about_y] if about_z is None else [azimuth, about_y, about_z]
    return Rotation.from_euler('ZYZ'[: len(angles)], np.stack(angles, axis=-1).reshape(-1, len(angles)))


def _quaternions(rotations: Rotation) -> Floats:
    return np.asarray(rotations.as_quat(canonical=True)).reshape(-1, 3, 4)


def _sideways(joint: Floats) -> Floats:
    """Return where the rods of each arm stand beside its middle [m], shape (3, 2, 3)."""
    return np.asarray(joint - joint.mean(axis=1, keepdims=True))
