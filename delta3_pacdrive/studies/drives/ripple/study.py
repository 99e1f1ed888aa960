"""Settings and results of a ripple study, data only."""

from dataclasses import dataclass

from delta3_pacdrive.studies.drives.ripple.cases import Case


@dataclass(frozen=True)
class Settings:
    """Settings of a ripple study."""

    program: str  # file, or name of a packaged program
    parameters: str | None  # file; None: the packaged one
    cycle_times_s: tuple[float, ...]  # of the bus
    interpolations: tuple[str, ...]  # fine interpolations of the drives
    axis: int  # motor shown in the figures, 1 to 3
    at_s: float | None = None  # time whose bus cycle is shown; None: that of the largest current


@dataclass(frozen=True)
class Results:
    """All cases, and the start of the displayed bus cycle [s]."""

    program: str
    axis: int
    cases: tuple[Case, ...]
    shown_s: float
