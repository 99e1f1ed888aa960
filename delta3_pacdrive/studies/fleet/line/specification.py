"""Strict reader of line files; up to ten errors are reported at once, with file, line and column.

name: two robots at a belt      # optional
seed: 1                         # optional, of the parts
hours: 8                        # optional, of the shift
rule: optimal                   # optional: first come, nearest, balanced, optimal
horizon_s: 12                   # optional, of the optimal rule
parameters: model               # optional, as for delta3 simulate
limits: {speed_m_s: 4, acceleration_m_s2: 40, jerk_m_s3: 4000}      # optional, of the TCP
above_mm: 20                    # optional, height above a part at which the robot gets on and off the belt
grip_s: 0.04                    # optional
release_s: 0.02                 # optional
decision_s: 0.029               # optional, time of the robot's script for the decisions of a cycle
parts:
  bar: {mass_kg: 0.2, height_mm: 20, share: 0.7}        # share: optional, 1
belts:
  infeed: {speed_m_s: 0.5, rate_per_min: 150, noise: 0.3, spread_mm: 40}        # noise, spread: optional, 0
robots:                         # along their belts; middle_mm: middle of the belt in the frame of the robot
  robot1: {belt: infeed, at_mm: 800, middle_mm: [0, 100, -870], window_mm: [-250, 300], place_mm: [0, -200, -850]}
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from delta3_pacdrive import parameters as core
from delta3_pacdrive.belts.synchronization import TrackLimits, TrackWindow, Vector
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.source_positions import numbered, place_in, place_of
from delta3_pacdrive.configuration.strict_reader import Errors, Section, refuse
from delta3_pacdrive.configuration.value_readers import (
    line_of_text,
    number_between,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import LineError, shown
from delta3_pacdrive.studies.fleet.line.design import Line, LineBelt, LineRobot, PartKind, Rule

KINDS_MAX, BELTS_MAX, ROBOTS_MAX = 20, 10, 50
NAME_MAX = 40
REACH_M, BELT_MAX_M = 2.0, 1000.0
PARTS_MAX = 2_000_000  # per shift
KEYS = (
    'name', 'seed', 'hours', 'rule', 'horizon_s', 'parameters', 'limits', 'above_m', 'grip_s', 'release_s',
    'decision_s', 'parts',
    'belts', 'robots',
)  # fmt: skip
DECISION_S = (
    0.029  # measured by delta3 line --replay: bus cycles from the end of a cycle to the begin of the next
)
LIMITS = TrackLimits(4.0, 40.0, 4000.0)
One = TypeVar('One')


def find(path: str | Path) -> Path:
    """Return ``path`` itself, or the packaged line for the name ``line`` without a file of this name."""
    path = Path(path)
    return path if path != Path('line') or path.is_file() else core.config_directory() / 'line.yaml'


def load(path: str | Path) -> Line:
    """Read the file of a line; raises LineError, or ParameterError for its parameters."""
    path = Path(path)
    return parse(yaml_file.read(path, 'line', LineError), path)


def parse(document: Any, path: Path) -> Line:
    """Read a document from the file ``path``; raises as ``load``."""
    errors = Errors(str(path))
    found: list[Line] = []
    with errors.raised_as(LineError), errors.noted(place_of(document)):
        found.append(_line(document, path, errors))
    return found[0]


def _line(document: Any, path: Path, errors: Errors) -> Line:
    fields = Section(document, 'the line', errors, KEYS, ('parts', 'belts', 'robots'))

    def several(key: str, most: int, read: Callable[[str, Any, str], One]) -> tuple[One, ...]:
        return fields.read(key, partial(_named, errors, most, read), (), prefix='')

    kinds = several('parts', KINDS_MAX, partial(_kind, errors))
    belts = several('belts', BELTS_MAX, partial(_belt, errors))
    robots = several('robots', ROBOTS_MAX, partial(_robot, errors, [belt.name for belt in belts]))
    hours = fields.read('hours', number_between(1e-3, 24.0), 8.0, prefix='')
    if sum(belt.rate_per_min for belt in belts) * hours * 60.0 > PARTS_MAX:
        refuse(f'in {hours:g} h more than {PARTS_MAX} parts would arrive', place_in(document, 'belts'))
    named = fields.read('parameters', line_of_text(1000), None, prefix='')
    return Line(
        name=fields.read('name', line_of_text(60), path.stem, prefix=''),
        seed=fields.read('seed', whole_number_between(0, 2**31 - 1), 1, prefix=''),
        hours=hours,
        rule=Rule(fields.read('rule', one_of(tuple(Rule)), Rule.OPTIMAL, prefix='')),
        horizon_s=fields.read('horizon_s', number_between(0.1, 60.0), 12.0, prefix=''),
        limits=fields.read('limits', partial(_limits, errors), LIMITS, prefix=''),
        above_m=fields.read('above_m', number_between(1e-3, 0.3), 0.02, prefix=''),
        grip_s=fields.read('grip_s', number_between(0.0, 10.0), 0.04, prefix=''),
        release_s=fields.read('release_s', number_between(0.0, 10.0), 0.02, prefix=''),
        decision_s=fields.read('decision_s', number_between(0.0, 10.0), DECISION_S, prefix=''),
        kinds=kinds,
        belts=belts,
        robots=tuple(sorted(robots, key=lambda robot: (robot.belt, robot.at_m))),
        parameters=core.load(core.of_run(named)),
    )


def _named(
    errors: Errors, most: int, read: Callable[[str, Any, str], One], value: Any, where: str
) -> tuple[One, ...]:
    """Read a mapping from names to objects."""
    if not isinstance(value, Mapping) or not 1 <= len(value) <= most:
        refuse(f'{where} must be a mapping of 1 to {most} names, not {shown(value)}')
    found = []
    for name, one in value.items():
        with errors.noted(place_in(value, name)):
            line_of_text(NAME_MAX)(name, f'a name in {where}')
            found.append(read(name, one, f'{where}.{name}'))
    return tuple(found)


def _kind(errors: Errors, name: str, value: Any, where: str) -> PartKind:
    fields = Section(value, where, errors, ('mass_kg', 'height_m', 'share'), ('mass_kg', 'height_m'))
    return PartKind(
        name,
        fields.read('mass_kg', number_between(0.0, 100.0), 0.0),
        fields.read('height_m', number_between(1e-4, 0.5), 0.01),
        fields.read('share', number_between(1e-6, 1e6), 1.0),
    )


def _belt(errors: Errors, name: str, value: Any, where: str) -> LineBelt:
    keys = ('speed_m_s', 'rate_per_min')
    fields = Section(value, where, errors, (*keys, 'noise', 'spread_m'), keys)
    return LineBelt(
        name,
        fields.read('speed_m_s', number_between(0.01, 5.0), 1.0),
        fields.read('rate_per_min', number_between(0.01, 1e5), 1.0),
        fields.read('noise', number_between(0.0, 1.0), 0.0),
        fields.read('spread_m', number_between(0.0, 0.5), 0.0),
    )


def _robot(errors: Errors, belts: list[str], name: str, value: Any, where: str) -> LineRobot:
    keys = ('belt', 'at_m', 'middle_m', 'window_m', 'place_m')
    fields = Section(value, where, errors, keys, keys)
    return LineRobot(
        name=name,
        belt=fields.read('belt', one_of(belts) if belts else _no_belts, ''),
        at_m=fields.read('at_m', number_between(0.0, BELT_MAX_M), 0.0),
        middle_m=fields.read('middle_m', _point, (0.0, 0.0, 0.0)),
        window=fields.read('window_m', _window, TrackWindow(0.0, 1.0)),
        place_m=fields.read('place_m', _point, (0.0, 0.0, 0.0)),
    )


def _no_belts(value: Any, where: str) -> str:
    refuse(f'{where} is {shown(value)}, but the line has no belts')


def _numbers(count: int, value: Any, where: str) -> tuple[float, ...]:
    if not isinstance(value, list) or len(value) != count:
        refuse(f'{where} must be a list of {count} numbers, not {shown(value)}')
    read = number_between(-REACH_M, REACH_M)
    return tuple(read(one, own) for one, own, _ in numbered(value, where))


def _point(value: Any, where: str) -> Vector:
    x, y, z = _numbers(3, value, where)
    return x, y, z


def _window(value: Any, where: str) -> TrackWindow:
    begin, end = _numbers(2, value, where)
    if not begin < end:
        refuse(f'{where} is from {begin:g} m to {end:g} m, but the end must be after the begin')
    return TrackWindow(begin, end)


def _limits(errors: Errors, value: Any, where: str) -> TrackLimits:
    keys = ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')
    fields = Section(value, where, errors, keys, keys)
    least = 2.0 * TrackLimits.belt_acceleration_m_s2  # half is reserved for belts that change their speed
    return TrackLimits(
        fields.read('speed_m_s', number_between(0.01, 20.0), LIMITS.speed_m_s),
        fields.read('acceleration_m_s2', number_between(least, 1e4), LIMITS.acceleration_m_s2),
        fields.read('jerk_m_s3', number_between(1.0, 1e6), LIMITS.jerk_m_s3),
    )
