"""Why something is refused: a code that programs decide by, and a sentence for people."""

from dataclasses import dataclass
from enum import StrEnum


class Code(StrEnum):
    """What kind of refusal it is."""

    CONTROL = 'control'  # another operator has control of the robot
    STATE = 'state'  # not in this state of the robot
    DISABLED = 'disabled'  # the drives are not enabled
    FAULT = 'fault'  # a fault is latched
    BUS = 'bus'  # the bus is not in cyclic operation
    CONTENT = 'content'  # the request itself breaks a rule or a limit
    LATE = 'late'  # its bus cycle is over
    STRANGER = 'stranger'  # of another session, a second time, or from nobody who is there
    WITHDRAWN = 'withdrawn'  # given up by whoever asked for it
    SILENT = 'silent'  # somebody who should have answered did not


@dataclass(frozen=True)
class Reason:
    """A refusal."""

    code: Code
    sentence: str

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence
