"""A robot that is up, on the page: what it tells is drawn, what people ask for on the page is asked of it.

The view is an operator like ``delta3 move``, in a process of its own.
"""

import json
import signal
import time
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from rclpy.signals import SignalHandlerOptions

from delta3_pacdrive import interrupts
from delta3_pacdrive.controller.messages import STOPS
from delta3_pacdrive.errors import Delta3Error, ProgramError, RunError, RunInterruptedError
from delta3_pacdrive.motion import program_file
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import discovery, node_process
from delta3_pacdrive.ros.robot_client import OperatorNode
from delta3_pacdrive.ros.robot_reader import RobotReader
from delta3_pacdrive.view.jog import (
    DIRECTIONS,
    JOG_ACCELERATION_M_S2,
    JOG_JERK_M_S3,
    Button,
    Turn,
    edge,
)
from delta3_pacdrive.view.page import PICTURES_HZ, Page
from delta3_pacdrive.view.values import Wish

PICTURE_S = 1.0 / PICTURES_HZ
UNSEEN_S = 0.1  # between two looks at the robot while nobody watches: only the plots go on
FACTS_S = 0.2
APPEAR_S = 10.0  # for a robot to be found, unless one is being brought up
GONE_S = 2.0  # without a browser, after which what the page has set off is held: a page may be loaded anew meanwhile
RELEASE_S = 0.5  # standing, after which the page gives control back
NAME = 'delta3 view'


