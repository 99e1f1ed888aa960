"""What the study of an optimisation finds: data only. It depends on what a sweep depends on."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.analysis.optimisation.design import Trials


@dataclass(frozen=True)
class Results:
    """The results are all trials, and how they were made.

    Attributes
    ----------
    trials
        All of them.
    seconds
        That the runs took which were made now; nan if there were none.
    made
        Runs that were made now; the others were there.
    workers
        That made them.
    files
        Parameters and program of the best trial; none without one.

    """

    trials: Trials
    seconds: float
    made: int
    workers: int
    files: tuple[Path, ...]
