"""Script requests to the transformation task: ``script/request`` in, ``script/reply`` out (String, JSON)."""

from collections.abc import Callable

from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.errors import Reason
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.request_server import RequestServer
from delta3_pacdrive.ros.robot_node import RobotNode

REQUEST_BYTES_MAX = 4096


class ScriptRequests:
    """Receives the script requests of one transformation task; ``changed`` executes the resulting actions."""

    def __init__(self, node: RobotNode, controller: RobotController, changed: Callable[[], None]) -> None:
        self._scripts, self._changed = controller.scripts, changed

        def session() -> str:
            return controller.bus.session.decode()

        self._server = RequestServer(
            node,
            interfaces.SCRIPT_REQUEST,
            interfaces.SCRIPT_REPLY,
            session,
            self._on_request,
            changes=lambda: controller.control.changes,
            bytes_max=REQUEST_BYTES_MAX,
        )
        controller.scripts.reply = self._reply

    def _on_request(self, request: Request) -> None:
        self._scripts.ask(request)
        self._changed()

    def _reply(self, request: Request, reason: Reason | None, text: str, done: bool) -> None:
        self._server.reply(request, reason, text, done)
