"""Functions of a drive for tests of its register: they note calls and set fields of a record."""

import numpy as np

from delta3_pacdrive.robot.drive.arrays import STATE
from delta3_pacdrive.robot.drive.register import Register


class DriveFunctions:
    """Notes executed commands; ``permits`` is what the state of the drive returns to each of them."""

    def __init__(self, record, permits=True):
        self._record, self.permits = record, permits
        self.calls = []

    def start_procedure(self, procedure):
        self.calls.append(procedure)
        return self.permits

    def cancel_procedure(self):
        self.calls.append('cancel')

    def set_data(self, name, value):
        if self.permits:
            self._record[name] = value
        return self.permits


class Drive:
    """A register with its state record, and the executed commands."""

    def __init__(self, robot, reset=True):
        self.state = np.zeros(1, STATE)
        self.changes = []
        self.resets = self.stored = 0
        self.functions, self._reset = DriveFunctions(self.state, reset), reset
        self.register = Register(
            robot,
            self._actual,
            self.changes.append,
            self._count_reset,
            drive=self.functions,
            back_up=self._back_up,
        )

    def _actual(self, name):
        return float(self.state[name][0])

    def _back_up(self):
        self.stored += 1
        return True

    def _count_reset(self):
        self.resets += 1
        return self._reset
