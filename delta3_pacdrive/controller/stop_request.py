"""A stop that was asked for by taking the order back: it is answered when the motion is stopping, or over.

Pure: what the transformation task says comes in as calls.
"""

from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.program_run import RunState
from delta3_pacdrive.errors import Reason


class StopRequest:
    """The stop that is waited for, of one program after the other.

    Attributes
    ----------
    waits
        Whether somebody waits for a stop.
    since_s
        Since when nothing has been heard of it.

    """

    def __init__(self) -> None:
        self.waits = False
        self.since_s = 0.0
        self._asked_in = MotionState.IDLE

    def begin(self, motion: MotionState, now_s: float) -> None:
        """Wait for the stop of a motion."""
        self.waits, self._asked_in, self.since_s = True, motion, now_s

    def end(self) -> None:
        """Wait no longer."""
        self.waits = False

    def note(self, motion: MotionState, now_s: float) -> None:
        """Note what is done with the TCP: a long way to rest is no silence."""
        if motion == MotionState.STOPPING:
            self.since_s = now_s

    def answer(
        self, run: RunState, motion: MotionState, came_to_its_end: bool, refusal: Reason | None
    ) -> str | None:
        """Return what whoever waits is answered with, None as long as nothing is certain.

        Parameters
        ----------
        run, motion
            What becomes of the program, and what is done with the TCP.
        came_to_its_end
            Whether the program, if it is over, was driven to its end.
        refusal
            Why no program could be started now.

        """
        if run is RunState.RUNNING:
            # who was stopping or stood already shows nothing new before it is over
            begins = motion == MotionState.STOPPING and self._asked_in in (
                MotionState.IDLE,
                MotionState.MOVING,
            )
            return 'stops on the path' if begins else None
        if run is RunState.FAILED:
            return str(refusal) if refusal else 'a fault has stopped the robot'
        if came_to_its_end:
            return 'it was at its end before it could be stopped'
        if self._asked_in == MotionState.STOPPED:
            return 'it stands on its path and is given up'
        return 'stopped on the path and given up'
