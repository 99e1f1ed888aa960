"""Source position of a call in a script, for error messages."""

import contextlib
import sys
from pathlib import Path
from types import FrameType
from typing import NamedTuple

OWN = str(Path(__file__).parent)
WITH = contextlib.__file__  # on the stack between a with statement and its context manager


class ScriptPlace(NamedTuple):
    """Source position; line and column count from 1, the file is relative to the working directory."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        """Return file and line."""
        return f'{self.file}:{self.line}' if self.file else ''


NOWHERE = ScriptPlace('', 0, 0)


def of_caller() -> ScriptPlace:
    """Return the source position of the call that entered this package."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith((OWN, WITH)):
        frame = frame.f_back
    if frame is None:
        return NOWHERE
    positions = list(frame.f_code.co_positions())
    line, _, column, _ = positions[frame.f_lasti // 2]
    return ScriptPlace(shown_file(frame.f_code.co_filename), line or frame.f_lineno, (column or 0) + 1)


def shown_file(file: str) -> str:
    """Return a file name relative to the working directory, if the file is below it."""
    try:
        return str(Path(file).relative_to(Path.cwd()))
    except (ValueError, OSError):  # outside, or the working directory no longer exists
        return file
