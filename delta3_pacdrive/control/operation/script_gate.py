"""The gate of a script: without a clock the bus waits for the script's decisions, based on the feedback of one cycle.

Pure state machine; events that are not in the table are ignored. While the bus waits, no cycle starts and feedback of
cycles after the one that the script decides on is not evaluated, so the result does not depend on the number of
outstanding cycles. With a clock the bus continues, and an order may be late.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from delta3_pacdrive.belts.knowledge import Phase
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.operation.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.errors import Reason, RunError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.bus_time import HISTORY, NEVER


class GateState(Enum):
    """State of a gate."""

    FREE = 'no script decides'
    RUNNING = 'the bus runs until the condition of the script'
    WAITING = 'the script decides'


class GateEvent(Enum):
    """Event of a gate."""

    ATTACH = 'a script starts'
    WAIT = 'the script waits for a condition'
    REACH = 'the condition is met, or its time is over'
    END = 'the script ends'
    CONTROL_LOST = 'the script has lost control'
    FAIL = 'a fault has stopped the robot'


@dataclass(frozen=True)
class Step:
    """Next state of a transition, and whether the robot is held."""

    state: GateState
    holds_robot: bool = False


TRANSITIONS = {
    (GateState.FREE, GateEvent.ATTACH): Step(GateState.WAITING),
    (GateState.WAITING, GateEvent.WAIT): Step(GateState.RUNNING),
    (GateState.WAITING, GateEvent.END): Step(GateState.FREE),
    (GateState.WAITING, GateEvent.CONTROL_LOST): Step(GateState.FREE, holds_robot=True),
    (GateState.WAITING, GateEvent.FAIL): Step(GateState.FREE),
    (GateState.RUNNING, GateEvent.REACH): Step(GateState.WAITING),
    (GateState.RUNNING, GateEvent.END): Step(GateState.FREE),
    (GateState.RUNNING, GateEvent.CONTROL_LOST): Step(GateState.FREE, holds_robot=True),
    (GateState.RUNNING, GateEvent.FAIL): Step(GateState.FREE),
}
"""Transitions; other events are ignored."""


def first_decision(parameters: Parameters) -> int:
    """Return the bus cycle of a script's first decision, so that its first move starts at ``motion.start_cycle``.

    Raises
    ------
    RunError
        The drives are not enabled before that cycle.

    """
    motion = parameters.motion
    begin = motion.start_cycle - parameters.decision_cycles
    if motion.enable_cycle < 0 or begin <= motion.enable_cycle:
        raise RunError(
            f'motion.start_cycle is {motion.start_cycle}, but a script needs {parameters.decision_cycles} bus '
            f'cycles before it, after motion.enable_cycle, which is {motion.enable_cycle}'
        )
    return begin


class ScriptGate:
    """Gate of one controller.

    With ``has_clock`` cycles are due by time, and the bus does not wait for a script. ``on_decision`` is called when
    the condition of the script is met, timed out or cancelled.
    """

    def __init__(self, task: Transformation, has_clock: bool, cycle_time_s: float = 1e-3) -> None:
        self._task, self.has_clock, self._cycle_time_s = task, has_clock, cycle_time_s
        self.state = GateState.FREE
        self.closed = False  # whether the bus waits for the script
        self.cycle, self.met = (
            -1,
            False,
        )  # bus cycle that the script decides on, and whether its condition was met
        self.hold_cycle = NEVER  # in which the robot starts to stop for the script
        self.begins = NEVER  # bus cycle of the first decision of an announced script
        # whether moves and belt are then cleared, and the first cycle at rest
        self.cancels_motion, self.rest_cycle = False, 0
        self.lost: Reason | None = None  # why the belt was lost, if that ended the wait
        self._loss_reported = False
        self.on_decision: Callable[[], None] = lambda: None
        self._condition = WaitCondition(0, NEVER)
        self._commanded: list[Commanded] = [Commanded.of(task)] * HISTORY

    def handle(self, event: GateEvent) -> bool:
        """Apply an event; return whether the robot has to be held."""
        step = TRANSITIONS.get((self.state, event))
        if step is None:
            return False
        waited, self.state = self.state is GateState.RUNNING, step.state
        self.closed = step.state is GateState.WAITING and not self.has_clock
        if step.state is GateState.FREE:
            self.hold_cycle = NEVER
        if waited:
            self.on_decision()
        return step.holds_robot

    def attach(self, answered: int) -> None:
        """Start a script, which decides on the newest feedback; ``answered`` is the next cycle to complete."""
        if self.state is GateState.FREE:
            self.cycle, self.met = answered - 1, True
            self._commanded = [Commanded.of(self._task)] * HISTORY
            self.handle(GateEvent.ATTACH)

    def refresh(self, answered: int) -> None:
        """With a clock, move the decision to the newest feedback."""
        if self.has_clock and self.state is GateState.WAITING:
            self.cycle = answered - 1

    def wait(self, condition: WaitCondition, inputs: int = 0) -> None:
        """Run the bus until a condition is met, unless the current feedback already meets it.

        ``inputs`` are the inputs of the current feedback, as bits.
        """
        self._condition, self.lost = condition, None
        self.handle(GateEvent.WAIT)
        self._check(self.cycle, inputs)

    def commanded(self, cycle: int) -> bool:
        """Record the state after the command of a bus cycle; return whether the robot is held from the next one on."""
        if self.state is GateState.FREE:
            return False
        self.note(cycle)
        if cycle + 1 < self.hold_cycle:
            return False
        self.hold_cycle = NEVER
        return True

    def note(self, cycle: int) -> None:
        """Record the state after the command of a bus cycle."""
        self._commanded[cycle % HISTORY] = Commanded.of(self._task)

    def answered(self, cycle: int, inputs: int = 0) -> None:
        """Check whether the feedback of a bus cycle meets the condition of the script."""
        if self.state is GateState.RUNNING:
            self.lost = self._newly_lost(cycle)
            self._check(cycle, inputs)
        elif cycle == self.begins:
            self.attach(cycle + 1)

    def interrupt(self, answered: int) -> None:
        """End a wait now, on the newest feedback, without its condition being met."""
        if self.state is GateState.RUNNING:
            self.cycle, self.met, self.lost = answered - 1, False, None
            self.handle(GateEvent.REACH)

    def clear_hold(self) -> None:
        """Clear a pending hold of the script, because another stop replaced it."""
        self.hold_cycle, self.cancels_motion = NEVER, False

    def command_of(self, cycle: int) -> Commanded:
        """Return the state after the command of one of the last 64 bus cycles."""
        return self._commanded[cycle % HISTORY]

    def _newly_lost(self, cycle: int) -> Reason | None:
        """Return why the belt was lost, once, as soon as the robot is at rest."""
        command = self.command_of(cycle)
        tracked = command.tracked
        if tracked is None or tracked.lost is None:
            self._loss_reported = False
            return None
        at_rest = tracked.phase is Phase.FREE or 0 < tracked.rest_cycle(self._cycle_time_s) <= cycle
        if self._task.loaded:
            at_rest = at_rest and command.held and command.end_cycle <= cycle
        if self._loss_reported or not at_rest:
            return None
        self._loss_reported = True
        return tracked.lost

    def _check(self, cycle: int, inputs: int) -> None:
        if self.state is not GateState.RUNNING:
            return
        state = self._task.state[0]
        self.met = self._condition.met(
            cycle, self.command_of(cycle), self._task.loaded, int(state['within']), inputs
        )
        if self.met or self.lost is not None or cycle >= self._condition.latest:
            self.cycle = cycle
            self.handle(GateEvent.REACH)
