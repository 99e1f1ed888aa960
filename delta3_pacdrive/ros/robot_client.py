"""Node of an operator: asks UnitRobot and the transformation task, and waits for what they answer."""

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
from rclpy.client import Client
from rclpy.task import Future
from std_msgs.msg import Header, String

from delta3_pacdrive import interrupts
from delta3_pacdrive.controller import messages
from delta3_pacdrive.controller.messages import QueueReport, Reply, Request
from delta3_pacdrive.controller.service_texts import parse_answer, split_mark
from delta3_pacdrive.errors import (
    Code,
    ProgramError,
    RefusedError,
    RunError,
    RunInterruptedError,
    TelegramError,
)
from delta3_pacdrive.motion.adaptation import AS_IT_IS, Adaptation
from delta3_pacdrive.ros import discovery, domain, interfaces, node_process
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.ros.present_robot import PresentRobot
from delta3_pacdrive.ros.progress_report import read_progress

LOOK_S = 0.02
PATIENCE_S = 10.0  # without a word
AGAIN_S = 1.0  # after which a request is made again: it, or its answer, may have been lost
WITHDRAWAL_S = 1.0  # for the answer to a withdrawal
ALIVE_S = 0.2
NAME_MAX = 90
OF_THE_BUS = ('control', 'script')  # who is asked in a session of the bus
# what is asked of the transformation task, and how it calls that; the rest is asked of the planner
OF_THE_TASK = messages.STOPS | {messages.ENABLE: messages.ENABLE, messages.RESET: messages.RESET}


@dataclass
class _Awaited:
    """What has come of a request so far: the last word of whoever works on it, when that came, and the reply."""

    received_s: float
    said: str = ''
    reply: Reply | None = None


