"""Settings, data and results of a calibration: requirements, poses, measurements, estimates."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats


class Method(StrEnum):
    """Method of measuring the position of the TCP."""

    BASE = 'base'  # points measured in the frame base
    FRAME = 'frame'  # points measured in the frame of the instrument
    PLANE = 'plane'  # touches of planes at unknown positions
    BALL = 'ball'  # touches of balls of known size at unknown positions
    LEVEL = 'level'  # touches of a level plane of known height: zero angles only


@dataclass(frozen=True)
class Requirements:
    """Measurements required for a calibration."""

    method: Method
    number: int  # poses used for the estimation
    checks: int  # poses used for the validation
    noise_m: float  # standard deviation of each coordinate of a point, or of the distance of a touch
    height_m: float | None = None  # z of a level plane in the frame base
    diameter_m: float = 0.2  # of the balls
    arm: int | None = None  # the only arm whose zero angle may be wrong; None: all three


@dataclass(frozen=True)
class Poses:
    """Poses to be measured."""

    points_m: Floats  # TCP in the controller's model, shape (n, 3)
    checks: NDArray[np.bool_]  # whether a pose is for validation only, shape (n,)
    objects: tuple[str, ...]  # touched objects; empty for points
    diameters_m: Floats  # of the objects; nan for a plane
    directions: Floats  # from the object to the probe, shape (n, 3)
    reach_m: float  # largest distance of an object from its planned position
    # expected rms error of the TCP over the workspace: calibrated, uncalibrated
    expected_m: tuple[float, float]


@dataclass(frozen=True)
class Measurements:
    """Arm angles, and the points or objects measured at them."""

    angles_rad: Floats  # arm angles reported by the controller, shape (n, 3)
    points_m: Floats  # measured points, shape (n, 3); nan for touches
    checks: NDArray[np.bool_]  # whether a measurement is for validation only, shape (n,)
    objects: tuple[str, ...]  # touched objects; empty for points
    diameters_m: Floats  # of the objects; nan for a plane
    checksum: str = ''  # parameters used for planning the poses; empty if unknown


@dataclass(frozen=True)
class Estimate:
    """Estimated correction of one geometric parameter of an arm [SI]."""

    symbol: str  # symbol in the thesis
    arm: int  # 1 to 3
    unit: str  # m or rad
    before: float  # correction in the parameters of the controller
    value: float  # estimated correction
    half_width: float  # of its 95 % interval
    hidden: float  # share of the prior variance that remains: 0 if identified, 1 if not

    @property
    def is_identified(self) -> bool:
        """Whether the measurements identify the parameter separately from all others."""
        return self.hidden < 0.1


@dataclass(frozen=True)
class Residual:
    """Residuals of a group of measurements [m]: rms and largest, before and after a calibration."""

    what: str
    count: int
    before_rms_m: float
    before_max_m: float
    after_rms_m: float
    after_max_m: float


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
