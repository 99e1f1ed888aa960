"""Definition, settings and results of a sweep; the settings are those of an optimisation as well."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats

PROGRAM = 'program.'  # prefix of paths to values of the program
FUNCTION = 'figures'  # function in a Python file that returns more results


class Law(StrEnum):
    """Distribution of a quantity."""

    LIST = 'list'  # choices
    UNIFORM = 'uniform'  # lower and upper bound
    NORMAL = 'normal'  # mean and standard deviation
    RUN = 'run'  # number of the run, from 1; used as a seed


class Sampling(StrEnum):
    """Sampling method."""

    RANDOM = 'random'
    LATIN_HYPERCUBE = 'latin_hypercube'
    SOBOL = 'sobol'  # scrambled Sobol sequence
    SALTELLI = 'saltelli'  # design for Sobol indices
    GRID = 'grid'  # all combinations of lists


class Reduction(StrEnum):
    """Reduction of a signal to a number."""

    MAX = 'max'  # of the absolute values, or of the norm
    RMS = 'rms'
    MEAN = 'mean'
    MIN = 'min'
    FINAL = 'final'


class Outcome(StrEnum):
    """Outcome of a run."""

    DONE = 'done'
    STOPPED = 'stopped'  # the robot was stopped by a fault
    REFUSED = 'refused'  # parameters or program were rejected, or a drive tripped


@dataclass(frozen=True)
class Variation:
    """Varied quantity."""

    # parameter (dynamics.payload_mass_kg) or value of the program (program.moves[0].move_l.speed_m_s)
    key: str
    law: Law
    # of the list; lower and upper bound; mean and standard deviation; empty for RUN
    values: tuple[Any, ...] = ()

    @property
    def is_number(self) -> bool:
        """Whether its values are numbers, so that effects can be computed."""
        return self.law is not Law.LIST or all(
            isinstance(value, (int, float)) and not isinstance(value, bool) for value in self.values
        )


@dataclass(frozen=True)
class Kept:
    """Result of each run."""

    name: str  # of the column
    signal: str = ''  # reduced signal; empty: figure of the run with this name
    less: str = ''  # signal to be subtracted; empty: none
    reduction: Reduction = Reduction.MAX
    axis: int = 0  # column of the signal, 1 to 3; 0: all columns, or the norm for x, y, z
    from_s: float = 0.0  # start of the evaluated part of the program
    to_s: float = float('inf')  # end of that part


@dataclass(frozen=True)
class Sweep:
    """Sweep as defined in its file."""

    name: str
    program: Mapping[str, Any]  # document of the program
    program_name: str
    parameters: Mapping[str, Any]  # in the format of flat_document
    runs: int
    sampling: Sampling
    seed: int
    vary: tuple[Variation, ...]
    keep: tuple[Kept, ...]
    limits: Mapping[str, float] = field(default_factory=dict)  # upper limits of results by name
    function: str = ''  # source of a Python file with a function figures(trace); empty: none
    digest: str = ''  # of everything on which the results depend


@dataclass(frozen=True)
class Runs:
    """All runs of a sweep, sorted by number."""

    sweep: Sweep
    values: Mapping[str, NDArray[Any]]  # of each varied quantity by key, shape (runs,)
    kept: Mapping[str, Floats]  # results by name, shape (runs,); nan where a run has none
    outcomes: Sequence[str]
    reasons: Sequence[str]

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whether a run was completed, shape (runs,)."""
        return np.array([outcome == Outcome.DONE for outcome in self.outcomes])


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
