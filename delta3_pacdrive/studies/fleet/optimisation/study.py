"""Results of an optimisation, data only; its settings are those of a sweep."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.studies.fleet.optimisation.design import Trials


@dataclass(frozen=True)
class Results:
    """All trials, and how they were made."""

    trials: Trials
    seconds: float  # duration of the new runs; nan without any
    made: int  # number of new runs
    workers: int  # number of worker processes
    files: tuple[Path, ...]  # parameters and program of the best trial; empty without one
