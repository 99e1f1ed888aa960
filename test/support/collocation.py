"""The shortest time over a path by direct collocation: CasADi and IPOPT, independent of the tested planner.

Speed and acceleration of the master at fixed places of the path are the unknowns. The places are those that a known
motion passes in even steps of time, so that they lie close where it begins and ends. The equation of motion, speed,
voltage, current and the rates hold at these places or from one to the next. Between them limits may be broken: the
result is a little too short.
"""

import math

import numpy as np

from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    path_coefficients,
)
from delta3_pacdrive.planning.paths.virtual_master import sample_master

ITERATIONS_MAX = 300
SEARCHES = ({'mu_init': 1e-4}, {'mu_init': 1e-2}, {'mu_strategy': 'adaptive'})  # how IPOPT begins, in turn
SLOWEST = 1e-6  # of the mean speed of the known motion: the master never stands on its way


def shortest_duration(
    casadi, curve, known, robot, payload_kg=0.0, jerk=math.inf, torque_rate=math.inf, steps=1000
):
    """Return the shortest duration of a motion of a master along a curve from rest to rest [s], or None.

    Parameters
    ----------
    casadi
        The module.
    curve
        The path.
    known
        Phases of a master over it, as the start of the search.
    robot
        Parameters.
    payload_kg, jerk, torque_rate
        Payload, and limits of the TCP [m/s^3] and the motors [N m/s].
    steps
        Number of pieces of the path.

    """
    length, duration = curve.length_m, float(known[-1, 0])
    begin = sample_master(np.linspace(0.0, duration, steps + 1), known)
    at = np.concatenate(([0.0], begin[1:-1, 0], [length]))
    samples = sample_path(at, curve.segments)
    demands = path_coefficients(samples, np.zeros(len(at), np.int64), (payload_kg,), robot)
    speed_unit, acceleration_unit = length / duration, length / duration**2
    opti = casadi.Opti()
    unknown_v, unknown_a = opti.variable(steps - 1), opti.variable(steps - 1)
    v = casadi.vertcat(0.0, unknown_v, 0.0) * speed_unit
    a = casadi.vertcat(0.0, unknown_a, 0.0) * acceleration_unit
    opti.subject_to(unknown_v >= SLOWEST)
    # From one place to the next the acceleration is linear in the distance, and so is the speed, nearly. Beside rest
    # they grow with the distance to the powers of 1/3 and 2/3.
    piece = np.diff(at)
    gained = casadi.vertcat(1.5 * piece[0] * a[1], piece[1:-1] * (a[1:-2] + a[2:-1]), 1.5 * piece[-1] * a[-2])
    dt = casadi.vertcat(
        3.0 * piece[0] / v[1], 2.0 * piece[1:-1] / (v[1:-2] + v[2:-1]), 3.0 * piece[-1] / v[-2]
    )
    opti.subject_to((v[1:] ** 2 - v[:-1] ** 2 - gained) / speed_unit**2 == 0.0)
    opti.minimize(casadi.sum1(dt) / duration)

    m, gear = robot.motor, robot.dynamics.gear_ratio
    volts = robot.drive.dc_link_voltage_v / math.sqrt(6.0)
    for axis in range(3):
        inertial, centrifugal, weight, rate = (
            demands[:, columns][:, axis] for columns in (INERTIAL, CENTRIFUGAL, WEIGHT, RATE)
        )
        shaft = gear * rate * v
        moving = inertial * a + centrifugal * v**2 + weight
        friction = m.static_friction_n_m * casadi.tanh(shaft / m.friction_smoothing_rad_s)
        current = (moving + friction + m.viscous_friction_n_m_s_rad * shaft) / m.torque_constant_n_m_a
        voltage = m.winding_resistance_ohm / 2.0 * current + m.torque_constant_n_m_a / 3.0 * shaft
        for used in (current / m.peak_current_a, voltage / volts, shaft / m.max_speed_rad_s):
            opti.subject_to(opti.bounded(-1.0, used[1:-1], 1.0))
        if math.isfinite(torque_rate):
            opti.subject_to(opti.bounded(-1.0, (moving[1:] - moving[:-1]) / dt / torque_rate, 1.0))
    if math.isfinite(jerk):
        change = (a[1:] - a[:-1]) / dt
        for k in (slice(0, steps), slice(1, steps + 1)):
            first, second, third = (samples[k, order] for order in (1, 2, 3))
            parts = [
                first[:, i] * change + 3.0 * second[:, i] * v[k] * a[k] + third[:, i] * v[k] ** 3
                for i in range(3)
            ]
            opti.subject_to(sum(part**2 for part in parts) / jerk**2 <= 1.0)

    quiet = {'print_level': 0, 'sb': 'yes', 'max_iter': ITERATIONS_MAX, 'tol': 1e-6}
    for search in SEARCHES:
        opti.set_initial(unknown_v, begin[1:-1, 1] / speed_unit)
        opti.set_initial(unknown_a, begin[1:-1, 2] / acceleration_unit)
        opti.solver('ipopt', {'print_time': False}, quiet | search)
        try:
            return duration * float(opti.solve().value(opti.f))
        except RuntimeError:  # it has found no optimum
            continue
    return None
