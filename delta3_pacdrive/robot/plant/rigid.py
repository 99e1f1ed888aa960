"""Force model of a rigid robot: shafts are rigidly coupled to arms, with the friction of the thesis (8.2).

    A thetaddot + C thetadot + G = k_r (K_m I - friction - load) - end stop          (4.26, A with rotors)

A step is an explicit midpoint step: positions and speeds are predicted at its midpoint, the exact dynamics are solved
there once, and the state advances with that acceleration; second order in the step size.
"""

from delta3_pacdrive.dynamics import motion_terms, multiply
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import middle, plus, triple
from delta3_pacdrive.robot.motor import warm_friction_torque
from delta3_pacdrive.robot.plant.brake import acceleration_under_brakes, caught_speeds
from delta3_pacdrive.robot.plant.contact import end_stop_torque


@kernel
def effective_currents(currents, k, s):
    """``currents`` [A] at the end of step ``k``, as those with which motors with the whole K_m have the same torque."""
    return (
        s.torque_share[0] * currents[k, 0],
        s.torque_share[1] * currents[k, 1],
        s.torque_share[2] * currents[k, 2],
    )


@kernel
def drive_torque(current, friction_share, theta, thetadot, c, m):
    """Torque [N m, arm side] of one motor through its gear, less friction and end stop.

    ``friction_share`` is the viscous friction relative to F_v.
    """
    speed = c.gear_ratio * thetadot
    torque = c.gear_ratio * (m.torque_constant * current - warm_friction_torque(speed, friction_share, m))
    return torque - end_stop_torque(theta, thetadot, c)


@kernel
def accelerate(theta, thetadot, current, plant):
    """Arm accelerations of a state, with the mass matrix and the torques of motion, weight and loads [N m]."""
    s, c, m = plant.state, plant.constants, plant.motor
    mass, (b1, b2, b3) = motion_terms(theta, thetadot, plant.geometry, plant.inertia)
    bias = (
        b1 + c.gear_ratio * s.load_torque[0],
        b2 + c.gear_ratio * s.load_torque[1],
        b3 + c.gear_ratio * s.load_torque[2],
    )
    force = (
        drive_torque(current[0], s.friction_share[0], theta[0], thetadot[0], c, m) - bias[0],
        drive_torque(current[1], s.friction_share[1], theta[1], thetadot[1], c, m) - bias[1],
        drive_torque(current[2], s.friction_share[2], theta[2], thetadot[2], c, m) - bias[2],
    )
    return acceleration_under_brakes(mass, force, thetadot, s, c), mass, bias


@kernel
def step_rigid(before, now, plant):
    """Advance the arms by one step, during which the currents change linearly from ``before`` to ``now``."""
    s, h = plant.state, plant.constants.step
    theta, thetadot, last = triple(s.theta), triple(s.thetadot), triple(s.thetaddot)
    half_way = plus(theta, 0.5 * h, plus(thetadot, 0.25 * h, last))
    last, _, _ = accelerate(half_way, plus(thetadot, 0.5 * h, last), middle(before, now), plant)
    after = caught_speeds(thetadot, h, last, s)
    theta = plus(theta, h, middle(thetadot, after))
    for i in range(3):
        s.theta[i], s.thetadot[i], s.thetaddot[i] = theta[i], after[i], last[i]


@kernel
def rigid_coupling(plant):
    """Coupling torques d [N m, motor side]: motor torques beyond the linear part (4.31)."""
    s, c = plant.state, plant.constants
    acceleration, mass, bias = accelerate(triple(s.theta), triple(s.thetadot), triple(s.current), plant)
    product = multiply(mass, acceleration)
    return (
        (product[0] + bias[0] - c.linear_inertia * acceleration[0]) / c.gear_ratio,
        (product[1] + bias[1] - c.linear_inertia * acceleration[1]) / c.gear_ratio,
        (product[2] + bias[2] - c.linear_inertia * acceleration[2]) / c.gear_ratio,
    )
