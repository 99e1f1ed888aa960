"""Commands from the web page: sends each to the robot and shows the reply.

The oscilloscope of the page requests samples from the drives like ``delta3 scope``, without blocking the view. It does
not require control of the robot. All browsers share one oscilloscope.
"""

import json
import time
from contextlib import suppress
from typing import Any

import numpy as np
from rclpy.publisher import Publisher

from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.errors import (
    Code,
    Delta3Error,
    ProgramError,
    RefusedError,
    RunError,
    RunInterruptedError,
    shown,
)
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.units import millimetres
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording.acquisition import Acquisition, Mode, Record, Setting
from delta3_pacdrive.ros.clients.procedure_client import execute, is_procedure
from delta3_pacdrive.ros.clients.robot_reader import RobotReader
from delta3_pacdrive.ros.clients.scope_client import NO_ANSWER, NO_DRIVES, ScopeClient, awaited
from delta3_pacdrive.ros.wire.interfaces import SCOPE_REQUEST
from delta3_pacdrive.view.controls import PROCEDURE, PROCEDURE_NAMES
from delta3_pacdrive.view.jog import DIRECTIONS, JOG_LIMITS, JOG_SPEED_MAX_M_S, Jog, parse
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.scope_panel import caption, setting_of
from delta3_pacdrive.view.values import UiCommand

STARTS = ('start', 'resume')
CLEARED_S = 1.0  # timeout for the report of an empty queue after a clear
STANDSTILL_S = 3.0  # timeout for a robot to come to rest after it has accepted a stop
REPORTS = 2  # reports to wait for after a stop: the first may have been sent before it
IN_MOTION = ('moving', 'steered', 'stopping')
NAME = 'delta3 view'
PATIENCE_S = 10.0  # timeout for the drives' replies
ROLLED_S = 0.5  # refresh period of a rolling oscilloscope
LEFT_S = 2.0  # without a browser before a rolling recording is ended


