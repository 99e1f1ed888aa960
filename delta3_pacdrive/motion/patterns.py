"""Patterns of places: grids, and layers of them, in a frame."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.motion.frames import BASE, Frame
from delta3_pacdrive.motion.program import Point, point_of
from delta3_pacdrive.numerics.types import Floats

PLACES_MAX = 1_000_000
PITCH_MAX_M = 10.0  # from place to place, of a shift, and of a height


class Order(StrEnum):
    """In which order the places of a grid are counted."""

    ROWS = 'rows'  # each row from its first place on
    SNAKE = 'snake'  # every other row from its last place back


class Pattern(ABC):
    """Places in a frame, counted from 0."""

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """The frame in which they are."""

    @abstractmethod
    def __len__(self) -> int:
        """Return how many there are."""

    @abstractmethod
    def place_m(self, number: int) -> Point:
        """Return a place in the frame of the pattern [m].

        Raises
        ------
        IndexError
            There is no such place.

        """

    def __getitem__(self, number: int) -> Point:
        """Return a place in ``base`` [m]; -1 is the last, as of a list.

        Raises
        ------
        IndexError
            There is no such place.

        """
        return point_of(self.frame.to_base(self.place_m(number)))

    def __iter__(self) -> Iterator[Point]:
        """Return the places in ``base`` [m], in their order."""
        return (point_of(place) for place in self.places_m())

    def places_m(self) -> Floats:
        """Return all places in ``base`` [m], shape (n, 3)."""
        return self.frame.to_base([self.place_m(n) for n in range(len(self))])

    def frame_at(self, number: int, name: str = '') -> Frame:
        """Return the frame whose origin is a place, with the axes of the pattern's frame.

        Raises
        ------
        IndexError
            There is no such place.

        """
        return self.frame.at(self.place_m(number), name)


@dataclass(frozen=True)
class Grid(Pattern):
    """Rows and columns of places; the first place is the origin of the frame.

    Attributes
    ----------
    rows, columns
        How many: the places of a row go along x, the rows along y of the frame.
    pitch_m
        From a place to the next of its row (x), and from row to row (y) [m]; negative ones go the other way.
    order
        In which the places are counted.
    frame
        In which they are.

    Raises
    ------
    ProgramError
        There are no rows or columns, too many places, or two places are one.

    """

    rows: int
    columns: int
    pitch_m: tuple[float, float]
    order: Order = Order.ROWS
    frame: Frame = BASE

    def __post_init__(self) -> None:
        """Refuse what is no grid."""
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
        """Return how many places there are."""
        return self.rows * self.columns

    def place_m(self, number: int) -> Point:
        """Return a place in the frame of the grid [m].

        Raises
        ------
        IndexError
            There is no such place.

        """
        row, column = divmod(_within(number, len(self)), self.columns)
        if self.order is Order.SNAKE and row % 2:
            column = self.columns - 1 - column
        return column * self.pitch_m[0], row * self.pitch_m[1], 0.0


@dataclass(frozen=True)
class Layers(Pattern):
    """Layers of a grid on top of each other, along z of its frame; the first layer is the grid itself.

    Attributes
    ----------
    grid
        Of each layer.
    count
        How many layers.
    height_m
        From layer to layer [m]; negative ones go down.
    shift_m
        By which every other layer is moved, the second first, along x and y [m]: so that it lies across the joints.

    Raises
    ------
    ProgramError
        There are no layers, too many places, or two layers are one.

    """

    grid: Grid
    count: int
    height_m: float
    shift_m: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Refuse what are no layers."""
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
        """The frame in which the places are."""
        return self.grid.frame

    def __len__(self) -> int:
        """Return how many places there are."""
        return self.count * len(self.grid)

    def place_m(self, number: int) -> Point:
        """Return a place in the frame of the grid [m]; one layer is filled after the other.

        Raises
        ------
        IndexError
            There is no such place.

        """
        layer, of_grid = divmod(_within(number, len(self)), len(self.grid))
        x, y, z = self.grid.place_m(of_grid)
        if layer % 2:
            x, y = x + self.shift_m[0], y + self.shift_m[1]
        return x, y, z + layer * self.height_m


def _within(number: int, count: int) -> int:
    """Return the number of a place, counted from 0."""
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
