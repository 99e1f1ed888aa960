"""The cascade: position P, velocity PI, current PI with feed-forwards, filters, limits and anti-windup (8.1).

Fine interpolation is linear, as in the thesis, or cubic. With linear interpolation the speed feed-forward steps at each
bus cycle, and the current responds with a pulse. Cubic interpolation connects the set points by Hermite polynomials
with the slopes of the chords over two cycles (Catmull-Rom): the speed is continuous, its feed-forward is that of the
curve, and the acceleration feed-forward changes linearly from one second difference to the next.

Arguments of the kernels, in addition to those of ``arrays``:

``before``, ``now``, ``after``
    Steps [rad] of the set point from ``set_point_steps``.
``passed``
    Elapsed fraction [1] of the bus cycle, 0 to 1.
"""

import math

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.drive.notch import notched


@kernel
def clamp(value, limit):
    """Limit a value to +-limit."""
    return min(max(value, -limit), limit)


@kernel
def set_point_steps(s):
    """Steps [rad] of the set point: to the last one, from the last to the present one, and on to the next one.

    The next set point is that of the MDT of this cycle. If it is not a number (a fault), the present speed is kept.
    """
    now = s.command - s.command_before
    after = s.next_command - s.command if math.isfinite(s.next_command) else now
    return s.command_before - s.command_before_that, now, after


@kernel
def cubic_way(before, now, after, passed):
    """Distance [rad] from the last set point after a fraction of the bus cycle; ``now`` at its end."""
    start, end = 0.5 * (before + now), 0.5 * (now + after)
    return passed * (start + passed * (3.0 * now - 2.0 * start - end + passed * (start + end - 2.0 * now)))


@kernel
def cubic_slope(before, now, after, passed):
    """Slope [rad/cycle] of ``cubic_way``."""
    start, end = 0.5 * (before + now), 0.5 * (now + after)
    return start + passed * (2.0 * (3.0 * now - 2.0 * start - end) + 3.0 * passed * (start + end - 2.0 * now))


@kernel
def cubic_bend(before, now, after, passed):
    """Second difference [rad/cycle^2], interpolated between those of the last and the present set point."""
    return (1.0 - passed) * (now - before) + passed * (after - now)


@kernel
def position_loop(s, c):
    """Interpolate the set point to this instant and compute the speed reference.

    The set point is approached in steps of T_pos and reached at the last of them: including the cycle on the bus,
    CT + (CT - T_pos) after it was commanded.
    """
    passed = (s.step // c.steps_per_position + 1) / c.positions_per_cycle
    actual = s.increments / c.increments_per_rad
    if c.cubic != 0:
        before, now, after = set_point_steps(s)
        s.reference = s.command_before + cubic_way(before, now, after, passed)
        speed = c.velocity_feedforward * cubic_slope(before, now, after, passed) / c.cycle_time
    else:
        s.reference = s.command_before + passed * (s.command - s.command_before)
        speed = c.velocity_feedforward * (s.command - s.command_before) / c.cycle_time
    s.speed_reference = clamp(speed + c.position_gain * (s.reference - actual), c.speed_max)


@kernel
def hold_place(s, c):
    """Compute the speed reference of a halted drive that holds its position."""
    actual = s.increments / c.increments_per_rad
    s.speed_reference = clamp(c.position_gain * (s.reference - actual), c.speed_max)


@kernel
def velocity_loop(speed, feedforward, s, c):
    """Compute the current reference from the actual speed; the integrator is frozen while the current is limited."""
    s.speed_filtered += c.velocity_smoothing * (speed - s.speed_filtered)
    error = s.speed_reference - s.speed_filtered
    integral = s.velocity_integral + c.velocity_integral_step * error
    wanted = c.velocity_gain * error + integral + feedforward
    if c.notches != 0:
        wanted = notched(wanted, s, c)
    else:
        s.current_asked = s.notched_twice = wanted
    s.current_reference = clamp(wanted, c.current_max)
    if wanted == s.current_reference or wanted * error < 0.0:
        s.velocity_integral = integral


@kernel
def current_feedforward(s, c):
    """Current for the acceleration given by the second difference of the set points."""
    if c.cubic != 0:
        before, now, after = set_point_steps(s)
        second = cubic_bend(before, now, after, (s.step + c.steps_per_velocity) / c.steps_per_cycle)
    else:
        second = s.command - 2.0 * s.command_before + s.command_before_that
    return c.current_feedforward * second / (c.cycle_time * c.cycle_time)


@kernel
def _take_over(current, s, c):
    """Add a current [A] to the one that holds the load: the disturbance observer's, else the integrator's."""
    if s.observes != 0:
        s.disturbance += c.torque_constant * current
    else:
        s.velocity_integral += current


@kernel
def disturbance_current(speed, known, s, c):
    """Update the disturbance observer and return the current [A] that compensates its estimate d.

    With the actual current i and the current ``known`` [A] of the additive torque command,

        p = LPF(K_m (i - i_known) + g J w),  d = p - g J w,  equivalent to  d = LPF(K_m (i - i_known) - J dw/dt).

    The second form has no transient if J or g changes. The measured current includes every limit, so that d does not
    wind up. The observer takes over the integrator's current when it starts, and returns it when it is switched off:
    the sum stays continuous.
    """
    if c.disturbance_share == 0.0:
        if s.observes == 0:
            return 0.0
        s.observes = 0
        s.velocity_integral += s.disturbance / c.torque_constant
        s.disturbance = 0.0
        return 0.0
    if s.observes == 0:
        s.observes = 1
        s.disturbance = c.torque_constant * s.velocity_integral
        s.velocity_integral = 0.0
    else:
        inertial = c.disturbance_inertance * (speed - s.observed_speed)
        found = c.torque_constant * (s.current - known) - inertial
        s.disturbance += c.disturbance_share * (found - s.disturbance)
    s.observed_speed = speed
    return s.disturbance / c.torque_constant


@kernel
def reset_disturbance(s):
    """Clear the estimate of a drive without torque, or whose torque a procedure commands."""
    s.observes = 0
    s.disturbance = 0.0


@kernel
def torque_feedforward(follows, s, c):
    """Current [A] of the additive torque command beyond the drive's own feed-forward.

    The torque stays continuous: the integrator takes over the torque of the command when a stop begins, and returns it
    when the drive follows again.
    """
    if not follows and s.torque_works == 0:
        return 0.0
    passed = (s.step + 0.5 * c.steps_per_velocity) / c.steps_per_cycle
    way = passed * (s.torque - s.torque_before)
    if c.cubic != 0:
        now = s.torque - s.torque_before
        way = cubic_way(s.torque_before - s.torque_before_that, now, s.next_torque - s.torque, passed)
    current = (s.torque_before + way) / c.torque_constant - current_feedforward(s, c)
    if follows and s.torque_works == 0:
        _take_over(-current, s, c)
    elif not follows:
        _take_over(current, s, c)
    s.torque_works = 1 if follows else 0
    return current if follows else 0.0


@kernel
def current_loop(voltage_max, s, c):
    """Compute the voltage for the next period (one period of computing delay)."""
    s.current_reference_filtered += c.current_reference_smoothing * (
        s.current_reference - s.current_reference_filtered
    )
    s.current_filtered += c.current_smoothing * (s.current - s.current_filtered)
    error = s.current_reference_filtered - s.current_filtered
    integral = s.current_integral + c.current_integral_step * error
    wanted = c.current_gain * error + integral
    s.voltage = clamp(wanted, voltage_max)
    if wanted == s.voltage or wanted * error < 0.0:
        s.current_integral = integral
