"""An automated operator: restarts a robot after any fault, as a human operator would."""

import json
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, RefusedError, RobotFault, RunError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.configuration_check import PLANT
from delta3_pacdrive.ros.clients.robot_client import OperatorNode

# wall-clock timeout of every wait, also on a busy machine
PATIENCE_S = 60.0
THERE_M = 1e-4  # tolerance of a position at rest: no move is necessary
ATTEMPTS = 3  # a fault may be injected during the recovery from another one
RESET_S = 1.0  # wall time before a reset is tried again
RECOVERY_M_S = 1.0
EXPLANATION_S = 0.1  # bus time in which the master reads the fault numbers of the drives


class AutomatedOperator:
    """An operator in the process of the bring-up; subclasses evaluate the messages of the robot."""

    def __init__(self, bringup: Bringup) -> None:
        self._bringup = bringup
        self.operator = OperatorNode(self.spin, namespace=bringup.node.get_namespace())
        bringup.add(self.operator)

    def update(self) -> None:
        """Process received messages; called during every wait."""

    def spin(self, seconds: float) -> None:
        """Process messages of all nodes for a while; raises KeyboardInterrupt after a signal."""
        self._bringup.poll(seconds)
        if self._bringup.interrupted:
            raise KeyboardInterrupt
        self.update()

    @property
    def progress(self) -> MotionProgress:
        """The newest progress report."""
        return self.operator.progress

    def fresh(self) -> MotionProgress:
        """Wait for the next progress report and return it."""
        before = self.progress
        self.wait(lambda: self.progress is not before, 'motion/progress')
        return self.progress

    def wait(self, condition: Callable[[], Any], what: str) -> None:
        """Wait for a condition; raises RunError after a timeout."""
        self.operator.wait_until(condition, what, PATIENCE_S)

    def mdt_losses(self, axis: str) -> int:
        """Return the number of MDT that a drive has missed since its start (S-0-0029)."""
        answer = self.operator.drive(f'{axis} read S-0-0029')
        return int(float(answer.rpartition('= ')[2].split()[0]))

    def is_at_rest(self) -> bool:
        """Whether the robot is at rest: no motion, or without torque after a fault."""
        if self.progress.fault:
            return not self.progress.in_torque
        return self.operator.state in ('idle', 'stopped')

    def let_pass(self, seconds: float) -> None:
        """Wait for a duration of bus time [s]."""
        end = self.fresh().bus_time_s + seconds
        self.wait(lambda: self.progress.bus_time_s >= end or self.progress.phase != 'CP4', 'bus time')

    def make_ready(self, home_m: Sequence[float]) -> None:
        """Bring the robot to a position, enabled and without faults; raises Delta3Error."""
        for _ in range(ATTEMPTS):
            self._try_to_make_ready(home_m)
            if not self.fresh().fault:
                return
        raise ProgramError(self.progress.fault)

    def _try_to_make_ready(self, home_m: Sequence[float]) -> None:
        operator = self.operator
        self.wait(lambda: self.fresh().phase == 'CP4', 'cyclic operation')
        operator.inject('fault: clear')
        self.let_pass(0.1)
        if self.fresh().fault:
            self._reset()
        if operator.state in ('stopped', 'stopping', 'moving'):
            self.wait(lambda: operator.state != 'stopping', 'standstill')
            self.call('abort')
            self.wait(lambda: operator.state == 'idle', 'end of the program')
        if not self.fresh().in_torque:
            operator.enable(True)
            self.wait(lambda: self.fresh().in_torque, 'torque')
        try:
            self.drive([{'move_l': {'to_m': list(home_m), 'speed_m_s': RECOVERY_M_S}}])
        except ProgramError:
            place = self.progress.tcp_m
            if place is None or math.dist(place, home_m) > THERE_M:
                raise
        self.wait(lambda: operator.state in ('idle', 'error'), 'end of the motion')

    def _reset(self) -> None:
        """Reset the fault repeatedly until its cause has been removed."""
        deadline = time.monotonic() + PATIENCE_S
        while self.fresh().fault:
            try:
                self.operator.call('reset')
                self.operator.wait_until(lambda: not self.fresh().fault, 'end of the fault', RESET_S)
            except Delta3Error:
                if time.monotonic() > deadline:
                    raise

    def replace_the_machine(self) -> None:
        """Replace the plant, by killing its process, if the robot cannot be moved any more.

        Without cyclic operation the command is rejected: the bus then restarts by itself, or the next attempt fails.
        """
        with suppress(Delta3Error):
            self.operator.inject(json.dumps({'fault': 'kill', 'node': PLANT}))

    def drive(self, moves: list[dict[str, Any]], faults: Sequence[dict[str, Any]] = (), **more: Any) -> None:
        """Send and start a program of moves with timed faults; raises ProgramError if it is rejected."""
        operator = self.operator
        self.wait(lambda: operator.state == 'idle' or self.progress.fault, 'idle robot')
        self._send(json.dumps({'moves': moves, 'faults': list(faults), **more}))
        before = operator.state_changes
        try:
            self.call('start')
        except Delta3Error:
            # remaining moves would precede those of the next program
            with suppress(Delta3Error):
                operator.call('clear')
            raise
        self.wait(lambda: operator.state_changes > before or self.progress.fault, 'start')

    def _send(self, document: str) -> None:
        """Send a program; a restarted planner may have missed it, or may not know the robot yet."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                self.operator.send_program(document)
                return
            except (RunError, ProgramError) as error:
                refused = error.reason.code if isinstance(error, RefusedError) else None
                unheard = isinstance(error, RunError) or refused is Code.BUS
                if not unheard or time.monotonic() > deadline:
                    raise
                self.fresh()

    def call(self, name: str) -> None:
        """Call a service; a planner that has hung accepts requests again after its next heartbeat."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                self.operator.call(name)
                return
            except RefusedError as error:
                for_good = error.reason.code is not Code.BUS or self.fresh().fault
                if for_good or time.monotonic() > deadline:
                    raise

    @property
    def fault(self) -> RobotFault | None:
        """The fault that has stopped the robot, from the newest report."""
        return RobotFault.of(vars(self.progress), self.progress.fault)

    def observe(self, seconds: float) -> RobotFault | None:
        """Wait for a fault that stops the robot, or for some bus time and standstill; return the fault."""
        started: float | None = None  # bus time at the start of cyclic operation
        over = time.monotonic() + PATIENCE_S
        while time.monotonic() < over:
            progress = self.fresh()
            if progress.phase != 'CP4':
                started = None
            elif started is None:
                started = progress.bus_time_s
            if progress.fault:
                self.wait(lambda: not self.fresh().in_torque, 'standstill')
                self.let_pass(EXPLANATION_S)
                break
            passed = 0.0 if started is None else progress.bus_time_s - started
            if passed > seconds and self.operator.state != 'moving':
                break
        return self.fault


def run_operated(bringup: Bringup, operate: Callable[[], None]) -> None:
    """Start a robot, operate it and end it; raises KeyboardInterrupt if a signal ends it early."""
    operated = False

    def script(_: MotionProgress) -> None:
        nonlocal operated
        if not operated:
            operated = True
            operate()
            bringup.stop()

    try:
        bringup.run(script)
    except RunError:
        if bringup.interrupted and not operated:
            raise KeyboardInterrupt from None
        raise
