"""Record types shared by the transformation task and its compiled calculations (``task_cycle``)."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.dynamics import INERTIA, rotor_inertia
from delta3_pacdrive.kinematics import GEOMETRY
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import AXES_MAX, Parameters
from delta3_pacdrive.robot.motor import MOTOR
from delta3_pacdrive.robot.sercos.bus_time import HISTORY

SETTLE_CYCLES = 100  # from the end of a program to the measurement of its final position

STATE = np.dtype(
    [
        ('start_cycle', 'i8'),
        ('end_cycle', 'i8'),
        ('move', 'i8'),
        ('master', 'f8'),  # [m]
        ('master_speed', 'f8'),  # [m/s]
        ('event', 'i8'),  # next of the present move
        ('outputs', 'i8'),  # bit n = output n
        ('payload', 'f8'),  # gripped [kg]
        # at the time when the command is reached [kg]; set if torques depend on it
        ('coming_payload', 'f8'),
        ('corrected_from', 'i8'),
        ('tcp', 'f8', (3,)),  # commanded [m]
        # on a belt the command is the plan plus an offset: position [m], velocity [m/s], acceleration [m/s^2]
        ('planned', 'f8', (3,)),
        ('tracks', 'i8'),  # whether an offset is added
        ('offset', 'f8', (3, 3)),
        ('tracks_history', 'i8', (HISTORY,)),
        ('tcp_history', 'f8', (HISTORY, 3)),
        ('theta_history', 'f8', (HISTORY, 3)),
        ('twist_history', 'f8', (HISTORY, 3)),  # of the gears [rad], arm side
        # actual arm angles of the last two cycles; histories are set by initialize_history
        ('theta_before', 'f8', (3,)),
        ('theta_before_that', 'f8', (3,)),
        # results of the program, from its start to SETTLE_CYCLES after its end
        ('measured_cycles', 'i8'),
        ('error_max', 'f8'),
        ('error_square_sum', 'f8'),
        ('following_error_max', 'f8'),
        ('current_peak', 'f8', (3,)),
        ('current_square_sum', 'f8', (3,)),
        ('final_tcp', 'f8', (3,)),
        # deviation of the motors from their commands [rad], and consecutive cycles within the position window
        ('off', 'f8', (3,)),
        ('within', 'i8'),
    ],
    align=True,
)

# name of each constant, and its value from the parameters
_CONSTANTS: dict[str, Callable[[Parameters], float]] = {
    'gear_ratio': lambda p: p.dynamics.gear_ratio,
    'increments_per_rad': lambda p: p.bus.increments_per_rev / math.tau,
    'cycle_time': lambda p: p.bus.cycle_time_s,
    'extrapolation': lambda p: p.following_error_delay_cycles,  # [cycles], age of the actual value (7.3)
    'set_point_delay': lambda p: (
        p.set_point_delay_cycles
    ),  # [cycles], of the actual TCP relative to the command
    'bus_delay': lambda p: p.bus_delay_cycles,  # [cycles], until a command takes effect
    'position_window': lambda p: p.drive.position_window_rad,
    'torque_constant': lambda p: p.motor.torque_constant_n_m_a,
    'sends_torque': lambda p: p.sends_torque,
    'torque_max': lambda p: p.torque_max_n_m,
    'torque_lead': lambda p: p.drive.position_period_s + p.torque_dead_time_s,  # [s]: see feed_forward
    'gear_gives': lambda p: p.gear_gives,
    'gear_compliance': lambda p: p.gear_compliance_rad_n_m,  # arm side
    'half_backlash': lambda p: 0.5 * p.control.gear_backlash_rad,
    'rotor': rotor_inertia,
    # m_nt [kg] without payload
    'empty_plate': lambda p: p.dynamics.plate_total_mass_kg - p.dynamics.payload_mass_kg,
}
CONSTANTS = np.dtype([(name, 'f8') for name in _CONSTANTS], align=True)

# evaluated feedback of a cycle; topics of ros.interfaces publish fields of it
ANSWER = np.dtype(
    [
        ('theta', 'f8', (3,)),  # actual arm angles [rad]
        ('tcp_actual', 'f8', (3,)),  # by forward kinematics [m]
        ('tcp_command', 'f8', (3,)),  # of the same cycle [m]
        ('following_error', 'f8', (3,)),  # of each arm [rad], dead time removed
        ('tcp_error', 'f8', (3,)),  # [m], set-point delay removed
    ],
    align=True,
)

TASK = np.dtype(
    [
        ('state', STATE),
        ('constants', CONSTANTS),
        ('geometry', GEOMETRY),
        ('inertia', INERTIA),  # with the payload of the feed-forward
        ('motor', MOTOR),
        # of the arms, then of the rotary axes
        ('motors', 'f8', (AXES_MAX,)),  # motor commands [rad]
        ('torques', 'f8', (AXES_MAX,)),  # additive torque commands [N m], 0 without feed-forward
        ('answer', ANSWER),  # of the last evaluated cycle
    ],
    align=True,
)


def task_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``CONSTANTS``."""
    constants = np.zeros(1, CONSTANTS)
    constants[0] = tuple(value(parameters) for value in _CONSTANTS.values())
    return constants


def initialize_history(theta: Floats, twist: Floats, tcp: Floats, state: np.void) -> None:
    """Initialize commands and histories as if the robot had always been at rest at this position.

    ``theta`` [rad] are the arm angles, ``twist`` [rad] the twists of their gears, ``tcp`` [m] the position of the TCP,
    shapes (3,).
    """
    state['twist_history'] = twist
    state['tcp'] = state['planned'] = state['tcp_history'] = tcp
    state['theta_history'] = state['theta_before'] = state['theta_before_that'] = theta
