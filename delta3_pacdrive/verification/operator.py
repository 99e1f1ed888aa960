"""An operator without hands: stays with a robot and gets it going again whatever has happened, as people do."""

import json
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, RefusedError, RobotFault, RunError
from delta3_pacdrive.ros.robot_client import OperatorNode
from delta3_pacdrive.sercos.configuration_check import PLANT

# wall time in which everything has to be as before, also on a machine that has other things to do
PATIENCE_S = 60.0
THERE_M = 1e-4  # by which a robot that stands at a place may be off it: it need not move there
ATTEMPTS = 3  # a fault may be injected while the last one is overcome
RESET_S = 1.0  # wall time after which a reset is tried again
RECOVERY_M_S = 1.0
EXPLANATION_S = 0.1  # bus time in which the master asks the drives for the number of their faults


class AutomatedOperator:
    """The operator lives in the process that brought the robot up; subclasses look at what the robot publishes.

    Attributes
    ----------
    operator
        Its node.

    """

    def __init__(self, bringup: Bringup) -> None:
        self._bringup = bringup
        self.operator = OperatorNode(self.spin, namespace=bringup.node.get_namespace())
        bringup.add(self.operator)

    def look(self) -> None:
        """Look at what was published since the last look; called all the time."""

    def spin(self, seconds: float) -> None:
        """Let everybody work for a while; raises KeyboardInterrupt if a signal asks for the end."""
        self._bringup.look(seconds)
        if self._bringup.interrupted:
            raise KeyboardInterrupt
        self.look()

    @property
    def progress(self) -> dict[str, Any]:
        """The newest progress."""
        return self.operator.progress

    def fresh(self) -> dict[str, Any]:
        """Wait for the next progress and return it."""
        before = self.progress
        self.wait(lambda: self.progress is not before, 'motion/progress')
        return self.progress

    def wait(self, condition: Callable[[], Any], what: str) -> None:
        """Wait for a condition; raises RunError when patience is over."""
        self.operator.wait_until(condition, what, PATIENCE_S)

    def mdt_losses(self, axis: str) -> int:
        """MDT that a drive has missed since its start (S-0-0029)."""
        answer = self.operator.drive(f'{axis} read S-0-0029')
        return int(float(answer.rpartition('= ')[2].split()[0]))

    def stands(self) -> bool:
        """Whether nothing moves: no program is under way, or a fault has taken the torque off."""
        if self.progress['fault']:
            return not self.progress['in_torque']
        return self.operator.state in ('idle', 'stopped')

    def let_pass(self, seconds: float) -> None:
        """Let bus time pass."""
        end = self.fresh()['bus_time_s'] + seconds
        self.wait(lambda: self.progress['bus_time_s'] >= end or self.progress['phase'] != 'CP4', 'bus time')

    def make_ready(self, home_m: Sequence[float]) -> None:
        """Do what has to be done: the robot stands enabled at a place, without faults; raises Delta3Error."""
        for _ in range(ATTEMPTS):
            self._try_to_make_ready(home_m)
            if not self.fresh()['fault']:
                return
        raise ProgramError(self.progress['fault'])

    def _try_to_make_ready(self, home_m: Sequence[float]) -> None:
        operator = self.operator
        self.wait(lambda: self.fresh()['phase'] == 'CP4', 'cyclic operation')
        operator.inject('fault: clear')
        self.let_pass(0.1)
        if self.fresh()['fault']:
            self._reset()
        if operator.state in ('stopped', 'stopping', 'moving'):
            self.wait(lambda: operator.state != 'stopping', 'standstill')
            self.call('abort')
            self.wait(lambda: operator.state == 'idle', 'end of the program')
        if not self.fresh()['in_torque']:
            operator.enable(True)
            self.wait(lambda: self.fresh()['in_torque'], 'torque')
        try:
            self.drive([{'move_l': {'to_m': list(home_m), 'speed_m_s': RECOVERY_M_S}}])
        except ProgramError:
            if math.dist(self.progress['tcp_m'], home_m) > THERE_M:
                raise
        self.wait(lambda: operator.state in ('idle', 'error'), 'end of the motion')

    def _reset(self) -> None:
        """Clear the fault, however often that takes until its cause is gone."""
        deadline = time.monotonic() + PATIENCE_S
        while self.fresh()['fault']:
            try:
                self.operator.call('reset')
                self.operator.wait_until(lambda: not self.fresh()['fault'], 'end of the fault', RESET_S)
            except Delta3Error:
                if time.monotonic() > deadline:
                    raise

    def replace_the_machine(self) -> None:
        """Let a new machine take the place of one that cannot be moved any more; its process is started again.

        Without cyclic operation nobody takes the order: the bus comes up by itself, or the next try says why not.
        """
        with suppress(Delta3Error):
            self.operator.inject(json.dumps({'fault': 'kill', 'node': PLANT}))

    def drive(self, moves: list[dict[str, Any]], faults: Sequence[dict[str, Any]] = (), **more: Any) -> None:
        """Send a program of moves, with faults at their times, and start it; raises ProgramError if it is refused."""
        operator = self.operator
        self.wait(lambda: operator.state == 'idle' or self.progress['fault'], 'idle robot')
        self._send(json.dumps({'moves': moves, 'faults': list(faults), **more}))
        before = operator.state_changes
        try:
            self.call('start')
        except Delta3Error:
            # what waits would go before the moves of the next program, or refuse them
            with suppress(Delta3Error):
                operator.call('clear')
            raise
        self.wait(lambda: operator.state_changes > before or self.progress['fault'], 'start')

    def _send(self, document: str) -> None:
        """Send a program; a planner that was started again may not have heard of it, or not know the robot yet."""
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
        """Ask for what a service does; a planner that has hung is listened to again when it has been heard."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                self.operator.call(name)
                return
            except RefusedError as error:
                for_good = error.reason.code is not Code.BUS or self.fresh()['fault']
                if for_good or time.monotonic() > deadline:
                    raise

    @property
    def fault(self) -> RobotFault | None:
        """The fault that has stopped the robot, as it said last."""
        return RobotFault.of(self.progress, self.progress['fault'])

    def observe(self, seconds: float) -> RobotFault | None:
        """Wait until a fault has stopped the robot, or some bus time is over and nothing moves; return the fault."""
        started: float | None = None  # bus time since which the bus is in cyclic operation
        over = time.monotonic() + PATIENCE_S
        while time.monotonic() < over:
            progress = self.fresh()
            if progress['phase'] != 'CP4':
                started = None
            elif started is None:
                started = progress['bus_time_s']
            if progress['fault']:
                self.wait(lambda: not self.fresh()['in_torque'], 'standstill')
                self.let_pass(EXPLANATION_S)
                break
            passed = 0.0 if started is None else progress['bus_time_s'] - started
            if passed > seconds and self.operator.state != 'moving':
                break
        return self.fault


def run_operated(bringup: Bringup, operate: Callable[[], None]) -> None:
    """Bring a robot up, operate it and end it; raises KeyboardInterrupt if a signal asks for the end before."""
    operated = False

    def script(_: dict[str, Any]) -> None:
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
