"""Stages of the transformation task, and the schedule of its pending events.

A stage is a part of the task with its own state, such as the wait at exact stops or the tracking of belts. The task
calls all its stages in the same way, so a robot without belts or without a rotary axis only has fewer of them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.tracking import BeltTracking
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, rotary_axis_parameters
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.paths.move import TRACK_BIT, MoveKind
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS, rest
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.robot.sercos.bus_time import NEVER

FADE_CYCLES = 40  # duration of the linear fade to zero
FAULT = 'a fault has dropped them'
_OVERRIDDEN = 'they belong to an override of 100 %'
_NOTHING_YET = 'no program has been started'
_NO_TORQUES: Floats = np.zeros((0, 3))
NO_MOVE = -1  # no move


class Stage:
    """Part of the transformation task; each method does nothing unless a stage overrides it.

    ``record`` is the array of one record ``TASK`` of the task, ``reason`` why learned torques end.
    """

    def load(self, plan: Plan) -> None:
        """Take the plan of a program that starts later."""

    def start(self, timeline: Timeline) -> None:
        """Start the loaded program."""

    def follow(self, timeline: Timeline, reason: str) -> None:
        """Take another motion profile of the timeline."""

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Take the timeline of an extended plan, which omits the first ``left_out`` moves of the plan before it."""

    def clear_program(self, cycle: int, reason: str) -> None:
        """Clear the program before a bus cycle."""

    def prepare(self, cycle: int) -> None:
        """Prepare the command of a bus cycle, before the arms are commanded."""

    def command(self, cycle: int, record: NDArray[Any], timeline: Timeline) -> None:
        """Complete the command of a bus cycle, after the arms are commanded."""


class Event(IntEnum):
    """Pending event of the task; events of the same bus cycle are handled in this order."""

    PROFILE = 0  # another motion profile takes effect
    PLAN = 1  # an extended plan takes effect
    STOP = 2  # the robot stops on its path
    EXACT_STOP = 3  # the master reaches an exact stop
    DISABLE = 4  # the drives are disabled


class Schedule:
    """Pending events by bus cycle, at most one of each kind; handlers are called with bus cycle and content."""

    def __init__(self, handlers: Mapping[Event, Callable[[int, Any], None]]) -> None:
        self._handlers = [(event, handlers[event]) for event in Event]
        self.cycles = [NEVER] * len(Event)  # bus cycle of each kind of event; NEVER: not pending
        self.contents: list[Any] = [None] * len(Event)
        self.next_cycle = NEVER  # of the first pending event

    def set(self, event: Event, cycle: int, content: Any = None) -> None:
        """Schedule an event for a bus cycle, ``NEVER`` to cancel it, in place of another one of its kind."""
        self.cycles[event], self.contents[event] = cycle, content
        self.next_cycle = min(self.cycles)

    def cancel(self, *events: Event) -> None:
        """Cancel pending events of these kinds."""
        for event in events:
            self.set(event, NEVER)

    def handle(self, cycle: int) -> None:
        """Handle and remove all events that are due in a bus cycle."""
        for event, handler in self._handlers:
            if cycle >= self.cycles[event]:
                content = self.contents[event]
                self.cancel(event)
                handler(cycle, content)


class BeltStage(BeltTracking, Stage):
    """Tracking of the belts by the task; ``belts`` is empty if there are none.

    ``state`` is ``TASK['state']``. ``stop`` is called with a bus cycle in which the robot cannot stay on its belt: it
    has to stop plan and belt offset.
    """

    def __init__(
        self,
        parameters: Parameters,
        belts: Sequence[BeltAxes],
        state: NDArray[Any],
        stop: Callable[[], None],
    ) -> None:
        super().__init__(parameters, belts)
        self._state, self._stop = state, stop

    def prepare(self, cycle: int) -> None:
        """Set the belt offset of the command; stop the robot if it cannot stay on its belt."""
        state = self._state[0]
        if self.lost is not None:
            self._stop()
        if self.step(cycle, bool(state['outputs'] & TRACK_BIT)):
            state['tracks'], state['offset'] = 1, self.offset
        elif state['tracks']:
            state['tracks'], state['tcp'] = 0, state['planned']
        if self.clears_at_rest and state['start_cycle'] == NEVER and cycle > self.rest_cycle:
            self.clear()

    def command(self, cycle: int, record: NDArray[Any], timeline: Timeline) -> None:
        """Check the limit of the TCP speed."""
        self.watch_speed(cycle, None if self._state['start_cycle'][0] == NEVER else timeline)

    def clear(self) -> None:
        """Clear belt and order of a robot at rest; the belt offset becomes part of its position."""
        super().clear()
        state = self._state[0]
        state['outputs'] &= TRACK_BIT - 1
        state['tracks'], state['planned'] = 0, state['tcp']


