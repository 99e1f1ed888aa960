"""Node of a script: has control of a robot and advances bus cycles on request of the script.

It is spun by a separate thread, or by the main thread of a bring-up; the script waits for the received messages.
"""

import json
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from std_msgs.msg import String

from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.control.messages import EXACT, EXTEND, ORDER, PROFILE, Origin, Verdict
from delta3_pacdrive.control.operation.script_service import (
    ABANDON,
    ATTACH,
    GET_ON,
    GET_ON_AGAIN,
    HOLD,
    LEAVE,
    LOOK,
    WAIT,
)
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.control.queue.plan_rows import PlanRows
from delta3_pacdrive.control.queue.planner_actions import Ordered
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, RunError, TelegramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.extension import Extension
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.output_names import OWN, NamedOutput, OutputNames
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.remote_parameters import RemoteParameters
from delta3_pacdrive.ros.clients.robot_client import LOOK_S, PATIENCE_S, OperatorNode
from delta3_pacdrive.ros.wire import discovery, domain, interfaces
from delta3_pacdrive.ros.wire.numbers import numbers

READY_S = 30.0  # timeout for a robot to become ready


class ScriptNode(OperatorNode):
    """Client of a robot that is moved by a script."""

    def __init__(self, **node_options: Any) -> None:
        self._news = threading.Condition()
        super().__init__(self._wait_for_news, interfaces.SCRIPT, **node_options)
        self.stopped = False  # a wait then raises KeyboardInterrupt
        self._orders = 0  # number of orders and changes
        self._driven = 0  # number of the newest executed order
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

    def attach(self, patience_s: float = READY_S) -> dict[str, Any]:
        """Attach the script to the robot as soon as it can be moved; raises RefusedError."""
        deadline = time.monotonic() + patience_s
        while True:
            try:
                return self._facts(ATTACH)
            except RefusedError as error:
                waits = error.reason.code in (Code.LATE, Code.BUS) and time.monotonic() < deadline
                if not waits:
                    raise
                self.spin_for(LOOK_S)

    def _facts(self, action: str, text: str = '') -> dict[str, Any]:
        found = json.loads(self.ask('script', action, text))
        return dict(found)

    def look(self) -> dict[str, Any]:
        """Return the state in the newest bus cycle."""
        return self._facts(LOOK)

    def wait(self, condition: WaitCondition) -> dict[str, Any]:
        """Run the bus until a condition is met or times out; return the state then."""
        return self._facts(WAIT, condition.to_json())

    def hold(self, cycle: int) -> dict[str, Any]:
        """Run the bus to a cycle, then stop the robot on its path."""
        return self._facts(HOLD, str(cycle))

    def get_on(self, order: TrackOrder) -> None:
        """Specify the belt for the next event of the plan that synchronises to one."""
        self.ask('script', GET_ON, json.dumps(order.to_document()))

    def get_on_again(self, cycle: int) -> None:
        """Synchronise to the belt again after a hold, or leave it, from a bus cycle."""
        self.ask('script', GET_ON_AGAIN, str(cycle))

    def abandon(self, cycle: int) -> dict[str, Any]:
        """Run the bus to a cycle, abort motion and belt tracking, and return the state at rest."""
        return self._facts(ABANDON, str(cycle))

    def end(self) -> None:
        """Detach the script, and release control."""
        with suppress(RunError, RefusedError):
            self.ask('script', LEAVE)
        self.leave_robot()

    def leave_robot(self) -> None:
        """Release control without detaching: a moving robot stops on its path."""
        with suppress(RunError, RefusedError):
            self.release_control()

    # orders -----------------------------------------------------------------------------------------------------------

    def start(self, plan: Plan, cycle: int, override: float, exact: bool) -> int:
        """Start a plan in a bus cycle, or later unless ``exact``; return its first cycle."""
        row = (float(cycle), override, *plan.tables.order.tolist())
        return self._order(plan, row, EXACT if exact else ORDER)

    def extend(self, extension: Extension) -> int:
        """Append moves to the current motion; return the bus cycle in which they become known."""
        return self._order(extension.more, extension.row(self._driven).tolist(), EXTEND)

    def _order(self, plan: Plan, row: Sequence[float], kind: str) -> int:
        self._orders += 1
        rows = PlanRows()
        rows.begin(Ordered(self._orders, plan.moves, (), tuple(row), kind))
        for row_kind, number, values in rows.due(0):
            self._plan.publish(self._numbered(row_kind, number, values))
        effect = self._verdict(self._orders)
        self._driven = self._orders
        return effect

    def change(self, profile: MotionProfile) -> int:
        """Switch to another motion profile; return its first bus cycle."""
        self._orders += 1
        self._change.publish(self._numbered(PROFILE, self._orders, profile.to_array()))
        return self._verdict(self._orders)

    def _numbered(self, kind: str, number: int, values: Any) -> Any:
        session = self.progress.session
        return numbers(values, Origin(kind, self.identity, session, number).label())

    def _verdict(self, number: int) -> int:
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
