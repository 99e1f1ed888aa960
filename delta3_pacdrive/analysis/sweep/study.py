"""What the study of a sweep or an optimisation depends on, and what that of a sweep finds: data only."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.analysis.sweep.design import Runs


@dataclass(frozen=True)
class Settings:
    """The settings of the study of a sweep or an optimisation.

    Attributes
    ----------
    specification
        Its file.
    workers
        Processes of an own cluster; 0: one for each core.
    scheduler
        Address of a cluster that is up; empty: an own one.

    """

    specification: Path
    workers: int = 0
    scheduler: str = ''


@dataclass(frozen=True)
class Results:
    """The results are the table of all runs, and how it was made.

    Attributes
    ----------
    runs
        All of them.
    seconds
        That the runs took which were made now; nan if there were none.
    made
        Runs that were made now; the others were there.
    workers
        That made them.

    """

    runs: Runs
    seconds: float
    made: int
    workers: int
