"""Text requests of operators to the service channels of the drives.

In: ``sercos/service/request`` (String: "axis1 read S-0-0104", "axis2 write S-0-0104 70", "axis3 command S-0-0099").
Out: ``sercos/service/answer`` (String: one sentence for each request, with value and unit, or message 8503). All
clients receive all answers.
"""

from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.controller.service_outcome import outcome
from delta3_pacdrive.controller.service_texts import answer_text, parse_request, split_mark
from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.ros.interfaces import SERVICE_ANSWER, SERVICE_REQUEST
from delta3_pacdrive.sercos.service_requests import ServiceRequests


def offer_service_requests(node: Node, requests: ServiceRequests) -> None:
    """Offer the service channels on the graph."""
    answers = SERVICE_ANSWER.publisher(node)

    def receive(message: String) -> None:
        mark, request = split_mark(message.data)

        def answer(text: str) -> None:
            answers.publish(String(data=f'{mark} {text}' if mark else text))

        try:
            index, access = parse_request(request, requests.drives)
            requests.ask(index, access, lambda index, result: answer(outcome(index, access, result)))
        except Delta3Error as error:
            answer(answer_text(False, str(error)))

    SERVICE_REQUEST.subscription(node, receive)
