"""Reader of a single statement, for clients that issue moves one by one."""

from collections.abc import Mapping
from typing import Any

from delta3_pacdrive.configuration.checked import Errors
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.frames import BASE, Frame, Tool
from delta3_pacdrive.motion.limits import Limits
from delta3_pacdrive.motion.output_names import OWN, OutputNames
from delta3_pacdrive.motion.point_reader import PointReader, Setting
from delta3_pacdrive.motion.program import Statement
from delta3_pacdrive.motion.statement_reader import Head, StatementReader
from delta3_pacdrive.parameters import Motion


def read_statement(
    kind: str,
    keys: Mapping[str, Any],
    motion: Motion,
    frame: Frame | None = None,
    tool: Tool | None = None,
    outputs: OutputNames = OWN,
) -> Statement:
    """Build a statement as in a program.

    Parameters
    ----------
    kind, keys
        Kind of the statement, such as ``move_l``, and its keys.
    motion
        Default limits.
    frame, tool
        Default frame of points, and tool whose working point is positioned.
    outputs
        Available output names.

    Raises
    ------
    ProgramError
        A rule is violated; states up to ten errors.

    """
    errors = Errors('')
    defaults = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
    head = Head(
        defaults, motion.tcp_speed_limit_m_s, setting=Setting(frame, tool, {BASE.name: BASE}), outputs=outputs
    )
    reader = StatementReader(head, PointReader(errors), errors)
    found: list[Statement] = []
    with errors.raised_as(ProgramError), errors.noted(None):
        found.extend(one.statement for one in reader.statements([{kind: dict(keys)}], 'moves'))
    return found[0]
