"""Maps of the workspace: what is asked, and what is found; data only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats


@dataclass(frozen=True)
class Quantity:
    """A quantity that is mapped.

    Attributes
    ----------
    key
        Its name in files and results.
    what, unit
        In words, and its unit, empty if it has none.
    scale, shown_unit
        Factor and unit for people.
    worst_is_large
        Whether a large value is worse than a small one.

    """

    key: str
    what: str
    unit: str
    scale: float
    shown_unit: str
    worst_is_large: bool


@dataclass(frozen=True)
class Slice:
    """A plane through the workspace.

    Attributes
    ----------
    axis
        Number of the coordinate that is the same everywhere: 0 to 2 for x, y, z.
    place_m
        Its value.

    """

    axis: int
    place_m: float

    @property
    def name(self) -> str:
        """The plane as people write it."""
        return f'{"xyz"[self.axis]} = {1e3 * self.place_m:g} mm'


@dataclass(frozen=True)
class Settings:
    """Settings of a study of the workspace.

    Attributes
    ----------
    resolution_m
        Distance of neighbours in the volume.
    slices
        That are drawn.
    acceleration_m_s2
        That ``motion.capability`` assumes; None: that of the parameters.

    """

    resolution_m: float
    slices: tuple[Slice, ...]
    acceleration_m_s2: float | None = None


@dataclass(frozen=True)
class Grid:
    """Values over a grid of positions.

    Attributes
    ----------
    x_m, y_m, z_m
        Coordinates of the grid, shapes (nx,), (ny,), (nz,).
    values
        Of each quantity by its key, shape (nx, ny, nz), nan where the arms cannot be.
    limit
        Code of ``motion.capability.Capability``: 0 where the robot may be, same shape.

    """

    x_m: Floats
    y_m: Floats
    z_m: Floats
    values: dict[str, Floats]
    limit: NDArray[np.uint8]


@dataclass(frozen=True)
class Extreme:
    """Least and largest value of a quantity where the robot may be, with their places [m], and its median."""

    least: float
    least_at_m: tuple[float, float, float]
    median: float
    largest: float
    largest_at_m: tuple[float, float, float]


@dataclass(frozen=True)
class Results:
    """Maps of a workspace.

    Attributes
    ----------
    volume
        Grid of the box around the workspace.
    slices
        Grids of the planes, in the order of the settings, a little beyond the workspace.
    extremes
        By the keys of the quantities, over the volume.
    poses, seconds
        How many poses the volume has, and how long they took.

    """

    volume: Grid
    slices: tuple[Grid, ...]
    extremes: dict[str, Extreme]
    poses: int
    seconds: float