class LearnedTorques(Stage):
    """Torques that are commanded only with the plan they were learned for; they fade, and report why they are inactive.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    learned
        The torques, if any.
    no_plan
        Placeholder plan.
    state
        ``TASK['state']``; its ``corrected_from`` is the cycle of the first row of ``torques``.

    """

    def __init__(
        self, parameters: Parameters, learned: Learned | None, no_plan: Plan, state: NDArray[Any]
    ) -> None:
        self._learned, self._state = learned, state
        # why they do not fit this robot, and the loaded program
        self._other_robot = self._misfit = ''
        if learned is not None:
            self._other_robot = learned.parameter_refusal(parameters)
            Origin.of(
                '', no_plan, parameters
            )  # loads the plan comparison before a program has to wait for it
        self.torques: Floats = _NO_TORQUES  # active or fading [N m], shape (n, 3)
        self.reason = _NOTHING_YET if learned is not None else ''  # why none are active

    @property
    def exist(self) -> bool:
        """Whether torques were learned, for this or another program, including those dropped by a fault."""
        return self._learned is not None or bool(self.reason)

    def load(self, plan: Plan) -> None:
        """Check whether the torques fit a program that is about to start."""
        if self._learned is not None:
            self._misfit = self._other_robot or self._learned.plan_refusal(plan)

    def start(self, timeline: Timeline) -> None:
        """Command the torques if they fit the program that starts, at an override of 1."""
        if self._learned is None or timeline.profile is None:
            return
        as_planned = timeline.profile.override == 1.0
        self.reason = self._misfit if self._misfit or as_planned else _OVERRIDDEN
        self.torques = _NO_TORQUES if self.reason else self._learned.torques
        self._state['corrected_from'] = timeline.start_cycle

    def follow(self, timeline: Timeline, reason: str) -> None:
        """Fade the torques out: another motion profile does not follow the plan."""
        self.fade_out(timeline.start_cycle, reason)

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Fade the torques out: they were learned for the plan before."""
        self.fade_out(timeline.start_cycle, 'moves were appended to the program')

    def clear_program(self, cycle: int, reason: str) -> None:
        """Fade the torques out."""
        self.fade_out(cycle, reason)

    def fade_out(self, cycle: int, reason: str, for_good: bool = False) -> None:
        """Fade the torques to zero from a cycle on, because the motion no longer follows their plan."""
        row = cycle - int(self._state['corrected_from'][0])
        followed = row < len(self.torques) and not self.reason
        if self._learned is not None and (followed or for_good):
            self.reason = reason
        if for_good:
            self._learned = None
        if not followed:
            return
        left = self.torques[row : row + FADE_CYCLES] if row >= 0 else _NO_TORQUES
        shares = 1.0 - np.arange(1, len(left) + 1) / FADE_CYCLES
        self.torques = left * shares[:, None]
        self._state['corrected_from'] = cycle


class PositionWait(Stage):
    """Waits at exact stops: the program continues once every drive is in position (S-0-0057).

    Pure. The plan has a dwell (``MoveKind.IN_POSITION``) after each exact stop. The master rests in it longer than the
    timeout, and leaves it a fixed number of bus cycles after the feedback that shows the robot in position, so that the
    motion does not depend on the number of outstanding cycles.
    """

    def __init__(self, parameters: Parameters, schedule: Schedule) -> None:
        self._schedule = schedule  # Event.EXACT_STOP: the master reaches the next exact stop
        bus, motion = parameters.bus, parameters.motion
        self._cycle_time_s, self._reaction = bus.cycle_time_s, bus.outstanding_cycles_max
        self._cycles, self._timeout_s = parameters.in_position_cycles, motion.in_position_timeout_s
        self._windows_rad = [parameters.drive.position_window_rad] * ARMS
        for number in range(len(parameters.rotary_axes)):
            self._windows_rad.append(rotary_axis_parameters(parameters, number).drive.position_window_rad)
        self._axes = parameters.axes
        self._stops = np.zeros(0, np.int64)  # numbers of the moves
        self._passed = NO_MOVE  # last exact stop that was left
        self._resting: MotionProfile | None = None
        self._leaving: MotionProfile | None = None
        # active exact stop as a move number, and first cycle of the wait
        self.number, self.since = NO_MOVE, NEVER

    @property
    def waits(self) -> bool:
        """Whether the master rests at an exact stop."""
        return self._resting is not None

    def is_long_enough(self, cycles: int) -> bool:
        """Whether drives that were within their windows for ``cycles`` cycles are in position."""
        return cycles >= self._cycles

    def start(self, timeline: Timeline) -> None:
        """Find the exact stops of the program."""
        self._passed = self.number = NO_MOVE
        self._note_stops(timeline)
        self.follow(timeline, '')

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Find the exact stops of an extended plan."""
        self._passed = max(self._passed - left_out, NO_MOVE)
        self.number = max(self.number - left_out, NO_MOVE)
        self._note_stops(timeline)
        self.follow(timeline, '')

    def clear_program(self, cycle: int, reason: str) -> None:
        """Clear the wait."""
        self._clear()

    def _clear(self) -> None:
        self._resting = self._leaving = None
        self._schedule.cancel(Event.EXACT_STOP)

    def _note_stops(self, timeline: Timeline) -> None:
        waits = np.array([move.kind == MoveKind.IN_POSITION for move in timeline.plan.moves])
        self._stops = np.flatnonzero(waits[timeline.plan.tables.order])

    def follow(self, timeline: Timeline, reason: str) -> None:
        """Schedule the next exact stop of another motion profile."""
        profile = timeline.profile
        if profile is None or profile is self._resting:
            return
        if profile is self._leaving:
            self._passed = profile.number
        self._clear()
        coming = self._stops[self._stops >= max(profile.number, self._passed + 1)]
        if not profile.held and len(coming):
            # a profile that starts at the stop takes effect for a cycle before the next wait, so that it is published
            first = max(timeline.first_cycle_in(int(coming[0])), profile.cycle + 1)
            self._schedule.set(Event.EXACT_STOP, first)

    def rest_at(self, cycle: int, timeline: Timeline) -> MotionProfile:
        """Return the motion profile that rests at the exact stop reached in a bus cycle."""
        number, profile = timeline.at(cycle).number, timeline.profile
        self.number, self.since = number, cycle
        longest_s = self._timeout_s + (self._cycles + 2 * self._reaction) * self._cycle_time_s
        override = 1.0 if profile is None else profile.override
        self._resting = MotionProfile(cycle, number, rest(longest_s), override)
        return self._resting

    def departure(self, cycle: int, timeline: Timeline) -> MotionProfile:
        """Return the motion profile that leaves the exact stop, after the feedback of a bus cycle."""
        override = 1.0 if timeline.profile is None else timeline.profile.override
        planned = math.ceil(timeline.plan.move(self.number).duration_s / override / self._cycle_time_s - 1e-9)
        first = max(cycle + self._reaction, self.since + planned)
        self._leaving = MotionProfile(first, self.number, np.zeros((1, PHASE_COLUMNS)), override)
        return self._leaving

    def fault(self, cycle: int, since: int, where: str, off_rad: Floats, within: int) -> RobotFault | None:
        """Return the fault of a robot that is not in position by a bus cycle, None before the timeout.

        ``off_rad`` are the deviations of all motors from their commands, ``within`` is the number of consecutive
        cycles within their windows.
        """
        waited_s = (cycle - since) * self._cycle_time_s
        if waited_s < self._timeout_s:
            return None
        off = np.abs(off_rad)
        worst = int(np.argmax(np.where(np.isfinite(off), off / self._windows_rad, np.inf)))
        axis, window = self._axes[worst], self._windows_rad[worst]
        sentence = f'not in position {waited_s:.3g} s after the set points came to rest {where}'
        if off[worst] <= window:
            counted = min(within, cycle + 1 - since)
            sentence += (
                f': all drives are within their position windows (S-0-0057) for only {counted} bus cycles, '
                f'{self._cycles} are needed'
            )
            return RobotFault(FaultCode.NOT_IN_POSITION, sentence, cycle=cycle)
        sentence += f': {axis} is {off[worst]:.4g} rad off, the position window (S-0-0057) is '
        sentence += f'{window:g} rad'
        return RobotFault(FaultCode.NOT_IN_POSITION, sentence, axis, cycle=cycle)
