"""Motion programs: a strict reader of YAML files.

name: pick and place            # optional
start_m: [0.0, 0.0, -0.75]      # optional: where the robot must stand
repeat: 1                       # optional
payload_kg: 0.0                 # optional: carried at the start
limits: {speed_m_s: 1.5, acceleration_m_s2: 15.0, jerk_m_s3: 600.0}     # optional, each
points: {pick: [0.15, 0.0, -0.85]}                                    # optional: names for points
moves:
- move_l: {to_m: [0.3, 0.0, -0.8], speed_m_s: 1.0, blend_m: 0.02}     # limits may stand in each move
- move_l: {to_m: pick}                                                # a named point
- move_l: {to_m: {by_m: [0.0, 0.0, 0.02]}}                            # relative to where the robot stands
- move_l: {to_m: {point: pick, by_m: [0.0, 0.0, 0.1]}, strict: true}  # relative to a point; refused, not slowed down
- move_c: {via_m: [0.1, 0.1, -0.8], to_m: [0.0, 0.2, -0.8]}           # circle through a point
- move_sb: {through_m: [[0.1, 0.0, -0.8], pick]}                      # spline through at most 100 points
- cubic: {to_m: pick, duration_s: 0.5, end_velocity_m_s: [0, 0, 0]}   # chapter 5; starts with the velocity before it
- dwell: {time_s: 0.1}
- output: {name: gripper, value: true, before_m: 0.005, payload_kg: 0.5}
faults:                                                             # optional: injected faults, see injection.py
- {fault: drop_at, axis: axis2, after_s: 0.3}                         # bus time from the start of the program
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive import yaml_file
from delta3_pacdrive.bus.words import PAYLOAD_MAX_KG, payload_on_grid
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.injection import Fault
from delta3_pacdrive.injection import parse as parse_fault
from delta3_pacdrive.motion.checks import Limits
from delta3_pacdrive.motion.curves import SPLINE_POINTS_MAX
from delta3_pacdrive.motion.plan import MOVES_MAX, OUTPUTS
from delta3_pacdrive.parameters import Motion, config_directory

REPEAT_MAX = 10_000
TIME_MAX_S = 3600.0  # of a dwell or a cubic
BLEND_MIN_M, BLEND_MAX_M = 1e-4, 1.0
REACH_M = 10.0
LIMIT_MIN, LIMIT_MAX = 1e-6, 1e9  # of speed, acceleration and jerk
VELOCITY_MAX_M_S = 100.0  # at the end of a cubic
NAME_MAX = 100
FAULTS_MAX = 1000

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Target:
    """A point [m], or a step from where the robot stands."""

    point_m: Point
    relative: bool = False


@dataclass(frozen=True)
class MoveL:
    """Straight line to a point (6.1)."""

    to: Target
    limits: Limits
    blend_m: float = 0.0
    strict: bool = False


@dataclass(frozen=True)
class MoveC:
    """Circle through a circle point to an end (6.2)."""

    via: Target
    to: Target
    limits: Limits
    blend_m: float = 0.0
    strict: bool = False


@dataclass(frozen=True)
class MoveSB:
    """Cubic spline through points (6.3)."""

    through: tuple[Target, ...]
    limits: Limits
    blend_m: float = 0.0
    strict: bool = False


@dataclass(frozen=True)
class Cubic:
    """Cubic in time with prescribed end velocity; it starts with the end velocity of the cubic before it (5.1)."""

    to: Target
    duration_s: float
    end_velocity_m_s: Point = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Dwell:
    """Rest at the present point."""

    time_s: float


@dataclass(frozen=True)
class Output:
    """An output, and perhaps the payload, that changes at the end of the move before it or a distance before that."""

    name: str
    value: float
    before_m: float = 0.0
    payload_kg: float | None = None


Statement = MoveL | MoveC | MoveSB | Cubic | Dwell | Output


@dataclass(frozen=True)
class Program:
    """Statements to run ``repeat`` times."""

    name: str
    statements: tuple[Statement, ...]
    start_m: Point | None = None
    repeat: int = 1
    payload_kg: float | None = None
    faults: tuple[Fault, ...] = ()


def load(path: str | Path, motion: Motion) -> Program:
    """Read a program file; a bare name is looked for among the packaged programs as well.

    Raises
    ------
    ProgramError
        The file cannot be read or breaks a rule; names the place and the rule.

    """
    return parse(yaml_file.read(find(path), 'program file', ProgramError), motion, Path(path).stem)


def find(path: str | Path) -> Path:
    """Return the file that ``path`` means: itself, else the packaged program of that name."""
    path = Path(path)
    packaged = config_directory() / 'programs' / f'{path.name}.yaml'
    if not path.exists() and path.parent == Path() and packaged.exists():
        return packaged
    return path


def packaged_names() -> list[str]:
    """Names of the packaged programs."""
    return sorted(file.stem for file in (config_directory() / 'programs').glob('*.yaml'))


@dataclass(frozen=True)
class _Context:
    """What a statement may refer to."""

    limits: Limits
    points: dict[str, Point]


_LIMIT_KEYS = {'speed_m_s', 'acceleration_m_s2', 'jerk_m_s3'}
_PATH_KEYS = _LIMIT_KEYS | {'blend_m', 'strict'}


def parse(document: Any, motion: Motion, name: str = 'program') -> Program:
    """Build a program from a parsed YAML document; raises ProgramError."""
    allowed = {'name', 'start_m', 'repeat', 'payload_kg', 'limits', 'points', 'moves', 'faults'}
    fields = _mapping(document, 'the program', allowed, {'moves'})
    defaults = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
    limits = _limits(_mapping(fields.get('limits', {}), 'limits', _LIMIT_KEYS, set()), defaults, 'limits')
    points = _points(fields.get('points', {}))
    repeat = fields.get('repeat', 1)
    if isinstance(repeat, bool) or not isinstance(repeat, int) or not 1 <= repeat <= REPEAT_MAX:
        raise ProgramError(
            f'repeat is {shown(repeat)}, but must be a whole number between 1 and {REPEAT_MAX}'
        )
    moves = fields['moves']
    if not isinstance(moves, list) or not moves:
        raise ProgramError('moves must be a list of at least one move')
    if len(moves) * repeat > MOVES_MAX:
        raise ProgramError(f'the program has {len(moves) * repeat} moves, the limit is {MOVES_MAX}')
    context = _Context(limits, points)
    statements = tuple(_statement(item, f'moves[{n}]', context) for n, item in enumerate(moves))
    start = _point(fields['start_m'], 'start_m', points) if 'start_m' in fields else None
    payload = _payload(fields['payload_kg'], 'payload_kg') if 'payload_kg' in fields else None
    faults = fields.get('faults', [])
    if not isinstance(faults, list) or len(faults) > FAULTS_MAX:
        raise ProgramError(f'faults must be a list of at most {FAULTS_MAX} faults')
    return Program(
        _name(fields.get('name', name), 'name'),
        statements,
        start,
        repeat,
        payload,
        tuple(parse_fault(item, f'faults[{n}]') for n, item in enumerate(faults)),
    )


def _name(value: Any, what: str) -> str:
    if not isinstance(value, str):
        raise ProgramError(f'{what} must be a text, not {shown(value)}')
    if len(value) > NAME_MAX or not value.isprintable():
        raise ProgramError(f'{what} must be one line of at most {NAME_MAX} characters, not {shown(value)}')
    return value


def _points(value: Any) -> dict[str, Point]:
    if not isinstance(value, dict):
        raise ProgramError(f'points must be a mapping, not {shown(value)}')
    names = [_name(key, 'points: the name of a point') for key in value]
    return {name: _point(value[name], f'points.{name}', {}) for name in names}


def _mapping(value: Any, where: str, allowed: set[str], required: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ProgramError(f'{where} must be a mapping, not {shown(value)}')
    for key in value:
        if key not in allowed:
            raise ProgramError(
                f'{where}: unknown key {shown(key)}, expected one of {", ".join(sorted(allowed))}'
            )
    for key in sorted(required - value.keys()):
        raise ProgramError(f'{where}: missing key {key}')
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ProgramError(f'{where} must be a number, not {shown(value)}')
    try:
        number = float(value)
    except OverflowError:
        raise ProgramError(f'{where} is too large a number') from None
    if math.isnan(number):
        raise ProgramError(f'{where} must be a number, not nan')
    return number


def _within(value: Any, where: str, low: float, high: float) -> float:
    """Return a number above ``low`` (or equal to it, if it is 0 and may be) and up to ``high``."""
    number = _number(value, where)
    if not low <= number <= high:
        raise ProgramError(f'{where} is {number:g}, but must be between {low:g} and {high:g}')
    return number


def _payload(value: Any, where: str) -> float:
    return payload_on_grid(_within(value, where, 0.0, PAYLOAD_MAX_KG))


def _vector(value: Any, where: str, unit: str) -> Point:
    if not isinstance(value, list) or len(value) != 3:
        raise ProgramError(f'{where} must be a list of 3 numbers [{unit}], not {shown(value)}')
    x, y, z = (_number(item, f'{where}[{n}]') for n, item in enumerate(value))
    if not all(math.isfinite(item) for item in (x, y, z)):
        raise ProgramError(f'{where} must be finite, not {shown(value)}')
    return x, y, z


def _point(value: Any, where: str, points: dict[str, Point]) -> Point:
    if isinstance(value, str):
        if value not in points:
            known = ', '.join(shown(name) for name in sorted(points)[:5]) or 'none'
            raise ProgramError(f'{where}: unknown point {shown(value)}, the points are: {known}')
        return points[value]
    point = _vector(value, where, 'm')
    if max(abs(item) for item in point) > REACH_M:
        raise ProgramError(f'{where} is {shown(value)} m, farther than {REACH_M:g} m: are these millimetres?')
    return point


def _target(value: Any, where: str, points: dict[str, Point]) -> Target:
    if not isinstance(value, dict):
        return Target(_point(value, where, points))
    fields = _mapping(value, where, {'point', 'by_m'}, {'by_m'})
    step = _point(fields['by_m'], f'{where}.by_m', {})
    if 'point' not in fields:
        return Target(step, relative=True)
    x, y, z = _point(fields['point'], f'{where}.point', points)
    return Target((x + step[0], y + step[1], z + step[2]))


def _limits(fields: dict[str, Any], defaults: Limits, where: str) -> Limits:
    values = {}
    for key in ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3'):
        value = _number(fields.get(key, getattr(defaults, key)), f'{where}.{key}')
        if not value > 0.0 or (math.isinf(value) and key != 'jerk_m_s3'):
            raise ProgramError(f'{where}.{key} is {value}, but must be a positive number')
        if not LIMIT_MIN <= value <= LIMIT_MAX and not math.isinf(value):
            raise ProgramError(
                f'{where}.{key} is {value:g}, but must be between {LIMIT_MIN:g} and {LIMIT_MAX:g}'
            )
        values[key] = value
    return Limits(**values)


def _path_options(fields: dict[str, Any], context: _Context, where: str) -> dict[str, Any]:
    strict = fields.get('strict', False)
    if not isinstance(strict, bool):
        raise ProgramError(f'{where}.strict must be true or false, not {shown(strict)}')
    blend = _within(fields.get('blend_m', 0.0), f'{where}.blend_m', 0.0, BLEND_MAX_M)
    if 0.0 < blend < BLEND_MIN_M:
        raise ProgramError(f'{where}.blend_m is {blend:g}, but must be 0 or at least {BLEND_MIN_M:g}')
    return {'limits': _limits(fields, context.limits, where), 'blend_m': blend, 'strict': strict}


def _parse_move_l(value: Any, where: str, context: _Context) -> Statement:
    fields = _mapping(value, where, {'to_m', *_PATH_KEYS}, {'to_m'})
    return MoveL(
        _target(fields['to_m'], f'{where}.to_m', context.points), **_path_options(fields, context, where)
    )


def _parse_move_c(value: Any, where: str, context: _Context) -> Statement:
    fields = _mapping(value, where, {'via_m', 'to_m', *_PATH_KEYS}, {'via_m', 'to_m'})
    return MoveC(
        _target(fields['via_m'], f'{where}.via_m', context.points),
        _target(fields['to_m'], f'{where}.to_m', context.points),
        **_path_options(fields, context, where),
    )


def _parse_move_sb(value: Any, where: str, context: _Context) -> Statement:
    fields = _mapping(value, where, {'through_m', *_PATH_KEYS}, {'through_m'})
    through = fields['through_m']
    if not isinstance(through, list) or not through:
        raise ProgramError(f'{where}.through_m must be a list of at least one point')
    if len(through) > SPLINE_POINTS_MAX:
        raise ProgramError(f'{where}.through_m has {len(through)} points, the limit is {SPLINE_POINTS_MAX}')
    targets = tuple(
        _target(item, f'{where}.through_m[{n}]', context.points) for n, item in enumerate(through)
    )
    return MoveSB(targets, **_path_options(fields, context, where))


def _parse_cubic(value: Any, where: str, context: _Context) -> Statement:
    fields = _mapping(value, where, {'to_m', 'duration_s', 'end_velocity_m_s'}, {'to_m', 'duration_s'})
    velocity = _vector(fields.get('end_velocity_m_s', [0.0, 0.0, 0.0]), f'{where}.end_velocity_m_s', 'm/s')
    if max(abs(item) for item in velocity) > VELOCITY_MAX_M_S:
        raise ProgramError(f'{where}.end_velocity_m_s may be up to {VELOCITY_MAX_M_S:g} m/s on each axis')
    return Cubic(
        _target(fields['to_m'], f'{where}.to_m', context.points),
        _duration(fields['duration_s'], f'{where}.duration_s'),
        velocity,
    )


def _duration(value: Any, where: str) -> float:
    time = _number(value, where)
    if not 1e-3 <= time <= TIME_MAX_S:
        raise ProgramError(f'{where} is {time:g}, but must be between 0.001 and {TIME_MAX_S:g}')
    return time


def _parse_dwell(value: Any, where: str, _: _Context) -> Statement:
    fields = _mapping(value, where, {'time_s'}, {'time_s'})
    time = _number(fields['time_s'], f'{where}.time_s')
    if not 0.0 < time <= TIME_MAX_S:
        raise ProgramError(f'{where}.time_s is {time}, but must be positive and at most {TIME_MAX_S:g}')
    return Dwell(time)


def _parse_output(value: Any, where: str, _: _Context) -> Statement:
    fields = _mapping(value, where, {'name', 'value', 'before_m', 'payload_kg'}, {'name', 'value'})
    name, state = fields['name'], fields['value']
    if name not in OUTPUTS:
        raise ProgramError(f'{where}.name is {shown(name)}, but must be one of {", ".join(OUTPUTS)}')
    if not isinstance(state, bool):
        raise ProgramError(f'{where}.value must be true or false, not {shown(state)}')
    before = _within(fields.get('before_m', 0.0), f'{where}.before_m', 0.0, REACH_M)
    payload = _payload(fields['payload_kg'], f'{where}.payload_kg') if 'payload_kg' in fields else None
    return Output(name, float(state), before, payload)


_PARSERS: dict[str, Callable[[Any, str, _Context], Statement]] = {
    'move_l': _parse_move_l,
    'move_c': _parse_move_c,
    'move_sb': _parse_move_sb,
    'cubic': _parse_cubic,
    'dwell': _parse_dwell,
    'output': _parse_output,
}


def _statement(value: Any, where: str, context: _Context) -> Statement:
    fields = _mapping(value, where, set(_PARSERS), set())
    if len(fields) != 1:
        raise ProgramError(f'{where} must hold exactly one of {", ".join(_PARSERS)}')
    ((kind, content),) = fields.items()
    return _PARSERS[kind](content, f'{where}.{kind}', context)


def point_text(point_m: ArrayLike) -> str:
    """Write a point as people do."""
    return '(' + ', '.join(f'{value:g}' for value in np.round(np.asarray(point_m), 6)) + ')'
