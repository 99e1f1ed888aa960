"""What all studies have in common."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

OnProgress = Callable[[str, int, int], None]
"""Is called with a stage in words, what is done, and all of it (0: not known)."""


def silent(_stage: str, _done: int, _total: int) -> None:
    """Tell nothing."""


@dataclass
class Study:
    """A study computes something from its settings and leaves the results in a folder.

    When it is made it checks whatever needs no computing; ``run`` computes, writes and returns the summary. Its package
    has ``study.py`` (settings and results, data only), ``report.py`` (summary, text and tables of the results),
    ``figures.py`` and ``run.py``, where the study is.

    Attributes
    ----------
    settings
        What it depends on.
    folder
        Where the results go.
    command
        As it was typed.
    on_progress
        Is told how far it is.

    """

    settings: Any
    folder: Path
    command: str
    on_progress: OnProgress
