"""The step of a steered robot: its next set point, within all limits and with a way to rest.

In each bus cycle the step chooses an acceleration towards the goal and accepts it only if the robot can still come to
rest from the resulting state within all limits. If it cannot, the robot follows the stop that was checked before, so
there is always a permitted motion. The stop has the cubic velocity

    v(u) = v0 (1 - 3 u^2 + 2 u^3) + a0 T (u - 2 u^2 + u^3),   u = t/T from 0 to 1,

whose acceleration and jerk start at those of the robot and end at zero speed and acceleration. T is the shortest time
that respects the limits of acceleration and jerk.

Near a limit h(p) >= 0 of the position, the speed towards it is limited to that from which the remaining distance
h/|grad h| suffices for a stop, and the component along the limit stays: the robot slides along it.

Arguments of the kernels here:

``servo``
    Array of one record ``SERVO``, shape (1,).
``task``
    Array of one record ``TASK``, shape (1,).
``p``, ``v``, ``a``
    Position [m], velocity [m/s] and acceleration [m/s^2] of the TCP, shape (3,).
``h``
    Distances from the limits of the position, ``MARGINS`` of them, each in its unit; nan out of reach. Those of the
    argument ``h`` of ``position_margins`` are overwritten.
``error``
    Distance [m] or speed [m/s] that a controller removes.
``gain``
    Gain of a controller [1/s].
``acceleration``, ``jerk``
    Limits [m/s^2] and [m/s^3], of ``root_law`` those of the first and second derivative of ``error``.
``distance``
    Distance in which the robot has to come to rest [m].
``duration``
    Duration of a stop [s].
``u``
    Number: share of the duration of a stop, 0 to 1.
``forward``
    Acceleration of the goal [m/s^2], shape (3,).
``wanted``
    Velocity towards the goal [m/s], shape (3,).
``share``
    Number, 0 to 1: share of the limits of acceleration and jerk, or of the speed towards a limit.
``least``
    Least permitted distances ``h``, ``MARGINS`` of them.
``most``
    Number: the maximum length of a vector, in its unit.
``speeds``
    Speeds of the arms [rad/s], shape (3,).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.control.cycle.task_cycle import arm_torques
from delta3_pacdrive.dynamics import rotor_inertia
from delta3_pacdrive.kinematics import (
    arm_angles,
    forearms,
    parallel_distance,
    serial_distance,
    swing_sine,
)
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import combine, difference, dot, length, plus, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import Limits, phase_voltage_max
from delta3_pacdrive.planning.paths.joint_path import plate_motion
from delta3_pacdrive.planning.paths.path_dynamics import arm_motion
from delta3_pacdrive.robot.motor import friction_torque

MARGINS = 16  # top, bottom, radius, parallel; of each arm: smallest and largest angle, swing, serial
STOP_MAX_S = 60.0  # longest stop
STOP_SAMPLES = 12  # instants of a stop at which the limits are checked
POSITION_GAIN = 20.0  # [1/s] of the distance from the goal
VELOCITY_GAIN = 80.0  # [1/s] of the deviation from the wanted velocity; four times as fast: no overshoot
INSIDE_M = (
    5e-4  # distance that is kept from limits of the position, for the bow of a stop between two samples
)
RETURN_GAIN = 5.0  # [1/s] with which a robot leaves this distance
RESERVE = 0.98  # share of torque, voltage and speed of the motors that is used
NEAR_M = 0.5  # distance from which on a limit of the position matters
PROBE_M = 1e-6  # step of the numerical gradient of the limits
SWEEPS = 64  # at most, over all near limits: in corners several of them act
STOPPING, VELOCITY, POSITION = range(3)
ATTEMPTS = (
    (1.0, 1.0),
    (1.0, 0.25),
    (0.5, 0.5),
    (0.25, 0.1),
)  # shares of acceleration and of the distance from limits

SERVO = np.dtype(
    [
        ('cycle_time', 'f8'),  # [s]
        ('speed', 'f8'),  # limits of the TCP: [m/s], [m/s^2], [m/s^3]
        ('acceleration', 'f8'),
        ('jerk', 'f8'),
        ('radius', 'f8'),  # [m], of the workspace
        ('top', 'f8'),
        ('bottom', 'f8'),
        ('angle_min', 'f8'),  # [rad]
        ('angle_max', 'f8'),
        ('swing_sine_max', 'f8'),
        ('serial_min', 'f8'),
        ('parallel_min', 'f8'),
        ('motor_speed', 'f8'),  # [rad/s]
        ('motor_torque', 'f8'),  # [N m], of the peak current
        ('gear_torque', 'f8'),  # [N m], at the output of a gear; inf: no limit
        ('rotor', 'f8'),  # inertia of a rotor, arm side [kg m^2]
        ('voltage', 'f8'),  # [V], rms phase voltage
        ('volts_per_torque', 'f8'),  # resistance
        ('volts_per_speed', 'f8'),  # back-EMF
        ('override', 'f8'),  # 1 = as commanded
        ('mode', 'i8'),  # STOPPING, VELOCITY or POSITION
        ('goal', 'f8', (3, 3)),  # position, velocity and acceleration of the goal when the command is reached
        ('p', 'f8', (3,)),  # of the last command
        ('v', 'f8', (3,)),
        ('a', 'f8', (3,)),
        # the checked stop: state at its begin, duration and elapsed time [s]
        ('stop', 'f8', (3, 3)),
        ('stop_duration', 'f8'),
        ('stop_time', 'f8'),
        ('beyond', 'f8', (MARGINS,)),  # by how much the robot is beyond limits from before; only decreases
        ('held_back', 'i8'),  # 1: a limit of the position slows the robot down; 2: it follows its stop
    ],
    align=True,
)


def servo_record(parameters: Parameters, limits: Limits) -> NDArray[Any]:
    """Return one record ``SERVO`` of a robot at rest, for limits of the TCP."""
    record = np.zeros(1, SERVO)
    s, k, motor = record[0], parameters.kinematics, parameters.motor
    s['cycle_time'] = parameters.bus.cycle_time_s
    s['speed'], s['override'] = min(limits.speed_m_s, parameters.motion.tcp_speed_limit_m_s), 1.0
    s['acceleration'], s['jerk'] = limits.acceleration_m_s2, limits.jerk_m_s3
    s['radius'] = 0.5 * k.workspace_diameter_m
    s['top'], s['bottom'] = k.workspace_top_m, k.workspace_bottom_m
    s['angle_min'], s['angle_max'] = map(math.radians, (k.arm_angle_min_deg, k.arm_angle_max_deg))
    s['swing_sine_max'] = math.sin(math.radians(k.forearm_swing_max_deg))
    s['serial_min'], s['parallel_min'] = k.serial_singularity_min, k.parallel_singularity_min
    s['motor_speed'] = RESERVE * parameters.shaft_speed_max_rad_s
    s['motor_torque'] = RESERVE * motor.torque_constant_n_m_a * motor.peak_current_a
    s['gear_torque'], s['rotor'] = RESERVE * parameters.gear_torque_max_n_m, rotor_inertia(parameters)
    s['voltage'] = RESERVE * phase_voltage_max(parameters)
    # rms per phase, as in timed_dynamics
    s['volts_per_torque'] = motor.winding_resistance_ohm / 2.0 / motor.torque_constant_n_m_a
    s['volts_per_speed'] = motor.torque_constant_n_m_a / 3.0
    return record


@kernel
def begin_at(p, v, a, servo, task):
    """Begin at a state; limits of the position that the stop from it violates hold again once they are respected."""
    s = servo[0]
    _take(p, v, a, servo)
    s.mode, s.held_back = STOPPING, 0
    begin_stop(servo)
    h = np.empty(MARGINS)
    for n in range(STOP_SAMPLES + 1):
        way = (0.0, 0.0, 0.0)
        if s.stop_duration > 0.0:
            way, _, _ = _stop_terms(n / STOP_SAMPLES, v, a, s.stop_duration)
        position_margins(plus(p, 1.0, way), h, servo, task)
        for i in range(MARGINS):
            beyond = max(-h[i], 0.0)
            s.beyond[i] = beyond if n == 0 else max(s.beyond[i], beyond)


@kernel
def motion_by_arms(speeds, servo, task):
    """Velocity [m/s] and acceleration [m/s^2] of the TCP at the last command for constant speeds of the arms."""
    g, still = task[0].geometry, (0.0, 0.0, 0.0)
    theta = arm_angles(triple(servo[0].p), g)
    _, velocity, acceleration = plate_motion((theta, speeds, still), g)
    return velocity, acceleration


@kernel
def root_law(error, gain, acceleration):
    """Rate with which a controller removes an error: linear, then the root whose slope respects ``acceleration``."""
    linear = acceleration / (gain * gain)
    if error <= linear:
        return gain * error
    return math.sqrt(2.0 * acceleration * (error - 0.5 * linear))


@kernel
def shortened(a, most):
    """Vector ``a``, shortened to a maximum length."""
    own = length(a)
    if own <= most:
        return a
    return combine(most / own, a, 0.0, a, 0.0, a)


@kernel
def speed_before(distance, acceleration, jerk):
    """Speed [m/s] from which the cubic stop needs a distance; 0 for negative ones.

    From a speed v it lasts T = max(sqrt(6 v/j), 3 v/(2 a)) and takes the distance v T/2.
    """
    if distance <= 0.0:
        return 0.0
    by_jerk = (2.0 * distance / math.sqrt(6.0 / jerk)) ** (2.0 / 3.0)
    return min(by_jerk, math.sqrt(distance * acceleration / 0.75))


@kernel
def position_margins(p, h, servo, task):
    """Set the distances from all limits of the position; return the arm angles [rad]."""
    s, g = servo[0], task[0].geometry
    h[0] = s.top - p[2]
    h[1] = p[2] - s.bottom
    h[2] = s.radius - math.sqrt(p[0] * p[0] + p[1] * p[1])
    theta = arm_angles(p, g)
    forearm, tangent = forearms(theta, p, g)
    h[3] = parallel_distance(forearm, g) - s.parallel_min
    for i in range(3):
        h[4 + i] = theta[i] - s.angle_min
        h[7 + i] = s.angle_max - theta[i]
        h[10 + i] = s.swing_sine_max - swing_sine(i, p, g)
        h[13 + i] = serial_distance(i, dot(forearm[i], tangent[i]), g) - s.serial_min
    return theta


@kernel
def _along_limits(wanted, share, servo, task):
    """Velocity without the components that the distances from the limits of the position do not allow."""
    s = servo[0]
    p = triple(s.p)
    h = np.empty(MARGINS)
    moved = np.empty((3, MARGINS))
    position_margins(p, h, servo, task)
    for axis in range(3):
        q = (
            p[0] + (PROBE_M if axis == 0 else 0.0),
            p[1] + (PROBE_M if axis == 1 else 0.0),
            p[2] + (PROBE_M if axis == 2 else 0.0),
        )
        position_margins(q, moved[axis], servo, task)
    kept = wanted
    for _ in range(SWEEPS):
        changed = False
        for i in range(MARGINS):
            slope = (
                (moved[0, i] - h[i]) / PROBE_M,
                (moved[1, i] - h[i]) / PROBE_M,
                (moved[2, i] - h[i]) / PROBE_M,
            )
            size = length(slope)
            if not size > 0.0:
                continue
            distance = (h[i] + s.beyond[i]) / size - INSIDE_M
            if distance > NEAR_M:
                continue
            fastest = RETURN_GAIN * distance
            if distance > 0.0:
                fastest = share * speed_before(distance, s.acceleration, s.jerk)
            towards = -dot(kept, slope) / size
            if towards > fastest:
                kept = plus(kept, (towards - fastest) / size, slope)
                changed = True
        if not changed:
            break
    return kept


@kernel
def _wanted_velocity(servo):
    """Velocity towards the goal [m/s], and acceleration of the goal [m/s^2]."""
    s = servo[0]
    zero = (0.0, 0.0, 0.0)
    if s.mode == STOPPING:
        return zero, zero
    if s.mode == VELOCITY:
        wanted = combine(s.override, triple(s.goal[1]), 0.0, zero, 0.0, zero)
        forward = combine(s.override * s.override, triple(s.goal[2]), 0.0, zero, 0.0, zero)
        return shortened(wanted, min(s.override, 1.0) * s.speed), forward
    # the goal in the cycle of the present state, one before the next command
    t, speed, forward = s.cycle_time, triple(s.goal[1]), triple(s.goal[2])
    place = combine(1.0, triple(s.goal[0]), -t, speed, 0.5 * t * t, forward)
    away = difference(place, triple(s.p))
    distance = length(away)
    wanted = plus(speed, -t, forward)
    if distance > 0.0:
        wanted = plus(wanted, root_law(distance, POSITION_GAIN, 0.5 * s.acceleration) / distance, away)
    return shortened(wanted, min(s.override, 1.0) * s.speed), forward


@kernel
def _acceleration_towards(wanted, forward, share, servo):
    """Next acceleration [m/s^2] towards a velocity, with the ``forward`` acceleration of the goal."""
    s = servo[0]
    off = difference(wanted, triple(s.v))
    speed = length(off)
    aim = forward
    if speed > 0.0:
        aim = plus(forward, root_law(speed, VELOCITY_GAIN, share * s.jerk) / speed, off)
    aim = shortened(aim, share * s.acceleration)
    change = shortened(difference(aim, triple(s.a)), share * s.jerk * s.cycle_time)
    return plus(triple(s.a), 1.0, change)


@kernel
def _stop_terms(u, v, a, duration):
    """Way [m] from the begin of a stop, velocity [m/s] and acceleration [m/s^2] in it."""
    u2, u3 = u * u, u * u * u
    way = combine(
        duration * (u - u3 + 0.5 * u2 * u2),
        v,
        duration * duration * (0.5 * u2 - 2.0 / 3.0 * u3 + 0.25 * u2 * u2),
        a,
        0.0,
        v,
    )
    velocity = combine(1.0 - 3.0 * u2 + 2.0 * u3, v, duration * (u - 2.0 * u2 + u3), a, 0.0, v)
    bend = combine((6.0 * u2 - 6.0 * u) / duration, v, 1.0 - 4.0 * u + 3.0 * u2, a, 0.0, v)
    return way, velocity, bend


@kernel
def stop_duration(v, a, servo):
    """Shortest duration [s] of a stop within the limits of acceleration and jerk, to 3 %; -1 if there is none."""
    s = servo[0]
    duration = 4.0 * s.cycle_time
    while duration < STOP_MAX_S:
        first = combine(-6.0 / (duration * duration), v, -4.0 / duration, a, 0.0, v)
        last = combine(6.0 / (duration * duration), v, 2.0 / duration, a, 0.0, v)
        kept = max(dot(first, first), dot(last, last)) <= s.jerk * s.jerk
        # the acceleration is a parabola, which may rise between two samples
        bow = length(combine(12.0 / duration, v, 6.0, a, 0.0, v)) / 512.0
        least = s.acceleration - bow
        kept = kept and least > 0.0
        rises = -6.0 / duration * dot(v, a) - 4.0 * dot(a, a) > 0.0
        if rises and dot(a, a) > least * least:
            kept = False
        for n in range(1, 8):
            if not kept:
                break
            _, _, bend = _stop_terms(n / 8.0, v, a, duration)
            kept = dot(bend, bend) <= least * least
        if kept:
            return duration
        duration *= 1.1 if duration < 0.1 else 1.03
    return -1.0


@kernel
def _highest_speed(v, a, duration):
    """Highest speed [m/s] during a stop: that of its begin, or where the speed along ``v`` has its maximum."""
    speed = length(v)
    if not speed > 0.0:
        # from rest the whole motion is due to the acceleration, and fastest after a third
        return length(a) * duration * 4.0 / 27.0
    along = dot(v, a) / speed * duration
    if along <= 0.0:
        return speed
    square, linear = 6.0 * speed + 3.0 * along, 6.0 * speed + 4.0 * along
    u = (linear - math.sqrt(linear * linear - 4.0 * square * along)) / (2.0 * square)
    _, velocity, _ = _stop_terms(u, v, a, duration)
    return length(velocity)


@kernel
def _is_permitted(p, v, a, least, h, servo, task):
    """Whether a state respects all limits; sets the distances ``h``, which must be at least ``least``."""
    s, c, m = servo[0], task[0].constants, task[0].motor
    theta = position_margins(p, h, servo, task)
    for i in range(MARGINS):
        h[i] += s.beyond[i]
        if not h[i] >= least[i]:
            return False
    speed, acceleration = arm_motion(theta, (p, v, a), 1.0, 0.0, task[0].geometry)
    torque = arm_torques((theta, speed, acceleration), task[0].state.payload, task)
    for i in range(3):
        turning = c.gear_ratio * speed[i]
        needed = torque[i] / c.gear_ratio + friction_torque(turning, m)
        volts = s.volts_per_torque * needed + s.volts_per_speed * turning
        if not (abs(turning) <= s.motor_speed and abs(needed) <= s.motor_torque and abs(volts) <= s.voltage):
            return False
        if not abs(torque[i] - s.rotor * acceleration[i]) <= s.gear_torque:
            return False
    return True


@kernel
def _can_stop(p, v, a, servo, task):
    """Duration [s] of a stop from a state within all limits; -1 if there is none."""
    s = servo[0]
    duration = stop_duration(v, a, servo)
    if duration < 0.0 or _highest_speed(v, a, duration) > s.speed * (1.0 + 1e-9):
        return -1.0
    least, h = np.zeros(MARGINS), np.empty(MARGINS)
    if not _is_permitted(p, v, a, least, h, servo, task):
        return -1.0
    # path and speed may bend between two samples; a robot that is closer to a limit must not come closer
    step = duration / STOP_SAMPLES
    bow = min(0.125 * s.acceleration * step * step, INSIDE_M)
    for i in range(MARGINS):
        least[i] = min(bow, h[i])
    fastest = s.speed - 0.125 * s.jerk * step * step
    for n in range(1, STOP_SAMPLES + 1):
        way, velocity, bend = _stop_terms(n / STOP_SAMPLES, v, a, duration)
        if length(velocity) > fastest:
            return -1.0
        if not _is_permitted(plus(p, 1.0, way), velocity, bend, least, h, servo, task):
            return -1.0
    return duration


@kernel
def _take(p, v, a, servo):
    """Set the state of the command."""
    s = servo[0]
    for axis in range(3):
        s.p[axis], s.v[axis], s.a[axis] = p[axis], v[axis], a[axis]


@kernel
def _tries(wanted, forward, share, servo, task):
    """Take the state after a step towards a velocity if a stop from it is permitted; return whether it is."""
    s = servo[0]
    before, t = triple(s.a), s.cycle_time
    after = _acceleration_towards(wanted, forward, share, servo)
    # constant jerk within the cycle
    p = combine(1.0, triple(s.p), t, triple(s.v), t * t / 3.0, before)
    p = plus(p, t * t / 6.0, after)
    v = combine(1.0, triple(s.v), 0.5 * t, before, 0.5 * t, after)
    duration = _can_stop(p, v, after, servo, task)
    if duration < 0.0:
        return False
    _take(p, v, after, servo)
    for axis in range(3):
        s.stop[0, axis], s.stop[1, axis], s.stop[2, axis] = p[axis], v[axis], after[axis]
    s.stop_duration, s.stop_time = duration, 0.0
    return True


@kernel
def _follow_stop(servo):
    """Take the next state of the checked stop."""
    s = servo[0]
    s.stop_time = min(s.stop_time + s.cycle_time, s.stop_duration)
    begin, zero = triple(s.stop[0]), (0.0, 0.0, 0.0)
    if s.stop_time >= s.stop_duration:
        if s.stop_duration > 0.0:
            way, _, _ = _stop_terms(1.0, triple(s.stop[1]), triple(s.stop[2]), s.stop_duration)
            begin = plus(begin, 1.0, way)
        _take(begin, zero, zero, servo)
        return
    way, velocity, bend = _stop_terms(
        s.stop_time / s.stop_duration, triple(s.stop[1]), triple(s.stop[2]), s.stop_duration
    )
    _take(plus(begin, 1.0, way), velocity, bend, servo)


@kernel
def begin_stop(servo):
    """Begin the shortest stop from the present state, whatever limits of the position it violates."""
    s = servo[0]
    for axis in range(3):
        s.stop[0, axis], s.stop[1, axis], s.stop[2, axis] = s.p[axis], s.v[axis], s.a[axis]
    s.stop_duration, s.stop_time = max(stop_duration(triple(s.v), triple(s.a), servo), 0.0), 0.0


@kernel
def servo_step(servo, task):
    """Set the state of the next command; return whether the robot is at rest."""
    s = servo[0]
    desired, forward = _wanted_velocity(servo)
    moving = False
    s.held_back = 2
    if s.mode == STOPPING:
        # a stop is never replaced by a longer one
        s.held_back = 0
        _follow_stop(servo)
    else:
        for share, room in ATTEMPTS:
            wanted = _along_limits(desired, room, servo, task)
            if _tries(wanted, forward if share == 1.0 else (0.0, 0.0, 0.0), share, servo, task):
                moved = difference(wanted, desired)
                s.held_back = 1 if dot(moved, moved) > 1e-12 else 0
                moving = True
                break
        if not moving:
            _follow_stop(servo)
    h = np.empty(MARGINS)
    position_margins(triple(s.p), h, servo, task)
    for i in range(MARGINS):
        s.beyond[i] = min(s.beyond[i], max(-h[i], 0.0))
    return s.mode == STOPPING and s.stop_time >= s.stop_duration
