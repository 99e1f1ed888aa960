"""Node of UnitRobot, the planner: takes moves and programs, plans and checks them as a whole, starts and overrides.

In: ``motion/status``, ``motion/course``, ``motion/verdict`` of the transformation task; requests of operators:
``unit_robot/program`` (String: YAML, or the name of a packaged program), ``unit_robot/move_l`` (PointStamped),
``unit_robot/move_c`` (Path: circle point, end), ``unit_robot/move_sb`` (Path of at most 100 poses),
``unit_robot/override`` (Float64, percent), and ``unit_robot/request`` (String, JSON: the same, of operators who say who
they are). Out: ``motion/plan``, ``motion/change``, ``unit_robot/state`` (latched: idle, moving, stopping, stopped,
error), ``unit_robot/answer`` (latched: one sentence for each request), ``unit_robot/reply`` (JSON: the answer to a
request), ``unit_robot/queue`` (latched, JSON: what is in it, the override, what is being planned), ``unit_robot/alive``
(5 Hz). Services: ``start``, ``resume``, ``clear``. What is decided, ``controller.planner`` decides.
"""

import json
import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, Header, String
from std_srvs.srv import Trigger

from delta3_pacdrive.controller import planner_actions
from delta3_pacdrive.controller.messages import (
    COURSE,
    FAULT,
    ORDER,
    REVOKE,
    LastReplies,
    Numbering,
    Origin,
    Reply,
    Request,
    Status,
    Verdict,
    refuse_recording,
)
from delta3_pacdrive.controller.planner import Planner
from delta3_pacdrive.errors import ProgramError, Reason, TelegramError, shown
from delta3_pacdrive.faults.fault import UNIT_ROBOT
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.motion.curves import SPLINE_POINTS_MAX
from delta3_pacdrive.ros import cdr, node_process
from delta3_pacdrive.ros.announcements import Participant
from delta3_pacdrive.ros.deferred_service import Answer, create_deferred_service
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.numbers import numbers, row_of
from delta3_pacdrive.ros.parameters import declare, declare_robot, descriptor
from delta3_pacdrive.ros.planner_link import ROW_BYTES_MAX
from delta3_pacdrive.ros.planning_thread import PlanningThread
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.ros.qos import LATCHED, NEWEST, PLAN, REPORT, REQUEST
from delta3_pacdrive.sercos.bus_time import NEVER, Clock
from delta3_pacdrive.sercos.telegrams import NO_SESSION

LOOK_S = 0.05  # between two looks at time limits and injected faults
FETCH_S = 0.005  # between two looks at what the planning thread has done, while it has something to do
ALIVE_EVERY = 4  # looks between two heartbeats
PROGRESS_EVERY = 10  # looks between two words about a request that takes long
ANNOUNCE_EVERY = 20  # looks between two announcements, as long as the task does not listen
PROGRAM_BYTES_MAX = 1024 * 1024
AHEAD_MAX = 5000  # cycles by which joint states may be newer than the status: they belong to everybody
UNCHECKED_MAX = 1000  # rows of a plan that are under way at once


