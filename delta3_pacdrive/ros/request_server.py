"""Requests of operators who say who they are: each is served once, and its answer is told again if it was lost."""

from collections.abc import Callable

from std_msgs.msg import String

from delta3_pacdrive.controller.messages import LastReplies, Numbering, Reply, Request, refuse_recording
from delta3_pacdrive.errors import Reason, RobotFault, TelegramError, shown
from delta3_pacdrive.ros.interfaces import TEXT_BYTES_MAX, Topic
from delta3_pacdrive.ros.robot_node import RobotNode


class RequestServer:
    """The requests to one receiver.

    Parameters
    ----------
    node
        Has the topics.
    requests, replies
        The topics.
    receiver
        Returns whom a request must be meant for; one for somebody else may come out of a recording.
    serve
        Called with each new request.
    changes
        Returns how often control of the robot has changed hands.
    refuse
        Called with a sentence about what is no request to this receiver; the log by default.

    """

    def __init__(
        self,
        node: RobotNode,
        requests: Topic,
        replies: Topic,
        receiver: Callable[[], str],
        serve: Callable[[Request], None],
        *,
        changes: Callable[[], int] = lambda: 0,
        bytes_max: int = TEXT_BYTES_MAX,
        refuse: Callable[[str], None] | None = None,
    ) -> None:
        self._receiver, self._serve, self._changes = receiver, serve, changes
        self._numbers = Numbering()
        self._last_replies = LastReplies()
        self._replies = replies.publisher(node)
        requests.bounded_subscription(node, self._on_request, bytes_max, refuse)

    def _on_request(self, message: String) -> None:
        request = Request.from_json(message.data)
        if request.receiver != self._receiver():
            self._publish(refuse_recording(request))
            raise TelegramError(f'a request to {shown(request.receiver)}, which is not here')
        if self._numbers.is_new(request.operator, request.number):
            self._serve(request)
        elif (last := self._last_replies.to(request)) is not None:
            self._publish(last)

    def reply(self, request: Request, reason: Reason | None, sentence: str, done: bool = True) -> None:
        """Tell what became of a request, or how far it is."""
        code, text = (str(reason.code), reason.sentence) if reason else ('', sentence)
        fault = RobotFault.facts(reason.fault if reason else None)
        reply = Reply(
            request.operator, request.number, done, reason is None, code, text, self._changes(), **fault
        )
        self._publish(reply)
        if done:
            self._last_replies.keep(reply)

    def _publish(self, reply: Reply) -> None:
        self._replies.publish(String(data=reply.to_json()))
