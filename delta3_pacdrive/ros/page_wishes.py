"""Wishes of people who look at the page: each is asked of the robot, and its answer is told on the page."""

import json
import time
from contextlib import suppress
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.checked import counted
from delta3_pacdrive.configuration.packaged import program_names
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
from delta3_pacdrive.ros.robot_reader import RobotReader
from delta3_pacdrive.view.jog import (
    DIRECTIONS,
    JOG_ACCELERATION_M_S2,
    JOG_JERK_M_S3,
    Jog,
    edge,
    parse,
)
from delta3_pacdrive.view.page import Page
from delta3_pacdrive.view.values import Wish

SETS_OFF = ('start', 'resume')
CLEARED_S = 1.0  # until a queue that was cleared is told to be empty
STANDS_S = 3.0  # for a robot that has accepted a stop to come to rest
NEWS = 2  # times it has to tell how it is after that: the first may have been on its way
IN_MOTION = ('moving', 'stopping')
NAME = 'delta3 view'


class PageWishes:
    """The wishes of one page.

    Parameters
    ----------
    page
        Where people wish, and are answered.
    robot
        What is known of the robot, and who operates it.
    jog
        The buttons that move the robot while they are held.

    Attributes
    ----------
    jog_speed_m_s
        How fast they move it [m/s].
    moving_s
        When something was last asked for that may move the robot.
    urgent
        Whether what is waited for must not be interrupted.

    """

    def __init__(self, page: Page, robot: RobotReader, jog: Jog) -> None:
        self._page, self._robot, self._jog = page, robot, jog
        self._operator = robot.operator
        self.jog_speed_m_s = 0.05
        self.moving_s = time.monotonic()
        self.urgent = False
        self._stops: set[str] = set()  # that are asked for now

    def carry_out(self, wish: Wish) -> None:
        """Carry a wish out and tell the answer; raises RunInterruptedError if a signal asks for the end meanwhile."""
        try:
            sentence = self._done(wish)
        except RunInterruptedError:
            raise
        except Delta3Error as error:
            if wish.action == 'jog':
                self._fail_jog(int(wish.text), error)
            elif wish.action == 'override':
                self.show_override()
            self._page.tell(str(error), refused=True)
            return
        if sentence:
            self._page.tell(sentence)

    def stop(self, wish: Wish) -> None:
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

    def stop_jog(self) -> None:
        """Stop what was set off by a button, and wait until the robot stands: who holds the button moves it again.

        Without an answer it is asked for again while the robot may move.
        """
        if 'abort' in self._stops:  # of somebody else, and nobody knows whether it is answered
            self._jog.unheard()
            return
        try:
            with suppress(ProgramError):  # it stands already
                self._ask_for_stop('abort')
                self._wait_until_it_stands()
        except RunError as error:
            self._page.tell(str(error), refused=True)
            if self._robot.here and self._operator.progress['state'] in IN_MOTION:
                self._jog.unheard()
                return
        self._jog.stopped(time.monotonic())

    def _wait_until_it_stands(self) -> None:
        """Wait for a robot that has accepted a stop; whose motion goes on is somebody else's, or nobody tells."""
        seen = [self._operator.progress]

        def stands() -> bool:
            if self._operator.progress is not seen[-1]:
                seen.append(self._operator.progress)
            return len(seen) > NEWS and self._operator.progress['state'] not in IN_MOTION

        with suppress(RunError):
            self._operator.wait_until(stands, 'word of a robot that stands', STANDS_S)

    def _uninterrupted(self, action: str) -> str:
        """Ask for something whose outcome has to be known, even if a signal asks for the end meanwhile."""
        before, self.urgent = self.urgent, True
        try:
            return self._operator.call(action)
        finally:
            self.urgent = before

    def _fail_jog(self, number: int, error: Delta3Error) -> None:
        """Take note that a press came to nothing, or that nobody knows what came of it."""
        silent = isinstance(error, RefusedError) and error.reason.code is Code.SILENT
        if silent or isinstance(error, RunError):
            self._jog.lost(number)
        else:
            self._jog.refused(number)

    def show_override(self) -> None:
        """Let the slider stand where the robot's override is, whatever was asked for."""
        if self._page.controls is not None:
            self._page.controls.show_override()

    def _done(self, wish: Wish) -> str:
        """Carry a wish out; return the answer."""
        operator, text = self._operator, wish.text
        if wish.action == 'inject':
            return operator.inject(text)
        if wish.action == 'input':
            return operator.input(text)
        if wish.action == 'teach':
            return self._teach(text)
        if wish.action == 'forget':
            return self._forget()
        if wish.action == 'jog' and not self._jog.wants(int(text)):
            return ''
        if not operator.in_control:
            operator.take_control(NAME, wish.by_force)
        self.moving_s = time.monotonic()
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
            raise ProgramError(f'{counted(queue.moves, "move")} in the queue: clear it before you jog')
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
        self._send_line(to.tolist(), self.jog_speed_m_s)
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
            raise RunError(
                'robot pose unknown: it is not measured yet, or forward kinematics has no solution'
            )
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
