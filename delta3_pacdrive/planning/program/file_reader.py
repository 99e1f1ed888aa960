"""Motion programs: a strict reader of YAML files and of single statements.

name: pick and place            # optional
start_m: [0.0, 0.0, -0.75]      # optional: required position of the robot
start_turn_deg: 0.0             # optional, with a rotary axis: required angle of its tool; a list for several axes
repeat: 1                       # optional
payload_kg: 0.0                 # optional: carried at the start
time_optimal: false             # optional: as fast as the motors allow; also in each move
in_position: false              # optional: wait at each exact stop until the robot is in position; also in each move
constant_speed: false           # optional: reject a path whose speed is not constant; also in each move
limits: {speed_m_s: 1.5, acceleration_m_s2: 15.0, jerk_m_s3: 600.0}     # optional, each; torque_rate_n_m_s if optimal
frames: {box: {origin_m: [0.1, 0.0, -0.9], yaw_deg: 30}}      # optional; or taught_m: 3 points; parents first
frame: box                      # optional: frame of the points; also in each move and in each point
tools: {cup: {offset_m: [0.0, 0.0, -0.06], mass_kg: 0.2}}               # optional
tool: cup                       # optional: its working point is positioned; also in each move
patterns: {tray: {frame: box, rows: 2, columns: 3, pitch_m: [0.04, 0.05], layers: 2, height_m: 0.03, order: snake}}
points: {pick: [0.15, 0.0, -0.85], above: {point: pick, by_mm: [0, 0, 50]}}   # optional: named points
points_mm: {place: [-150, 0, -850]}                                   # keys in _m and _rad also exist in _mm and _deg
moves:
- move_l: {to_m: [0.3, 0.0, -0.8], speed_m_s: 1.0, blend_m: 0.02}     # each move may have its own limits
- move_l: {to_m: pick}                                                # a named point
- move_l: {to_m: {by_m: [0.0, 0.0, 0.02]}}                            # relative to the current position
- move_l: {to_m: {point: pick, by_m: [0.0, 0.0, 0.1]}, strict: true}  # relative to a point; never slowed down
- move_c: {via_m: [0.1, 0.1, -0.8], to_m: [0.0, 0.2, -0.8]}           # circle through a point
- move_c: {via_m: [0.1, 0.1, -0.8], to_m: [0.0, 0.2, -0.8], angle_deg: 720}    # two turns on the circle through these
- move_sb: {through_m: [[0.1, 0.0, -0.8], pick]}                      # spline through at most 100 points
- move_l: {to_m: pick, turn_deg: 90}      # the tool rotates during the move; or turn_deg: {by_deg: 45}, relative
- move_l: {to_m: pick, turn_deg: [90, -10]}                       # an angle for each of several rotary axes
- turn: {to_deg: 0}                                                   # and at rest
- arch: {to_m: pick, up_m: 0.01, down_m: 0.01, keep_out: {height_m: -0.8, margin_m: 0.05}, aim: time}   # best shape
- cubic: {to_m: pick, duration_s: 0.5, end_velocity_m_s: [0, 0, 0]}   # chapter 5; starts with the preceding velocity
- joints: {points: [{time_s: 0.5, angles_rad: [0.2, 0.3, 0.2], speeds_rad_s: [0, 0, 0]}]}   # arm angles over time
- dwell: {time_s: 0.1}
- output: {name: gripper, value: true, before_m: 0.005, payload_kg: 0.5}
- output: {name: gripper, value: true, before_s: 0.02}                # or after_s, after_m, in_time (by its cell)
- for_each: {place_of: tray, moves: [{move_l: {to_m: [0, 0, 0]}}]}    # points are relative to each place of a pattern
faults:                                                           # optional: injected faults, see robot/faults/fault.py
- {fault: drop_at, axis: axis2, after_s: 0.3}                         # bus time from the start of the program
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import packaged, yaml_file
from delta3_pacdrive.configuration.strict_reader import Errors, Section, nearest_of, read_document, refuse
from delta3_pacdrive.configuration.value_readers import flag, whole_number_between
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.parameters import Motion, config_directory
from delta3_pacdrive.planning.limits.limit_reader import LIMIT_KEYS, given_limits
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program.frame_reader import Places, read_frames, read_patterns, read_tools
from delta3_pacdrive.planning.program.frames import BASE, Frame, Tool
from delta3_pacdrive.planning.program.model import TIME_MAX_S, Point, Program, Statement
from delta3_pacdrive.planning.program.output_names import OWN, OutputNames
from delta3_pacdrive.planning.program.point_reader import NAME, NAME_MAX, Named, PointReader, Setting, named
from delta3_pacdrive.planning.program.statement_reader import (
    Head,
    StatementReader,
    each,
    payload,
    per_rotary_axis,
    turn,
)
from delta3_pacdrive.robot.faults.fault import Fault, read_fault

__all__ = [
    'FAULTS_MAX',
    'NAME_MAX',
    'REPEAT_MAX',
    'STATEMENTS',
    'TIME_MAX_S',
    'find',
    'load',
    'packaged_names',
    'parse',
]

REPEAT_MAX = 10_000
STATEMENTS = ('move_l', 'move_c', 'move_sb', 'arch', 'cubic', 'joints', 'turn', 'dwell', 'output')
FAULTS_MAX = 1000


def load(path: str | Path, motion: Motion, outputs: OutputNames = OWN) -> Program:
    """Read a program file; a bare name also finds packaged programs.

    ``outputs`` are the available output names (default: those of the robot without a cell).

    Raises
    ------
    ProgramError
        The file cannot be read or violates a rule; states place and rule.

    """
    file = find(path)
    if file.parent == Path() and not file.exists():
        names = packaged_names()
        raise ProgramError(
            f'cannot read program file {path}: No such file or directory; packaged programs are {", ".join(names)}'
            f'{nearest_of(file.name.removesuffix(".yaml"), names)}'
        )
    document = yaml_file.read(file, 'program file', ProgramError)
    return parse(document, motion, Path(path).stem, str(path), outputs)


def find(path: str | Path) -> Path:
    """Return the path itself, or the packaged program of that name."""
    path = Path(path)
    own = config_directory() / 'programs' / f'{path.name}.yaml'
    if not packaged.is_own(path) and path.parent == Path() and own.exists():
        return own
    return path


def packaged_names() -> list[str]:
    """Return the names of the packaged programs."""
    return packaged.program_names()


def parse(
    document: Any, motion: Motion, name: str = 'program', file: str = '', outputs: OutputNames = OWN
) -> Program:
    """Build a program from a parsed YAML document; ``file`` is the name used for an empty document.

    ``outputs`` are the available output names.

    Raises
    ------
    ProgramError
        Values violate rules; states places and rules, up to ten.

    """
    program = read_document(
        document, file, ProgramError, lambda value, errors: _program(value, motion, name, errors, outputs)
    )
    source = getattr(document, 'source', '')
    if source or any(place and place.line > 1 for place in program.places):
        return replace(program, source=source)
    return replace(program, places=())  # a single line needs no places


def _program(document: Any, motion: Motion, name: str, errors: Errors, outputs: OutputNames) -> Program:
    """Build a program; the result is invalid if errors were collected."""
    allowed = (
        'name',
        'start_m',
        'start_turn_rad',
        'repeat',
        'payload_kg',
        'time_optimal',
        'in_position',
        'constant_speed',
        'limits',
        'frames',
        'frame',
        'tools',
        'tool',
        'patterns',
        'points',
        'points_mm',
        'moves',
        'faults',
    )
    fields = Section(document, 'the program', errors, allowed, ('moves',))
    limits = fields.read(
        'limits',
        lambda value, where: given_limits(
            Section(value, where, errors, LIMIT_KEYS), motion.tcp_speed_limit_m_s
        ),
        {},
        prefix='',
    )
    time_optimal = fields.read('time_optimal', flag, False, prefix='')
    in_position = fields.read('in_position', flag, False, prefix='')
    constant_speed = fields.read('constant_speed', flag, False, prefix='')
    frames: Named[Frame] = {BASE.name: BASE}
    tools: Named[Tool] = {}
    patterns: Named[Places] = {}
    fields.read('frames', lambda value, where: read_frames(value, where, errors, frames), prefix='')
    fields.read('tools', lambda value, where: read_tools(value, where, errors, tools), prefix='')
    frame = fields.read('frame', lambda value, where: named(value, where, frames, 'frame'), prefix='')
    tool = fields.read('tool', lambda value, where: named(value, where, tools, 'tool'), prefix='')
    fields.read(
        'patterns',
        lambda value, where: read_patterns(
            value, where, errors, found=patterns, frames=frames, default=frame
        ),
        prefix='',
    )
    setting = Setting(frame, tool, frames)
    points = PointReader(errors)
    for key in ('points', 'points_mm'):
        fields.read(key, lambda value, where: points.add(value, where, setting), prefix='')
    head = Head(
        Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3),
        motion.tcp_speed_limit_m_s,
        limits,
        time_optimal=time_optimal,
        in_position=in_position,
        constant_speed=constant_speed,
        setting=setting,
        tools=tools,
        patterns=patterns,
        repeat=fields.read('repeat', whole_number_between(1, REPEAT_MAX), 1, prefix=''),
        outputs=outputs,
    )

    def start(value: Any, where: str) -> Point | None:
        place = points.place_m(value, where, setting)
        return None if place is None else setting.plate_m(place)

    def faults(value: Any, where: str) -> tuple[Fault, ...]:
        if not isinstance(value, list) or len(value) > FAULTS_MAX:
            refuse(f'{where} must be a list of at most {FAULTS_MAX} faults')
        return each(value, where, errors, lambda item, name: read_fault(item, name, errors))

    read = fields.read('moves', StatementReader(head, points, errors).statements, (), prefix='')
    carried = payload(0.0, 'payload_kg', head.tool_kg) if head.tool_kg else None
    return Program(
        name=fields.read('name', NAME, NAME(name, 'name'), prefix=''),
        statements=tuple(one.statement for one in read),
        start_m=fields.read('start_m', start, prefix=''),
        repeat=head.repeat,
        payload_kg=fields.read(
            'payload_kg', lambda value, where: payload(value, where, head.tool_kg), carried, prefix=''
        ),
        faults=fields.read('faults', faults, (), prefix=''),
        start_turns_rad=fields.read(
            'start_turn_rad',
            lambda value, where: per_rotary_axis(value, where, turn),
            (),
            prefix='',
        ),
        places=tuple(one.place for one in read),
        names=tuple(one.name for one in read),
    )


def read_statement(
    kind: str,
    keys: Mapping[str, Any],
    motion: Motion,
    frame: Frame | None = None,
    tool: Tool | None = None,
    outputs: OutputNames = OWN,
) -> Statement:
    """Build a statement as in a program.

    Parameters
    ----------
    kind, keys
        Kind of the statement, such as ``move_l``, and its keys.
    motion
        Default limits.
    frame, tool
        Default frame of points, and tool whose working point is positioned.
    outputs
        Available output names.

    Raises
    ------
    ProgramError
        A rule is violated; states up to ten errors.

    """
    defaults = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
    head = Head(
        defaults, motion.tcp_speed_limit_m_s, setting=Setting(frame, tool, {BASE.name: BASE}), outputs=outputs
    )

    def read(document: Any, errors: Errors) -> Statement:
        found = StatementReader(head, PointReader(errors), errors).statements(document, 'moves')
        return found[0].statement if found else None  # type: ignore[return-value]  # the errors are raised

    return read_document([{kind: dict(keys)}], '', ProgramError, read)
