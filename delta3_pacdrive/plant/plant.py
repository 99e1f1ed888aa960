"""Three motors, gears and the coupled arms, integrated through the current samples of an exchange period.

One explicit midpoint step per current sample: positions and speeds are predicted to the middle of the step, the exact
dynamics (4.26) are solved there once, and the state advances with that acceleration; second order in the step. The
torque of a step is that of the mean of the currents at its ends.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.dynamics import inertia, motion_terms, multiply
from delta3_pacdrive.kinematics import geometry, plate_position
from delta3_pacdrive.motor import friction_torque, motor
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.brake import acceleration_under_brakes, advance_brake, caught_speed
from delta3_pacdrive.plant.built_robot import RICH_STATE, advance_rich, rich_constants, settle
from delta3_pacdrive.plant.contact import end_stop_torque, take_payload

STATE = np.dtype(
    [
        ('theta', 'f8', (3,)),  # [rad], arm
        ('thetadot', 'f8', (3,)),  # [rad/s], arm
        ('thetaddot', 'f8', (3,)),  # [rad/s^2], arm, of the last step
        ('current', 'f8', (3,)),  # [A rms], at the end of the last step
        ('coupling', 'f8', (3,)),  # d [N m], motor (4.31)
        ('brake_command', 'i8', (3,)),  # 1 = release
        ('brake_released', 'i8', (3,)),
        ('brake_delay', 'i8', (3,)),  # steps since the command changed
        ('brake_locked', 'i8', (3,)),  # the shaft sticks
        ('gripped', 'f8'),  # [kg], as the plant was told last
        ('carried', 'f8'),  # [kg], what hangs at the plate in truth
        # injected
        ('brake_share', 'f8', (3,)),  # of its torque that a brake still has: 1 as new, 0 worn out
        ('brake_stuck', 'i8', (3,)),  # an applied brake does not open any more
        ('load_torque', 'f8', (3,)),  # [N m], motor; positive is against a shaft that turns forwards
        ('payload_lost', 'i8'),  # what was gripped has fallen off, until another payload is gripped
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
        ('angle_error', 'f8', (3,)),  # arm angle beyond that of a rigid shaft, as referenced
    ],
    align=True,
)


def _constants(parameters: Parameters) -> NDArray[Any]:
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
    if parameters.rich.effects.geometry:
        record['angle_error'] = np.radians(parameters.rich.arm_angle_error_deg)
    return record


@kernel
def drive_torque(current, theta, thetadot, c, m):
    """Torque [N m, arm side] of one motor through its gear, less friction, plus that of an end stop."""
    speed = c.gear_ratio * thetadot
    torque = c.gear_ratio * (m.torque_constant * current - friction_torque(speed, m))
    return torque - end_stop_torque(theta, thetadot, c)


@kernel
def accelerate(theta, thetadot, current, s, c, g, n, m):
    """Arm accelerations [rad/s^2] of a state, with the mass matrix and the torques of motion, weight and loads."""
    mass, (b1, b2, b3) = motion_terms(theta, thetadot, g, n)
    bias = (
        b1 + c.gear_ratio * s.load_torque[0],
        b2 + c.gear_ratio * s.load_torque[1],
        b3 + c.gear_ratio * s.load_torque[2],
    )
    force = (
        drive_torque(current[0], theta[0], thetadot[0], c, m) - bias[0],
        drive_torque(current[1], theta[1], thetadot[1], c, m) - bias[1],
        drive_torque(current[2], theta[2], thetadot[2], c, m) - bias[2],
    )
    return acceleration_under_brakes(mass, force, thetadot, s, c), mass, bias


@kernel
def coupling_torques(acceleration, mass, bias, c):
    """What the motors feel beyond the linear part (d, 4.31), motor side."""
    product = multiply(mass, acceleration)
    return (
        (product[0] + bias[0] - c.linear_inertia * acceleration[0]) / c.gear_ratio,
        (product[1] + bias[1] - c.linear_inertia * acceleration[1]) / c.gear_ratio,
        (product[2] + bias[2] - c.linear_inertia * acceleration[2]) / c.gear_ratio,
    )


@kernel
def advance_plant(
    currents, brakes, payload_kg, shafts, state, constants, geometry_record, inertia_record, motor_record
):
    """Integrate through ``currents`` (steps, 3), the values at the end of each step; fill the nine ``shafts``.

    ``brakes`` (3,) and ``payload_kg``, what the controller has gripped, are valid from the start on.
    """
    s, c = state[0], constants[0]
    for i in range(3):
        s.brake_command[i] = brakes[i]
    g, n, m = geometry_record[0], inertia_record[0], motor_record[0]
    take_payload(payload_kg, s, n)
    h = c.step
    theta, thetadot, last = triple(s.theta), triple(s.thetadot), triple(s.thetaddot)
    before = triple(s.current)
    for k in range(currents.shape[0]):
        for i in range(3):
            advance_brake(i, thetadot[i], s, c)
        now = (currents[k, 0], currents[k, 1], currents[k, 2])
        mean = (0.5 * (before[0] + now[0]), 0.5 * (before[1] + now[1]), 0.5 * (before[2] + now[2]))
        before = now
        middle = (
            theta[0] + 0.5 * h * (thetadot[0] + 0.25 * h * last[0]),
            theta[1] + 0.5 * h * (thetadot[1] + 0.25 * h * last[1]),
            theta[2] + 0.5 * h * (thetadot[2] + 0.25 * h * last[2]),
        )
        speed = (
            thetadot[0] + 0.5 * h * last[0],
            thetadot[1] + 0.5 * h * last[1],
            thetadot[2] + 0.5 * h * last[2],
        )
        last, _, _ = accelerate(middle, speed, mean, s, c, g, n, m)
        after = (
            caught_speed(0, thetadot[0], thetadot[0] + h * last[0], s),
            caught_speed(1, thetadot[1], thetadot[1] + h * last[1], s),
            caught_speed(2, thetadot[2], thetadot[2] + h * last[2], s),
        )
        theta = (
            theta[0] + 0.5 * h * (thetadot[0] + after[0]),
            theta[1] + 0.5 * h * (thetadot[1] + after[1]),
            theta[2] + 0.5 * h * (thetadot[2] + after[2]),
        )
        thetadot = after
    acceleration, mass, bias = accelerate(theta, thetadot, before, s, c, g, n, m)
    coupling = coupling_torques(acceleration, mass, bias, c)
    for i in range(3):
        s.theta[i], s.thetadot[i], s.thetaddot[i] = theta[i], thetadot[i], last[i]
        s.current[i], s.coupling[i] = before[i], coupling[i]
        shafts[i], shafts[3 + i], shafts[6 + i] = (
            (theta[i] - c.angle_error[i]) * c.gear_ratio,
            thetadot[i] * c.gear_ratio,
            coupling[i],
        )


@kernel
def advance(
    currents,
    brakes,
    payload_kg,
    shafts,
    state,
    constants,
    geometry_record,
    inertia_record,
    motor_record,
    rich,
):
    """Integrate as ``advance_plant`` does; ``rich`` holds what ``advance_rich`` needs besides, or is None."""
    if rich is None:
        advance_plant(
            currents,
            brakes,
            payload_kg,
            shafts,
            state,
            constants,
            geometry_record,
            inertia_record,
            motor_record,
        )
    else:
        advance_rich(
            currents,
            brakes,
            payload_kg,
            shafts,
            state,
            constants,
            geometry_record,
            inertia_record,
            motor_record,
            rich[0],
            rich[1],
        )


@kernel
def true_tcp(state, geometry_record):
    """TCP [m] of the arms as they are built and stand."""
    return plate_position(triple(state[0].theta), geometry_record[0])


class Plant:
    """Motors, brakes, gears and arms; starts at rest at the home position with the brakes applied.

    The controller believes that a shaft at k_r theta holds its arm at theta: a plant with geometric errors or elastic
    gears stands a little beside the home position.
    """

    def __init__(self, parameters: Parameters) -> None:
        effects = parameters.rich.effects
        self._constants = _constants(parameters)
        self._geometry = geometry(parameters.kinematics, effects if effects.geometry else None)
        self._inertia = inertia(
            parameters, self._geometry, rods=effects.forearm_rods, rotors=not effects.gear
        )
        self._motor = motor(parameters)
        self.state = np.zeros(1, STATE)
        self.state['theta'] = kinematics.inverse(parameters.motion.home_m, parameters.kinematics)
        self.state['theta'] += self._constants['angle_error']
        self._rich: tuple[NDArray[Any], NDArray[Any]] | None = None
        if effects.gear or effects.friction or effects.ripple:
            self._rich = np.zeros(1, RICH_STATE), rich_constants(parameters)
            settle(self.state, self._constants, self._geometry, self._inertia, *self._rich)
        self.state['brake_locked'] = 1
        self.state['brake_share'] = 1.0
        self.state['gripped'] = self.state['carried'] = parameters.dynamics.payload_mass_kg
        self._brakes = np.zeros(3, dtype=np.int64)
        self._shafts: Floats = np.zeros(9)
        self._advance_through(np.empty((0, 3)), parameters.dynamics.payload_mass_kg)

    def _advance_through(self, currents: Floats, payload_kg: float) -> None:
        advance(
            currents,
            self._brakes,
            payload_kg,
            self._shafts,
            self.state,
            self._constants,
            self._geometry,
            self._inertia,
            self._motor,
            self._rich,
        )

    def arrays(self) -> tuple[Any, ...]:
        """Arrays for a loop that is compiled as a whole: motor, state, constants, geometry, inertia, rich, shafts."""
        return (
            self._motor,
            self.state,
            self._constants,
            self._geometry,
            self._inertia,
            self._rich,
            self._shafts,
        )

    def advance(
        self, currents: Floats, brakes_released: Sequence[bool], payload_kg: float | None = None
    ) -> None:
        """Integrate one exchange period.

        Parameters
        ----------
        currents
            Shape (steps, 3): I_eff [A rms] of each motor at the end of each current-loop period.
        brakes_released
            Brake outputs of the three drives, valid from the start of the period.
        payload_kg
            What the controller has gripped, from the start of the period on; None: as before.

        """
        if payload_kg is None:
            payload_kg = float(self.state['gripped'][0])
        self._brakes[:] = brakes_released
        self._advance_through(currents, payload_kg)

    def shafts(self) -> list[float]:
        """Motor side: three shaft positions [rad], three speeds [rad/s], three coupling torques d [N m]."""
        return list(self._shafts.tolist())

    def arm_angles(self) -> Floats:
        """True arm angles [rad], behind elastic gears and beside what the encoders were referenced to; shape (3,)."""
        return np.array(self.state['theta'][0])

    def tcp(self) -> Floats:
        """True TCP [m]: of the arms as they are built and stand; shape (3,)."""
        return np.array(true_tcp(self.state, self._geometry))
