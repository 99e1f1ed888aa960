"""Operator services of the planner: programs, moves, start, resume, clear, override, and their replies.

In: ``unit_robot/program`` (String: YAML, or the name of a packaged program), ``unit_robot/move_l`` (PointStamped),
``unit_robot/move_c`` (Path: circle point, end), ``unit_robot/move_sb`` (Path of at most 100 poses),
``joint_trajectory`` (JointTrajectory: arm angles over time, executed immediately), ``unit_robot/override`` (Float64,
percent), and ``unit_robot/request`` (String, JSON: the same with the identity of the operator). Out:
``unit_robot/answer`` (latched: one sentence for each request), ``unit_robot/reply`` (JSON: reply to a request),
``unit_robot/queue`` (latched, JSON: content of the queue, override, planning progress, reason of the newest rejection),
``unit_robot/requests`` (JSON: states of the moves of each request), and the keys and values of the latter two in
``unit_robot/queue/values`` and ``unit_robot/requests/values`` (DiagnosticArray). Services: ``start``, ``resume``,
``clear``, and ``unit_robot/move`` (moves in YAML; the reply contains an id).
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.srv import AddDiagnostics
from std_msgs.msg import String
from std_srvs.srv import Trigger

from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.control.messages import QueueReport, Request, RequestReport
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.request_service import FOR_MOVES
from delta3_pacdrive.control.queue.request_tracker import Phase
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.ros.deferred_service import Respond
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import frames, interfaces, move_messages
from delta3_pacdrive.ros.wire.diagnostics import diagnostic_array
from delta3_pacdrive.ros.wire.joint_trajectory import joint_trajectory
from delta3_pacdrive.ros.wire.publishers import Output
from delta3_pacdrive.ros.wire.request_server import RequestServer

FAILED = (Phase.REJECTED, Phase.ABORTED)


class PlannerServices:
    """Operator services of one planner.

    ``progress`` describes the planning job, ``stamp`` returns bus time, negative before cyclic operation, and
    ``bus_time_s`` that of a stamp; ``changed`` is called after each request to execute the resulting actions.
    """

    def __init__(
        self,
        node: RobotNode,
        planner: Planner,
        identity: str,
        progress: Callable[[], str],
        stamp: Callable[[], tuple[int, int]],
        bus_time_s: Callable[[int, int], float],
        changed: Callable[[], None],
    ) -> None:
        self._node, self._log = node, node.get_logger()
        self._planner, self._identity = planner, identity
        self._base = frames.base_of(node)
        self._progress, self._stamp, self._changed = progress, stamp, changed
        # by the identity of the request: request, callback of its reply, and the received request to reply to by topic
        self._pending: dict[int, tuple[Request, Respond | None, Request | None]] = {}
        self._anonymous = 0  # requests of clients without an identity
        self._refusal: Reason | None = None  # of the newest request
        self._published_queue = self._published_values = ''  # JSON of the newest messages
        self._answer = interfaces.ANSWER.publisher(node)
        self._queue = interfaces.QUEUE.publisher(node)
        self._queue_values = interfaces.QUEUE_VALUES.publisher(node)
        self._server = RequestServer(
            node,
            (interfaces.PLANNER_REQUEST, interfaces.PLANNER_REPLY),
            lambda: identity,
            self._on_request,
            refuse=self._refuse_request,
        )
        for topic, receive in (
            (
                interfaces.PROGRAM,
                lambda message: self._ask_openly(interfaces.PROGRAM, 'program', message.data),
            ),
            (interfaces.MOVE_L, self._enqueue(interfaces.MOVE_L, move_messages.move_l)),
            (interfaces.MOVE_C, self._enqueue(interfaces.MOVE_C, move_messages.move_c)),
            (interfaces.MOVE_SB, self._enqueue(interfaces.MOVE_SB, move_messages.move_sb)),
            (
                interfaces.JOINT_TRAJECTORY,
                lambda message: self._ask_openly(
                    interfaces.JOINT_TRAJECTORY,
                    'trajectory',
                    joint_trajectory(message, bus_time_s).to_json(),
                ),
            ),
            (
                interfaces.OVERRIDE,
                lambda message: self._ask_openly(interfaces.OVERRIDE, 'override', repr(message.data)),
            ),
        ):
            refuse = self._refuse if topic is interfaces.OVERRIDE else self.refuse_moves
            topic.bounded_subscription(node, receive, refuse)
        self._requests = interfaces.REQUESTS.publisher(node)
        self._request_values = Output(node, interfaces.REQUESTS_VALUES)
        for service in (interfaces.START, interfaces.RESUME, interfaces.CLEAR):
            service.deferred_servers(node, partial(self._serve, service.name))
        interfaces.MOVE.deferred_servers(node, self._move)

    # requests ---------------------------------------------------------------------------------------------------------

    def _ask(self, action: str, text: str = '', respond: Respond | None = None) -> None:
        """Pass a request of a client without identity to the planner."""
        self.pass_on(self.request(action, text), respond)

    def _ask_openly(self, topic: interfaces.Topic, action: str, text: str) -> None:
        """Pass on a request received by topic, unless a bag may be playing."""
        reason = self._planner.played_back(time.monotonic()) or interfaces.player_of(self._node, topic)
        if reason is None:
            self._ask(action, text)
        elif action in FOR_MOVES:
            self.refuse_moves(reason)
        else:
            self._publish_answer(reason, '')

    def request(self, action: str, text: str = '') -> Request:
        """Return a new request for a client without identity."""
        self._anonymous += 1
        return Request(
            receiver=self._identity, operator='', number=self._anonymous, control=0, action=action, text=text
        )

    def pass_on(
        self, request: Request, respond: Respond | None = None, received: Request | None = None
    ) -> None:
        """Pass on a request; ``respond`` is called with the result, and ``received`` gets the reply."""
        self._pending[id(request)] = request, respond, received
        self._planner.ask(request, time.monotonic())
        self._changed()

    def _serve(self, action: str, _: Trigger.Request, respond: Respond) -> None:
        self._ask(action, respond=respond)

    def _move(self, request: AddDiagnostics.Request, respond: Respond) -> None:
        """Pass on moves; the reply contains the id of the request."""
        text = request.load_namespace
        asked = self.request('move', text)

        def answer(reason: Reason | None, sentence: str) -> None:
            code, text = (str(reason.code), reason.sentence) if reason else ('', sentence)
            document = json.dumps({'id': asked.identity, 'code': code, 'sentence': text})
            respond(reason and replace(reason, sentence=document), document)

        if len(text.encode()) > interfaces.PROGRAM_BYTES_MAX:
            size = f'the request has {len(text.encode())} bytes, the limit is {interfaces.PROGRAM_BYTES_MAX}'
            answer(Reason(Code.CONTENT, size), '')
        elif not text.strip():
            answer(Reason(Code.CONTENT, 'the request is empty: it needs moves, or the name of a program'), '')
        else:
            self.pass_on(asked, answer)

    def _enqueue(
        self, topic: interfaces.Topic, statement: Callable[[Any, str], move_messages.Statement]
    ) -> Callable[[Any], None]:
        return lambda message: self._ask_openly(
            topic, 'program', json.dumps({'moves': [statement(message, self._base)]})
        )

    def _on_request(self, request: Request) -> None:
        own = request
        if not request.operator and request.action == 'withdraw':
            self._server.reply(
                request, Reason(Code.CONTENT, 'a withdrawal needs the identity of its operator'), ''
            )
            return
        if not request.operator:  # numbers of different clients may coincide
            self._anonymous += 1
            own = replace(request, receiver=self._identity, number=self._anonymous)
        self.pass_on(own, received=request)

    # answers ----------------------------------------------------------------------------------------------------------

    def reply(self, request: Request, reason: Reason | None, sentence: str, routine: bool = False) -> None:
        """Reply to a request, with the reason if it is rejected; a routine reply is not logged."""
        _, respond, received = self._pending.pop(id(request), (request, None, None))
        if respond is not None:
            respond(reason, sentence)
        if received is not None:
            self._server.reply(received, reason, sentence)
        self._publish_answer(reason, sentence, routine)

    def _publish_answer(self, reason: Reason | None, sentence: str, routine: bool = False) -> None:
        """Publish the result of the newest request on ``unit_robot/answer``."""
        self._refusal = reason
        if routine:
            self._log.debug(reason.sentence if reason else sentence)
        if reason is None:
            if not routine:
                self._log.info(sentence)
            self._answer.publish(String(data=f'accepted: {sentence}'))
        else:
            if not routine:
                self._log.error(reason.sentence)
            self._answer.publish(String(data=f'refused: {reason.sentence}'))
        self.publish_queue()

    def report(self, report: RequestReport) -> None:
        """Publish the state of the moves of a request."""
        self._requests.publish(String(data=report.to_json()))
        if self._request_values.wanted:
            level = DiagnosticStatus.WARN if report.state in FAILED else DiagnosticStatus.OK
            status = DiagnosticStatus(level=level, name='request', message=report.state)
            self._request_values.publish(diagnostic_array(self._stamp(), status, report.to_fields()))

    def _refuse(self, sentence: str) -> None:
        self._publish_answer(Reason(Code.CONTENT, sentence), '')

    def refuse_moves(self, why: str | Reason) -> None:
        """Publish the rejection of a move request that was not passed to the planner."""
        reason = why if isinstance(why, Reason) else Reason(Code.CONTENT, why)
        identity = self.request('move').identity
        self.report(
            RequestReport(
                id=identity,
                state=Phase.REJECTED,
                statements=0,
                remaining=0,
                code=str(reason.code),
                sentence=reason.sentence,
            )
        )
        self._publish_answer(reason, '')

    def _refuse_request(self, sentence: str) -> None:
        self._published_queue = ''  # publish again: the client may have received the queue of another planner
        self._refuse(sentence)

    def report_progress(self) -> None:
        """Report to waiting clients that their requests are in progress."""
        self.publish_queue()
        sentence = self._progress() or 'waiting'
        for _, _, received in list(self._pending.values()):
            if received is not None:
                self._server.reply(received, None, sentence, done=False)

    def publish_queue(self) -> None:
        """Publish the queue if it has changed."""
        moves, duration = self._planner.queue
        refusal = self._refusal
        report = QueueReport(
            identity=self._identity,
            moves=moves,
            duration_s=duration,
            override=self._planner.override,
            working=self._progress(),
            refusal=refusal.sentence if refusal else '',
            refusal_code=str(refusal.code) if refusal else '',
        )
        text = report.to_json()
        if text != self._published_queue:
            self._published_queue = text
            self._queue.publish(String(data=text))
        # without subscribers as well: the topic is latched
        if text != self._published_values and (stamp := self._stamp()) >= (0, 0):
            self._published_values = text
            level = DiagnosticStatus.WARN if report.refusal else DiagnosticStatus.OK
            sentence = report.refusal or report.working or counted(moves, 'move')
            status = DiagnosticStatus(level=level, name='queue', message=sentence)
            self._queue_values.publish(diagnostic_array(stamp, status, report.to_fields()))
