"""Compiled cyclic calculations of the transformation task: the command and the feedback of a bus cycle.

Arguments of the kernels here:

``cycle``
    Number of a bus cycle.
``task``, ``s``
    Array of one record ``TASK``, shape (1,), and its state.
``timeline``
    ``planning.execution.TimelineArrays``.
``tables``
    The plan: a ``planning.plan.Tables``.
``corrections``
    Learned torques [N m] from the cycle ``corrected_from`` of the state on, shape (n, 3); n = 0 for none.
``number``, ``over``
    Number of the active move, and whether the program has ended.
``master``, ``runs``
    Number of the active move, and distance [m], speed [m/s] and acceleration [m/s^2] of the master: the result of
    ``profile_at``, meaningless unless the plan ``runs``.
``theta``
    Commanded arm angles [rad], three.
``motion``
    Arm angles [rad], speeds [rad/s] and accelerations [rad/s^2], three of shape (3,).
``payload``
    Gripped payload [kg].
``torque``, ``compliance``, ``half_backlash``
    Torque of a gear [N m], its compliance [rad/(N m)] and half of its backlash [rad], arm side.
"""

import math

from delta3_pacdrive.control.cycle.task_arrays import SETTLE_CYCLES
from delta3_pacdrive.dynamics import motion_terms, multiply
from delta3_pacdrive.kinematics import arm_angles, plate_position
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.vector3 import combine, triple
from delta3_pacdrive.planning.execution import profile_at
from delta3_pacdrive.planning.paths.joint_path import plate_motion
from delta3_pacdrive.planning.paths.path_dynamics import arm_motion
from delta3_pacdrive.planning.plan import plan_motion_at, plan_path_at
from delta3_pacdrive.robot.motor import friction_torque
from delta3_pacdrive.robot.sercos.bus_time import HISTORY
from delta3_pacdrive.robot.sercos.increments import on_grid

FLANKS_N_M = 10.0  # torque range over which a set point changes between the flanks of a gear, arm side


@kernel
def command_cycle(cycle, task, timeline, corrections):
    """Set the ``motors`` of the task to the commands [rad] of a bus cycle; nan where the TCP is out of reach."""
    s, c, profile, tables = task[0].state, task[0].constants, timeline.profile[0], timeline.tables
    theta, has_angles, runs = (0.0, 0.0, 0.0), False, cycle >= s.start_cycle
    master = (s.move, 0.0, 0.0, 0.0)
    if runs:
        master = profile_at((cycle - profile.cycle) * c.cycle_time, s.move, timeline)
        number, s.master, s.master_speed, _ = master
        _switch_outputs(number, is_over(cycle, s, profile), tables, s)
        p = plan_path_at(s.master, number, tables)
        has_angles = tables.moves[tables.order[number]].joints == 1
        if has_angles:
            theta = p
            p = plate_position(theta, task[0].geometry)
        for axis in range(3):
            s.tcp[axis] = p[axis]
            s.planned[axis] = p[axis]
    if s.tracks != 0:
        has_angles = False
        for axis in range(3):
            s.tcp[axis] = s.planned[axis] + s.offset[0, axis]
    if not has_angles:
        theta = arm_angles(triple(s.tcp), task[0].geometry)
    row = cycle % HISTORY
    s.tracks_history[row] = s.tracks
    for i in range(3):
        s.tcp_history[row, i] = s.tcp[i]
        s.theta_history[row, i] = theta[i]
    if c.gear_gives != 0.0 or c.sends_torque != 0.0:
        reached = cycle + int(c.bus_delay)
        s.coming_payload = _payload_at(reached, task, timeline) if s.start_cycle <= reached else s.payload
    twist = (0.0, 0.0, 0.0)
    if c.gear_gives != 0.0:
        twist = gear_twist(_motion_of(master, runs, 0.0, theta, task, tables), s.coming_payload, task)
    for i in range(3):
        s.twist_history[row, i] = twist[i]
        task[0].motors[i] = on_grid((theta[i] + twist[i]) * c.gear_ratio, c.increments_per_rad)
    if c.sends_torque != 0.0:
        feed_forward(cycle, theta, task, timeline)
        correct_torques(cycle - s.corrected_from, task, corrections)


@kernel
def planned_motion(cycle, task, timeline):
    """Position [m], velocity [m/s] and acceleration [m/s^2] of the TCP in a cycle by the plan, without offset."""
    profile, tables = timeline.profile[0], timeline.tables
    time = (cycle - profile.cycle) * task[0].constants.cycle_time
    number, distance, v, a = profile_at(max(time, 0.0), 0, timeline)
    place, first, second = plan_motion_at(distance, number, tables)
    velocity = (first[0] * v, first[1] * v, first[2] * v)
    bend = combine(a, first, v * v, second, 0.0, second)
    if tables.moves[tables.order[number]].joints == 1:
        return plate_motion((place, velocity, bend), task[0].geometry)
    return place, velocity, bend


