"""Server of operator requests: executes each identified request once, and repeats the reply if it was lost."""

import time
from collections.abc import Callable, Container

from std_msgs.msg import String

from delta3_pacdrive.control.messages import Reply, Request, refuse_malformed, refuse_recording
from delta3_pacdrive.control.queue.request_queue import ReceivedRequests
from delta3_pacdrive.errors import Code, Reason, RefusedError, RobotFault, TelegramError, shown
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.interfaces import Topic


class RequestServer:
    """Receives the requests of one request topic.

    Parameters
    ----------
    topics
        Topic of the requests, and topic of the replies.
    receiver
        Returns the expected receiver; requests for others may come from a recording.
    serve
        Called with each new request.
    changes
        Returns how often control of the robot has changed hands.
    refuse
        Called with the reason when a message is rejected; the log by default.
    always
        Actions that are served even if there are too many operators.

    """

    def __init__(
        self,
        node: RobotNode,
        topics: tuple[Topic, Topic],
        receiver: Callable[[], str],
        serve: Callable[[Request], None],
        *,
        changes: Callable[[], int] = lambda: 0,
        refuse: Callable[[str], None] | None = None,
        always: Container[str] = (),
    ) -> None:
        self._receiver, self._serve, self._changes = receiver, serve, changes
        self._always = always
        self._received = ReceivedRequests()
        requests, replies = topics
        self._replies = replies.publisher(node)
        requests.bounded_subscription(node, self._on_request, refuse=refuse)

    def _on_request(self, message: String) -> None:
        try:
            request = Request.from_json(message.data)
        except TelegramError as error:
            refusal = refuse_malformed(message.data, str(error))
            if refusal is not None:
                self._publish(refusal)
            raise
        if request.receiver != self._receiver():
            self._publish(refuse_recording(request))
            raise TelegramError(f'a request to {shown(request.receiver)}, which is not here')
        # requests without an operator cannot be distinguished
        if not request.operator or self._is_new(request):
            self._serve(request)
        elif (last := self._received.reply(request)) is not None:
            self._publish(last)

    def _is_new(self, request: Request) -> bool:
        """Whether a request is received for the first time; publishes the reply if it is rejected."""
        try:
            return self._received.receive(request, time.monotonic())
        except RefusedError as error:
            if request.action in self._always and error.reason.code is Code.STATE:
                return True
            self._publish(self._reply(request, error.reason, '', done=True))
            return False

    def reply(self, request: Request, reason: Reason | None, sentence: str, done: bool = True) -> None:
        """Publish the result of a request, or its progress if not ``done``."""
        reply = self._reply(request, reason, sentence, done)
        self._publish(reply)
        if done:
            self._received.note(reply)

    def _reply(self, request: Request, reason: Reason | None, sentence: str, done: bool) -> Reply:
        code, text = (str(reason.code), reason.sentence) if reason else ('', sentence)
        fault = RobotFault.facts(reason.fault if reason else None)
        return Reply(
            operator=request.operator,
            number=request.number,
            done=done,
            accepted=reason is None,
            code=code,
            sentence=text,
            control=self._changes(),
            **fault,
        )

    def _publish(self, reply: Reply) -> None:
        self._replies.publish(String(data=reply.to_json()))
