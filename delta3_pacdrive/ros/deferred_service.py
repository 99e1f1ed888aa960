"""Services that reply when the requested action has finished, not when the callback returns."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service

from delta3_pacdrive.errors import Reason

Respond = Callable[[Reason | None, str], None]  # reason of a rejection, or None and the result


class _Pending:
    """A response that is sent once, as soon as both its content and its address are known."""

    def __init__(self, response: Any, send: Callable[[Any, Any], None]) -> None:
        self._response, self._send = response, send
        self._header: Any = None
        self._filled = False

    def respond(self, reason: Reason | None, sentence: str) -> None:
        """Fill the response; later calls are ignored."""
        if self._filled:
            return
        self._filled = True
        self._response.success = reason is None
        self._response.message = reason.sentence if reason else sentence
        self._send_if_complete()

    def address(self, header: Any) -> None:
        """Set the request header to which the response is sent."""
        self._header = header
        self._send_if_complete()

    def _send_if_complete(self) -> None:
        if self._filled and self._header is not None:
            self._send(self._response, self._header)


def create_deferred_service(node: Node, kind: Any, name: str, ask: Callable[[Any, Respond], None]) -> Service:
    """Create a service whose callback receives the request and a function that replies to it.

    The response of ``kind`` has the fields ``success`` and ``message``, as in Trigger and SetBool.
    """

    def serve(request: Any, response: Any) -> _Pending:
        pending = _Pending(response, send)
        ask(request, pending.respond)
        return pending

    service = node.create_service(kind, name, serve)
    send = service.send_response
    # the executor passes the callback's return value and the request header to this method
    service.send_response = _Pending.address  # type: ignore[method-assign, assignment]
    return service
