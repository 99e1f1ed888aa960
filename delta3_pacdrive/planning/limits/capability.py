"""Capability of the robot at a pose in every direction: singularity, speed, acceleration, payload, resolution.

The rows r_i = s_i/(s_i.b_i) of J^-1 map a TCP velocity to arm speeds (4.12). The speed available in every direction is
the motor speed limit over the longest row. At rest the torques for an acceleration X'' are

    tau = A J^-1 X'' + G,   A J^-1 = I_b J^-1 + m_nt J^T,   G_i = m_nt g J_zi - m_br g r_Gb cos theta_i    (4.26)

with terms linear in the payload. Static friction reduces the acceleration, but not the payload held at rest. The output
of a gear carries these torques without those of the rotor, up to its acceleration torque.

Arguments of the kernels here:

``points``
    Positions of the TCP [m], shape (n, 3).
``out``
    Receives a row of ``COLUMNS`` for each position; nan where an arm cannot reach it.
``geometry_record``, ``inertia_record``
    Arrays of one ``kinematics.GEOMETRY`` and of one ``dynamics.INERTIA``, that of the empty plate, shape (1,).
``demand_record``, ``d``
    Array of one ``DEMAND``, and the record.
``row``, ``column``
    Row i of A J^-1 of the empty plate [kg m], and column i of J [m/rad], shape (3,).
``weight``, ``lift``
    Holding torque of an arm with the empty plate [N m], and its increase per payload [N m/kg].
``payload``
    Payload [kg].
``torque``, ``limit``
    Available torque [N m].
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.dynamics import inertia, motion_terms, rotor_inertia
from delta3_pacdrive.kinematics import (
    arm_angles,
    forearm_swing,
    forearms,
    geometry,
    jacobian_columns,
    parallel_distance,
    rows,
    serial_distance,
)
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.singular_values import singular_values
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, dot, length, plus, triple
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG, Parameters
from delta3_pacdrive.planning.limits.limits import Limit, arm_bounds, highest_motor_speed, workspace_bounds

COLUMNS = (
    'theta_1',
    'theta_2',
    'theta_3',
    'serial_1',
    'serial_2',
    'serial_3',
    'parallel',
    'singular_min',
    'singular_max',
    'speed',
    'acceleration',
    'acceleration_nominal',
    'payload_held',
    'payload_peak',
    'increment',
)
DEMAND = np.dtype(
    [
        ('arm_speed', 'f8'),  # largest arm speed [rad/s]
        ('peak', 'f8'),  # arm torque available for acceleration at peak current [N m]
        ('nominal', 'f8'),  # and at nominal current
        ('gear', 'f8'),  # largest torque at the output of a gear [N m]; inf: no limit
        ('rotor', 'f8'),  # inertia of a rotor, arm side [kg m^2]
        ('held', 'f8'),  # arm torque that nominal current and brake can hold permanently [N m]
        ('payload', 'f8'),  # carried payload [kg]
        ('acceleration', 'f8'),  # required of the largest payload [m/s^2]
        ('increment', 'f8'),  # of an arm [rad]
        ('gravity', 'f8'),  # [m/s^2]
    ]
)
LOAD_MAX_KG = 1e4  # result where neither gravity nor acceleration loads an arm
REACHED, OUT_OF_REACH = 0, 1
CODES: dict[str, int] = {key: code for code, key in enumerate(Limit, start=2)}  # of the first violated bound


def demand(parameters: Parameters, payload_kg: float, acceleration_m_s2: float) -> NDArray[Any]:
    """Return one record of ``DEMAND`` with the torques and speeds of the motors and the required acceleration."""
    motor, gear = parameters.motor, parameters.dynamics.gear_ratio
    record = np.zeros(1, DEMAND)
    peak, nominal = (
        motor.torque_constant_n_m_a * current for current in (motor.peak_current_a, motor.nominal_current_a)
    )
    record['arm_speed'] = highest_motor_speed(parameters) / gear
    record['peak'] = gear * max(peak - motor.static_friction_n_m, 0.0)
    record['nominal'] = gear * max(nominal - motor.static_friction_n_m, 0.0)
    record['gear'], record['rotor'] = parameters.gear_torque_max_n_m, rotor_inertia(parameters)
    record['held'] = gear * min(nominal, motor.brake_torque_n_m)
    record['payload'], record['acceleration'] = payload_kg, acceleration_m_s2
    record['increment'] = math.tau / (parameters.bus.increments_per_rev * gear)
    record['gravity'] = parameters.dynamics.gravity_m_s2
    return record


@kernel
def _acceleration(row, column, weight, lift, payload, torque):
    """Acceleration [m/s^2] in every direction that an arm's torque allows; 0 if it cannot hold the arm."""
    room = torque - abs(weight + payload * lift)
    return max(room, 0.0) / length(plus(row, payload, column))


