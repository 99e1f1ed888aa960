"""Exceptions of the package, each also derived from a built-in one; robot faults and rejections as values."""

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import ModuleType
from typing import Any, Self

_OWN = ('delta3_pacdrive', '__main__', '__mp_main__')


class Delta3Error(Exception):
    """Base class of all exceptions that this package raises; the message is meant for the user."""

    _complaints: tuple[str, ...] = ()

    @classmethod
    def of_all(cls, complaints: Iterable[str]) -> Self:
        """Return one error with several complaints, joined by semicolons."""
        parts = tuple(complaints)
        error = cls('; '.join(parts))
        error._complaints = parts
        return error

    @property
    def complaints(self) -> tuple[str, ...]:
        """The complaints one by one."""
        return self._complaints or (str(self),)


class ParameterError(Delta3Error, ValueError):
    """A parameter file or value breaks a rule."""


class UnreachableError(Delta3Error, ValueError):
    """A pose that the arms cannot reach, or arm angles for which forward kinematics has no solution."""


class SingularityError(Delta3Error, ValueError):
    """A pose in which the Jacobian has no inverse."""


class ProgramError(Delta3Error, ValueError):
    """A motion program is malformed, or one of its moves is rejected."""


class CellError(Delta3Error, ValueError):
    """A cell file breaks a rule."""


class TelegramError(Delta3Error, ValueError):
    """A cyclic message has the wrong shape, a non-finite number or an invalid stamp."""


class TraceError(Delta3Error, ValueError):
    """A recording cannot be read or lacks a signal."""


class EstimationError(Delta3Error, ValueError):
    """The signals are unsuitable for an estimation, or the estimation did not converge."""


class CalibrationError(Delta3Error, ValueError):
    """Measurements unsuitable for a calibration, or poses that cannot be measured."""


class TuningError(Delta3Error, ValueError):
    """A tuning request that its input, load or settings do not allow."""


class LearnedError(Delta3Error, ValueError):
    """Learned torques that cannot be read or learned, or that do not fit the program."""


class SweepError(Delta3Error, ValueError):
    """A sweep file that cannot be executed, or not on the available cluster."""


class LineError(Delta3Error, ValueError):
    """A line file that breaks a rule."""


class FigureError(Delta3Error, OSError):
    """Figures cannot be written."""


class ReportError(Delta3Error, OSError):
    """A report cannot be written, or its input cannot be read."""


class KernelError(Delta3Error, OSError):
    """No folder for compiled kernels is available."""


class RunError(Delta3Error, RuntimeError):
    """A run of the graph failed; the message names the process and the reason."""


class RunInterruptedError(RunError):
    """A run was interrupted from outside, after its cleanup."""


class Code(StrEnum):
    """Kind of rejection."""

    CONTROL = 'control'  # another operator has control of the robot
    STATE = 'state'  # not allowed in the current robot state
    DISABLED = 'disabled'
    FAULT = 'fault'  # a fault is latched
    BUS = 'bus'  # the bus is not in cyclic operation
    CONTENT = 'content'  # the request itself breaks a rule or a limit
    LATE = 'late'  # its bus cycle has passed
    FOREIGN = 'foreign'  # from another session, an unknown sender, or a duplicate
    WITHDRAWN = 'withdrawn'  # cancelled by the requester
    SILENT = 'silent'  # no response from a participant
    TIMEOUT = 'timeout'
    BELT = 'belt'  # a part on a belt is out of reach, or the robot cannot follow the belt

    @classmethod
    def of(cls, text: str) -> 'Code':
        """Return the code for ``text``, ``CONTENT`` if it is unknown."""
        return next((code for code in cls if code == text), cls.CONTENT)


class FaultCode(StrEnum):
    """Kind of fault that stopped the robot."""

    DRIVE = 'drive'  # reported by a drive, with the number of its diagnostic message
    ANSWER_LOST = 'answer_lost'  # missing ATs
    BUS_TIME = 'bus_time'  # a drive is in another bus cycle than the master
    NOT_ENABLED = 'not_enabled'  # a drive lost torque while a program was running
    SECOND_WRITER = 'second_writer'  # two ATs of one drive in one cycle
    PARTICIPANT_LEFT = 'participant_left'  # a participant restarted or left the bus
    PARAMETERS = 'parameters'  # participants use different parameters
    PLACE = 'place'  # forward kinematics has no solution for the motor angles
    PLANNER_SILENT = 'planner_silent'
    PLANNER_RESTARTED = 'planner_restarted'
    NOT_IN_POSITION = 'not_in_position'  # at the end of a program or at an exact stop
    EMERGENCY_STOP = 'emergency_stop'
    DISABLED = 'disabled'  # by the operator, during motion

    @classmethod
    def of(cls, text: str) -> 'FaultCode':
        """Return the code for ``text``, ``DRIVE`` if it is unknown."""
        return next((code for code in cls if code == text), cls.DRIVE)


