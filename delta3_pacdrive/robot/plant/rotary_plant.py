"""A rotary axis of the tool: motor and brake on the base plate, gear, telescopic bar, tool and payload.

The bar transmits the angle without error. Axis and arms do not affect each other, nor do two rotary axes. With a rigid
bar, as in the nominal robot,

    (I_m + J / k^2) w' = K_m I - F_s tanh(w / w_s) - F_v w - load

with J of bar, tool and payload. With an elastic bar, as in the built robot, rotor and tool are two masses connected by
a spring with backlash. A step is an explicit midpoint step, as for the arms.

Arguments of the kernels, in addition to those of ``arrays``:

``rotary``, ``number``
    Array of records ``ROTARY_PLANT``, and an index.
``p``
    That record; its motor is ``m``.
``torque``
    Torque on the motor shaft [N m]: motor less friction, load and bar.
``inertia``
    Inertia rigidly coupled to the shaft [kg m^2, motor side].
``angle``, ``turning``
    Tool angle [rad] and speed [rad/s].
``brake``
    Brake output of the drive, 1 = release.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, AXES_MAX, Parameters, rotary_axis_parameters
from delta3_pacdrive.robot.motor import MOTOR, motor, warm_drawn_energy, warm_friction_torque
from delta3_pacdrive.robot.plant.brake import advance_brake, caught_speed
from delta3_pacdrive.robot.plant.built_robot import STEP_ANGLE, STEP_DECAY, gear_torque

STATE = np.dtype(
    [
        ('shaft', 'f8'),  # [rad], motor
        ('rate', 'f8'),  # [rad/s], motor
        ('acceleration', 'f8'),  # [rad/s^2], motor, of the last step
        ('angle', 'f8'),  # [rad], tool
        ('turning', 'f8'),  # [rad/s], tool
        ('turning_acceleration', 'f8'),  # [rad/s^2], tool, of the last step
        ('current', 'f8'),  # [A rms], at the end of the last step, for the whole K_m
        ('coupling', 'f8'),  # d [N m]: motor torque beyond the inertia known to the drive
        ('drawn', 'f8'),  # [J], from the DC link in the last exchange period
        ('inertia', 'f8'),  # J [kg m^2] of bar, tool and payload about z
        # brake, as in ``arrays.STATE``
        ('brake_command', 'i8', (1,)),
        ('brake_released', 'i8', (1,)),
        ('brake_delay', 'i8', (1,)),
        ('brake_locked', 'i8', (1,)),
        # injected
        ('brake_share', 'f8', (1,)),
        ('brake_stuck', 'i8', (1,)),
        ('load_torque', 'f8', (1,)),  # [N m], motor; positive opposes forward rotation
        ('torque_share', 'f8', (1,)),  # K_m, R and viscous friction relative to the parameters
        ('resistance_share', 'f8', (1,)),
        ('friction_share', 'f8', (1,)),
    ],
    align=True,
)

CONSTANTS = np.dtype(
    [
        ('gear_ratio', 'f8'),
        ('step', 'f8'),
        ('substeps', 'i8'),  # per step
        ('rotor', 'f8'),  # I_m [kg m^2], motor side
        ('linear_inertia', 'f8'),  # known to the drive [kg m^2], motor side
        ('tool_inertia', 'f8'),  # of bar and tool [kg m^2]
        ('part_inertia', 'f8'),  # of a payload, per mass [m^2]
        ('brake_torque', 'f8'),  # motor side
        ('brake_release_steps', 'i8'),
        ('brake_apply_steps', 'i8'),
        ('elastic', 'i8'),  # elastic bar
        ('stiffness', 'f8'),  # of the bar [N m/rad]
        ('damping', 'f8'),  # [N m s/rad]
        ('backlash', 'f8'),  # [rad, tool]
    ],
    align=True,
)

ROTARY_PLANT = np.dtype(
    [
        ('state', STATE),
        ('constants', CONSTANTS),
        ('motor', MOTOR),
        # motor side: position [rad], speed [rad/s], coupling torque d [N m]
        ('shaft', 'f8', (3,)),
    ],
    align=True,
)


def rotary_constants(parameters: Parameters, number: int) -> NDArray[Any]:
    """Return one record of ``CONSTANTS`` of rotary axis ``number``, from 0."""
    rotary, axis = parameters.rotary_axes[number], rotary_axis_parameters(parameters, number)
    step, drive = axis.drive.current_period_s, axis.drive
    record = np.zeros(1, CONSTANTS)
    record['gear_ratio'] = gear = rotary.gear_ratio
    record['step'], record['substeps'] = step, 1
    record['rotor'] = rotary.rotor_inertia_kg_m2
    record['linear_inertia'] = drive.observer_arm_inertia_kg_m2 / gear**2
    record['tool_inertia'] = rotary.tool_inertia_kg_m2
    record['part_inertia'] = rotary.part_gyration_radius_m**2
    record['brake_torque'] = rotary.brake_torque_n_m
    record['brake_release_steps'] = max(1, round(axis.motor.brake_release_s / step))
    record['brake_apply_steps'] = max(1, round(axis.motor.brake_apply_s / step))
    if parameters.rich.effects.gear:
        record['elastic'] = 1
        record['stiffness'] = rotary.bar_stiffness_n_m_rad
        record['damping'] = rotary.bar_damping_n_m_s_rad
        record['backlash'] = rotary.backlash_rad
        give = 1.0 / (rotary.rotor_inertia_kg_m2 * gear**2) + 1.0 / rotary.tool_inertia_kg_m2
        swing, decay = math.sqrt(rotary.bar_stiffness_n_m_rad * give), rotary.bar_damping_n_m_s_rad * give
        record['substeps'] = max(
            1, math.ceil(step * swing / STEP_ANGLE), math.ceil(step * decay / STEP_DECAY)
        )
    return record


@kernel
def _under_brake(torque, inertia, speed, s, c):
    """Acceleration [rad/s^2] of the shaft, which its brake may hold; an overloaded brake slips."""
    if s.brake_released[0] != 0:
        return torque / inertia
    most = s.brake_share[0] * c.brake_torque
    if s.brake_locked[0] != 0:
        if abs(torque) <= most:
            return 0.0
        s.brake_locked[0] = 0
        return (torque - math.copysign(most, torque)) / inertia
    if speed == 0.0:
        return torque / inertia
    return (torque - math.copysign(most, speed)) / inertia


@kernel
def _bar_torque(shaft, rate, angle, turning, c):
    """Torque [N m] transmitted by the bar to the tool."""
    return gear_torque(shaft / c.gear_ratio - angle, rate / c.gear_ratio - turning, c)


@kernel
def _step(before, now, p):
    """Advance shaft and tool by one step, during which the current changes linearly from ``before`` to ``now``."""
    s, c, m = p.state, p.constants, p.motor
    h = c.step / c.substeps
    for part in range(c.substeps):
        current = before + (part + 0.5) / c.substeps * (now - before)
        speed = s.rate + 0.5 * h * s.acceleration
        torque = (
            m.torque_constant * current
            - warm_friction_torque(speed, s.friction_share[0], m)
            - s.load_torque[0]
        )
        inertia = c.rotor
        if c.elastic != 0:
            turning = s.turning + 0.5 * h * s.turning_acceleration
            passed = _bar_torque(s.shaft + 0.5 * h * s.rate, speed, s.angle + 0.5 * h * s.turning, turning, c)
            torque -= passed / c.gear_ratio
            s.turning_acceleration = passed / s.inertia
        else:
            inertia += s.inertia / (c.gear_ratio * c.gear_ratio)
        s.acceleration = _under_brake(torque, inertia, speed, s, c)
        after = caught_speed(0, s.rate, s.rate + h * s.acceleration, s)
        s.shaft += 0.5 * h * (s.rate + after)
        s.rate = after
        if c.elastic != 0:
            faster = s.turning + h * s.turning_acceleration
            s.angle += 0.5 * h * (s.turning + faster)
            s.turning = faster
        else:
            s.angle, s.turning = s.shaft / c.gear_ratio, s.rate / c.gear_ratio


@kernel
def _coupling(p):
    """Torque d [N m, motor side] of the motor beyond the inertia known to its drive."""
    s, c, m = p.state, p.constants, p.motor
    torque = (
        m.torque_constant * s.current
        - warm_friction_torque(s.rate, s.friction_share[0], m)
        - s.load_torque[0]
    )
    inertia, passed = c.rotor, 0.0
    if c.elastic != 0:
        passed = _bar_torque(s.shaft, s.rate, s.angle, s.turning, c) / c.gear_ratio
    else:
        inertia += s.inertia / (c.gear_ratio * c.gear_ratio)
    acceleration = _under_brake(torque - passed, inertia, s.rate, s, c)
    return (inertia - c.linear_inertia) * acceleration + passed + s.load_torque[0]


@kernel
def advance_rotary(currents, i, brake, payload_kg, rotary, number):
    """Integrate the axis through the currents of an exchange period, and fill its ``shaft``.

    Parameters
    ----------
    currents, i
        Motor currents [A rms] of all axes at the end of each step, shape (steps, axes), and the column of this one.
    brake
        Brake output of the drive, 1 = release, valid from the start on.
    payload_kg
        Payload [kg], from the start on; it rotates with the tool.
    rotary, number
        As above.

    """
    p = rotary[number]
    s, c = p.state, p.constants
    s.brake_command[0] = brake
    s.drawn = 0.0
    s.inertia = c.tool_inertia + c.part_inertia * payload_kg
    for k in range(currents.shape[0]):
        advance_brake(0, s.rate, s, c)
        slower = s.rate
        now = s.torque_share[0] * currents[k, i]
        _step(s.current, now, p)
        of_motor = 0.5 * (slower + s.rate), c.step, s.torque_share[0], s.resistance_share[0], p.motor
        s.drawn += warm_drawn_energy(s.current, now, *of_motor)
        s.current = now
    s.coupling = _coupling(p)
    p.shaft[0], p.shaft[1], p.shaft[2] = s.shaft, s.rate, s.coupling


class RotaryPlant:
    """Rotary axis ``number``, from 0, initially at its home angle with its brake applied.

    Parameters
    ----------
    parameters, number
        Parameters of a robot with this rotary axis.
    record
        Array of one record ``ROTARY_PLANT`` to use, shape (1,); created if None.

    """

    def __init__(self, parameters: Parameters, number: int, record: NDArray[Any] | None = None) -> None:
        self._index = ARMS + number
        self.record = record = np.zeros(1, ROTARY_PLANT) if record is None else record
        self.state: NDArray[Any] = record['state']
        record['constants'] = rotary_constants(parameters, number)
        record['motor'] = motor(rotary_axis_parameters(parameters, number))
        state, rotary = self.state, parameters.rotary_axes[number]
        state['angle'] = rotary.home_rad
        state['shaft'] = rotary.home_rad * rotary.gear_ratio
        state['brake_locked'], state['brake_share'] = 1, 1.0
        state['torque_share'] = state['resistance_share'] = state['friction_share'] = 1.0
        self.advance(np.empty((0, AXES_MAX)), False, parameters.dynamics.payload_mass_kg)

    def advance(self, currents: Floats, brake_released: bool, payload_kg: float) -> None:
        """Integrate one exchange period with the ``currents`` [A rms] of all axes; see ``advance_rotary``."""
        advance_rotary(currents, self._index, int(brake_released), payload_kg, self.record, 0)

    def shaft(self) -> tuple[float, float, float]:
        """Motor shaft: position [rad], speed [rad/s], coupling torque d [N m]."""
        position, speed, coupling = self.record['shaft'][0].tolist()
        return position, speed, coupling

    @property
    def drawn_j(self) -> float:
        """Energy [J] that the motor drew from the DC link in the last exchange period."""
        return float(self.state['drawn'][0])

    @property
    def angle_rad(self) -> float:
        """True angle of the tool by this axis."""
        return float(self.state['angle'][0])
