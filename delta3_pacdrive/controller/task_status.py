"""The newest word of the transformation task; old words, and those of another master, are not believed."""

import math

from delta3_pacdrive.controller.messages import Numbering, Status
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.errors import Code, Reason

MASTER_SILENT_S = 1.0  # without a status, after which that of another master counts
FOREIGN_S = 2.0  # without a foreign status, after which topics that are open to everybody are believed again
STATES = frozenset(str(state) for state in MotionState)


class TaskStatus:
    """What a planner knows of the transformation task.

    Attributes
    ----------
    newest
        The newest status, None before the first.
    received
        How many were taken.

    """

    def __init__(self) -> None:
        self.newest: Status | None = None
        self.received = 0
        self._received_s = 0.0
        self._foreign_s = -math.inf
        self._serials = Numbering()

    def take(self, status: Status, now_s: float) -> bool:
        """Take a status; False for what is old or comes from elsewhere."""
        if status.state not in STATES:
            return False
        before = self.newest
        foreign = before is not None and before.session not in (status.session, status.previous)
        if foreign and now_s - self._received_s < MASTER_SILENT_S:
            # another master, or a recording: believed when the present one says nothing any more
            self._foreign_s = now_s
            return False
        if not self._serials.is_new(status.session, status.serial):
            self._foreign_s = now_s
            return False
        self.newest, self._received_s = status, now_s
        self.received += 1
        return True

    def played_back(self, now_s: float) -> Reason | None:
        """Return why nobody can know who has sent what comes by topic: a bag is played back here, or was just now."""
        if now_s - self._foreign_s >= FOREIGN_S:
            return None
        return Reason(
            Code.FOREIGN,
            'a recording is played back here, or there is another transformation task: what comes by topic is '
            f'refused until {FOREIGN_S:g} s after that',
        )
