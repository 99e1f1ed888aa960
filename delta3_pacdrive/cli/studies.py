"""Execution of studies: progress display, interrupts, summary as text or JSON."""

from __future__ import annotations

from dataclasses import dataclass
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.output import INTERRUPTED, Output
from delta3_pacdrive.cli.progress import Progress, announce_compilation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import Drawings, Table
    from delta3_pacdrive.studies.framework.study import OnProgress, Study


@dataclass
class Task:
    """Work of a command with progress like that of a study, but without a report."""

    work: Callable[[OnProgress], dict[str, Any]]
    on_progress: OnProgress

    def run(self) -> dict[str, Any]:
        """Work; return the summary."""
        return self.work(self.on_progress)

    def unfinished(self) -> str:
        """Return the message after an interrupt."""
        return 'interrupted: nothing was written'


def run_study(
    options: Any,
    make: Callable[[OnProgress], Study | Task],
    text: Callable[[dict[str, Any]], Iterable[str]],
    writes: Path | str | None = None,
    run: Callable[[Any], dict[str, Any]] = methodcaller('run'),
    then: Callable[[], dict[str, str]] = dict,
) -> Output:
    """Run a study and return its summary as output.

    Parameters
    ----------
    options
        Options with ``parameters`` and ``json``.
    make
        Returns the study, given its callback for progress.
    text
        Converts the summary to lines of text.
    writes
        Output folder, checked before the study starts.
    run
        Runs the study and returns the summary.
    then
        Action after the summary is printed as text; returns sentences by their keys in the JSON summary.

    """
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder

    require_writable_folder(writes)
    announce_compilation(options.parameters)
    simulation.load_kernels(core.load(options.parameters))
    study: Study | Task | None = None
    try:
        # interrupts raise, so that the study can report the state of its output
        with interrupts.raising(), Progress(quiet=options.json) as progress:
            study = make(progress.show)
            summary = run(study)
    except KeyboardInterrupt:
        message = 'interrupted: no report was written' if study is None else study.unfinished()
        return Output(status=INTERRUPTED, message=message)

    def lines() -> Iterator[str]:
        yield from text(summary)
        yield from summary.get('files', ())
        yield from then().values()

    return Output(lambda: summary | then(), lines())


def written(
    options: Any,
    title: str,
    text: Iterable[str],
    drawings: Drawings,
    tables: Iterable[Table] = (),
    of: Provenance | None = None,
) -> list[str]:
    """Write figures, tables and page to the output folder; return the file names, none without a folder.

    ``of`` is the provenance; by default only the command.
    """
    if options.output is None:
        return []
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import ReportFolder

    folder = ReportFolder(Path(options.output), of or Provenance.of(options.command_line))
    folder.figures(drawings)
    for table in tables:
        folder.table(table)
    folder.page(title, text)
    return folder.files
