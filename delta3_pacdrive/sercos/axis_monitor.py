"""The master's side of the cyclic telegrams: answers of the drives, their losses, and the faults they tell of.

Knows bus cycles, no clock and no messages. What it finds in the answers of cycle k is answered with a stop from cycle
k + ``outstanding_cycles_max`` on: by then no command has gone out yet, however many answers are on their way, so that
the course of events depends on bus time alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.numerics.kernel import interpreted
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos import losses
from delta3_pacdrive.sercos.configuration_check import DRIVES, drives_of
from delta3_pacdrive.sercos.losses import LOSSES_IN_A_ROW, NO_ANSWER, Losses, count_telegrams
from delta3_pacdrive.sercos.words import Status, in_torque

FOLLOWS = int(Status.FOLLOWS_COMMAND)
ERROR = int(Status.ERROR)  # operations on flags are 20 times slower
count_telegram, count_loss, too_many = (
    interpreted(function) for function in (losses.count_telegram, losses.count_loss, losses.too_many)
)


@dataclass(frozen=True)
class AxisFault:
    """A fault keeps an axis from going on, as the answers of a bus cycle tell.

    Attributes
    ----------
    fault
        Which axis, what it tells, and in which bus cycle.
    not_following
        Whether the axis does not follow its commands any more: bit 3 of S-0-0135 is off beside its fault.
    drive
        Number of the drive that reports it, from 0 on; None if the master has found it.

    """

    fault: RobotFault
    not_following: bool = False
    drive: int | None = None


class AxisMonitor:
    """The monitor keeps what the master knows of the drives: those of the arms, and that of a rotary axis behind them.

    Attributes
    ----------
    positions, speeds, torques
        Of the motor shafts [rad, rad/s, N m], as the last answers said, or extrapolated; by axis.
    status
        Status words S-0-0135.
    losses
        Answers that were missing, per axis.
    absent
        Axes that do not take part any more; their answers are neither expected nor counted.

    """

    def __init__(self, parameters: Parameters) -> None:
        self._cycle_time_s, self._names = parameters.bus.cycle_time_s, drives_of(parameters)
        count, arms = len(self._names), len(DRIVES)
        self.positions: Floats = np.zeros(count)
        self.torques: Floats = np.zeros(count)
        self.speeds = [0.0] * count
        self.status = [0] * count
        self.losses = [0] * count
        self.absent: set[int] = set()
        self._recent = [Losses() for _ in self._names]
        # what couples is checked together: the arms, and the rotary axis by itself
        self._groups = [range(arms), range(arms, count)] if count > arms else [range(arms)]
        self._checked: list[list[int]] = [[] for _ in self._groups]

    def begin(self) -> None:
        """Begin cyclic operation: everybody takes part."""
        self.absent.clear()
        self.speeds = [0.0] * len(self._names)
        self.status = [0] * len(self._names)
        self._recent = [Losses() for _ in self._names]
        self._checked = [[] for _ in self._groups]

    def clear_losses(self) -> None:
        """Begin a new window of lost answers."""
        for recent in self._recent:
            recent.losses_in_window = 0

    def accept(self, axis: int, values: Sequence[float], status: int) -> None:
        """Accept the answer of an axis, by its number: position [rad], speed [rad/s], torque [N m], status word."""
        self.positions[axis], self.speeds[axis], self.torques[axis] = values
        self.status[axis] = status
        count_telegram(self._recent[axis])

    def accept_cycles(self, cycles: int, answers: Floats, status: Sequence[int]) -> None:
        """Accept the answers of cycles in which nothing was lost, of which the last ones are given.

        Parameters
        ----------
        cycles
            How many they are.
        answers
            Rows of position [rad], speed [rad/s] and torque [N m], a column for each axis, shape (3, axes).
        status
            Status words, shape (axes,).

        """
        self.positions[:], self.torques[:] = answers[0], answers[2]
        self.speeds, self.status = answers[1].tolist(), list(status)
        for recent in self._recent:
            count_telegrams(recent, cycles)

    def extrapolate(self, axis: int) -> None:
        """Go on without the answer of an axis in a cycle: its shaft is extrapolated at constant speed."""
        if axis in self.absent:
            return
        self.losses[axis] += 1
        count_loss(self._recent[axis])
        self.positions[axis] += self.speeds[axis] * self._cycle_time_s

    def drop(self, axis: int) -> None:
        """Go on without an axis until the bus is phased up again: it is as good as without power."""
        self.absent.add(axis)
        self.status[axis] = 0
        self.speeds[axis] = self.torques[axis] = 0.0

    def faulty(self) -> list[int]:
        """Numbers of the axes that report a fault."""
        return [index for index, status in enumerate(self.status) if status & ERROR]

    def is_checked(self, status: list[int]) -> bool:
        """Whether these status words are those that were checked last: they tell nothing new."""
        return status == [word for words in self._checked for word in words]

    def check(self, cycle: int, program_starts: int) -> AxisFault | None:
        """Check the answers of a cycle, once they are all there.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        program_starts
            Bus cycle from which on every drive must be in torque, ``NEVER`` if none is.

        Returns
        -------
        AxisFault | None
            The first fault that the answers tell of. A status that has been checked is not told again. A rotary axis
            comes behind the arms, unless it alone does not follow any more.

        """
        found: AxisFault | None = None
        for number, group in enumerate(self._groups):
            told = self._check(cycle, program_starts, number, group)
            if found is None or (told is not None and told.not_following and not found.not_following):
                found = told
        return found

    def _check(self, cycle: int, program_starts: int, number: int, group: range) -> AxisFault | None:
        """Check the axes of a group, by its number."""
        for index in group:
            axis = self._names[index]
            if too_many(self._recent[index]):
                in_a_row = self._recent[index].losses_in_a_row >= LOSSES_IN_A_ROW
                many = 'two AT lost in a row' if in_a_row else 'ten AT lost in a window'
                sentence = f'{axis}: {many} in bus cycle {cycle} ({NO_ANSWER})'
                return AxisFault(RobotFault(FaultCode.ANSWER_LOST, sentence, axis, NO_ANSWER, cycle))
        words = self.status[group.start : group.stop]
        if words == self._checked[number] and cycle != program_starts:
            return None
        self._checked[number] = words
        for index, status in zip(group, words, strict=True):
            axis = self._names[index]
            if index in self.absent:
                continue
            if status & ERROR:
                sentence = f'{axis} reports a fault in bus cycle {cycle}'
                fault = RobotFault(FaultCode.DRIVE, sentence, axis, cycle=cycle)
                return AxisFault(fault, not status & FOLLOWS, index)
            if cycle >= program_starts and not in_torque(status):
                sentence = f'{axis} is not enabled in bus cycle {cycle}, in which a program runs'
                return AxisFault(RobotFault(FaultCode.NOT_ENABLED, sentence, axis, cycle=cycle))
        return None
