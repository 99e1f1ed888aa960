"""Learned torques in the transformation task: activation by program and override, fading, and reason of inactivity."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.control.cycle.stages import Stage
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.plan import Plan

FADE_CYCLES = 40  # duration of the linear fade to zero
FAULT = 'a fault has dropped them'
_OVERRIDDEN = 'they belong to an override of 100 %'
_NOTHING_YET = 'no program has been started'
_NONE: Floats = np.zeros((0, 3))


class LearnedTorques(Stage):
    """Torques that are commanded only with the plan they were learned for.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    learned
        The torques, if any.
    no_plan
        Placeholder plan.
    state
        ``TASK['state']``; its ``corrected_from`` is the cycle of the first row of ``torques``.

    """

    def __init__(
        self, parameters: Parameters, learned: Learned | None, no_plan: Plan, state: NDArray[Any]
    ) -> None:
        self._learned, self._state = learned, state
        # why they do not fit this robot, and the loaded program
        self._other_robot = self._misfit = ''
        if learned is not None:
            self._other_robot = learned.parameter_refusal(parameters)
            Origin.of(
                '', no_plan, parameters
            )  # loads the plan comparison before a program has to wait for it
        self.torques: Floats = _NONE  # active or fading [N m], shape (n, 3)
        self.reason = _NOTHING_YET if learned is not None else ''  # why none are active

    @property
    def exist(self) -> bool:
        """Whether torques were learned, for this or another program, including those dropped by a fault."""
        return self._learned is not None or bool(self.reason)

    def load(self, plan: Plan) -> None:
        """Check whether the torques fit a program that is about to start."""
        if self._learned is not None:
            self._misfit = self._other_robot or self._learned.plan_refusal(plan)

    def start(self, timeline: Timeline) -> None:
        """Command the torques if they fit the program that starts, at an override of 1."""
        if self._learned is None or timeline.profile is None:
            return
        as_planned = timeline.profile.override == 1.0
        self.reason = self._misfit if self._misfit or as_planned else _OVERRIDDEN
        self.torques = _NONE if self.reason else self._learned.torques
        self._state['corrected_from'] = timeline.start_cycle

    def follow(self, timeline: Timeline, reason: str) -> None:
        """Fade the torques out: another motion profile does not follow the plan."""
        self.fade_out(timeline.start_cycle, reason)

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Fade the torques out: they were learned for the plan before."""
        self.fade_out(timeline.start_cycle, 'moves were appended to the program')

    def clear_program(self, cycle: int, reason: str) -> None:
        """Fade the torques out."""
        self.fade_out(cycle, reason)

    def fade_out(self, cycle: int, reason: str, for_good: bool = False) -> None:
        """Fade the torques to zero from a cycle on, because the motion no longer follows their plan."""
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
