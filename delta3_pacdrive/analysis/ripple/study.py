"""What a study of the ripple depends on, and what it finds."""

from dataclasses import dataclass

from delta3_pacdrive.analysis.ripple.cases import Case


@dataclass(frozen=True)
class Settings:
    """The settings are what the study depends on, apart from the contents of its files.

    Attributes
    ----------
    program
        Program file, or the name of a packaged one.
    parameters
        Parameter file; None: the packaged one.
    cycle_times_s
        Of the bus.
    interpolations
        Fine interpolations of the drives.
    axis
        Number of the motor that the figures show, 1 to 3.
    at_s
        Time from the start of the program whose bus cycle is shown; None: that of the largest current.

    """

    program: str
    parameters: str | None
    cycle_times_s: tuple[float, ...]
    interpolations: tuple[str, ...]
    axis: int
    at_s: float | None = None


@dataclass(frozen=True)
class Results:
    """The results are the cases, and which bus cycle of each is shown from where [s]."""

    program: str
    axis: int
    cases: tuple[Case, ...]
    shown_s: float
