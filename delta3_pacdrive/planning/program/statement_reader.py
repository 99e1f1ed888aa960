"""Reader of statements in program files, including loops over patterns."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from delta3_pacdrive.configuration.schema import RecordReader, schema_of
from delta3_pacdrive.configuration.source_positions import Place, numbered, place_in, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, Section, at, expected, refuse
from delta3_pacdrive.configuration.value_readers import (
    finite_numbers,
    flag,
    number_between,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import shown
from delta3_pacdrive.parameters import ROTARY_AXES_MAX
from delta3_pacdrive.planning.limits.limit_reader import LIMIT_KEYS, blend, given_limits, limits_of
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.planning.program.frame_reader import RESERVED, Places, read_loop
from delta3_pacdrive.planning.program.frames import Frame, Tool
from delta3_pacdrive.planning.program.model import (
    KINDS,
    Angle,
    Arch,
    Cubic,
    Dwell,
    Joints,
    KeepOut,
    MoveC,
    MoveL,
    MoveSB,
    Output,
    PathMove,
    Point,
    Statement,
    Target,
    Turn,
)
from delta3_pacdrive.planning.program.output_names import OWN, OutputNames
from delta3_pacdrive.planning.program.point_reader import PointReader, Setting, named
from delta3_pacdrive.robot.sercos.words import PAYLOAD_MAX_KG, payload_on_grid

SHIFTS = ('before_m', 'after_m', 'before_s', 'after_s', 'in_time')
VELOCITY_MAX_M_S = 100.0  # at the end of a cubic
TURN_MAX_RAD = 1e3  # larger angles are errors of units
LEVEL_M = 1e-9  # rounding tolerance for the distance from the tool axis
LEVEL_RAD = 1e-9  # rounding tolerance for the tilt of a frame
FOR_EACH = 'for_each'
_IN_TIME = 'in_time'
_KINDS = {name: kind for kind, name in KINDS.items()}
_OF_POINTS = ('frame', 'tool')
# keys of a statement that are not fields of its record
_OTHER_KEYS: dict[type[Statement], tuple[str, ...]] = {
    **dict.fromkeys((MoveL, MoveC, MoveSB, Arch), (*LIMIT_KEYS, *_OF_POINTS)),
    Cubic: _OF_POINTS,
    Turn: _OF_POINTS,
    Joints: (),
    Dwell: (),
    Output: (_IN_TIME,),
}
Read = Callable[[Any, str], Any]


class ReadStatement(NamedTuple):
    """A statement with its name for messages and its position in the file, if known."""

    statement: Statement
    name: str
    place: Place | None


@dataclass(frozen=True)
class Head:
    """Settings in the head of a program that apply to its statements."""

    defaults: Limits
    tcp_speed_limit_m_s: float
    limits: dict[str, float] = field(default_factory=dict)  # given in the head, by key
    time_optimal: bool = False
    in_position: bool = False
    constant_speed: bool = False
    setting: Setting = field(default_factory=Setting)  # default frame and tool
    tools: Mapping[str, Tool | None] = field(default_factory=dict)
    patterns: Mapping[str, Places | None] = field(default_factory=dict)
    repeat: int = 1
    outputs: OutputNames = field(default_factory=lambda: OWN)

    @property
    def tool_kg(self) -> float:
        """Mass of the tool [kg]."""
        return self.setting.tool.mass_kg if self.setting.tool else 0.0


class StatementReader:
    """Reader of statements, with access to the settings in the head of the program."""

    def __init__(self, head: Head, points: PointReader, errors: Errors) -> None:
        self._head, self._points, self._errors = head, points, errors
        self._count = 0  # number of statements so far
        self._setting: Setting | None = None  # of the latest reader of records
        self._reader = RecordReader(errors)

    def statements(self, value: Any, where: str) -> tuple[ReadStatement, ...]:
        """Read all statements of a program; invalid ones are reported and skipped."""
        if not isinstance(value, list) or not value:
            refuse(f'{where} must be a list of at least one move')
        self._counted(sum(1 for item in value if not _is_loop(item)))
        found: list[ReadStatement] = []
        for item, name, place in numbered(value, where):
            with self._errors.noted(place):
                if _is_loop(item):
                    with at(place_in(item, FOR_EACH)):
                        found.extend(self._for_each(item[FOR_EACH], f'{name}.{FOR_EACH}'))
                else:
                    kinds = (*_KINDS, FOR_EACH)
                    found.append(self._named(item, name, place, self._head.setting, kinds))
        return tuple(found)

    def _counted(self, more: int) -> None:
        """Count statements; rejects a program with too many moves."""
        self._count += more
        moves = self._count * self._head.repeat
        if moves > MOVES_MAX:
            refuse(f'the program has {moves} moves, the limit is {MOVES_MAX}')

    def _for_each(self, value: Any, where: str) -> Iterator[ReadStatement]:
        """Read a loop: its statements once for each position of its patterns."""
        required = ('moves', 'place_of')
        fields = Section(value, where, self._errors, ('first', *required), required)
        patterns, taken = self._head.patterns, (*RESERVED, *self._head.setting.frames)
        loop = fields.read(
            'place_of', lambda names, name: read_loop(names, name, patterns, taken, self._errors)
        )
        moves = fields.read('moves', _moves, [])
        if loop is None:
            return
        first = fields.read('first', whole_number_between(0, loop.count - 1), 0)
        self._counted((loop.count - first) * len(moves))
        for n in range(first, loop.count):
            setting = loop.setting(n, self._head.setting)
            for item, name, place in numbered(moves, f'{where}.moves'):
                with self._errors.noted(place):
                    read = self._named(item, name, place, setting, tuple(_KINDS))
                    yield read._replace(name=f'{read.name} at place {n} of {loop.name}')

    def _named(
        self, value: Any, where: str, place: Place | None, setting: Setting, kinds: Iterable[str]
    ) -> ReadStatement:
        """Read a statement of one of the allowed kinds."""
        if not isinstance(value, dict):
            refuse(f'{where} must be a mapping, not {shown(value)}')
        for key in value:
            if key not in kinds:
                unknown = f'{where}: unknown key {shown(key)}, {expected(key, kinds)}'
                refuse(unknown, place_of_key(value, key))
        if len(value) != 1:
            refuse(f'{where} must hold exactly one of {", ".join(kinds)}')
        ((name, content),) = value.items()
        with at(place_in(value, name)):
            statement = self._statement(content, f'{where}.{name}', _KINDS[name], setting)
        return ReadStatement(statement, f'{where}.{name}', place)

    def _statement(self, content: Any, where: str, kind: type[Statement], setting: Setting) -> Statement:
        schema, along_path = schema_of(kind), issubclass(kind, PathMove)
        fields = Section(content, where, self._errors, (*schema.fields, *_OTHER_KEYS[kind]), schema.required)
        setting = self._set(fields, setting)
        values = self._along_path(fields, where) if along_path else {}
        if kind is Output:
            _require_one_shift(fields, where)
        values = self._bound_to(setting).values(kind, fields, known=values)
        if kind is Output:
            values = self._of_own_output(values, fields.read(_IN_TIME, flag, False))
        return kind(**values)

    def _bound_to(self, setting: Setting) -> RecordReader:
        """Return the reader of records for a setting."""
        if setting is not self._setting:
            points = self._points
            self._setting = setting
            self._reader = RecordReader(
                self._errors,
                readers={
                    Target: lambda value, where: points.target(value, where, setting),
                    'target': lambda value, where: points.target(value, where, setting),
                    'angles': lambda value, where: self._angles(value, where, setting),
                    'keep_out': lambda value, where: self._keep_out(value, where, setting),
                    'velocity': lambda value, where: _velocity(value, where, setting),
                    'output': one_of(tuple(self._head.outputs)),
                    'payload': lambda value, where: payload(value, where, self._head.tool_kg),
                },
            )
        return self._reader

    def _of_own_output(self, values: dict[str, Any], in_time: bool) -> dict[str, Any]:
        """Replace a named output by the robot's own output, with the lead time of the connected device."""
        named_output = self._head.outputs[values['name']]
        values['name'] = named_output.output
        if in_time:
            values['before_s'] = named_output.delay_s(values['value'])
        return values

    def _set(self, fields: Section, setting: Setting) -> Setting:
        """Return the setting with frame and tool of a statement."""
        setting = setting.with_frame(fields)
        if 'tool' not in fields:
            return setting
        return replace(setting, tool=fields.read('tool', self._tool))

    def _tool(self, value: Any, where: str) -> Tool | None:
        tool = named(value, where, self._head.tools, 'tool')
        if tool is not None and tool.mass_kg != self._head.tool_kg:
            refuse(
                f'{where}: {shown(value)} weighs {tool.mass_kg:g} kg, but the robot carries a tool of '
                f'{self._head.tool_kg:g} kg, given in the head of the program'
            )
        return tool

    def _along_path(self, fields: Section, where: str) -> dict[str, Any]:
        """Return the values of a move along a path that depend on the head of the program."""
        head = self._head
        optimal = fields.read('time_optimal', flag, head.time_optimal)
        own = given_limits(fields, head.tcp_speed_limit_m_s)
        if 'torque_rate_n_m_s' in own and not optimal:
            refuse(f'{where}.torque_rate_n_m_s is a limit of time-optimal moves: add time_optimal: true')
        given = {**head.limits, **own}
        blend_m = fields.read('blend_m', blend, 0.0)
        stops = blend_m == 0.0
        in_position = fields.read('in_position', flag, head.in_position and stops)
        if in_position and not stops:
            refuse(f'{where}.in_position: the robot does not stop at a blend, and cannot wait there')
        return {
            'time_optimal': optimal,
            'limits': limits_of(given, head.defaults, optimal),
            'torque_rate_n_m_s': given.get('torque_rate_n_m_s', math.inf) if optimal else math.inf,
            'blend_m': blend_m,
            'in_position': in_position,
            'constant_speed': fields.read('constant_speed', flag, head.constant_speed),
        }

    def _angles(self, value: Any, where: str, setting: Setting) -> tuple[Angle, ...]:
        """Read angles of the first rotary axes; that of the first one is from the x axis of its frame."""
        for name, tool in self._head.tools.items():
            offset_m = 0.0 if tool is None else math.hypot(*tool.offset_m[:2])
            if offset_m > LEVEL_M:
                refuse(
                    f'{where}: tool {shown(name)} works {1e3 * offset_m:g} mm off the axis that would turn it; '
                    'points are not corrected for this offset'
                )
        angles = per_rotary_axis(value, where, self._angle)
        return (*(_in_base(angle, where, setting) for angle in angles[:1]), *angles[1:])

    def _angle(self, value: Any, where: str) -> Angle:
        """Read an angle of a rotary axis, or a rotation from its current angle."""
        if not isinstance(value, dict):
            return Angle(turn(value, where))
        fields = Section(value, where, self._errors, ('by_rad',), ('by_rad',))
        return Angle(fields.read('by_rad', turn, 0.0), relative=True)

    def _keep_out(self, value: Any, where: str, setting: Setting) -> KeepOut:
        """Read a keep-out zone; its height refers to the frame and to the working point of the tool."""
        found = self._reader.record(KeepOut, value, where)
        height = found.height_m
        setting.require_frame(where)
        if setting.frame is not None:
            _require_upright(setting.frame, where, 'a height')
            height += setting.frame.in_base.origin_m[2]
        if setting.tool is not None:
            height -= setting.tool.offset_m[2]
        return KeepOut(height, found.margin_m)


