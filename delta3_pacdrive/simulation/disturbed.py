"""A program with injected faults, without ROS: cycle by cycle as the nodes do, to its end or to standstill."""

from collections.abc import Sequence

import numpy as np

from delta3_pacdrive.controller.cycle import ControllerCycle, Stop, emergency_stop
from delta3_pacdrive.controller.transformation import (
    FOLLOWING_ERROR,
    TCP_ACTUAL,
    TCP_COMMAND,
    TCP_ERROR,
    Transformation,
)
from delta3_pacdrive.drive.diagnostics import fault_text
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.faults.effects import apply_to_drive, apply_to_plant
from delta3_pacdrive.faults.fault import AT_LOSSES, MDT_LOSSES, PROCESS_FAULTS, Fault
from delta3_pacdrive.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.signals import SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.simulation.robot import AXES, Robot

REST_S = 1.0  # without torque, in which a machine comes to rest


class Disturbed:
    """A run with faults.

    Attributes
    ----------
    stopped
        Why the program was given up, empty while it was not.

    """

    def __init__(
        self, faults: Sequence[Fault], robot: Robot, task: Transformation, parameters: Parameters
    ) -> None:
        self._robot, self._task, self._parameters = robot, task, parameters
        self._start = parameters.motion.start_cycle
        self._schedule = Schedule()
        for fault in faults:
            if fault.kind in PROCESS_FAULTS:
                raise RunError(f'{fault.text}: a simulation has no processes, use delta3 run')
            self._schedule.add(Scheduled.of(fault, self._start, parameters.bus.cycle_time_s))
        self._axes = AxisMonitor(parameters)
        self._controller = ControllerCycle(task, self._axes, parameters)
        self._answers = np.empty((3, 3))
        self.stopped = ''

    @property
    def lost(self) -> int:
        """AT that did not reach the master."""
        return sum(self._axes.losses)

    def run(self) -> dict[str, Floats]:
        """Run to the end; return the signals, torques [N m] in place of currents."""
        names = (*SIGNALS, *TRUE_SIGNALS)
        rows: list[list[Floats]] = [[] for _ in names]
        rest_cycles = round(REST_S / self._parameters.bus.cycle_time_s)
        cycle, last = 0, NEVER
        while cycle <= min(last, NEVER if self.stopped else self._task.last_cycle):
            for column, value in zip(rows, self._cycle(cycle), strict=True):
                column.append(value)
            if self.stopped and last == NEVER and self._without_torque():
                last = cycle + rest_cycles
            cycle += 1
        return {name: np.array(column) for name, column in zip(names, rows, strict=True)}

    def _without_torque(self) -> bool:
        return self._task.enable_cycle == NEVER and not any(drive.powered for drive in self._robot.drives)

    def _cycle(self, cycle: int) -> list[Floats]:
        """Run one bus cycle; return its row of every signal."""
        robot, schedule = self._robot, self._schedule
        if cycle >= schedule.next_cycle:
            self._change_faults(cycle)
        motors, control, payload = self._controller.command(cycle)
        motors = motors.copy()
        shafts, arms, true_tcp = np.array(robot.plant.shafts()), robot.plant.arm_angles(), robot.plant.tcp()
        heard = [schedule.telegram(MDT_LOSSES, axis, cycle) is None for axis in AXES]
        status = robot.cycle(motors, control, self._answers, payload, heard)
        answers = self._answers.copy()
        received = [
            None if schedule.telegram(AT_LOSSES, axis, cycle) else (answers[:, index].tolist(), status[index])
            for index, axis in enumerate(AXES)
        ]
        starts = NEVER if self.stopped else self._start
        stop = self._controller.evaluate(cycle, received, starts, bool(self.stopped))
        answer = self._task.answer.copy()
        if stop is not None:
            names = [f': {fault_text(robot.drives[n].fault)}' for n in self._axes.faulty()]
            self._stop(stop, ''.join(names[:1]))
        tcp = [answer[columns] for columns in (FOLLOWING_ERROR, TCP_COMMAND, TCP_ACTUAL, TCP_ERROR)]
        return [motors, *answers, *tcp, *np.split(shafts, 3), arms, true_tcp]

    def _change_faults(self, cycle: int) -> None:
        nominal = self._parameters.drive.dc_link_voltage_v
        changes, active = self._schedule.due(cycle), self._schedule.active
        for axis, drive in zip(AXES, self._robot.drives, strict=True):
            apply_to_drive(drive.state[0], axis, changes, active, nominal)
        apply_to_plant(self._robot.plant.state[0], changes, active)
        for fault, _ in changes:
            if fault.kind == 'emergency_stop':
                self._stop(emergency_stop(cycle))

    def _stop(self, stop: Stop, cause: str = '') -> None:
        self.stopped = self.stopped or stop.reason + cause
        self._task.stop_at(stop.first, stop.hard)


def run_disturbed(
    faults: Sequence[Fault], robot: Robot, task: Transformation, parameters: Parameters
) -> tuple[dict[str, Floats], str, int]:
    """Run a loaded and started program with faults; return signals, why it was stopped, and how many AT were lost.

    Raises
    ------
    RunError
        A fault concerns a process: here there is only one.

    """
    disturbed = Disturbed(faults, robot, task, parameters)
    return disturbed.run(), disturbed.stopped, disturbed.lost
