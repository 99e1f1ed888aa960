"""The bus cycle without ROS: faults, command, exchange, feedback, check, reaction.

``SimulatedOperation`` contains all steps of a cycle. Stretches of motion without changes of faults or status words are
run in one compiled loop of the same kernels.

Arguments of the kernels here:

``cycle``
    Number of a bus cycle.
``motors``, ``torques``
    Motor shaft commands [rad] and additive torque commands [N m], shape (axes,).
``plant``
    Array of one record ``PLANT``.
``answers``
    Content of the AT: rows of position [rad], speed [rad/s] and torque [N m], a column for each axis.
``task``, ``robot``
    Arrays of one record ``TASK`` and ``ROBOT``, shape (1,).
``signals``
    Receives the signals in the order of ``NAMES``, shape (22, cycles, 3).
``rotary``
    For each rotary axis its rotations in the plan (``TurnTables``), array of one record ``control.cycle.ROTARY``, and
    array that receives its signals, shape (6, cycles). The compiler cannot iterate over an empty tuple, so each loop is
    within a condition, which it removes.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.cell.world import World
from delta3_pacdrive.control.cycle.cycle import ControllerCycle, Stop, emergency_stop
from delta3_pacdrive.control.cycle.rotary_axis import answer_turn, command_turn
from delta3_pacdrive.control.cycle.task_cycle import answer_cycle, command_cycle
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.errors import FaultCode, RunError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, numbered
from delta3_pacdrive.recording.signals import (
    CURRENT_SIGNALS,
    SIGNALS,
    SUPPLY_SIGNALS,
    THERMAL_SIGNALS,
    TORQUE_SIGNALS,
    TRUE_SIGNALS,
)
from delta3_pacdrive.robot.drive.diagnostics import fault_text
from delta3_pacdrive.robot.faults.effects import (
    apply_to_drive,
    apply_to_link,
    apply_to_motors,
    apply_to_plant,
    apply_to_temperatures,
)
from delta3_pacdrive.robot.faults.fault import AT_LOSSES, GARBLED, MDT_LOSSES, PROCESS_FAULTS, Fault
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.plant.plant import true_tcp
from delta3_pacdrive.robot.plant.temperatures import temperatures
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.words import in_torque
from delta3_pacdrive.simulation.belts import readings
from delta3_pacdrive.simulation.optional_signals import NAMES as TURN_NAMES
from delta3_pacdrive.simulation.optional_signals import OptionalSignals, note_turn, note_turn_command
from delta3_pacdrive.simulation.robot import Robot, robot_cycle

REST_S = 1.0  # time without torque in which the machine comes to rest
ROOM_CYCLES = 1024  # initial size of the signals when the duration is unknown

SUPPLY = 'supply'  # its columns are the signals of the supply
NAMES = (*SIGNALS, *CURRENT_SIGNALS, *TRUE_SIGNALS, *TORQUE_SIGNALS, SUPPLY, *THERMAL_SIGNALS)
(
    MOTOR_COMMAND, MOTOR_POSITION, MOTOR_SPEED, CURRENT, FOLLOWING_ERROR, TCP_COMMAND, TCP_ACTUAL, TCP_ERROR,
    SHAFT_POSITION, SHAFT_SPEED, COUPLING_TORQUE,
    CURRENT_MEAN, CURRENT_RMS, CURRENT_MIN, CURRENT_MAX, ARM_ANGLE, TCP_TRUE, TORQUE_COMMAND,
    SUPPLY_POWERS,
    WINDING, HOUSING, SINK,
) = range(len(NAMES))  # fmt: skip


@kernel
def note_command(cycle, motors, torques, plant, signals):
    """Record the command of a bus cycle, and the state of the plant at its start."""
    tcp, shafts = true_tcp(plant), plant[0].shafts
    for i in range(3):
        signals[MOTOR_COMMAND, cycle, i] = motors[i]
        signals[TORQUE_COMMAND, cycle, i] = torques[i]
        signals[SHAFT_POSITION, cycle, i] = shafts[i]
        signals[SHAFT_SPEED, cycle, i] = shafts[3 + i]
        signals[COUPLING_TORQUE, cycle, i] = shafts[6 + i]
        signals[ARM_ANGLE, cycle, i] = plant[0].state.theta[i]
        signals[TCP_TRUE, cycle, i] = tcp[i]


@kernel
def note_supply(cycle, robot, signals):
    """Record voltage and powers of the DC link at the start of a bus cycle."""
    link, period = robot[0].link[0].state, robot[0].drives[0].constants.cycle_time
    signals[SUPPLY_POWERS, cycle, 0] = link.voltage
    signals[SUPPLY_POWERS, cycle, 1] = link.cycle_mains / period
    signals[SUPPLY_POWERS, cycle, 2] = link.cycle_resistor / period


@kernel
def note_temperatures(cycle, robot, signals):
    """Record the temperatures of motors and drives at the start of a bus cycle."""
    if robot[0].warms != 0:
        for i in range(3):
            signals[WINDING, cycle, i], signals[HOUSING, cycle, i], signals[SINK, cycle, i], _ = temperatures(
                i, robot[0].bodies
            )


@kernel
def note_currents(cycle, robot, signals):
    """Record the current statistics of the drives in a bus cycle."""
    for i in range(3):
        s, c = robot[0].drives[i].state, robot[0].drives[i].constants
        signals[CURRENT_MEAN, cycle, i] = s.cycle_sum / c.steps_per_cycle
        signals[CURRENT_RMS, cycle, i] = math.sqrt(s.cycle_square / c.steps_per_cycle)
        signals[CURRENT_MIN, cycle, i] = s.cycle_min
        signals[CURRENT_MAX, cycle, i] = s.cycle_max


@kernel
def note_answers(cycle, answers, task, signals):
    """Record the feedback of a bus cycle, and its evaluation by the task."""
    evaluated = task[0].answer
    for i in range(3):
        signals[MOTOR_POSITION, cycle, i] = answers[0, i]
        signals[MOTOR_SPEED, cycle, i] = answers[1, i]
        signals[CURRENT, cycle, i] = answers[2, i]
        signals[TCP_ACTUAL, cycle, i] = evaluated.tcp_actual[i]
        signals[TCP_COMMAND, cycle, i] = evaluated.tcp_command[i]
        signals[FOLLOWING_ERROR, cycle, i] = evaluated.following_error[i]
        signals[TCP_ERROR, cycle, i] = evaluated.tcp_error[i]


@kernel
def run_stretch(cycles, control, task, timeline, corrections, robot, built, currents, signals, rotary):
    """Run bus cycles of motion only, up to one in which a status word changes.

    Parameters
    ----------
    cycles
        First bus cycle, and the one after the last, shape (2,).
    control
        Control word S-0-0134 of all of them.
    task, timeline, corrections
        As in ``command_cycle``.
    robot, built, currents
        As in ``robot_cycle``.
    signals
        Receives the signals, shape (signals, cycles, 3), torques [N m] instead of currents.
    rotary
        As above.

    Returns
    -------
    int
        The cycle with a changed status word, still to be evaluated; else the one after the last.

    """
    first, end = cycles
    c, r = task[0], robot[0]
    axes = ARMS + len(rotary)
    motors, before = c.motors[:axes], r.status.copy()
    for k in range(first, end):
        command_cycle(k, task, timeline, corrections)
        note_command(k, motors, c.torques, r.plant, signals)
        note_supply(k, robot, signals)
        note_temperatures(k, robot, signals)
        if len(rotary) > 0:
            for turns, axis, found in rotary:
                command_turn(k, task, timeline, turns, axis)
                note_turn_command(k, axis, robot, found)
        for i in range(axes):
            r.torques[i] = c.torques[i]
        robot_cycle(motors, control, c.state.payload, robot, built, currents)
        note_currents(k, robot, signals)
        for i in range(axes):
            if r.status[i] != before[i]:
                return k
        answer_cycle(k, r.answers[0], r.answers[2], task)
        note_answers(k, r.answers, task, signals)
        if len(rotary) > 0:
            for _, axis, found in rotary:
                i = axis[0].constants.index
                answer_turn(k, r.answers[0, i], r.answers[2, i], task, axis)
                note_turn(k, axis, robot, found)
    return end


class SimulatedOperation:
    """Cyclic operation of a robot and its controller from bus cycle 0 on, with the faults of a program.

    Parameters
    ----------
    robot, task
        The simulated robot, and the task with its program loaded and started.
    faults
        Injected faults, counted from ``motion.start_cycle``. Without any, a drive that trips is an error.
    parameters
        Parameters of the robot.
    signals
        Optional signals: see ``OptionalSignals``.
    world
        The cell around the robot; None: the payload is that of the program.

    Attributes
    ----------
    stopped
        Why the program was stopped, empty if it was not.
    stop_source, stop_cycle
        ``RobotFault.source``, and first bus cycle of the stop, ``NEVER`` without one.
    drive_status
        For each drive the bus cycles in which its status word S-0-0135 changed, each with the new word.

    Raises
    ------
    RunError
        A fault affects a process, which a simulation does not have.

    """

    def __init__(
        self,
        robot: Robot,
        task: Transformation,
        faults: Sequence[Fault],
        parameters: Parameters,
        signals: Sequence[str] = (),
        world: World | None = None,
    ) -> None:
        self._robot, self._task, self._parameters, self._world = robot, task, parameters, world
        of_belts = ('cell_belts',) if world is not None and world.belts else ()
        self._requested = OptionalSignals((*signals, *of_belts), robot, parameters, world)
        self._start = parameters.motion.start_cycle
        self._must_succeed = not faults
        self._schedule = Schedule()
        for fault in faults:
            if fault.kind in PROCESS_FAULTS:
                raise RunError(f'{fault.text}: a simulation has no processes, use delta3 run')
            self._schedule.add(Scheduled.of(fault, self._start, parameters.bus.cycle_time_s))
        if len(robot.rotary) != len(task.rotary):
            raise RunError('controller and machine must have the same rotary axes (rotary.present)')
        self._axes = AxisMonitor(parameters)
        self._controller = ControllerCycle(task, self._axes, parameters)
        self._names = parameters.axes
        room = task.last_cycle + 1 if task.end_cycle < NEVER else ROOM_CYCLES
        self._signals = np.empty((len(NAMES), room, 3))
        self._turn_signals = np.empty((len(robot.rotary), len(TURN_NAMES), room))
        self.cycle = 0
        self.stopped = self.stop_source = ''
        self.stop_cycle = self._fault_cycle = NEVER
        self.drive_status: list[list[list[int]]] = [[] for _ in DRIVES]

    @property
    def lost(self) -> int:
        """Number of AT that did not reach the master."""
        return sum(self._axes.losses)

    def run(self) -> dict[str, Floats]:
        """Run to the end of the program, or to rest; return the signals, torques [N m] instead of currents.

        Raises
        ------
        RunError
            The drives are not enabled when a program without faults starts, or one trips.

        """
        rest_cycles = round(REST_S / self._parameters.bus.cycle_time_s)
        rests = NEVER
        while (end := self._end(self.cycle, rests)) > self.cycle:
            self.cycle = self._advance(self.cycle, end)
            if self.stopped and rests == NEVER and self._without_torque():
                rests = self.cycle + rest_cycles
        return self.signals()

    def signals(self) -> dict[str, Floats]:
        """Return the signals so far, torques [N m] instead of currents."""
        signals = {name: signal[: self.cycle] for name, signal in zip(NAMES, self._signals, strict=True)}
        supply = signals.pop(SUPPLY)
        if self._robot.link.enabled:
            columns = supply.T[:, :, None]
            signals |= dict(zip(SUPPLY_SIGNALS, columns, strict=True))
        if not self._robot.temperatures.enabled:
            for name in THERMAL_SIGNALS:
                del signals[name]
        if not self._parameters.sends_torque:
            for name in TORQUE_SIGNALS:
                del signals[name]
        for number, of_axis in enumerate(self._turn_signals):
            for name, signal in zip(TURN_NAMES, of_axis, strict=True):
                signals[numbered(name, number)] = signal[: self.cycle, None]
        return signals | self._requested.signals(self._fault_cycle)

    def _end(self, cycle: int, rests: int) -> int:
        """Return the cycle before which the run ends, as known in a cycle."""
        if self.stopped:
            return rests
        last = self._task.last_cycle
        if cycle < last:
            return last
        return last + 1 if cycle == last or self._task.in_position(cycle - 1) else cycle + 1

    def _without_torque(self) -> bool:
        return self._task.enable_cycle == NEVER and not any(drive.powered for drive in self._robot.drives)

    def _advance(self, cycle: int, end: int) -> int:
        """Run one bus cycle, or a stretch of motion only; return the next cycle."""
        starts = self._start if cycle <= self._start else NEVER
        after = min(end, starts, self._task.next_event(cycle), self._schedule.next_event(cycle))
        robot, task, axes = self._robot, self._task, self._axes
        one_by_one = robot.observed or bool(self._requested) or self._settles(cycle)
        one_by_one = one_by_one or self._world is not None
        if after <= cycle or one_by_one or not axes.is_checked(robot.status.tolist()):
            self._make_room(cycle + 1)
            self._requested.note_begin()
            self._begin(cycle)
            self._evaluate(cycle)
            self._requested.note_end(task, axes)
            return cycle + 1
        after = min(after, max(2 * cycle, self._signals.shape[1]))
        self._make_room(after)
        robot.received[:] = 1
        machine = robot.record, robot.plant.built, robot.currents
        command = task.control(cycle), task.record, task.timeline.arrays, task.learned.torques
        reached = int(run_stretch((cycle, after), *command, *machine, self._signals, self._rotary()))
        axes.accept_cycles(reached - cycle, robot.answers, robot.status.tolist())
        if reached == after:
            task.next_cycle = after
            return after
        task.next_cycle = reached + 1
        self._evaluate(reached)
        return reached + 1

    def _settles(self, cycle: int) -> bool:
        """Whether the feedback of a cycle has to be evaluated, because the program waits for the robot."""
        task = self._task
        return task.settling(cycle) and (cycle < task.end_cycle or cycle >= task.last_cycle)

    def _make_room(self, cycles: int) -> None:
        room = self._signals.shape[1]
        if cycles > room:
            larger = np.empty((len(NAMES), max(cycles, 2 * room), 3))
            larger[:, :room] = self._signals
            self._signals = larger
            longer = np.empty((*self._turn_signals.shape[:2], larger.shape[1]))
            longer[:, :, :room] = self._turn_signals
            self._turn_signals = longer

    def _rotary(self) -> tuple[Any, ...]:
        """Return the ``rotary`` argument of the kernels."""
        axes = zip(self._task.rotary, self._turn_signals, strict=True)
        return tuple((axis.turns, axis.record, signals) for axis, signals in axes)

    def _begin(self, cycle: int) -> None:
        """Apply faults, command, and exchange telegrams with the simulated robot."""
        robot = self._robot
        if cycle >= self._schedule.next_cycle:
            self._change_faults(cycle)
        if self._world is not None:
            # outputs of the previous MDT are active now
            self._world.step(cycle, robot.plant.tcp().tolist(), self._task.outputs, robot.turn_rad)
        motors, torques, control, payload, _ = self._task.command(cycle)
        carried = None if self._world is None else self._world.carried_kg
        if carried is not None:
            # the controller only assumes its payload; the plant carries that of the cell
            payload = carried
            robot.grip(carried)
        note_command(cycle, motors, torques, robot.plant.record, self._signals)
        note_supply(cycle, robot.record, self._signals)
        note_temperatures(cycle, robot.record, self._signals)
        for _, axis, signals in self._rotary():
            note_turn_command(cycle, axis, robot.record, signals)
        lost = [self._schedule.telegram(MDT_LOSSES, axis, cycle) for axis in self._names]
        for drive, fault in zip(robot.drives, lost, strict=True):
            if fault is not None and fault.kind not in GARBLED:
                drive.state['mst_losses'] += 1
        robot.cycle(motors, control, payload, [fault is None for fault in lost], torques)
        note_currents(cycle, robot.record, self._signals)

    def _evaluate(self, cycle: int) -> None:
        """Evaluate the feedback that reaches the master, and react to faults."""
        robot, status = self._robot, self._robot.status.tolist()
        for changes, word in zip(self.drive_status, status, strict=False):
            if not changes or changes[-1][1] != word:
                changes.append([cycle, word])
        received = [
            None if self._schedule.telegram(AT_LOSSES, axis, cycle) else (values, word)
            for axis, values, word in zip(self._names, robot.answers.T.tolist(), status, strict=True)
        ]
        if self._must_succeed and cycle >= self._start and not self.stopped:
            self._require_torque(status, cycle)
        starts = NEVER if self.stopped else self._start
        stop = self._controller.evaluate(cycle, received, starts, bool(self.stopped))
        if self._task.tracking.belts and self._world is not None:
            self._task.tracking.observe(cycle, readings(self._world))
        note_answers(cycle, robot.record['answers'][0], self._task.record, self._signals)
        for _, axis, signals in self._rotary():
            note_turn(cycle, axis, robot.record, signals)
        late = stop is not None and stop.fault.code is FaultCode.NOT_IN_POSITION
        if stop is not None and (late or not self._must_succeed):
            causes = [f': {fault_text(robot.drives[axis].fault)}' for axis in self._axes.faulty()]
            self._stop(stop, ''.join(causes[:1]))

    def _change_faults(self, cycle: int) -> None:
        changes, active = self._schedule.due(cycle), self._schedule.active
        for axis, drive in zip(self._names, self._robot.drives, strict=True):
            apply_to_drive(drive.state[0], axis, changes, active)
        apply_to_plant(self._robot.plant.state[0], changes, active)
        apply_to_link(self._robot.link.state[0], active)
        apply_to_temperatures(self._robot.temperatures.bodies, active, self._names)
        for axis, plant in zip(self._names[ARMS:], self._robot.rotary, strict=True):
            apply_to_motors(plant.state[0], active, (axis,))
        for fault, _ in changes:
            if fault.kind == 'emergency_stop':
                self._stop(emergency_stop(cycle))
            if fault.kind == 'payload_lost' and self._world is not None:
                self._world.drop_part(cycle)

    def _stop(self, stop: Stop, cause: str = '') -> None:
        if not self.stopped:
            self.stopped, self.stop_source = f'{stop.fault}{cause}', stop.fault.source
            self.stop_cycle, self._fault_cycle = stop.first, stop.fault.cycle
        self._task.stop_at(stop.first, stop.hard)

    def _require_torque(self, status: Sequence[int], cycle: int) -> None:
        for axis, word, drive in zip(self._names, status, self._robot.drives, strict=True):
            if not in_torque(word):
                why = fault_text(drive.fault) if drive.fault else drive.drive_state.name.lower()
                raise RunError(f'{axis} is not enabled in bus cycle {cycle}: {why}')