class PageCommands:
    """Executes the commands of one page."""

    def __init__(self, page: Page, robot: RobotReader, jog: Jog) -> None:
        self._page, self._robot, self._jog = page, robot, jog
        self._operator = robot.operator
        self._send_velocity = robot.operator.velocities()
        self.jog_speed_m_s = 0.05
        self.moving_s = time.monotonic()  # time of the last command that may move the robot
        self.urgent = False  # the current wait must not be interrupted
        self._stops: set[str] = set()  # pending stop requests
        self.procedure = ''  # axis and name of the procedure in progress, empty without one
        self._procedure_ends = False  # its end is requested

    def execute(self, command: UiCommand) -> None:
        """Execute a command and show the reply; raises RunInterruptedError if a signal arrives meanwhile."""
        try:
            sentence = self._execute(command)
        except RunInterruptedError:
            raise
        except Delta3Error as error:
            if command.action == 'jog':
                self._fail_jog(int(command.text), error)
            elif command.action == 'override':
                self.show_override()
            self._page.report(str(error), refused=True)
            return
        if sentence:
            self._page.report(sentence)

    def stop(self, command: UiCommand) -> None:
        """Stop the robot, even during another blocking request, and show the reply."""
        if command.action in self._stops:  # already pending
            return
        try:
            self._ask_for_stop(command.action)
        except (RunError, ProgramError) as error:
            self._page.report(str(error), refused=True)

    def _ask_for_stop(self, action: str) -> None:
        """Request a stop and show that it was accepted."""
        self._stops.add(action)
        try:
            self._page.report(self._uninterrupted(action))
        finally:
            self._stops.remove(action)

    def stop_jog(self) -> None:
        """Stop a jog motion and wait for standstill; while the button is held, the jog then starts again.

        Without a reply the stop is requested again while the robot may move.
        """
        if 'abort' in self._stops:  # pending from another command, with unknown outcome
            self._jog.unconfirmed()
            return
        try:
            with suppress(ProgramError):  # already at rest
                self._ask_for_stop('abort')
                self._wait_for_standstill()
        except RunError as error:
            self._page.report(str(error), refused=True)
            if self._robot.available and self._operator.progress.state in IN_MOTION:
                self._jog.unconfirmed()
                return
        self._jog.stopped(time.monotonic())

    def _wait_for_standstill(self) -> None:
        """Wait for standstill after an accepted stop; a timeout is ignored (other motion, or no reports)."""
        seen = [self._operator.progress]

        def is_at_rest() -> bool:
            if self._operator.progress is not seen[-1]:
                seen.append(self._operator.progress)
            return len(seen) > REPORTS and self._operator.progress.state not in IN_MOTION

        with suppress(RunError):
            self._operator.wait_until(is_at_rest, 'report of standstill', STANDSTILL_S)

    def _uninterrupted(self, action: str, text: str = '') -> str:
        """Send a request whose outcome must be known, even if a signal arrives meanwhile."""
        before, self.urgent = self.urgent, True
        try:
            return self._operator.call(action, text)
        finally:
            self.urgent = before

    def _fail_jog(self, number: int, error: Delta3Error) -> None:
        """Record that a jog request was rejected, or that its outcome is unknown."""
        silent = isinstance(error, RefusedError) and error.reason.code is Code.SILENT
        if silent or isinstance(error, RunError):
            self._jog.lost(number)
        else:
            self._jog.refused(number)

    def show_override(self) -> None:
        """Set the slider to the robot's actual override."""
        if self._page.controls is not None:
            self._page.controls.show_override()

    def _execute(self, command: UiCommand) -> str:
        """Execute a command; return the reply."""
        operator, text = self._operator, command.text
        if command.action == 'inject':
            return operator.inject(text)
        if command.action == 'input':
            return operator.input(text)
        if command.action == 'teach':
            return self._teach(text)
        if command.action == 'forget':
            return self._clear_points()
        if command.action == 'jog' and not self._jog.is_pending(int(text)):
            return ''
        if command.action == PROCEDURE:
            return self._execute_procedure(text, command.by_force)
        if not operator.in_control:
            operator.take_control(NAME, command.by_force)
        self.moving_s = time.monotonic()
        if command.action == 'packaged':
            return operator.send_program(self._packaged(text))
        if command.action == 'program':
            return operator.send_program(text)
        if command.action == 'override':
            return operator.override(float(text))
        if command.action == 'step':
            return self._step(text)
        if command.action == 'jog':
            return self._start_jog(int(text))
        if command.action in STARTS:
            return self._uninterrupted(command.action)
        return operator.call(command.action)

    def _execute_procedure(self, text: str, by_force: bool) -> str:
        """Execute a procedure command of a drive; return its result.

        The robot rejects procedures while an operator has control, so the page takes control and releases it.
        """
        axis, _, idn = text.partition(' ')
        if axis not in self._robot.parameters.axes or idn not in PROCEDURE_NAMES:
            raise ProgramError(f'{shown(text)} is not an axis and a procedure command')
        operator = self._operator
        self.procedure, self._procedure_ends = f'{axis}: {idn} {PROCEDURE_NAMES[idn]}', False
        try:
            if not operator.in_control:
                operator.take_control(NAME, by_force)
            operator.release_control()
            if not is_procedure(idn):
                return operator.drive(f'{axis} command {idn}')
            self.urgent = True  # a signal interrupts the procedure in the drive first
            result = execute(
                operator,
                axis,
                idn,
                lambda step: self._page.report_procedure(axis, step),
                cancelled=lambda: self._procedure_ends,
            ).text
        except Delta3Error as error:
            self._page.report_procedure(axis, str(error), failed=True)
            raise
        finally:
            self.procedure, self.urgent = '', False
        self._page.report_procedure(axis, result)
        return result

    def end_procedure(self) -> None:
        """Let the procedure in progress, if any, be interrupted."""
        self._procedure_ends = True

    def _packaged(self, name: str) -> str:
        if name not in program_names():  # the page may send any text
            raise ProgramError(f'there is no packaged program {shown(name)}')
        try:
            return program_file.find(name).read_text(encoding='utf-8')
        except OSError as error:
            raise ProgramError(f'the program {name} cannot be read: {error.strerror}') from None

    def _send_line(self, to: Any, speed_m_s: float) -> None:
        """Send a slow straight line with a soft stop."""
        queue = self._operator.queue
        if queue is not None and queue.moves:
            raise ProgramError(f'{counted(queue.moves, "move")} in the queue: clear it before you jog')
        move = {'to_m': to, 'speed_m_s': speed_m_s, **JOG_LIMITS}
        self._operator.send_program(json.dumps({'moves': [{'move_l': move}]}))

    def _step(self, text: str) -> str:
        direction, (step, speed) = parse(text, 2)
        way = 1e-3 * step * np.array(DIRECTIONS[direction])
        self._send_line({'by_m': way.tolist()}, 1e-3 * speed)
        return self._start_line()

    def _start_jog(self, number: int) -> str:
        """Let velocities move the robot; releasing the button stops it."""
        if not self._jog.start(number):
            return ''
        limits = {'speed_m_s': JOG_SPEED_MAX_M_S, **JOG_LIMITS}
        sentence = self._uninterrupted('steer', json.dumps(limits))
        self._jog.accepted(number)
        return sentence

    def jog_on(self, direction: str) -> None:
        """Move on in the direction of the button that is held."""
        if self._jog.velocity is not None and direction == self._jog.direction:
            x, y, z = (self.jog_speed_m_s * component for component in self._jog.velocity)
            self._send_velocity(x, y, z)

    def _start_line(self) -> str:
        """Start the line; if the start is rejected, remove the line from the queue."""
        try:
            return self._uninterrupted('start')
        except ProgramError:
            self._remove_line()
            raise

    def _remove_line(self) -> None:
        with suppress(Delta3Error):
            self._uninterrupted('clear')
            self._operator.wait_until(self._queue_is_empty, 'report of an empty queue', CLEARED_S)

    def _queue_is_empty(self) -> bool:
        queue = self._operator.queue
        return queue is None or not queue.moves

    def _tcp(self) -> Floats:
        """Return the TCP position [m]; raises RunError without a robot."""
        if not self._robot.available:
            raise RunError('there is no robot')
        place = np.array(self._operator.progress.tcp_m, dtype=np.float64)
        if not np.isfinite(place).all():
            raise RunError(
                'robot pose unknown: it is not measured yet, or forward kinematics has no solution'
            )
        return place

    def _teach(self, name: str) -> str:
        if not name.strip() or not name.isprintable():
            raise ProgramError('a point needs a name')
        x, y, z = self._tcp().tolist()
        if self._page.controls is not None:
            self._page.controls.teach(name.strip(), (x, y, z))
        return f'{name.strip()} is at {millimetres((x, y, z))}'

    def _clear_points(self) -> str:
        if self._page.controls is not None:
            self._page.controls.clear_points()
        return 'all points are deleted'


