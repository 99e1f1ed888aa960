"""The simulated robot on the bus: three drives and the plant, bus cycle by bus cycle, without ROS."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.arrays import DRIVE, drive_constants
from delta3_pacdrive.robot.drive.mc4 import MC4, mc4_begin_cycle, mc4_run_period
from delta3_pacdrive.robot.plant.arrays import PLANT
from delta3_pacdrive.robot.plant.plant import Plant, advance
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.words import payload_on_grid
from delta3_pacdrive.simulation.tool_axis import ToolDrive

ROBOT = np.dtype(
    [
        ('drives', DRIVE, (3,)),
        ('plant', PLANT, (1,)),
        ('exchanges', 'i8'),  # per bus cycle
        ('received', 'i8', (3,)),  # whether a drive receives the MDT
        ('status', 'i8', (3,)),  # S-0-0135
        # rows of the AT: position [rad], speed [rad/s], torque [N m]; a column for each axis
        ('answers', 'f8', (3, 3)),
        ('torques', 'f8', (3,)),  # additive torque commands of the MDT [N m]
        ('payload', 'f8'),  # in this cycle [kg]
        ('next_payload', 'f8'),  # in the last MDT [kg]
        ('brakes', 'i8', (3,)),  # brake outputs, 1 = release
    ],
    align=True,
)


@kernel
def robot_cycle(motors, control, payload_kg, robot, built, currents):
    """Run one bus cycle of drives and plant, exchange by exchange; sets ``status`` and ``answers``.

    Parameters
    ----------
    motors, control, payload_kg
        Content of the MDT: motor shaft commands [rad], shape (3,), S-0-0134, and payload [kg]. Its additive torques are
        in ``robot``.
    robot
        Array of one record ``ROBOT``, because access to a record within an array needs no reference counting.
    built
        Array of one record ``BUILT``, or None for a rigid robot: see ``plant.advance``.
    currents
        Receives the motor currents of an exchange period [A], shape (steps, 3).

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
        Additive torques [N m] of the MDT, shape (cycles, 3).
    control
        Control word S-0-0134 of all MDT; the payload does not change.
    robot, built, currents
        As in ``robot_cycle``.
    answers
        Receives the AT, shape (cycles, rows, 3): position [rad], speed [rad/s] and torque [N m] by axis, then motor
        currents [A] of current-loop periods, from that of the AT backwards.

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
    """Plant and drives of a robot, run bus cycle by bus cycle.

    Attributes
    ----------
    record, currents
        Arrays of the compiled loops: one record ``ROBOT``, shape (1,), and the motor currents of an exchange period
        [A].
    tool
        Fourth drive and rotary axis, dynamically decoupled from the arms; None if not present. The caller runs its bus
        cycles together with those of the arms.
    observed
        Whether the drives are observed between exchanges; bus cycles are then not run in one compiled loop.
    answers, status
        Content of the last AT: position [rad], speed [rad/s] and torque [N m] by axis, shape (3, 3), and S-0-0135.

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
        """Set the payload [kg] of this MDT and the one before."""
        self.record['payload'] = self.record['next_payload'] = payload_kg

    def take_payload(self, payload_kg: float) -> None:
        """Take the payload [kg] of the MDT at the start of a cycle; that of the MDT before becomes active."""
        self.record['payload'] = self.record['next_payload']
        self.record['next_payload'] = payload_kg

    @property
    def payload(self) -> float:
        """Payload in this bus cycle [kg]."""
        return float(self.record['payload'][0])

    def encoder_positions(self) -> list[float]:
        """Return motor shaft positions [rad] as read by the encoders."""
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
            Additive torques of the MDT [N m], shape (cycles, 3).
        earlier
            Number of motor currents to return, from that of the AT backwards; at most the periods of an exchange.

        Returns
        -------
        Floats
            The AT, shape (cycles, 3 + earlier, 3): position [rad], speed [rad/s] and torque [N m] by axis, then motor
            currents [A].

        """
        self.received[:] = 1
        answers = np.empty((len(commands), 3 + earlier, 3))
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        additive = np.ascontiguousarray(
            np.broadcast_to(np.asarray(torques, dtype=np.float64), commands.shape)
        )
        run_commands(commands, additive, control, self.record, self.plant.built, self.currents, answers)
        return answers

    def cycle(
        self,
        commands: Floats,
        control: int,
        payload_kg: float | None = None,
        received: Sequence[bool] = (True, True, True),
        torques: ArrayLike = 0.0,
    ) -> None:
        """Run one bus cycle; ``status`` and ``answers`` are then those of its AT.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (3,).
        control
            Control word S-0-0134 of the MDT.
        payload_kg
            Payload of the MDT [kg]; None: unchanged.
        received
            Whether each drive receives the MDT, shape (3,).
        torques
            Additive torques of the MDT [N m], shape (3,).

        """
        self.received[:] = received
        self.record['torques'] = torques
        payload = float(self.record['next_payload'][0]) if payload_kg is None else payload_kg
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        robot_cycle(commands, control, payload, self.record, self.plant.built, self.currents)
