"""The transformation task's link to the planner: plans and courses in, verdicts and status out.

In: ``motion/plan`` (moves, faults and the order that ends them), ``motion/change`` (courses), ``unit_robot/alive``
(heartbeat of the planner: its identity and the session that it knows of, numbered in ``stamp.sec``). Out:
``motion/status`` (latched, JSON: all that the planner has to know), ``motion/verdict`` (JSON: what became of an order
or of a change), ``motion/refusal`` (the same for people, if it was refused).

A plan of thousands of moves is checked in slices of time, so that bus cycles start when they are due.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive.bus.participants import Announcement
from delta3_pacdrive.controller.control import Control
from delta3_pacdrive.controller.messages import (
    ACCEPTED,
    COURSE,
    REVOKE,
    Numbering,
    Origin,
    Status,
    verdict_of,
)
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.plan_intake import Order, PlanIntake
from delta3_pacdrive.controller.planner_watch import PlannerWatch
from delta3_pacdrive.controller.reason import Code, Reason
from delta3_pacdrive.controller.robot_state import RobotState
from delta3_pacdrive.errors import ProgramError, TelegramError, shown
from delta3_pacdrive.injection import UNIT_ROBOT
from delta3_pacdrive.motion.timeline import Course
from delta3_pacdrive.nodes.fault_desk import FaultDesk
from delta3_pacdrive.nodes.numbers import numbers, row_of
from delta3_pacdrive.nodes.qos import LATCHED, PLAN, REPORT, REQUEST
from delta3_pacdrive.nodes.robot_node import RobotNode
from delta3_pacdrive.parameters import Parameters

SLICE_S, SLICE_EVERY_S = 0.5e-3, 2e-3  # time that checking a plan may take, and how often
ROWS_WAITING_MAX = 50_000  # rows of a plan that nobody has checked yet
ROW_BYTES_MAX = 16 * 1024 * 1024
STATUS_EVERY = 500  # checked rows


class PlannerLink:
    """Link of one transformation task.

    Parameters
    ----------
    node
        Publishes and subscribes.
    parameters, state, control, watch, faults
        Of the same transformation task.
    session, phase, next_cycle
        Return the session of the bus and the one before it, the name of its phase, and its next cycle.
    changed
        Called when the state has been asked to change: whatever it wants done has to be done.

    """

    def __init__(
        self,
        node: RobotNode,
        parameters: Parameters,
        state: RobotState,
        control: Control,
        watch: PlannerWatch,
        faults: FaultDesk,
        session: Callable[[], tuple[bytes, bytes]],
        phase: Callable[[], str],
        next_cycle: Callable[[], int],
        changed: Callable[[], None],
    ) -> None:
        self._node, self._state, self._control, self._watch, self._faults = (
            node,
            state,
            control,
            watch,
            faults,
        )
        self._session, self._phase, self._next_cycle, self._changed = session, phase, next_cycle, changed
        self._intake = PlanIntake(parameters)
        self._changes = Numbering()
        self._rows: deque[tuple[Origin, Any]] = deque()
        self._revoked: set[tuple[str, int]] = set()
        self._serial = self._courses = 0
        self._order = 0  # the newest one that was accepted
        self._planner = ''  # whose program is loaded
        self._listened_to = ''
        self._status = node.create_publisher(String, 'motion/status', LATCHED)
        self._verdicts = node.create_publisher(String, 'motion/verdict', REQUEST)
        self._refusals = node.create_publisher(String, 'motion/refusal', REQUEST)
        self._course = node.create_publisher(Float64MultiArray, 'motion/course', LATCHED)
        for topic, receive in (('motion/plan', self._on_row), ('motion/change', self._on_change)):
            node.create_bounded_subscription(
                Float64MultiArray, topic, receive, PLAN, ROW_BYTES_MAX, self._refuse_stranger
            )
        node.create_bounded_subscription(Header, 'unit_robot/alive', self._on_alive, REPORT)
        self._slices = node.create_timer(SLICE_EVERY_S, self._check_rows)
        self._slices.cancel()

    # the planner ----------------------------------------------------------------------------------------------------

    def announced(self, announcement: Announcement) -> None:
        """Take note of what a planner was configured with."""
        if announcement.name == UNIT_ROBOT:
            self._watch.announced(announcement.instance, announcement.identity)

    def _on_alive(self, message: Header) -> None:
        planner, _, session = message.frame_id.partition(' ')
        if session != self._session()[0].decode():
            return
        self._watch.heard(planner, message.stamp.sec, time.monotonic())
        self._look_at_planner()

    def _look_at_planner(self) -> None:
        if self._watch.planner != self._listened_to:
            self._listened_to, self._order = self._watch.planner, 0
            self._node.get_logger().info(f'planner {self._listened_to or "nobody"}')
            self.tell_status()

    def look(self) -> str:
        """Look: say why the planner whose program moves the robot is lost, empty if it is not."""
        moving = self._state.motion in (MotionState.MOVING, MotionState.STOPPING)
        reason = self._watch.look(time.monotonic(), self._planner if moving else '')
        self._look_at_planner()
        return reason

    def tell_status(self) -> None:
        """Publish all that the planner has to know."""
        self._serial += 1
        session, previous = self._session()
        state, control = self._state, self._control
        refusal = state.refusal()
        operator = control.operator
        x, y, z = (float(value) for value in state.tcp_m)
        status = Status(
            session.decode(),
            previous.decode(),
            self._serial,
            self._watch.planner,
            str(state.motion),
            self._phase(),
            refusal.sentence if refusal else '',
            str(refusal.code) if refusal else '',
            state.located,
            (x, y, z),
            control.changes,
            operator.identity if operator else '',
            operator.name if operator else '',
            control.losses,
            self._order,
            self._intake.checked,
            self._next_cycle(),
        )
        self._status.publish(String(data=status.to_json()))

    def tell_course(self, course: Course) -> None:
        """Publish what the master follows."""
        self._courses += 1
        label = Origin(COURSE, self._planner, self._session()[0].decode(), self._courses).label()
        self._course.publish(numbers(course.to_array(), label))

    # plans and courses ----------------------------------------------------------------------------------------------

    def begin_session(self) -> None:
        """Forget what belongs to a session that is over."""
        self._rows.clear()
        self._revoked.clear()
        self._intake.begin()
        self._order = 0

    def _origin(self, label: str) -> Origin:
        """Return where a row comes from; raises TelegramError if that is none of this robot's planner."""
        origin = Origin.from_label(label)
        if (origin.planner, origin.session) != (self._watch.planner, self._session()[0].decode()):
            raise TelegramError(
                f'an order of planner {shown(origin.planner)} in session {shown(origin.session)} is not for this '
                'robot now; is it a recording?'
            )
        return origin

    def _on_row(self, message: Float64MultiArray) -> None:
        label, row = row_of(message)
        origin = self._origin(label)
        if origin.kind == REVOKE:
            self._revoke(origin)
            return
        if len(self._rows) >= ROWS_WAITING_MAX:
            raise TelegramError(f'{ROWS_WAITING_MAX} rows of a plan are waiting already')
        if not self._rows:
            self._slices.reset()
        self._rows.append((origin, row))

    def _revoke(self, origin: Origin) -> None:
        """Take an order back; if it runs already, the program is given up."""
        self._revoked.add((origin.planner, origin.number))
        if origin.number == self._order:
            self._state.abort()
            self._changed()

    def _check_rows(self) -> None:
        """Check rows of a plan for a slice of time."""
        end = time.monotonic() + SLICE_S
        while self._rows and time.monotonic() < end:
            origin, row = self._rows.popleft()
            outcome = self._intake.take(origin, row)
            if isinstance(outcome, Order) and (origin.planner, origin.number) in self._revoked:
                outcome = Reason(Code.WITHDRAWN, 'the planner has taken it back')
            if isinstance(outcome, Order):
                outcome = self._start(origin, outcome)
            elif self._intake.checked % STATUS_EVERY == STATUS_EVERY - 1:
                self.tell_status()
            if isinstance(outcome, Reason):
                self._refuse('plan', origin, outcome)
        if not self._rows:
            self._slices.cancel()

    def _start(self, origin: Origin, order: Order) -> Reason | None:
        try:
            self._faults.check(order.faults)
        except ProgramError as error:
            return Reason(Code.CONTENT, str(error))
        disagreement = self._watch.disagreement()
        if disagreement:
            return Reason(Code.CONTENT, f'it was planned for another robot: {disagreement}')
        loaded, self._planner = self._planner, origin.planner
        reason = self._state.start(order)
        if reason is not None:
            self._planner = loaded
            return reason
        self._order = origin.number
        self._changed()
        self._accept(origin)
        return None

    def _on_change(self, message: Float64MultiArray) -> None:
        label, row = row_of(message)
        origin = self._origin(label)
        if not self._changes.is_new(f'{origin.planner} {origin.session}', origin.number):
            raise TelegramError(f'change {origin.number} of this planner was heard before')
        try:
            reason = self._state.change(Course.from_array(row))
        except ProgramError as error:
            reason = Reason(Code.CONTENT, str(error))
        if reason is not None:
            self._refuse('course', origin, reason)
            return
        self._changed()
        self._accept(origin)

    def _accept(self, origin: Origin) -> None:
        self._verdicts.publish(String(data=verdict_of(origin, ACCEPTED, '').to_json()))

    def _refuse(self, what: str, origin: Origin, reason: Reason) -> None:
        self._verdicts.publish(String(data=verdict_of(origin, reason.code, reason.sentence).to_json()))
        self.say_refusal(f'{what} refused: {reason}')

    def say_refusal(self, sentence: str) -> None:
        """Say to people what was refused."""
        self._node.get_logger().error(sentence)
        self._refusals.publish(String(data=sentence))

    def _refuse_stranger(self, sentence: str) -> None:
        """Say that something was refused that is nobody's order: at most once a second."""
        self._node.get_logger().error(f'refused: {sentence}', throttle_duration_sec=1.0)
        self._refusals.publish(String(data=f'refused: {sentence}'))
