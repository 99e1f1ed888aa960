"""The oscilloscopes of a robot's drives: what they find and what they leave in every period of the current loop."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.sercos.increments import all_on_grid
from delta3_pacdrive.simulation.robot import Robot

Changes = Sequence[tuple[str, float]]
Add = Callable[[int, int, Any], Changes]

FOUND = ('position', 'speed', 'command', 'motor_current', 'voltage')


class Oscilloscope:
    """The oscilloscope runs drives and plant of a robot period by period, and records states of the drives.

    Parameters
    ----------
    robot
        Has begun its bus cycle whenever an exchange begins one.
    samples
        Periods of the current loop that are recorded.
    left
        Fields of a drive's state that are recorded at the end of each period.

    Attributes
    ----------
    found, left
        Fields at the start and at the end of each period, shapes (samples, 3). The shaft at the start of an exchange is
        that of the plant, later that of the drive itself.
    per_exchange
        Periods from one exchange to the next.

    """

    def __init__(self, robot: Robot, samples: int, left: Sequence[str] = ()) -> None:
        self._robot = robot
        self.found: dict[str, Floats] = {name: np.empty((samples, 3)) for name in FOUND}
        self.left: dict[str, Floats] = {name: np.empty((samples, 3)) for name in left}
        self.per_exchange = len(robot.drives[0].currents)
        self._row = 0

    def begin_cycle(
        self, commands: Iterable[float], control: int, torques: Iterable[float] = (0.0, 0.0, 0.0)
    ) -> list[int]:
        """Begin a bus cycle of the drives; return their status words S-0-0135."""
        shafts = np.reshape(self._robot.plant.shafts(), (3, 3)).T.tolist()
        told = zip(self._robot.drives, commands, torques, shafts, strict=True)
        return [
            drive.begin_cycle(command, control, position, speed, coupling, torque=torque)
            for drive, command, torque, (position, speed, coupling) in told
        ]

    def exchange(self, payload_kg: float | None = None, add: Add = lambda i, row, state: ()) -> None:
        """Run drives and plant from one exchange to the next.

        Parameters
        ----------
        payload_kg
            That the controller has gripped; None: as before.
        add
            Is called before each period with the number of the drive, that of the sample, and the state of the drive,
            which it may change; returns the fields and what is to be taken away from them after the period.

        """
        shafts = np.reshape(self._robot.plant.shafts(), (3, 3)).T.tolist()
        released = [self._run(i, shaft, add) for i, shaft in enumerate(shafts)]
        self._robot.plant.advance(self._robot.currents, released, payload_kg)
        self._row += self.per_exchange

    def _run(self, i: int, shaft: Sequence[float], add: Add) -> bool:
        drive, released = self._robot.drives[i], False
        state = drive.state[0]
        for n in range(self.per_exchange):
            row = self._row + n
            for name, values in self.found.items():
                values[row, i] = state[name]
            self.found['position'][row, i], self.found['speed'][row, i] = shaft[:2]
            undo = add(i, row, state)
            # one period at a time, from the drive's own shaft on: to the drive it is all one exchange
            released = drive.run_sample(n, *shaft)
            for name, change in undo:
                state[name] -= change
            for name, values in self.left.items():
                values[row, i] = state[name]
            shaft = float(state['position']), float(state['speed']), float(state['coupling'])
        return released

    def signals(self) -> dict[str, Floats]:
        """Return what the drives measure, by the names of signals."""
        per_rad = float(self._robot.drives[0].constants['increments_per_rad'][0])
        positions = np.empty(self.found['position'].shape)
        all_on_grid(self.found['position'].reshape(-1), per_rad, positions.reshape(-1))
        return {
            'motor_position': positions,
            'motor_speed': self.found['speed'],
            'current': self.found['motor_current'],
            'phase_voltage': self.found['voltage'],
        }
