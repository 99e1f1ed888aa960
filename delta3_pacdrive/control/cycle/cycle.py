"""The controller's evaluation of the drives' feedback in a bus cycle, without a bus.

The simulation calls ``Transformation.command`` and ``evaluate`` of a cycle in turn. A node calls the first when it
sends the MDT of a cycle and the second when its feedback is complete, each in the order of the cycles; a few cycles may
be outstanding in between.
The decision which fault stops the robot, and how, is made only here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor


@dataclass(frozen=True)
class Stop:
    """Stop of the robot caused by a fault."""

    fault: RobotFault
    first: int  # first bus cycle of the stop
    hard: bool = False  # whether it may exceed the deceleration of the move, because an axis does not follow
    drive: int | None = None  # index of the drive that reports the fault, if any


def emergency_stop(cycle: int) -> Stop:
    """Return the stop by an operator or an injected fault, from the command of a bus cycle on."""
    sentence = f'emergency stop in bus cycle {cycle}'
    return Stop(RobotFault(FaultCode.EMERGENCY_STOP, sentence, cycle=cycle), cycle)


class ControllerCycle:
    """The controller's part of each bus cycle after its feedback has arrived.

    A stop starts ``bus.outstanding_cycles_max`` cycles after the one with the fault in its feedback.
    """

    def __init__(self, task: Transformation, axes: AxisMonitor, parameters: Parameters) -> None:
        self._task, self._axes = task, axes
        self._reaction_cycles = parameters.bus.outstanding_cycles_max

    def evaluate(
        self, cycle: int, answers: Sequence[tuple[Any, ...] | None], program_starts: int, stopped: bool
    ) -> Stop | None:
        """Evaluate the feedback of the drives in a cycle.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        answers
            Of each axis (position [rad], speed [rad/s], torque [N m]), the status word, and possibly more; None for a
            lost AT: its position is extrapolated.
        program_starts
            First bus cycle in which every drive must be in torque, ``NEVER`` at rest.
        stopped
            Whether a fault has stopped the robot already: then only an axis that no longer follows is a new fault.

        Returns
        -------
        Stop | None
            Stop for a fault of a drive, or for a robot that is not in position. The evaluated feedback is in
            ``Transformation.answer``.

        """
        axes = self._axes
        for axis, answer in enumerate(answers):
            if answer is None:
                axes.extrapolate(axis)
            else:
                axes.accept(axis, answer[0], answer[1])
        self._task.receive(cycle, axes.positions, axes.torques)
        found = axes.check(cycle, program_starts)
        if found is None or (stopped and not found.not_following):
            late = None if stopped else self._task.settle(cycle)
            return None if late is None else Stop(late, cycle + self._reaction_cycles)
        return Stop(found.fault, cycle + self._reaction_cycles, found.not_following, found.drive)
