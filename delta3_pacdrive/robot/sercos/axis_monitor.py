"""Evaluation of the ATs by the master: actual values, losses and drive faults.

Works in bus cycles, without clock and messages. A fault found in the ATs of cycle k leads to a stop from cycle
k + ``outstanding_cycles_max`` on. No command of that cycle has been sent yet, regardless of the ATs under way, so that
the sequence of events depends on bus time only.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.numerics.kernel import interpreted
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters
from delta3_pacdrive.robot.sercos import losses
from delta3_pacdrive.robot.sercos.losses import LOSSES_IN_A_ROW, NO_ANSWER, Losses, count_telegrams
from delta3_pacdrive.robot.sercos.words import Status, in_torque

FOLLOWS = int(Status.FOLLOWS_COMMAND)
ERROR = int(Status.ERROR)  # operations on flags are 20 times slower
count_telegram, count_loss, too_many = (
    interpreted(function) for function in (losses.count_telegram, losses.count_loss, losses.too_many)
)


@dataclass(frozen=True)
class AxisFault:
    """A fault of an axis, found in the ATs of a bus cycle."""

    fault: RobotFault
    not_following: bool = False  # bit 3 of S-0-0135 is off: the drive does not follow its commands
    drive: int | None = None  # index of the reporting drive; None: found by the master


class AxisMonitor:
    """Actual values and status of all drives: the arms first, then the rotary axes.

    Attributes
    ----------
    positions, speeds, torques
        Motor shafts [rad, rad/s, N m] from the latest ATs, or extrapolated; by axis.
    status
        Status words S-0-0135.
    losses
        Number of missing ATs, per axis.
    absent
        Removed axes; their ATs are neither expected nor counted.

    """

    def __init__(self, parameters: Parameters) -> None:
        self._cycle_time_s, self._names = parameters.bus.cycle_time_s, parameters.axes
        count = len(self._names)
        self.positions: Floats = np.zeros(count)
        self.torques: Floats = np.zeros(count)
        self.speeds = [0.0] * count
        self.status = [0] * count
        self.losses = [0] * count
        self.absent: set[int] = set()
        self._recent = [Losses() for _ in self._names]
        # coupled axes are checked together: the arms, and the rotary axes separately
        self._groups = range(ARMS), range(ARMS, count)
        self._checked: list[list[int]] = [[] for _ in self._groups]

    def begin(self) -> None:
        """Start cyclic operation with all axes."""
        self.absent.clear()
        self.speeds = [0.0] * len(self._names)
        self.status = [0] * len(self._names)
        self._recent = [Losses() for _ in self._names]
        self._checked = [[] for _ in self._groups]

    def clear_losses(self) -> None:
        """Start a new window of lost ATs."""
        for recent in self._recent:
            recent.losses_in_window = 0

    def accept(self, axis: int, values: Sequence[float], status: int) -> None:
        """Store the AT of an axis: position [rad], speed [rad/s], torque [N m], status word."""
        self.positions[axis], self.speeds[axis], self.torques[axis] = values
        self.status[axis] = status
        count_telegram(self._recent[axis])

    def accept_cycles(self, cycles: int, answers: Floats, status: Sequence[int]) -> None:
        """Store the ATs of several cycles without losses, given those of the last one.

        Parameters
        ----------
        cycles
            Number of cycles.
        answers
            Rows of position [rad], speed [rad/s] and torque [N m], one column per axis, shape (3, axes).
        status
            Status words, shape (axes,).

        """
        self.positions[:], self.torques[:] = answers[0], answers[2]
        self.speeds, self.status = answers[1].tolist(), list(status)
        for recent in self._recent:
            count_telegrams(recent, cycles)

    def extrapolate(self, axis: int) -> None:
        """Replace a missing AT: the shaft is extrapolated at constant speed."""
        if axis in self.absent:
            return
        self.losses[axis] += 1
        count_loss(self._recent[axis])
        self.positions[axis] += self.speeds[axis] * self._cycle_time_s

    def drop(self, axis: int) -> None:
        """Continue without an axis, treated as unpowered, until the next phase-up of the bus."""
        self.absent.add(axis)
        self.status[axis] = 0
        self.speeds[axis] = self.torques[axis] = 0.0

    def faulty(self) -> list[int]:
        """Return the indices of the axes that report a fault."""
        return [index for index, status in enumerate(self.status) if status & ERROR]

    def is_checked(self, status: list[int]) -> bool:
        """Whether these status words have already been checked."""
        return status == [word for words in self._checked for word in words]

    def check(self, cycle: int, program_starts: int) -> AxisFault | None:
        """Check the ATs of a complete cycle.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        program_starts
            Bus cycle from which every drive must be in torque, ``NEVER`` without one.

        Returns
        -------
        AxisFault | None
            First fault found; each status word is reported once. The arms take precedence over rotary axes, unless
            only one of the latter has stopped following its commands.

        """
        found: AxisFault | None = None
        for number, group in enumerate(self._groups):
            fault = self._check(cycle, program_starts, number, group)
            if found is None or (fault is not None and fault.not_following and not found.not_following):
                found = fault
        return found

    def _check(self, cycle: int, program_starts: int, number: int, group: range) -> AxisFault | None:
        """Check the axes of one group."""
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
