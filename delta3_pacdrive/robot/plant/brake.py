"""Holding brakes of the motors: delays, sticking and slipping.

An applied brake sticks (is locked) or slips. Arguments of the kernels are those of ``arrays``; ``force`` are torques.
"""

from delta3_pacdrive.dynamics import multiply, solve
from delta3_pacdrive.numerics.kernel import kernel


@kernel
def command_brakes(brakes, s):
    """Store the brake outputs of the drives, 1 = release."""
    for i in range(3):
        s.brake_command[i] = brakes[i]


@kernel
def advance_brake(i, speed, s, c):
    """Update brake ``i`` after its release or apply delay; one integration step."""
    released = s.brake_released[i]
    if s.brake_command[i] == released or (released == 0 and s.brake_stuck[i] != 0):
        s.brake_delay[i] = 0
    else:
        s.brake_delay[i] += 1
        if s.brake_delay[i] >= (c.brake_release_steps if released == 0 else c.brake_apply_steps):
            s.brake_delay[i] = 0
            s.brake_released[i] = s.brake_command[i]
            s.brake_locked[i] = 0
    if s.brake_released[i] == 0 and speed == 0.0:
        # a shaft at rest sticks, unless its brake is overloaded
        s.brake_locked[i] = 1


@kernel
def advance_brakes(speed, s, c):
    """Update the three brakes, with shafts rotating at ``speed`` [rad/s]."""
    advance_brake(0, speed[0], s, c)
    advance_brake(1, speed[1], s, c)
    advance_brake(2, speed[2], s, c)


@kernel
def caught_speed(i, before, after, s):
    """Speed of shaft ``i`` after a step from ``before`` to ``after`` [rad/s]; 0 if its brake stops it."""
    comes_to_rest = before != 0.0 and after * before <= 0.0
    if s.brake_released[i] == 0 and (s.brake_locked[i] != 0 or comes_to_rest):
        s.brake_locked[i] = 1
        return 0.0
    return after


@kernel
def caught_speeds(before, h, acceleration, s):
    """Speeds of the shafts after a step of ``h`` [s]; brakes stop them as in ``caught_speed``."""
    return (
        caught_speed(0, before[0], before[0] + h * acceleration[0], s),
        caught_speed(1, before[1], before[1] + h * acceleration[1], s),
        caught_speed(2, before[2], before[2] + h * acceleration[2], s),
    )


@kernel
def acceleration_under_brakes(mass, force, speed, s, c):
    """Accelerations of the shafts: solution x of mass x = force, 0 for shafts that a brake holds."""
    if s.brake_released[0] + s.brake_released[1] + s.brake_released[2] == 3:
        return solve(mass, force)
    return _braked_acceleration(mass, force, speed, s, c)


@kernel
def _braked_acceleration(mass, force, speed, s, c):
    """Accelerations with brakes applied: sticking shafts stay at rest, slipping ones have the full brake torque.

    A sticking brake slips if the reaction torque exceeds its torque, reduced by wear (``brake_share``).
    """
    f = (
        _slipping_torque(0, force[0], speed[0], s, c),
        _slipping_torque(1, force[1], speed[1], s, c),
        _slipping_torque(2, force[2], speed[2], s, c),
    )
    acceleration = _acceleration_with_locked_shafts(mass, f, s)
    required = multiply(mass, acceleration)
    locked = s.brake_locked[0] + s.brake_locked[1] + s.brake_locked[2]
    f = (
        _torque_if_overloaded(0, required[0] - f[0], f[0], s, c),
        _torque_if_overloaded(1, required[1] - f[1], f[1], s, c),
        _torque_if_overloaded(2, required[2] - f[2], f[2], s, c),
    )
    if s.brake_locked[0] + s.brake_locked[1] + s.brake_locked[2] != locked:
        acceleration = _acceleration_with_locked_shafts(mass, f, s)
    return acceleration


@kernel
def _slipping_torque(i, force, speed, s, c):
    """Torque on shaft ``i``, including the torque of its brake if that slips."""
    if s.brake_released[i] == 0 and s.brake_locked[i] == 0:
        if speed > 0.0:
            return force - s.brake_share[i] * c.brake_torque
        if speed < 0.0:
            return force + s.brake_share[i] * c.brake_torque
    return force


@kernel
def _torque_if_overloaded(i, reaction, force, s, c):
    """Torque on shaft ``i`` whose brake must hold ``reaction``; includes the brake torque if it starts to slip."""
    torque = s.brake_share[i] * c.brake_torque
    if s.brake_locked[i] != 0 and abs(reaction) > torque:
        s.brake_locked[i] = 0
        return force + (torque if reaction > 0.0 else -torque)
    return force


@kernel
def _acceleration_with_locked_shafts(mass, f, s):
    """Accelerations x from mass x = f, with x_i = 0 for shafts locked by their brake."""
    free = (
        0.0 if s.brake_locked[0] != 0 else 1.0,
        0.0 if s.brake_locked[1] != 0 else 1.0,
        0.0 if s.brake_locked[2] != 0 else 1.0,
    )
    reduced = (
        mass[0] if free[0] else 1.0,
        mass[1] if free[1] else 1.0,
        mass[2] if free[2] else 1.0,
        mass[3] * free[0] * free[1],
        mass[4] * free[0] * free[2],
        mass[5] * free[1] * free[2],
    )
    return solve(reduced, (f[0] * free[0], f[1] * free[1], f[2] * free[2]))