@kernel
def _held(weight, lift, d):
    """Largest payload [kg] that an arm holds at rest permanently; 0 if it cannot hold the empty plate."""
    if abs(weight) > d.held:
        return 0.0
    room = d.held - weight if lift > 0.0 else d.held + weight
    return room / abs(lift) if room < LOAD_MAX_KG * abs(lift) else LOAD_MAX_KG


@kernel
def _accelerated(row, column, weight, lift, limit, d):
    """Largest payload [kg] that an arm accelerates with a torque; 0 if it cannot accelerate the empty plate."""
    if _acceleration(row, column, weight, lift, 0.0, limit) < d.acceleration:
        return 0.0
    most, square = LOAD_MAX_KG, d.acceleration * d.acceleration
    for sign in (-1.0, 1.0):
        # acceleration |row + m column| = torque - sign (weight + m lift), squared: its smallest positive root m
        torque, slope = limit - sign * weight, sign * lift
        half = square * dot(row, column) + torque * slope
        rest = torque * torque - square * dot(row, row)
        radicand = half * half + (square * dot(column, column) - slope * slope) * rest
        if radicand >= 0.0:
            divisor = half + math.sqrt(radicand)
            if divisor * most > rest:
                most = rest / divisor
    return most


@kernel
def _capability(points, out, geometry_record, inertia_record, demand_record):
    """Fill a row of ``out`` for each position."""
    g, m, d = geometry_record[0], inertia_record[0], demand_record[0]
    for n in range(points.shape[0]):
        p = triple(points[n])
        theta = arm_angles(p, g)
        if math.isnan(theta[0] + theta[1] + theta[2]):
            for column in range(out.shape[1]):
                out[n, column] = math.nan
            continue
        s, b = forearms(theta, p, g)
        sb = (dot(s[0], b[0]), dot(s[1], b[1]), dot(s[2], b[2]))
        j = jacobian_columns(s, b)
        (a11, a22, a33, a12, a13, a23), weight = motion_terms(theta, (0.0, 0.0, 0.0), g, m)
        one, two, three = 1.0 / sb[0], 1.0 / sb[1], 1.0 / sb[2]
        table = (
            combine(a11 * one, s[0], a12 * two, s[1], a13 * three, s[2]),
            combine(a12 * one, s[0], a22 * two, s[1], a23 * three, s[2]),
            combine(a13 * one, s[0], a23 * two, s[1], a33 * three, s[2]),
        )
        speed = acceleration = nominal = held = peak = math.inf
        for i in range(3):
            lift = d.gravity * j[i][2]
            speed = min(speed, d.arm_speed * abs(sb[i]) / g.l_b[i])
            arm = (table[i], j[i], weight[i], lift, d.payload)
            acceleration = min(acceleration, _acceleration(*arm, d.peak))
            nominal = min(nominal, _acceleration(*arm, d.nominal))
            held = min(held, _held(weight[i], lift, d))
            peak = min(peak, _accelerated(table[i], j[i], weight[i], lift, d.peak, d))
            if d.gear < math.inf:
                # the gear carries the torque of the arms, without the rotor
                row = plus(table[i], -d.rotor / sb[i], s[i])
                at_gear = _acceleration(row, j[i], weight[i], lift, d.payload, d.gear)
                acceleration, nominal = min(acceleration, at_gear), min(nominal, at_gear)
                peak = min(peak, _accelerated(row, j[i], weight[i], lift, d.gear, d))
            out[n, i] = theta[i]
            out[n, 3 + i] = serial_distance(i, sb[i], g)
        out[n, 6] = parallel_distance(s, g)
        out[n, 8], _, out[n, 7] = singular_values(j[0], j[1], j[2])
        out[n, 9], out[n, 10], out[n, 11], out[n, 12], out[n, 13] = speed, acceleration, nominal, held, peak
        apart = 0.0
        for second in (-1.0, 1.0):
            for third in (-1.0, 1.0):
                apart = max(apart, length(combine(1.0, j[0], second, j[1], third, j[2])))
        out[n, 14] = d.increment * apart


