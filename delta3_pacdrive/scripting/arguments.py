"""Arguments of script calls: checks of numbers, and conversion to program statements with default frame and tool."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from delta3_pacdrive.errors import Code, ProgramError, Reason, ScriptError, shown
from delta3_pacdrive.parameters import Motion
from delta3_pacdrive.planning.program.file_reader import read_statement
from delta3_pacdrive.planning.program.frames import Frame, Tool
from delta3_pacdrive.planning.program.model import Statement
from delta3_pacdrive.planning.program.output_names import OutputNames

TIMEOUT_S = 10.0  # default timeout for inputs and parts
TIME_MAX_S = 3600.0  # maximum time of a wait
WITH_POINTS = ('move_l', 'move_c', 'move_sb', 'arch', 'cubic')


def script_error(code: Code, sentence: str) -> ScriptError:
    """Return the error of a rejected call; its place is added later."""
    return ScriptError(Reason(code, sentence))


def plain(value: Any) -> Any:
    """Convert tuples, arrays and numpy numbers to the plain types of a program file."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def number(name: str, value: Any, low: float, high: float, unit: str = '') -> float:
    """Check that a value is a number within limits; raises ProgramError."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        raise ProgramError(f'{name} is {shown(value)}, but must be a number')
    if not low <= value <= high:
        raise ProgramError(f'{name} is {value:g}{unit}, but must be between {low:g} and {high:g}{unit}')
    return float(value)


class StatementMaker:
    """Creates the statements of one script; ``motion`` has the default limits of moves."""

    def __init__(self, motion: Motion, outputs: OutputNames) -> None:
        self._motion, self._outputs = motion, outputs
        self.frame: Frame | None = None  # default frame; None: base
        self.tool: Tool | None = None  # default tool; None: TCP of the plate

    @property
    def tool_kg(self) -> float:
        """Mass of the default tool [kg]."""
        return 0.0 if self.tool is None else self.tool.mass_kg

    def make(self, kind: str, keys: Mapping[str, Any], part: Frame | None = None) -> Statement:
        """Return the statement of a call; raises ProgramError.

        ``part`` is the frame of a part on a belt; it cannot be replaced by ``frame``.
        """
        values, frame, tool = dict(keys), part or self.frame, self.tool
        if kind in WITH_POINTS:
            if 'frame' in values:
                if part is not None:
                    raise ProgramError(f'{kind}: on a belt, points are in the frame of the part: omit frame')
                frame = checked_frame(values.pop('frame'))
            if 'tool' in values:
                tool = self._of_same_mass(checked_tool(values.pop('tool')))
        return read_statement(
            kind, plain(values), motion=self._motion, frame=frame, tool=tool, outputs=self._outputs
        )

    def _of_same_mass(self, tool: Tool | None) -> Tool | None:
        mass_kg = 0.0 if tool is None else tool.mass_kg
        if tool is not None and mass_kg != self.tool_kg:
            raise ProgramError(
                f'tool {shown(tool.name)} has a mass of {mass_kg:g} kg, but the present tool has {self.tool_kg:g} kg: '
                'change it with robot.use(tool=...)'
            )
        return tool


def checked_frame(value: Any) -> Frame | None:
    """Check that a value is a frame, or None for ``base``; raises ProgramError."""
    if value is None:
        return None
    if isinstance(value, Frame):
        return value.in_base
    raise ProgramError(
        f'frame is {shown(value)}, but must be a Frame of delta3_pacdrive.planning.program.frames'
    )


def checked_tool(value: Any) -> Tool | None:
    """Check that a value is a tool, or None for the TCP of the plate; raises ProgramError."""
    if value is None or isinstance(value, Tool):
        return value
    raise ProgramError(
        f'tool is {shown(value)}, but must be a Tool of delta3_pacdrive.planning.program.frames'
    )
