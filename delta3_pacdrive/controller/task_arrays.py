"""The arrays of the transformation task, which its compiled calculations (``task_cycle``) work on."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.dynamics import INERTIA, rotor_inertia
from delta3_pacdrive.kinematics import GEOMETRY
from delta3_pacdrive.motor import MOTOR
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

HISTORY = 64  # cycles of commands kept for the answers that are still on their way
SETTLE_CYCLES = 100  # after the end of a program, before the final position is taken

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
        ('corrected_from', 'i8'),
        ('tcp', 'f8', (3,)),  # commanded [m]
        # beside it where the plan has it, and what goes with a belt: place [m], velocity [m/s], acceleration [m/s^2]
        ('planned', 'f8', (3,)),
        ('tracks', 'i8'),  # whether there is any of that
        ('offset', 'f8', (3, 3)),
        ('tracks_history', 'i8', (HISTORY,)),
        ('tcp_history', 'f8', (HISTORY, 3)),
        ('theta_history', 'f8', (HISTORY, 3)),
        ('twist_history', 'f8', (HISTORY, 3)),  # of the gears [rad], arm side
        # actual arm angles of the two cycles before; what needs the past gets its first value in stand_at
        ('theta_before', 'f8', (3,)),
        ('theta_before_that', 'f8', (3,)),
        # figures of the run, from the start of the program to SETTLE_CYCLES after its end
        ('measured_cycles', 'i8'),
        ('error_max', 'f8'),
        ('error_square_sum', 'f8'),
        ('following_error_max', 'f8'),
        ('current_peak', 'f8', (3,)),
        ('current_square_sum', 'f8', (3,)),
        ('final_tcp', 'f8', (3,)),
        # of the motors [rad]: how far they are off their commands, and for how many cycles no farther than the window
        ('off', 'f8', (3,)),
        ('within', 'i8'),
    ],
    align=True,
)

# name of each constant, and what it is of the parameters
_CONSTANTS: dict[str, Callable[[Parameters], float]] = {
    'gear_ratio': lambda p: p.dynamics.gear_ratio,
    'increments_per_rad': lambda p: p.bus.increments_per_rev / math.tau,
    'cycle_time': lambda p: p.bus.cycle_time_s,
    'extrapolation': lambda p: p.following_error_delay_cycles,  # [cycles], of the actual value (7.3)
    'set_point_delay': lambda p: p.set_point_delay_cycles,  # [cycles], of the actual TCP behind the command
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

# what the answers of one cycle give; a topic of ros.interfaces may name a field, which it then tells in every cycle
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
        ('motors', 'f8', (3,)),  # motor commands [rad]
        ('torques', 'f8', (3,)),  # that the motors are to have beside them [N m], else 0
        ('answer', ANSWER),  # of the last cycle that was evaluated
    ],
    align=True,
)


def task_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``CONSTANTS``."""
    constants = np.zeros(1, CONSTANTS)
    constants[0] = tuple(value(parameters) for value in _CONSTANTS.values())
    return constants


def stand_at(theta: Floats, twist: Floats, tcp: Floats, state: np.void) -> None:
    """Give all of a ``STATE`` that keeps the past its first value: the robot has always stood there.

    ``theta`` [rad] are the actual arm angles, ``twist`` [rad] is that of their gears, ``tcp`` [m] is their place,
    shapes (3,).
    """
    state['twist_history'] = twist
    state['tcp'] = state['planned'] = state['tcp_history'] = tcp
    state['theta_history'] = state['theta_before'] = state['theta_before_that'] = theta
