"""Three motors, gears and the coupled arms, integrated through the current samples of an exchange period.

One step per current sample, through which the currents go evenly from the last sample to this one. Brakes, payload and
what the drives are told are the same for every robot; its force model, rigid or as built, is what a step asks.
"""

from collections.abc import Sequence

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.dynamics import inertia
from delta3_pacdrive.kinematics import geometry, plate_position
from delta3_pacdrive.motor import motor
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import difference, triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.arrays import (
    STATE,
    BuiltArrays,
    BuiltRecords,
    PlantArrays,
    PlantRecords,
    plant_constants,
)
from delta3_pacdrive.plant.brake import advance_brakes, command_brakes
from delta3_pacdrive.plant.built_robot import (
    BUILT_STATE,
    built_constants,
    built_coupling,
    settle,
    step_built,
)
from delta3_pacdrive.plant.contact import hang_payload
from delta3_pacdrive.plant.rigid import rigid_coupling, step_rigid


@kernel
def advance(currents, brakes, payload_kg, plant, built):
    """Integrate the plant through the currents of an exchange period, and fill ``plant.shafts``.

    Parameters
    ----------
    currents
        Currents [A rms] of the motors at the end of each step, shape (steps, 3).
    brakes
        Brake outputs of the drives, 1 = release, valid from the start on, shape (3,).
    payload_kg
        What the controller has gripped [kg], from the start on.
    plant
        The ``PlantArrays``.
    built
        The ``BuiltArrays``, or None for a rigid robot; an argument of its own, because only by arguments the compiler
        leaves out what a robot does not have.

    """
    p = PlantRecords(plant.state[0], plant.constants[0], plant.geometry[0], plant.inertia[0], plant.motor[0])
    shafts = plant.shafts
    s, c = p.state, p.constants
    command_brakes(brakes, s)
    hang_payload(payload_kg, s, p.inertia)
    for k in range(currents.shape[0]):
        before, now = triple(s.current), (currents[k, 0], currents[k, 1], currents[k, 2])
        if built is None:
            advance_brakes(triple(s.thetadot), s, c)
            step_rigid(before, now, p)
        else:
            advance_brakes(triple(built.state[0].rate), s, c)
            step_built(before, now, p, BuiltRecords(built.state[0], built.constants[0]))
        for i in range(3):
            s.current[i] = now[i]
    if built is None:
        shaft, rate, coupling = difference(s.theta, c.angle_error), triple(s.thetadot), rigid_coupling(p)
    else:
        b = BuiltRecords(built.state[0], built.constants[0])
        shaft, rate, coupling = triple(b.state.shaft), triple(b.state.rate), built_coupling(p, b)
    for i in range(3):
        s.coupling[i] = coupling[i]
        shafts[i], shafts[3 + i], shafts[6 + i] = shaft[i] * c.gear_ratio, rate[i] * c.gear_ratio, coupling[i]


@kernel
def settle_at_rest(plant, built):
    """Let shafts and arms of a built robot stand still, from where its arms are; see ``built_robot.settle``."""
    p = PlantRecords(plant.state[0], plant.constants[0], plant.geometry[0], plant.inertia[0], plant.motor[0])
    settle(p, BuiltRecords(built.state[0], built.constants[0]))


@kernel
def true_tcp(plant):
    """TCP [m] of the arms as they are built and stand."""
    return plate_position(triple(plant.state[0].theta), plant.geometry[0])


class Plant:
    """A plant holds motors, brakes, gears and arms, at rest at the home position and with brakes applied at first.

    The controller believes that a shaft at k_r theta holds its arm at theta: a plant with geometric errors or elastic
    gears stands a little beside the home position.

    Parameters
    ----------
    parameters
        Of the robot; ``parameters.rich`` says what of a built robot it has.

    Attributes
    ----------
    arrays, built
        What the compiled loops work on; ``built`` is None for a rigid robot with the thesis' friction.
    state
        Record ``STATE`` of ``arrays``.

    """

    def __init__(self, parameters: Parameters) -> None:
        effects = parameters.rich.effects
        lengths = geometry(parameters.kinematics, effects if effects.geometry else None)
        self.arrays = PlantArrays(
            np.zeros(1, STATE),
            plant_constants(parameters),
            lengths,
            inertia(parameters, lengths, rods=effects.forearm_rods, rotors=not effects.gear),
            motor(parameters),
            np.zeros(9),
        )
        self.state = state = self.arrays.state
        state['theta'] = kinematics.inverse(parameters.motion.home_m, parameters.kinematics)
        state['theta'] += self.arrays.constants['angle_error']
        self.built: BuiltArrays | None = None
        if effects.gear or effects.friction or effects.ripple:
            self.built = BuiltArrays(np.zeros(1, BUILT_STATE), built_constants(parameters))
            settle_at_rest(self.arrays, self.built)
        state['brake_locked'] = 1
        state['brake_share'] = 1.0
        state['gripped'] = state['carried'] = payload_kg = parameters.dynamics.payload_mass_kg
        self._brakes = np.zeros(3, dtype=np.int64)
        advance(np.empty((0, 3)), self._brakes, payload_kg, self.arrays, self.built)

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
        advance(currents, self._brakes, payload_kg, self.arrays, self.built)

    def shafts(self) -> list[float]:
        """Motor side: three shaft positions [rad], three speeds [rad/s], three coupling torques d [N m]."""
        return list(self.arrays.shafts.tolist())

    def arm_angles(self) -> Floats:
        """True arm angles [rad], behind elastic gears and beside what the encoders were referenced to; shape (3,)."""
        return np.array(self.state['theta'][0])

    def tcp(self) -> Floats:
        """True TCP [m]: of the arms as they are built and stand; shape (3,)."""
        return np.array(true_tcp(self.arrays))
