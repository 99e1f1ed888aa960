"""Newest status of the transformation task; outdated ones and those of another master are ignored."""

import math

from delta3_pacdrive.control.messages import Numbering, Status
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.errors import Code, Reason

MASTER_SILENT_S = 1.0  # without a status, after which another master is accepted
FOREIGN_S = 2.0  # without a foreign status, after which public topics are trusted again
STATES = frozenset(str(state) for state in MotionState)


class TaskStatus:
    """Status of the transformation task as known to a planner."""

    def __init__(self) -> None:
        self.newest: Status | None = None
        self.received = 0  # number of statuses taken
        self._received_s = 0.0
        self._foreign_s = -math.inf
        self._serials = Numbering()

    def take(self, status: Status, now_s: float) -> bool:
        """Take a status; return False if it is outdated or from another master."""
        if status.state not in STATES:
            return False
        before = self.newest
        foreign = before is not None and before.session not in (status.session, status.previous)
        if foreign and now_s - self._received_s < MASTER_SILENT_S:
            # another master, or a recording: accepted only once the present master stops publishing
            self._foreign_s = now_s
            return False
        if not self._serials.is_new(status.session, status.serial):
            self._foreign_s = now_s
            return False
        self.newest, self._received_s = status, now_s
        self.received += 1
        return True

    def played_back(self, now_s: float) -> Reason | None:
        """Return why the sender of a topic cannot be trusted: a bag is being played back, or was within FOREIGN_S."""
        if now_s - self._foreign_s >= FOREIGN_S:
            return None
        return Reason(
            Code.FOREIGN,
            'a recording is played back here, or there is another transformation task: requests by topic are '
            f'refused until {FOREIGN_S:g} s after that',
        )
