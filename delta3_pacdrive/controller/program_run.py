"""The program that the planner has ordered last: it waits for its verdict, runs, fails, ends; and what is left of it.

Pure: events come in, the actions that they ask for go out. What is not in the table does not happen.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Any

from delta3_pacdrive.configuration.checked import counted
from delta3_pacdrive.controller.messages import EXACT, ORDER
from delta3_pacdrive.controller.motion_state import at_percent
from delta3_pacdrive.controller.planner_actions import Ordered, Revoked
from delta3_pacdrive.controller.tolerances import Tolerances
from delta3_pacdrive.faults.fault import Fault
from delta3_pacdrive.motion.execution import OVERRIDE_MAX, MotionProfile, Timeline
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.motion.resume import way_back
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

# by how much, and how often, the numbers of orders leap over those of a foreign writer
LEAP, LEAPS_MAX = 1000, 3


class RunState(Enum):
    """What becomes of a program."""

    NONE = 'no program runs'
    ORDERED = 'the transformation task has not said yet whether it takes the plan'
    RUNNING = 'the plan was taken'
    FAILED = 'a fault has stopped it, and where the robot stands is not known yet'


class Remains(Enum):
    """What is left of the program that ran last."""

    NOTHING = 'nothing'
    CUT_OFF = 'the rest of it can be driven, or all of it again'
    WHOLE = 'all of it can be driven again'


class RunEvent(Enum):
    """What happens to a program."""

    ORDER = 'its plan is sent'
    RENUMBER = 'the number of the order was used already'
    ACCEPT = 'the transformation task takes the plan'
    REFUSE = 'the transformation task refuses the plan'
    REVOKE = 'the order is taken back: nobody waits for it any more, or nobody answers'
    END = 'the last answer of the program is there'
    FAIL = 'the motion is in error'
    LOCATE = 'the robot stands ready for a program'
    PHASE_UP = 'the bus was phased up anew'
    CLEAR = 'what is left is given up'


@dataclass(frozen=True)
class Step:
    """Where an event leads: to a state, with what is left then (None: as before), and an action."""

    state: RunState
    remains: Remains | None = None
    action: type[Ordered] | type[Revoked] | None = None


TRANSITIONS = {
    (RunState.NONE, RunEvent.ORDER): Step(RunState.ORDERED, action=Ordered),
    (RunState.NONE, RunEvent.CLEAR): Step(RunState.NONE, Remains.NOTHING),
    (RunState.ORDERED, RunEvent.RENUMBER): Step(RunState.ORDERED, action=Ordered),
    (RunState.ORDERED, RunEvent.ACCEPT): Step(RunState.RUNNING, Remains.NOTHING),
    (RunState.ORDERED, RunEvent.REFUSE): Step(RunState.NONE),
    (RunState.ORDERED, RunEvent.REVOKE): Step(RunState.NONE, action=Revoked),
    (RunState.ORDERED, RunEvent.PHASE_UP): Step(RunState.NONE),
    (RunState.RUNNING, RunEvent.END): Step(RunState.NONE),
    (RunState.RUNNING, RunEvent.FAIL): Step(RunState.FAILED),
    (RunState.RUNNING, RunEvent.LOCATE): Step(RunState.NONE),
    (RunState.RUNNING, RunEvent.PHASE_UP): Step(RunState.NONE, Remains.WHOLE),
    (RunState.FAILED, RunEvent.LOCATE): Step(RunState.NONE, Remains.CUT_OFF),
    (RunState.FAILED, RunEvent.PHASE_UP): Step(RunState.NONE, Remains.WHOLE),
}
"""Where an event leads from a state."""


@dataclass(frozen=True)
class Order:
    """What is to be driven.

    Attributes
    ----------
    plan, faults
        What the transformation task gets.
    start_cycle
        Bus cycle of its start, -1: as soon as possible.
    override, override_max
        Override of its start, and the largest that the motors bear.
    program
        What all of it is, should it be started again.
    sentence
        Answer to whoever asked for it, once it was accepted.
    queued
        What the planner knows of a program out of its queue, None for one that goes on after a fault.
    own
        How many statements at its end are those of whoever asked for it, and were not in the queue before.
    exact
        Whether it begins in its bus cycle or not at all; any other order begins later if it must.
    tolerances
        Of this trajectory, None: those of all.

    """

    plan: Plan
    faults: tuple[Fault, ...]
    start_cycle: int
    override: float
    override_max: float
    program: Program | None
    sentence: str
    queued: Planned | None = None
    own: int = 0
    exact: bool = False
    tolerances: Tolerances | None = None

    @staticmethod
    def of(
        program: Program,
        planned: Planned,
        override: float,
        start_cycle: int = -1,
        own: int = 0,
        exact: bool = False,
        tolerances: Tolerances | None = None,
    ) -> 'Order':
        """Return the order of a program that is planned, with an override or less if the motors bear less."""
        override = min(override, planned.override_max)
        time = f'{planned.plan.duration_s / override:.3f} s{at_percent(override)}'
        moves = f'{counted(len(planned.plan), "move")}, {time}'
        sentence = f'started "{planned.name}": {moves}'
        if own:
            sentence += ''.join(f'; {notice}' for notice in planned.notices)
        return Order(
            planned.plan,
            program.faults,
            start_cycle,
            override,
            planned.override_max,
            program,
            sentence,
            planned,
            own,
            exact,
            tolerances,
        )

    @staticmethod
    def back(
        run: 'ProgramRun', cut_off: Timeline, here: Floats, override: float, robot: Parameters
    ) -> 'Order':
        """Return the order of the way back to a path that was cut off, from where the TCP stands [m], and on along it.

        Raises
        ------
        ProgramError
            There is no way back.

        """
        plan, override = way_back(cut_off, here, robot), min(override, run.override_max)
        time = f'{plan.duration_s / override:.3f} s{at_percent(override)}'
        sentence = f'resumed after the fault: {counted(len(plan), "move")}, {time}'
        return Order(plan, (), -1, override, run.override_max, run.program, sentence)


class OrderNumbers:
    """Numbers of the orders and changes of one planner, each larger than the one before."""

    def __init__(self) -> None:
        self._newest = self._leaps = 0

    def next(self) -> int:
        """Return the next number."""
        self._newest += 1
        return self._newest

    def leap(self) -> bool:
        """Count on from far above, where a foreign writer has used numbers up; False if that was done too often."""
        self._leaps += 1
        self._newest += LEAP**self._leaps
        return self._leaps <= LEAPS_MAX


class ProgramRun:
    """The run of one program after the other.

    Attributes
    ----------
    state, remains
        What becomes of the program, and what is left of the last one.
    number
        Of the last order, 0 before the first.
    order
        What was ordered last.
    since_s
        Since when its verdict is waited for.
    timeline
        The motion profiles that the transformation task follows; None while no program runs.
    cut_off
        The timeline of the program that is cut off, None if none is.
    program, override_max
        The program that was accepted last, and the largest override that its motors bear.
    came_to_its_end
        Whether the program that ran last was driven to its end, not given up.

    """

    def __init__(self, numbers: OrderNumbers, cycle_time_s: float) -> None:
        self._numbers, self._cycle_time_s = numbers, cycle_time_s
        self.state, self.remains = RunState.NONE, Remains.NOTHING
        self.number = 0
        self.order: Order | None = None
        self.since_s = 0.0
        self._checked = 0
        self.timeline: Timeline | None = None
        self._before: Timeline | None = None  # the same before the newest motion profile
        self.cut_off: Timeline | None = None
        self.program: Program | None = None
        self.override_max = OVERRIDE_MAX
        self.came_to_its_end = False
        self._longer: Timeline | None = None  # which is followed from the cycle of its motion profile on

    @property
    def waits(self) -> bool:
        """Whether an order waits for its verdict."""
        return self.state is RunState.ORDERED

    def send(self, order: Order, now_s: float) -> list[Ordered | Revoked]:
        """Order a program."""
        self.order, self.since_s, self._checked = order, now_s, 0
        self.number = self._numbers.next()
        return self.happen(RunEvent.ORDER)

    def renumber(self) -> list[Ordered | Revoked]:
        """Send the order again under a number that nobody has used; nothing if that was done too often."""
        if not self._numbers.leap():
            return []
        self.number = self._numbers.next()
        return self.happen(RunEvent.RENUMBER)

    def note_checked(self, rows: int, now_s: float) -> None:
        """Note how much of the plan was checked: whoever goes on with it has not fallen silent."""
        if rows != self._checked:
            self._checked, self.since_s = rows, now_s

    def happen(self, event: RunEvent, cycle: int | None = None) -> list[Ordered | Revoked]:
        """Let an event happen, in a bus cycle if one is known; returns the actions that it asks for."""
        step = TRANSITIONS.get((self.state, event))
        if step is None:
            return []
        if self.state is RunState.RUNNING and step.state is not RunState.RUNNING:
            self.came_to_its_end = event in (RunEvent.END, RunEvent.LOCATE) and self._is_over(cycle)
        before, self.state = self.state, step.state
        if step.remains is not None:
            self.remains = step.remains
            self.cut_off = self.timeline if step.remains is Remains.CUT_OFF else None
        if step.state is RunState.NONE:
            self.timeline = self._longer = None
        elif before is RunState.NONE and self.order is not None:
            self.timeline, self._before = Timeline(self.order.plan, self._cycle_time_s), None
        elif event is RunEvent.ACCEPT and self.order is not None:
            self.program, self.override_max = self.order.program, self.order.override_max
        return [self._action(step.action)] if step.action else []

    def _is_over(self, cycle: int | None) -> bool:
        """Whether the motion profile that is followed is at its end in a bus cycle."""
        timeline = self.timeline
        if timeline is None or timeline.profile is None or cycle is None:
            return True
        return not timeline.profile.held and cycle >= timeline.end_cycle

    def _action(self, kind: type[Ordered] | type[Revoked]) -> Ordered | Revoked:
        order = self.order
        if kind is Revoked or order is None:
            return Revoked(self.number)
        row = (float(order.start_cycle), order.override, *order.plan.tables.order.tolist())
        return Ordered(self.number, order.plan.moves, order.faults, row, EXACT if order.exact else ORDER)

    def follow(self, row: Any) -> None:
        """Follow the motion profile that the transformation task follows, its own stops included."""
        timeline = self.timeline
        if timeline is None:
            return
        profile = MotionProfile.from_array(row)
        longer = self._longer
        if longer is not None and longer.profile is not None and profile.cycle >= longer.profile.cycle:
            timeline = self._go_over(longer)
        if timeline.profile is None:
            timeline.start(profile.cycle, profile.override)
        elif (profile.cycle, profile.held) != (timeline.profile.cycle, timeline.profile.held):
            # a program that is held before it begins stops in the cycle of its start
            if profile.cycle < timeline.profile.cycle and self._before is not None:
                timeline = self.timeline = self._before  # a stop came before what was to come
            self._before = timeline.copy()
            timeline.change(profile)

    def lengthen(self, longer: Timeline | None) -> None:
        """Follow a longer plan from the cycle of its motion profile on, or not (None)."""
        self._longer = longer

    def lengthened(self, program: Program | None, override_max: float) -> None:
        """Note that the longer plan is followed, and what all of it is now."""
        if self._longer is not None and self.timeline is not None:
            self._go_over(self._longer)
        self._longer = None
        self.program, self.override_max = program, override_max

    def _go_over(self, longer: Timeline) -> Timeline:
        self.timeline, self._before, self._longer = longer, None, None
        return longer

    def changes_from(self) -> int:
        """Return the bus cycle from which on the newest change of motion profile counts, 0 if there was none."""
        profile = self.timeline.profile if self.timeline else None
        changed = self._before is not None and self._before.profile is not None
        return profile.cycle if changed and profile is not None else 0
