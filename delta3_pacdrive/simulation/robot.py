"""The robot behind the bus: three drives and the plant, one bus cycle after the other, without ROS."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.drive.arrays import DriveArrays
from delta3_pacdrive.drive.mc4 import MC4, mc4_begin_cycle, mc4_run_period
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.arrays import PlantArrays
from delta3_pacdrive.plant.plant import Plant, advance
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.words import payload_on_grid


class RobotArrays(NamedTuple):
    """These are the arrays of three drives and the plant that the compiled code works on."""

    drives: tuple[DriveArrays, DriveArrays, DriveArrays]
    plant: PlantArrays
    exchanges: int  # in a bus cycle
    received: NDArray[np.int64]  # (3,) whether a drive gets the MDT
    status: NDArray[np.int64]  # (3,) S-0-0135
    answers: (
        Floats  # (3, 3) rows of the AT: position [rad], speed [rad/s], torque [N m]; a column for each axis
    )
    payload: Floats  # (2,) what is gripped now, and what the last MDT said [kg]
    currents: Floats  # (steps, 3) of an exchange period [A]
    brakes: NDArray[np.int64]  # (3,) brake outputs, 1 = release


@kernel
def robot_cycle(motors, control, payload_kg, robot, built):
    """Run one bus cycle of drives and plant, exchange by exchange; ``status`` and ``answers`` are filled.

    Parameters
    ----------
    motors, control, payload_kg
        What the MDT says: motor shaft commands [rad], shape (3,), S-0-0134, and what is gripped [kg].
    robot
        The ``RobotArrays``.
    built
        The ``BuiltArrays``, or None for a rigid robot: see ``plant.advance``.

    """
    drives, shafts = robot.drives, robot.plant.shafts
    robot.payload[0] = robot.payload[1]
    robot.payload[1] = payload_kg
    for i in range(3):
        drive, shaft = drives[i], (shafts[i], shafts[3 + i], shafts[6 + i])
        robot.status[i] = mc4_begin_cycle(robot.received[i] != 0, motors[i], control, shaft, drive)
        for row in range(3):
            robot.answers[row, i] = drive.state[0].answer[row]
    for _ in range(robot.exchanges):
        for i in range(3):
            drive, shaft = drives[i], (shafts[i], shafts[3 + i], shafts[6 + i])
            robot.brakes[i] = mc4_run_period(shaft, drive)
            for n in range(drive.currents.shape[0]):
                robot.currents[n, i] = drive.currents[n]
        advance(robot.currents, robot.brakes, robot.payload[0], robot.plant, built)


@kernel
def run_commands(commands, control, robot, built, answers):
    """Run one bus cycle for each row of commands.

    Parameters
    ----------
    commands
        Motor shafts [rad] of the MDT, shape (cycles, 3).
    control
        Control word S-0-0134 of all MDT; the payload stays as it is.
    robot, built
        As in ``robot_cycle``.
    answers
        Takes the AT, shape (cycles, 3, 3): position [rad], speed [rad/s] and torque [N m] by axis.

    """
    for k in range(commands.shape[0]):
        robot_cycle(commands[k], control, robot.payload[1], robot, built)
        for row in range(3):
            for i in range(3):
                answers[k, row, i] = robot.answers[row, i]


class Robot:
    """A robot is what the bus meets: plant and drives, one exchange after the other.

    Parameters
    ----------
    parameters
        Of the robot.

    Attributes
    ----------
    plant, drives
        The machine and its three drives.
    arrays
        What the compiled loops work on.

    """

    def __init__(self, parameters: Parameters) -> None:
        bus = parameters.bus
        self.plant = Plant(parameters)
        self.drives = [MC4(parameters, index) for index in range(len(DRIVES))]
        gripped = payload_on_grid(parameters.dynamics.payload_mass_kg)
        first, second, third = (drive.arrays for drive in self.drives)
        self.arrays = RobotArrays(
            (first, second, third),
            self.plant.arrays,
            round(bus.cycle_time_s / bus.exchange_period_s),
            np.ones(3, dtype=np.int64),
            np.zeros(3, dtype=np.int64),
            np.zeros((3, 3)),
            np.array([gripped, gripped]),
            np.zeros((len(first.currents), 3)),
            np.zeros(3, dtype=np.int64),
        )

    def encoder_positions(self) -> list[float]:
        """Motor shaft positions [rad] as the encoders read them."""
        positions = self.plant.shafts()[:3]
        return [drive.encoder_position(p) for drive, p in zip(self.drives, positions, strict=True)]

    def run(self, commands: Floats, control: int) -> Floats:
        """Run a bus cycle for each row of commands.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (cycles, 3).
        control
            Control word S-0-0134 of all MDT.

        Returns
        -------
        Floats
            The AT, shape (cycles, 3, 3): position [rad], speed [rad/s] and torque [N m] by axis.

        """
        self.arrays.received[:] = 1
        answers = np.empty((len(commands), 3, 3))
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        run_commands(commands, control, self.arrays, self.plant.built, answers)
        return answers

    def cycle(
        self,
        commands: Floats,
        control: int,
        answers: Floats,
        payload_kg: float | None = None,
        received: Sequence[bool] = (True, True, True),
    ) -> list[int]:
        """Run one bus cycle.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (3,).
        control
            Control word S-0-0134 of the MDT.
        answers
            Takes the AT, shape (3, 3): rows of position [rad], speed [rad/s] and torque [N m], columns of axes.
        payload_kg
            Payload of the MDT [kg]; None: as before.
        received
            Which drives get the MDT, shape (3,).

        Returns
        -------
        list[int]
            Status words S-0-0135 of the three drives.

        """
        arrays = self.arrays
        arrays.received[:] = received
        payload = float(arrays.payload[1]) if payload_kg is None else payload_kg
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        robot_cycle(commands, control, payload, arrays, self.plant.built)
        answers[:] = arrays.answers
        return list(arrays.status.tolist())
