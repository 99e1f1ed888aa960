"""The parameters of a robot, as its nodes tell them."""

import math
from contextlib import suppress
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.ros.parameters import shows

ANSWER_S = 2.0  # for an answer, before the robot is asked again
TELL_PARAMETERS = {
    'plant': 'plant',
    'mc4_drive_1': 'mc4_drive',
    'transformation_task': 'transformation_task',
}  # kinds


def _plain(names: list[str], response: Any) -> dict[str, Any]:
    """Return parameters by their names as a node has answered them; raises RuntimeError for a type that is none."""
    values = [parameter_value_to_python(told) for told in response.values] if response else []
    return {
        name: value if isinstance(value, (bool, int, float, str)) else list(value)
        for name, value in zip(names, values, strict=False)
        if value is not None
    }


class ToldParameters:
    """A node asks a robot for all of its parameters, each of a node that shows it."""

    def __init__(self, node: Node) -> None:
        self._names = list(core.flatten(core.load()))
        self._questions = {
            name: node.create_client(GetParameters, f'{name}/get_parameters') for name in TELL_PARAMETERS
        }
        self._answers: dict[str, tuple[list[str], Any]] = {}  # by node: names, and what is to come
        self._again_s, self._patience_s = -math.inf, ANSWER_S

    @property
    def ready(self) -> bool:
        """Whether all that tell them are there."""
        return all(question.service_is_ready() for question in self._questions.values())

    def ask(self) -> None:
        """Ask; what was asked for before is not waited for any more."""
        left = self._names
        for node, question in self._questions.items():
            names = [name for name in left if shows(TELL_PARAMETERS[node], name)]
            left = [name for name in left if name not in names]
            self._answers[node] = names, question.call_async(GetParameters.Request(names=names))

    def ask_until_told(self, now_s: float) -> bool:
        """Ask if all are there and the last question is old; whether it has asked.

        Each question has twice the time of the one before: a busy robot needs longer than any fixed time.
        """
        if now_s < self._again_s or not self.ready:
            return False
        self._again_s, self._patience_s = now_s + self._patience_s, 2.0 * self._patience_s
        self.ask()
        return True

    def take(self) -> core.Parameters | None:
        """Return what has been told since the last call; None for nothing, or what no robot of this version has."""
        if not self._answers or not all(answer.done() for _, answer in self._answers.values()):
            return None
        answers, self._answers = self._answers, {}
        plain: dict[str, Any] = {}
        for names, answer in answers.values():
            with suppress(RuntimeError):  # an answer that cannot be read is none
                plain |= _plain(names, answer.result())
        try:
            return core.from_flat(plain)
        except Delta3Error:
            return None
