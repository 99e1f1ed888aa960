"""A robot that is up, on the page: what it tells is drawn, what people ask for on the page is asked of it.

The view is an operator like ``delta3 move``, in a process of its own.
"""

import math
import signal
import time
from contextlib import suppress

from delta3_pacdrive import interrupts
from delta3_pacdrive.controller.messages import STOPS
from delta3_pacdrive.errors import Delta3Error, ProgramError, RunError, RunInterruptedError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import discovery, domain, node_process
from delta3_pacdrive.ros.page_scope import PageScope
from delta3_pacdrive.ros.page_wishes import IN_MOTION, PageWishes
from delta3_pacdrive.ros.present_robot import RobotWatch
from delta3_pacdrive.ros.robot_client import OperatorNode
from delta3_pacdrive.ros.robot_reader import RobotReader
from delta3_pacdrive.view.jog import Jog, Turn, parse
from delta3_pacdrive.view.page import PICTURES_HZ, Page
from delta3_pacdrive.view.scope_panel import BEGIN, END
from delta3_pacdrive.view.values import Wish

PICTURE_S = 1.0 / PICTURES_HZ
UNSEEN_S = 0.1  # between two looks at the robot while nobody watches: only the plots go on
FACTS_S = 0.2
APPEAR_S = 10.0  # for a robot to be found, unless one is being brought up
GONE_S = 2.0  # without a browser, after which what the page has set off is held: a page may be loaded anew meanwhile
WAITING_MAX = 20  # requests of all browsers
RELEASE_S = 0.5  # standing, after which the page gives control back


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
        self._wishes = PageWishes(page, robot, self._jog)
        self._scope = PageScope(page, robot)
        self._watch = RobotWatch(robot.operator, page.tell, PICTURE_S, process)
        self._progress_s = robot.operator.progress_s  # of the newest report
        self._session = ''
        self._planned = self._stands = 0  # changes of the path and of the cell that are drawn
        self._drawn_s = self._read_s = 0.0
        self._watched_s = time.monotonic()
        self._waiting: list[Wish] = []
        self._stopping = False

    def stop(self) -> None:
        """Let ``run`` end."""
        self._stopping = True

    def run(self, patience_s: float) -> None:
        """Draw until it is stopped, or its process has to join the domain anew; raises RunError if no robot is found.

        When it is stopped, it holds the motion that the page has started.
        """
        try:
            self._go_on(time.monotonic() + patience_s)
        except RunInterruptedError:
            self._stopping = False
            self._scope.close()
            self._end()

    def _go_on(self, deadline: float) -> None:
        found = False
        while True:
            self.spin_for(PICTURE_S)
            if self._operator.progress_s > self._progress_s:
                self._progress_s = self._operator.progress_s
                self._watch.heard()
            self._watch.look()
            if self._process.rejoins:
                return
            found = found or self._robot.here
            if not found and time.monotonic() > deadline:
                raise RunError(f'no robot is up in namespace {self._operator.get_namespace()} (delta3 up)')
            if self._waiting:
                self._wishes.carry_out(self._waiting.pop(0))
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
                # on a grid, so that a picture that comes late does not make all later ones late; not to catch up
                self._drawn_s = max(self._drawn_s + period_s, now - period_s)
                self._draw(now)
                self._scope.look()
            self._sort()
            if self._stopping and not self._wishes.urgent and not self._jog.may_move:
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
        if robot.cell.now.changes != self._stands:
            self._stands = robot.cell.now.changes
            page.stand(robot.cell.now.things)
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
            elif wish.action == BEGIN:  # to look needs no control, and waits for nobody
                self._scope.begin(wish.text)
            elif wish.action == END:
                self._scope.end()
            elif wish.action in STOPS:  # they wait for nothing that is under way
                self._waiting.clear()
                self._jog.drop()
                self._wishes.stop(wish)
                self._wishes.show_override()
            else:
                self._append(wish)
        if self._stopping:
            self._jog.drop()
        turn = self._jog.look(time.monotonic())
        self._waiting = [w for w in self._waiting if w.action != 'jog' or self._jog.wants(int(w.text))]
        if turn is Turn.SET_OFF:
            self._waiting.append(Wish('jog', str(self._jog.number)))
        elif turn is Turn.STOP:
            self._wishes.stop_jog()

    def _press(self, wish: Wish) -> None:
        try:
            direction, (speed,) = parse(wish.text, 1)
        except ProgramError as error:
            self._page.tell(str(error), refused=True)
            return
        self._wishes.jog_speed_m_s = 1e-3 * speed
        self._jog.beat(direction, wish.time_s)

    def _append(self, wish: Wish) -> None:
        """Let a wish wait for its turn; of several overrides only the newest counts."""
        actions = [waiting.action for waiting in self._waiting]
        if wish.action == 'override' and 'override' in actions:
            self._waiting[actions.index('override')] = wish
        elif len(self._waiting) >= WAITING_MAX:
            self._page.tell(
                f'{len(self._waiting)} requests wait already: {wish.action} is not taken', refused=True
            )
        else:
            self._waiting.append(wish)

    def _give_back(self) -> None:
        """Hold the robot when nobody looks any more, and give control back once it stands."""
        now = time.monotonic()
        if not self._operator.in_control:
            return
        if self._operator.state in IN_MOTION or self._jog.may_move:
            self._wishes.moving_s = now
            if self._operator.state == 'moving' and now - self._watched_s > GONE_S:
                self._wishes.stop(Wish('hold'))
        elif not self._waiting and now - self._wishes.moving_s > RELEASE_S:
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
