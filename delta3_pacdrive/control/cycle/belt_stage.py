"""Belt tracking as a stage of the transformation task: adds the belt offset to the command of each bus cycle."""

from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import NDArray

from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.tracking import BeltTracking
from delta3_pacdrive.control.cycle.stages import Stage
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.move import TRACK_BIT
from delta3_pacdrive.robot.sercos.bus_time import NEVER


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
