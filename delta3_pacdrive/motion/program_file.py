"""Motion programs: a strict reader of YAML files.

name: pick and place            # optional
start_m: [0.0, 0.0, -0.75]      # optional: where the robot must stand
repeat: 1                       # optional
payload_kg: 0.0                 # optional: carried at the start
time_optimal: false             # optional: as fast as the motors allow; also in each move
limits: {speed_m_s: 1.5, acceleration_m_s2: 15.0, jerk_m_s3: 600.0}     # optional, each; torque_rate_n_m_s if optimal
points: {pick: [0.15, 0.0, -0.85]}                                    # optional: names for points
moves:
- move_l: {to_m: [0.3, 0.0, -0.8], speed_m_s: 1.0, blend_m: 0.02}     # limits may stand in each move
- move_l: {to_m: pick}                                                # a named point
- move_l: {to_m: {by_m: [0.0, 0.0, 0.02]}}                            # relative to where the robot stands
- move_l: {to_m: {point: pick, by_m: [0.0, 0.0, 0.1]}, strict: true}  # relative to a point; refused, not slowed down
- move_c: {via_m: [0.1, 0.1, -0.8], to_m: [0.0, 0.2, -0.8]}           # circle through a point
- move_sb: {through_m: [[0.1, 0.0, -0.8], pick]}                      # spline through at most 100 points
- arch: {to_m: pick, up_m: 0.01, down_m: 0.01, keep_out: {height_m: -0.8, margin_m: 0.05}, aim: time}   # best shape
- cubic: {to_m: pick, duration_s: 0.5, end_velocity_m_s: [0, 0, 0]}   # chapter 5; starts with the velocity before it
- joints: {points: [{time_s: 0.5, angles_rad: [0.2, 0.3, 0.2], speeds_rad_s: [0, 0, 0]}]}   # arm angles over time
- dwell: {time_s: 0.1}
- output: {name: gripper, value: true, before_m: 0.005, payload_kg: 0.5}
faults:                                                             # optional: injected faults, see faults/fault.py
- {fault: drop_at, axis: axis2, after_s: 0.3}                         # bus time from the start of the program
"""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import packaged, yaml_file
from delta3_pacdrive.configuration.checked import Errors, Refusal, Section, at, expected, nearest_of, refuse
from delta3_pacdrive.configuration.located import numbered, place_in, place_of, place_of_key
from delta3_pacdrive.configuration.readers import (
    flag,
    line_of_text,
    number,
    number_between,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.faults.fault import Fault, read_fault
from delta3_pacdrive.motion.curves import SPLINE_POINTS_MAX
from delta3_pacdrive.motion.limits import Limits
from delta3_pacdrive.motion.plan import MOVES_MAX, OUTPUTS
from delta3_pacdrive.motion.program import (
    JOINT_POINTS_MAX,
    Aim,
    Arch,
    Cubic,
    Dwell,
    JointPoint,
    Joints,
    KeepOut,
    MoveC,
    MoveL,
    MoveSB,
    Output,
    PathMove,
    Point,
    Program,
    Statement,
    Target,
)
from delta3_pacdrive.parameters import Motion, config_directory
from delta3_pacdrive.sercos.words import PAYLOAD_MAX_KG, payload_on_grid

REPEAT_MAX = 10_000
TIME_MAX_S = 3600.0  # of a dwell or a cubic
BLEND_MIN_M, BLEND_MAX_M = 1e-4, 1.0
CLEARANCE_MAX_M = 1.0  # of an arch
REACH_M = 10.0
LIMIT_MIN, LIMIT_MAX = 1e-6, 1e9  # of speed, acceleration and jerk
VELOCITY_MAX_M_S = 100.0  # at the end of a cubic
NAME_MAX = 100
STATEMENTS = ('move_l', 'move_c', 'move_sb', 'arch', 'cubic', 'joints', 'dwell', 'output')
FAULTS_MAX = 1000
_NAME = line_of_text(NAME_MAX)
Read = Callable[[Any, str], Any]


def load(path: str | Path, motion: Motion) -> Program:
    """Read a program file; a bare name is looked for among the packaged programs as well.

    Raises
    ------
    ProgramError
        The file cannot be read or breaks a rule; names the place and the rule.

    """
    document = yaml_file.read(find(path), 'program file', ProgramError)
    return parse(document, motion, Path(path).stem, str(path))


def find(path: str | Path) -> Path:
    """Return the file that ``path`` means: itself, else the packaged program of that name."""
    path = Path(path)
    own = config_directory() / 'programs' / f'{path.name}.yaml'
    if not path.exists() and path.parent == Path() and own.exists():
        return own
    return path


def packaged_names() -> list[str]:
    """Names of the packaged programs."""
    return packaged.program_names()


_TCP_LIMIT_KEYS = ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')
_LIMIT_KEYS = (*_TCP_LIMIT_KEYS, 'torque_rate_n_m_s')
_PATH_KEYS = (*_LIMIT_KEYS, 'blend_m', 'strict', 'time_optimal')


def parse(document: Any, motion: Motion, name: str = 'program', file: str = '') -> Program:
    """Build a program from a parsed YAML document; ``file`` names one that is empty, and so cannot tell its own name.

    Raises
    ------
    ProgramError
        Values break rules; names the places and the rules, up to ten.

    """
    errors = Errors(getattr(document, 'source', file))
    programs: list[Program] = []
    with errors.raised_as(ProgramError), errors.noted(place_of(document)):
        programs.append(_program(document, motion, name, errors))
    (program,) = programs
    source, moves = getattr(document, 'source', ''), document['moves']
    places = tuple(place_in(moves, n) for n in range(len(moves)))
    if source or any(
        place and place.line > 1 for place in places
    ):  # nobody looks for a place in a single line
        return replace(program, source=source, places=places)
    return program


def _program(document: Any, motion: Motion, name: str, errors: Errors) -> Program:
    """Build a program; it is good for nothing if there are errors."""
    allowed = (
        'name',
        'start_m',
        'repeat',
        'payload_kg',
        'time_optimal',
        'limits',
        'points',
        'moves',
        'faults',
    )
    fields = Section(document, 'the program', errors, allowed, ('moves',))
    defaults = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
    limits = fields.read(
        'limits',
        lambda value, where: _given_limits(Section(value, where, errors, _LIMIT_KEYS)),
        {},
        prefix='',
    )
    time_optimal = fields.read('time_optimal', flag, False, prefix='')
    points = fields.read('points', lambda value, where: _points(value, where, errors), {}, prefix='')
    repeat = fields.read('repeat', whole_number_between(1, REPEAT_MAX), 1, prefix='')
    reader = _StatementReader(defaults, limits, time_optimal, points, errors)

    def statements(value: Any, where: str) -> tuple[Statement, ...]:
        if not isinstance(value, list) or not value:
            refuse(f'{where} must be a list of at least one move')
        if len(value) * repeat > MOVES_MAX:
            refuse(f'the program has {len(value) * repeat} moves, the limit is {MOVES_MAX}')
        return _each(value, where, errors, reader.statement)

    def faults(value: Any, where: str) -> tuple[Fault, ...]:
        if not isinstance(value, list) or len(value) > FAULTS_MAX:
            refuse(f'{where} must be a list of at most {FAULTS_MAX} faults')
        return _each(value, where, errors, lambda item, name: read_fault(item, name, errors))

    return Program(
        fields.read('name', _NAME, _NAME(name, 'name'), prefix=''),
        fields.read('moves', statements, (), prefix=''),
        fields.read('start_m', lambda value, where: _point(value, where, points), prefix=''),
        repeat,
        fields.read('payload_kg', _payload, prefix=''),
        fields.read('faults', faults, (), prefix=''),
    )


def _each(value: Any, where: str, errors: Errors, read: Read) -> tuple[Any, ...]:
    """Read the items of a list; what is wrong with one is noted, and it is left out."""
    found = []
    for item, name, place in numbered(value, where):
        with errors.noted(place):
            found.append(read(item, name))
    return tuple(found)


def _points(value: Any, where: str, errors: Errors) -> dict[str, Point | None]:
    """Return points by their names; None is one that is wrong, which has been told."""
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping, not {shown(value)}')
    found: dict[str, Point | None] = {}
    for key, point in value.items():
        with errors.noted(place_of_key(value, key)):
            found[_NAME(key, f'{where}: the name of a point')] = None
            with errors.noted(place_in(value, key)):
                found[key] = _point(point, f'{where}.{key}', {})
    return found


def _payload(value: Any, where: str) -> float:
    return payload_on_grid(number_between(0.0, PAYLOAD_MAX_KG)(value, where))


def _vector(value: Any, where: str, unit: str) -> Point:
    if not isinstance(value, list) or len(value) != 3:
        refuse(f'{where} must be a list of 3 numbers [{unit}], not {shown(value)}')
    numbers = []
    for item, name, place in numbered(value, where):
        try:
            numbers.append(number(item, name))
        except Refusal as refusal:
            refusal.place = place
            raise
    if not all(math.isfinite(item) for item in numbers):
        refuse(f'{where} must be finite, not {shown(value)}')
    x, y, z = numbers
    return x, y, z


def _point(value: Any, where: str, points: dict[str, Point | None]) -> Point | None:
    if isinstance(value, str):
        if value not in points:
            known = ', '.join(shown(name) for name in sorted(points)[:5]) or 'none'
            nearest = nearest_of(value, points)
            refuse(f'{where}: unknown point {shown(value)}, the points are: {known}{nearest}')
        return points[value]
    point = _vector(value, where, 'm')
    if max(abs(item) for item in point) > REACH_M:
        refuse(f'{where} is {shown(value)} m, farther than {REACH_M:g} m: are these millimetres?')
    return point


def _limit(value: Any, where: str) -> float:
    limit = number(value, where)
    if not limit > 0.0 or (math.isinf(limit) and not where.endswith('jerk_m_s3')):
        refuse(f'{where} is {limit}, but must be a positive number')
    if not LIMIT_MIN <= limit <= LIMIT_MAX and not math.isinf(limit):
        refuse(f'{where} is {limit:g}, but must be between {LIMIT_MIN:g} and {LIMIT_MAX:g}')
    return limit


def _given_limits(fields: Section) -> dict[str, float]:
    """Return the limits that are given, by their keys."""
    return {key: fields.read(key, _limit) for key in _LIMIT_KEYS if key in fields}


def _limits_of(given: dict[str, float], defaults: Limits, time_optimal: bool) -> Limits:
    """Return the limits of the TCP; the motors alone limit a time-optimal move where none are given.

    Without a torque rate its jerk is limited all the same.
    """
    if time_optimal:
        jerk = math.inf if 'torque_rate_n_m_s' in given else defaults.jerk_m_s3
        defaults = Limits(math.inf, math.inf, jerk)
    return Limits(*(given.get(key, getattr(defaults, key)) for key in _TCP_LIMIT_KEYS))


def _blend(value: Any, where: str) -> float:
    blend = number_between(0.0, BLEND_MAX_M)(value, where)
    if 0.0 < blend < BLEND_MIN_M:
        refuse(f'{where} is {blend:g}, but must be 0 or at least {BLEND_MIN_M:g}')
    return blend


def _velocity(value: Any, where: str) -> Point:
    vector = _vector(value, where, 'm/s')
    if max(abs(item) for item in vector) > VELOCITY_MAX_M_S:
        refuse(f'{where} may be up to {VELOCITY_MAX_M_S:g} m/s on each axis')
    return vector


def _duration(value: Any, where: str) -> float:
    time = number(value, where)
    if not 0.0 < time <= TIME_MAX_S:
        refuse(f'{where} is {time}, but must be positive and at most {TIME_MAX_S:g}')
    return time


class _StatementReader:
    """The reader of statements, which may refer to limits and points of the program."""

    def __init__(
        self,
        defaults: Limits,
        limits: dict[str, float],
        time_optimal: bool,
        points: dict[str, Point | None],
        errors: Errors,
    ) -> None:
        self._defaults, self._limits, self._time_optimal = defaults, limits, time_optimal
        self._points, self._errors = points, errors
        # of each kind of statement: its class, its fields by their keys with a reader, and the keys that it must have
        self._kinds: dict[str, tuple[type[Statement], dict[str, tuple[str, Read]], tuple[str, ...]]] = {
            'move_l': (MoveL, {'to_m': ('to', self._target)}, ('to_m',)),
            'move_c': (
                MoveC,
                {'via_m': ('via', self._target), 'to_m': ('to', self._target)},
                ('to_m', 'via_m'),
            ),
            'move_sb': (MoveSB, {'through_m': ('through', self._through)}, ('through_m',)),
            'arch': (
                Arch,
                {
                    'to_m': ('to', self._target),
                    'up_m': ('up_m', number_between(0.0, CLEARANCE_MAX_M)),
                    'down_m': ('down_m', number_between(0.0, CLEARANCE_MAX_M)),
                    'keep_out': ('keep_out', self._keep_out),
                    'aim': ('aim', lambda value, where: Aim(one_of(tuple(Aim))(value, where))),
                },
                ('down_m', 'to_m', 'up_m'),
            ),
            'cubic': (
                Cubic,
                {
                    'to_m': ('to', self._target),
                    'duration_s': ('duration_s', number_between(1e-3, TIME_MAX_S)),
                    'end_velocity_m_s': ('end_velocity_m_s', _velocity),
                },
                ('duration_s', 'to_m'),
            ),
            'joints': (Joints, {'points': ('points', self._joint_points)}, ('points',)),
            'dwell': (Dwell, {'time_s': ('time_s', _duration)}, ('time_s',)),
            'output': (
                Output,
                {
                    'name': ('name', one_of(OUTPUTS)),
                    'value': ('value', lambda value, where: float(flag(value, where))),
                    'before_m': ('before_m', number_between(0.0, REACH_M)),
                    'payload_kg': ('payload_kg', _payload),
                },
                ('name', 'value'),
            ),
        }

    def statement(self, value: Any, where: str) -> Statement:
        """Read a statement."""
        if not isinstance(value, dict):
            refuse(f'{where} must be a mapping, not {shown(value)}')
        for key in value:
            if key not in self._kinds:
                unknown = f'{where}: unknown key {shown(key)}, {expected(key, self._kinds)}'
                refuse(unknown, place_of_key(value, key))
        if len(value) != 1:
            refuse(f'{where} must hold exactly one of {", ".join(self._kinds)}')
        ((kind, content),) = value.items()
        made, keys, required = self._kinds[kind]
        along_path = issubclass(made, PathMove)
        with at(place_in(value, kind)):
            allowed = {*keys, *(_PATH_KEYS if along_path else ())}
            fields = Section(content, f'{where}.{kind}', self._errors, allowed, required)
            # a key that is left out has the default of its field
            there = {key: name_read for key, name_read in keys.items() if key in fields or key in required}
            values = {name: fields.read(key, read) for key, (name, read) in there.items()}
            if along_path:
                optimal = values['time_optimal'] = fields.read('time_optimal', flag, self._time_optimal)
                own = _given_limits(fields)
                if 'torque_rate_n_m_s' in own and not optimal:
                    refuse(
                        f'{where}.{kind}.torque_rate_n_m_s is a limit of time-optimal moves: add time_optimal: true'
                    )
                given = {**self._limits, **own}
                values['limits'] = _limits_of(given, self._defaults, optimal)
                values['torque_rate_n_m_s'] = (
                    given.get('torque_rate_n_m_s', math.inf) if optimal else math.inf
                )
                values['blend_m'] = fields.read('blend_m', _blend, 0.0)
                values['strict'] = fields.read('strict', flag, False)
            return made(**values)

    def _target(self, value: Any, where: str) -> Target | None:
        if not isinstance(value, dict):
            point = _point(value, where, self._points)
            return None if point is None else Target(point)
        fields = Section(value, where, self._errors, ('point', 'by_m'), ('by_m',))
        step = fields.read('by_m', lambda step, name: _point(step, name, {}))
        if 'point' not in fields:
            return None if step is None else Target(step, relative=True)
        point = fields.read('point', lambda name, place: _point(name, place, self._points))
        if point is None or step is None:
            return None
        return Target((point[0] + step[0], point[1] + step[1], point[2] + step[2]))

    def _keep_out(self, value: Any, where: str) -> KeepOut:
        fields = Section(value, where, self._errors, ('height_m', 'margin_m'), ('height_m',))
        return KeepOut(
            fields.read('height_m', number_between(-REACH_M, REACH_M), 0.0),
            fields.read('margin_m', number_between(0.0, REACH_M), 0.0),
        )

    def _joint_points(self, points: Any, where: str) -> tuple[JointPoint, ...]:
        if not isinstance(points, list) or not points:
            refuse(f'{where} must be a list of at least one point')
        if len(points) > JOINT_POINTS_MAX:
            refuse(f'{where} has {len(points)} points, the limit is {JOINT_POINTS_MAX}')
        return _each(points, where, self._errors, self._joint_point)

    def _joint_point(self, value: Any, where: str) -> JointPoint:
        required = ('angles_rad', 'time_s')
        allowed = (*required, 'accelerations_rad_s2', 'speeds_rad_s')
        fields = Section(value, where, self._errors, allowed, required)
        return JointPoint(
            fields.read('time_s', number_between(0.0, TIME_MAX_S), 0.0),
            fields.read('angles_rad', lambda angles, name: _vector(angles, name, 'rad'), (0.0, 0.0, 0.0)),
            fields.read('speeds_rad_s', lambda speeds, name: _vector(speeds, name, 'rad/s'), None),
            fields.read('accelerations_rad_s2', lambda values, name: _vector(values, name, 'rad/s2'), None),
        )

    def _through(self, points: Any, where: str) -> tuple[Target, ...]:
        if not isinstance(points, list) or not points:
            refuse(f'{where} must be a list of at least one point')
        if len(points) > SPLINE_POINTS_MAX:
            refuse(f'{where} has {len(points)} points, the limit is {SPLINE_POINTS_MAX}')
        return _each(points, where, self._errors, self._target)
