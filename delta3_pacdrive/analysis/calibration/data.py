"""What a calibration is made of: poses, measurements, and what is said about them; data only."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats


class Method(StrEnum):
    """How the place of the TCP is measured."""

    BASE = 'base'  # points of an instrument, in the frame base
    FRAME = 'frame'  # points of an instrument, in a frame of its own
    PLANE = 'plane'  # touches of planes of which nobody knows where they are
    BALL = 'ball'  # touches of balls of known size of which nobody knows where they are
    LEVEL = 'level'  # touches of a level plane whose height is known: for the zero angles alone


@dataclass(frozen=True)
class Wanted:
    """A calibration is to be made of these measurements.

    Attributes
    ----------
    method
        How the TCP is measured.
    number, checks
        Poses to be planned: to be estimated from, and to be checked with.
    noise_m
        Standard deviation of what is measured: of each coordinate of a point, of the distance of a touch [m].
    height_m
        Of a level plane [m], z in the frame base.
    diameter_m
        Of the balls.
    arm
        The only one whose zero angle may be wrong; None: all three.

    """

    method: Method
    number: int
    checks: int
    noise_m: float
    height_m: float | None = None
    diameter_m: float = 0.2
    arm: int | None = None


@dataclass(frozen=True)
class Poses:
    """Poses are to be measured.

    Attributes
    ----------
    points_m
        Of the TCP, as the controller sees it, shape (n, 3).
    checks
        Which of them are not for the estimation, but to check it, shape (n,).
    objects, diameters_m
        What is touched there, empty without touches; its diameter, nan for a plane.
    directions
        From the object to the probe that touches it, shape (n, 3).
    reach_m
        How far what is touched may be from where it is planned [m].
    expected_m
        Rms over the workspace that the noise lets the calibrated TCP be off [m], and the same without a calibration.

    """

    points_m: Floats
    checks: NDArray[np.bool_]
    objects: tuple[str, ...]
    diameters_m: Floats
    directions: Floats
    reach_m: float
    expected_m: tuple[float, float]


@dataclass(frozen=True)
class Measurements:
    """Measurements tell what arm angles were there when the TCP was somewhere.

    Attributes
    ----------
    angles_rad
        Of the arms as the controller told them, shape (n, 3).
    points_m
        Of the instrument, shape (n, 3); nan for touches.
    checks
        Which of them are not for the estimation, shape (n,).
    objects, diameters_m
        What was touched, empty for points; its diameter, nan for a plane.
    checksum
        Of the parameters with which the poses were planned; empty if nobody has told it.

    """

    angles_rad: Floats
    points_m: Floats
    checks: NDArray[np.bool_]
    objects: tuple[str, ...]
    diameters_m: Floats
    checksum: str = ''


@dataclass(frozen=True)
class Told:
    """What measurements tell about one figure of an arm; SI.

    Attributes
    ----------
    symbol, arm, unit
        Which one: the symbol of the thesis, arm 1 to 3, and m or rad.
    before, value
        Correction that the controller had, and the one that was found.
    half_width
        Of its 95 % interval.
    hidden
        Share of its variance before that is left: 0 if the measurements tell it, 1 if they do not.

    """

    symbol: str
    arm: int
    unit: str
    before: float
    value: float
    half_width: float
    hidden: float

    @property
    def is_told(self) -> bool:
        """Whether the measurements tell it alone, not only together with others."""
        return self.hidden < 0.1


@dataclass(frozen=True)
class Left:
    """What is left between measurement and robot [m]: rms and largest, before and after a calibration."""

    what: str
    count: int
    before_rms_m: float
    before_max_m: float
    after_rms_m: float
    after_max_m: float
