"""The robot behind the bus: three drives and the plant, one bus cycle after the other, without ROS."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.drive.arrays import DRIVE, drive_constants
from delta3_pacdrive.drive.mc4 import MC4, mc4_begin_cycle, mc4_run_period
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.plant.arrays import PLANT
from delta3_pacdrive.plant.plant import Plant, advance
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.words import payload_on_grid
from delta3_pacdrive.simulation.tool_axis import ToolDrive

ROBOT = np.dtype(
    [
        ('drives', DRIVE, (3,)),
        ('plant', PLANT, (1,)),
        ('exchanges', 'i8'),  # in a bus cycle
        ('received', 'i8', (3,)),  # whether a drive gets the MDT
        ('status', 'i8', (3,)),  # S-0-0135
        # rows of the AT: position [rad], speed [rad/s], torque [N m]; a column for each axis
        ('answers', 'f8', (3, 3)),
        ('torques', 'f8', (3,)),  # that the MDT commands beside the shafts [N m]
        ('payload', 'f8'),  # gripped now [kg]
        ('next_payload', 'f8'),  # what the last MDT said [kg]
        ('brakes', 'i8', (3,)),  # brake outputs, 1 = release
    ],
    align=True,
)


@kernel
def robot_cycle(motors, control, payload_kg, robot, built, currents):
    """Run one bus cycle of drives and plant, exchange by exchange; ``status`` and ``answers`` are filled.

    Parameters
    ----------
    motors, control, payload_kg
        What the MDT says: motor shaft commands [rad], shape (3,), S-0-0134, and what is gripped [kg]. The torques
        that it commands beside them stand in ``robot``.
    robot
        Array of one record ``ROBOT``: what is taken out of a record costs no counting of references.
    built
        Array of one record ``BUILT``, or None for a rigid robot: see ``plant.advance``.
    currents
        Takes the motor currents of an exchange period [A], shape (steps, 3).

    """
    r = robot[0]
    drives, plant = r.drives, r.plant
    shafts = plant[0].shafts
    r.payload, r.next_payload = r.next_payload, payload_kg
    for i in range(3):
        shaft = shafts[i], shafts[3 + i], shafts[6 + i]
        r.status[i] = mc4_begin_cycle(r.received[i] != 0, motors[i], r.torques[i], control, shaft, drives, i)
        for row in range(3):
            r.answers[row, i] = drives[i].state.answer[row]
    for _ in range(r.exchanges):
        for i in range(3):
            shaft = shafts[i], shafts[3 + i], shafts[6 + i]
            r.brakes[i] = mc4_run_period(shaft, drives, i, currents)
        advance(currents, r.brakes, r.payload, plant, built)


@kernel
def run_commands(commands, torques, control, robot, built, currents, answers):
    """Run one bus cycle for each row of commands.

    Parameters
    ----------
    commands
        Motor shafts [rad] of the MDT, shape (cycles, 3).
    torques
        Torques [N m] that the MDT commands beside them, shape (cycles, 3).
    control
        Control word S-0-0134 of all MDT; the payload stays as it is.
    robot, built, currents
        As in ``robot_cycle``.
    answers
        Takes the AT, shape (cycles, rows, 3): position [rad], speed [rad/s] and torque [N m] by axis; each further row
        is the motor current [A] of a current-loop period, from that of the AT back.

    """
    newest = currents.shape[0] - 1
    for k in range(commands.shape[0]):
        for row in range(3, answers.shape[1]):
            for i in range(3):
                answers[k, row, i] = currents[newest - (row - 3), i]
        for i in range(3):
            robot[0].torques[i] = torques[k, i]
        robot_cycle(commands[k], control, robot[0].next_payload, robot, built, currents)
        for row in range(3):
            for i in range(3):
                answers[k, row, i] = robot[0].answers[row, i]


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
    record, currents
        What the compiled loops work on: an array of one record ``ROBOT``, shape (1,), and the motor currents of an
        exchange period [A].
    tool
        The fourth drive and its axis, which do not couple with the arms; None: the robot has none. Who runs the bus
        cycles of the arms runs also those of it.
    observed
        Whether something looks into the drives between exchanges: then no stretch is run as one compiled loop.
    answers, status
        What the last AT say: position [rad], speed [rad/s] and torque [N m] by axis, shape (3, 3), and S-0-0135.

    """

    observed = False

    def __init__(self, parameters: Parameters) -> None:
        bus = parameters.bus
        samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self.record: NDArray[Any] = np.zeros(1, ROBOT)
        self.currents: Floats = np.zeros((samples, 3))
        self.plant = Plant(parameters, self.record['plant'][0])
        shared = self.record['drives'][0], self.currents
        constants = drive_constants(parameters)
        self.drives = [MC4(parameters, index, shared, constants) for index in range(len(DRIVES))]
        self.received: NDArray[np.int64] = self.record['received'][0]
        self.status: NDArray[np.int64] = self.record['status'][0]
        self.answers: Floats = self.record['answers'][0]
        self.record['exchanges'] = round(bus.cycle_time_s / bus.exchange_period_s)
        self.grip(payload_on_grid(parameters.dynamics.payload_mass_kg))
        self.tool = ToolDrive(parameters) if parameters.rotary.present else None

    def grip(self, payload_kg: float) -> None:
        """Let the drives know a payload [kg], of this MDT and the one before."""
        self.record['payload'] = self.record['next_payload'] = payload_kg

    def take_payload(self, payload_kg: float) -> None:
        """Take the payload [kg] of an MDT with the cycle that it begins: that of the MDT before hangs there now."""
        self.record['payload'] = self.record['next_payload']
        self.record['next_payload'] = payload_kg

    @property
    def payload(self) -> float:
        """What is gripped in this bus cycle [kg]."""
        return float(self.record['payload'][0])

    def encoder_positions(self) -> list[float]:
        """Motor shaft positions [rad] as the encoders read them."""
        positions = self.plant.shafts()[:3]
        return [drive.encoder_position(p) for drive, p in zip(self.drives, positions, strict=True)]

    def run(self, commands: Floats, control: int, torques: ArrayLike = 0.0, earlier: int = 0) -> Floats:
        """Run a bus cycle for each row of commands.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (cycles, 3).
        control
            Control word S-0-0134 of all MDT.
        torques
            Of the MDT [N m], shape (cycles, 3).
        earlier
            Number of motor currents to return, from that of the AT back; at most the periods of an exchange.

        Returns
        -------
        Floats
            The AT, shape (cycles, 3 + earlier, 3): position [rad], speed [rad/s] and torque [N m] by axis, then motor
            currents [A].

        """
        self.received[:] = 1
        answers = np.empty((len(commands), 3 + earlier, 3))
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        beside = np.ascontiguousarray(np.broadcast_to(np.asarray(torques, dtype=np.float64), commands.shape))
        run_commands(commands, beside, control, self.record, self.plant.built, self.currents, answers)
        return answers

    def cycle(
        self,
        commands: Floats,
        control: int,
        payload_kg: float | None = None,
        received: Sequence[bool] = (True, True, True),
        torques: ArrayLike = 0.0,
    ) -> None:
        """Run one bus cycle; ``status`` and ``answers`` are those of its AT.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (3,).
        control
            Control word S-0-0134 of the MDT.
        payload_kg
            Payload of the MDT [kg]; None: as before.
        received
            Which drives get the MDT, shape (3,).
        torques
            Of the MDT [N m], shape (3,).

        """
        self.received[:] = received
        self.record['torques'] = torques
        payload = float(self.record['next_payload'][0]) if payload_kg is None else payload_kg
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        robot_cycle(commands, control, payload, self.record, self.plant.built, self.currents)