def each(value: Any, where: str, errors: Errors, read: Read) -> tuple[Any, ...]:
    """Read the items of a list; invalid ones are reported and skipped."""
    found = []
    for item, name, place in numbered(value, where):
        with errors.noted(place):
            found.append(read(item, name))
    return tuple(found)


def per_rotary_axis(value: Any, where: str, read: Read) -> tuple[Any, ...]:
    """Read a value of the first rotary axis, or a list with one value for each of the first axes."""
    if not isinstance(value, list):
        return (read(value, where),)
    if not 1 <= len(value) <= ROTARY_AXES_MAX:
        refuse(f'{where} has {len(value)} angles, but must have 1 to {ROTARY_AXES_MAX}: one per rotary axis')
    found = []
    for item, name, place in numbered(value, where):
        with at(place):  # raised to the reader of the key, which adds the unit
            found.append(read(item, name))
    return tuple(found)


def payload(value: Any, where: str, tool_kg: float = 0.0) -> float:
    """Read a payload and add the mass of the tool [kg]."""
    carried = number_between(0.0, PAYLOAD_MAX_KG)(value, where) + tool_kg
    if carried > PAYLOAD_MAX_KG:
        refuse(f'{where} and the tool are {carried:g} kg together, the limit is {PAYLOAD_MAX_KG:g} kg')
    return payload_on_grid(carried)


