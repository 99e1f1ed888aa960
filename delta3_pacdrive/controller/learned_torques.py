"""Learned torques in the transformation task: from which cycle on they are commanded, and why they are not."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.motion.learned import Learned, Origin
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

FADE_CYCLES = 40  # in which learned torques go that are no longer followed
FAULT = 'a fault has dropped them'
_OVERRIDDEN = 'they belong to an override of 100 %'
_NOTHING_YET = 'no program has been started'
_NONE: Floats = np.zeros((0, 3))


class LearnedTorques:
    """The learned torques of a robot are commanded with the plan that they were learned for, and with no other one.

    Parameters
    ----------
    parameters
        Of the robot.
    learned
        The torques; None for a robot without.
    no_plan
        A plan that stands for none.
    state
        Of the task (``TASK['state']``): it tells the compiled code from which cycle on they are commanded.

    Attributes
    ----------
    torques
        That are commanded, or fade [N m], shape (n, 3).
    reason
        Why none are followed; empty while they are, or if there are none.

    """

    def __init__(
        self, parameters: Parameters, learned: Learned | None, no_plan: Plan, state: NDArray[Any]
    ) -> None:
        self._learned, self._state = learned, state
        self._other_robot = self._misfit = (
            ''  # why they are not for this robot, and for the program that is loaded
        )
        if learned is not None:
            self._other_robot = learned.parameter_refusal(parameters)
            Origin.of('', no_plan, parameters)  # loads what compares plans: no program waits for it
        self.torques: Floats = _NONE
        self.reason = _NOTHING_YET if learned is not None else ''

    @property
    def exist(self) -> bool:
        """Whether there are learned torques, for this program or for another one, or a fault has dropped them."""
        return self._learned is not None or bool(self.reason)

    def load(self, plan: Plan) -> None:
        """Look whether they are for a program that is to be started."""
        if self._learned is not None:
            self._misfit = self._other_robot or self._learned.plan_refusal(plan)

    def start(self, cycle: int, override: float) -> None:
        """Command them from a cycle on, if they are for the program that starts there with an override."""
        if self._learned is None:
            return
        as_planned = override == 1.0
        self.reason = self._misfit if self._misfit or as_planned else _OVERRIDDEN
        self.torques = _NONE if self.reason else self._learned.torques
        self._state['corrected_from'] = cycle

    def drop(self, cycle: int, reason: str, for_good: bool = False) -> None:
        """Let them fade from a cycle on: what is driven is no longer what they are for."""
        row = cycle - int(self._state['corrected_from'][0])
        followed = row < len(self.torques) and not self.reason
        if self._learned is not None and (followed or for_good):
            self.reason = reason
        if for_good:
            self._learned = None
        if not followed:
            return
        left = self.torques[row : row + FADE_CYCLES] if row >= 0 else _NONE
        shares = 1.0 - np.arange(1, len(left) + 1) / FADE_CYCLES
        self.torques = left * shares[:, None]
        self._state['corrected_from'] = cycle