class OperatorNode(PollingNode):
    """Client of one robot; every wait is bounded. Who spins may ask for a stop while something else is waited for.

    Attributes
    ----------
    progress, progress_s
        The newest ``motion/progress``, and when it came [s].
    queue
        The newest ``unit_robot/queue``.
    state, state_changes
        The newest ``motion/state``, and how many there were; while a recording is played back, those of the progress.
    identity
        What this operator is known by.
    in_control
        Whether he has control of the robot, as far as he knows.
    present
        Which reports come from the robot that is up.
    interruptible
        Whether a signal that asks for the end ends his waiting.
    show
        Called with a sentence that tells how far a request is that takes long.

    """

    def __init__(
        self, spin_for: Callable[[float], None], name: str = interfaces.OPERATOR, **node_options: Any
    ) -> None:
        super().__init__(name, **node_options)
        self.spin_for = spin_for
        self.show: Callable[[str], None] = lambda _: None
        self.identity = secrets.token_hex(8)
        self.in_control = False
        self.interruptible = True
        self.progress: dict[str, Any] = {}
        self.progress_s = time.monotonic()
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
        self.create_timer(LOOK_S, lambda: None)  # the executor needs one to keep its waits short
        self.create_timer(ALIVE_S, self._beat)

    def _on_progress(self, message: String) -> None:
        progress = read_progress(message.data)
        if progress is None or not self.present.takes(progress):
            return
        self.progress, self.progress_s = progress, time.monotonic()
        before, self._alone = self._alone, self.present.is_alone
        if not (before and self._alone):  # some motion/state may be missing
            self._see(progress['state'])
        if self.progress['control'] >= self._control and self.progress['operator_identity'] != self.identity:
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
            self._see(message.data)
        else:  # of a recording, or of a robot not discovered completely: the next report decides
            self._alone = False

    def _see(self, state: str) -> None:
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
            awaited.said = reply.sentence

    def _beat(self) -> None:
        if self.in_control:
            self._beats += 1
            message = Header(frame_id=self.identity)
            message.stamp.sec = self._beats
            self._alive.publish(message)

    def wait_until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
        """Spin until a condition holds; raises RunError after a while."""
        deadline = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > deadline:
                raise RunError(
                    f'no {what} within {patience_s:g} s: is a robot up in namespace {self.get_namespace()}?'
                )
            self.spin_for(LOOK_S)

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, whom: str, action: str, text: str = '', adaptation: Adaptation = AS_IT_IS) -> str:
        """Ask ``unit_robot`` or ``control`` for something; return the sentence that it is answered with.

        A request that takes longer reports its progress. One that is not answered in time, or is interrupted, is
        withdrawn from the planner; the error says whether it may still be carried out.

        Raises
        ------
        RefusedError
            It was refused.
        ProgramError
            It is too large.
        RunError
            There was no answer.

        """
        try:
            return self._ask_once(whom, action, text, adaptation)
        except RefusedError as error:
            if error.reason.code != Code.FOREIGN:
                raise
        return self._ask_once(whom, action, text, adaptation)

    def _receiver(self, whom: str) -> str:
        """Return whom a request is meant for, empty as long as he has not said who he is."""
        if whom in OF_THE_BUS:
            return str(self.progress.get('session', ''))
        return self.queue.identity if self.queue else ''

    def _forget(self, whom: str, receiver: str) -> None:
        """Forget a receiver who is not there any more, unless another one has said meanwhile who he is."""
        if self._receiver(whom) != receiver:
            return
        if whom in OF_THE_BUS:
            self.progress = {}
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
        # before it is published: another thread may hear the reply
        awaited = self._awaited[request.number] = _Awaited(asked)
        said = ''
        try:
            publisher.publish(message)
            while awaited.reply is None:
                now = time.monotonic()
                if now - awaited.received_s > PATIENCE_S:
                    raise RunError(
                        f'no answer of {whom} to "{action}" within {PATIENCE_S:g} s: is a robot up in namespace '
                        f'{self.get_namespace()}?'
                    )
                if now - asked > AGAIN_S and awaited.received_s < asked + AGAIN_S:
                    publisher.publish(message)
                    asked = now
                if awaited.said != said:
                    said = awaited.said
                    self.show(said)
                self.spin_for(LOOK_S)
        except (RunError, KeyboardInterrupt) as error:
            raise type(error)(f'{error}{self._take_back(whom, request)}') from None
        finally:
            del self._awaited[request.number]
        reply = awaited.reply
        self._control = max(self._control, reply.control)
        if reply.reason is not None:
            if reply.reason.code == Code.FOREIGN:  # planner or bus have started anew
                self._forget(whom, receiver)
            raise RefusedError(reply.reason)
        return reply.sentence

    def _take_back(self, whom: str, request: Request) -> str:
        """Withdraw a request; return what has to be added to the error: empty if nothing is left of it."""
        if whom != 'unit_robot':  # the transformation task does at once what it is asked for
            return f'; "{request.action}" may still be carried out'
        self._numbers += 1
        withdrawal = Request(
            request.receiver, self.identity, self._numbers, 0, 'withdraw', str(request.number)
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
            return f'; "{request.action}" may still be carried out, as its withdrawal was not answered either'
        return '' if reply.accepted else f'; {reply.sentence}'

    def take_control(self, name: str, by_force: bool = False) -> str:
        """Take control of the robot and keep it until it is released; raises RefusedError if it cannot be had."""
        who = f'{name}, process {os.getpid()} on {socket.gethostname()}'[:NAME_MAX]
        told = self.ask('control', messages.TAKE_OVER if by_force else messages.TAKE, who)
        self.in_control = True
        self._beat()
        return told

    def release_control(self) -> None:
        """Give control up; what is under way goes on."""
        if self.in_control:
            self.in_control = False
            self.ask('control', messages.RELEASE)

    def send_program(self, text: str, adaptation: Adaptation = AS_IT_IS) -> str:
        """Append a program in YAML, or a packaged one by its name, to the queue."""
        return self.ask('unit_robot', 'program', text, adaptation)

    def start_program(self, text: str, adaptation: Adaptation = AS_IT_IS) -> str:
        """Append a program to the queue and start the queue; if that is refused the queue is as before."""
        return self.ask('unit_robot', 'start', text, adaptation)

    def move(self, text: str, adaptation: Adaptation = AS_IT_IS) -> str:
        """Drive moves in YAML, or a packaged program; behind those that are driven, if the robot moves or is held."""
        return self.ask('unit_robot', 'move', text, adaptation)

    def override(self, percent: float) -> str:
        """Set the override."""
        return self.ask('unit_robot', 'override', repr(percent))

    def call(self, name: str) -> str:
        """Ask for what a service of that name does, or for ``disable``; raises RefusedError if it is refused."""
        if name in OF_THE_TASK:
            return self.ask('control', OF_THE_TASK[name])
        return self.ask('unit_robot', name)

    def enable(self, on: bool) -> str:
        """Enable or disable the drives."""
        return self.call('enable' if on else 'disable')

    @property
    def reaches_drives(self) -> bool:
        """Whether somebody takes requests to the drives and answers."""
        listening = self._request.get_subscription_count()
        return bool(listening and self.count_publishers('sercos/service/answer'))

    def drive(self, request: str) -> str:
        """Ask a drive through its service channel ("axis1 read S-0-0104"); raises ProgramError if it refuses."""
        self.wait_until(lambda: self.reaches_drives, 'transformation task')
        mark = f'#{secrets.token_hex(4)}'  # others ask as well, and everybody receives every answer
        self._service_answers.clear()
        self._request.publish(String(data=f'{mark} {request}'))
        self.wait_until(lambda: mark in self._service_answers, 'answer of the service channel')
        accepted, sentence = parse_answer(self._service_answers[mark])
        if not accepted:
            raise ProgramError(sentence)
        return sentence

    def inject(self, fault: str) -> str:
        """Inject a fault, in YAML as in program files; raises ProgramError if it is refused."""
        # marked: however often it is asked for, the fault is injected once
        return self._call(self._inject, f'#{secrets.token_hex(4)} {fault}')

    def input(self, request: str = '') -> str:
        """Set an input, ``{name: part, value: true}`` in YAML, or ask for all of them; raises ProgramError."""
        return self._call(self._input, request)

    def _call(self, client: Client, text: str) -> str:
        """Call a service until it answers: what it answers a client that it has just met may be lost."""
        self.wait_until(client.service_is_ready, f'service {client.srv_name}')
        calls: list[Future] = []
        asked = -math.inf

        def answered() -> Future | None:
            nonlocal asked
            if time.monotonic() - asked > AGAIN_S:
                calls.append(client.call_async(AddDiagnostics.Request(load_namespace=text)))
                asked = time.monotonic()
            return next((call for call in calls if call.done()), None)

        self.wait_until(answered, f'answer of service {client.srv_name}')
        response = next(call for call in calls if call.done()).result()
        if not response.success:
            raise ProgramError(response.message)
        return str(response.message)


@contextmanager
def operating(namespace: str) -> Iterator[OperatorNode]:
    """Be an operator of the robot in a namespace, in a process that does nothing else with ROS.

    A signal that asks for the end raises RunInterruptedError where the operator waits, once; he can still act after it.
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
