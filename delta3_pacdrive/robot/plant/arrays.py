"""State and constants of the plant as records shared by the compiled loops.

Arguments of the kernels of this package:

``s``, ``c``
    Records ``STATE`` and ``CONSTANTS``.
``n``, ``m``, ``r``
    Records ``dynamics.INERTIA``, ``motor.MOTOR`` and ``built_robot.BUILT_CONSTANTS``.
``plant``, ``built``, ``plate``
    Records ``PLANT``, ``built_robot.BUILT`` and ``plate_pose.PLATE``; outside a step the first two are arrays of one
    record, and ``built`` is None for a rigid robot.
``i``
    Axis number, 0 to 2.
``theta``, ``thetadot``
    Arm angles [rad] and speeds [rad/s], shape (3,), or those of one arm.
``shaft``, ``rate``
    Motor shafts over k_r [rad] and their speeds [rad/s], shape (3,), or those of one.
``speed``, ``angle``
    Speed [rad/s] and position [rad] of motor shafts; for brakes on the arm side.
``bristle``
    Deflection z of the bristles [rad, motor side], shape (3,), or that of one shaft.
``current``, ``before``, ``now``
    Currents [A rms], shape (3,), or that of one motor; at the beginning and the end of a step.
``mass``, ``force``, ``f``
    Mass matrix as in ``dynamics`` [kg m^2], shape (6,), and arm torques [N m], shape (3,).
``acceleration``
    Acceleration of shafts over k_r [rad/s^2], shape (3,).
``h``, ``duration``
    Time step [s].
``payload_kg``
    Payload gripped by the controller [kg].
``brakes``
    Brake outputs of the drives, 1 = release, shape (3,).
``depth``, ``stiffness``, ``damping``
    Compression, stiffness and damping of a spring: [rad], [N m/rad], [N m s/rad].
``v``, ``gibbs``
    Vector [m], and a rotation: its axis times the tangent of half its angle, shape (3,).
``equations``
    Linear equations, shape (6, 7).
``g``
    Record ``kinematics.GEOMETRY``.
``twist``
    Twist of a gear [rad, arm side].
``coupling``
    Torques on the shafts in addition to their own inertia and friction [N m, motor side], shape (3,).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.dynamics import INERTIA
from delta3_pacdrive.kinematics import GEOMETRY
from delta3_pacdrive.parameters import DECOUPLED, Parameters
from delta3_pacdrive.robot.motor import MOTOR
from delta3_pacdrive.robot.plant.plate_pose import PLATE

STATE = np.dtype(
    [
        ('theta', 'f8', (3,)),  # [rad], arm
        ('thetadot', 'f8', (3,)),  # [rad/s], arm
        ('thetaddot', 'f8', (3,)),  # [rad/s^2], arm, of the last step
        ('current', 'f8', (3,)),  # [A rms], at the end of the last step, for the whole K_m
        ('coupling', 'f8', (3,)),  # d [N m], motor (4.31)
        ('offset', 'f8', (3,)),  # [m], of the true TCP by the frame and by elastic rods
        ('drawn', 'f8'),  # [J], from the DC link in the last exchange period
        ('brake_command', 'i8', (3,)),  # 1 = release
        ('brake_released', 'i8', (3,)),
        ('brake_delay', 'i8', (3,)),  # steps since the command changed
        ('brake_locked', 'i8', (3,)),  # the shaft sticks
        ('gripped', 'f8'),  # [kg], last command
        ('carried', 'f8'),  # [kg], true payload at the plate
        # injected
        ('brake_share', 'f8', (3,)),  # remaining fraction of the brake torque: 1 new, 0 worn out
        ('brake_stuck', 'i8', (3,)),  # an applied brake no longer opens
        ('load_torque', 'f8', (3,)),  # [N m], motor; positive opposes forward rotation
        ('payload_lost', 'i8'),  # the payload has fallen off, until another one is gripped
        # of warm motors and gears: K_m, R and viscous friction relative to the parameters
        ('torque_share', 'f8', (3,)),
        ('resistance_share', 'f8', (3,)),
        ('friction_share', 'f8', (3,)),
    ],
    align=True,
)

CONSTANTS = np.dtype(
    [
        ('gear_ratio', 'f8'),
        ('step', 'f8'),
        ('linear_inertia', 'f8'),  # A_bar of the coupling torque
        ('brake_torque', 'f8'),  # arm side
        ('brake_release_steps', 'i8'),
        ('brake_apply_steps', 'i8'),
        ('stop_min', 'f8'),
        ('stop_max', 'f8'),
        ('stop_stiffness', 'f8'),
        ('stop_damping', 'f8'),
        ('angle_error', 'f8', (3,)),  # arm angle less that of a rigid shaft, as referenced
        ('decoupled', 'i8'),  # d is an input, taken from the previous step
        ('gives', 'i8'),  # frame or rods give
        ('supplied', 'i8'),  # the DC link has a model
    ],
    align=True,
)


PLANT = np.dtype(
    [
        ('state', STATE),
        ('constants', CONSTANTS),
        ('geometry', GEOMETRY),  # as built
        ('inertia', INERTIA),
        ('motor', MOTOR),
        ('plate', PLATE),
        # motor side: positions [rad], speeds [rad/s], coupling torques d [N m]
        ('shafts', 'f8', (9,)),
    ],
    align=True,
)


def plant_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``CONSTANTS``."""
    p, motor_, drive = parameters.dynamics, parameters.motor, parameters.drive
    record = np.zeros(1, CONSTANTS)
    record['gear_ratio'] = p.gear_ratio
    record['step'] = drive.current_period_s
    record['linear_inertia'] = drive.observer_arm_inertia_kg_m2
    record['brake_torque'] = motor_.brake_torque_n_m * p.gear_ratio
    record['brake_release_steps'] = max(1, round(motor_.brake_release_s / drive.current_period_s))
    record['brake_apply_steps'] = max(1, round(motor_.brake_apply_s / drive.current_period_s))
    record['stop_min'] = math.radians(p.end_stop_min_deg)
    record['stop_max'] = math.radians(p.end_stop_max_deg)
    record['stop_stiffness'] = p.end_stop_stiffness_n_m_rad
    record['stop_damping'] = p.end_stop_damping_n_m_s_rad
    record['gives'] = parameters.rich.effects.frame or parameters.rich.effects.elastic_rods
    record['angle_error'] = parameters.rich.deviations.angle_rad
    record['supplied'] = parameters.supply.enabled
    record['decoupled'] = p.arm_coupling == DECOUPLED
    return record