def _require_one_shift(fields: Section, where: str) -> None:
    """Reject an output with more than one shift, or with a timed change of the payload."""
    given = [key for key in SHIFTS if key in fields]
    if len(given) > 1:
        refuse(f'{where} holds {" and ".join(given)}: give one of them')
    if given and given[0] in ('before_s', 'after_s', 'in_time') and 'payload_kg' in fields:
        refuse(
            f'{where}: payload_kg does not go with {given[0]}: add a second output for the position where the part is '
            'held'
        )


def _require_upright(frame: Frame, where: str, what: str) -> None:
    if frame.tilt_rad > LEVEL_RAD:
        tilt = math.degrees(frame.tilt_rad)
        refuse(f'{where}: {what} needs a frame whose z axis is upright, not one tilted by {tilt:.3g} deg')


def turn(value: Any, where: str) -> float:
    """Read an angle of the tool [rad]."""
    return number_between(-TURN_MAX_RAD, TURN_MAX_RAD)(value, where)


def _in_base(angle: Angle, where: str, setting: Setting) -> Angle:
    """Return an angle of the first rotary axis from the x axis of ``base``."""
    if angle.relative:
        return angle
    setting.require_frame(where)
    if setting.frame is None:
        return angle
    _require_upright(setting.frame, where, 'an angle of the tool')
    return Angle(angle.angle_rad + setting.frame.in_base.roll_pitch_yaw_rad[2])


def _is_loop(value: Any) -> bool:
    return isinstance(value, dict) and len(value) == 1 and FOR_EACH in value


def _moves(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        refuse(f'{where} must be a list of at least one move')
    return value


def _velocity(value: Any, where: str, setting: Setting) -> Point:
    velocity: Point = finite_numbers('m/s')(value, where)
    if max(abs(item) for item in velocity) > VELOCITY_MAX_M_S:
        refuse(f'{where} may be up to {VELOCITY_MAX_M_S:g} m/s on each axis')
    return setting.along_base(velocity, where)
