"""Node of a script: has control of a robot and advances bus cycles on request of the script.

It is spun by a separate thread, or by the main thread of a bring-up; the script waits for the received messages.
"""

import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from std_msgs.msg import String

from delta3_pacdrive.control.actions import Ordered
from delta3_pacdrive.control.messages import PROFILE, Origin, Verdict
from delta3_pacdrive.control.operation.script_operations import END, ScriptOperation
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, RunError, TelegramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.output_names import OWN, NamedOutput, OutputNames
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.remote_parameters import RemoteParameters
from delta3_pacdrive.ros.clients.robot_client import PATIENCE_S, OperatorNode
from delta3_pacdrive.ros.wire import discovery, domain, interfaces
from delta3_pacdrive.ros.wire.numbers import numbers


class ScriptNode(OperatorNode):
    """Client of a robot that is moved by a script."""

    def __init__(self, **node_options: Any) -> None:
        self._news = threading.Condition()
        super().__init__(self._wait_for_news, interfaces.SCRIPT, **node_options)
        self.stopped = False  # a wait then raises KeyboardInterrupt
        self.number = 0  # of the newest order or change
        self._verdicts: dict[int, Verdict] = {}
        self._requests['script'] = interfaces.SCRIPT_REQUEST.publisher(self)
        interfaces.SCRIPT_REPLY.subscription(self, self._on_reply)
        self._plan = interfaces.MOTION_PLAN.publisher(self)
        self._change = interfaces.MOTION_CHANGE.publisher(self)
        interfaces.VERDICT.subscription(self, self._on_verdict)
        self._remote = RemoteParameters(self)

    # subscriptions ----------------------------------------------------------------------------------------------------

    def _on_reply(self, message: String) -> None:
        super()._on_reply(message)
        self._notify()

    def _on_verdict(self, message: String) -> None:
        with suppress(TelegramError):
            verdict = Verdict.from_json(message.data)
            if verdict.planner == self.identity:
                self._verdicts[verdict.number] = verdict
                self._notify()

    def _notify(self) -> None:
        with self._news:
            self._news.notify_all()

    def _wait_for_news(self, seconds: float) -> None:
        if self.stopped:
            raise KeyboardInterrupt
        with self._news:
            self._news.wait(seconds)

    def stop(self) -> None:
        """Stop the script in its current or next wait for the robot."""
        self.stopped = True
        self._notify()

    # requests ---------------------------------------------------------------------------------------------------------

    def parameters(self) -> Parameters:
        """Return the parameters published by the robot; raises RunError."""
        self.wait_until(lambda: self._remote.ready, 'parameters')
        self._remote.ask()
        found: list[Parameters] = []

        def received() -> bool:
            taken = self._remote.take()
            if taken is not None:
                found.append(taken)
            return bool(found)

        self.wait_until(received, 'parameters')
        return found[0]

    def outputs(self) -> OutputNames:
        """Return the outputs named by the robot's cell; without a cell the default ones."""
        try:
            facts = json.loads(self.input())
        except ProgramError:
            return OWN
        return {name: NamedOutput(**one) for name, one in facts['output_names'].items()}

    def request(self, operation: ScriptOperation, argument: Any = None) -> str:
        """Return the reply to a request of the script."""
        return self.ask('script', operation.name, operation.write(argument))

    def end(self) -> None:
        """Detach the script, and release control."""
        with suppress(RunError, RefusedError):
            self.request(END)
        self.stop_robot()

    def stop_robot(self) -> None:
        """Release control without detaching: a moving robot stops on its path."""
        with suppress(RunError, RefusedError):
            self.release_control()

    # orders -----------------------------------------------------------------------------------------------------------

    def order(self, kind: str, plan: Plan, row: Sequence[float]) -> int:
        """Send a plan with the row that ends it; return the bus cycle in which it takes effect."""
        self.number += 1
        for row_kind, values in Ordered(self.number, plan.moves, (), tuple(row), kind).rows():
            self._plan.publish(self._numbered(row_kind, self.number, values))
        return self._effect(self.number)

    def change(self, profile: MotionProfile) -> int:
        """Switch to another motion profile; return its first bus cycle."""
        self.number += 1
        self._change.publish(self._numbered(PROFILE, self.number, profile.to_array()))
        return self._effect(self.number)

    def _numbered(self, kind: str, number: int, values: Any) -> Any:
        session = self.progress.session
        return numbers(values, Origin(kind, self.identity, session, number).label())

    def _effect(self, number: int) -> int:
        """Wait for a verdict; return the bus cycle in which its order takes effect."""
        self.wait_until(lambda: number in self._verdicts, 'verdict of the transformation task', PATIENCE_S)
        verdict = self._verdicts.pop(number)
        if not verdict.accepted:
            raise RefusedError(Reason(Code.of(verdict.code), verdict.sentence))
        return int(verdict.sentence)


@contextmanager
def scripting(namespace: str) -> Iterator[ScriptNode]:
    """Create a script node for the robot in a namespace, spun by a thread while the script runs.

    It has a separate ROS context, so several scripts may share a process.
    """
    absolute = domain.namespace(namespace)
    discovery.keep_to_this_machine()
    context = rclpy.Context()
    node_process.join(context=context)
    process = node_process.Process(context)
    # two nodes of one name in a process would share a publisher of /rosout, and rcl would warn
    node = ScriptNode(namespace=absolute, context=context, enable_rosout=False)
    process.add(node)
    listener = threading.Thread(target=process.spin, name='script listener', daemon=True)
    listener.start()
    try:
        yield node
    finally:
        process.stop()
        listener.join()
        node_process.leave(process, context)
