"""Connection of the page to a running robot: draws its state and executes UI commands.

The view is an operator like ``delta3 move``, in a separate process.
"""

import math
import signal
import time
from contextlib import suppress

from delta3_pacdrive import interrupts
from delta3_pacdrive.control.messages import STOPS
from delta3_pacdrive.errors import Delta3Error, ProgramError, RunError, RunInterruptedError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.page_commands import IN_MOTION, PageCommands, PageScope
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.clients.robot_reader import RobotReader
from delta3_pacdrive.ros.present_robot import RobotWatch
from delta3_pacdrive.ros.wire import discovery, domain
from delta3_pacdrive.view.controls import END_PROCEDURE, PROCEDURE
from delta3_pacdrive.view.jog import Jog, JogAction, parse
from delta3_pacdrive.view.page import PICTURES_HZ, Page
from delta3_pacdrive.view.scope_panel import BEGIN, END
from delta3_pacdrive.view.values import UiCommand

PICTURE_S = 1.0 / PICTURES_HZ
UNSEEN_S = 0.1  # period while no browser is connected: only the plots are updated
FACTS_S = 0.2
APPEAR_S = 10.0  # timeout for finding a robot, unless one is being started
GONE_S = 2.0  # without a browser before motion of the page is held; a page may reload within this time
WAITING_MAX = 20  # requests of all browsers
RELEASE_S = 0.5  # at standstill before the page releases control


