"""What the planner makes of a script, move by move: the script runs dry, in a simulation that nobody keeps."""

from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.analysis.planning import report
from delta3_pacdrive.analysis.planning.evaluation import study
from delta3_pacdrive.analysis.planning.study import MoveRow
from delta3_pacdrive.cell.moves import Batch
from delta3_pacdrive.cell.script import Script
from delta3_pacdrive.cell.simulation import simulate
from delta3_pacdrive.configuration.checked import counted
from delta3_pacdrive.errors import ScriptError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.peripherals.cell import Cell


@dataclass(frozen=True)
class DryRun:
    """A script that ran dry.

    Attributes
    ----------
    name
        Of the script.
    rows
        Its moves, in the order in which they are driven, with their lines in the script.
    time_s
        From its first move to the end of its last one.
    notices
        Of the planner.
    stopped
        Why the script was given up; empty if it was not.

    """

    name: str
    rows: tuple[MoveRow, ...]
    time_s: float
    notices: tuple[str, ...]
    stopped: str


def dry_run(script: Script, parameters: Parameters, around: Cell | None = None) -> DryRun:
    """Run a script dry: its inputs are those of the cell around the robot. Raises Delta3Error if it cannot begin."""
    rows: list[MoveRow] = []

    def note(batch: Batch) -> None:
        if batch.again and rows:
            rows.pop()  # with what follows it is another move
        order = batch.planned.plan.tables.order.tolist()
        for row, number in zip(study(batch.planned, parameters).rows, order, strict=True):
            rows.append(replace(row, number=len(rows) + 1, name=batch.names[number]))

    robot = None
    try:
        with simulate(parameters, cell=around, name=script.name) as robot:
            robot.on_planned(note)
            script.run(robot)
    except ScriptError:
        if robot is None:
            raise
    meta = robot.trace.meta
    if len(rows) == len(meta['moves']):  # else some were never driven
        rows = [
            replace(row, start_s=move['start_s'], duration_s=move['end_s'] - move['start_s'])
            for row, move in zip(rows, meta['moves'], strict=True)
        ]
    return DryRun(script.name, tuple(rows), meta['program_s'], tuple(meta['notices']), meta['stopped'])


def document(found: DryRun, with_limits: bool = False) -> dict[str, Any]:
    """Return a dry run ready for JSON, as ``analysis.planning.report.document`` does for programs."""
    return {
        'ok': not found.stopped,
        'program': found.name,
        'time_s': found.time_s,
        'length_m': float(sum(row.length_m for row in found.rows)),
        'moves': [report.move_document(row, with_limits) for row in found.rows],
        'notices': list(found.notices),
        'stopped': found.stopped,
    }


def text(found: DryRun) -> list[str]:
    """Return a dry run as lines for people: a table of the moves, and what was slowed down."""
    moved_s = sum(row.duration_s for row in found.rows)
    lines = [f'{found.name}: {counted(len(found.rows), "move")}', *report.table_of_moves(found.rows)]
    notes = [('whole', f'{found.time_s:.3f} s, {found.time_s - moved_s:.3f} s of it between moves')]
    notes += [('note', notice) for notice in found.notices]
    return [*lines, *(f'{name:>12}  {line}' for name, line in notes)]
