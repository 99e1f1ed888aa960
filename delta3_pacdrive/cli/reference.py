"""What the commands share that run a program, or play a sampled trajectory instead."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from delta3_pacdrive.cli.command import ReferenceOptions


@dataclass(frozen=True)
class Chosen:
    """What is run: a program file or the name of a packaged one, the inputs that it comes from, notes for people."""

    program: str
    inputs: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def digests(self) -> list[str]:
        """Return the inputs, each with the digest of its bytes; raises ReportError."""
        from delta3_pacdrive.analysis.provenance import digest
        from delta3_pacdrive.motion import program_file as programs

        return [f'{name} {digest(programs.find(name))}' for name in self.inputs]


@contextmanager
def program_of(options: ReferenceOptions) -> Iterator[Chosen]:
    """Give what is run; a reference becomes a program file, which is there meanwhile. Raises Delta3Error.

    The options say from then on which parameter file the run has.
    """
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.configuration.packaged import THESIS_PROGRAMS

    # what is played is a log to be held against the model: of a robot as the thesis has it
    like = options.program if options.reference is None else THESIS_PROGRAMS[0]
    options.parameters = core.of_run(options.parameters, like)
    if options.reference is None:
        yield Chosen(options.program, (options.program,))
        return
    import tempfile

    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis import reference
    from delta3_pacdrive.motion import program_file as programs

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
