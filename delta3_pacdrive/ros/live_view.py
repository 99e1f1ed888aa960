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
from delta3_pacdrive.configuration.packaged import program_names
from delta3_pacdrive.controller.messages import STOPS
from delta3_pacdrive.errors import (
    Code,
    Delta3Error,
    ProgramError,
    RefusedError,
    RunError,
    RunInterruptedError,
    shown,
)
from delta3_pacdrive.motion import program_file
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.units import millimetres
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import discovery, node_process
from delta3_pacdrive.ros.robot_client import OperatorNode
from delta3_pacdrive.ros.robot_reader import RobotReader
from delta3_pacdrive.view.jog import (
    DIRECTIONS,
    JOG_ACCELERATION_M_S2,
    JOG_JERK_M_S3,
    Jog,
    Turn,
    edge,
    parse,
)
from delta3_pacdrive.view.page import PICTURES_HZ, Page
from delta3_pacdrive.view.values import Wish

PICTURE_S = 1.0 / PICTURES_HZ
UNSEEN_S = 0.1  # between two looks at the robot while nobody watches: only the plots go on
FACTS_S = 0.2
APPEAR_S = 10.0  # for a robot to be found, unless one is being brought up
SETS_OFF = ('start', 'resume')
GONE_S = 2.0  # without a browser, after which what the page has set off is held: a page may be loaded anew meanwhile
RELEASE_S = 0.5  # standing, after which the page gives control back
CLEARED_S = 1.0  # until a queue that was cleared is told to be empty
IN_MOTION = ('moving', 'stopping')
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
        self._jog = Jog()
        self._jog_speed_m_s = 0.05
        self._session = ''
        self._planned = 0  # changes of the path that is drawn
        self._drawn_s = self._read_s = 0.0
        self._moving_s = self._watched_s = time.monotonic()
        self._urgent = False  # whether what is waited for must not be interrupted
        self._stops: set[str] = set()  # that are asked for now
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
        if not self._operator.in_control:
            return
        with suppress(Delta3Error):  # of a robot that stands
            self._operator.call('hold')
        with suppress(Delta3Error):
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
            if self._stopping and not self._urgent and not self._jog.may_move:
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
        while self._page.wishes:
            wish = self._page.wishes.popleft()
            if wish.action == 'press':
                self._press(wish)
            elif wish.action in STOPS:  # they wait for nothing that is under way
                self._wishes.clear()
                self._jog.drop()
                self._stop(wish)
                self._show_override()
            else:
                self._append(wish)
        if self._stopping:
            self._jog.drop()
        turn = self._jog.look(time.monotonic())
        self._wishes = [w for w in self._wishes if w.action != 'jog' or self._jog.wants(int(w.text))]
        if turn is Turn.SET_OFF:
            self._wishes.append(Wish('jog', str(self._jog.number)))
        elif turn is Turn.STOP:
            self._stop_jog()

    def _press(self, wish: Wish) -> None:
        try:
            direction, (speed,) = parse(wish.text, 1)
        except ProgramError as error:
            self._page.tell(str(error), refused=True)
            return
        self._jog_speed_m_s = 1e-3 * speed
        self._jog.beat(direction, wish.time_s)

    def _append(self, wish: Wish) -> None:
        """Let a wish wait for its turn; of several overrides only the newest counts."""
        actions = [waiting.action for waiting in self._wishes]
        if wish.action == 'override' and 'override' in actions:
            self._wishes[actions.index('override')] = wish
        else:
            self._wishes.append(wish)

    def _stop(self, wish: Wish) -> None:
        """Stop the robot, in the middle of whatever else is being waited for, and show what it answers."""
        if wish.action in self._stops:  # asked for, and not answered yet
            return
        try:
            self._ask_for_stop(wish.action)
        except (RunError, ProgramError) as error:
            self._page.tell(str(error), refused=True)

    def _ask_for_stop(self, action: str) -> None:
        """Ask for a stop, and show that it was accepted."""
        self._stops.add(action)
        try:
            self._page.tell(self._uninterrupted(action))
        finally:
            self._stops.remove(action)

    def _stop_jog(self) -> None:
        """Stop what was set off by a button; without an answer it is asked for again while the robot may move."""
        if 'abort' in self._stops:  # of somebody else, and nobody knows whether it is answered
            self._jog.unheard()
            return
        try:
            with suppress(ProgramError):  # it stands already
                self._ask_for_stop('abort')
        except RunError as error:
            self._page.tell(str(error), refused=True)
            if self._robot.here and self._operator.progress['state'] in IN_MOTION:
                self._jog.unheard()
                return
        self._jog.stopped(time.monotonic())

    def _uninterrupted(self, action: str) -> str:
        """Ask for something whose outcome has to be known, even if a signal asks for the end meanwhile."""
        before, self._urgent = self._urgent, True
        try:
            return self._operator.call(action)
        finally:
            self._urgent = before

    def _carry_out(self, wish: Wish) -> None:
        try:
            sentence = self._done(wish)
        except RunInterruptedError:
            raise
        except Delta3Error as error:
            if wish.action == 'jog':
                self._fail_jog(int(wish.text), error)
            elif wish.action == 'override':
                self._show_override()
            self._page.tell(str(error), refused=True)
            return
        if sentence:
            self._page.tell(sentence)

    def _fail_jog(self, number: int, error: Delta3Error) -> None:
        """Take note that a press came to nothing, or that nobody knows what came of it."""
        silent = isinstance(error, RefusedError) and error.reason.code is Code.SILENT
        if silent or isinstance(error, RunError):
            self._jog.lost(number)
        else:
            self._jog.refused(number)

    def _show_override(self) -> None:
        """Let the slider stand where the robot's override is, whatever was asked for."""
        if self._page.controls is not None:
            self._page.controls.show_override()

    def _done(self, wish: Wish) -> str:
        """Carry a wish out; return the answer."""
        operator, text = self._operator, wish.text
        if wish.action == 'inject':
            return operator.inject(text)
        if wish.action == 'teach':
            return self._teach(text)
        if wish.action == 'forget':
            return self._forget()
        if wish.action == 'jog' and not self._jog.wants(int(text)):
            return ''
        if not operator.in_control:
            operator.take_control(NAME, wish.by_force)
        self._moving_s = time.monotonic()
        if wish.action == 'packaged':
            return operator.send_program(self._packaged(text))
        if wish.action == 'program':
            return operator.send_program(text)
        if wish.action == 'override':
            return operator.override(float(text))
        if wish.action == 'step':
            return self._step(text)
        if wish.action == 'jog':
            return self._set_jog_off(int(text))
        if wish.action in SETS_OFF:
            return self._uninterrupted(wish.action)
        return operator.call(wish.action)

    def _packaged(self, name: str) -> str:
        if name not in program_names():  # a page may ask for anything
            raise ProgramError(f'there is no packaged program {shown(name)}')
        try:
            return program_file.find(name).read_text(encoding='utf-8')
        except OSError as error:
            raise ProgramError(f'the program {name} cannot be read: {error.strerror}') from None

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

    def _step(self, text: str) -> str:
        direction, (step, speed) = parse(text, 2)
        way = 1e-3 * step * np.array(DIRECTIONS[direction])
        self._send_line({'by_m': way.tolist()}, 1e-3 * speed)
        return self._start_line()

    def _set_jog_off(self, number: int) -> str:
        """Set off for the edge of the workspace; whoever lets the button go stops that on the way."""
        jog = self._jog
        to = edge(self._place(), jog.direction, self._robot.parameters.kinematics)
        self._send_line(to.tolist(), self._jog_speed_m_s)
        if not jog.start(number):
            self._take_line_back()
            return ''
        sentence = self._start_line()
        jog.accepted(number)
        return sentence

    def _start_line(self) -> str:
        """Start a line that was sent; one that is refused does not stay in the queue for whoever starts next."""
        try:
            return self._uninterrupted('start')
        except ProgramError:
            self._take_line_back()
            raise

    def _take_line_back(self) -> None:
        with suppress(Delta3Error):
            self._uninterrupted('clear')
            self._operator.wait_until(self._queue_is_empty, 'word of an empty queue', CLEARED_S)

    def _queue_is_empty(self) -> bool:
        queue = self._operator.queue
        return queue is None or not queue.moves

    def _place(self) -> Floats:
        """Return where the robot stands [m]; raises RunError if it is not there."""
        if not self._robot.here:
            raise RunError('there is no robot')
        place = np.array(self._operator.progress['tcp_m'], dtype=np.float64)
        if not np.isfinite(place).all():
            raise RunError('nobody knows where the robot is: its arms close no chain')
        return place

    def _teach(self, name: str) -> str:
        if not name.strip() or not name.isprintable():
            raise ProgramError('a point needs a name')
        x, y, z = self._place().tolist()
        if self._page.controls is not None:
            self._page.controls.teach(name.strip(), (x, y, z))
        return f'{name.strip()} is at {millimetres((x, y, z))}'

    def _forget(self) -> str:
        if self._page.controls is not None:
            self._page.controls.forget()
        return 'all points are forgotten'

    def _give_back(self) -> None:
        """Hold the robot when nobody looks any more, and give control back once it stands."""
        now = time.monotonic()
        if not self._operator.in_control:
            return
        if self._operator.state in IN_MOTION or self._jog.may_move:
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
        node_process.leave(process)
