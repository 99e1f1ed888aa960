"""Node of an operator: asks UnitRobot and the transformation task, and waits for what they answer."""

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.srv import AddDiagnostics
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.nodes import discovery, runtime
from delta3_pacdrive.nodes.polling import PollingNode
from delta3_pacdrive.nodes.progress_report import read_progress
from delta3_pacdrive.nodes.qos import LATCHED, REPORT, REQUEST
from delta3_pacdrive.nodes.service_desk import split_mark

LOOK_S = 0.02
PATIENCE_S = 10.0
SERVICES = ('start', 'resume', 'clear', 'hold', 'abort', 'emergency_stop', 'reset')


class OperatorNode(PollingNode):
    """Client of one robot; every wait is bounded.

    Attributes
    ----------
    progress
        The newest ``motion/progress``.
    state, state_changes
        The newest ``motion/state``, and how many there were.

    """

    def __init__(self, spin_for: Callable[[float], None], **node_options: Any) -> None:
        super().__init__('operator', **node_options)
        self.spin_for = spin_for
        self.progress: dict[str, Any] = {}
        self.state = ''
        self.state_changes = 0
        self.create_subscription(String, 'motion/progress', self._on_progress, REPORT)
        self.create_subscription(String, 'motion/state', self._on_state, LATCHED)
        self.create_subscription(String, 'motion/refusal', self._on_refusal, REQUEST)
        self._refusals: list[str] = []
        self._take_answer = self.create_polled_subscription(String, 'unit_robot/answer', LATCHED)
        self._program = self.create_publisher(String, 'unit_robot/program', REQUEST)
        self._override = self.create_publisher(Float64, 'unit_robot/override', REQUEST)
        self._triggers = {name: self.create_client(Trigger, name) for name in SERVICES}
        self._enable = self.create_client(SetBool, 'enable')
        self._inject = self.create_client(AddDiagnostics, 'inject_fault')
        self._request = self.create_publisher(String, 'sercos/service/request', REQUEST)
        self._service_answers: dict[str, str] = {}  # by the mark of the request
        self.create_subscription(
            String,
            'sercos/service/answer',
            self._on_service_answer,
            REQUEST,
        )
        self.create_timer(LOOK_S, lambda: None)  # the executor needs one to keep its waits short

    def _on_progress(self, message: String) -> None:
        self.progress = read_progress(message.data) or self.progress

    def _on_service_answer(self, message: String) -> None:
        mark, answer = split_mark(message.data)
        self._service_answers[mark] = answer

    def _on_refusal(self, message: String) -> None:
        self._refusals.append(message.data)

    def _on_state(self, message: String) -> None:
        self.state = message.data
        self.state_changes += 1

    def wait_until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
        """Spin until a condition holds; raises RunError after a while."""
        deadline = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > deadline:
                raise RunError(
                    f'no {what} within {patience_s:g} s: is a robot up in namespace {self.get_namespace()}?'
                )
            self.spin_for(LOOK_S)

    def _ask(self, publisher: Any, message: Any) -> str:
        """Publish a request, return the sentence that it is answered with; raises ProgramError if it is refused."""
        self.wait_until(
            lambda: publisher.get_subscription_count() and self.count_publishers('unit_robot/answer'),
            'UnitRobot',
        )
        since_ns = time.time_ns()
        publisher.publish(message)
        answers: list[str] = []
        self.wait_until(lambda: self._newer_answers(since_ns, answers), 'answer of UnitRobot')
        verdict, _, sentence = answers[-1].partition(': ')
        if verdict == 'refused':
            raise ProgramError(sentence)
        return sentence

    def _newer_answers(self, since_ns: int, answers: list[str]) -> list[str]:
        while (taken := self._take_answer()) is not None:
            # the latched answer to an older request may come first
            if taken[1]['source_timestamp'] >= since_ns:
                answers.append(deserialize_message(taken[0], String).data)
        return answers

    def send_program(self, text: str) -> str:
        """Append a program in YAML, or a packaged one by its name, to the queue."""
        return self._ask(self._program, String(data=text))

    def override(self, percent: float) -> str:
        """Set the override."""
        return self._ask(self._override, Float64(data=percent))

    def _result(self, client: Any, request: Any, what: str) -> str:
        self.wait_until(client.service_is_ready, f'service {what}')
        future = client.call_async(request)
        self.wait_until(future.done, f'answer of service {what}')
        response = future.result()
        if not response.success:
            raise ProgramError(response.message)
        return str(response.message)

    def call(self, name: str) -> str:
        """Call one of ``SERVICES``; raises ProgramError if it is refused."""
        self._refusals.clear()
        return self._result(self._triggers[name], Trigger.Request(), name)

    def await_reset(self) -> str:
        """Wait for what becomes of a reset that was called; raises ProgramError with the cause that is still there."""
        before = self.progress
        self.wait_until(
            lambda: self._refusals or (self.progress is not before and not self.progress['fault']),
            'end of the fault',
        )
        if self._refusals:
            raise ProgramError(self._refusals[-1])
        return 'faults cleared'

    def drive(self, request: str) -> str:
        """Ask a drive through its service channel ("axis1 read S-0-0104"); raises ProgramError if it refuses."""
        self.wait_until(
            lambda: self._request.get_subscription_count() and self.count_publishers('sercos/service/answer'),
            'transformation task',
        )
        mark = f'#{secrets.token_hex(4)}'  # others ask as well, and everybody hears every answer
        self._service_answers.clear()
        self._request.publish(String(data=f'{mark} {request}'))
        self.wait_until(lambda: mark in self._service_answers, 'answer of the service channel')
        verdict, _, text = self._service_answers[mark].partition(': ')
        if verdict == 'refused':
            raise ProgramError(text)
        return text

    def inject(self, fault: str) -> str:
        """Inject a fault, in YAML as in program files; raises ProgramError if it is refused."""
        request = AddDiagnostics.Request(load_namespace=fault)
        return self._result(self._inject, request, 'inject_fault')

    def enable(self, on: bool) -> str:
        """Enable or disable the drives."""
        return self._result(self._enable, SetBool.Request(data=on), 'enable')


@contextmanager
def operating(namespace: str) -> Iterator[OperatorNode]:
    """Be an operator of the robot in a namespace, in a process that does nothing else with ROS."""
    discovery.keep_to_this_machine()
    rclpy.init()
    process = runtime.Process()
    operator = OperatorNode(process.spin_for, namespace='/' + namespace.strip('/'))
    process.add(operator)
    try:
        yield operator
    finally:
        process.close()
        rclpy.try_shutdown()
