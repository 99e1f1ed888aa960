"""What the commands of studies share: progress, what an interruption leaves, the summary as text or as JSON."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.output import INTERRUPTED
from delta3_pacdrive.cli.progress import Progress, announce_compilation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from delta3_pacdrive.analysis.study import OnProgress


def run_study(
    options: Any,
    work: Callable[[OnProgress], dict[str, Any]],
    text: Callable[[dict[str, Any]], Iterable[str]],
    unfinished: Callable[[], str] = lambda: 'interrupted: no report was written',
    writes: Path | str | None = None,
    then: Callable[[], dict[str, str]] = dict,
) -> int:
    """Do what a study does, print its summary and return the exit status.

    Parameters
    ----------
    options
        Of the command: ``parameters`` and ``json``.
    work
        Computes, and returns the summary.
    text
        Turns the summary into lines for people.
    unfinished
        Says what an interruption leaves.
    writes
        Folder that it writes into, which is refused at once if that cannot be.
    then
        Is done with what the study has left; returns sentences about it, by the names that they have in the summary.

    """
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis.report_folder import require_writable_folder

    require_writable_folder(writes)
    announce_compilation(options.parameters)
    simulation.load_kernels(core.load(options.parameters))
    try:
        # an interruption is an exception meanwhile, so that the study can say what it leaves behind
        with interrupts.raising(), Progress(quiet=options.json) as progress:
            summary = work(progress.show)
    except KeyboardInterrupt:
        print(unfinished(), file=sys.stderr)
        return INTERRUPTED
    if not options.json:
        print('\n'.join([*text(summary), *summary.get('files', ())]))
    told = then()
    if options.json:
        print(json.dumps(summary | told))
    else:
        for sentence in told.values():
            print(sentence)
    return 0