class LiveView:
    """The view draws a robot on a page, and carries out what is asked for there, until it is stopped.

    Parameters
    ----------
    page
        Shows it.
    robot
        What is known of it.
    process
        Spins the node.

    """

    def __init__(self, page: Page, robot: RobotReader, process: node_process.Process) -> None:
        self._page, self._robot, self._process = page, robot, process
        self._operator = robot.operator
        self._operator.show = page.tell
        self._button = Button()
        self._jog_speed = 0.05
        self._session = ''
        self._planned = 0  # changes of the path that is drawn
        self._drawn_s = self._read_s = 0.0
        self._moving_s = self._watched_s = time.monotonic()
        self._urgent = False
        self._wishes: list[Wish] = []
        self._stopping = False

    def stop(self) -> None:
        """Let ``run`` end."""
        self._stopping = True

    def run(self, patience_s: float) -> None:
        """Draw until it is stopped; what the page has set off is held then. Raises RunError if no robot is found."""
        try:
            self._go_on(time.monotonic() + patience_s)
        except RunInterruptedError:
            self._stopping = False
            self._end()

    def _go_on(self, deadline: float) -> None:
        found = False
        while True:
            self.spin_for(PICTURE_S)
            found = found or self._robot.here
            if not found and time.monotonic() > deadline:
                raise RunError(f'no robot is up in namespace {self._operator.get_namespace()} (delta3 up)')
            if self._wishes:
                self._carry_out(self._wishes.pop(0))
            self._give_back()

    def _end(self) -> None:
        """Hold what the page has set off, and give control back."""
        with suppress(Delta3Error):
            if self._operator.in_control and self._operator.state == 'moving':
                self._operator.call('hold')
            self._operator.release_control()

    def spin_for(self, seconds: float) -> None:
        """Spin, draw when a picture is due, and stop the robot when that is asked for, whoever waits for what."""
        end = time.monotonic() + seconds
        period_s = PICTURE_S if self._page.watched else UNSEEN_S
        while True:
            now = time.monotonic()
            self._process.spin_for(max(0.0, min(end, self._drawn_s + period_s) - now))
            now = time.monotonic()
            if now >= self._drawn_s + period_s:
                self._drawn_s = now
                self._draw(now)
            self._sort()
            if self._stopping and not self._urgent:
                raise RunInterruptedError(interrupts.sentence(interrupts.asked() or signal.SIGINT))
            if now >= end:
                return

    def _draw(self, now: float) -> None:
        robot, page = self._robot, self._page
        if robot.learn():
            page.use(robot.parameters)
            page.plan(robot.planned.points_m)
        session = str(self._operator.progress.get('session', ''))
        if session != self._session:
            self._session = session
            page.forget()
        instant = robot.instant()
        if instant is not None:
            page.show(instant)
        if now - self._read_s >= FACTS_S:
            self._read_s = now
            page.read(robot.facts())
            if robot.planned.changes != self._planned:
                self._planned = robot.planned.changes
                page.plan(robot.planned.points_m)
        if page.watched:
            self._watched_s = now

    # wishes -----------------------------------------------------------------------------------------------------------

    def _sort(self) -> None:
        """Take wishes from the page: beats of a button count at once, stops overtake all others."""
        now = time.monotonic()
        while self._page.wishes:
            wish = self._page.wishes.popleft()
            if wish.action == 'press':
                direction, speed = wish.text.split()
                self._jog_speed = 1e-3 * float(speed)
                self._button.beat(direction, now)
            elif wish.action in STOPS:  # they wait for nothing that is under way
                self._wishes.clear()
                self._button.drop()
                self._stop(wish)
            else:
                self._wishes.append(wish)
        turn = self._button.look(now)
        if turn is Turn.PRESSED:
            self._wishes.append(Wish('jog', self._button.direction))
        elif turn is Turn.RELEASED:
            self._stop(Wish('abort'), quiet=True)

    def _stop(self, wish: Wish, quiet: bool = False) -> None:
        """Stop the robot, in the middle of whatever else is being waited for."""
        before, self._urgent = self._urgent, True
        try:
            operator = self._operator
            self._page.tell(
                operator.enable(False) if wish.action == 'disable' else operator.call(wish.action)
            )
        except (RunError, ProgramError) as error:
            if not quiet:
                self._page.tell(str(error), refused=True)
        finally:
            self._urgent = before

    def _carry_out(self, wish: Wish) -> None:
        try:
            sentence = self._done(wish)
        except RunInterruptedError:
            raise
        except Delta3Error as error:
            self._button.drop()
            self._page.tell(str(error), refused=True)
            return
        if sentence:
            self._page.tell(sentence)

    def _done(self, wish: Wish) -> str:
        """Carry a wish out; return the answer."""
        operator, text = self._operator, wish.text
        if wish.action == 'inject':
            return operator.inject(text)
        if wish.action == 'teach':
            return self._teach(text)
        if not operator.in_control:
            operator.take_control(NAME, wish.by_force)
        self._moving_s = time.monotonic()
        if wish.action == 'packaged':
            return operator.send_program(program_file.find(text).read_text(encoding='utf-8'))
        if wish.action == 'program':
            return operator.send_program(text)
        if wish.action == 'override':
            return operator.override(float(text))
        if wish.action == 'enable':
            return operator.enable(True)
        if wish.action == 'step':
            direction, step, speed = text.split()
            way = 1e-3 * float(step) * np.array(DIRECTIONS[direction])
            self._send_line({'by_m': way.tolist()}, 1e-3 * float(speed))
            return operator.call('start')
        if wish.action == 'jog':
            return self._jog(text)
        return operator.call(wish.action)

    def _send_line(self, to: Any, speed_m_s: float) -> None:
        """Send a slow straight line that ends softly wherever it is stopped."""
        queue = self._operator.queue
        if queue is not None and queue.moves:
            raise ProgramError(f'there are {queue.moves} moves in the queue: clear it before you jog')
        limits = {
            'speed_m_s': speed_m_s,
            'acceleration_m_s2': JOG_ACCELERATION_M_S2,
            'jerk_m_s3': JOG_JERK_M_S3,
        }
        self._operator.send_program(json.dumps({'moves': [{'move_l': {'to_m': to, **limits}}]}))

    def _jog(self, direction: str) -> str:
        """Set off for the edge of the workspace; whoever lets the button go stops that on the way."""
        if self._button.direction != direction:
            return ''
        to = edge(self._place(), direction, self._robot.parameters.kinematics)
        self._send_line(to.tolist(), self._jog_speed)
        if self._button.direction != direction:
            return self._operator.call('clear')
        sentence = self._operator.call('start')
        if self._button.direction != direction:
            self._operator.call('abort')
        return sentence

    def _place(self) -> Floats:
        """Return where the robot stands [m]; raises RunError if it is not there."""
        if not self._robot.here:
            raise RunError('there is no robot')
        return np.array(self._operator.progress['tcp_m'], dtype=np.float64)

    def _teach(self, name: str) -> str:
        if not name.strip() or not name.isprintable():
            raise ProgramError('a point needs a name')
        x, y, z = self._place().tolist()
        if self._page.controls is not None:
            self._page.controls.teach(name.strip(), (x, y, z))
        return f'{name.strip()} is at ({1e3 * x:.3f}, {1e3 * y:.3f}, {1e3 * z:.3f}) mm'

    def _give_back(self) -> None:
        """Hold the robot when nobody looks any more, and give control back once it stands."""
        now = time.monotonic()
        if not self._operator.in_control:
            return
        if self._operator.state in ('moving', 'stopping'):
            self._moving_s = now
            if self._operator.state == 'moving' and now - self._watched_s > GONE_S:
                self._stop(Wish('hold'))
        elif not self._wishes and now - self._moving_s > RELEASE_S:
            try:
                self._operator.release_control()
            except Delta3Error:
                self._operator.in_control = False


def run(page: Page, parameters: Parameters, namespace: str, patience_s: float = APPEAR_S) -> None:
    """Show a robot that is up until a signal asks for the end; what the page has set off is held then.

    Parameters
    ----------
    page
        Shows it.
    parameters
        Of the robot, until it tells its own.
    namespace
        Of the robot.
    patience_s
        For a robot to be found [s].

    Raises
    ------
    RunError
        No robot is found.

    """
    discovery.keep_to_this_machine()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    process = node_process.Process()
    operator = OperatorNode(process.spin_for, namespace='/' + namespace.strip('/'))
    process.add(operator)
    view = LiveView(page, RobotReader(operator, parameters), process)
    operator.spin_for = view.spin_for
    try:
        with interrupts.answered_by(view.stop):
            view.run(patience_s)
    finally:
        process.close()
        rclpy.try_shutdown()
