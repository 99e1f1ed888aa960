"""Statements of a script: what a call says, in a frame, for a tool, with the names of the cell."""

from collections.abc import Mapping
from typing import Any

from delta3_pacdrive.cell.values import plain
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.motion.frames import Frame, Tool
from delta3_pacdrive.motion.output_names import OutputNames
from delta3_pacdrive.motion.program import Statement
from delta3_pacdrive.motion.single_statement import read_statement
from delta3_pacdrive.parameters import Motion

WITH_POINTS = ('move_l', 'move_c', 'move_sb', 'arch', 'cubic')


class StatementMaker:
    """The statements of one script.

    Parameters
    ----------
    motion
        Limits of moves that tell none.
    outputs
        Those that the script may name.

    Attributes
    ----------
    frame, tool
        Of moves that tell none; None: ``base``, and the TCP of the plate.

    """

    def __init__(self, motion: Motion, outputs: OutputNames) -> None:
        self._motion, self._outputs = motion, outputs
        self.frame: Frame | None = None
        self.tool: Tool | None = None

    @property
    def tool_kg(self) -> float:
        """Mass of the tool that the robot carries [kg]."""
        return 0.0 if self.tool is None else self.tool.mass_kg

    def make(self, kind: str, keys: Mapping[str, Any], part: Frame | None = None) -> Statement:
        """Return what a call says; raises ProgramError.

        ``part`` is the frame of the part on a belt that the robot works on, which no move can leave.
        """
        told, frame, tool = dict(keys), part or self.frame, self.tool
        if kind in WITH_POINTS:
            if 'frame' in told:
                if part is not None:
                    raise ProgramError(
                        f'{kind}: on a belt, points are in the frame of the part: leave out frame'
                    )
                frame = checked_frame(told.pop('frame'))
            if 'tool' in told:
                tool = self._of_same_mass(checked_tool(told.pop('tool')))
        return read_statement(kind, plain(told), self._motion, frame, tool, self._outputs)

    def _of_same_mass(self, tool: Tool | None) -> Tool | None:
        mass_kg = 0.0 if tool is None else tool.mass_kg
        if tool is not None and mass_kg != self.tool_kg:
            raise ProgramError(
                f'tool {shown(tool.name)} weighs {mass_kg:g} kg, but the robot carries a tool of {self.tool_kg:g} kg: '
                'robot.use(tool=...) changes it'
            )
        return tool


def checked_frame(value: Any) -> Frame | None:
    """Return a frame; raises ProgramError for anything else. None is ``base``."""
    if value is None:
        return None
    if isinstance(value, Frame):
        return value.in_base  # as programs have it
    raise ProgramError(f'frame is {shown(value)}, but must be a Frame of delta3_pacdrive.motion.frames')


def checked_tool(value: Any) -> Tool | None:
    """Return a tool; raises ProgramError for anything else. None is the TCP of the plate."""
    if value is None or isinstance(value, Tool):
        return value
    raise ProgramError(f'tool is {shown(value)}, but must be a Tool of delta3_pacdrive.motion.frames')
