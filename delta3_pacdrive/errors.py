"""What goes wrong: exceptions of one family, each also a built-in one; faults of the robot and refusals, as values."""

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import ModuleType
from typing import Any, Self

_OWN = ('delta3_pacdrive', '__main__', '__mp_main__')


class Delta3Error(Exception):
    """Base of everything this package raises on purpose; the message is one sentence for the user, or several."""

    _complaints: tuple[str, ...] = ()

    @classmethod
    def of_all(cls, complaints: Iterable[str]) -> Self:
        """Return an error of all that is wrong at once."""
        told = tuple(complaints)
        error = cls('; '.join(told))
        error._complaints = told
        return error

    @property
    def complaints(self) -> tuple[str, ...]:
        """What is wrong, one by one."""
        return self._complaints or (str(self),)


class ParameterError(Delta3Error, ValueError):
    """A parameter file or value breaks a rule; the message names the key and the rule."""


class UnreachableError(Delta3Error, ValueError):
    """A pose that the arms cannot reach, or an angle triple that closes no chain."""


class SingularityError(Delta3Error, ValueError):
    """A pose in which the Jacobian has no inverse."""


class ProgramError(Delta3Error, ValueError):
    """A motion program is malformed, or a move in it is refused."""


class CellError(Delta3Error, ValueError):
    """A cell file breaks a rule; the message names the place and the rule."""


class TelegramError(Delta3Error, ValueError):
    """A message on a cyclic topic has the wrong shape, a number that is not finite, or a bad stamp."""


class TraceError(Delta3Error, ValueError):
    """A recording that cannot be read or lacks a signal."""


class EstimationError(Delta3Error, ValueError):
    """Signals that hold nothing to estimate from, or an estimation that cannot go on."""


class CalibrationError(Delta3Error, ValueError):
    """Measurements that no calibration can be made of, or poses that cannot be measured."""


class TuningError(Delta3Error, ValueError):
    """A tuning that is asked for what its input, its load or its settings do not allow."""


class LearnedError(Delta3Error, ValueError):
    """Learned torques that cannot be read, do not fit what is driven, or cannot be learned."""


class SweepError(Delta3Error, ValueError):
    """A sweep cannot be made as its file has it, or on the cluster that is there."""


class LineError(Delta3Error, ValueError):
    """A line of robots that cannot be as its file has it."""


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
    TIMEOUT = 'timeout'  # what was waited for has not come in time
    BELT = 'belt'  # a part on a belt cannot be met, or the robot could not stay on the belt

    @classmethod
    def of(cls, text: str) -> 'Code':
        """Return the code that a message names; one that is unknown is taken for ``CONTENT``."""
        return next((code for code in cls if code == text), cls.CONTENT)


class FaultCode(StrEnum):
    """A code tells what kind of fault has stopped the robot."""

    DRIVE = 'drive'  # a drive reports it; the number of its diagnostic message follows
    ANSWER_LOST = 'answer_lost'  # answers of drives are missing
    BUS_TIME = 'bus_time'  # a drive is in another bus cycle than the master
    NOT_ENABLED = 'not_enabled'  # a drive is without torque while a program runs
    SECOND_WRITER = 'second_writer'  # two answers of one drive in one cycle
    PARTICIPANT_LEFT = 'participant_left'  # somebody was started again, or has left the bus
    PARAMETERS = 'parameters'  # not everybody rests on the same parameters
    PLACE = 'place'  # the motors stand where the arms cannot be
    PLANNER_SILENT = 'planner_silent'
    PLANNER_RESTARTED = 'planner_restarted'
    NOT_IN_POSITION = 'not_in_position'  # the robot has not come to the end of a program, or to an exact stop
    EMERGENCY_STOP = 'emergency_stop'
    DISABLED = 'disabled'  # by the operator, in motion

    @classmethod
    def of(cls, text: str) -> 'FaultCode':
        """Return the code that a message names; one that is unknown is taken for ``DRIVE``."""
        return next((code for code in cls if code == text), cls.DRIVE)


def sources_of(source: str) -> tuple[str, ...]:
    """Return one by one whom the ``source`` of a fault names."""
    return tuple(source.split(', ')) if source else ()


