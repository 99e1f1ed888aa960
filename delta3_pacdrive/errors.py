"""What goes wrong: exceptions of one family, each also a built-in one, and refusals, which are values."""

from dataclasses import dataclass
from enum import StrEnum


class Delta3Error(Exception):
    """Base of everything this package raises on purpose; the message is one sentence for the user."""


class ParameterError(Delta3Error, ValueError):
    """A parameter file or value breaks a rule; the message names the key and the rule."""


class UnreachableError(Delta3Error, ValueError):
    """A pose that the arms cannot reach, or an angle triple that closes no chain."""


class SingularityError(Delta3Error, ValueError):
    """A pose in which the Jacobian has no inverse."""


class ProgramError(Delta3Error, ValueError):
    """A motion program is malformed, or a move in it is refused."""


class TelegramError(Delta3Error, ValueError):
    """A message on a cyclic topic has the wrong shape, a number that is not finite, or a bad stamp."""


class TraceError(Delta3Error, ValueError):
    """A recording that cannot be read or lacks a signal."""


class EstimationError(Delta3Error, ValueError):
    """Signals that hold nothing to estimate from, or an estimation that cannot go on."""


class TuningError(Delta3Error, ValueError):
    """A tuning that is asked for what its input, its load or its settings do not allow."""


class FigureError(Delta3Error, OSError):
    """Figures that cannot be written."""


class ReportError(Delta3Error, OSError):
    """A report cannot be written, or what it is about cannot be read."""


class KernelError(Delta3Error, OSError):
    """Compiled kernels have no place."""


class RunError(Delta3Error, RuntimeError):
    """A run of the graph ended otherwise than planned; the message names who and why."""


class RunInterruptedError(RunError):
    """A run was ended from outside, and has put in order what it leaves behind."""


class Code(StrEnum):
    """What kind of refusal it is."""

    CONTROL = 'control'  # another operator has control of the robot
    STATE = 'state'  # not in this state of the robot
    DISABLED = 'disabled'  # the drives are not enabled
    FAULT = 'fault'  # a fault is latched
    BUS = 'bus'  # the bus is not in cyclic operation
    CONTENT = 'content'  # the request itself breaks a rule or a limit
    LATE = 'late'  # its bus cycle is over
    FOREIGN = 'foreign'  # of another session, a second time, or from nobody who is there
    WITHDRAWN = 'withdrawn'  # given up by whoever asked for it
    SILENT = 'silent'  # somebody who should have answered did not

    @classmethod
    def of(cls, text: str) -> 'Code':
        """Return the code that a message names; one that is unknown is taken for ``CONTENT``."""
        return next((code for code in cls if code == text), cls.CONTENT)


@dataclass(frozen=True)
class Reason:
    """A refusal."""

    code: Code
    sentence: str

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence


class RefusedError(ProgramError):
    """A request that is refused, with the reason."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason.sentence)
        self.reason = reason


def shown(value: object) -> str:
    """Return a value as text for a message: short, whatever it is."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, endless nesting
        text = f'a {type(value).__name__} that is too large to show'
    return text if len(text) <= 60 else f'{text[:57]}...'
