"""Node of an operator: sends requests to the planner and the transformation task and waits for the replies."""

import math
import os
import secrets
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass
from typing import Any

from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import TwistStamped
from rclpy.client import Client
from rclpy.task import Future
from std_msgs.msg import Header, String

from delta3_pacdrive import interrupts
from delta3_pacdrive.control import messages
from delta3_pacdrive.control.messages import QueueReport, Reply, Request
from delta3_pacdrive.control.operation.service_texts import parse_answer, split_mark
from delta3_pacdrive.errors import (
    Code,
    ProgramError,
    RefusedError,
    RunError,
    RunInterruptedError,
    TelegramError,
)
from delta3_pacdrive.planning.program.adaptation import AS_IT_IS, Adaptation
from delta3_pacdrive.recording.motion_progress import NO_REPORT, MotionProgress
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.present_robot import PresentRobot
from delta3_pacdrive.ros.wire import discovery, domain, interfaces
from delta3_pacdrive.ros.wire.polling import PollingNode

LOOK_S = 0.02
PATIENCE_S = 10.0  # timeout without any reply
AGAIN_S = 1.0  # before a request is repeated: it, or its reply, may have been lost
WITHDRAWAL_S = 1.0  # timeout for the reply to a withdrawal
ALIVE_S = 0.2
NAME_MAX = 90
BUS_RECEIVERS = ('control', 'script')  # receivers that are identified by the bus session
# action by service name for requests to the transformation task; all others go to the planner
TASK_ACTIONS = messages.STOPS | {
    action: action for action in (messages.ENABLE, messages.RESET, messages.STEER, messages.END_STEERING)
}


@dataclass
class _Awaited:
    """State of a request: when it was last heard of, its progress, and its reply."""

    received_s: float
    progress: str = ''
    reply: Reply | None = None


