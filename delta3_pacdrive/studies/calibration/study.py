"""Settings and results of a calibration, data only."""

from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.calibration.data import Estimate, Measurements, Requirements, Residual


@dataclass(frozen=True)
class Settings:
    """Settings of a calibration."""

    parameters: str | None  # file of the controller; None: simulated robot, else packaged
    simulate: str | None  # file of the robot to be simulated; None: no simulation
    requirements: Requirements
    seed: int  # of the noise and of the poses of objects in a simulation
    columns: str | None = None  # column file for a third-party table


@dataclass(frozen=True)
class Result:
    """Result of a calibration."""

    estimates: tuple[Estimate, ...]  # one per free parameter
    combinations: tuple[str, ...]  # directions that are not identifiable
    directions: int  # number of estimated independent combinations of parameters
    freedom: int  # remaining degrees of freedom
    residuals: tuple[Residual, ...]  # of the used and unused measurements, and of other comparisons
    scatter: float  # rms of the residuals relative to its expectation; 1 if noise and model are correct
    expected_m: float  # expected rms error of the calibrated TCP over the workspace
    limits: tuple[tuple[str, float], ...]  # sources of remaining error with their sizes [m]
    measurements: Measurements
    points_m: Floats  # TCP in the model of the calibrated controller, shape (n, 3)
    residuals_m: tuple[Floats, Floats]  # before and after, each of shape (n,)
    corrections: dict[str, Any]  # all geometric parameters by name
    truth: tuple[float, ...] | None = None  # true values of the estimates, for a simulated robot