@dataclass(frozen=True)
class Capability:
    """Capability of the robot at positions; arrays (...) or (..., 3), nan where an arm cannot reach."""

    arm_angle_rad: Floats  # elbow-out branch
    serial: Floats  # distance from the serial singularity of each arm, s_i.b_i/(l_A l_B)
    parallel: Floats  # distance from the parallel singularity, |det S|/l_B^3
    singular_min_m_rad: Floats  # singular values of J
    singular_max_m_rad: Floats
    speed_m_s: Floats  # available in every direction at maximum motor speed
    acceleration_m_s2: (
        Floats  # from rest in every direction with the payload, at peak current and within the gears
    )
    acceleration_nominal_m_s2: Floats  # the same at nominal current
    payload_held_kg: Floats  # largest payload that nominal currents and brakes hold at rest, permitted or not
    payload_peak_kg: Floats  # largest payload that peak currents accelerate as required, within the gears
    increment_m: Floats  # largest TCP error if every motor is off by one increment
    limit: NDArray[np.uint8]  # 0: permitted, 1: out of reach, else the first violated bound, by ``CODES``

    @property
    def payload_kg(self) -> Floats:
        """Largest payload that the robot may carry, can hold permanently and can accelerate as required."""
        return np.minimum(np.minimum(self.payload_held_kg, self.payload_peak_kg), PAYLOAD_MAX_KG)

    @property
    def condition(self) -> Floats:
        """Condition number of J."""
        with np.errstate(divide='ignore', invalid='ignore'):
            return np.asarray(self.singular_max_m_rad / self.singular_min_m_rad)


def capability(
    p: ArrayLike,
    parameters: Parameters,
    *,
    payload_kg: float | None = None,
    acceleration_m_s2: float | None = None,
) -> Capability:
    """Evaluate the capability at positions.

    Parameters
    ----------
    p
        TCP positions [m] in the frame ``base``, shape (..., 3).
    parameters
        The parameters of a robot.
    payload_kg
        Carried payload (default: that of the parameters) [kg].
    acceleration_m_s2
        Acceleration required of the largest payload in every direction (default: that of moves) [m/s^2].

    Returns
    -------
    Capability
        Arrays of shapes (...) and (..., 3).

    """
    points, shape = rows(p, 'p')
    payload = parameters.dynamics.payload_mass_kg if payload_kg is None else payload_kg
    wanted = parameters.motion.acceleration_max_m_s2 if acceleration_m_s2 is None else acceleration_m_s2
    empty = inertia(parameters.replace(dynamics__payload_mass_kg=0.0))
    out = np.empty((len(points), len(COLUMNS)))
    _capability(points, out, geometry(parameters.kinematics), empty, demand(parameters, payload, wanted))

    def column(name: str) -> Floats:
        return out[:, COLUMNS.index(name)].reshape(shape)

    return Capability(
        arm_angle_rad=out[:, :3].reshape(*shape, 3),
        serial=out[:, 3:6].reshape(*shape, 3),
        parallel=column('parallel'),
        singular_min_m_rad=column('singular_min'),
        singular_max_m_rad=column('singular_max'),
        speed_m_s=column('speed'),
        acceleration_m_s2=column('acceleration'),
        acceleration_nominal_m_s2=column('acceleration_nominal'),
        payload_held_kg=column('payload_held'),
        payload_peak_kg=column('payload_peak'),
        increment_m=column('increment'),
        limit=_first_broken(points, out, parameters).reshape(shape),
    )


def _first_broken(points: Floats, out: Floats, parameters: Parameters) -> NDArray[np.uint8]:
    """Return the code of the first violated bound at each position."""
    code = np.where(np.isnan(out[:, 0]), OUT_OF_REACH, REACHED).astype(np.uint8)
    swing = forearm_swing(points, parameters.kinematics)
    arms = arm_bounds(out[:, :3], swing, out[:, 3:6], out[:, 6], parameters)
    for bound in (*arms, *workspace_bounds(points, parameters)):
        broken = ~bound.kept if bound.values.ndim == 1 else ~bound.kept.all(axis=1)
        code[(code == REACHED) & broken] = CODES[bound.key]
    return code
