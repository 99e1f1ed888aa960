"""Settings of a sweep or an optimisation, and results of a sweep, data only."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.studies.fleet.sweep.design import Runs


@dataclass(frozen=True)
class Settings:
    """Settings of the study of a sweep or an optimisation."""

    specification: Path  # file of the sweep or optimisation
    workers: int = 0  # processes of a local cluster; 0: one per core
    scheduler: str = ''  # address of an existing cluster; empty: a local one


@dataclass(frozen=True)
class Results:
    """Table of all runs, and how it was made."""

    runs: Runs
    seconds: float  # duration of the new runs; nan without any
    made: int  # number of new runs
    workers: int  # number of worker processes
