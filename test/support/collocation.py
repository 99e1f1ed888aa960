"""The shortest time over a path by direct collocation: CasADi and IPOPT, which know nothing of the planner under test.

The time is divided into even steps of constant jerk; place, speed and acceleration of the master at their ends are
unknowns, and every limit holds there. Between them it may be broken: the result is a little too short.
"""

import math
from contextlib import suppress
from itertools import pairwise

import numpy as np

from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.path_dynamics import CENTRIFUGAL, INERTIAL, RATE, WEIGHT, path_coefficients
from delta3_pacdrive.motion.virtual_master import sample_master

KNOTS, PER_PIECE = 600, 12  # of the tables of the path: in all, and at least on each of its pieces
JERK_SCALE = 10.0  # of the unknown jerks over length / duration^3
ITERATIONS_MAX = 150
# How IPOPT begins beside the motion that it is given; none of them finds the optimum of every path. Far from it, with a
# large first barrier, it loses what it was given and ends in a slower motion.
SEARCHES = ({'mu_init': 1e-5}, {'mu_init': 1e-4}, {'mu_strategy': 'adaptive'}, {'mu_init': 1e-3})


def fastest_motion(
    casadi, curve, guess, below_s, robot, payload_kg=0.0, jerk=math.inf, torque_rate=math.inf, steps=500
):
    """Phases (steps + 1, 5) of the fastest master along a curve from rest to rest; None if none is fast enough.

    The search ends with the first motion that is fast enough.

    Parameters
    ----------
    casadi
        The module.
    curve
        The path.
    guess
        Phases of a master over it, where the search begins.
    below_s
        What it must be faster than [s].
    robot
        Parameters.
    payload_kg, jerk, torque_rate
        What is carried, and limits of the TCP [m/s^3] and the motors [N m/s].
    steps
        How many even steps of time.

    """
    length, duration = curve.length_m, float(guess[-1, 0])
    edges = np.append(curve.segments[:, 0], length)
    knots = [
        np.linspace(a, b, max(math.ceil((b - a) / length * KNOTS), PER_PIECE) + 1) for a, b in pairwise(edges)
    ]
    at = np.unique(np.concatenate(knots))
    samples = sample_path(at, curve.segments)
    demands = path_coefficients(samples, np.zeros(len(at), np.int64), (payload_kg,), robot)
    opti = casadi.Opti()
    s, v, a = (opti.variable(steps + 1) for _ in range(3))
    j, stretch = opti.variable(steps), opti.variable()
    h = stretch / steps
    opti.minimize(stretch)
    opti.subject_to(s[1:] == s[:-1] + h * v[:-1] + h**2 / 2 * a[:-1] + h**3 / 6 * JERK_SCALE * j)
    opti.subject_to(v[1:] == v[:-1] + h * a[:-1] + h**2 / 2 * JERK_SCALE * j)
    opti.subject_to(a[1:] == a[:-1] + h * JERK_SCALE * j)
    for unknown, end in ((s, 1.0), (v, 0.0), (a, 0.0)):
        opti.subject_to(unknown[0] == 0.0)
        opti.subject_to(unknown[-1] == end)
    opti.subject_to(v >= 0.0)
    opti.subject_to(opti.bounded(0.0, s, 1.0))
    opti.subject_to(stretch >= 0.3)
    place, speed, acceleration = s * length, v * length / duration, a * length / duration**2

    def table(values, kind='bspline'):
        options = {'degree': [3]} if kind == 'bspline' else {}
        return casadi.interpolant('table', kind, [at], values, options)(place.T).T

    m, gear = robot.motor, robot.dynamics.gear_ratio
    volts = robot.drive.dc_link_voltage_v / math.sqrt(6.0)
    for axis in range(3):
        inertial, centrifugal, weight, rate = (
            table(demands[:, columns][:, axis]) for columns in (INERTIAL, CENTRIFUGAL, WEIGHT, RATE)
        )
        shaft = gear * rate * speed
        moving = inertial * acceleration + centrifugal * speed**2 + weight
        friction = m.static_friction_n_m * casadi.tanh(shaft / m.friction_smoothing_rad_s)
        current = (moving + friction + m.viscous_friction_n_m_s_rad * shaft) / m.torque_constant_n_m_a
        voltage = m.winding_resistance_ohm / 2.0 * current + m.torque_constant_n_m_a / 3.0 * shaft
        opti.subject_to(opti.bounded(-1.0, current / m.peak_current_a, 1.0))
        opti.subject_to(opti.bounded(-1.0, voltage / volts, 1.0))
        opti.subject_to(opti.bounded(-1.0, shaft / m.max_speed_rad_s, 1.0))
        if math.isfinite(torque_rate):
            rise = (moving[1:] - moving[:-1]) / (duration * h) / torque_rate
            opti.subject_to(opti.bounded(-1.0, rise, 1.0))
    if math.isfinite(jerk):
        change = JERK_SCALE * j * length / duration**3
        first, second = ([table(samples[:, order, axis]) for axis in range(3)] for order in (1, 2))
        third = [table(samples[:, 3, axis], 'linear') for axis in range(3)]
        for k in (slice(0, steps), slice(1, steps + 1)):
            parts = [
                p1[k] * change + 3.0 * p2[k] * speed[k] * acceleration[k] + p3[k] * speed[k] ** 3
                for p1, p2, p3 in zip(first, second, third, strict=True)
            ]
            opti.subject_to(sum(part**2 for part in parts) / jerk**2 <= 1.0)
    known = sample_master(np.linspace(0.0, duration, steps + 1), guess)
    opti.set_initial(stretch, 1.0)
    opti.set_initial(s, known[:, 0] / length)
    opti.set_initial(v, known[:, 1] * duration / length)
    opti.set_initial(a, known[:, 2] * duration**2 / length)
    opti.set_initial(j, known[:-1, 3] * duration**3 / length / JERK_SCALE)
    quiet = {'print_level': 0, 'sb': 'yes', 'max_iter': ITERATIONS_MAX, 'tol': 1e-6}
    for search in SEARCHES:
        opti.solver('ipopt', {'print_time': False}, quiet | search)
        with suppress(RuntimeError):  # it has found no optimum
            found = opti.solve()
            time_s = duration * float(found.value(stretch))
            if time_s < below_s:
                rows = np.zeros((steps + 1, 5))
                rows[:, 0] = np.linspace(0.0, time_s, steps + 1)
                for column, unknown in enumerate((s, v, a), start=1):
                    rows[:, column] = found.value(unknown) * length / duration ** (column - 1)
                rows[:-1, 4] = found.value(j) * JERK_SCALE * length / duration**3
                return rows
    return None
