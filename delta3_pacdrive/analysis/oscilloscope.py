"""Oscilloscope inside the drives: records drive states in every period of the current loop."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.drive.arrays import words_of_state
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.sercos.increments import all_on_grid
from delta3_pacdrive.simulation.recorded_exchange import FOUND, run_recorded_exchange
from delta3_pacdrive.simulation.robot import Robot


@dataclass(frozen=True)
class Added:
    """Values added to fields of a drive's state before each period and removed after it."""

    axis: int  # index of the drive, from 0
    fields: Sequence[tuple[str, float]]  # fields, each with a factor
    values: Floats  # one value per period of the current loop, shape (samples,)


NOTHING = Added(-1, (), np.empty(0))


def _places(names: Sequence[str]) -> NDArray[np.int64]:
    """Return the word offsets of fields in a drive's state; raises ValueError for an integer field."""
    words, whole = words_of_state(names)
    if whole.any():
        raise ValueError(
            f'{names[int(whole.argmax())]} is an integer field, an oscilloscope records floating-point fields'
        )
    return words


class Oscilloscope:
    """Runs drives and plant of a robot period by period and records states of the drives.

    Parameters
    ----------
    robot
        Robot whose bus cycle has begun whenever an exchange begins one.
    samples
        Number of recorded periods of the current loop.
    left
        State fields recorded at the end of each period.
    added
        Values added to the set points of a drive.

    Attributes
    ----------
    found, left
        Fields at the start and at the end of each period, shapes (samples, 3). At the start of an exchange the shaft
        is that of the plant, afterwards that of the drive.
    per_exchange
        Periods of the current loop per exchange.

    """

    def __init__(self, robot: Robot, samples: int, left: Sequence[str] = (), added: Added = NOTHING) -> None:
        self._robot = robot
        self._words = robot.record['drives'][0].view(np.float64).reshape(3, -1)
        self._brakes = robot.record['brakes'][0]
        self._found = _places(FOUND), np.empty((len(FOUND), samples, 3))
        self._left = _places(left), np.empty((len(left), samples, 3))
        factors = np.array([factor for _, factor in added.fields], dtype=np.float64)
        self._added = _places([name for name, _ in added.fields]), factors, added.axis, added.values
        self.found: dict[str, Floats] = dict(zip(FOUND, self._found[1], strict=True))
        self.left: dict[str, Floats] = dict(zip(left, self._left[1], strict=True))
        self.per_exchange = len(robot.currents)
        self._row = 0

    def begin_cycle(
        self, commands: Iterable[float], control: int, torques: Iterable[float] = (0.0, 0.0, 0.0)
    ) -> list[int]:
        """Begin a bus cycle of the drives; return their status words S-0-0135."""
        shafts = np.reshape(self._robot.plant.shafts(), (3, 3)).T.tolist()
        return [
            drive.begin_cycle(command, control, position, speed, coupling, torque=torque)
            for drive, command, torque, (position, speed, coupling) in zip(
                self._robot.drives, commands, torques, shafts, strict=True
            )
        ]

    def exchange(self, payload_kg: float | None = None) -> None:
        """Run drives and plant for one exchange period, with a newly gripped payload; None: unchanged."""
        robot = self._robot
        shafts = np.array(robot.plant.shafts())
        run_recorded_exchange(
            self._row, shafts, self._words, self._added, robot.record, robot.currents, self._found, self._left
        )
        robot.plant.advance(robot.currents, self._brakes, payload_kg)
        self._row += self.per_exchange

    def signals(self) -> dict[str, Floats]:
        """Return the measurements of the drives by signal name."""
        per_rad = float(self._robot.drives[0].constants['increments_per_rad'][0])
        positions = np.empty(self.found['position'].shape)
        all_on_grid(self.found['position'].reshape(-1), per_rad, positions.reshape(-1))
        return {
            'motor_position': positions,
            'motor_speed': self.found['speed'],
            'current': self.found['motor_current'],
            'phase_voltage': self.found['voltage'],
        }
