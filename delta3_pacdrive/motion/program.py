"""Motion programs: a strict reader of YAML files, and the planning of their moves.

name: pick and place            # optional
start_m: [0.0, 0.0, -0.75]      # optional: where the robot must stand
repeat: 1                       # optional
limits: {speed_m_s: 1.5, acceleration_m_s2: 15.0, jerk_m_s3: 600.0}     # optional, each
moves:
- move_l: {to_m: [0.3, 0.0, -0.8], speed_m_s: 1.0}                    # limits may stand in each move
- dwell: {time_s: 0.1}
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive import yaml_file
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.motion.checks import check_move
from delta3_pacdrive.motion.master import plan_master, rest
from delta3_pacdrive.motion.path import line, point
from delta3_pacdrive.motion.plan import MOVES_MAX, Move, MoveKind
from delta3_pacdrive.parameters import Motion, Parameters, config_directory

START_TOLERANCE_M = (
    1e-3  # how far the robot may stand from the start of a program; the first move begins there
)
COINCIDENT_M = 1e-6
REPEAT_MAX = 10_000
MOVE_MAX_S = 3600.0

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Limits:
    """TCP limits of a move."""

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float


@dataclass(frozen=True)
class MoveL:
    """Straight line to a point (6.1)."""

    to_m: Point
    limits: Limits


@dataclass(frozen=True)
class Dwell:
    """Rest at the present point."""

    time_s: float


Statement = MoveL | Dwell


@dataclass(frozen=True)
class Program:
    """Statements to run ``repeat`` times."""

    name: str
    statements: tuple[Statement, ...]
    start_m: Point | None = None
    repeat: int = 1


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


def parse(document: Any, motion: Motion, name: str = 'program') -> Program:
    """Build a program from a parsed YAML document; raises ProgramError."""
    fields = _mapping(document, 'the program', {'name', 'start_m', 'repeat', 'limits', 'moves'}, {'moves'})
    defaults = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
    limits = _limits(_mapping(fields.get('limits', {}), 'limits', _LIMIT_KEYS, set()), defaults, 'limits')
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
    statements = tuple(_statement(item, f'moves[{n}]', limits) for n, item in enumerate(moves))
    start = _point(fields['start_m'], 'start_m') if 'start_m' in fields else None
    title = fields.get('name', name)
    if not isinstance(title, str):
        raise ProgramError(f'name must be a text, not {shown(title)}')
    return Program(title, statements, start, repeat)


_LIMIT_KEYS = {'speed_m_s', 'acceleration_m_s2', 'jerk_m_s3'}


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


def _point(value: Any, where: str) -> Point:
    if not isinstance(value, list) or len(value) != 3:
        raise ProgramError(f'{where} must be a list of 3 numbers [m], not {shown(value)}')
    x, y, z = (_number(item, f'{where}[{n}]') for n, item in enumerate(value))
    if not all(math.isfinite(item) for item in (x, y, z)):
        raise ProgramError(f'{where} must be finite, not {shown(value)}')
    if max(abs(x), abs(y), abs(z)) > 10.0:
        raise ProgramError(f'{where} is {shown(value)} m, farther than 10 m: are these millimetres?')
    return x, y, z


def _limits(fields: dict[str, Any], defaults: Limits, where: str) -> Limits:
    values = {}
    for key in ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3'):
        value = _number(fields.get(key, getattr(defaults, key)), f'{where}.{key}')
        if not value > 0.0 or (math.isinf(value) and key != 'jerk_m_s3'):
            raise ProgramError(f'{where}.{key} is {value}, but must be a positive number')
        values[key] = value
    return Limits(**values)


def _parse_move_l(value: Any, where: str, limits: Limits) -> Statement:
    fields = _mapping(value, where, {'to_m', *_LIMIT_KEYS}, {'to_m'})
    return MoveL(_point(fields['to_m'], f'{where}.to_m'), _limits(fields, limits, where))


def _parse_dwell(value: Any, where: str, _: Limits) -> Statement:
    fields = _mapping(value, where, {'time_s'}, {'time_s'})
    time = _number(fields['time_s'], f'{where}.time_s')
    if not 0.0 < time <= MOVE_MAX_S:
        raise ProgramError(f'{where}.time_s is {time}, but must be positive and at most {MOVE_MAX_S:g}')
    return Dwell(time)


_PARSERS: dict[str, Callable[[Any, str, Limits], Statement]] = {
    'move_l': _parse_move_l,
    'dwell': _parse_dwell,
}


def _statement(value: Any, where: str, limits: Limits) -> Statement:
    fields = _mapping(value, where, set(_PARSERS), set())
    if len(fields) != 1:
        raise ProgramError(f'{where} must hold exactly one of {", ".join(_PARSERS)}')
    ((kind, content),) = fields.items()
    return _PARSERS[kind](content, f'{where}.{kind}', limits)


def plan(program: Program, position_m: ArrayLike, parameters: Parameters) -> list[Move]:
    """Plan and check every move of a program for a robot that stands at ``position_m``.

    Raises
    ------
    ProgramError
        The robot stands elsewhere than the program starts, or a move breaks a limit; says which, how and where.

    """
    here = np.array(position_m, dtype=np.float64)
    if program.start_m is not None:
        distance = float(np.linalg.norm(here - program.start_m))
        if distance > START_TOLERANCE_M:
            raise ProgramError(
                f'program "{program.name}" starts at {_text(program.start_m)} m, but the robot stands at '
                f'{_text(here)} m, {distance * 1e3:.1f} mm away'
            )
    moves: list[Move] = []
    known: dict[tuple[Point, Statement], Move] = {}
    for _ in range(program.repeat):
        for n, statement in enumerate(program.statements):
            key = (tuple(here.tolist()), statement)
            if key not in known:
                known[key] = _plan_statement(here, statement, f'moves[{n}]', parameters)
            moves.append(known[key])
            here = np.array(statement.to_m) if isinstance(statement, MoveL) else here
    return moves


def _plan_statement(here: Any, statement: Statement, where: str, parameters: Parameters) -> Move:
    if isinstance(statement, Dwell):
        return Move(MoveKind.DWELL, rest(statement.time_s), point(here))
    segments, length = line(here, statement.to_m)
    if length < COINCIDENT_M:
        raise ProgramError(f'{where}.move_l: the robot already stands at {_text(statement.to_m)} m')
    limits = statement.limits
    try:
        master = plan_master(length, limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
        move = Move(MoveKind.LINE, master, segments)
        if move.duration_s > MOVE_MAX_S:
            raise ProgramError(f'it would take {move.duration_s:.3g} s, the limit is {MOVE_MAX_S:g} s')
        check_move(move, parameters)
    except ProgramError as error:
        raise ProgramError(f'{where}.move_l to {_text(statement.to_m)} m: {error}') from None
    return move


def _text(point_m: ArrayLike) -> str:
    return '(' + ', '.join(f'{value:g}' for value in np.round(np.asarray(point_m), 6)) + ')'
