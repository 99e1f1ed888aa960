"""What operators ask of the planner: programs, moves, start, resume, clear, override; and what they are answered.

In: ``unit_robot/program`` (String: YAML, or the name of a packaged program), ``unit_robot/move_l`` (PointStamped),
``unit_robot/move_c`` (Path: circle point, end), ``unit_robot/move_sb`` (Path of at most 100 poses),
``joint_trajectory`` (JointTrajectory: arm angles over time, followed at once),
``unit_robot/override`` (Float64, percent), and ``unit_robot/request`` (String, JSON: the same, of operators who say who
they are). Out: ``unit_robot/answer`` (latched: one sentence for each request), ``unit_robot/reply`` (JSON: the answer
to a request), ``unit_robot/queue`` (latched, JSON: what is in it, the override, what is being planned, why
the newest request was refused), ``unit_robot/requests`` (JSON: what becomes of the moves of each request). Services:
``start``, ``resume``, ``clear``, and ``unit_robot/move`` (moves in YAML, answered with an id).
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from diagnostic_msgs.srv import AddDiagnostics
from std_msgs.msg import String
from std_srvs.srv import Trigger

from delta3_pacdrive.controller.messages import QueueReport, Request, RequestReport
from delta3_pacdrive.controller.planner import Planner
from delta3_pacdrive.controller.request_service import FOR_MOVES
from delta3_pacdrive.controller.request_tracker import Phase
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.ros import interfaces, move_messages
from delta3_pacdrive.ros.deferred_service import Tell
from delta3_pacdrive.ros.joint_trajectory import joint_trajectory
from delta3_pacdrive.ros.request_server import RequestServer
from delta3_pacdrive.ros.robot_node import RobotNode


class PlannerServices:
    """Services of one planner.

    Parameters
    ----------
    node
        Has the services.
    planner, identity
        Decides, and what it is known by.
    progress
        Says how far the planning is, empty while nothing is planned.
    changed
        Called when the planner was asked for something: whatever it wants done has to be done.

    """

    def __init__(
        self,
        node: RobotNode,
        planner: Planner,
        identity: str,
        progress: Callable[[], str],
        changed: Callable[[], None],
    ) -> None:
        self._log, self._planner, self._identity = node.get_logger(), planner, identity
        self._progress, self._changed = progress, changed
        # by the identity of the request: it, what is called with its answer, and as which it is answered by topic
        self._asked: dict[int, tuple[Request, Tell | None, Request | None]] = {}
        self._anonymous = 0  # requests of clients without an identity
        self._refusal: Reason | None = None  # of the newest request
        self._told_queue = ''
        self._answer = interfaces.ANSWER.publisher(node)
        self._queue = interfaces.QUEUE.publisher(node)
        self._server = RequestServer(
            node,
            interfaces.PLANNER_REQUEST,
            interfaces.PLANNER_REPLY,
            lambda: identity,
            self._on_request,
            bytes_max=interfaces.REQUEST_BYTES_MAX,
            refuse=self._refuse_request,
        )
        for topic, receive in (
            (interfaces.PROGRAM, lambda message: self._ask_openly('program', message.data)),
            (interfaces.MOVE_L, self._enqueue(move_messages.move_l)),
            (interfaces.MOVE_C, self._enqueue(move_messages.move_c)),
            (interfaces.MOVE_SB, self._enqueue(move_messages.move_sb)),
            (
                interfaces.JOINT_TRAJECTORY,
                lambda message: self._ask_openly('trajectory', joint_trajectory(message).to_json()),
            ),
            (interfaces.OVERRIDE, lambda message: self._ask_openly('override', repr(message.data))),
        ):
            refuse = self._refuse if topic is interfaces.OVERRIDE else self.refuse_moves
            topic.bounded_subscription(node, receive, interfaces.PROGRAM_BYTES_MAX, refuse)
        self._requests = interfaces.REQUESTS.publisher(node)
        for service in (interfaces.START, interfaces.RESUME, interfaces.CLEAR):
            service.deferred_servers(node, partial(self._serve, service.name))
        interfaces.MOVE.deferred_servers(node, self._move)

    # requests ---------------------------------------------------------------------------------------------------------

    def _ask(self, action: str, text: str = '', tell: Tell | None = None) -> None:
        """Pass on the request of a client that has no identity."""
        self.pass_on(self.request(action, text), tell)

    def _ask_openly(self, action: str, text: str) -> None:
        """Pass on what came on a topic, unless it may come from a bag that is played back."""
        reason = self._planner.played_back(time.monotonic())
        if reason is None:
            self._ask(action, text)
        elif action in FOR_MOVES:
            self.refuse_moves(reason)
        else:
            self._say(reason, '')

    def request(self, action: str, text: str = '') -> Request:
        """Return the request of a client that has no identity."""
        self._anonymous += 1
        return Request(self._identity, '', self._anonymous, 0, action, text)

    def pass_on(self, request: Request, tell: Tell | None = None, received: Request | None = None) -> None:
        """Pass on a request; ``tell`` is called with its answer, and the reply goes to the one that was received."""
        self._asked[id(request)] = request, tell, received
        self._planner.ask(request, time.monotonic())
        self._changed()

    def _serve(self, action: str, _: Trigger.Request, tell: Tell) -> None:
        self._ask(action, tell=tell)

    def _move(self, request: AddDiagnostics.Request, tell: Tell) -> None:
        """Pass on moves whose answer tells by which id they are known."""
        text = request.load_namespace
        asked = self.request('move', text)

        def answer(reason: Reason | None, sentence: str) -> None:
            code, said = (str(reason.code), reason.sentence) if reason else ('', sentence)
            told = json.dumps({'id': asked.identity, 'code': code, 'sentence': said})
            tell(reason and replace(reason, sentence=told), told)

        if len(text.encode()) > interfaces.PROGRAM_BYTES_MAX:
            size = f'the request has {len(text.encode())} bytes, the limit is {interfaces.PROGRAM_BYTES_MAX}'
            answer(Reason(Code.CONTENT, size), '')
        elif not text.strip():
            answer(Reason(Code.CONTENT, 'the request is empty: it needs moves, or the name of a program'), '')
        else:
            self.pass_on(asked, answer)

    def _enqueue(self, statement: Callable[[Any], move_messages.Statement]) -> Callable[[Any], None]:
        return lambda message: self._ask_openly('program', json.dumps({'moves': [statement(message)]}))

    def _on_request(self, request: Request) -> None:
        own = request
        if not request.operator and request.action == 'withdraw':
            self._server.reply(
                request, Reason(Code.CONTENT, 'a withdrawal needs the identity of its operator'), ''
            )
            return
        if not request.operator:  # others may count from 1 as well
            self._anonymous += 1
            own = replace(request, receiver=self._identity, number=self._anonymous)
        self.pass_on(own, received=request)

    # answers ----------------------------------------------------------------------------------------------------------

    def reply(self, request: Request, reason: Reason | None, sentence: str) -> None:
        """Answer a request, with the reason if it is refused."""
        _, tell, received = self._asked.pop(id(request), (request, None, None))
        if tell is not None:
            tell(reason, sentence)
        if received is not None:
            self._server.reply(received, reason, sentence)
        self._say(reason, sentence)

    def _say(self, reason: Reason | None, sentence: str) -> None:
        """Say to everybody what became of the newest request."""
        self._refusal = reason
        if reason is None:
            self._log.info(sentence)
            self._answer.publish(String(data=f'accepted: {sentence}'))
        else:
            self._log.error(reason.sentence)
            self._answer.publish(String(data=f'refused: {reason.sentence}'))
        self.tell_queue()

    def report(self, report: RequestReport) -> None:
        """Tell what has become of the moves of a request."""
        self._requests.publish(String(data=report.to_json()))

    def _refuse(self, sentence: str) -> None:
        self._say(Reason(Code.CONTENT, sentence), '')

    def refuse_moves(self, why: str | Reason) -> None:
        """Publish that a request for moves, which the planner has not seen, is refused."""
        reason = why if isinstance(why, Reason) else Reason(Code.CONTENT, why)
        identity = self.request('move').identity
        self.report(RequestReport(identity, Phase.REFUSED, 0, 0, str(reason.code), reason.sentence))
        self._say(reason, '')

    def _refuse_request(self, sentence: str) -> None:
        self._told_queue = ''  # who asks may have heard the queue of another planner
        self._refuse(sentence)

    def tell_progress(self) -> None:
        """Tell those who wait that their requests are being worked on, and how far."""
        self.tell_queue()
        sentence = self._progress() or 'waiting'
        for _, _, received in list(self._asked.values()):
            if received is not None:
                self._server.reply(received, None, sentence, done=False)

    def tell_queue(self) -> None:
        """Tell what is in the queue, if that has changed."""
        moves, duration = self._planner.queue
        refusal = self._refusal
        report = QueueReport(
            self._identity,
            moves,
            duration,
            self._planner.override,
            self._progress(),
            refusal.sentence if refusal else '',
            str(refusal.code) if refusal else '',
        )
        text = report.to_json()
        if text != self._told_queue:
            self._told_queue = text
            self._queue.publish(String(data=text))
