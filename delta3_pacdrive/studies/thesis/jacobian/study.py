"""Settings and results of a Jacobian study."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.thesis.jacobian.condition import Sweep
from delta3_pacdrive.studies.thesis.jacobian.mapping import (
    JointMotion,
    Pose,
)
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion, Signals
from delta3_pacdrive.studies.thesis.jacobian.sensitivity import Sensitivity

# the single length whose error comes closest to the 10 %, 5 %, 10 % of the peak velocities in the thesis
ERRORS_M = {'R_A': 0.035}
LATE = 'one bus cycle between TCP and joints'
WITHOUT_JACOBIAN_DOT = 'Jdot left out of (4.16)'
PRINTED_JACOBIAN_DOT = '(4.15) as printed, + Sdot J'


@dataclass(frozen=True)
class Cause:
    """Largest deviations [%] that a cause makes on its own."""

    name: str
    quantity: str
    of_peak: float
    momentary: float


@dataclass(frozen=True)
class Course:
    """Deviation [% of the peak] over time by a single cause, shape (n, 3); nan without a previous sample."""

    name: str
    quantity: str
    of_peak: Floats


@dataclass(frozen=True)
class Settings:
    """Settings of a Jacobian study, except for the contents of its files."""

    inputs: tuple[str, ...]  # numbers of experiments, programs, recordings
    parameters: str | None  # file with the exact lengths; None: packaged parameters
    errors: Mapping[str, float]  # of the inexact lengths [m], by symbol
    pose: Pose = Pose.RECORDED
    signals: Signals = Signals.COMMAND


@dataclass(frozen=True)
class Trial:
    """One trajectory with its results."""

    motion: Motion
    exact: JointMotion
    inexact: JointMotion
    condition: Floats  # of J, shape (n,)
    worst: Floats  # deviation [%] in the worst direction of motion, each length 1 mm off, shape (n,)
    sensitivities: list[Sensitivity]
    tolerance: dict[str, dict[str, float]]  # largest deviations [%] with every length 1 mm off
    causes: list[Cause]
    courses: list[Course] = field(default_factory=list)


@dataclass(frozen=True)
class Results:
    """Results of each trajectory, and of poses from the middle of the workspace to its singularities."""

    trials: list[Trial]
    sweep: Sweep