@kernel
def is_over(cycle, s, profile):
    """Whether a program has ended in a cycle, other than by a stop; ``profile`` is that of the timeline."""
    return cycle >= s.end_cycle and profile.held == 0


@kernel
def feed_forward(cycle, theta, task, timeline):
    """Set the ``torques`` of the task [N m] to those that the motion of the set points requires.

    The torque of MDT(k) is reached at the end of the cycle in which it takes effect, k + ``bus_delay``, and acts a dead
    time later. The set points are one step of the fine interpolation ahead of their cycle, so the torque belongs to the
    motion at that instant. The payload at that time is the payload of MDT(k + ``bus_delay``).
    """
    s, c, m = task[0].state, task[0].constants, task[0].motor
    master, runs = (s.move, 0.0, 0.0, 0.0), (s.start_cycle - cycle) * c.cycle_time <= c.torque_lead
    if runs:
        time = (cycle - timeline.profile[0].cycle) * c.cycle_time + c.torque_lead
        master = profile_at(time, s.move, timeline)
    motion = _motion_of(master, runs, c.torque_lead, theta, task, timeline.tables)
    torque = arm_torques(motion, s.coming_payload, task)
    speed = motion[1]
    for i in range(3):
        friction = friction_torque(c.gear_ratio * speed[i], m)
        task[0].torques[i] = torque[i] / c.gear_ratio + friction


@kernel
def _motion_of(master, runs, lead, theta, task, tables):
    """Motion of the arms where the master is ``lead`` [s] after the command with the arm angles ``theta`` [rad]."""
    s, g = task[0].state, task[0].geometry
    number, distance, v, a = master
    place, velocity, bend = triple(s.planned), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if runs:
        place, first, second = plan_motion_at(distance, number, tables)
        velocity = (first[0] * v, first[1] * v, first[2] * v)
        bend = combine(a, first, v * v, second, 0.0, second)
        of_arms = tables.moves[tables.order[number]].joints == 1
        if s.tracks == 0:
            if of_arms:
                return place, velocity, bend
            theta = arm_angles(place, g)
            speed, acceleration = arm_motion(theta, (place, first, second), v, a, g)
            return theta, speed, acceleration
        if of_arms:
            place, velocity, bend = plate_motion((place, velocity, bend), g)
    if s.tracks == 0:
        return theta, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    # with an offset from the plan, as on a belt: motion of the plan plus that of the offset
    along, speed, more = triple(s.offset[0]), triple(s.offset[1]), triple(s.offset[2])
    place = combine(1.0, place, 1.0, along, lead, combine(1.0, speed, 0.5 * lead, more, 0.0, more))
    velocity = combine(1.0, velocity, 1.0, speed, lead, more)
    bend = combine(1.0, bend, 1.0, more, 0.0, more)
    theta = arm_angles(place, g)
    rates, accelerations = arm_motion(theta, (place, velocity, bend), 1.0, 0.0, g)
    return theta, rates, accelerations


@kernel
def arm_torques(motion, payload, task):
    """Torques [N m, arm side] of a motion, including rotors and weight, without friction."""
    c, n = task[0].constants, task[0].inertia
    theta, speed, acceleration = motion
    n.plate = c.empty_plate + payload
    mass, bias = motion_terms(theta, speed, task[0].geometry, n)
    inertial = multiply(mass, acceleration)
    return (inertial[0] + bias[0], inertial[1] + bias[1], inertial[2] + bias[2])


@kernel
def gear_twist(motion, payload, task):
    """Angles [rad, arm side] by which the shafts lead their arms; the gears carry all torques but the rotors'."""
    c, torque, acceleration = task[0].constants, arm_torques(motion, payload, task), motion[2]
    return (
        give(torque[0] - c.rotor * acceleration[0], c.gear_compliance, c.half_backlash),
        give(torque[1] - c.rotor * acceleration[1], c.gear_compliance, c.half_backlash),
        give(torque[2] - c.rotor * acceleration[2], c.gear_compliance, c.half_backlash),
    )


@kernel
def give(torque, compliance, half_backlash):
    """Twist [rad] of a gear under a torque [N m], arm side; smooth at the change of flanks."""
    return compliance * torque + half_backlash * math.tanh(torque / FLANKS_N_M)


@kernel
def correct_torques(row, task, corrections):
    """Add ``row`` of the learned torques to the ``torques`` of the task, and limit the sums to the motor torque."""
    if 0 <= row < corrections.shape[0]:
        limit = task[0].constants.torque_max
        for i in range(3):
            torque = task[0].torques[i] + corrections[row, i]
            task[0].torques[i] = min(max(torque, -limit), limit)


