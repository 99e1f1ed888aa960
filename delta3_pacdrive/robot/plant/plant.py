"""Three motors, gears and the coupled arms, integrated through the current samples of an exchange period.

There is one step per current sample, during which the currents change linearly. Brakes, payload and outputs to the
drives are common to all robots; the force model is that of a rigid or a built robot.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.dynamics import inertia
from delta3_pacdrive.kinematics import geometry, plate_position
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import difference, plus, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.motor import motor, warm_drawn_energy
from delta3_pacdrive.robot.plant.arrays import PLANT, plant_constants
from delta3_pacdrive.robot.plant.brake import advance_brakes, command_brakes
from delta3_pacdrive.robot.plant.built_robot import (
    BUILT,
    built_constants,
    built_coupling,
    displace,
    settle,
    step_built,
)
from delta3_pacdrive.robot.plant.contact import hang_payload
from delta3_pacdrive.robot.plant.decoupled import require_stable, step_decoupled
from delta3_pacdrive.robot.plant.plate_pose import plate_constants, tool_place
from delta3_pacdrive.robot.plant.rigid import effective_currents, rigid_coupling, step_rigid


@kernel
def advance(currents, brakes, payload_kg, plant, built):
    """Integrate the plant through the currents of an exchange period, and fill its ``shafts``.

    Parameters
    ----------
    currents
        Currents [A rms] of the motors at the end of each step, shape (steps, 3).
    brakes
        Brake outputs of the drives, 1 = release, valid from the start on, shape (3,).
    payload_kg
        Payload gripped by the controller [kg], from the start on.
    plant
        Array of one record ``PLANT``.
    built
        Array of one record ``BUILT``, or None for a rigid robot; a separate argument, because the compiler removes
        unused effects by argument type only.

    """
    p = plant[0]
    s, c, shafts = p.state, p.constants, p.shafts
    command_brakes(brakes, s)
    s.drawn = 0.0
    hang_payload(payload_kg, s, p.inertia)
    for k in range(currents.shape[0]):
        before, now = triple(s.current), effective_currents(currents, k, s)
        if c.supplied != 0:
            slower = triple(s.thetadot) if built is None else triple(built[0].state.rate)
        if built is None:
            advance_brakes(triple(s.thetadot), s, c)
            if c.decoupled != 0:
                step_decoupled(before, now, p)
            else:
                step_rigid(before, now, p)
        else:
            advance_brakes(triple(built[0].state.rate), s, c)
            step_built(before, now, p, built[0])
        if c.supplied != 0:
            faster = triple(s.thetadot) if built is None else triple(built[0].state.rate)
            for i in range(3):
                speed = 0.5 * c.gear_ratio * (slower[i] + faster[i])
                of_motor = speed, c.step, s.torque_share[i], s.resistance_share[i], p.motor
                s.drawn += warm_drawn_energy(before[i], now[i], *of_motor)
        for i in range(3):
            s.current[i] = now[i]
    if built is None:
        shaft, rate = difference(s.theta, c.angle_error), triple(s.thetadot)
        # decoupled arms: d of the last step; before the first step, d of arms at rest
        known = c.decoupled != 0 and currents.shape[0] > 0
        coupling = triple(s.coupling) if known else rigid_coupling(p)
    else:
        q = built[0].state
        shaft, rate, coupling = triple(q.shaft), triple(q.rate), built_coupling(p, built[0])
    for i in range(3):
        s.coupling[i] = coupling[i]
        shafts[i], shafts[3 + i], shafts[6 + i] = shaft[i] * c.gear_ratio, rate[i] * c.gear_ratio, coupling[i]


@kernel
def true_tcp(plant):
    """True TCP [m] of the built arms, in space."""
    p = plant[0]
    if p.plate.tilts != 0:
        place = tool_place(triple(p.state.theta), p.geometry, p.plate)
    else:
        place = plate_position(triple(p.state.theta), p.geometry)
    if p.constants.gives != 0:
        return plus(place, 1.0, triple(p.state.offset))
    return place


class Plant:
    """Motors, brakes, gears and arms, initially at rest at the home position with brakes applied.

    The home position refers to the arms as known to the controller: a plant with geometric errors or elastic gears
    starts slightly off the home position.

    Parameters
    ----------
    parameters
        Parameters of the robot; ``parameters.rich`` selects the effects of a built robot.
    record
        Array of one record ``PLANT`` to use, shape (1,); created if None.

    Attributes
    ----------
    record, built
        Records of the compiled loops; ``built`` is None for a rigid robot with the thesis' friction.
    state
        State of ``record``, shape (1,).

    Raises
    ------
    ParameterError
        The arms are decoupled, and their loop would be unstable with this payload.

    """

    def __init__(self, parameters: Parameters, record: NDArray[Any] | None = None) -> None:
        require_stable(parameters, parameters.dynamics.payload_mass_kg)
        effects = parameters.rich.effects
        lengths = geometry(parameters.kinematics, parameters.rich.deviations)
        self.record = record = np.zeros(1, PLANT) if record is None else record
        self.state = state = record['state']
        self._shafts: Floats = record['shafts'][0]
        record['constants'] = plant_constants(parameters)
        record['geometry'] = lengths
        record['inertia'] = inertia(parameters, lengths, rods=effects.forearm_rods, rotors=not effects.gear)
        record['motor'] = motor(parameters)
        record['plate'] = plate_constants(parameters)
        state['torque_share'] = state['resistance_share'] = state['friction_share'] = 1.0
        state['theta'] = kinematics.inverse(parameters.motion.home_m, parameters.kinematics)
        state['theta'] += record['constants']['angle_error'] - parameters.kinematics.corrections.angle_rad
        self.built: NDArray[Any] | None = None
        if effects.gear or effects.friction or effects.ripple or effects.frame or effects.elastic_rods:
            self.built = np.zeros(1, BUILT)
            self.built['constants'] = built_constants(parameters)
            settle(record[0], self.built[0])
            displace(record[0], self.built[0])
        state['brake_locked'] = 1
        state['brake_share'] = 1.0
        state['gripped'] = state['carried'] = payload_kg = parameters.dynamics.payload_mass_kg
        self._brakes = np.zeros(3, dtype=np.int64)
        advance(np.empty((0, 3)), self._brakes, payload_kg, self.record, self.built)

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
            Payload gripped by the controller, from the start of the period on; None: unchanged.

        """
        if payload_kg is None:
            payload_kg = float(self.state['gripped'][0])
        self._brakes[:] = brakes_released
        advance(currents, self._brakes, payload_kg, self.record, self.built)

    def shafts(self) -> list[float]:
        """Return three shaft positions [rad], three speeds [rad/s], three coupling torques d [N m]; motor side."""
        return list(self._shafts.tolist())

    @property
    def drawn_j(self) -> float:
        """Energy [J] that the motors drew from the DC link in the last exchange period."""
        return float(self.state['drawn'][0])

    def arm_angles(self) -> Floats:
        """True arm angles [rad], including gear twist and referencing errors; shape (3,)."""
        return np.array(self.state['theta'][0])

    def tcp(self) -> Floats:
        """True TCP [m] of the built arms; shape (3,)."""
        return np.array(true_tcp(self.record))
