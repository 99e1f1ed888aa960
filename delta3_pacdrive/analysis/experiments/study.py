"""What an experiment depends on, and what it finds."""

from dataclasses import dataclass

from delta3_pacdrive.analysis.experiments.attribution import Attribution
from delta3_pacdrive.analysis.experiments.comparison import Comparison


@dataclass(frozen=True)
class Settings:
    """The settings are what an experiment depends on, apart from the contents of its files.

    Attributes
    ----------
    number
        1 to 3, of the thesis.
    parameters
        Parameter file of the model; None: the packaged one.
    robot
        Parameter file of the robot.
    seed
        Of the robot's sensor noise; None: the one in its file.
    attributed
        Whether to look for what explains the difference.

    """

    number: int
    parameters: str | None = None
    robot: str = 'rich'
    seed: int | None = None
    attributed: bool = True


@dataclass(frozen=True)
class Results:
    """The results are the comparison, what explains it (None: not looked for), and notes in sentences."""

    number: int
    program: str
    comparison: Comparison
    attribution: Attribution | None
    notes: list[str]
