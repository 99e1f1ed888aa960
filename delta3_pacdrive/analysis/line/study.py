"""What the study of a line depends on, and what it finds: data only."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.analysis.line.design import Line, Rule
from delta3_pacdrive.analysis.line.shift import BeltShift


@dataclass(frozen=True)
class Settings:
    """The settings of the study of a line.

    Attributes
    ----------
    specification
        Its file.
    rule, seed, hours
        Instead of those of the file; None: those.
    plans
        Real plans that the tables of cycles are checked against.

    """

    specification: Path
    rule: Rule | None = None
    seed: int | None = None
    hours: float | None = None
    plans: int = 100


@dataclass(frozen=True)
class Check:
    """How far tables of cycles are from real plans.

    Attributes
    ----------
    plans
        That were made.
    error_max_s
        The greatest difference [s]; 0 without plans.

    """

    plans: int
    error_max_s: float


@dataclass(frozen=True)
class Results:
    """A shift of a line.

    Attributes
    ----------
    line
        As it was simulated.
    belts
        What has become of the parts of each belt.
    check
        Of the tables.
    seconds
        That the shift took, without tables.

    """

    line: Line
    belts: tuple[BeltShift, ...]
    check: Check
    seconds: float
