"""What the controller does in a bus cycle, without a bus: it commands, and later evaluates the answers of the drives.

The simulation calls both halves of a cycle one after the other. A node calls ``command`` when it sends the MDT of a
cycle and ``evaluate`` when the answers of a cycle are complete, each in the order of the cycles; in between a few
cycles may be outstanding. The rule which fault stops the robot, and how, stands here alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos.axis_monitor import AxisMonitor


class Command(NamedTuple):
    """What the MDT of a bus cycle says to the drives."""

    motors: Floats  # (3,) motor shafts [rad], on the increment grid; the next command overwrites them
    torques: Floats  # (3,) of the motors [N m], S-0-0081, where the robot's parameters ask for them; else 0
    control: int  # S-0-0134
    payload: float  # [kg], gripped
    outputs: int  # bit n is output n
    turn: tuple[float, float] | None = (
        None  # motor shaft [rad] and torque [N m] of the rotary axis, where there is one
    )


@dataclass(frozen=True)
class Stop:
    """A fault asks for a stop of the robot.

    Attributes
    ----------
    fault
        What is wrong, and in which bus cycle it was found.
    first
        First bus cycle of the stop, still to come.
    hard
        Whether the stop may be harder than the move allows: an axis does not follow any more.
    drive
        Number of the drive that reports the fault, from 0 on; None if it is no drive's.

    """

    fault: RobotFault
    first: int
    hard: bool = False
    drive: int | None = None


def emergency_stop(cycle: int) -> Stop:
    """Return the stop of an operator or of an injected fault, from the command of a bus cycle on."""
    sentence = f'emergency stop in bus cycle {cycle}'
    return Stop(RobotFault(FaultCode.EMERGENCY_STOP, sentence, cycle=cycle), cycle)


class ControllerCycle:
    """The controller's part of each bus cycle.

    Parameters
    ----------
    task
        Gives the commands and evaluates the answers.
    axes
        Keeps what the drives have answered.
    parameters
        Of the robot. A stop begins ``bus.outstanding_cycles_max`` cycles after the one whose answers tell of a fault.

    """

    def __init__(self, task: Transformation, axes: AxisMonitor, parameters: Parameters) -> None:
        self._task, self._axes = task, axes
        self._reaction_cycles = parameters.bus.outstanding_cycles_max

    def command(self, cycle: int) -> Command:
        """Return the command of the next cycle."""
        motors = self._task.command(cycle)
        task = self._task
        turn = None if task.turning is None else task.turning.commanded
        return Command(motors, task.torques, task.control(cycle), task.payload, task.outputs, turn)

    def evaluate(
        self, cycle: int, answers: Sequence[tuple[Any, ...] | None], program_starts: int, stopped: bool
    ) -> Stop | None:
        """Evaluate the answers of the drives in a cycle.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        answers
            Of each axis (position [rad], speed [rad/s], torque [N m]) and the status word, perhaps more behind them;
            None if it is lost: then the shaft is extrapolated.
        program_starts
            Bus cycle from which on every drive must be in torque, ``NEVER`` if the TCP stands.
        stopped
            Whether a fault has stopped the robot before: only an axis that does not follow any more counts then.

        Returns
        -------
        Stop | None
            What the fault of a drive asks for, or a robot that is not in position. The evaluated answers are in
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
