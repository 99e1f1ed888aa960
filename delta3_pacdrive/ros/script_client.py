"""Node of a script: has control of a robot, and lets bus cycles go by as the script asks.

Somebody else spins it: a thread of its own, or the main thread of a bring-up. The script waits for what that hears.
"""

import json
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from std_msgs.msg import String

from delta3_pacdrive.controller.belt_knowledge import TrackOrder
from delta3_pacdrive.controller.messages import EXACT, EXTEND, ORDER, PROFILE, Origin, Verdict
from delta3_pacdrive.controller.plan_rows import PlanRows
from delta3_pacdrive.controller.planner_actions import Ordered
from delta3_pacdrive.controller.script_service import (
    ABANDON,
    ATTACH,
    GET_ON,
    GET_ON_AGAIN,
    HOLD,
    LEAVE,
    LOOK,
    WAIT,
    condition_text,
)
from delta3_pacdrive.controller.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, RunError, TelegramError
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.motion.extension import Extension
from delta3_pacdrive.motion.output_names import OWN, NamedOutput, OutputNames
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import discovery, domain, interfaces, node_process
from delta3_pacdrive.ros.numbers import numbers
from delta3_pacdrive.ros.robot_client import LOOK_S, PATIENCE_S, OperatorNode
from delta3_pacdrive.ros.told_parameters import ToldParameters

READY_S = 30.0  # for a robot that comes up


class ScriptNode(OperatorNode):
    """Client of one robot that a script moves.

    Attributes
    ----------
    stopped
        Whether somebody has asked the script to stop: then waiting raises KeyboardInterrupt.

    """

    def __init__(self, **node_options: Any) -> None:
        self._news = threading.Condition()
        super().__init__(self._wait_for_news, interfaces.SCRIPT, **node_options)
        self.stopped = False
        self._orders = 0  # and changes
        self._driven = 0  # number of the newest order that is driven
        self._verdicts: dict[int, Verdict] = {}
        self._requests['script'] = interfaces.SCRIPT_REQUEST.publisher(self)
        interfaces.SCRIPT_REPLY.subscription(self, self._on_reply)
        self._plan = interfaces.MOTION_PLAN.publisher(self)
        self._change = interfaces.MOTION_CHANGE.publisher(self)
        interfaces.VERDICT.subscription(self, self._on_verdict)
        self._told = ToldParameters(self)

    # what is heard ----------------------------------------------------------------------------------------------------

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
        """Ask the script to stop: where it waits for the robot, or as soon as it does."""
        self.stopped = True
        self._notify()

    # what is asked ----------------------------------------------------------------------------------------------------

    def parameters(self) -> Parameters:
        """Return the parameters that the robot tells; raises RunError."""
        self.wait_until(lambda: self._told.ready, 'parameters')
        self._told.ask()
        found: list[Parameters] = []

        def told() -> bool:
            taken = self._told.take()
            if taken is not None:
                found.append(taken)
            return bool(found)

        self.wait_until(told, 'parameters')
        return found[0]

    def outputs(self) -> OutputNames:
        """Return the outputs that the cell of the robot names; without a cell the robot's own."""
        try:
            told = json.loads(self.input())
        except ProgramError:
            return OWN
        return {name: NamedOutput(**one) for name, one in told['output_names'].items()}

    def attach(self, patience_s: float = READY_S) -> dict[str, Any]:
        """Begin to decide, as soon as the robot can be moved; raises RefusedError."""
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
        """Return what is seen of the newest bus cycle."""
        return self._facts(LOOK)

    def wait(self, condition: WaitCondition) -> dict[str, Any]:
        """Let the bus go on until a condition is met or given up; return what is seen then."""
        return self._facts(WAIT, condition_text(condition))

    def hold(self, cycle: int) -> dict[str, Any]:
        """Let the bus go on to a cycle, and stop the robot on its path from there on."""
        return self._facts(HOLD, str(cycle))

    def get_on(self, order: TrackOrder) -> None:
        """Say which belt is meant by the next event of the plan that gets on one."""
        self.ask('script', GET_ON, json.dumps(order.to_document()))

    def get_on_again(self, cycle: int) -> None:
        """Get on the belt again after a hold, or leave it, from a bus cycle on."""
        self.ask('script', GET_ON_AGAIN, str(cycle))

    def abandon(self, cycle: int) -> dict[str, Any]:
        """Let the bus go on to a cycle, stop from there on, forget moves and belt; return what is seen at rest."""
        return self._facts(ABANDON, str(cycle))

    def end(self) -> None:
        """End the script, and give control back."""
        with suppress(RunError, RefusedError):
            self.ask('script', LEAVE)
        self.leave_robot()

    def leave_robot(self) -> None:
        """Give control back without an end of the script: a robot that still drives stops on its path."""
        with suppress(RunError, RefusedError):
            self.release_control()

    # orders -----------------------------------------------------------------------------------------------------------

    def start(self, plan: Plan, cycle: int, override: float, exact: bool) -> int:
        """Let a plan start in a bus cycle, or as soon as it can if that may be later; return in which one it does."""
        row = (float(cycle), override, *plan.tables.order.tolist())
        return self._order(plan, row, EXACT if exact else ORDER)

    def extend(self, extension: Extension) -> int:
        """Let moves follow those that are driven; return the bus cycle from which on they are known."""
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
        """Go over to another motion profile; return the bus cycle from which on it is followed."""
        self._orders += 1
        self._change.publish(self._numbered(PROFILE, self._orders, profile.to_array()))
        return self._verdict(self._orders)

    def _numbered(self, kind: str, number: int, values: Any) -> Any:
        session = str(self.progress.get('session', ''))
        return numbers(values, Origin(kind, self.identity, session, number).label())

    def _verdict(self, number: int) -> int:
        self.wait_until(lambda: number in self._verdicts, 'verdict of the transformation task', PATIENCE_S)
        verdict = self._verdicts.pop(number)
        if not verdict.accepted:
            raise RefusedError(Reason(Code.of(verdict.code), verdict.sentence))
        return int(verdict.sentence)


@contextmanager
def scripting(namespace: str) -> Iterator[ScriptNode]:
    """Be a script of the robot in a namespace: a thread listens to the robot while the script runs.

    What else the process does with ROS, such as another script, is not touched.
    """
    absolute = domain.namespace(namespace)
    discovery.keep_to_this_machine()
    context = rclpy.Context()
    node_process.join(context=context)
    process = node_process.Process(context)
    # of two nodes of one name in a process, rcl would have one tell /rosout for both, and warn
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
