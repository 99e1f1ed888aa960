"""Effects of a built robot: elastic gears with backlash, stick-slip friction, torque ripple, frame and elastic rods.

A motor drives its rotor and one side of its gear, at ``shaft`` = theta_m / k_r; the arm is the other side, at theta:

    J_m thetaddot_m = K_m I (1 + a_6 cos 6 z_p theta_m) + T_c sin n theta_m - friction - tau_gear / k_r
    tau_gear = c e + d edot   where the flanks touch, e = twist less half the backlash
    A thetaddot + C thetadot + G = tau_gear - end stop          (4.26, A without rotors)

The friction is that of LuGre (Canudas de Wit et al. 1995) on the motor side: bristles of stiffness s0 and deflection z,

    zdot = w - s0 |w| / g z,   g = F_s + (F_b - F_s) exp(-(w/w_st)^2),   F = s0 z + s1 exp(-(w/w_st)^2) zdot + F_v w

A shaft at rest is held as by a spring up to the break-away torque F_b; with speed, friction falls to F_s and
rises again with F_v (Stribeck). zdot is integrated exactly for the speed of a step.

The base stands on a frame of mass M with robot, which oscillates horizontally (q: x and y). The base exerts the force
F = sum_i h_i thetaddot_i + f on the moving parts (``momentum_terms``), whose inertia loads the arms in turn:

    M qddot + D qdot + K q = -F,   K = M (2 pi f)^2,  D = 2 zeta sqrt(K M),   A thetaddot + ... = tau - h_i . qddot

The arms see the frame's acceleration of the previous step: the moving masses are a hundredth of M, and the step a
hundredth of its period. Rods stretch by their force over the stiffness of both; their natural frequencies of several
hundred Hz are far above the motion, so that masses do not oscillate on them. Both displace the true TCP.

The step is that of ``rigid``, but predicts the midpoint from position and speed alone (position Verlet), so that
springs conserve energy; it is divided for springs that are too stiff.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.dynamics import momentum_terms, motion_terms, multiply, rotor_inertia, solve
from delta3_pacdrive.kinematics import inverse_columns, pose
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import combine, difference, dot, middle, plus, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.motor import warm_friction_torque
from delta3_pacdrive.robot.plant.brake import acceleration_under_brakes, caught_speeds
from delta3_pacdrive.robot.plant.contact import contact_torque, end_stop_torque

STEP_ANGLE = 0.1  # [rad], phase of the stiffest spring per step: its period is accurate to 1e-3
STEP_DECAY = 0.2  # fraction of the speed removed by its damping per step
SETTLING = 30  # iterations; each reduces the error about a thousandfold

BUILT_STATE = np.dtype(
    [
        ('shaft', 'f8', (3,)),  # [rad], motor shaft over k_r
        ('rate', 'f8', (3,)),  # [rad/s]
        ('acceleration', 'f8', (3,)),  # [rad/s^2], of the last step
        ('bristle', 'f8', (3,)),  # z [rad], motor
        ('frame', 'f8', (2,)),  # q [m], x and y
        ('frame_speed', 'f8', (2,)),  # [m/s]
        ('frame_acceleration', 'f8', (2,)),  # [m/s^2], of the last step
    ],
    align=True,
)

BUILT_CONSTANTS = np.dtype(
    [
        ('substeps', 'i8'),
        ('elastic', 'i8'),
        ('rotor', 'f8'),  # J_m [kg m^2], arm side
        ('stiffness', 'f8'),  # [N m/rad], arm side
        ('damping', 'f8'),  # [N m s/rad]
        ('backlash', 'f8'),  # [rad]
        ('bristle_stiffness', 'f8'),  # s0 [N m/rad], motor side; 0: friction of the thesis
        ('bristle_damping', 'f8'),  # s1 [N m s/rad]
        ('stiction', 'f8'),  # F_b - F_s [N m]
        ('stribeck_speed', 'f8'),  # w_st [rad/s]
        ('cogging', 'f8'),  # T_c [N m]
        ('cogging_periods', 'f8'),
        ('ripple', 'f8'),  # a_6
        ('frame_mass', 'f8'),  # M [kg]; 0: the base is fixed
        ('frame_stiffness', 'f8'),  # K [N/m]
        ('frame_damping', 'f8'),  # D [N s/m]
        ('rod_stiffness', 'f8'),  # of one rod [N/m]; 0: rigid
    ],
    align=True,
)

BUILT = np.dtype([('state', BUILT_STATE), ('constants', BUILT_CONSTANTS)], align=True)


def built_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``BUILT_CONSTANTS``; neutral values for effects that are off."""
    effects, motor, gear_ratio = parameters.rich.effects, parameters.motor, parameters.dynamics.gear_ratio
    record = np.zeros(1, BUILT_CONSTANTS)
    rotor = rotor_inertia(parameters)
    step = parameters.drive.current_period_s
    stiffness = decay = 0.0
    record['rotor'] = rotor
    if effects.gear:
        record['elastic'] = 1
        record['stiffness'] = stiffness = effects.gear_stiffness_n_m_rad
        record['damping'] = effects.gear_damping_n_m_s_rad
        record['backlash'] = effects.gear_backlash_rad
        decay = effects.gear_damping_n_m_s_rad / rotor
    if effects.friction:
        bristles = effects.break_away_torque_n_m / effects.presliding_rad
        record['bristle_stiffness'] = bristles
        record['bristle_damping'] = math.sqrt(bristles * rotor) / gear_ratio
        record['stiction'] = effects.break_away_torque_n_m - motor.static_friction_n_m
        record['stribeck_speed'] = effects.stribeck_speed_rad_s
        stiffness += bristles * gear_ratio**2
    if effects.ripple:
        record['cogging'] = effects.cogging_torque_n_m
        record['cogging_periods'] = effects.cogging_periods
        record['ripple'] = effects.torque_ripple
    if effects.frame:
        pulsation = math.tau * effects.frame_frequency_hz
        record['frame_mass'] = effects.frame_mass_kg
        record['frame_stiffness'] = effects.frame_mass_kg * pulsation**2
        record['frame_damping'] = 2.0 * effects.frame_damping * effects.frame_mass_kg * pulsation
    if effects.elastic_rods:
        record['rod_stiffness'] = effects.rod_stiffness_n_m
    swing = math.sqrt(stiffness / rotor)
    record['substeps'] = max(1, math.ceil(step * swing / STEP_ANGLE), math.ceil(step * decay / STEP_DECAY))
    return record


