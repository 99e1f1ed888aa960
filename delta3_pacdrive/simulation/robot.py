"""The simulated robot on the bus: drives and plant, bus cycle by bus cycle, without ROS."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, AXES_MAX, Parameters, numbered, rotary_axis_parameters
from delta3_pacdrive.robot.drive.arrays import DRIVE, drive_constants
from delta3_pacdrive.robot.drive.mc4 import (
    MC4,
    mc4_begin_cycle,
    mc4_run_period,
    take_link,
    take_temperatures,
)
from delta3_pacdrive.robot.plant.arrays import PLANT
from delta3_pacdrive.robot.plant.dc_link import LINK, DcLink, advance_link, begin_link_cycle
from delta3_pacdrive.robot.plant.plant import Plant, advance
from delta3_pacdrive.robot.plant.rotary_plant import ROTARY_PLANT, RotaryPlant, advance_rotary
from delta3_pacdrive.robot.plant.temperatures import (
    BODIES,
    Temperatures,
    collect_losses,
    end_heat_cycle,
    temperatures,
    warm_plant,
)
from delta3_pacdrive.robot.sercos.words import payload_on_grid

ROTARY_MAX = AXES_MAX - ARMS
# room for all axes of the largest robot: the arms, then the rotary axes
ROBOT = np.dtype(
    [
        ('drives', DRIVE, (AXES_MAX,)),
        ('plant', PLANT, (1,)),
        ('rotary', ROTARY_PLANT, (ROTARY_MAX,)),
        ('link', LINK, (1,)),
        ('bodies', BODIES, (AXES_MAX,)),
        ('warms', 'i8'),  # motors, gears and drives warm up
        ('exchanges', 'i8'),  # per bus cycle
        # axes whose motors and encoders are connected to the drives; ``crossed`` if any is not that of its drive
        ('motors', 'i8', (AXES_MAX,)),
        ('encoders', 'i8', (AXES_MAX,)),
        ('crossed', 'i8'),
        ('received', 'i8', (AXES_MAX,)),  # whether a drive receives the MDT
        ('status', 'i8', (AXES_MAX,)),  # S-0-0135
        # rows of the AT: position [rad], speed [rad/s], torque [N m]; a column for each axis
        ('answers', 'f8', (3, AXES_MAX)),
        ('torques', 'f8', (AXES_MAX,)),  # additive torque commands of the MDT [N m]
        ('payload', 'f8'),  # in this cycle [kg]
        ('next_payload', 'f8'),  # in the last MDT [kg]
        ('brakes', 'i8', (AXES_MAX,)),  # brake outputs, 1 = release
        # errors of the true tool angles [rad], set-point delay removed: in the last AT, and maxima at the ends of moves
        ('turn_errors', 'f8', (ROTARY_MAX,)),
        ('turn_place_errors', 'f8', (ROTARY_MAX,)),
    ],
    align=True,
)


@kernel
def _shaft(i, r):
    """Motor shaft of axis ``i`` of the record ``r``: position [rad], speed [rad/s], coupling torque d [N m]."""
    shafts, own = r.plant[0].shafts, r.rotary[max(i - ARMS, 0)].shaft
    if i < ARMS:
        return shafts[i], shafts[3 + i], shafts[6 + i]
    return own[0], own[1], own[2]


@kernel
def _feed_back(axes, r):
    """Give the shafts of their encoders to the first ``axes`` drives of the record ``r``."""
    for i in range(axes):
        s = r.drives[i].state
        s.feedback_position, s.feedback_speed, _ = _shaft(r.encoders[i], r)


@kernel
def _cross(axes, r, currents):
    """Give the ``currents`` and brake outputs of the first ``axes`` drives of the record ``r`` to their motors."""
    for i in range(axes):
        motor = r.motors[i]
        if motor > i:  # a pair
            r.brakes[i], r.brakes[motor] = r.brakes[motor], r.brakes[i]
            for n in range(currents.shape[0]):
                currents[n, i], currents[n, motor] = currents[n, motor], currents[n, i]


@kernel
def _supply(axes, r):
    """Give the voltage of the DC link of the record ``r`` to its first ``axes`` drives, and begin its sums."""
    s = r.link[0].state
    load = s.heat / r.link[0].constants.heat_max
    for i in range(axes):
        take_link((s.voltage, float(s.ready), load), r.drives[i].state)
    begin_link_cycle(r.link)


@kernel
def _warm(axes, r):
    """Give the temperatures to the first ``axes`` drives and motors of the record ``r``."""
    for i in range(axes):
        take_temperatures(temperatures(i, r.bodies), r.drives[i].state, r.drives[i].constants)
        if i < ARMS:
            warm_plant(i, r.bodies, r.plant[0].state, i)
        else:
            warm_plant(i, r.bodies, r.rotary[i - ARMS].state, 0)


@kernel
def _drawn(axes, r):
    """Energy [J] drawn by the motors of the first ``axes`` axes of the record ``r`` in the last exchange period."""
    drawn = r.plant[0].state.drawn
    for number in range(axes - ARMS):
        drawn += r.rotary[number].state.drawn
    return drawn


@kernel
def robot_cycle(motors, control, payload_kg, robot, built, currents):
    """Run one bus cycle of drives and plant, exchange by exchange; sets ``status`` and ``answers``.

    Parameters
    ----------
    motors, control, payload_kg
        Content of the MDT: motor shaft commands [rad], shape (axes,), S-0-0134, and payload [kg]. Its additive torques
        are in ``robot``. Axes after the last command are not run.
    robot
        Array of one record ``ROBOT``, because access to a record within an array needs no reference counting.
    built
        Array of one record ``BUILT``, or None for a rigid robot: see ``plant.advance``.
    currents
        Receives the motor currents of an exchange period [A], shape (steps, axes).

    """
    r, axes = robot[0], motors.shape[0]
    drives, plant = r.drives, r.plant
    r.payload, r.next_payload = r.next_payload, payload_kg
    if r.link[0].constants.enabled != 0:
        _supply(axes, r)
    if r.warms != 0:
        _warm(axes, r)
    if r.crossed != 0:
        _feed_back(axes, r)
    for i in range(axes):
        received, shaft = r.received[i] != 0, _shaft(r.motors[i], r)
        r.status[i] = mc4_begin_cycle(received, motors[i], r.torques[i], control, shaft, drives, i)
        for row in range(3):
            r.answers[row, i] = drives[i].state.answer[row]
    for _ in range(r.exchanges):
        if r.crossed != 0:
            _feed_back(axes, r)
        for i in range(axes):
            r.brakes[i] = mc4_run_period(_shaft(r.motors[i], r), drives, i, currents)
        if r.crossed != 0:
            _cross(axes, r, currents)
        advance(currents, r.brakes, r.payload, plant, built)
        for i in range(ARMS, axes):
            advance_rotary(currents, i, r.brakes[i], plant[0].state.carried, r.rotary, i - ARMS)
        if r.link[0].constants.enabled != 0:
            advance_link(_drawn(axes, r), r.link)
        if r.warms != 0:
            for i in range(axes):
                collect_losses(currents, i, _shaft(i, r)[1], r.bodies)
    if r.warms != 0:
        end_heat_cycle(axes, r.bodies)


@kernel
def run_commands(commands, torques, control, robot, built, currents, answers):
    """Run one bus cycle for each row of commands.

    Parameters
    ----------
    commands
        Motor shafts [rad] of the MDT, shape (cycles, axes).
    torques
        Additive torques [N m] of the MDT, shape (cycles, axes).
    control
        Control word S-0-0134 of all MDT; the payload does not change.
    robot, built, currents
        As in ``robot_cycle``.
    answers
        Receives the AT, shape (cycles, rows, axes): position [rad], speed [rad/s] and torque [N m] by axis, then motor
        currents [A] of current-loop periods, from that of the AT backwards.

    """
    newest, axes = currents.shape[0] - 1, commands.shape[1]
    for k in range(commands.shape[0]):
        for row in range(3, answers.shape[1]):
            for i in range(axes):
                answers[k, row, i] = currents[newest - (row - 3), i]
        for i in range(axes):
            robot[0].torques[i] = torques[k, i]
        robot_cycle(commands[k], control, robot[0].next_payload, robot, built, currents)
        for row in range(3):
            for i in range(axes):
                answers[k, row, i] = robot[0].answers[row, i]


class Robot:
    """Plant and drives of a robot, run bus cycle by bus cycle.

    Attributes
    ----------
    record, currents
        Arrays of the compiled loops: one record ``ROBOT``, shape (1,), and the motor currents of an exchange period
        [A].
    plant, rotary
        Arms, and rotary axes.
    drives, link
        All drives, those of the arms first, and their DC link.
    temperatures
        Temperatures of motors, gears and drives.
    observed
        Whether the drives are observed between exchanges; bus cycles are then not run in one compiled loop.
    answers, status
        Content of the last AT: position [rad], speed [rad/s] and torque [N m] by axis, shape (3, axes), and S-0-0135.

    """

    observed = False

    def __init__(self, parameters: Parameters) -> None:
        bus, axes = parameters.bus, len(parameters.axes)
        samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        self.record: NDArray[Any] = np.zeros(1, ROBOT)
        self.currents: Floats = np.zeros((samples, axes))
        self.plant = Plant(parameters, self.record['plant'][0])
        shared = self.record['drives'][0], self.currents
        constants = drive_constants(parameters)
        self.drives = [MC4(parameters, index, shared, constants) for index in range(ARMS)]
        rotary = self.record['rotary'][0]
        self.rotary: tuple[RotaryPlant, ...] = ()
        for number in range(axes - ARMS):
            self.drives.append(
                MC4(rotary_axis_parameters(parameters, number), 0, shared, place=ARMS + number)
            )
            self.rotary += (RotaryPlant(parameters, number, rotary[number : number + 1]),)
        self.link = DcLink(parameters, self.record['link'][0])
        self.temperatures = Temperatures(parameters, self.record['bodies'][0])
        self.record['warms'] = self.temperatures.enabled
        self.received: NDArray[np.int64] = self.record['received'][0, :axes]
        self.status: NDArray[np.int64] = self.record['status'][0, :axes]
        self.answers: Floats = self.record['answers'][0, :, :axes]
        self._torques: Floats = self.record['torques'][0, :axes]
        self.record['exchanges'] = round(bus.cycle_time_s / bus.exchange_period_s)
        own, wiring = list(range(AXES_MAX)), parameters.mounting
        self.record['motors'] = [wiring.motor_of(index) for index in own]
        self.record['encoders'] = [wiring.encoder_of(index) for index in own]
        self.record['crossed'] = wiring.crossed
        self.grip(payload_on_grid(parameters.dynamics.payload_mass_kg))

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

    @property
    def turn_rad(self) -> float:
        """True angle of the tool [rad], the sum over the rotary axes."""
        return sum((axis.angle_rad for axis in self.rotary), 0.0)

    def turn_figures(self) -> dict[str, float]:
        """Return results of the rotary axes known only to a simulation, under their names in run results."""
        errors = self.record['turn_place_errors'][0].tolist()
        return {
            numbered('turn_place_error_max_rad', number): errors[number] for number in range(len(self.rotary))
        }

    def shafts(self) -> list[tuple[float, float, float]]:
        """Return the motor shaft of each axis: position [rad], speed [rad/s], coupling torque d [N m]."""
        arms = self.plant.shafts()
        return [(arms[i], arms[3 + i], arms[6 + i]) for i in range(ARMS)] + [
            axis.shaft() for axis in self.rotary
        ]

    def encoder_positions(self) -> list[float]:
        """Return motor shaft positions [rad] of the arms as read by the encoders."""
        positions = self.plant.shafts()[:ARMS]
        return [drive.encoder_position(p) for drive, p in zip(self.drives[:ARMS], positions, strict=True)]

    def run(self, commands: Floats, control: int, torques: ArrayLike = 0.0, earlier: int = 0) -> Floats:
        """Run a bus cycle for each row of commands; axes without commands are not run.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (cycles, axes).
        control
            Control word S-0-0134 of all MDT.
        torques
            Additive torques of the MDT [N m], shape (cycles, axes).
        earlier
            Number of motor currents to return, from that of the AT backwards; at most the periods of an exchange.

        Returns
        -------
        Floats
            The AT, shape (cycles, 3 + earlier, axes): position [rad], speed [rad/s] and torque [N m] by axis, then
            motor currents [A].

        """
        self.received[:] = 1
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        answers = np.empty((len(commands), 3 + earlier, commands.shape[1]))
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
        received: bool | Sequence[bool] = True,
        torques: ArrayLike = 0.0,
    ) -> None:
        """Run one bus cycle; ``status`` and ``answers`` are then those of its AT. Axes without commands are not run.

        Parameters
        ----------
        commands
            Motor shafts [rad] of the MDT, shape (axes,).
        control
            Control word S-0-0134 of the MDT.
        payload_kg
            Payload of the MDT [kg]; None: unchanged.
        received
            Whether each drive receives the MDT, shape (axes,).
        torques
            Additive torques of the MDT [N m], shape (axes,).

        """
        axes = len(commands)
        self.received[:axes], self._torques[:axes] = received, torques
        payload = float(self.record['next_payload'][0]) if payload_kg is None else payload_kg
        commands = np.ascontiguousarray(commands, dtype=np.float64)
        robot_cycle(commands, control, payload, self.record, self.plant.built, self.currents)
