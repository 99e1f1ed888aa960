"""Execution of studies: progress display, interrupts, summary as text or JSON."""

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

    from delta3_pacdrive.studies.framework.study import OnProgress


def run_study(
    options: Any,
    work: Callable[[OnProgress], dict[str, Any]],
    text: Callable[[dict[str, Any]], Iterable[str]],
    unfinished: Callable[[], str] = lambda: 'interrupted: no report was written',
    writes: Path | str | None = None,
    then: Callable[[], dict[str, str]] = dict,
) -> int:
    """Run a study, print its summary and return the exit status.

    Parameters
    ----------
    options
        Options with ``parameters`` and ``json``.
    work
        Runs the study and returns the summary.
    text
        Converts the summary to lines of text.
    unfinished
        Returns the message after an interrupt.
    writes
        Output folder, checked before the study starts.
    then
        Follow-up action; returns sentences by their keys in the summary.

    """
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder

    require_writable_folder(writes)
    announce_compilation(options.parameters)
    simulation.load_kernels(core.load(options.parameters))
    try:
        # interrupts raise, so that the study can report the state of its output
        with interrupts.raising(), Progress(quiet=options.json) as progress:
            summary = work(progress.show)
    except KeyboardInterrupt:
        print(unfinished(), file=sys.stderr)
        return INTERRUPTED
    if not options.json:
        print('\n'.join([*text(summary), *summary.get('files', ())]))
    followed = then()
    if options.json:
        print(json.dumps(summary | followed))
    else:
        for sentence in followed.values():
            print(sentence)
    return 0
