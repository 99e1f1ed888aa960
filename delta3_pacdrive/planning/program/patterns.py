"""Patterns of positions in a frame: grids, and layers of grids."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.program.frames import BASE, Frame
from delta3_pacdrive.planning.program.model import Point, point_of

PLACES_MAX = 1_000_000
PITCH_MAX_M = 10.0  # for pitch, shift and height


class Order(StrEnum):
    """Visiting order of a grid."""

    ROWS = 'rows'  # each row from its first position
    SNAKE = 'snake'  # every second row backwards


class Pattern(ABC):
    """Positions in a frame, numbered from 0."""

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """Frame of the positions."""

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of positions."""

    @abstractmethod
    def place_m(self, number: int) -> Point:
        """Return a position in the frame of the pattern [m].

        Raises
        ------
        IndexError
            The number is out of range.

        """

    def __getitem__(self, number: int) -> Point:
        """Return a position in ``base`` [m]; -1 is the last one.

        Raises
        ------
        IndexError
            The number is out of range.

        """
        return point_of(self.frame.to_base(self.place_m(number)))

    def __iter__(self) -> Iterator[Point]:
        """Iterate over the positions in ``base`` [m]."""
        return (point_of(place) for place in self.places_m())

    def places_m(self) -> Floats:
        """Return all positions in ``base`` [m], shape (n, 3)."""
        return self.frame.to_base([self.place_m(n) for n in range(len(self))])

    def frame_at(self, number: int, name: str = '') -> Frame:
        """Return a frame with its origin at a position and the axes of the pattern's frame.

        Raises
        ------
        IndexError
            The number is out of range.

        """
        return self.frame.at(self.place_m(number), name)


@dataclass(frozen=True)
class Grid(Pattern):
    """Rows and columns of positions, the first one at the origin of the frame.

    Raises
    ------
    ProgramError
        There are no rows or columns, too many positions, or two positions coincide.

    """

    rows: int  # along y of the frame
    columns: int  # positions in a row, along x of the frame
    pitch_m: tuple[float, float]  # within a row (x), and between rows (y); may be negative
    order: Order = Order.ROWS
    frame: Frame = BASE

    def __post_init__(self) -> None:
        """Validate the numbers."""
        object.__setattr__(self, 'rows', _count(self.rows, 'rows of a grid'))
        object.__setattr__(self, 'columns', _count(self.columns, 'columns of a grid'))
        if self.rows * self.columns > PLACES_MAX:
            raise ProgramError(f'a grid of {self.rows} x {self.columns} has more than {PLACES_MAX} places')
        pitch = _pair(self.pitch_m, 'pitch_m of a grid')
        for name, count, value in zip(('columns', 'rows'), (self.columns, self.rows), pitch, strict=True):
            if count > 1 and value == 0.0:
                raise ProgramError(f'a grid has {count} {name}, but pitch_m between them is 0')
        if self.order not in tuple(Order):
            raise ProgramError(f'order of a grid is {shown(self.order)}, but must be {" or ".join(Order)}')
        object.__setattr__(self, 'pitch_m', pitch)
        object.__setattr__(self, 'order', Order(self.order))

    def __len__(self) -> int:
        """Return the number of positions."""
        return self.rows * self.columns

    def place_m(self, number: int) -> Point:
        """Return a position in the frame of the grid [m].

        Raises
        ------
        IndexError
            The number is out of range.

        """
        row, column = divmod(_within(number, len(self)), self.columns)
        if self.order is Order.SNAKE and row % 2:
            column = self.columns - 1 - column
        return column * self.pitch_m[0], row * self.pitch_m[1], 0.0


@dataclass(frozen=True)
class Layers(Pattern):
    """Layers of a grid along z of its frame; the first layer is the grid itself.

    Raises
    ------
    ProgramError
        There are no layers, too many positions, or two layers coincide.

    """

    grid: Grid
    count: int
    height_m: float  # from layer to layer; may be negative
    shift_m: tuple[float, float] = (0.0, 0.0)  # of the second, fourth, ... layer along x and y, for a bond

    def __post_init__(self) -> None:
        """Validate the numbers."""
        if not isinstance(self.grid, Grid):
            raise ProgramError(f'layers are made of a grid, not of {shown(self.grid)}')
        object.__setattr__(self, 'count', _count(self.count, 'count of layers'))
        if self.count * len(self.grid) > PLACES_MAX:
            raise ProgramError(
                f'{self.count} layers of {len(self.grid)} places have more than {PLACES_MAX} places'
            )
        height = _length(self.height_m, 'height_m of layers')
        if self.count > 1 and height == 0.0:
            raise ProgramError(f'there are {self.count} layers, but height_m between them is 0')
        object.__setattr__(self, 'height_m', height)
        object.__setattr__(self, 'shift_m', _pair(self.shift_m, 'shift_m of layers'))

    @property
    def frame(self) -> Frame:
        """Frame of the positions."""
        return self.grid.frame

    def __len__(self) -> int:
        """Return the number of positions."""
        return self.count * len(self.grid)

    def place_m(self, number: int) -> Point:
        """Return a position in the frame of the grid [m]; layers are numbered one after the other.

        Raises
        ------
        IndexError
            The number is out of range.

        """
        layer, of_grid = divmod(_within(number, len(self)), len(self.grid))
        x, y, z = self.grid.place_m(of_grid)
        if layer % 2:
            x, y = x + self.shift_m[0], y + self.shift_m[1]
        return x, y, z + layer * self.height_m


def _within(number: int, count: int) -> int:
    """Return a position number from 0; negative numbers count from the end."""
    found = number + count if number < 0 else number
    if not 0 <= found < count:
        raise IndexError(f'there is no place {number}, the pattern has {count}')
    return found


def _count(value: Any, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= PLACES_MAX:
        raise ProgramError(f'{what} must be a whole number from 1 to {PLACES_MAX}, not {shown(value)}')
    return int(value)


def _length(value: Any, what: str) -> float:
    is_number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        raise ProgramError(f'{what} must be a finite number [m], not {shown(value)}')
    if abs(value) > PITCH_MAX_M:
        raise ProgramError(f'{what} is {value:g} m, farther than {PITCH_MAX_M:g} m: are these millimetres?')
    return float(value)


def _pair(values: Any, what: str) -> tuple[float, float]:
    if not isinstance(values, (tuple, list, np.ndarray)) or len(values) != 2:
        raise ProgramError(f'{what} must be 2 numbers [m], not {shown(values)}')
    return _length(values[0], what), _length(values[1], what)
