"""Services that are answered when what was asked for has happened, not when the callback returns."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service

from delta3_pacdrive.errors import Reason

Tell = Callable[[Reason | None, str], None]  # why something was refused, or None and what has happened


class _Pending:
    """A response that is not there yet, or one that nobody has said where to send to yet; sent once."""

    def __init__(self, response: Any, send: Callable[[Any, Any], None]) -> None:
        self._response, self._send = response, send
        self._header: Any = None
        self._filled = False

    def tell(self, reason: Reason | None, sentence: str) -> None:
        """Fill the response; only the first answer counts."""
        if self._filled:
            return
        self._filled = True
        self._response.success = reason is None
        self._response.message = reason.sentence if reason else sentence
        self._send_if_complete()

    def address(self, header: Any) -> None:
        """Take note of whose request it answers."""
        self._header = header
        self._send_if_complete()

    def _send_if_complete(self) -> None:
        if self._filled and self._header is not None:
            self._send(self._response, self._header)


def create_deferred_service(node: Node, kind: Any, name: str, ask: Callable[[Any, Tell], None]) -> Service:
    """Create a service whose callback gets the request and what answers it.

    ``kind`` has a response with these two fields, as Trigger and SetBool have.
    """

    def serve(request: Any, response: Any) -> _Pending:
        pending = _Pending(response, send)
        ask(request, pending.tell)
        return pending

    service = node.create_service(kind, name, serve)
    send = service.send_response
    # executors send what the callback returns by this method, with the header that says where to
    service.send_response = _Pending.address  # type: ignore[method-assign, assignment]
    return service
