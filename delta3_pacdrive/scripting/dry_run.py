"""Dry run of a script: planned moves with their limits, from a simulation that is discarded."""

from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.configuration.strict_reader import counted
from delta3_pacdrive.errors import ScriptError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.scripting.moves import Batch
from delta3_pacdrive.scripting.script import Script
from delta3_pacdrive.scripting.simulation import simulate
from delta3_pacdrive.studies.places.planning import report
from delta3_pacdrive.studies.places.planning.evaluation import study
from delta3_pacdrive.studies.places.planning.study import MoveRow


@dataclass(frozen=True)
class DryRun:
    """Result of a dry run."""

    name: str
    rows: tuple[MoveRow, ...]  # executed moves, with line numbers of the script
    time_s: float  # from the start of the first move to the end of the last one
    notices: tuple[str, ...]
    stopped: str  # reason of an abort, or empty


def dry_run(script: Script, parameters: Parameters, around: Cell | None = None) -> DryRun:
    """Run a script in a simulation with the cell ``around`` the robot; raises Delta3Error if it cannot start."""
    rows: list[MoveRow] = []

    def note(batch: Batch) -> None:
        if batch.again and rows:
            rows.pop()  # replanned
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
    if len(rows) == len(meta['moves']):  # otherwise some moves were not executed
        rows = [
            replace(row, start_s=move['start_s'], duration_s=move['end_s'] - move['start_s'])
            for row, move in zip(rows, meta['moves'], strict=True)
        ]
    return DryRun(script.name, tuple(rows), meta['program_s'], tuple(meta['notices']), meta['stopped'])


def document(found: DryRun, with_limits: bool = False) -> dict[str, Any]:
    """Return a dry run for JSON, like ``studies.places.planning.report.document`` for programs."""
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
    """Return a dry run as lines of text: a table of the moves, and notices."""
    moved_s = sum(row.duration_s for row in found.rows)
    lines = [f'{found.name}: {counted(len(found.rows), "move")}', *report.table_of_moves(found.rows)]
    notes = [('whole', f'{found.time_s:.3f} s, {found.time_s - moved_s:.3f} s of it between moves')]
    notes += [('note', notice) for notice in found.notices]
    return [*lines, *(f'{name:>12}  {line}' for name, line in notes)]
