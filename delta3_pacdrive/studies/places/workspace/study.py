"""Data of workspace maps: settings and results."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats


@dataclass(frozen=True)
class Quantity:
    """Mapped quantity; its attribute of ``Capability``, and its key in JSON, is the key with the unit."""

    key: str  # name in files and results
    title: str  # name in text
    unit: str = ''  # empty if dimensionless
    shown_unit: str = ''  # in text and figures
    worst_is_large: bool = False  # large values are worse than small ones


@dataclass(frozen=True)
class Slice:
    """Plane through the workspace, perpendicular to a coordinate axis."""

    axis: int  # constant coordinate, 0 to 2 for x, y, z
    position_m: float  # its value

    @property
    def name(self) -> str:
        """The plane as an equation in mm."""
        return f'{"xyz"[self.axis]} = {1e3 * self.position_m:g} mm'


@dataclass(frozen=True)
class Settings:
    """Settings of a workspace study."""

    resolution_m: float  # grid spacing of the volume
    slices: tuple[Slice, ...]  # planes that are drawn
    acceleration_m_s2: float | None = None  # of payloads and forces; None: from the parameters
    forces: bool = False  # in rods and ball joints


@dataclass(frozen=True)
class Grid:
    """Values over a grid of positions."""

    x_m: Floats  # shape (nx,)
    y_m: Floats  # shape (ny,)
    z_m: Floats  # shape (nz,)
    values: dict[str, Floats]  # by key of the quantity, shape (nx, ny, nz); nan beyond the limits of the arms
    limit: NDArray[np.uint8]  # code as in motion.capability.Capability, 0 if all limits are kept; same shape


@dataclass(frozen=True)
class Extreme:
    """Least and largest value of a quantity in the workspace, their positions [m], and the median."""

    least: float
    least_at_m: tuple[float, float, float]
    median: float
    largest: float
    largest_at_m: tuple[float, float, float]


@dataclass(frozen=True)
class Results:
    """Maps of a workspace."""

    volume: Grid  # box around the workspace
    slices: tuple[Grid, ...]  # in the order of the settings, extending beyond the workspace
    extremes: dict[str, Extreme]  # over the volume, by key of the quantity
    poses: int  # of the volume
    seconds: float  # for the volume
