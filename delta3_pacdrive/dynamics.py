"""Dynamics of the Delta-3 robot by virtual work (thesis 4.8, 4.9), arm side.

    tau = A(theta) thetaddot + C(theta, thetadot) thetadot + G(theta)                       (4.26)
    A = I_b 1 + m_nt J^T J,   C = m_nt J^T Jdot,   G_i = m_nt g J_3i - m_br g r_Gb cos theta_i

with the rotor and brake inertia in I_b = k_r^2 (I_m + I_brake) + l_A^2 (m_b/3 + m_c + r m_fb), without friction. The
coupling torque d (4.31) is the motor load in addition to A_bar thetaddot and friction.

The thesis assigns the share r of a forearm's mass to the elbow and the remainder to the plate (4.8.1). A forearm of
uniform rods, whose points move with (1 - x) Cdot_i + x Xdot, 0 <= x <= 1, has exactly the kinetic energy

    m_fb/6 (|Cdot_i|^2 + Cdot_i.Xdot + |Xdot|^2)

of a third of the mass in the elbow, a third in the plate, and a coupling mass mu = m_fb/6:

    A = I_b 1 + m_nt J^T J + mu (B^T J + J^T B),   B = [b_1 b_2 b_3] (4.9),

which adds mu sum (Cddot_k + g z) to the force on the plate and mu b_i.(Xddot + g z) to the torque of arm i.

Arguments of the functions and kernels here:

``theta``, ``thetadot``, ``thetaddot``
    Arm angles [rad], speeds [rad/s] and accelerations [rad/s^2], shape (3,); of functions (..., 3).
``tau``
    Arm torques [N m], shape (..., 3).
``parameters``
    The parameters of a robot: a ``Parameters``.
``rods``
    Whether forearms are uniform rods instead of split masses.
``g``, ``n``, ``geometry_record``, ``inertia_record``
    Records ``kinematics.GEOMETRY`` and ``INERTIA``, and arrays with one of them, shape (1,).
``mass``
    Mass matrix (A11, A22, A33, A12, A13, A23) [kg m^2], shape (6,).
``p``, ``xdot``
    Position [m] and velocity [m/s] of the plate, shape (3,).
``s``, ``b``, ``j``
    Forearm vectors [m], arm tangents [m/rad] and columns of J [m/rad], shape (3, 3), or those of one arm, shape (3,).
``a``
    Jdot thetadot [m/s^2], shape (3,).
``f``, ``v``
    Torques [N m] and any vector, shape (3,).
``i``
    Number of an arm, 0 to 2.
``angles``, ``rates``, ``accelerations``, ``torques``
    Rows of [rad], [rad/s], [rad/s^2] and [N m], shape (n, 3).
``out``
    Receives the results, one for each row, shape (n, ...).
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.kinematics import geometry, inverse_columns, pose, rows, upper_arm
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, dot
from delta3_pacdrive.parameters import Parameters

INERTIA = np.dtype(
    [
        ('arm', 'f8', (3,)),  # I_b [kg m^2]
        ('plate', 'f8'),  # m_nt [kg]
        ('rod', 'f8'),  # mu [kg], 0 for split masses
        ('weight', 'f8', (3,)),  # m_br r_Gb g / l_A [N]
        ('elbow', 'f8', (3,)),  # m_br r_Gb / l_A [kg], moves with the elbow in the momentum
        ('gravity', 'f8'),  # g [m/s^2]
    ],
    align=True,
)


def rotor_inertia(parameters: Parameters) -> float:
    """Return the inertia [kg m^2] of a rotor with its brake, on the arm side of the gear."""
    motor = parameters.motor
    return parameters.dynamics.gear_ratio**2 * (motor.rotor_inertia_kg_m2 + motor.brake_inertia_kg_m2)


def inertia(
    parameters: Parameters,
    geometry_record: NDArray[Any] | None = None,
    *,
    rods: bool = False,
    rotors: bool = True,
) -> NDArray[Any]:
    """Return one record of ``INERTIA`` (4.8.1).

    Parameters
    ----------
    parameters
        The parameters of a robot.
    geometry_record
        Lengths of the built arms (default: nominal).
    rods
        Whether forearms are uniform rods instead of split masses.
    rotors
        Whether to include the rotors.

    """
    p = parameters.dynamics
    l_a = (geometry(parameters.kinematics) if geometry_record is None else geometry_record)['l_a']
    elbow_share = 1.0 / 3.0 if rods else p.forearm_share_at_elbow
    at_elbow = p.elbow_mass_kg + elbow_share * p.forearm_mass_kg
    record = np.zeros(1, INERTIA)
    record['arm'] = l_a**2 * (p.upper_arm_mass_kg / 3.0 + at_elbow)
    if rotors:
        record['arm'] += rotor_inertia(parameters)
    record['plate'] = p.plate_total_mass_kg
    if rods:
        record['plate'] = p.plate_mass_kg + p.payload_mass_kg + p.forearm_mass_kg
        record['rod'] = p.forearm_mass_kg / 6.0
        # a third and a sixth: the elbow carries half of the forearm's weight
        at_elbow += record['rod'][0]
    moment = l_a * (p.upper_arm_mass_kg / 2.0 + at_elbow)
    record['weight'] = p.gravity_m_s2 * moment / l_a
    record['elbow'] = moment / l_a
    record['gravity'] = p.gravity_m_s2
    return record


@kernel
def motion_terms(theta, thetadot, g, n):
    """Mass matrix A as (A11, A22, A33, A12, A13, A23) and bias C thetadot + G at one pose; nan where FK fails.

    Jdot thetadot = S^-1 (Ddot thetadot - Sdot Xdot) (4.15 times thetadot) avoids the matrix Jdot.
    """
    p, s, b = pose(theta, g)
    n1, n2, n3, determinant = inverse_columns(s)
    sb = (dot(s[0], b[0]), dot(s[1], b[1]), dot(s[2], b[2]))
    per_volume = 1.0 / determinant
    q = (sb[0] * per_volume, sb[1] * per_volume, sb[2] * per_volume)
    xdot = combine(q[0] * thetadot[0], n1, q[1] * thetadot[1], n2, q[2] * thetadot[2], n3)
    e1 = _acceleration_right_side(0, s[0], b[0], p, xdot, thetadot[0], g)
    e2 = _acceleration_right_side(1, s[1], b[1], p, xdot, thetadot[1], g)
    e3 = _acceleration_right_side(2, s[2], b[2], p, xdot, thetadot[2], g)
    a = combine(e1 * per_volume, n1, e2 * per_volume, n2, e3 * per_volume, n3)
    force = (n.plate * a[0], n.plate * a[1], n.plate * (a[2] + n.gravity))
    mass = (
        n.arm[0] + n.plate * q[0] * q[0] * dot(n1, n1),
        n.arm[1] + n.plate * q[1] * q[1] * dot(n2, n2),
        n.arm[2] + n.plate * q[2] * q[2] * dot(n3, n3),
        n.plate * q[0] * q[1] * dot(n1, n2),
        n.plate * q[0] * q[2] * dot(n1, n3),
        n.plate * q[1] * q[2] * dot(n2, n3),
    )
    # the cosine of an arm angle is -b_z / l_A
    bias = (
        q[0] * dot(n1, force) + n.weight[0] * b[0][2],
        q[1] * dot(n2, force) + n.weight[1] * b[1][2],
        q[2] * dot(n3, force) + n.weight[2] * b[2][2],
    )
    if n.rod != 0.0:
        j = (
            combine(q[0], n1, 0.0, n1, 0.0, n1),
            combine(q[1], n2, 0.0, n2, 0.0, n2),
            combine(q[2], n3, 0.0, n3, 0.0, n3),
        )
        return _with_rods((mass, bias), thetadot, (p, s, b), j, a, g, n)
    return mass, bias


@kernel
def _with_rods(terms, thetadot, pose, j, a, g, n):
    """Add the coupling of elbows and plate by uniform rods.

    ``terms`` are mass matrix and bias of split masses, ``pose`` is (p, s, b).
    """
    mass, bias = terms
    p, s, b = pose
    arms = (upper_arm(0, p, s[0], g), upper_arm(1, p, s[1], g), upper_arm(2, p, s[2], g))
    squares = (thetadot[0] * thetadot[0], thetadot[1] * thetadot[1], thetadot[2] * thetadot[2])
    # bdot_i thetadot_i; the weight of the elbows is included in that of the arms
    elbows = combine(-squares[0], arms[0], -squares[1], arms[1], -squares[2], arms[2])
    force = (elbows[0], elbows[1], elbows[2] + 3.0 * n.gravity)
    coupled_mass = (
        mass[0] + 2.0 * n.rod * dot(b[0], j[0]),
        mass[1] + 2.0 * n.rod * dot(b[1], j[1]),
        mass[2] + 2.0 * n.rod * dot(b[2], j[2]),
        mass[3] + n.rod * (dot(b[0], j[1]) + dot(b[1], j[0])),
        mass[4] + n.rod * (dot(b[0], j[2]) + dot(b[2], j[0])),
        mass[5] + n.rod * (dot(b[1], j[2]) + dot(b[2], j[1])),
    )
    coupled_bias = (
        bias[0] + n.rod * (dot(j[0], force) + dot(b[0], a)),
        bias[1] + n.rod * (dot(j[1], force) + dot(b[1], a)),
        bias[2] + n.rod * (dot(j[2], force) + dot(b[2], a)),
    )
    return coupled_mass, coupled_bias


@kernel
def momentum_terms(theta, thetadot, masses, g):
    """Rate of the momentum of masses at plate and elbows, sum_i h_i thetaddot_i + f; returns (h, f).

    ``masses`` are that of the plate and those of the elbows [kg], shape (4,).
    """
    p, s, b = pose(theta, g)
    n1, n2, n3, determinant = inverse_columns(s)
    per_volume = 1.0 / determinant
    j = (
        combine(dot(s[0], b[0]) * per_volume, n1, 0.0, n1, 0.0, n1),
        combine(dot(s[1], b[1]) * per_volume, n2, 0.0, n2, 0.0, n2),
        combine(dot(s[2], b[2]) * per_volume, n3, 0.0, n3, 0.0, n3),
    )
    xdot = combine(thetadot[0], j[0], thetadot[1], j[1], thetadot[2], j[2])
    e1 = _acceleration_right_side(0, s[0], b[0], p, xdot, thetadot[0], g)
    e2 = _acceleration_right_side(1, s[1], b[1], p, xdot, thetadot[1], g)
    e3 = _acceleration_right_side(2, s[2], b[2], p, xdot, thetadot[2], g)
    a = combine(e1 * per_volume, n1, e2 * per_volume, n2, e3 * per_volume, n3)
    plate, elbow = masses[0], (masses[1], masses[2], masses[3])
    h = (
        combine(plate, j[0], elbow[0], b[0], 0.0, a),
        combine(plate, j[1], elbow[1], b[1], 0.0, a),
        combine(plate, j[2], elbow[2], b[2], 0.0, a),
    )
    bends = combine(
        -elbow[0] * thetadot[0] * thetadot[0],
        upper_arm(0, p, s[0], g),
        -elbow[1] * thetadot[1] * thetadot[1],
        upper_arm(1, p, s[1], g),
        -elbow[2] * thetadot[2] * thetadot[2],
        upper_arm(2, p, s[2], g),
    )
    return h, combine(plate, a, 1.0, bends, 0.0, a)


@kernel
def _acceleration_right_side(i, s, b, p, xdot, thetadot, g):
    """Ddot_ii thetadot_i - sdot_i.Xdot of one arm (4.14)."""
    sdot = combine(1.0, xdot, -thetadot, b, 0.0, xdot)
    ddot = dot(sdot, b) - dot(s, upper_arm(i, p, s, g)) * thetadot
    return ddot * thetadot - dot(sdot, xdot)


@kernel
def multiply(mass, v):
    """Product of the symmetric mass matrix and a 3-tuple."""
    return (
        mass[0] * v[0] + mass[3] * v[1] + mass[4] * v[2],
        mass[3] * v[0] + mass[1] * v[1] + mass[5] * v[2],
        mass[4] * v[0] + mass[5] * v[1] + mass[2] * v[2],
    )


@kernel
def solve(mass, f):
    """Solve mass x = f for a symmetric 3x3 matrix by its adjugate."""
    a, b, c, d, e, h = mass
    k11, k12, k13 = b * c - h * h, e * h - d * c, d * h - e * b
    k22, k23, k33 = a * c - e * e, d * e - a * h, a * b - d * d
    scale = 1.0 / (a * k11 + d * k12 + e * k13)
    return (
        (k11 * f[0] + k12 * f[1] + k13 * f[2]) * scale,
        (k12 * f[0] + k22 * f[1] + k23 * f[2]) * scale,
        (k13 * f[0] + k23 * f[1] + k33 * f[2]) * scale,
    )


@kernel
def _inverse(angles, rates, accelerations, out, geometry_record, inertia_record):
    """Fill ``out`` with arm torques [N m]."""
    for row in range(angles.shape[0]):
        theta = (angles[row, 0], angles[row, 1], angles[row, 2])
        thetadot = (rates[row, 0], rates[row, 1], rates[row, 2])
        mass, bias = motion_terms(theta, thetadot, geometry_record[0], inertia_record[0])
        torque = multiply(mass, (accelerations[row, 0], accelerations[row, 1], accelerations[row, 2]))
        for i in range(3):
            out[row, i] = torque[i] + bias[i]


@kernel
def _forward(angles, rates, torques, out, geometry_record, inertia_record):
    """Fill ``out`` with arm accelerations [rad/s^2]."""
    for row in range(angles.shape[0]):
        theta = (angles[row, 0], angles[row, 1], angles[row, 2])
        thetadot = (rates[row, 0], rates[row, 1], rates[row, 2])
        mass, bias = motion_terms(theta, thetadot, geometry_record[0], inertia_record[0])
        f = (torques[row, 0] - bias[0], torques[row, 1] - bias[1], torques[row, 2] - bias[2])
        acceleration = solve(mass, f)
        for i in range(3):
            out[row, i] = acceleration[i]


@kernel
def _mass_matrix(angles, out, geometry_record, inertia_record):
    """Fill ``out`` with mass matrices [kg m^2]."""
    for row in range(angles.shape[0]):
        theta = (angles[row, 0], angles[row, 1], angles[row, 2])
        mass, _ = motion_terms(theta, (0.0, 0.0, 0.0), geometry_record[0], inertia_record[0])
        out[row, 0, 0], out[row, 1, 1], out[row, 2, 2] = mass[0], mass[1], mass[2]
        out[row, 0, 1] = out[row, 1, 0] = mass[3]
        out[row, 0, 2] = out[row, 2, 0] = mass[4]
        out[row, 1, 2] = out[row, 2, 1] = mass[5]


def _three_rows(first: ArrayLike, second: ArrayLike, third: ArrayLike, names: tuple[str, str, str]) -> Any:
    arrays = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (first, second, third)))
    shaped = [rows(array, name) for array, name in zip(arrays, names, strict=True)]
    return [array for array, _ in shaped], shaped[0][1]


def inverse(
    theta: ArrayLike,
    thetadot: ArrayLike,
    thetaddot: ArrayLike,
    parameters: Parameters,
    *,
    rods: bool = False,
) -> Floats:
    """Return the arm torques [N m] of a motion (4.26), with motor inertia, without friction; shapes (..., 3).

    They are nan where FK fails.

    With ``rods`` the forearms are uniform rods instead of the thesis' split masses.
    """
    (angles, rates, accelerations), shape = _three_rows(
        theta, thetadot, thetaddot, ('theta', 'thetadot', 'thetaddot')
    )
    out: Floats = np.empty_like(angles)
    _inverse(
        angles,
        rates,
        accelerations,
        out,
        geometry(parameters.kinematics),
        inertia(parameters, rods=rods),
    )
    return out.reshape(*shape, 3)


def regressor(theta: ArrayLike, thetadot: ArrayLike, thetaddot: ArrayLike, parameters: Parameters) -> Floats:
    """Return Y of (4.26), which is linear in the inertial constants: tau = Y [I_b, m_nt, m_br r_Gb].

    Shapes (..., 3) -> (..., 3, 3): arm by constant, in [rad/s^2], [m^2/s^2], [m/s^2]; nan where FK fails.
    """
    (angles, rates, accelerations), shape = _three_rows(
        theta, thetadot, thetaddot, ('theta', 'thetadot', 'thetaddot')
    )
    gravity, lengths = parameters.dynamics.gravity_m_s2, geometry(parameters.kinematics)
    units = {'arm': 1.0, 'plate': 1.0, 'weight': gravity / lengths['l_a']}
    out = np.empty((3, *angles.shape))
    for column, (name, value) in zip(out, units.items(), strict=True):
        unit = np.zeros(1, INERTIA)
        unit[name], unit['gravity'] = value, gravity
        _inverse(angles, rates, accelerations, column, lengths, unit)
    return np.moveaxis(out, 0, -1).reshape(*shape, 3, 3)


def forward(
    theta: ArrayLike, thetadot: ArrayLike, tau: ArrayLike, parameters: Parameters, *, rods: bool = False
) -> Floats:
    """Return arm accelerations [rad/s^2] for arm torques: thetaddot = A^-1 (tau - C thetadot - G); shapes (..., 3).

    With ``rods`` the forearms are uniform rods instead of the thesis' split masses.
    """
    (angles, rates, torques), shape = _three_rows(theta, thetadot, tau, ('theta', 'thetadot', 'tau'))
    out: Floats = np.empty_like(angles)
    _forward(angles, rates, torques, out, geometry(parameters.kinematics), inertia(parameters, rods=rods))
    return out.reshape(*shape, 3)


def mass_matrix(
    theta: ArrayLike, parameters: Parameters, *, rods: bool = False, rotors: bool = True
) -> Floats:
    """Return the mass matrix A(theta) [kg m^2], arm side; shape (..., 3) -> (..., 3, 3).

    With ``rods`` the forearms are uniform rods instead of the thesis' split masses; ``rotors`` includes the rotors.
    """
    angles, shape = rows(theta, 'theta')
    out = np.empty((len(angles), 3, 3))
    lengths = geometry(parameters.kinematics)
    _mass_matrix(angles, out, lengths, inertia(parameters, rods=rods, rotors=rotors))
    return out.reshape(*shape, 3, 3)


def gravity(theta: ArrayLike, parameters: Parameters) -> Floats:
    """Return the arm torques G(theta) [N m] that hold the robot at rest; shapes (..., 3)."""
    return inverse(theta, np.zeros(3), np.zeros(3), parameters)


def coupling(theta: ArrayLike, thetadot: ArrayLike, thetaddot: ArrayLike, parameters: Parameters) -> Floats:
    """Return the coupling torque d = [(A - A_bar) thetaddot + C thetadot + G]/k_r [N m, motor side] (4.31)."""
    linear = parameters.drive.observer_arm_inertia_kg_m2 * np.asarray(thetaddot, dtype=np.float64)
    torque = inverse(theta, thetadot, thetaddot, parameters) - linear
    return np.asarray(torque / parameters.dynamics.gear_ratio)