class OperatorNode(PollingNode):
    """Client of one robot. Every wait is bounded; ``spin_for`` may send a stop during another request.

    ``state`` is the newest ``motion/state``; while a recording is played back, it is taken from the progress.
    """

    def __init__(
        self, spin_for: Callable[[float], None], name: str = interfaces.OPERATOR, **node_options: Any
    ) -> None:
        super().__init__(name, **node_options)
        self.spin_for = spin_for
        self.show: Callable[[str], None] = lambda _: None  # called with the progress of a long request
        self.identity = secrets.token_hex(8)
        self.in_control = False  # as far as this client knows
        self.interruptible = True  # a signal ends a wait
        self.progress = NO_REPORT  # newest motion/progress
        self.progress_s = time.monotonic()  # when it arrived
        self.queue: QueueReport | None = None
        self.state = ''
        self.state_changes = 0
        self._numbers = self._beats = self._control = 0
        self._awaited: dict[int, _Awaited] = {}  # by number of the request
        self.present, self._alone = PresentRobot(self), True
        interfaces.PROGRESS.subscription(self, self._on_progress)
        interfaces.MOTION_STATE.subscription(self, self._on_state)
        interfaces.QUEUE.subscription(self, self._on_queue)
        self._requests = {}
        for whom, request, reply in (
            ('unit_robot', interfaces.PLANNER_REQUEST, interfaces.PLANNER_REPLY),
            ('control', interfaces.CONTROL_REQUEST, interfaces.CONTROL_REPLY),
        ):
            self._requests[whom] = request.publisher(self)
            reply.subscription(self, self._on_reply)
        self._alive = interfaces.CONTROL_ALIVE.publisher(self)
        self._inject = interfaces.INJECT_FAULT.client(self)
        self._input = interfaces.INPUT.client(self)
        self._request = interfaces.SERVICE_REQUEST.publisher(self)
        self._service_answers: dict[str, str] = {}  # by the mark of the request
        interfaces.SERVICE_ANSWER.subscription(self, self._on_service_answer)
        self.create_timer(LOOK_S, lambda: None)  # the executor needs a timer to keep its waits short
        self.create_timer(ALIVE_S, self._send_heartbeat)

    def _on_progress(self, message: String) -> None:
        try:
            progress = MotionProgress.from_json(message.data)
        except TelegramError:
            return
        if not self.present.accepts(progress):
            return
        self.progress, self.progress_s = progress, time.monotonic()
        before, self._alone = self._alone, self.present.is_alone
        if not (before and self._alone):  # a motion/state may have been missed
            self._set_state(progress.state)
        if self.progress.control >= self._control and self.progress.operator_identity != self.identity:
            self.in_control = False

    def _on_queue(self, message: String) -> None:
        with suppress(TelegramError):
            queue = QueueReport.from_json(message.data)
            if self.present.is_planner(queue.identity):
                self.queue = queue

    def _on_service_answer(self, message: String) -> None:
        mark, answer = split_mark(message.data)
        self._service_answers[mark] = answer

    def _on_state(self, message: String) -> None:
        if self.present.is_alone:
            self._set_state(message.data)
        else:  # from a recording, or discovery is incomplete: the next report decides
            self._alone = False

    def _set_state(self, state: str) -> None:
        self.state_changes += state != self.state
        self.state = state

    def _on_reply(self, message: String) -> None:
        try:
            reply = Reply.from_json(message.data)
        except TelegramError:
            return
        awaited = self._awaited.get(reply.number) if reply.operator == self.identity else None
        if awaited is None:
            return
        awaited.received_s = time.monotonic()
        if reply.done:
            awaited.reply = reply
        else:
            awaited.progress = reply.sentence

    def _send_heartbeat(self) -> None:
        if self.in_control:
            self._beats += 1
            message = Header(frame_id=self.identity)
            message.stamp.sec = self._beats
            self._alive.publish(message)

    def wait_until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
        """Spin until a condition is met; raises RunError after a timeout [s]."""
        deadline = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > deadline:
                raise RunError(
                    f'no {what} within {patience_s:g} s: is a robot up in namespace {self.get_namespace()}?'
                )
            self.spin_for(LOOK_S)

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, whom: str, action: str, text: str = '', adaptation: Adaptation = AS_IT_IS) -> str:
        """Send a request to ``unit_robot`` or ``control``; return the reply.

        A long request reports its progress. If it times out or is interrupted, it is withdrawn from the planner; the
        error message states whether it may still be executed.

        Raises
        ------
        RefusedError
            The request was rejected.
        ProgramError
            It is too large.
        RunError
            The reply did not arrive in time.

        """
        try:
            return self._ask_once(whom, action, text, adaptation)
        except RefusedError as error:
            if error.reason.code != Code.FOREIGN:
                raise
        return self._ask_once(whom, action, text, adaptation)

    def _receiver(self, whom: str) -> str:
        """Return the identity of the receiver, empty until it is known."""
        if whom in BUS_RECEIVERS:
            return self.progress.session
        return self.queue.identity if self.queue else ''

    def _clear_receiver(self, whom: str, receiver: str) -> None:
        """Clear the identity of a receiver that has gone, unless a new one is known already."""
        if self._receiver(whom) != receiver:
            return
        if whom in BUS_RECEIVERS:
            self.progress = NO_REPORT
        else:
            self.queue = None

    def _ask_once(self, whom: str, action: str, text: str, adaptation: Adaptation) -> str:
        publisher = self._requests[whom]
        self.wait_until(
            lambda: (
                self._receiver(whom)
                and publisher.get_subscription_count()
                and self.count_publishers(f'{whom}/reply')
            ),
            'UnitRobot' if whom == 'unit_robot' else 'transformation task',
        )
        self._numbers += 1
        receiver = self._receiver(whom)
        request = Request(
            receiver, self.identity, self._numbers, self._control, action, text, *astuple(adaptation)
        )
        message = String(data=request.to_json())
        if len(message.data) > interfaces.REQUEST_BYTES_MAX:
            raise ProgramError(
                f'the request has {len(message.data)} bytes, the limit is {interfaces.REQUEST_BYTES_MAX}'
            )
        asked = time.monotonic()
        # before publishing: another thread may receive the reply
        awaited = self._awaited[request.number] = _Awaited(asked)
        progress = ''
        try:
            publisher.publish(message)
            while awaited.reply is None:
                now = time.monotonic()
                if now - awaited.received_s > PATIENCE_S:
                    raise RunError(
                        f'no reply of {whom} to "{action}" within {PATIENCE_S:g} s: is a robot up in namespace '
                        f'{self.get_namespace()}?'
                    )
                if now - asked > AGAIN_S and awaited.received_s < asked + AGAIN_S:
                    publisher.publish(message)
                    asked = now
                if awaited.progress != progress:
                    progress = awaited.progress
                    self.show(progress)
                self.spin_for(LOOK_S)
        except (RunError, KeyboardInterrupt) as error:
            raise type(error)(f'{error}{self._withdraw(whom, request)}') from None
        finally:
            del self._awaited[request.number]
        reply = awaited.reply
        self._control = max(self._control, reply.control)
        if reply.reason is not None:
            if reply.reason.code == Code.FOREIGN:  # planner or bus have restarted
                self._clear_receiver(whom, receiver)
            raise RefusedError(reply.reason)
        return reply.sentence

    def _withdraw(self, whom: str, request: Request) -> str:
        """Withdraw a request; return a suffix for the error message, empty if the withdrawal succeeded."""
        if whom != 'unit_robot':  # the transformation task executes requests immediately
            return f'; "{request.action}" may still be executed'
        self._numbers += 1
        withdrawal = Request(
            receiver=request.receiver,
            operator=self.identity,
            number=self._numbers,
            control=0,
            action='withdraw',
            text=str(request.number),
        )
        awaited = self._awaited[self._numbers] = _Awaited(time.monotonic())
        before, self.interruptible = self.interruptible, False
        try:
            self._requests[whom].publish(String(data=withdrawal.to_json()))
            while awaited.reply is None and time.monotonic() < awaited.received_s + WITHDRAWAL_S:
                self.spin_for(LOOK_S)
        finally:
            self.interruptible = before
            del self._awaited[withdrawal.number]
        reply = awaited.reply
        if reply is None:
            return f'; "{request.action}" may still be executed: its withdrawal was not confirmed'
        return '' if reply.accepted else f'; {reply.sentence}'

    def take_control(self, name: str, by_force: bool = False) -> str:
        """Take control of the robot until it is released; raises RefusedError if another operator has it."""
        who = f'{name}, process {os.getpid()} on {socket.gethostname()}'[:NAME_MAX]
        sentence = self.ask('control', messages.TAKE_OVER if by_force else messages.TAKE, who)
        self.in_control = True
        self._send_heartbeat()
        return sentence

    def release_control(self) -> None:
        """Release control; motion continues."""
        if self.in_control:
            self.in_control = False
            self.ask('control', messages.RELEASE)

    def send_program(self, text: str, adaptation: Adaptation = AS_IT_IS) -> str:
        """Append a program in YAML, or a packaged one by its name, to the queue."""
        return self.ask('unit_robot', 'program', text, adaptation)

    def start_program(self, text: str, adaptation: Adaptation = AS_IT_IS) -> str:
        """Append a program to the queue and start it; if the start is rejected, the queue is unchanged."""
        return self.ask('unit_robot', 'start', text, adaptation)

    def move(self, text: str, adaptation: Adaptation = AS_IT_IS) -> str:
        """Execute moves in YAML or a packaged program, appended to the current motion if the robot moves or is held."""
        return self.ask('unit_robot', 'move', text, adaptation)

    def override(self, percent: float) -> str:
        """Set the override."""
        return self.ask('unit_robot', 'override', repr(percent))

    def call(self, name: str, text: str = '') -> str:
        """Call the action of a service, ``disable`` or ``steer``; raises RefusedError if it is rejected."""
        if name in TASK_ACTIONS:
            return self.ask('control', TASK_ACTIONS[name], text)
        return self.ask('unit_robot', name, text)

    def velocities(self) -> Callable[[float, float, float], None]:
        """Return a function that sends a velocity of the TCP [m/s] to a steered robot."""
        publisher = interfaces.SERVO_TWIST.publisher(self)

        def send(x_m_s: float, y_m_s: float, z_m_s: float) -> None:
            message = TwistStamped()
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
            linear = message.twist.linear
            linear.x, linear.y, linear.z = x_m_s, y_m_s, z_m_s
            publisher.publish(message)

        return send

    def enable(self, on: bool) -> str:
        """Enable or disable the drives."""
        return self.call('enable' if on else 'disable')

    @property
    def reaches_drives(self) -> bool:
        """Whether a transformation task accepts requests to the drives and replies."""
        listening = self._request.get_subscription_count()
        return bool(listening and self.count_publishers('sercos/service/answer'))

    def drive(self, request: str) -> str:
        """Send a request to a service channel ("axis1 read S-0-0104"); raises ProgramError if it is rejected."""
        self.wait_until(lambda: self.reaches_drives, 'transformation task')
        mark = f'#{secrets.token_hex(4)}'  # every client receives every answer
        self._service_answers.clear()
        self._request.publish(String(data=f'{mark} {request}'))
        self.wait_until(lambda: mark in self._service_answers, 'reply of the service channel')
        accepted, sentence = parse_answer(self._service_answers[mark])
        if not accepted:
            raise ProgramError(sentence)
        return sentence

    def inject(self, fault: str) -> str:
        """Inject a fault, in YAML as in program files; raises ProgramError if it is rejected."""
        # the mark makes repeated requests idempotent
        return self._call(self._inject, f'#{secrets.token_hex(4)} {fault}')

    def input(self, request: str = '') -> str:
        """Force an input, ``{name: part, value: true}`` in YAML, or list all inputs; raises ProgramError."""
        return self._call(self._input, request)

    def _call(self, client: Client, text: str) -> str:
        """Call a service repeatedly until it replies: replies to a newly discovered client may be lost."""
        self.wait_until(client.service_is_ready, f'service {client.srv_name}')
        calls: list[Future] = []
        asked = -math.inf

        def answered() -> Future | None:
            nonlocal asked
            if time.monotonic() - asked > AGAIN_S:
                calls.append(client.call_async(AddDiagnostics.Request(load_namespace=text)))
                asked = time.monotonic()
            return next((call for call in calls if call.done()), None)

        self.wait_until(answered, f'reply of service {client.srv_name}')
        response = next(call for call in calls if call.done()).result()
        if not response.success:
            raise ProgramError(response.message)
        return str(response.message)


@contextmanager
def operating(namespace: str) -> Iterator[OperatorNode]:
    """Create an operator of the robot in a namespace, in a process without other ROS nodes.

    A signal raises RunInterruptedError once where the operator waits; the operator can be used after it.
    """
    absolute = domain.namespace(namespace)
    discovery.keep_to_this_machine()
    signals: list[int] = []
    before = {
        number: signal.signal(number, lambda n, _: signals.append(n))
        for number in interrupts.NUMBERS
        if signal.getsignal(number) != signal.SIG_IGN
    }
    node_process.join()
    process = node_process.Process()

    def spin_for(seconds: float) -> None:
        process.spin_for(seconds)
        if signals and operator.interruptible:
            number = signals[0]
            signals.clear()
            interrupts.note(number)
            raise RunInterruptedError(interrupts.sentence(number))

    operator = OperatorNode(spin_for, namespace=absolute)
    process.add(operator)
    try:
        yield operator
    finally:
        node_process.leave(process)
        for number, handler in before.items():
            signal.signal(number, handler)
