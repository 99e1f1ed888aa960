"""Settings and results of an experiment or of a comparison of two runs, data only."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from delta3_pacdrive.studies.runs import alignment, runs
from delta3_pacdrive.studies.runs.alignment import Alignment
from delta3_pacdrive.studies.thesis.experiments.attribution import Attribution
from delta3_pacdrive.studies.thesis.experiments.claims import ArmSpeeds
from delta3_pacdrive.studies.thesis.experiments.comparison import Comparison

SEEDS = 8  # further seeds, by default


@dataclass(frozen=True)
class Settings:
    """Settings of an experiment."""

    number: int  # 1 to 3
    parameters: str | None = None  # file of the model; None: the packaged one
    robot: str = 'rich'  # parameter file
    seed: int | None = None  # of the robot's sensor noise; None: from its file
    attributed: bool = True  # whether to attribute the difference to effects
    seeds: int = SEEDS  # number of further seeds for the range of each verdict


@dataclass(frozen=True)
class Pair:
    """Two runs to be compared."""

    model: runs.Run
    robot: runs.Run
    how: str = alignment.START  # alignment method, as for alignment.align
    attributed: bool = True  # whether to attribute the difference if both are simulated


@dataclass(frozen=True)
class Results:
    """Comparison of model and robot with its attribution."""

    number: int | None  # of the experiment; None for any two runs
    program: str  # its name, or those of the runs
    comparison: Comparison
    attribution: Attribution | None  # None: not determined
    notes: list[str]  # sentences
    alignment: Alignment | None = None  # of any two runs
    # arm speeds in other experiments, by number
    elsewhere: Mapping[int, ArmSpeeds] = field(default_factory=dict)
    # comparison and 'elsewhere' for other seeds of the robot
    seeded: Sequence[tuple[Comparison, Mapping[int, ArmSpeeds]]] = ()

    @property
    def title(self) -> str:
        """Return the title of figures."""
        return self.program if self.number is None else f'Experiment {self.number}'
