"""What an experiment, or the comparison of any two runs, depends on, and what it finds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from delta3_pacdrive.analysis import alignment, runs
from delta3_pacdrive.analysis.alignment import Alignment
from delta3_pacdrive.analysis.experiments.attribution import Attribution
from delta3_pacdrive.analysis.experiments.claims import ArmSpeeds
from delta3_pacdrive.analysis.experiments.comparison import Comparison

SEEDS = 8  # further seeds, by default


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
    seeds
        Number of further seeds of the robot's sensor noise, over which each verdict gets its range.

    """

    number: int
    parameters: str | None = None
    robot: str = 'rich'
    seed: int | None = None
    attributed: bool = True
    seeds: int = SEEDS


@dataclass(frozen=True)
class Pair:
    """Two runs that are compared.

    Attributes
    ----------
    model, robot
        The runs.
    how
        They are aligned, as ``alignment.align`` takes it.
    attributed
        Whether to look for what explains the difference, where both are simulated.

    """

    model: runs.Run
    robot: runs.Run
    how: str = alignment.START
    attributed: bool = True


@dataclass(frozen=True)
class Results:
    """The results are the comparison, and what is known of it.

    Attributes
    ----------
    number
        Of the experiment; None: of any two runs.
    program
        Its name, or those of the runs.
    comparison
        Of model and robot.
    attribution
        What explains it; None: not looked for.
    notes
        In sentences.
    alignment
        How any two runs were brought to one time.
    elsewhere
        Arm speeds of the same two in other experiments, by their numbers.
    seeded
        Comparison and ``elsewhere`` of the same two with other seeds of the robot.

    """

    number: int | None
    program: str
    comparison: Comparison
    attribution: Attribution | None
    notes: list[str]
    alignment: Alignment | None = None
    elsewhere: Mapping[int, ArmSpeeds] = field(default_factory=dict)
    seeded: Sequence[tuple[Comparison, Mapping[int, ArmSpeeds]]] = ()

    @property
    def title(self) -> str:
        """Return what stands above figures."""
        return self.program if self.number is None else f'Experiment {self.number}'