class UnitRobotNode(PollingNode):
    """The non-cyclic part of the controller."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('unit_robot', **node_options)
        text = descriptor('program file, or the name of a packaged program; empty: none', 0, 0, str)
        path = declare(self, 'program', '', text)
        self._robot = declare_robot(self)
        self._cycles = Clock(self._robot.bus.cycle_time_s)
        program = programs.load(path, self._robot.motion) if path else None
        self._participant = Participant(self, UNIT_ROBOT, self._robot)
        self._identity = self._participant.instance
        self._planner = Planner(self._robot, self._identity, program, self._newest)
        self._thread = PlanningThread(self._robot, self.get_logger().error)
        self._answers: dict[int, Callable[[Reason | None, str], None]] = {}  # by the identity of the request
        self._asked: dict[int, Request] = {}
        self._heard = Numbering()  # requests of operators
        self._last_replies = LastReplies()
        self._strangers = 0  # requests of clients without an identity
        self._rows: deque[tuple[int, Any, str]] = deque()  # of a plan on its way: order, numbers, kind
        self._sent = 0  # rows of the present plan
        self._newest_cycle = 0
        self._beats = self._looks = 0
        self._told_queue = ''

        self._state = self.create_publisher(String, 'unit_robot/state', LATCHED)
        self._answer = self.create_publisher(String, 'unit_robot/answer', LATCHED)
        self._replies = self.create_publisher(String, 'unit_robot/reply', REQUEST)
        self._queue = self.create_publisher(String, 'unit_robot/queue', LATCHED)
        self._plan = self.create_publisher(Float64MultiArray, 'motion/plan', PLAN)
        self._change = self.create_publisher(Float64MultiArray, 'motion/change', PLAN)
        self._alive = self.create_publisher(Header, 'unit_robot/alive', REPORT)
        self._take_joint_states = self.create_polled_subscription(JointState, 'joint_states', NEWEST)
        self._joint_states = cdr.joint_states_codec()
        listen = self.create_bounded_subscription
        listen(String, 'motion/status', self._on_status, LATCHED)
        listen(Float64MultiArray, 'motion/course', self._on_course, LATCHED, ROW_BYTES_MAX)
        listen(String, 'motion/verdict', self._on_verdict, REQUEST)
        for kind, topic, receive, size in (
            (String, 'program', self._on_program, PROGRAM_BYTES_MAX),
            (PointStamped, 'move_l', self._on_move_l, PROGRAM_BYTES_MAX),
            (Path, 'move_c', self._on_move_c, PROGRAM_BYTES_MAX),
            (Path, 'move_sb', self._on_move_sb, PROGRAM_BYTES_MAX),
            (Float64, 'override', self._on_override, PROGRAM_BYTES_MAX),
            (String, 'request', self._on_request, 2 * PROGRAM_BYTES_MAX),
        ):
            listen(kind, f'unit_robot/{topic}', receive, REQUEST, size, self._refuse)
        for name in ('start', 'resume', 'clear'):
            create_deferred_service(self, Trigger, name, self._service(name))
        self._faults = Faults(self, UNIT_ROBOT, self._newest, self._session)
        self._participant.announce(NO_SESSION)
        self._beat()
        self._tell_queue()
        self.create_timer(LOOK_S, self._look)
        self._fetcher = self.create_timer(FETCH_S, self._fetch)
        self._fetcher.cancel()
        self.get_logger().info('waiting for transformation_task')

    def destroy_node(self) -> None:
        """End the planning thread as well."""
        self._thread.close()
        super().destroy_node()

    # what has to be done ----------------------------------------------------------------------------------------------

    def _look(self) -> None:
        self._looks += 1
        if self._faults.next_cycle < NEVER:
            self._faults.due(self._newest())
        self._planner.look(time.monotonic())
        self._carry_out()
        if self._looks % ALIVE_EVERY == 0:
            self._beat()
        if self._looks % ANNOUNCE_EVERY == 0 and not self._planner.listened_to:
            self._participant.announce(NO_SESSION)
        if self._looks % PROGRESS_EVERY == 0:
            self._tell_progress()

    def _fetch(self) -> None:
        """Take what the planning thread has done."""
        for result in self._thread.results():
            self._planner.take_result(result, time.monotonic())
        if not self._thread.busy:
            self._fetcher.cancel()
        self._carry_out()

    def _session(self) -> bytes:
        status = self._planner.status
        return status.session.encode() if status else NO_SESSION

    def _beat(self) -> None:
        """Let the transformation task know that this planner is there, and which session it knows of."""
        self._beats += 1
        message = Header(frame_id=f'{self._identity} {self._session().decode()}')
        message.stamp.sec = self._beats
        self._alive.publish(message)

    def _carry_out(self) -> None:
        """Do what the planner has decided."""
        actions, self._planner.actions = self._planner.actions, []
        for action in actions:
            match action:
                case planner_actions.Working(job):
                    self._thread.begin(job)
                    self._fetcher.reset()
                case planner_actions.Cancelled(number):
                    self._thread.cancel(number)
                case planner_actions.Ordered(number, moves, faults, row):
                    count = len(moves)
                    self._rows.extend(
                        (number, (move, n, count), move.kind.name) for n, move in enumerate(moves)
                    )
                    self._rows.extend((number, fault.to_row(), FAULT) for fault in faults)
                    self._rows.append((number, row, ORDER))
                    self._sent = 0
                    self._send_rows()
                case planner_actions.Revoked(number):
                    self._rows.clear()
                    self._plan.publish(self._numbered([], REVOKE, number))
                case planner_actions.Changed(number, course):
                    self._change.publish(self._numbered(course.to_array(), COURSE, number))
                case planner_actions.Replied(request, reason, sentence):
                    self._reply(request, reason, sentence)
                case planner_actions.Mirrored(state):
                    self._state.publish(String(data=str(state)))
        if actions:
            self._tell_queue()

    def _numbered(self, values: Any, kind: str, number: int) -> Float64MultiArray:
        origin = Origin(kind, self._identity, self._session().decode(), number)
        return numbers(values, origin.label())

    def _send_rows(self) -> None:
        """Send what is left of a plan, no more of it than the transformation task can take at once."""
        status = self._planner.status
        checked = status.checked if status and self._sent else 0
        while self._rows and self._sent - checked < UNCHECKED_MAX:
            number, values, kind = self._rows.popleft()
            if kind not in (FAULT, ORDER):
                move, n, count = values
                values = move.to_array(n, count)
            self._plan.publish(self._numbered(values, kind, number))
            self._sent += 1

    # answers ----------------------------------------------------------------------------------------------------------

    def _ask(self, request: Request, answer: Callable[[Reason | None, str], None] | None = None) -> None:
        if answer is not None:
            self._answers[id(request)] = answer
        self._asked[id(request)] = request
        self._planner.ask(request, time.monotonic())
        self._carry_out()

    def _ask_as_stranger(
        self, action: str, text: str = '', answer: Callable[[Reason | None, str], None] | None = None
    ) -> None:
        """Pass on the request of a client that has no identity."""
        self._strangers += 1
        self._ask(Request(self._identity, '', self._strangers, 0, action, text), answer)

    def _service(self, action: str) -> Callable[[Trigger.Request, Answer], None]:
        def ask(_: Trigger.Request, answer: Answer) -> None:
            def tell(reason: Reason | None, sentence: str) -> None:
                answer(reason is None, reason.sentence if reason else sentence)

            self._ask_as_stranger(action, answer=tell)

        return ask

    def _reply(self, request: Request, reason: Reason | None, sentence: str) -> None:
        self._asked.pop(id(request), None)
        answer = self._answers.pop(id(request), None)
        if answer is not None:
            answer(reason, sentence)
        if request.operator:
            self._publish_reply(request, reason, sentence, done=True)
        if reason is None:
            self.get_logger().info(sentence)
            self._answer.publish(String(data=f'accepted: {sentence}'))
        else:
            self._refuse(reason.sentence)

    def _publish_reply(self, request: Request, reason: Reason | None, sentence: str, done: bool) -> None:
        code, text = (str(reason.code), reason.sentence) if reason else ('', sentence)
        reply = Reply(request.operator, request.number, done, reason is None, code, text)
        self._replies.publish(String(data=reply.to_json()))
        if done:
            self._last_replies.keep(reply)

    def _refuse(self, sentence: str) -> None:
        self.get_logger().error(sentence)
        self._answer.publish(String(data=f'refused: {sentence}'))

    def _tell_progress(self) -> None:
        """Tell those who wait that their requests are being worked on, and how far."""
        self._tell_queue()
        sentence = self._thread.progress() or 'waiting'
        for request in list(self._asked.values()):
            if request.operator:
                self._publish_reply(request, None, sentence, done=False)

    def _tell_queue(self) -> None:
        moves, duration = self._planner.queue
        facts = {
            'identity': self._identity,
            'moves': moves,
            'duration_s': duration,
            'override': self._planner.rate,
            'working': self._thread.progress(),
        }
        text = json.dumps(facts)
        if text != self._told_queue:
            self._told_queue = text
            self._queue.publish(String(data=text))

    # what is heard ----------------------------------------------------------------------------------------------------

    def _on_status(self, message: String) -> None:
        status = Status.from_json(message.data)
        before = self._session()
        if not self._planner.hear_status(status, time.monotonic()):
            return
        if self._session() != before:
            self._rows.clear()
            self._beat()
        self._send_rows()
        self._carry_out()

    def _on_course(self, message: Float64MultiArray) -> None:
        label, row = row_of(message)
        self._planner.hear_course(Origin.from_label(label), row)

    def _on_verdict(self, message: String) -> None:
        self._planner.hear_verdict(Verdict.from_json(message.data), time.monotonic())
        self._carry_out()

    def _on_request(self, message: String) -> None:
        request = Request.from_json(message.data)
        if not request.operator or not all(math.isfinite(cap) and cap >= 0.0 for cap in request.caps):
            raise TelegramError(
                'a request needs the identity of its operator, and caps that are numbers from 0 on'
            )
        if request.receiver != self._identity:
            self._replies.publish(String(data=refuse_recording(request).to_json()))
            self._told_queue = ''  # who asks may have heard the queue of another planner
            self._tell_queue()
            raise TelegramError(f'a request to {shown(request.receiver)}, which is not this planner')
        if self._heard.is_new(request.operator, request.number):
            self._ask(request)
            return
        if (last := self._last_replies.to(request)) is not None:
            self._replies.publish(String(data=last.to_json()))

    def _on_program(self, message: String) -> None:
        self._ask_as_stranger('program', message.data)

    def _enqueue(self, statement: dict[str, Any]) -> None:
        self._ask_as_stranger('program', json.dumps({'moves': [statement]}))

    def _on_move_l(self, message: PointStamped) -> None:
        _require_base(message.header.frame_id)
        self._enqueue({'move_l': {'to_m': _point_of(message.point)}})

    def _on_move_c(self, message: Path) -> None:
        points = _points_of(message)
        if len(points) != 2:
            raise ProgramError(f'move_c takes two poses, circle point and end, not {len(points)}')
        self._enqueue({'move_c': {'via_m': points[0], 'to_m': points[1]}})

    def _on_move_sb(self, message: Path) -> None:
        self._enqueue({'move_sb': {'through_m': _points_of(message)}})

    def _on_override(self, message: Float64) -> None:
        self._ask_as_stranger('override', repr(message.data))

    def _newest(self) -> int:
        """Bus cycle of the newest joint states, which come every 10 ms of bus time."""
        status = self._planner.status
        known = status.cycle if status else 0
        self._newest_cycle = (
            max(self._newest_cycle, known) if self._newest_cycle < known + AHEAD_MAX else known
        )
        while (taken := self._take_joint_states()) is not None:
            try:
                sec, nanosec, frame, _ = self._joint_states.decode(taken[0])
            except TelegramError:
                continue  # joints of somebody else: the topic belongs to everybody
            cycle = self._cycles.count(sec, nanosec) if frame == cdr.BASE_FRAME else -1
            if cycle < known + AHEAD_MAX:
                self._newest_cycle = max(self._newest_cycle, cycle)
        return self._newest_cycle


def _require_base(frame: str) -> None:
    if frame != cdr.BASE_FRAME.decode():
        raise ProgramError(f'frame_id is {shown(frame)}, but must be "base"')


def _point_of(point: Any) -> list[float]:
    return [point.x, point.y, point.z]


def _points_of(message: Path) -> list[list[float]]:
    _require_base(message.header.frame_id)
    if len(message.poses) > SPLINE_POINTS_MAX:
        raise ProgramError(f'the path has {len(message.poses)} poses, the limit is {SPLINE_POINTS_MAX}')
    points = []
    for number, pose in enumerate(message.poses):
        if pose.header.frame_id:  # empty: that of the path
            _require_base(pose.header.frame_id)
        turn = pose.pose.orientation
        if (turn.x, turn.y, turn.z) != (0.0, 0.0, 0.0):
            raise ProgramError(f'poses[{number}] has an orientation, but the plate does not turn')
        points.append(_point_of(pose.pose.position))
    return points


def main() -> int:
    """Run the planner process."""
    return node_process.run_single(UnitRobotNode)


if __name__ == '__main__':
    raise SystemExit(main())
