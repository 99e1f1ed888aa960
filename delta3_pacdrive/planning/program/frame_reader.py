"""Readers of frames, tools, patterns and loops over their positions in program files."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from delta3_pacdrive.configuration.source_positions import numbered
from delta3_pacdrive.configuration.strict_reader import Errors, Section, refuse
from delta3_pacdrive.configuration.value_readers import (
    finite_numbers,
    flag,
    number,
    number_between,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.planning.program.frames import BASE, Frame, Tool
from delta3_pacdrive.planning.program.model import REACH_M
from delta3_pacdrive.planning.program.patterns import Grid, Layers, Order, Pattern
from delta3_pacdrive.planning.program.point_reader import Named, Setting, named, read_named

PLACE = 'place'  # name of the frame at the current position of a pattern
RESERVED = (BASE.name, PLACE)
_TURNED = ('origin_m', 'roll_rad', 'pitch_rad', 'yaw_rad')
_Made = TypeVar('_Made')
Places = tuple[Frame, ...]  # frames at the positions of a pattern, in visiting order


def read_frames(value: Any, where: str, errors: Errors, found: Named[Frame]) -> None:
    """Read named frames into ``found``; a parent must be defined before its children."""

    def read(frame: Any, name: str) -> Frame | None:
        called = name.rpartition('.')[2]
        fields = Section(frame, name, errors, (*_TURNED, 'parent', 'taught_m'))
        parent = fields.read('parent', lambda value, place: named(value, place, found, 'frame'), BASE)
        origin = fields.read('origin_m', _point, (0.0, 0.0, 0.0))
        roll, pitch, yaw = (fields.read(key, number, 0.0) for key in _TURNED[1:])
        taught = fields.read('taught_m', _taught)
        if 'taught_m' not in fields:
            made = checked(lambda: Frame.turned(origin, roll, pitch, yaw, parent=parent, name=called), name)
        else:
            given = [key for key in _TURNED if key in fields]
            if given:
                refuse(f'{name}: taught_m defines origin and axes of the frame: remove {" and ".join(given)}')
            if taught is None:
                return None
            made = checked(lambda: Frame.taught(taught, parent, called), name)
        return None if parent is None else made.in_base  # keeps chains of frames short

    read_named(value, where, 'frame', found=found, errors=errors, read=read, reserved=RESERVED)


def read_tools(value: Any, where: str, errors: Errors, found: Named[Tool]) -> None:
    """Read named tools into ``found``."""

    def read(tool: Any, name: str) -> Tool:
        fields = Section(tool, name, errors, ('mass_kg', 'offset_m'))
        offset = fields.read('offset_m', finite_numbers('m'), (0.0, 0.0, 0.0))
        mass = fields.read('mass_kg', number_between(0.0, PAYLOAD_MAX_KG), 0.0)
        return checked(lambda: Tool(offset, mass, name.rpartition('.')[2]), name)

    read_named(value, where, 'tool', found=found, errors=errors, read=read)


def read_patterns(
    value: Any,
    where: str,
    errors: Errors,
    found: Named[Places],
    frames: Mapping[str, Frame | None],
    default: Frame | None,
) -> None:
    """Read named patterns into ``found``; a pattern without a frame uses the default frame."""
    of_layers = ('height_m', 'shift_m')
    allowed = ('columns', 'frame', 'layers', 'order', 'pitch_m', 'reverse', 'rows', *of_layers)

    def read(pattern: Any, name: str) -> Places | None:
        fields = Section(pattern, name, errors, allowed, ('columns', 'pitch_m', 'rows'))
        frame = fields.read('frame', lambda one, place: named(one, place, frames, 'frame'), default)
        rows, columns = (fields.read(key, whole_number_between(1, MOVES_MAX)) for key in ('rows', 'columns'))
        pitch = fields.read('pitch_m', _pair)
        order = fields.read('order', lambda one, place: Order(one_of(tuple(Order))(one, place)), Order.ROWS)
        layers = fields.read('layers', whole_number_between(1, MOVES_MAX), 1)
        height = fields.read('height_m', _length, 0.0)
        shift = fields.read('shift_m', _pair, (0.0, 0.0))
        reverse = fields.read('reverse', flag, False)
        alone = [key for key in of_layers if key in fields] if 'layers' not in fields else []
        if alone:
            refuse(f'{name}: {" and ".join(alone)} needs layers')
        if rows is None or columns is None or pitch is None or ('frame' in fields and frame is None):
            return None
        if rows * columns * layers > MOVES_MAX:
            refuse(f'{name} has {rows * columns * layers} places, the limit is {MOVES_MAX}')
        grid = checked(lambda: Grid(rows, columns, pitch, order, frame or BASE), name)
        filled: Pattern = grid
        if layers > 1:
            filled = checked(lambda: Layers(grid, layers, height, shift), name)
        places = tuple(filled.frame_at(n, PLACE).in_base for n in range(len(filled)))
        return places[::-1] if reverse else places

    read_named(value, where, 'pattern', found=found, errors=errors, read=read)


def checked(make: Callable[[], _Made], where: str) -> _Made:
    """Return the result of a constructor; report its ProgramError as an error of the file."""
    try:
        return make()
    except ProgramError as error:
        refuse(f'{where}: {error}')


def _point(value: Any, where: str) -> tuple[float, float, float]:
    point: tuple[float, float, float] = finite_numbers('m')(value, where)
    for one in point:
        _within_reach(one, where)
    return point


def _taught(value: Any, where: str) -> list[tuple[float, float, float]] | None:
    if not isinstance(value, list) or len(value) != 3:
        refuse(f'{where} must be 3 points: the origin, one on the x axis, and one where y is positive')
    return [_point(point, name) for point, name, _ in numbered(value, where)]


def _pair(value: Any, where: str) -> tuple[float, float]:
    x, y = finite_numbers('m', 2)(value, where)
    return _within_reach(x, where), _within_reach(y, where)


def _length(value: Any, where: str) -> float:
    return _within_reach(number(value, where), where)


def _within_reach(value: float, where: str) -> float:
    if not abs(value) <= REACH_M:
        refuse(f'{where} holds {value:g} m, farther than {REACH_M:g} m: are these millimetres?')
    return value


@dataclass(frozen=True)
class PlaceLoop:
    """Patterns that a loop iterates over."""

    name: str  # of the patterns, for messages
    places: Mapping[str, Places]  # frames of each pattern by loop variable; all of the same length

    @property
    def count(self) -> int:
        """Number of positions."""
        return min(map(len, self.places.values()))

    def setting(self, number: int, outside: Setting) -> Setting:
        """Return the setting of points at a position; with a single pattern its frame is the default frame."""
        frames = {name: places[number] for name, places in self.places.items()}
        choices = () if PLACE in frames else tuple(frames)
        return replace(outside, frame=frames.get(PLACE), frames={**outside.frames, **frames}, choices=choices)


def read_loop(
    value: Any, where: str, patterns: Mapping[str, Places | None], taken: Collection[str], errors: Errors
) -> PlaceLoop | None:
    """Read the patterns of a loop: the name of one, or several by names that are not ``taken``.

    None if a pattern is invalid, which is reported elsewhere.
    """
    if not isinstance(value, dict):
        places = named(value, where, patterns, 'pattern')
        return None if places is None else PlaceLoop(str(value), {PLACE: places})
    found: Named[Places] = {}
    read_named(
        value,
        where,
        'place',
        found=found,
        errors=errors,
        read=lambda one, name: named(one, name, patterns, 'pattern'),
        reserved=taken,
    )
    known = {name: places for name, places in found.items() if places is not None}
    if len(known) < len(value):
        return None
    if not known:
        refuse(f'{where} does not name a pattern')
    counts = {name: len(places) for name, places in known.items()}
    if len(set(counts.values())) > 1:
        sizes = ', '.join(f'{value[name]} has {count}' for name, count in counts.items())
        refuse(f'{where}: patterns of one loop must have the same number of places: {sizes}')
    return PlaceLoop(' and '.join(str(one) for one in value.values()), known)
