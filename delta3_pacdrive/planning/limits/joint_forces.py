"""Forces in rods and ball joints, and the load of tool and payload on the plate.

A forearm consists of two uniform rods of mass m_fb/2 between ball joints at elbow and plate. With c and a the
accelerations of elbow and plate plus g z, the plate pulls the two rods of an arm together with

    R_i = m_fb (c_i/6 + a/3) + f_i s_i,   sum_i f_i s_i = -(m_n + m_payload) a - m_fb sum_i (c_i/6 + a/3),

and the elbow with m_fb (c_i/3 + a/6) - f_i s_i. The plate cannot rotate: the left rod carries R_i/2 + D_i s_i, the
right one R_i/2 - D_i s_i, whose moments w D_i e_i x s_i balance those of the forces R_i, which act R_B from the centre
of the plate, and that of the payload below it (w: spacing of the rods, e_i: direction from right to left rod).

Springs between the two rods press the sockets on their balls along e_i. A socket that encloses its ball up to the angle
beta from e_i stays closed as long as the spring exceeds |Q|/tan(beta) - N, with Q the force across e_i and N the force
along e_i that presses both together.

Arguments of the kernel here:

``motion``
    Position [m], velocity [m/s] and acceleration [m/s^2] of the plate, shape (n, 3, 3).
``payload_kg``
    Payload [kg], shape (n,).
``geometry_record``, ``body_record``
    Arrays of one ``kinematics.GEOMETRY`` and of one ``BODY``, shape (1,).
``at_plate``, ``at_elbow``
    Receive the forces on the rods, shape (n, 3, 2, 3): by arm, left and right rod, x to z [N].
``direction``
    Receives the unit vectors from elbows to plate, shape (n, 3, 3).
``s``, ``right``
    Three vectors, shape (3, 3), and their sum with unknown factors, shape (3,).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.kinematics import arm_angles, forearms, geometry, inverse_columns, upper_arm
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, cross, dot, plus, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.paths.path_dynamics import arm_motion

BODY = np.dtype(
    [
        ('rods', 'f8'),  # m_fb [kg], both rods of an arm
        ('plate', 'f8'),  # m_n [kg]
        ('radius', 'f8'),  # R_B [m]
        ('spacing', 'f8'),  # w [m]
        ('lever', 'f8'),  # of the payload's centre of mass below the joints [m]
        ('gravity', 'f8'),  # g [m/s^2]
    ],
    align=True,
)


def body(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``BODY``."""
    p, record = parameters, np.zeros(1, BODY)
    record['rods'], record['plate'] = p.dynamics.forearm_mass_kg, p.dynamics.plate_mass_kg
    record['radius'], record['spacing'] = p.kinematics.plate_radius_m, p.rich.rod_spacing_m
    record['lever'], record['gravity'] = p.rich.tool_length_m, p.dynamics.gravity_m_s2
    return record


@kernel
def _solve_columns(s, right):
    """Solve sum_i x_i s_i = ``right`` for three vectors s_i."""
    n1, n2, n3, determinant = inverse_columns(s)
    return (dot(n1, right) / determinant, dot(n2, right) / determinant, dot(n3, right) / determinant)


