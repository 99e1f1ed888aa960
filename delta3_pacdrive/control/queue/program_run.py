"""The newest program ordered by the planner: verdict, run, fault, end, and remainder.

Pure state machine; events come in, actions go out. Events that are not in the table are ignored.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.control.actions import Ordered, Revoked
from delta3_pacdrive.control.messages import ORDER, REPLACEMENT, SMOOTHED
from delta3_pacdrive.control.motion_state import MotionState, at_percent
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.queue.running_moves import RunningMoves
from delta3_pacdrive.control.queue.task_status import TaskStatus
from delta3_pacdrive.control.queue.tolerances import Tolerances
from delta3_pacdrive.errors import Code, Reason, RefusedError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.extension import RunningProgram
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.planning.resume import return_plan
from delta3_pacdrive.robot.faults.fault import Fault

# increment of order numbers after a collision with another writer, and maximum number of increments
LEAP, LEAPS_MAX = 1000, 3


class RunState(Enum):
    """State of the program."""

    NONE = 'no program runs'
    ORDERED = 'the order waits for its verdict'
    RUNNING = 'the order was accepted'
    FAILED = 'a fault has stopped it, and the robot has not been located yet'


class Remains(Enum):
    """Part of the last program that can be executed again."""

    NOTHING = 'nothing'
    CUT_OFF = 'its remainder can be resumed, or all of it started again'
    WHOLE = 'all of it can be started again'


class RunEvent(Enum):
    """Event of the program."""

    ORDER = 'its plan is sent'
    RENUMBER = 'the number of the order was used already'
    ACCEPT = 'the transformation task accepts the plan'
    REJECT = 'the transformation task rejects the plan'
    REVOKE = 'the order is revoked after a cancellation or a timeout'
    END = 'the last feedback of the program has arrived'
    FAIL = 'the motion is in the error state'
    LOCATE = 'the robot is located, ready for a program'
    PHASE_UP = 'the bus was phased up again'
    CLEAR = 'the remainder is cleared'


@dataclass(frozen=True)
class Step:
    """Next state, remainder (None: unchanged), and an action."""

    state: RunState
    remains: Remains | None = None
    action: type[Ordered] | type[Revoked] | None = None


TRANSITIONS = {
    (RunState.NONE, RunEvent.ORDER): Step(RunState.ORDERED, action=Ordered),
    (RunState.NONE, RunEvent.CLEAR): Step(RunState.NONE, Remains.NOTHING),
    (RunState.ORDERED, RunEvent.RENUMBER): Step(RunState.ORDERED, action=Ordered),
    (RunState.ORDERED, RunEvent.ACCEPT): Step(RunState.RUNNING, Remains.NOTHING),
    (RunState.ORDERED, RunEvent.REJECT): Step(RunState.NONE),
    (RunState.ORDERED, RunEvent.REVOKE): Step(RunState.NONE, action=Revoked),
    (RunState.ORDERED, RunEvent.PHASE_UP): Step(RunState.NONE),
    (RunState.RUNNING, RunEvent.END): Step(RunState.NONE),
    (RunState.RUNNING, RunEvent.FAIL): Step(RunState.FAILED),
    (RunState.RUNNING, RunEvent.LOCATE): Step(RunState.NONE),
    (RunState.RUNNING, RunEvent.PHASE_UP): Step(RunState.NONE, Remains.WHOLE),
    (RunState.FAILED, RunEvent.LOCATE): Step(RunState.NONE, Remains.CUT_OFF),
    (RunState.FAILED, RunEvent.PHASE_UP): Step(RunState.NONE, Remains.WHOLE),
}
"""Transitions; other events are ignored."""


def moves_text(plan: Plan, override: float) -> str:
    """Return number of moves and duration of a plan at an override."""
    return f'{counted(len(plan), "move")}, {plan.duration_s / override:.3f} s{at_percent(override)}'


@dataclass(frozen=True)
class Order:
    """A program to execute."""

    plan: Plan
    override: float  # at the start
    override_max: float  # limit of the motors
    program: Program | None  # whole program, for another start
    sentence: str  # reply after acceptance
    faults: tuple[Fault, ...] = ()
    start_cycle: int = -1  # bus cycle, -1: as soon as possible
    queued: Planned | None = None  # None for a program resumed after a fault
    own: int = 0  # statements at the end that were not in the queue before
    tolerances: Tolerances | None = None  # of this trajectory, None: default
    kind: str = ORDER  # of the row on ``motion/plan``

    @staticmethod
    def of(program: Program, planned: Planned, override: float, own: int = 0, **more: Any) -> 'Order':
        """Return the order of a planned program; the override is limited by the motors, ``more`` are further fields."""
        override = min(override, planned.override_max)
        sentence = f'started "{planned.name}": {moves_text(planned.plan, override)}'
        if own:
            sentence += ''.join(f'; {notice}' for notice in planned.notices)
        return Order(
            planned.plan,
            override,
            planned.override_max,
            program,
            sentence=sentence,
            faults=program.faults,
            queued=planned,
            own=own,
            **more,
        )

    def ordered(self, number: int) -> Ordered:
        """Return the action that sends it, with its number."""
        row = (float(self.start_cycle), self.override, *self.plan.tables.order.tolist())
        return Ordered(number, self.plan.moves, self.faults, row, self.kind)

    @staticmethod
    def back(
        run: 'ProgramRun', cut_off: Timeline, start_m: Floats, override: float, robot: Parameters
    ) -> 'Order':
        """Return the order from the TCP position [m] back to a path that was cut off, and on along it.

        Raises
        ------
        ProgramError
            No return path exists.

        """
        plan, override = return_plan(cut_off, start_m, robot), min(override, run.override_max)
        sentence = f'resumed after the fault: {moves_text(plan, override)}'
        smoothed = run.order is not None and run.order.kind in (SMOOTHED, REPLACEMENT)
        return Order(
            plan, override, run.override_max, run.program, sentence, kind=SMOOTHED if smoothed else ORDER
        )


class ProgramRun(RunningMoves):
    """One program after the other.

    ``timeline`` has the motion profiles that the transformation task follows; None without a program.
    """

    def __init__(self, cycle_time_s: float) -> None:
        super().__init__()
        self._cycle_time_s = cycle_time_s
        self._newest_number = self._leaps = 0
        self.state, self.remains = RunState.NONE, Remains.NOTHING
        self.number = 0  # of the last order, 0 before the first
        self.order: Order | None = None  # newest
        self.since_s = 0.0  # start of the timeout of the verdict
        self._checked = 0
        self._before: Timeline | None = None  # before the newest motion profile
        self.cut_off: Timeline | None = None  # of a program that can be resumed
        self.program: Program | None = None  # newest accepted one
        self.base = 0  # number of the newest accepted order, including appended moves
        self.completed = False  # whether the last program was executed to its end
        self.pending: Timeline | None = (
            None  # with appended moves, active from the cycle of its motion profile on
        )

    @property
    def waits(self) -> bool:
        """Whether an order waits for its verdict."""
        return self.state is RunState.ORDERED

    def send(self, order: Order, now_s: float) -> list[Ordered | Revoked]:
        """Order a program."""
        self.order, self.since_s, self._checked = order, now_s, 0
        self.number = self.next_number()
        return self.handle(RunEvent.ORDER)

    def next_number(self) -> int:
        """Return the next number of an order or a change."""
        self._newest_number += 1
        return self._newest_number

    def renumber(self) -> list[Ordered | Revoked]:
        """Send the order again with an unused number; returns no action after too many attempts."""
        self._leaps += 1
        self._newest_number += LEAP**self._leaps  # beyond the numbers of another writer
        if self._leaps > LEAPS_MAX:
            return []
        self.number = self.next_number()
        return self.handle(RunEvent.RENUMBER)

    def note_checked(self, rows: int, now_s: float) -> None:
        """Record the number of checked rows; progress restarts the timeout of the verdict."""
        if rows != self._checked:
            self._checked, self.since_s = rows, now_s

    def handle(self, event: RunEvent, cycle: int | None = None) -> list[Ordered | Revoked]:
        """Apply an event, in a bus cycle if known; return the resulting actions."""
        step = TRANSITIONS.get((self.state, event))
        if step is None:
            return []
        if self.state is RunState.RUNNING and step.state is not RunState.RUNNING:
            self.completed = event in (RunEvent.END, RunEvent.LOCATE) and self._is_over(cycle)
        before, self.state = self.state, step.state
        if step.remains is not None:
            self.remains = step.remains
            self.cut_off = self.timeline if step.remains is Remains.CUT_OFF else None
        if step.state is RunState.NONE:
            self.timeline = self.pending = None
        elif before is RunState.NONE and self.order is not None:
            self.timeline, self._before = Timeline(self.order.plan, self._cycle_time_s), None
        elif event is RunEvent.ACCEPT and self.order is not None:
            self._accept(self.order)
        return [self._action(step.action)] if step.action else []

    def _accept(self, order: Order) -> None:
        self.program, self.override_max, self.base = order.program, order.override_max, self.number
        self.running = None
        if order.program is not None and order.queued is not None:
            self.running = RunningProgram.of(order.program, order.queued)

    def _is_over(self, cycle: int | None) -> bool:
        """Whether the active motion profile has ended in a bus cycle."""
        timeline = self.timeline
        if timeline is None or timeline.profile is None or cycle is None:
            return True
        return not timeline.profile.held and cycle >= timeline.end_cycle

    def _action(self, kind: type[Ordered] | type[Revoked]) -> Ordered | Revoked:
        order = self.order
        if kind is Revoked or order is None:
            return Revoked(self.number)
        return order.ordered(self.number)

    def follow(self, row: Any) -> None:
        """Follow the motion profile of the transformation task, including its own stops."""
        timeline = self.timeline
        if timeline is None:
            return
        profile = MotionProfile.from_array(row)
        longer = self.pending
        if longer is not None and longer.profile is not None and profile.cycle >= longer.profile.cycle:
            timeline = self._switch_to(longer)
        if timeline.profile is None:
            timeline.start(profile.cycle, profile.override)
        elif (profile.cycle, profile.held) != (timeline.profile.cycle, timeline.profile.held):
            # a program held before its start stops in its start cycle
            if profile.cycle < timeline.profile.cycle and self._before is not None:
                timeline = self.timeline = self._before  # the stop precedes the pending profile
            self._before = timeline.copy()
            timeline.change(profile)

    def accept_pending(self, number: int, program: Program | None) -> None:
        """Activate the pending timeline of an order by its number, and set the whole program."""
        if self.pending is not None and self.timeline is not None:
            self._switch_to(self.pending)
        self.pending = None
        self.base, self.program = number, program

    def _switch_to(self, longer: Timeline) -> Timeline:
        self.timeline, self._before, self.pending = longer, None, None
        return longer

    def accept_replacement(self, number: int, order: Order) -> None:
        """Continue with another order, whose timeline is pending."""
        self.number, self.order = number, order
        if self.pending is not None and self.timeline is not None:
            self._switch_to(self.pending)
        self.pending = None
        self._accept(order)

    def changes_from(self) -> int:
        """Return the first bus cycle of the newest change of motion profile, 0 if there was none."""
        profile = self.timeline.profile if self.timeline else None
        changed = self._before is not None and self._before.profile is not None
        return profile.cycle if changed and profile is not None else 0


class StopRequest:
    """Pending stop request, for one program after the other."""

    def __init__(self) -> None:
        self.waits = False  # whether a stop is pending
        self.since_s = 0.0  # start of its timeout
        self._asked_in = MotionState.IDLE

    def begin(self, motion: MotionState, now_s: float) -> None:
        """Start to wait for a stop, requested in a motion state."""
        self.waits, self._asked_in, self.since_s = True, motion, now_s

    def end(self) -> None:
        """Stop waiting."""
        self.waits = False

    def note(self, motion: MotionState, now_s: float) -> None:
        """Restart the timeout while the robot is stopping, which may take long."""
        if motion == MotionState.STOPPING:
            self.since_s = now_s

    def answer(self, run: ProgramRun, motion: MotionState, refusal: Reason | None) -> str | None:
        """Return the reply to the request, None while the outcome is unknown.

        ``refusal`` is the reason why no program could be started now.
        """
        if run.state is RunState.RUNNING:
            # a robot that was stopping or stopped already shows no change before the end
            begins = motion == MotionState.STOPPING and self._asked_in in (
                MotionState.IDLE,
                MotionState.MOVING,
            )
            return 'stops on the path' if begins else None
        if run.state is RunState.FAILED:
            return str(refusal) if refusal else 'a fault has stopped the robot'
        if run.completed:
            return 'it was at its end before it could be stopped'
        if self._asked_in == MotionState.STOPPED:
            return 'at rest on the path and aborted'
        return 'stopped on the path and aborted'


class Readiness(TaskStatus):
    """Readiness of the robot for moves and orders, as known to the planner with this ``identity`` and its program."""

    def __init__(self, identity: str, run: ProgramRun) -> None:
        super().__init__()
        self._identity, self._run = identity, run
        self.tcp_m: Floats | None = None  # TCP position [m], shape (3,), once located

    @property
    def motion(self) -> MotionState:
        """The newest known motion state."""
        return MotionState(self.newest.state) if self.newest else MotionState.IDLE

    @property
    def listened_to(self) -> bool:
        """Whether the transformation task accepts orders of this planner."""
        return self.newest is not None and self.newest.planner == self._identity

    @property
    def refusal(self) -> Reason | None:
        """Why the transformation task would reject an order now."""
        return self.newest.reason if self.newest else None

    def require_rest(self) -> Floats:
        """Return the TCP position; raises RefusedError unless the robot is located and idle."""
        if self.newest is None or self.tcp_m is None:
            refusal = self.refusal
            if refusal is not None and refusal.code == Code.STATE:  # an axis is not homed
                raise RefusedError(refusal)
            raise rejected(Code.BUS, 'the transformation task has not located the robot yet')
        if self.motion != MotionState.IDLE or self._run.state is not RunState.NONE:
            refusal = self.refusal
            if refusal is not None and refusal.code == Code.FAULT:
                raise RefusedError(refusal)
            motion = MotionState.MOVING if self.motion == MotionState.IDLE else self.motion
            raise rejected(Code.STATE, f'{motion_sentence(motion)}: moves are taken when it is idle')
        return self.tcp_m

    def require_orders(self) -> Floats:
        """Return the TCP position; raises RefusedError unless the transformation task would accept an order."""
        start_m = self.require_rest()
        if not self.listened_to:
            raise rejected(Code.BUS, 'the transformation task does not listen to this planner yet')
        if self.refusal is not None:
            raise RefusedError(self.refusal)
        return start_m


def rejected(code: Code, sentence: str) -> RefusedError:
    """Return the error of a rejection."""
    return RefusedError(Reason(code, sentence))
