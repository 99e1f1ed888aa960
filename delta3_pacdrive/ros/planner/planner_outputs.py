"""Execution of the planner's actions on the graph and in the planning thread.

Out: ``motion/plan``, ``motion/change``, ``unit_robot/state`` (latched: idle, moving, steered, stopping, stopped,
error).
"""

import queue
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, String

from delta3_pacdrive.control.actions import (
    Cancelled,
    Changed,
    Entered,
    Ordered,
    Overridden,
    Replied,
    Reported,
    Revoked,
    Settled,
)
from delta3_pacdrive.control.messages import OVERRIDE, PROFILE, REVOKE, Origin
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.planning_job import CancelledError, Job, Result, run_job
from delta3_pacdrive.errors import Code, Reason, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.output_names import OWN, OutputNames
from delta3_pacdrive.ros.planner.motion_action import MotionAction
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.numbers import numbers

UNCHECKED_MAX = 1000  # rows sent but not checked yet
JOIN_S = 2.0  # timeout for a cancelled job to end


class PlanningThread:
    """A thread that executes one planning job at a time, with progress and cancellation.

    Unexpected exceptions go to ``log``. ``outputs`` are the output names that programs may use.
    """

    def __init__(
        self, parameters: Parameters, log: Callable[[str], None], outputs: OutputNames = OWN
    ) -> None:
        self._robot, self._log, self._outputs = parameters, log, outputs
        self._jobs: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[Result] = queue.SimpleQueue()
        self._given_up = 0  # newest cancelled job
        self._state = (0, 0, 0)  # number of the job, planned statements, all statements
        self._newest = self._fetched = 0  # numbers of jobs
        self._thread = threading.Thread(target=self._run, name='planning', daemon=True)
        self._thread.start()

    def begin(self, job: Job) -> None:
        """Queue a job."""
        self._newest = job.number
        self._jobs.put(job)

    def cancel(self, number: int) -> None:
        """Cancel all jobs up to a number."""
        self._given_up = max(self._given_up, number)

    def results(self) -> Iterator[Result]:
        """Yield the results since the last call."""
        while not self._results.empty():
            result = self._results.get()
            self._fetched = result.number
            yield result

    @property
    def busy(self) -> bool:
        """Whether the result of a job is pending."""
        return self._fetched < self._newest

    def progress(self) -> str:
        """Return the progress of the current job, empty if there is none."""
        number, done, total = self._state
        return f'planning move {done + 1} of {total}' if number > self._given_up and total else ''

    def close(self) -> None:
        """Cancel all jobs and end the thread."""
        self.cancel(self._newest)
        self._jobs.put(None)
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        while (job := self._jobs.get()) is not None:
            number = job.number

            def note(done: int, total: int, number: int = number) -> None:
                if number <= self._given_up:
                    raise CancelledError('planning was cancelled')
                self._state = (number, done, total)

            try:
                result = run_job(job, self._robot, note, self._outputs)
            except Exception as error:  # noqa: BLE001 (no program may terminate the planner)
                self._log(traceback.format_exc())
                sentence = f'{type(error).__name__}: {shown(str(error))}'
                result = Result(number, None, None, Reason(Code.CONTENT, sentence))
            self._state = (0, 0, 0)
            self._results.put(result)


class PlannerOutputs:
    """Executes the actions of one planner; ``goals`` are the servers of the ROS actions that it offers."""

    def __init__(
        self,
        node: Node,
        planner: Planner,
        thread: PlanningThread,
        operators: PlannerServices,
        goals: Sequence[MotionAction],
        origin: Callable[[str, int], Origin],
    ) -> None:
        self._planner, self._thread, self._operators = planner, thread, operators
        self._goals, self._origin = goals, origin
        # rows of a plan that have not been sent, number of its order, and number of its rows that have been sent
        self._rows: Iterator[tuple[str, Any]] = iter(())
        self._number = self._sent = 0
        self._state = interfaces.PLANNER_STATE.publisher(node)
        self._plan = interfaces.MOTION_PLAN.publisher(node)
        self._change = interfaces.MOTION_CHANGE.publisher(node)

    def carry_out(self) -> None:
        """Execute all pending actions."""
        actions, self._planner.actions = self._planner.actions, []
        for action in actions:
            match action:
                case Job():
                    self._thread.begin(action)
                case Cancelled(number):
                    self._thread.cancel(number)
                case Ordered():
                    self._rows, self._number, self._sent = action.rows(), action.number, 0
                    self.send_rows()
                case Revoked(number):
                    self.discard_rows()
                    self._plan.publish(self._numbered(REVOKE, number, []))
                case Changed(number, profile):
                    self._change.publish(self._numbered(PROFILE, number, profile.to_array()))
                case Overridden(number, override):
                    self._change.publish(self._numbered(OVERRIDE, number, [override]))
                case Replied(request, reason, sentence, routine):
                    self._operators.reply(request, reason, sentence, routine)
                case Reported(report):
                    self._operators.report(report)
                    for goals in self._goals:
                        goals.report(report)
                case Settled(identity, arrival, reason):
                    for goals in self._goals:
                        goals.settle(identity, arrival, reason)
                case Entered(state):
                    self._state.publish(String(data=str(state)))
        if actions:
            self._operators.publish_queue()

    def _numbered(self, kind: str, number: int, values: Any) -> Float64MultiArray:
        return numbers(values, self._origin(kind, number).label())

    def send_rows(self) -> None:
        """Send the remaining rows of a plan, limited to what the transformation task can buffer."""
        status = self._planner.status
        checked = status.checked if status and self._sent else 0
        while self._sent - checked < UNCHECKED_MAX and (row := next(self._rows, None)) is not None:
            kind, values = row
            self._plan.publish(self._numbered(kind, self._number, values))
            self._sent += 1

    def discard_rows(self) -> None:
        """Discard unsent rows of the previous session."""
        self._rows = iter(())
