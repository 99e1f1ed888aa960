"""Stages of the transformation task, and the schedule of its pending events.

A stage is a part of the task with its own state, such as the wait at exact stops or the tracking of belts. The task
calls all its stages in the same way, so a robot without belts or without a rotary axis only has fewer of them.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any

from numpy.typing import NDArray

from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.tracking import BeltTracking
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.move import TRACK_BIT
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.robot.sercos.bus_time import NEVER


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