class LiveView:
    """Draws a robot on a page and executes the page's commands until it is stopped."""

    def __init__(self, page: Page, robot: RobotReader, process: node_process.Process) -> None:
        self._page, self._robot, self._process = page, robot, process
        self._operator = robot.operator
        self._operator.show = page.report
        self._jog = Jog()
        self._commands = PageCommands(page, robot, self._jog)
        self._scope = PageScope(page, robot)
        self._watch = RobotWatch(robot.operator, page.report, PICTURE_S, process)
        self._progress_s = robot.operator.progress_s  # of the newest report
        self._session = ''
        self._path_changes = self._cell_changes = 0  # change counters of the drawn path and cell
        self._drawn_s = self._read_s = 0.0
        self._watched_s = time.monotonic()
        self._waiting: list[UiCommand] = []
        self._stopping = False

    def stop(self) -> None:
        """Make ``run`` return."""
        self._stopping = True

    def run(self, patience_s: float) -> None:
        """Draw until stopped or until the process has to rejoin the domain; raises RunError if no robot is found.

        A stop holds the motion that the page has started.
        """
        try:
            self._loop(time.monotonic() + patience_s)
        except RunInterruptedError:
            self._stopping = False
            self._scope.close()
            self._end()

    def _loop(self, deadline: float) -> None:
        found = False
        while True:
            self.spin_for(PICTURE_S)
            if self._operator.progress_s > self._progress_s:
                self._progress_s = self._operator.progress_s
                self._watch.received()
            self._watch.update()
            if self._process.rejoins:
                return
            found = found or self._robot.available
            if not found and time.monotonic() > deadline:
                raise RunError(f'no robot is up in namespace {self._operator.get_namespace()} (delta3 up)')
            if self._waiting:
                self._commands.execute(self._waiting.pop(0))
            self._release_control()

    def _end(self) -> None:
        """Hold motion started by the page, and release control."""
        if not self._operator.in_control:
            return
        with suppress(Delta3Error):  # the robot is at rest
            self._operator.call('hold')
        with suppress(Delta3Error):
            self._operator.release_control()

    def spin_for(self, seconds: float) -> None:
        """Spin, draw when a picture is due, and handle stop commands, also during blocking calls."""
        end = time.monotonic() + seconds
        period_s = PICTURE_S if self._page.watched else UNSEEN_S
        while True:
            now = time.monotonic()
            self._process.spin_for(max(0.0, min(end, self._drawn_s + period_s) - now))
            now = time.monotonic()
            if now >= self._drawn_s + period_s:
                # on a grid, so that one late picture does not delay all later ones; missed pictures are skipped
                self._drawn_s = max(self._drawn_s + period_s, now - period_s)
                self._draw(now)
                self._scope.update()
            self._sort_commands()
            if self._stopping or now - self._watched_s > GONE_S:
                self._commands.end_procedure()
            if self._stopping and not self._commands.urgent and not self._jog.may_move:
                raise RunInterruptedError(interrupts.sentence(interrupts.asked() or signal.SIGINT))
            if now >= end:
                return

    def _draw(self, now: float) -> None:
        robot, page = self._robot, self._page
        if robot.update_parameters():
            page.use(robot.parameters)
            page.show_path(robot.planned.points_m)
        session = self._operator.progress.session
        if session != self._session:
            self._session = session
            page.clear_history()
        instant = robot.instant()
        if robot.cell.now.changes != self._cell_changes:
            self._cell_changes = robot.cell.now.changes
            page.show_cell(robot.cell.now.things)
        if instant is not None:
            page.show(instant)
        if now - self._read_s >= FACTS_S:
            self._read_s = now
            page.read(robot.facts())
            if robot.planned.changes != self._path_changes:
                self._path_changes = robot.planned.changes
                page.show_path(robot.planned.points_m)
        if page.watched:
            self._watched_s = now

    # commands ---------------------------------------------------------------------------------------------------------

    def _sort_commands(self) -> None:
        """Sort commands of the page: button heartbeats take effect immediately, stops overtake all others."""
        while self._page.commands:
            command = self._page.commands.popleft()
            if command.action == 'press':
                self._press(command)
            elif command.action == BEGIN:  # observing requires no control and is not queued
                self._scope.begin(command.text)
            elif command.action == END:
                self._scope.end()
            elif command.action == END_PROCEDURE:
                self._end_procedure()
            elif command.action in STOPS:  # executed immediately
                self._waiting.clear()
                self._jog.cancel()
                self._commands.stop(command)
                self._commands.show_override()
            else:
                self._append(command)
        if self._stopping:
            self._jog.cancel()
        action = self._jog.update(time.monotonic())
        self._waiting = [w for w in self._waiting if w.action != 'jog' or self._jog.is_pending(int(w.text))]
        if action is JogAction.START:
            self._waiting.append(UiCommand('jog', str(self._jog.number)))
        elif action is JogAction.STOP:
            self._commands.stop_jog()

    def _press(self, command: UiCommand) -> None:
        try:
            direction, (speed,) = parse(command.text, 1)
        except ProgramError as error:
            self._page.report(str(error), refused=True)
            return
        self._commands.jog_speed_m_s = 1e-3 * speed
        self._jog.heartbeat(direction, command.time_s)
        self._commands.jog_on(direction)

    def _end_procedure(self) -> None:
        if self._commands.procedure:
            self._commands.end_procedure()
        else:
            self._page.report('the page executes no procedure', refused=True)

    def _append(self, command: UiCommand) -> None:
        """Queue a command; of several overrides only the newest is kept."""
        actions = [waiting.action for waiting in self._waiting]
        if self._commands.procedure or PROCEDURE in actions:
            running = self._commands.procedure or 'a procedure'
            self._page.report(f'{command.action} is rejected: {running} is in progress', refused=True)
        elif command.action == 'override' and 'override' in actions:
            self._waiting[actions.index('override')] = command
        elif len(self._waiting) >= WAITING_MAX:
            self._page.report(
                f'{len(self._waiting)} commands are queued: {command.action} is rejected', refused=True
            )
        else:
            self._waiting.append(command)

    def _release_control(self) -> None:
        """Hold the robot when no browser is connected, and release control once it is at rest."""
        now = time.monotonic()
        if not self._operator.in_control:
            return
        if self._operator.state in IN_MOTION or self._jog.may_move:
            self._commands.moving_s = now
            if self._operator.state in ('moving', 'steered') and now - self._watched_s > GONE_S:
                self._commands.stop(UiCommand('hold'))
        elif not self._waiting and now - self._commands.moving_s > RELEASE_S:
            try:
                self._operator.release_control()
            except Delta3Error:
                self._operator.in_control = False


def run(page: Page, parameters: Parameters, namespace: str, patience_s: float = APPEAR_S) -> None:
    """Show a running robot until a signal ends it; motion started by the page is then held.

    Parameters
    ----------
    parameters
        Used until the robot has published its own.
    patience_s
        Timeout for finding the robot [s].

    Raises
    ------
    RunError
        No robot is found.

    """
    absolute = domain.namespace(namespace)
    discovery.keep_to_this_machine()
    shown: list[LiveView] = []

    def stop() -> None:
        for view in shown:
            view.stop()

    with interrupts.answered_by(stop, interrupts.PATIENCE_S):
        while True:
            node_process.join()
            process = node_process.Process()
            operator = OperatorNode(process.spin_for, namespace=absolute)
            process.add(operator)
            robot = RobotReader(operator, parameters)
            shown[:] = [LiveView(page, robot, process)]
            operator.spin_for = shown[0].spin_for
            try:
                if interrupts.asked():
                    stop()
                shown[0].run(patience_s)
            finally:
                node_process.leave(process)
            if not process.rejoins:
                return
            parameters, patience_s = robot.parameters, math.inf