@kernel
def motor_torque(current, angle, m, r):
    """Torque of a motor at a shaft angle, with ripple and cogging."""
    ripple = 1.0 + r.ripple * math.cos(6.0 * m.pole_pairs * angle)
    return m.torque_constant * current * ripple + r.cogging * math.sin(r.cogging_periods * angle)


@kernel
def bristle_after(bristle, speed, duration, m, r):
    """Deflection of the bristles after a time at constant speed (exact solution)."""
    ratio = speed / r.stribeck_speed
    level = m.static_friction + r.stiction * math.exp(-ratio * ratio)
    steady = math.copysign(level, speed) / r.bristle_stiffness
    return bristle + (bristle - steady) * math.expm1(-r.bristle_stiffness * abs(speed) / level * duration)


@kernel
def bristle_friction(bristle, speed, friction_share, m, r):
    """Friction torque at the shaft if the viscous friction has fallen to ``friction_share`` of F_v."""
    ratio = speed / r.stribeck_speed
    share = math.exp(-ratio * ratio)
    torque = r.bristle_stiffness * bristle + friction_share * m.viscous_friction * speed
    if share != 0.0:
        level = m.static_friction + r.stiction * share
        slip = r.bristle_stiffness * abs(speed) / level * bristle
        torque += r.bristle_damping * share * (speed - slip)
    return torque


@kernel
def shaft_torque(i, current, shaft, rate, bristle, plant, built):
    """Motor torque [N m, motor side] of axis ``i`` less friction and load, and its difference from the model's."""
    c, m, r = plant.constants, plant.motor, built.constants
    speed = c.gear_ratio * rate
    share, load = plant.state.friction_share[i], plant.state.load_torque[i]
    friction = modelled = warm_friction_torque(speed, share, m)
    if r.bristle_stiffness != 0.0:
        friction = bristle_friction(bristle, speed, share, m, r)
    torque = motor_torque(current, c.gear_ratio * shaft, m, r) - friction - load
    return torque, m.torque_constant * current - modelled - torque


@kernel
def gear_torque(twist, rate, r):
    """Torque [N m, arm side] transmitted by a gear to its arm."""
    if r.backlash == 0.0:
        return r.stiffness * twist + r.damping * rate
    half = 0.5 * r.backlash
    if abs(twist) <= half:
        return 0.0
    return contact_torque(twist - math.copysign(half, twist), rate, r.stiffness, r.damping)


