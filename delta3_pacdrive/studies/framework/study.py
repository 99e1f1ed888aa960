"""Common base of all studies."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

OnProgress = Callable[[str, int, int], None]
"""Called with the name of a stage, the completed steps and the total number of steps (0: unknown)."""


def silent(_stage: str, _done: int, _total: int) -> None:
    """Report nothing."""


@dataclass
class Study:
    """Computation that turns settings into a folder of results.

    The constructor checks the settings; ``run`` computes, writes the results and returns the summary. The package of a
    study contains ``study.py`` (settings and results, data only), ``report.py`` (summary, text and tables),
    ``figures.py`` and ``run.py``.
    """

    settings: Any
    folder: Path  # destination of the results
    command: str  # as typed
    on_progress: OnProgress

    def unfinished(self) -> str:
        """Return the message after an interrupt."""
        return 'interrupted: no report was written'