@kernel
def _joint_forces(motion, payload_kg, at_plate, at_elbow, direction, geometry_record, body_record):
    """Fill forces and directions of the rods; nan where an arm cannot reach."""
    g, m = geometry_record[0], body_record[0]
    zero = (0.0, 0.0, 0.0)
    for n in range(motion.shape[0]):
        p, v, a = triple(motion[n, 0]), triple(motion[n, 1]), triple(motion[n, 2])
        theta = arm_angles(p, g)
        s, b = forearms(theta, p, g)
        speed, acceleration = arm_motion(theta, (p, v, a), 1.0, 0.0, g)
        plate = (a[0], a[1], a[2] + m.gravity)
        carried = m.plate + payload_kg[n]
        total = combine(carried, plate, 0.0, zero, 0.0, zero)
        for i in range(3):
            bend = combine(acceleration[i], b[i], -speed[i] * speed[i], upper_arm(i, p, s[i], g), 0.0, zero)
            for axis in range(3):
                direction[n, i, axis] = s[i][axis] / g.l_b[i]
                c = bend[axis] + (m.gravity if axis == 2 else 0.0)
                for rod in range(2):
                    at_plate[n, i, rod, axis] = m.rods * (c / 6.0 + plate[axis] / 3.0)
                    at_elbow[n, i, rod, axis] = m.rods * (c / 3.0 + plate[axis] / 6.0)
            total = plus(total, 1.0, triple(at_plate[n, i, 0]))
        along = _solve_columns(s, combine(-1.0, total, 0.0, zero, 0.0, zero))
        moment = cross((0.0, 0.0, -m.lever), combine(payload_kg[n], plate, 0.0, zero, 0.0, zero))
        left1 = (-g.sin_alpha[0], g.cos_alpha[0], 0.0)
        left2 = (-g.sin_alpha[1], g.cos_alpha[1], 0.0)
        left3 = (-g.sin_alpha[2], g.cos_alpha[2], 0.0)
        for i in range(3):
            pull = plus(triple(at_plate[n, i, 0]), along[i], s[i])
            arm = (m.radius * g.cos_alpha[i], m.radius * g.sin_alpha[i], 0.0)
            moment = plus(moment, 1.0, cross(arm, pull))
        arms = (cross(left1, s[0]), cross(left2, s[1]), cross(left3, s[2]))
        apart = _solve_columns(arms, combine(-1.0 / m.spacing, moment, 0.0, zero, 0.0, zero))
        for i in range(3):
            for axis in range(3):
                for rod in range(2):
                    axial = (0.5 * along[i] + (apart[i] if rod == 0 else -apart[i])) * s[i][axis]
                    at_plate[n, i, rod, axis] = 0.5 * at_plate[n, i, rod, axis] + axial
                    at_elbow[n, i, rod, axis] = 0.5 * at_elbow[n, i, rod, axis] - axial


@dataclass(frozen=True)
class JointForces:
    """Forces of a motion; arrays (n, ...), nan where an arm cannot reach."""

    at_plate_n: Floats  # of the plate on the rods, shape (n, 3, 2, 3): arm, left and right rod, x to z
    at_elbow_n: Floats  # of the elbows on the rods, same shape
    rod_n: Floats  # axial force of each rod where it is largest, tension positive, shape (n, 3, 2)
    spring_n: Floats  # force of the springs that keeps every joint of an arm closed, shape (n, 3)
    plate_axial_n: Floats  # force of the payload on the plate along z, downward positive, shape (n,)
    plate_moment_n_m: (
        Floats  # tilting moment of the payload about the centre of the plate's joints, shape (n,)
    )

    @property
    def larger_rods_n(self) -> Floats:
        """Axial force of that rod of each arm where it is larger, shape (n, 3)."""
        left, right = np.moveaxis(self.rod_n, 2, 0)
        return np.asarray(np.where(np.abs(left) >= np.abs(right), left, right))


@dataclass(frozen=True)
class ForceDemand:
    """A quantity of a motion with a limit: its parts at rest and due to the motion add up to at least the whole."""

    quantity: str  # 'rod', 'spring' or 'moment'
    arm: int | None  # number of the arm from 1; None: plate
    value: Floats  # shape (n,)
    standing: Floats
    moving: Floats  # due to velocity and acceleration, proportional to the square of a factor on the speed
    limit: float
    unit: str