@kernel
def _accelerations(arms, shafts, current, plant, built):
    """Accelerations of arms and shafts [rad/s^2, arm side], and coupling torques d [N m, motor side] (4.31).

    The last result is the force [N] of the base on the moving parts, 0 for a fixed base.

    ``arms`` is (theta, thetadot), ``shafts`` is (shaft, rate, bristle), each of them a 3-tuple.
    """
    s, c, r = plant.state, plant.constants, built.constants
    theta, thetadot = arms
    shaft, rate, z = shafts
    mass, bias = motion_terms(theta, thetadot, plant.geometry, plant.inertia)
    push = (0.0, 0.0, 0.0)
    if r.frame_mass > 0.0:
        n = plant.inertia
        masses = (n.plate + 3.0 * n.rod, n.elbow[0], n.elbow[1], n.elbow[2])
        h, push = momentum_terms(theta, thetadot, masses, plant.geometry)
        x, y = built.state.frame_acceleration[0], built.state.frame_acceleration[1]
        bias = (
            bias[0] + h[0][0] * x + h[0][1] * y,
            bias[1] + h[1][0] * x + h[1][1] * y,
            bias[2] + h[2][0] * x + h[2][1] * y,
        )
    t1, less1 = shaft_torque(0, current[0], shaft[0], rate[0], z[0], plant, built)
    t2, less2 = shaft_torque(1, current[1], shaft[1], rate[1], z[1], plant, built)
    t3, less3 = shaft_torque(2, current[2], shaft[2], rate[2], z[2], plant, built)
    k = c.gear_ratio
    held = (
        bias[0] + end_stop_torque(theta[0], thetadot[0], c),
        bias[1] + end_stop_torque(theta[1], thetadot[1], c),
        bias[2] + end_stop_torque(theta[2], thetadot[2], c),
    )
    if r.elastic != 0:
        gear = (
            gear_torque(shaft[0] + c.angle_error[0] - theta[0], rate[0] - thetadot[0], r),
            gear_torque(shaft[1] + c.angle_error[1] - theta[1], rate[1] - thetadot[1], r),
            gear_torque(shaft[2] + c.angle_error[2] - theta[2], rate[2] - thetadot[2], r),
        )
        arms = solve(mass, (gear[0] - held[0], gear[1] - held[1], gear[2] - held[2]))
        rotors = (r.rotor, r.rotor, r.rotor, 0.0, 0.0, 0.0)
        net = (k * t1 - gear[0], k * t2 - gear[1], k * t3 - gear[2])
        shafts = acceleration_under_brakes(rotors, net, rate, s, c)
        felt = (
            r.rotor * shafts[0] + gear[0],
            r.rotor * shafts[1] + gear[1],
            r.rotor * shafts[2] + gear[2],
        )
    else:
        net = (k * t1 - held[0], k * t2 - held[1], k * t3 - held[2])
        arms = shafts = acceleration_under_brakes(mass, net, rate, s, c)
        product = multiply(mass, arms)
        felt = (product[0] + bias[0], product[1] + bias[1], product[2] + bias[2])
    coupling = (
        (felt[0] - c.linear_inertia * shafts[0]) / k + less1,
        (felt[1] - c.linear_inertia * shafts[1]) / k + less2,
        (felt[2] - c.linear_inertia * shafts[2]) / k + less3,
    )
    if r.frame_mass > 0.0:
        push = plus(push, 1.0, combine(arms[0], h[0], arms[1], h[1], arms[2], h[2]))
    return arms, shafts, coupling, push


@kernel
def _bristles(bristle, rate, h, c, m, r):
    """Deflections after a step; unchanged without bristles."""
    if r.bristle_stiffness == 0.0:
        return bristle
    k = c.gear_ratio
    return (
        bristle_after(bristle[0], k * rate[0], h, m, r),
        bristle_after(bristle[1], k * rate[1], h, m, r),
        bristle_after(bristle[2], k * rate[2], h, m, r),
    )


