"""Inputs of the commands ``run``, ``simulate`` and ``plan``: program, sampled reference trajectory, cell."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from delta3_pacdrive.cell.cell import Cell
    from delta3_pacdrive.cli.command import ReferenceOptions


@dataclass(frozen=True)
class Chosen:
    """Selected program (file or packaged name), the input files behind it, and notes."""

    program: str
    inputs: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def digests(self) -> list[str]:
        """Return each input with the digest of its content; raises ReportError."""
        from delta3_pacdrive.planning.program import file_reader as programs
        from delta3_pacdrive.studies.framework.provenance import digest

        return [f'{name} {digest(programs.find(name))}' for name in self.inputs]


@contextmanager
def program_of(options: ReferenceOptions) -> Iterator[Chosen]:
    """Yield the selected program; a reference is converted into a temporary program file. Raises Delta3Error.

    Sets ``options.parameters`` to the parameter file of the run.
    """
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.configuration.packaged import THESIS_PROGRAMS

    # a reference is a log to compare with the model: use the controller of the thesis
    like = options.program if options.reference is None else THESIS_PROGRAMS[0]
    options.parameters = core.of_run(options.parameters, like)
    if options.reference is None:
        yield Chosen(options.program, (options.program,))
        return
    import tempfile

    from delta3_pacdrive import simulation
    from delta3_pacdrive.planning.program import file_reader as programs
    from delta3_pacdrive.studies.runs import reference

    robot = core.load(options.parameters)
    if options.exchange_period is not None:
        robot = robot.replace(bus__exchange_period_s=options.exchange_period)
    played = reference.load(options.reference, robot, options.columns, options.lowpass)
    inputs = (options.reference, *filter(None, [options.columns]))
    with tempfile.TemporaryDirectory(prefix='delta3-reference-') as folder:
        path = played.write(Path(folder) / 'reference.yaml')
        program = programs.load(path, robot.motion)
        played.require_drivable(program, simulation.placed(robot, program))
        yield Chosen(str(path), inputs, (f'reference: {played.text}',))


def cell_of(options: Any) -> Cell | None:
    """Return the cell of the options; raises CellError."""
    if options.cell is None:
        return None
    from delta3_pacdrive.cell import cell_file

    return cell_file.load(options.cell)


def cell_digest(options: Any) -> list[str]:
    """Return the cell file of the options with its digest, if there is one; raises CellError."""
    if options.cell is None:
        return []
    from delta3_pacdrive.cell import cell_file
    from delta3_pacdrive.studies.framework.provenance import digest

    return [f'{options.cell} {digest(cell_file.find(options.cell))}']
