"""Text requests over topics: to the service channels of the drives, and of scripts.

In: ``sercos/service/request`` (String: "axis1 read S-0-0104", "axis2 write S-0-0104 70", "axis3 command S-0-0099").
Out: ``sercos/service/answer`` (String: one sentence for each request, with value and unit, or message 8503). All
clients receive all answers.
"""

from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.control.operation.service_texts import answer_text, parse_request, split_mark
from delta3_pacdrive.errors import Delta3Error, Reason
from delta3_pacdrive.robot.drive.operation_data import TABLE, refusal, value_text
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer, Operation, format_idn
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.interfaces import SERVICE_ANSWER, SERVICE_REQUEST
from delta3_pacdrive.ros.wire.request_server import RequestServer


def offer_service_requests(node: Node, controller: RobotController, changed: Callable[[], None]) -> None:
    """Offer the service channels on the graph; ``changed`` executes the resulting actions."""
    answers = SERVICE_ANSWER.publisher(node)

    def receive(message: String) -> None:
        mark, request = split_mark(message.data)

        def answer(text: str) -> None:
            answers.publish(String(data=f'{mark} {text}' if mark else text))

        try:
            index, access = parse_request(request, controller.services.drives)
            controller.commissioning.ask(
                index, access, lambda index, result: answer(outcome(index, access, result))
            )
        except Delta3Error as error:
            answer(answer_text(False, str(error)))
        changed()

    SERVICE_REQUEST.subscription(node, receive)


class ScriptRequests:
    """Receives the script requests of one transformation task; ``changed`` executes the resulting actions."""

    def __init__(self, node: RobotNode, controller: RobotController, changed: Callable[[], None]) -> None:
        self._scripts, self._changed = controller.scripts, changed

        def session() -> str:
            return controller.bus.session.decode()

        self._server = RequestServer(
            node,
            (interfaces.SCRIPT_REQUEST, interfaces.SCRIPT_REPLY),
            session,
            self._on_request,
            changes=lambda: controller.control.changes,
        )
        controller.scripts.reply = self._reply

    def _on_request(self, request: Request) -> None:
        self._scripts.ask(request)
        self._changed()

    def _reply(self, request: Request, reason: Reason | None, text: str, done: bool) -> None:
        self._server.reply(request, reason, text, done)


def outcome(index: int, access: Access, answer: Answer) -> str:
    """Return the response as text."""
    if answer.error:
        return answer_text(False, f'{ALL_DRIVES[index]}: {refusal(access, answer)}')
    row = TABLE[access.idn]
    result = ': done' if access.operation == Operation.COMMAND else f' = {value_text(row, answer.value)}'
    return answer_text(True, f'{ALL_DRIVES[index]}: {format_idn(access.idn)} {row.name}{result}')
