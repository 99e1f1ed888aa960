"""What a script waits for: evaluated on the answers of one bus cycle after the other, the same way on every bus.

Pure. Commands of later cycles may be out already when the answers of a cycle are evaluated. What counts is what the
command of the same cycle has left: so a condition is met in the same cycle however many cycles are outstanding.
"""

from dataclasses import dataclass, replace
from typing import Self

from delta3_pacdrive.controller.belt_knowledge import Tracked
from delta3_pacdrive.controller.transformation import Transformation


@dataclass(frozen=True)
class Commanded:
    """The command of a bus cycle has left this.

    Attributes
    ----------
    end_cycle
        First cycle in which the TCP stands at the end of the program, or of a stop; ``NEVER`` before a start.
    held
        Whether the master stops, or stands, on its path.
    outputs
        As bits: bit n is output n.
    payload_kg
        What the outputs have gripped.
    planned_m
        Where the plan has the TCP, beside what goes with a belt [m].
    tracked
        What goes with a belt; None: the robot has no belts.
    turn_rad
        Where the tool is commanded to be; None: the robot has no rotary axis.

    """

    end_cycle: int
    held: bool
    outputs: int
    payload_kg: float
    planned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tracked: Tracked | None = None
    turn_rad: float | None = None

    @classmethod
    def of(cls, task: Transformation) -> Self:
        """Return what the last command of a task has left."""
        turn = None if task.turning is None else task.turning.angle_rad
        held = task.loaded and task.held
        left = cls(task.end_cycle, held, task.outputs, task.payload, turn_rad=turn)
        if task.tracking is None:
            return left
        x, y, z = task.state['planned'][0].tolist()
        return replace(left, planned_m=(x, y, z), tracked=task.tracking.tracked)


@dataclass(frozen=True)
class WaitCondition:
    """A script waits for this, from one bus cycle to another.

    Attributes
    ----------
    first, latest
        Bus cycles: the condition is not looked at before the first one, and given up after the latest one.
    left_cycles
        So many bus cycles of motion, or fewer, are left; 0: the robot stands in position. None: that does not matter.
    over
        Whether no program may be under way any more: it has ended with its last answer.
    inputs_on, inputs_off
        Inputs that must be on and off, as bits.
    in_position_cycles
        For how many cycles every drive must have been within its window, to be in position.

    """

    first: int
    latest: int
    left_cycles: int | None = None
    over: bool = False
    inputs_on: int = 0
    inputs_off: int = 0
    in_position_cycles: int = 1

    def met(self, cycle: int, commanded: Commanded, loaded: bool, within: int, inputs: int) -> bool:
        """Say whether the answers of a bus cycle meet the condition.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        commanded
            What its command has left.
        loaded
            Whether a program is under way, once the same answers are evaluated.
        within
            For how many cycles every drive has been within its position window.
        inputs
            Of the same answers, as bits.

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
        """Return the first bus cycle that can meet the condition, as far as is known after a command."""
        if not loaded or (self.left_cycles is None and not self.over):
            return self.first
        return max(self.first, commanded.end_cycle - (self.left_cycles or 0))
