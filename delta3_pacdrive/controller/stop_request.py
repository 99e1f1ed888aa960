"""A stop requested by revoking an order; it is answered when the motion is stopping or has ended.

Pure: the state of the transformation task arrives as calls.
"""

from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.program_run import RunState
from delta3_pacdrive.errors import Reason


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

    def answer(
        self, run: RunState, motion: MotionState, completed: bool, refusal: Reason | None
    ) -> str | None:
        """Return the reply to the request, None while the outcome is unknown.

        Parameters
        ----------
        run, motion
            State of the program, and of the motion.
        came_to_its_end
            Whether the program was executed to its end.
        refusal
            Why no program could be started now.

        """
        if run is RunState.RUNNING:
            # a robot that was stopping or stopped already shows no change before the end
            begins = motion == MotionState.STOPPING and self._asked_in in (
                MotionState.IDLE,
                MotionState.MOVING,
            )
            return 'stops on the path' if begins else None
        if run is RunState.FAILED:
            return str(refusal) if refusal else 'a fault has stopped the robot'
        if completed:
            return 'it was at its end before it could be stopped'
        if self._asked_in == MotionState.STOPPED:
            return 'at rest on the path and aborted'
        return 'stopped on the path and aborted'
