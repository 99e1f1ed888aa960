"""The newest word of the transformation task; old words, and those of another master, are not believed."""

from delta3_pacdrive.controller.messages import Numbering, Status
from delta3_pacdrive.controller.motion_state import MotionState

MASTER_SILENT_S = 1.0  # without a status, after which that of another master counts
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
        self._serials = Numbering()

    def take(self, status: Status, now_s: float) -> bool:
        """Take a status; False for what is old or comes from elsewhere."""
        if status.state not in STATES:
            return False
        before = self.newest
        foreign = before is not None and before.session not in (status.session, status.previous)
        if foreign and now_s - self._received_s < MASTER_SILENT_S:
            # another master, or a recording: believed when the present one says nothing any more
            return False
        if not self._serials.is_new(status.session, status.serial):
            return False
        self.newest, self._received_s = status, now_s
        self.received += 1
        return True
