"""Settings and results of the study of a line."""

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.studies.fleet.line.design import Line, Rule
from delta3_pacdrive.studies.fleet.line.shift import BeltShift


@dataclass(frozen=True)
class Settings:
    """Settings of the study of a line."""

    specification: Path
    # override the values of the file
    rule: Rule | None = None
    seed: int | None = None
    hours: float | None = None
    plans: int = 100  # number of plans that the tables of cycles are checked against


@dataclass(frozen=True)
class Check:
    """Deviation of tabulated cycle times from plans."""

    plans: int
    error_max_s: float  # 0 without plans


@dataclass(frozen=True)
class Results:
    """Results of a shift of a line."""

    line: Line  # as simulated
    belts: tuple[BeltShift, ...]
    check: Check  # of the tables
    seconds: float  # computing time of the shift, without tables
