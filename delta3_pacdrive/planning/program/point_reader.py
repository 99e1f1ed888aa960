"""Reader of points in program files: coordinates in a frame, named points, and relative points."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from delta3_pacdrive.configuration.key_units import in_base_unit
from delta3_pacdrive.configuration.source_positions import place_in, place_of, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, Section, nearest_of, refuse
from delta3_pacdrive.configuration.value_readers import finite_numbers, line_of_text
from delta3_pacdrive.errors import shown
from delta3_pacdrive.planning.program.frames import Frame, Tool
from delta3_pacdrive.planning.program.model import REACH_M, Point, Target, point_of

NAME_MAX = 100
NAME = line_of_text(NAME_MAX)
NAMES_SHOWN = 5
_Value = TypeVar('_Value')
Named = dict[str, _Value | None]  # None: the definition is invalid, which is reported elsewhere


@dataclass(frozen=True)
class Setting:
    """Context for the coordinates of a point."""

    frame: Frame | None = None  # of the coordinates; None: ``base``
    tool: Tool | None = None  # its working point is positioned; None: the TCP of the plate
    frames: Mapping[str, Frame | None] = field(default_factory=dict)  # available by name
    choices: tuple[
        str, ...
    ] = ()  # names of frames one of which must be given; empty: ``frame`` is the default

    def with_frame(self, fields: Section) -> 'Setting':
        """Return the setting with the frame of a mapping, if it has one."""
        if 'frame' not in fields:
            return self
        frame = fields.read('frame', lambda value, where: named(value, where, self.frames, 'frame'))
        return replace(self, frame=frame, choices=())

    def place_m(self, point_m: Point, where: str) -> Point:
        """Transform a point to ``base``."""
        self.require_frame(where)
        return point_m if self.frame is None else point_of(self.frame.to_base(point_m))

    def along_base(self, vector: Point, where: str) -> Point:
        """Rotate a displacement or velocity to ``base``."""
        self.require_frame(where)
        return vector if self.frame is None else point_of(self.frame.directions_to_base(vector))

    def plate_m(self, place_m: Point) -> Point:
        """Return the TCP position of the plate for a position of the working point."""
        return place_m if self.tool is None else point_of(self.tool.plate_m(place_m))

    def require_frame(self, where: str) -> None:
        """Reject coordinates without a frame if several frames are possible."""
        if self.choices:
            names = ' or '.join(f'frame: {name}' for name in self.choices)
            refuse(f'{where}: give the place, {names}')


class PointReader:
    """Reader of points; stores named points as positions in ``base``."""

    def __init__(self, errors: Errors) -> None:
        self._errors = errors
        self._named: Named[Point] = {}

    def add(self, value: Any, where: str, setting: Setting) -> None:
        """Read named points; a point may refer to an earlier one."""

        def read(point: Any, name: str) -> Point | None:
            target = self._target(in_base_unit(where, point), name, setting, named=True)
            return None if target is None else target.point_m

        read_named(value, where, 'point', found=self._named, errors=self._errors, read=read)

    def place_m(self, value: Any, where: str, setting: Setting) -> Point | None:
        """Read a position by coordinates or name; None if the definition of the name is invalid."""
        if isinstance(value, str):
            return named(value, where, self._named, 'point')
        return setting.place_m(_near(value, where), where)

    def target(self, value: Any, where: str, setting: Setting) -> Target | None:
        """Read a position or step for the TCP of the plate; None if a referenced point is invalid."""
        found = self._target(value, where, setting)
        if found is None or found.relative:
            return found
        return Target(setting.plate_m(found.point_m))

    def _target(self, value: Any, where: str, setting: Setting, named: bool = False) -> Target | None:
        """Read a position or step; a ``named`` point must be a position."""
        if not isinstance(value, dict):
            place = self.place_m(value, where, setting)
            return None if place is None else Target(place)
        fields = Section(value, where, self._errors, ('at_m', 'by_m', 'frame', 'point'))
        setting = setting.with_frame(fields)
        if 'at_m' in fields:
            if 'by_m' in fields or 'point' in fields:
                refuse(f'{where}: at_m is a complete position: remove point and by_m')
            at = fields.read('at_m', lambda point, name: setting.place_m(_near(point, name), name))
            return None if at is None else Target(at)
        required = ('by_m', 'point') if named else ('by_m',)
        missing = [key for key in required if key not in fields]
        if missing:
            refuse(f'{where}: missing key {missing[0]}', place_of(value))
        step = fields.read('by_m', lambda step, name: setting.along_base(_near(step, name), name))
        if 'point' not in fields:
            return None if step is None else Target(step, relative=True)
        point = fields.read('point', lambda name, place: self.place_m(name, place, setting))
        if point is None or step is None:
            return None
        return Target((point[0] + step[0], point[1] + step[1], point[2] + step[2]))


def _near(value: Any, where: str) -> Point:
    point: Point = finite_numbers('m')(value, where)
    if max(abs(item) for item in point) > REACH_M:
        refuse(f'{where} is {shown(value)} m, farther than {REACH_M:g} m: are these millimetres?')
    return point


def named(value: Any, where: str, known: Mapping[str, _Value | None], what: str) -> _Value | None:
    """Return a named definition; None if it is invalid."""
    if not isinstance(value, str) or value not in known:
        names = ', '.join(shown(name) for name in sorted(known)[:NAMES_SHOWN]) or 'none'
        refuse(f'{where}: unknown {what} {shown(value)}, the {what}s are: {names}{nearest_of(value, known)}')
    return known[value]


def read_named(
    value: Any,
    where: str,
    what: str,
    found: Named[_Value],
    errors: Errors,
    read: Callable[[Any, str], _Value | None],
    reserved: Iterable[str] = (),
) -> None:
    """Read named definitions into ``found``; errors are collected, and an invalid definition becomes None."""
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping, not {shown(value)}')
    for key, item in value.items():
        with errors.noted(place_of_key(value, key)):
            name = NAME(key, f'{where}: the name of a {what}')
            if name in reserved:
                refuse(f'{where}: {shown(name)} is a reserved name, choose another one for the {what}')
            if name in found:
                refuse(f'{where}: the {what} {shown(name)} already exists')
            made: _Value | None = None
            with errors.noted(place_in(value, key)):
                made = read(item, f'{where}.{key}')
            found[name] = made
