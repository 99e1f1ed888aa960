"""Settings and results of a Jacobian study."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.thesis.jacobian.causes import Cause, Course
from delta3_pacdrive.studies.thesis.jacobian.condition import Sweep
from delta3_pacdrive.studies.thesis.jacobian.mapping import JointMotion, Pose
from delta3_pacdrive.studies.thesis.jacobian.motion import Motion, Signals
from delta3_pacdrive.studies.thesis.jacobian.sensitivity import Sensitivity

# the single length whose error comes closest to the 10 %, 5 %, 10 % of the peak velocities in the thesis
ERRORS_M = {'R_A': 0.035}


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
