"""Where in a script a call stands: the file and the line that a refusal names."""

import contextlib
import sys
from pathlib import Path
from types import FrameType
from typing import NamedTuple

OWN = str(Path(__file__).parent)
WITH = contextlib.__file__  # what stands between a with statement and what it enters


class ScriptPlace(NamedTuple):
    """A call stands here; line and column count from 1. The file is named as people would type it."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        """Return file and line."""
        return f'{self.file}:{self.line}' if self.file else ''


NOWHERE = ScriptPlace('', 0, 0)


def of_caller() -> ScriptPlace:
    """Return the place of the call that has come into this room."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None and frame.f_code.co_filename.startswith((OWN, WITH)):
        frame = frame.f_back
    if frame is None:
        return NOWHERE
    positions = list(frame.f_code.co_positions())
    line, _, column, _ = positions[frame.f_lasti // 2]
    return ScriptPlace(shown_file(frame.f_code.co_filename), line or frame.f_lineno, (column or 0) + 1)


def shown_file(file: str) -> str:
    """Return the name of a file as seen from the present folder, if it is below that."""
    try:
        return str(Path(file).relative_to(Path.cwd()))
    except (ValueError, OSError):  # elsewhere, or the folder is gone
        return file