@dataclass(frozen=True)
class RobotFault:
    """A fault has stopped the robot, or keeps it from starting.

    Attributes
    ----------
    code
        What kind of fault it is.
    sentence
        The same for people.
    source
        Who is or may be its cause: axis or participant, several parted by a comma; empty for the robot as a whole.
    number
        Number of the diagnostic message (``drive.diagnostics``), 0 if it has none or a drive has not told it yet.
    cycle
        Bus cycle in which it was found, -1 as long as nobody has said so.

    """

    code: FaultCode
    sentence: str
    source: str = ''
    number: int = 0
    cycle: int = -1

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence

    @property
    def sources(self) -> tuple[str, ...]:
        """Who is or may be its cause, one by one."""
        return sources_of(self.source)

    @staticmethod
    def facts(fault: 'RobotFault | None') -> dict[str, Any]:
        """Return what messages and reports tell of a fault beside its sentence; 0 and empty if there is none."""
        if fault is None:
            return {'fault_code': '', 'fault_number': 0, 'fault_source': '', 'fault_cycle': 0}
        return {
            'fault_code': str(fault.code),
            'fault_number': fault.number,
            'fault_source': fault.source,
            'fault_cycle': fault.cycle,
        }

    @classmethod
    def of(cls, facts: Mapping[str, Any], sentence: str) -> Self | None:
        """Read back what ``facts`` wrote; None if there was no fault."""
        if not facts.get('fault_code'):
            return None
        code = FaultCode.of(facts['fault_code'])
        return cls(code, sentence, facts['fault_source'], facts['fault_number'], facts['fault_cycle'])


@dataclass(frozen=True)
class Reason:
    """A refusal, and the fault that it is because of, if it is."""

    code: Code
    sentence: str
    fault: RobotFault | None = None

    def __str__(self) -> str:
        """Return the sentence."""
        return self.sentence

    @staticmethod
    def of(error: Delta3Error) -> 'Reason':
        """Return the reason of a refused request; any other error tells what breaks a rule."""
        return error.reason if isinstance(error, RefusedError) else Reason(Code.CONTENT, str(error))


class RefusedError(ProgramError):
    """A request that is refused, with the reason."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason.sentence)
        self.reason = reason


class ScriptError(RefusedError):
    """A call of a script that is refused, or a script that cannot go on; the message begins with its file and line.

    Parameters
    ----------
    reason
        Why, with its code.
    place
        File and line of the script, such as ``pick.py:12``; empty if nobody knows it.

    """

    def __init__(self, reason: Reason, place: str = '') -> None:
        known = not place or reason.sentence.startswith(place.rpartition(':')[0] + ':')
        super().__init__(
            reason if known else Reason(reason.code, f'{place}: {reason.sentence}', reason.fault)
        )
        self.place = place

    @property
    def code(self) -> Code:
        """What kind of refusal it is."""
        return self.reason.code


class WaitTimeoutError(ScriptError, TimeoutError):
    """What a script has waited for has not come in time."""


NO_ROS = (
    "ROS 2 is not installed here: on Linux on x86-64 pip install '.[ros]' in the folder of the sources, elsewhere "
    'source a ROS 2 Jazzy; check, simulate, plot, report and the studies work without it'
)


def loading_failure(error: BaseException) -> str | None:
    """Return why a library of others cannot be loaded, as one sentence; None if the error has another cause."""
    missing = getattr(error, 'name', None) if isinstance(error, ModuleNotFoundError) else None
    if missing == 'rclpy':
        return NO_ROS
    library, file = '', None
    trace = error.__traceback__
    while trace is not None:  # the innermost is the cause
        frame = trace.tb_frame
        name = str(frame.f_globals.get('__name__', '')).partition('.')[0]
        if frame.f_code.co_name == '<module>' and name not in _OWN:
            library, file = name, frame.f_code.co_filename
        trace = trace.tb_next
    if not library and isinstance(error, ImportError | AttributeError):  # some of it is missing
        library = '' if isinstance(error, AttributeError) else (error.name or '').partition('.')[0]
        module = error.obj if isinstance(error, AttributeError) else sys.modules.get(library)
        if isinstance(module, ModuleType):
            library, file = module.__name__, getattr(module, '__file__', None)
    elif not library and isinstance(error, SyntaxError):  # it was not compiled and has no frame
        file = error.filename
        library = _module_of(file)
    library = library.partition('.')[0]
    if library in ('', *_OWN):
        return None
    place = f' from {file}' if file else ''
    path = os.environ.get('PYTHONPATH')
    hint = f'; PYTHONPATH is {path}, whose libraries come first' if path else ''
    text = ' '.join(str(error).split())
    return f'cannot load {library}{place} with Python {sys.version.split()[0]}: {type(error).__name__}: {text}{hint}'


def _module_of(file: str | None) -> str:
    """Return the top-level module of a source file on the import path; empty if it is elsewhere."""
    from pathlib import Path

    for folder in filter(None, sys.path):
        if file and Path(file).is_relative_to(folder):
            return Path(file).with_suffix('').relative_to(folder).parts[0]
    return ''


def shown(value: object) -> str:
    """Return a value as text for a message: short, whatever it is."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, endless nesting
        text = f'a value of type {type(value).__name__}, too large to show'
    return text if len(text) <= 60 else f'{text[:57]}...'
