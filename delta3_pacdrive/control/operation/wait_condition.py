"""Conditions that a script waits for, evaluated on the feedback of each bus cycle, identically on every bus.

Pure. Later cycles may have been commanded already when the feedback of a cycle is evaluated. The condition uses the
state after the command of the same cycle, so the result does not depend on the number of outstanding cycles.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from delta3_pacdrive.belts.knowledge import Tracked
from delta3_pacdrive.configuration.json_message import JsonMessage, nullable
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.robot.sercos.bus_time import NEVER


@dataclass(frozen=True)
class Commanded:
    """State after the command of a bus cycle."""

    end_cycle: int  # first cycle at rest at the end of the program or of a stop; NEVER before a start
    held: bool  # whether the master is stopping or at rest on its path
    outputs: int  # bit n is output n
    payload_kg: float
    planned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # position of the plan, without belt offset
    tracked: Tracked | None = None  # None: the robot has no belts
    turns_rad: tuple[float, ...] = ()  # commanded angles of the rotary axes

    @classmethod
    def of(cls, task: Transformation) -> Self:
        """Return the state after the last command of a task."""
        held = task.loaded and task.held
        left = cls(task.end_cycle, held, task.outputs, task.payload, turns_rad=task.turns_rad)
        if not task.tracking.belts:
            return left
        x, y, z = task.state['planned'][0].tolist()
        return replace(left, planned_m=(x, y, z), tracked=task.tracking.tracked)


@dataclass(frozen=True)
class WaitCondition(JsonMessage):
    """Condition that a script waits for."""

    number_min: ClassVar[float] = -1
    number_max: ClassVar[float] = NEVER

    first: int  # first bus cycle that is evaluated
    latest: int  # bus cycle of the timeout
    left_cycles: int | None = nullable()  # maximum remaining cycles of motion, 0: in position, None: any
    over: bool = False  # whether the program must have ended with its last feedback
    inputs_on: int = 0  # inputs that must be on, as bits
    inputs_off: int = 0
    in_position_cycles: int = 1  # required cycles within the position windows

    def met(self, cycle: int, commanded: Commanded, loaded: bool, within: int, inputs: int) -> bool:
        """Return whether the feedback of a bus cycle meets the condition.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        commanded
            State after its command.
        loaded
            Whether a program is loaded after this feedback has been evaluated.
        within
            Number of cycles for which every drive has been within its position window.
        inputs
            Inputs in this feedback, as bits.

        """
        if cycle < self.first:
            return False
        if inputs & self.inputs_on != self.inputs_on or inputs & self.inputs_off:
            return False
        if self.left_cycles is None or not loaded:
            return not (self.over and loaded)
        if self.left_cycles:
            return not commanded.held and cycle >= commanded.end_cycle - self.left_cycles
        stood = cycle + 1 - commanded.end_cycle
        return min(within, stood) >= self.in_position_cycles

    def earliest(self, commanded: Commanded, loaded: bool) -> int:
        """Return the first bus cycle that can meet the condition, given the state after a command."""
        if not loaded or (self.left_cycles is None and not self.over):
            return self.first
        return max(self.first, commanded.end_cycle - (self.left_cycles or 0))
