"""A calibration: settings and results, data only."""

from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.analysis.calibration.data import Left, Measurements, Told, Wanted
from delta3_pacdrive.numerics.types import Floats


@dataclass(frozen=True)
class Settings:
    """A calibration depends on these.

    Attributes
    ----------
    parameters
        File of the controller's parameters; None: those of the simulated robot, else the packaged ones.
    simulate
        Parameter file of the robot that is measured in simulation; None: nothing is simulated.
    wanted
        What is measured.
    seed
        Of the noise, and of where things are in a simulation.
    columns
        Column file of a table of somebody else's.

    """

    parameters: str | None
    simulate: str | None
    wanted: Wanted
    seed: int
    columns: str | None = None


@dataclass(frozen=True)
class Found:
    """A calibration has found this.

    Attributes
    ----------
    told
        About each free figure.
    combinations
        What cannot be told apart: directions in words.
    directions, freedom
        How many independent combinations of the figures were estimated; degrees of freedom that are left.
    left
        On the measurements that were used, on those that were not, and what else was compared.
    scatter
        Rms of what is left over what was to be expected: 1 if everything is as it was told.
    expected_m
        Rms over the workspace that the calibrated TCP is off by what is not known exactly [m].
    limits
        What limits each step, in words and in m.
    measurements
        What was measured.
    points_m
        Where the TCP was, as the calibrated controller sees it, shape (n, 3).
    residuals_m
        Before and after, each of shape (n,), for each measurement.
    corrections
        Of all figures, by the name of their parameter.
    truth
        Of a simulated robot: what the figures in ``told`` are.

    """

    told: tuple[Told, ...]
    combinations: tuple[str, ...]
    directions: int
    freedom: int
    left: tuple[Left, ...]
    scatter: float
    expected_m: float
    limits: tuple[tuple[str, float], ...]
    measurements: Measurements
    points_m: Floats
    residuals_m: tuple[Floats, Floats]
    corrections: dict[str, Any]
    truth: tuple[float, ...] | None = None
