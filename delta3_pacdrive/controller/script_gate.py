"""The gate of a script: without a clock the bus waits for its decisions, which rest on the answers of one bus cycle.

Pure: events come in; what is not in the table does not happen. While the bus waits, no cycle is started, and answers
that come of cycles behind the one that the script decides on are not evaluated. So it makes no difference how many
cycles are outstanding. With a clock the bus goes on all the same, and an order may come too late.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from delta3_pacdrive.controller.belt_knowledge import Phase
from delta3_pacdrive.controller.task_arrays import HISTORY
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.controller.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.errors import Reason, RunError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos.bus_time import NEVER


class GateState(Enum):
    """Whether a script decides."""

    FREE = 'no script decides'
    RUNNING = 'the bus goes on, until what the script waits for'
    WAITING = 'the script decides'


class GateEvent(Enum):
    """What happens to a gate."""

    ATTACH = 'a script begins'
    WAIT = 'the script waits for something'
    REACH = 'it is there, or its time is over'
    LEAVE = 'the script ends'
    LOSE = 'nobody hears of the script any more'
    FAIL = 'a fault has stopped the robot'


@dataclass(frozen=True)
class Step:
    """Where an event leads: to a state, and whether the robot is stopped on its path."""

    state: GateState
    holds_robot: bool = False


TRANSITIONS = {
    (GateState.FREE, GateEvent.ATTACH): Step(GateState.WAITING),
    (GateState.WAITING, GateEvent.WAIT): Step(GateState.RUNNING),
    (GateState.WAITING, GateEvent.LEAVE): Step(GateState.FREE),
    (GateState.WAITING, GateEvent.LOSE): Step(GateState.FREE, holds_robot=True),
    (GateState.WAITING, GateEvent.FAIL): Step(GateState.FREE),
    (GateState.RUNNING, GateEvent.REACH): Step(GateState.WAITING),
    (GateState.RUNNING, GateEvent.LEAVE): Step(GateState.FREE),
    (GateState.RUNNING, GateEvent.LOSE): Step(GateState.FREE, holds_robot=True),
    (GateState.RUNNING, GateEvent.FAIL): Step(GateState.FREE),
}
"""Where an event leads from a state; what is not listed does not happen."""


def first_decision(parameters: Parameters) -> int:
    """Return the bus cycle on whose answers a script begins, so that its first move starts at ``motion.start_cycle``.

    Raises
    ------
    RunError
        The drives are not enabled before.

    """
    motion = parameters.motion
    begin = motion.start_cycle - parameters.decision_cycles
    if motion.enable_cycle < 0 or begin <= motion.enable_cycle:
        raise RunError(
            f'motion.start_cycle is {motion.start_cycle}, but a script needs {parameters.decision_cycles} bus '
            f'cycles before it, behind motion.enable_cycle, which is {motion.enable_cycle}'
        )
    return begin


class ScriptGate:
    """Gate of one controller.

    Parameters
    ----------
    task
        Of the same controller.
    has_clock
        Whether bus cycles are due by a clock: then the bus waits for nobody.
    cycle_time_s
        Of the bus [s].

    Attributes
    ----------
    state
        Whether a script decides.
    cycle, met
        The bus cycle on whose answers the script decides, and whether they meet what it has waited for.
    hold_cycle
        From which cycle on the robot is to be stopped on its path, ``NEVER`` if it is not.
    abandons, stands
        Whether the robot is to forget moves and belt then, instead; and the first bus cycle in which it stands.
    lost
        Why the robot could not stay on a belt, where that is what the script decides on; None: it is not.
    begins
        Bus cycle on whose answers a script begins that was announced before, ``NEVER`` if none was.
    on_decision
        Called when what the script waits for is there, or will not come any more.

    """

    def __init__(self, task: Transformation, has_clock: bool, cycle_time_s: float = 1e-3) -> None:
        self._task, self._has_clock, self._cycle_time_s = task, has_clock, cycle_time_s
        self.state = GateState.FREE
        self.cycle, self.met = -1, False
        self.hold_cycle = self.begins = NEVER
        self.abandons, self.stands = False, 0
        self.lost: Reason | None = None
        self._told_lost = False
        self.on_decision: Callable[[], None] = lambda: None
        self._condition = WaitCondition(0, NEVER)
        self._commanded: list[Commanded] = [Commanded.of(task)] * HISTORY

    @property
    def closed(self) -> bool:
        """Whether the bus waits for the script."""
        return self.state is GateState.WAITING and not self._has_clock

    def happen(self, event: GateEvent) -> bool:
        """Let an event happen; return whether the robot has to be stopped on its path."""
        step = TRANSITIONS.get((self.state, event))
        if step is None:
            return False
        waited, self.state = self.state is GateState.RUNNING, step.state
        if step.state is GateState.FREE:
            self.hold_cycle = NEVER
        if waited:
            self.on_decision()
        return step.holds_robot

    def attach(self, answered: int) -> None:
        """Let a script begin, which decides on the newest answers; ``answered`` is the next cycle to be complete."""
        if self.state is GateState.FREE:
            self.cycle, self.met = answered - 1, True
            self._commanded = [Commanded.of(self._task)] * HISTORY
            self.happen(GateEvent.ATTACH)

    def refresh(self, answered: int) -> None:
        """With a clock the bus has gone on: let the script decide on the newest answers."""
        if self._has_clock and self.state is GateState.WAITING:
            self.cycle = answered - 1

    def wait(self, condition: WaitCondition, inputs: int = 0) -> None:
        """Let the bus go on until a condition is met; if the answers that the script knows meet it, it does not.

        ``inputs`` are those of these answers, as bits.
        """
        self._condition, self.lost = condition, None
        self.happen(GateEvent.WAIT)
        self._look(self.cycle, inputs)

    def commanded(self, cycle: int) -> bool:
        """Note what the command of a bus cycle has left; return whether the robot stops from the next one on."""
        if self.state is GateState.FREE:
            return False
        self.note(cycle)
        if cycle + 1 < self.hold_cycle:
            return False
        self.hold_cycle = NEVER
        return True

    def note(self, cycle: int) -> None:
        """Note what the command of a bus cycle has left, or what has been asked for at once behind it."""
        self._commanded[cycle % HISTORY] = Commanded.of(self._task)

    def answered(self, cycle: int, inputs: int = 0) -> None:
        """Look whether the answers of a bus cycle meet what the script waits for."""
        if self.state is GateState.RUNNING:
            self.lost = self._newly_lost(cycle)
            self._look(cycle, inputs)
        elif cycle == self.begins:
            self.attach(cycle + 1)

    def interrupt(self, answered: int) -> None:
        """Let the script decide now, on the newest answers, though what it waits for is not there."""
        if self.state is GateState.RUNNING:
            self.cycle, self.met, self.lost = answered - 1, False, None
            self.happen(GateEvent.REACH)

    def forget(self) -> None:
        """Forget that the robot was to be stopped for the script: somebody else has done so."""
        self.hold_cycle, self.abandons = NEVER, False

    def command_of(self, cycle: int) -> Commanded:
        """Return what the command of a bus cycle has left, one of the last 64."""
        return self._commanded[cycle % HISTORY]

    def _newly_lost(self, cycle: int) -> Reason | None:
        """Return why the robot could not stay on a belt, once, as soon as it stands; None: it could."""
        command = self.command_of(cycle)
        tracked = command.tracked
        if tracked is None or tracked.lost is None:
            self._told_lost = False
            return None
        stands = tracked.phase is Phase.FREE or 0 < tracked.rest_cycle(self._cycle_time_s) <= cycle
        if self._task.loaded:
            stands = stands and command.held and command.end_cycle <= cycle
        if self._told_lost or not stands:
            return None
        self._told_lost = True
        return tracked.lost

    def _look(self, cycle: int, inputs: int) -> None:
        if self.state is not GateState.RUNNING:
            return
        state = self._task.state[0]
        self.met = self._condition.met(
            cycle, self.command_of(cycle), self._task.loaded, int(state['within']), inputs
        )
        if self.met or self.lost is not None or cycle >= self._condition.latest:
            self.cycle = cycle
            self.happen(GateEvent.REACH)