def sources_of(source: str) -> tuple[str, ...]:
    """Split the ``source`` of a fault into names."""
    return tuple(source.split(', ')) if source else ()


@dataclass(frozen=True)
class RobotFault:
    """A fault that stopped the robot or prevents it from starting."""

    code: FaultCode
    sentence: str
    source: str = ''  # axes or participants that may be the cause, comma-separated; empty for the whole robot
    number: int = (
        0  # diagnostic message (``robot.drive.diagnostics``); 0 without one, or not yet reported by the drive
    )
    cycle: int = -1  # bus cycle of detection; -1 if unknown

    def __str__(self) -> str:
        """Return the message for the user."""
        return self.sentence

    @property
    def sources(self) -> tuple[str, ...]:
        """Possible causes one by one."""
        return sources_of(self.source)

    @staticmethod
    def facts(fault: 'RobotFault | None') -> dict[str, Any]:
        """Return the fields of messages and reports about a fault; 0 and empty strings without one."""
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
        """Rebuild a fault from ``facts``; None if there was none."""
        if not facts.get('fault_code'):
            return None
        code = FaultCode.of(facts['fault_code'])
        return cls(code, sentence, facts['fault_source'], facts['fault_number'], facts['fault_cycle'])


@dataclass(frozen=True)
class Reason:
    """A rejection, with the fault that caused it, if any."""

    code: Code
    sentence: str
    fault: RobotFault | None = None

    def __str__(self) -> str:
        """Return the message for the user."""
        return self.sentence

    @staticmethod
    def of(error: Delta3Error) -> 'Reason':
        """Return the reason of a rejected request; other errors map to ``Code.CONTENT``."""
        return error.reason if isinstance(error, RefusedError) else Reason(Code.CONTENT, str(error))


class RefusedError(ProgramError):
    """A rejected request, with the reason."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason.sentence)
        self.reason = reason


class ScriptError(RefusedError):
    """A rejected call of a script, or a script that cannot continue; the message begins with file and line.

    Parameters
    ----------
    reason
        Code and message.
    place
        File and line of the script, such as ``pick.py:12``; empty if unknown.

    """

    def __init__(self, reason: Reason, place: str = '') -> None:
        known = not place or reason.sentence.startswith(place.rpartition(':')[0] + ':')
        super().__init__(
            reason if known else Reason(reason.code, f'{place}: {reason.sentence}', reason.fault)
        )
        self.place = place

    @property
    def code(self) -> Code:
        """Kind of rejection."""
        return self.reason.code


class WaitTimeoutError(ScriptError, TimeoutError):
    """A script waited longer than its timeout."""


NO_ROS = (
    "ROS 2 is not installed here: on Linux on x86-64 pip install '.[ros]' in the folder of the sources, elsewhere "
    'source a ROS 2 Jazzy; check, simulate, plot, report and the studies work without it'
)


def loading_failure(error: BaseException) -> str | None:
    """Return one sentence if a third-party library failed to load; None if the error has another cause."""
    missing = getattr(error, 'name', None) if isinstance(error, ModuleNotFoundError) else None
    if missing == 'rclpy':
        return NO_ROS
    library, file = '', None
    trace = error.__traceback__
    while trace is not None:  # the innermost frame is the cause
        frame = trace.tb_frame
        name = str(frame.f_globals.get('__name__', '')).partition('.')[0]
        if frame.f_code.co_name == '<module>' and name not in _OWN:
            library, file = name, frame.f_code.co_filename
        trace = trace.tb_next
    if not library and isinstance(error, ImportError | AttributeError):  # incomplete library
        library = '' if isinstance(error, AttributeError) else (error.name or '').partition('.')[0]
        module = error.obj if isinstance(error, AttributeError) else sys.modules.get(library)
        if isinstance(module, ModuleType):
            library, file = module.__name__, getattr(module, '__file__', None)
    elif not library and isinstance(error, SyntaxError):  # not compiled, so it has no frame
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
    """Return the top-level module of a source file, empty if it is not on the import path."""
    from pathlib import Path

    for folder in filter(None, sys.path):
        if file and Path(file).is_relative_to(folder):
            return Path(file).with_suffix('').relative_to(folder).parts[0]
    return ''


def shown(value: object) -> str:
    """Return a value as text of at most 60 characters."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # integers of thousands of digits, endless nesting
        text = f'a value of type {type(value).__name__}, too large to show'
    return text if len(text) <= 60 else f'{text[:57]}...'
