"""Three independent motors, each with its own load (8.2): the plant of a single motor."""

from collections.abc import Sequence

import numpy as np

from delta3_pacdrive.dynamics import rotor_inertia
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import EXACT, Parameters
from delta3_pacdrive.robot.plant.decoupled import advance_single
from delta3_pacdrive.robot.plant.plant import Plant


def alone(parameters: Parameters) -> Parameters:
    """Return the parameters of motors with loads: plant and observer have the inertia of rotor and I_Load.

    Raises
    ------
    ParameterError
        The robot has effects that the single motor of the thesis does not have.

    """
    for name in ('gear', 'friction', 'ripple'):
        if getattr(parameters.rich.effects, name):
            raise ParameterError(
                f'the single motor is that of the thesis (8.2), but the robot has rich.{name}: switch it off'
            )
    inertia = rotor_inertia(parameters) + parameters.motor.load_inertia_kg_m2
    return parameters.replace(drive__observer_arm_inertia_kg_m2=inertia, dynamics__arm_coupling=EXACT)


class SingleMotors(Plant):
    """Single motors with brakes, gears and loads, initially at rest at the arm angles of the home position.

    Parameters
    ----------
    parameters
        From ``alone``.
    coupling
        Torque d [N m, motor side] of each motor per exchange period, shape (n, 3), scaled by CE; the last row persists.

    """

    def __init__(self, parameters: Parameters, coupling: Floats) -> None:
        super().__init__(parameters)
        motor = parameters.motor
        load = motor.load_torque_n_m / parameters.dynamics.gear_ratio
        self._felt = motor.coupling_effect * coupling + load
        self._exchange = 0
        constants = self.record['constants']
        self.state['theta'] -= constants['angle_error']
        constants['angle_error'] = 0.0
        constants['stop_min'], constants['stop_max'] = -np.inf, np.inf  # no end stops
        self._integrate(np.empty((0, 3)))

    def advance(
        self, currents: Floats, brakes_released: Sequence[bool], payload_kg: float | None = None
    ) -> None:
        """Integrate one exchange period, as ``Plant.advance``; the payload has no effect."""
        self._brakes[:] = brakes_released
        self._integrate(currents)

    def _integrate(self, currents: Floats) -> None:
        advance_single(currents, self._brakes, self._now_felt(), self.record)
        self._exchange += len(currents) > 0
        # the torque reported to a drive acts on its motor from now on
        self._shafts[6:] = self._now_felt()

    def _now_felt(self) -> Floats:
        return np.asarray(self._felt[min(self._exchange, len(self._felt) - 1)])
