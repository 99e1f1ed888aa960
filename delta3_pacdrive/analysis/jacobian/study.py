"""What a Jacobian study depends on, and what it finds."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from delta3_pacdrive.analysis.jacobian.causes import Cause, Course
from delta3_pacdrive.analysis.jacobian.condition import Sweep
from delta3_pacdrive.analysis.jacobian.mapping import JointMotion, Pose
from delta3_pacdrive.analysis.jacobian.motion import Motion, Signals
from delta3_pacdrive.analysis.jacobian.sensitivity import Sensitivity
from delta3_pacdrive.numerics.types import Floats

# the one length whose error, by itself, comes closest to the thesis' 10 %, 5 %, 10 % of the peak velocities
ERRORS_M = {'R_A': 0.035}


@dataclass(frozen=True)
class Settings:
    """The settings are what a study depends on, apart from the contents of its files.

    Attributes
    ----------
    inputs
        Numbers of experiments, programs, recordings.
    parameters
        Parameter file; None: the packaged one. Its lengths are the exact ones.
    errors
        Of the inexact lengths [m], by symbol.
    pose
        Where the Jacobian takes angles and position from.
    signals
        Which signals are compared.

    """

    inputs: tuple[str, ...]
    parameters: str | None
    errors: Mapping[str, float]
    pose: Pose = Pose.RECORDED
    signals: Signals = Signals.COMMAND


@dataclass(frozen=True)
class Trial:
    """A trial is one trajectory with everything that is computed of it.

    Attributes
    ----------
    exact, inexact
        Joint motion through the Jacobian.
    condition
        Of J, shape (n,).
    worst
        Deviation [%] in the worst direction of motion with each length 1 mm off, independently; shape (n,).
    tolerance
        Largest deviations [%] with every length 1 mm off.

    """

    motion: Motion
    exact: JointMotion
    inexact: JointMotion
    condition: Floats
    worst: Floats
    sensitivities: list[Sensitivity]
    tolerance: dict[str, dict[str, float]]
    causes: list[Cause]
    courses: list[Course] = field(default_factory=list)


@dataclass(frozen=True)
class Results:
    """The results are those of each trajectory, and of poses from the middle of the workspace to its singularities."""

    trials: list[Trial]
    sweep: Sweep