@kernel
def _payload_at(cycle, task, timeline):
    """Payload [kg] after the events of a future cycle, without carrying them out."""
    s, c, profile, tables = task[0].state, task[0].constants, timeline.profile[0], timeline.tables
    time = (cycle - profile.cycle) * c.cycle_time
    number, master, _, _ = profile_at(time, s.move, timeline)
    over = is_over(cycle, s, profile)
    payload, event = s.payload, s.event
    for driven in range(s.move, number + 1):
        move = tables.moves[tables.order[driven]]
        while event < move.events:
            row = move.first_event + event
            if driven == number and not over and tables.events[row, 0] > master:
                return payload
            if tables.events[row, 3] >= 0.0:
                payload = tables.events[row, 3]
            event += 1
        event = 0
    return payload


@kernel
def _switch_outputs(number, over, tables, s):
    """Carry out, in order, all events that the master has passed, or all remaining ones of a move that has ended."""
    while True:
        move = tables.moves[tables.order[s.move]]
        while s.event < move.events:
            row = move.first_event + s.event
            if s.move == number and not over and tables.events[row, 0] > s.master:
                return
            bit = int(tables.events[row, 1])
            if bit >= 0:
                s.outputs &= ~(1 << bit)
                if tables.events[row, 2] != 0.0:
                    s.outputs |= 1 << bit
            if tables.events[row, 3] >= 0.0:
                s.payload = tables.events[row, 3]
            s.event += 1
        if s.move >= number:
            return
        s.move += 1
        s.event = 0


@kernel
def answer_cycle(cycle, positions, torques, task):
    """Set the ``answer`` of the task: forward kinematics and errors of a bus cycle.

    ``positions`` [rad] and ``torques`` [N m] are those of the motor shafts in the AT, shapes (3,).
    """
    s, c, out = task[0].state, task[0].constants, task[0].answer
    row = cycle % HISTORY
    # the actual position corresponds to a command on the chord between two earlier commands
    whole = math.floor(c.set_point_delay)
    share = c.set_point_delay - whole
    newer = max(cycle - int(whole), 0) % HISTORY
    older = max(cycle - int(whole) - 1, 0) % HISTORY
    theta = (positions[0] / c.gear_ratio, positions[1] / c.gear_ratio, positions[2] / c.gear_ratio)
    if c.gear_gives != 0.0:
        twist, before = s.twist_history[newer], s.twist_history[older]
        theta = (
            theta[0] - (1.0 - share) * twist[0] - share * before[0],
            theta[1] - (1.0 - share) * twist[1] - share * before[1],
            theta[2] - (1.0 - share) * twist[2] - share * before[2],
        )
    p = plate_position(theta, task[0].geometry)
    error_square, within = 0.0, True
    for i in range(3):
        due_shaft = (s.theta_history[row, i] + s.twist_history[row, i]) * c.gear_ratio
        if s.tracks_history[row] != 0:
            # on a belt the set points never rest: compare with the command that the actual position corresponds to
            due_shaft = (1.0 - share) * (s.theta_history[newer, i] + s.twist_history[newer, i])
            due_shaft += share * (s.theta_history[older, i] + s.twist_history[older, i])
            due_shaft *= c.gear_ratio
        s.off[i] = due_shaft - positions[i]
        within = within and abs(s.off[i]) <= c.position_window
        out.theta[i] = theta[i]
        out.tcp_actual[i] = p[i]
        out.tcp_command[i] = s.tcp_history[row, i]
        before = s.theta_before[i]
        extrapolated = before + c.extrapolation * (before - s.theta_before_that[i])
        out.following_error[i] = s.theta_history[row, i] - extrapolated
        due = (1.0 - share) * s.tcp_history[newer, i] + share * s.tcp_history[older, i]
        out.tcp_error[i] = due - p[i]
        error_square += out.tcp_error[i] * out.tcp_error[i]
        s.theta_before_that[i] = before
        s.theta_before[i] = theta[i]
    s.within = s.within + 1 if within else 0
    if s.start_cycle <= cycle:
        for i in range(3):
            s.final_tcp[i] = p[i]
    if s.start_cycle <= cycle < s.end_cycle + SETTLE_CYCLES:
        s.measured_cycles += 1
        s.error_square_sum += error_square
        s.error_max = max(s.error_max, math.sqrt(error_square))
        for i in range(3):
            current = torques[i] / c.torque_constant
            s.current_peak[i] = max(s.current_peak[i], abs(current))
            s.current_square_sum[i] += current * current
            s.following_error_max = max(s.following_error_max, abs(out.following_error[i]))
