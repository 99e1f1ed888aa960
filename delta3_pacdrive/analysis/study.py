"""What all studies have in common."""

from collections.abc import Callable
from typing import Any, Protocol

OnProgress = Callable[[str, int, int], None]
"""Is called with a stage in words, what is done, and all of it (0: not known)."""


def silent(_stage: str, _done: int, _total: int) -> None:
    """Tell nothing."""


class Study(Protocol):
    """A study computes something from its settings and leaves the results in a folder.

    It is made of settings, folder, command and ``OnProgress``, and checks then whatever needs no computing. Its
    package has ``study.py`` (settings and results, data only), ``report.py`` (summary, text and tables of the results),
    ``figures.py`` and ``run.py``, where the study is.
    """

    def run(self) -> dict[str, Any]:
        """Compute everything, write it into the folder, and return the summary; raises Delta3Error."""