class PageScope:
    """The oscilloscope of a page, started and ended by UI commands and updated between pictures."""

    def __init__(self, page: Page, robot: RobotReader) -> None:
        self._page, self._robot = page, robot
        # shared by all clients: the end of one recording must be received before the start of the next
        self._requests: Publisher | None = None
        self._client: ScopeClient | None = None
        self._acquisition: Acquisition | None = None
        self._setting: Setting | None = None
        self._began_s = self._drawn_s = self._watched_s = 0.0

    def begin(self, text: str) -> None:
        """Start the requested recording, replacing the current one."""
        self._detach()
        try:
            self._setting = setting_of(text, self._robot.parameters)
        except Delta3Error as error:
            self._report(str(error), refused=True)
            return
        operator = self._robot.operator
        if self._requests is None:
            self._requests = SCOPE_REQUEST.publisher(operator)
        self._client = ScopeClient(operator, self._setting, self._take, self._requests)
        self._began_s = self._watched_s = time.monotonic()
        self._report('asking the drives')

    def end(self) -> None:
        """End the current recording; a rolling oscilloscope keeps its last picture."""
        client, acquisition = self._client, self._acquisition
        if client is None:
            self._report('nothing is recorded')
            return
        if acquisition is None:
            self._report('ended before the drives answered')
        elif acquisition.setting.mode is Mode.ROLLING or acquisition.records:
            acquisition.finish()
        else:
            self._report(f'ended while {awaited(acquisition)}')
        self._detach()

    def close(self) -> None:
        """Disarm the drives before the view ends."""
        client, self._client = self._client, None
        if client is not None:
            with suppress(Delta3Error):  # interrupted by a signal
                client.disarm()

    def update(self) -> None:
        """Continue the current recording."""
        if self._client is None:
            return
        try:
            self._continue(self._client)
        except Delta3Error as error:
            self._detach()
            self._report(str(error), refused=True)

    def _continue(self, client: ScopeClient) -> None:
        now = time.monotonic()
        if self._page.watched:
            self._watched_s = now
        if self._acquisition is None:
            self._arm(client, now)
            return
        client.receive_samples(self._acquisition)
        if self._acquisition.done:
            self._detach()
        elif self._acquisition.setting.mode is Mode.ROLLING:
            if now - self._watched_s > LEFT_S:
                self.end()
            elif now - self._drawn_s > ROLLED_S and (record := self._acquisition.newest()) is not None:
                self._drawn_s = now
                self._draw(record)

    def _arm(self, client: ScopeClient, now: float) -> None:
        reached = client.reaches_drives
        if reached and (acquisition := client.armed()) is not None:
            self._acquisition, trigger = acquisition, acquisition.setting.trigger
            self._report(f'waiting for {trigger.sentence}' if trigger else 'recording')
        elif now - self._began_s > PATIENCE_S:
            where = self._robot.operator.get_namespace()
            raise RunError(
                f'no {NO_ANSWER if reached else NO_DRIVES} within {PATIENCE_S:g} s: is a robot up in namespace {where}?'
            )

    def _take(self, record: Record) -> None:
        self._draw(record)
        self._report(caption(record))

    def _draw(self, record: Record) -> None:
        if self._page.scope is not None:
            self._page.scope.show(record)

    def _report(self, sentence: str, refused: bool = False) -> None:
        self._page.report_scope(sentence, refused)

    def _detach(self) -> None:
        if self._client is not None:
            self._client.detach()
        self._client = self._acquisition = None