def force_demands(motion: Floats, payload_kg: Floats | None, parameters: Parameters) -> list[ForceDemand]:
    """Compare a motion (n, 3, 3) of the TCP (``PathDynamics.tcp_motion_m``) with the limits of ``joints``."""
    still = np.zeros_like(motion)
    still[:, 0] = motion[:, 0]
    weightless = parameters.replace(dynamics__gravity_m_s2=0.0)
    every = [
        joint_forces(one[:, 0], one[:, 1], one[:, 2], robot, payload_kg)
        for one, robot in ((motion, parameters), (still, parameters), (motion, weightless))
    ]
    limits = parameters.joints

    def demand(quantity: str, arm: int | None, values: list[Floats], limit: float, unit: str) -> ForceDemand:
        whole, standing, moving = values
        return ForceDemand(quantity, arm, whole, standing, moving=moving, limit=limit, unit=unit)

    found = [
        demand('moment', None, [one.plate_moment_n_m for one in every], limits.plate_moment_max_n_m, 'N m')
    ]
    for i in range(3):
        rods = [np.abs(one.rod_n[:, i]).max(axis=1) for one in every]
        found.append(demand('rod', i + 1, rods, limits.rod_force_max_n, 'N'))
        found.append(
            demand('spring', i + 1, [one.spring_n[:, i] for one in every], limits.spring_force_n, 'N')
        )
    return found


def joint_forces(
    p: ArrayLike,
    pdot: ArrayLike,
    pddot: ArrayLike,
    parameters: Parameters,
    payload_kg: ArrayLike | None = None,
) -> JointForces:
    """Return the forces in rods and ball joints of a motion of the TCP.

    Parameters
    ----------
    p, pdot, pddot
        Position [m], velocity [m/s] and acceleration [m/s^2] of the TCP in the frame ``base``, (n, 3) or (3,) each.
    parameters
        The parameters of a robot.
    payload_kg
        Payload [kg], (n,) or a number (default: that of the parameters).

    """
    motion = np.ascontiguousarray(
        np.stack([np.atleast_2d(np.asarray(one, dtype=np.float64)) for one in (p, pdot, pddot)], axis=1)
    )
    carried = parameters.dynamics.payload_mass_kg if payload_kg is None else payload_kg
    payload = np.ascontiguousarray(np.broadcast_to(np.asarray(carried, dtype=np.float64), len(motion)))
    (at_plate, at_elbow), along = np.empty((2, len(motion), 3, 2, 3)), np.empty((len(motion), 3, 3))
    lengths = geometry(parameters.kinematics)
    _joint_forces(motion, payload, at_plate, at_elbow, along, lengths, body(parameters))
    left = np.stack([-lengths['sin_alpha'][0], lengths['cos_alpha'][0], np.zeros(3)], axis=1)
    tension = np.einsum('niax,nix->nia', at_plate, along)
    tension_at_elbow = -np.einsum('niax,nix->nia', at_elbow, along)
    return JointForces(
        at_plate,
        at_elbow,
        rod_n=np.where(np.abs(tension) >= np.abs(tension_at_elbow), tension, tension_at_elbow),
        spring_n=_springs(np.stack([at_plate, at_elbow], axis=2), left, parameters),
        plate_axial_n=payload * (motion[:, 2, 2] + parameters.dynamics.gravity_m_s2),
        plate_moment_n_m=parameters.rich.tool_length_m * payload * np.hypot(*motion[:, 2, :2].T),
    )


def _springs(forces: Floats, left: Floats, parameters: Parameters) -> Floats:
    """Return the spring force [N] that keeps all joints of an arm closed, for forces (n, 3, 2, 2, 3) on its rods."""
    along = np.einsum('niexy,iy->niex', forces, left)  # by arm, end and rod
    across = np.linalg.norm(forces - along[..., None] * left[:, None, None, :], axis=-1)
    pressed = along * np.array([1.0, -1.0])  # the balls are on the inner side of the rods
    needed = across / math.tan(math.radians(parameters.joints.socket_angle_deg)) - pressed
    return np.asarray(needed.max(axis=(2, 3)))
