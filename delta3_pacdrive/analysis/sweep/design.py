"""What a sweep is: what varies, what is kept, and the table of its runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats

PROGRAM = 'program.'  # before the path of a value of the program
FUNCTION = 'figures'  # of a Python file: its numbers are kept as well


class Law(StrEnum):
    """How a quantity varies."""

    LIST = 'list'  # one of these values
    UNIFORM = 'uniform'  # between two numbers
    NORMAL = 'normal'  # mean and standard deviation
    RUN = 'run'  # the number of the run, from 1 on: a seed of its own


class Sampling(StrEnum):
    """How values are drawn."""

    RANDOM = 'random'
    LATIN_HYPERCUBE = 'latin_hypercube'
    SOBOL = 'sobol'  # a scrambled Sobol sequence
    SALTELLI = 'saltelli'  # the design that Sobol indices need
    GRID = 'grid'  # every combination of lists


class Reduction(StrEnum):
    """What is kept of a signal."""

    MAX = 'max'  # of the absolute values, or of the norm
    RMS = 'rms'
    MEAN = 'mean'
    MIN = 'min'
    FINAL = 'final'


class Outcome(StrEnum):
    """What has become of a run."""

    DONE = 'done'
    STOPPED = 'stopped'  # a fault has stopped the robot
    REFUSED = 'refused'  # parameters or program break a rule, or a drive has tripped


@dataclass(frozen=True)
class Variation:
    """A quantity that varies.

    Attributes
    ----------
    key
        A parameter such as ``dynamics.payload_mass_kg``, or a value of the program such as
        ``program.moves[0].move_l.speed_m_s``.
    law
        How it varies.
    values
        Of the list; least and greatest; mean and standard deviation; nothing for ``RUN``.

    """

    key: str
    law: Law
    values: tuple[Any, ...] = ()

    @property
    def is_number(self) -> bool:
        """Whether its values are numbers, so that effects of it can be computed."""
        return self.law is not Law.LIST or all(
            isinstance(value, (int, float)) and not isinstance(value, bool) for value in self.values
        )


@dataclass(frozen=True)
class Kept:
    """A number that is kept of each run.

    Attributes
    ----------
    name
        Of the column.
    signal
        Whose reduction it is; empty: a figure of the run of that name.
    less
        A signal that is taken off it; empty: none.
    reduction
        What is kept of the signal.
    axis
        Column of the signal, 1 to 3; 0: all, or the norm of those that are told in x, y, z.
    from_s, to_s
        Part of the program that counts [s].

    """

    name: str
    signal: str = ''
    less: str = ''
    reduction: Reduction = Reduction.MAX
    axis: int = 0
    from_s: float = 0.0
    to_s: float = float('inf')


@dataclass(frozen=True)
class Sweep:
    """A sweep, as its file has it.

    Attributes
    ----------
    name
        Of it.
    program, program_name
        What is driven: the document of the program, and its name.
    parameters
        Of the robot, by their dotted names, as ``flat_document`` has them.
    runs, sampling, seed
        How many, how they are drawn, and from which seed.
    vary, keep
        What varies and what is kept.
    limits
        Largest values of kept numbers that are allowed, by their names.
    function
        Source text of a Python file whose function ``figures(trace)`` returns more numbers; empty: there is none.
    digest
        Of all that the numbers of the runs depend on.

    """

    name: str
    program: Mapping[str, Any]
    program_name: str
    parameters: Mapping[str, Any]
    runs: int
    sampling: Sampling
    seed: int
    vary: tuple[Variation, ...]
    keep: tuple[Kept, ...]
    limits: Mapping[str, float] = field(default_factory=dict)
    function: str = ''
    digest: str = ''


@dataclass(frozen=True)
class Runs:
    """All runs of a sweep, sorted by their numbers.

    Attributes
    ----------
    sweep
        What was asked for.
    values
        Of each variation, by its key, shape (runs,).
    kept
        Numbers of each run, by their names, shape (runs,); nan where a run has none.
    outcomes, reasons
        What has become of each run, and why.

    """

    sweep: Sweep
    values: Mapping[str, NDArray[Any]]
    kept: Mapping[str, Floats]
    outcomes: Sequence[str]
    reasons: Sequence[str]

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which runs have come to their end, shape (runs,)."""
        return np.array([outcome == Outcome.DONE for outcome in self.outcomes])
