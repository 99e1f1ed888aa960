"""Impulse responses of the closed loops from a torque in one bus cycle to the motors, measured on a simulated robot.

The robot holds a pose with a payload and receives a torque in one MDT. Friction, backlash, ripple and noise are off
because they are nonlinear and would stop a shaft at rest; elastic gears are included.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE
from delta3_pacdrive.simulation.robot import Robot

SETTLE_S, LENGTH_S = 0.4, 0.4  # settling time before the torque; length of a response
PULSE_N_M = 2.0
FINE_INCREMENTS = 2**23  # finer than the real encoder, whose quantisation would be noise
LINEAR = {
    'motor__static_friction_n_m': 0.0,
    'rich__friction': False,
    'rich__gear_backlash_rad': 0.0,
    'rich__ripple': False,
    'rich__sensors': False,
    'bus__increments_per_rev': FINE_INCREMENTS,
}
MASSES = ('upper_arm_mass_kg', 'elbow_mass_kg', 'forearm_mass_kg', 'plate_mass_kg')


def with_masses(parameters: Parameters, share: float) -> Parameters:
    """Return the parameters of a robot with scaled masses."""
    return parameters.replace(
        **{f'dynamics__{name}': share * getattr(parameters.dynamics, name) for name in MASSES}
    )


def measured(parameters: Parameters, place_m: ArrayLike, payload_kg: float) -> Floats:
    """Return the impulse responses of the motors in a pose with a payload.

    Returns
    -------
    Floats
        Angles [rad] in the AT for 1 N m, from the cycle of the MDT: shape (cycles, motor, motor with the torque).

    """
    standing = parameters.replace(
        motion__home_m=tuple(np.asarray(place_m, dtype=np.float64).tolist()), **LINEAR
    )
    settle, length = (math.ceil(time_s / parameters.bus.cycle_time_s) for time_s in (SETTLE_S, LENGTH_S))
    answers = []
    for axis in (None, 0, 1, 2):
        robot = Robot(standing)
        robot.grip(payload_kg)
        commands = np.tile(robot.encoder_positions(), (settle + length, 1))
        torques = np.zeros_like(commands)
        if axis is not None:
            torques[settle, axis] = PULSE_N_M
        answers.append(robot.run(commands, CONTROL_ENABLE, torques)[settle:, 0])
    return np.stack([(answer - answers[0]) / PULSE_N_M for answer in answers[1:]], axis=-1)