@kernel
def step_built(before, now, plant, built):
    """Advance arms and shafts by one step, during which the currents change linearly from ``before`` to ``now``."""
    s, c, q, r = plant.state, plant.constants, built.state, built.constants
    m, h = plant.motor, c.step / r.substeps
    theta, thetadot, last = triple(s.theta), triple(s.thetadot), triple(s.thetaddot)
    shaft, rate, turning, bristle = triple(q.shaft), triple(q.rate), triple(q.acceleration), triple(q.bristle)
    rise = difference(now, before)
    for part in range(r.substeps):
        mean = plus(before, (part + 0.5) / r.substeps, rise)
        middle_rate = plus(rate, 0.5 * h, turning)
        last, turning, _, push = _accelerations(
            (plus(theta, 0.5 * h, thetadot), plus(thetadot, 0.5 * h, last)),
            (plus(shaft, 0.5 * h, rate), middle_rate, _bristles(bristle, middle_rate, 0.5 * h, c, m, r)),
            mean,
            plant,
            built,
        )
        if r.frame_mass > 0.0:
            for axis in range(2):
                held = r.frame_damping * q.frame_speed[axis] + r.frame_stiffness * q.frame[axis]
                q.frame_acceleration[axis] = -(push[axis] + held) / r.frame_mass
                q.frame_speed[axis] += h * q.frame_acceleration[axis]
                q.frame[axis] += h * q.frame_speed[axis]
        after = caught_speeds(rate, h, turning, s)
        mean_rate = middle(rate, after)
        shaft = plus(shaft, h, mean_rate)
        bristle = _bristles(bristle, mean_rate, h, c, m, r)
        rate = after
        if r.elastic != 0:
            arms = plus(thetadot, h, last)
            theta = plus(theta, h, middle(thetadot, arms))
            thetadot = arms
        else:
            theta, thetadot = plus(shaft, 1.0, c.angle_error), rate
    for i in range(3):
        s.theta[i], s.thetadot[i], s.thetaddot[i] = theta[i], thetadot[i], last[i]
        q.shaft[i], q.rate[i], q.acceleration[i], q.bristle[i] = shaft[i], rate[i], turning[i], bristle[i]
    if c.gives != 0:
        displace(plant, built)


@kernel
def built_coupling(plant, built):
    """Coupling torques d [N m, motor side] at the end of a step (4.31)."""
    s, q = plant.state, built.state
    _, _, coupling, _ = _accelerations(
        (triple(s.theta), triple(s.thetadot)),
        (triple(q.shaft), triple(q.rate), triple(q.bristle)),
        triple(s.current),
        plant,
        built,
    )
    return coupling


@kernel
def displace(plant, built):
    """Set the displacement of the true TCP by the frame and by the stretch of the rods."""
    s, q, r, n = plant.state, built.state, built.constants, plant.inertia
    offset = (q.frame[0], q.frame[1], 0.0)
    if r.rod_stiffness > 0.0:
        theta, thetadot, thetaddot = triple(s.theta), triple(s.thetadot), triple(s.thetaddot)
        _, forearm, _ = pose(theta, plant.geometry)
        h, force = momentum_terms(theta, thetadot, (n.plate, n.rod, n.rod, n.rod), plant.geometry)
        force = plus(force, 1.0, combine(thetaddot[0], h[0], thetaddot[1], h[1], thetaddot[2], h[2]))
        force = (force[0], force[1], force[2] + (n.plate + 3.0 * n.rod) * n.gravity)
        n1, n2, n3, determinant = inverse_columns(forearm)
        # force of each pair of rods over its length, then the stretch of the rods and the shift of the plate
        along = (-dot(n1, force) / determinant, -dot(n2, force) / determinant, -dot(n3, force) / determinant)
        per_pair = 0.5 / (r.rod_stiffness * determinant)
        l_b = plant.geometry.l_b
        shift = combine(
            along[0] * l_b[0] * l_b[0] * per_pair,
            n1,
            along[1] * l_b[1] * l_b[1] * per_pair,
            n2,
            along[2] * l_b[2] * l_b[2] * per_pair,
            n3,
        )
        offset = plus(offset, 1.0, shift)
    for axis in range(3):
        s.offset[axis] = offset[axis]


@kernel
def settle(plant, built):
    """Bring shafts and arms to rest, with the gears twisted by the weight of the arms."""
    s, c, q, r = plant.state, plant.constants, built.state, built.constants
    for i in range(3):
        q.shaft[i] = s.theta[i] - c.angle_error[i]
    if r.elastic == 0:
        return
    for _ in range(SETTLING):
        _, weight = motion_terms(triple(s.theta), (0.0, 0.0, 0.0), plant.geometry, plant.inertia)
        for i in range(3):
            twist = weight[i] / r.stiffness + math.copysign(0.5 * r.backlash, weight[i])
            s.theta[i] = q.shaft[i] + c.angle_error[i] - twist
