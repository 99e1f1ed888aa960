"""Parameters of a robot, read from its nodes."""

import math
from contextlib import suppress
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.ros.parameters import shows

ANSWER_S = 2.0  # timeout for a reply before the robot is asked again
SOURCES = {
    'plant': 'plant',
    'mc4_drive_1': 'mc4_drive',
    'transformation_task': 'transformation_task',
}  # kind by node


def _plain(names: list[str], response: Any) -> dict[str, Any]:
    """Return parameter values by name from a node's response; raises RuntimeError for an unknown type."""
    values = [parameter_value_to_python(value) for value in response.values] if response else []
    return {
        name: value if isinstance(value, (bool, int, float, str)) else list(value)
        for name, value in zip(names, values, strict=False)
        if value is not None
    }


class RemoteParameters:
    """Reads all parameters of a robot, each from a node that declares it."""

    def __init__(self, node: Node) -> None:
        self._names = list(core.flatten(core.load(), absent=True))
        self._questions = {
            name: node.create_client(GetParameters, f'{name}/get_parameters') for name in SOURCES
        }
        self._answers: dict[str, tuple[list[str], Any]] = {}  # by node: names, and the pending response
        self._again_s, self._patience_s = -math.inf, ANSWER_S

    @property
    def ready(self) -> bool:
        """Whether the services of all source nodes are available."""
        return all(question.service_is_ready() for question in self._questions.values())

    def ask(self) -> None:
        """Send the requests; earlier ones are discarded."""
        left = self._names
        for node, question in self._questions.items():
            names = [name for name in left if shows(SOURCES[node], name)]
            left = [name for name in left if name not in names]
            self._answers[node] = names, question.call_async(GetParameters.Request(names=names))

    def ask_until_received(self, now_s: float) -> bool:
        """Send the requests if the last ones have timed out; return whether they were sent.

        The timeout doubles each time, because a busy robot may need longer than any fixed time.
        """
        if now_s < self._again_s or not self.ready:
            return False
        self._again_s, self._patience_s = now_s + self._patience_s, 2.0 * self._patience_s
        self.ask()
        return True

    def take(self) -> core.Parameters | None:
        """Return parameters received since the last call; None if incomplete or invalid."""
        if not self._answers or not all(answer.done() for _, answer in self._answers.values()):
            return None
        answers, self._answers = self._answers, {}
        plain: dict[str, Any] = {}
        for names, answer in answers.values():
            with suppress(RuntimeError):  # an invalid response counts as none
                plain |= _plain(names, answer.result())
        try:
            return core.from_flat(plain)
        except Delta3Error:
            return None
