"""Tests of program files: meaning of each statement, and the message for invalid statements."""

import itertools
import json
import math

import pytest
import yaml

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Cubic, Dwell, MoveC, MoveL, MoveSB, Output, Program, Target
from programs_read import parse, refusal


def statement(document, robot, **fields):
    """Return the only statement of a program."""
    (found,) = parse({'moves': [document], **fields}, robot).statements
    return found


def to(x, y, z, **options):
    return {'move_l': {'to_m': [x, y, z], **options}}


# what statements mean


def test_a_program_is_its_name_statements_start_repeats_and_payload(robot):
    limits = Limits(1.5, 15.0, 600.0)
    assert parse({'moves': [to(0, 0, -0.8)]}, robot) == Program(
        'program', (MoveL(Target((0.0, 0.0, -0.8)), limits=limits),), None, 1, None
    )
    document = {
        'name': 'x',
        'start_m': [0, 0, -0.75],
        'repeat': 2,
        'payload_kg': 1,
        'moves': [{'dwell': {'time_s': 1}}],
    }
    assert parse(document, robot) == Program('x', (Dwell(1.0),), (0.0, 0.0, -0.75), 2, 1.0)


def test_every_kind_of_statement_is_read(robot):
    limits = Limits(1.5, 15.0, 600.0)
    near, far = Target((0.1, 0.0, -0.8)), Target((0.0, 0.2, -0.8))
    assert statement(to(0.1, 0, -0.8, blend_m=0.02, strict=True), robot) == MoveL(
        near, limits=limits, blend_m=0.02, strict=True
    )
    circle = {'move_c': {'via_m': [0.1, 0, -0.8], 'to_m': [0, 0.2, -0.8]}}
    assert statement(circle, robot) == MoveC(near, far, limits=limits)
    spline = {'move_sb': {'through_m': [[0.1, 0, -0.8], [0, 0.2, -0.8]], 'blend_m': 0.01}}
    assert statement(spline, robot) == MoveSB((near, far), limits=limits, blend_m=0.01)
    cubic = {'cubic': {'to_m': [0.1, 0, -0.8], 'duration_s': 0.5, 'end_velocity_m_s': [0, 1, 0.5]}}
    assert statement(cubic, robot) == Cubic(near, 0.5, (0.0, 1.0, 0.5))
    del cubic['cubic']['end_velocity_m_s']
    assert statement(cubic, robot) == Cubic(near, 0.5)
    assert statement({'dwell': {'time_s': 0.25}}, robot) == Dwell(0.25)
    output = {'output': {'name': 'gripper', 'value': True, 'before_m': 0.005, 'payload_kg': 0.50004}}
    assert statement(output, robot) == Output('gripper', 1.0, 0.005, 0.5)  # payloads in steps of 0.1 g
    assert statement({'output': {'name': 'output7', 'value': False}}, robot) == Output('output7', 0.0)


def test_a_point_is_given_by_numbers_by_its_name_or_by_a_step(robot):
    points = {'pick': [0.1, 0.2, -0.8]}
    cases = {
        Target((0.1, 0.2, -0.8)): 'pick',
        Target((0.0, 0.0, 0.05), relative=True): {'by_m': [0, 0, 0.05]},
        Target((0.1, 0.2, -0.75)): {'point': 'pick', 'by_m': [0, 0, 0.05]},
        Target((0.1, 0.0, -0.75)): {'point': [0.1, 0, -0.8], 'by_m': [0, 0, 0.05]},
    }
    for expected, given_ in cases.items():
        found = statement({'move_l': {'to_m': given_}}, robot, points=points).to
        assert (found.relative, found.point_m) == (expected.relative, pytest.approx(expected.point_m))
    start = parse({'start_m': 'pick', 'points': points, 'moves': [to(0, 0, -0.8)]}, robot).start_m
    assert start == (0.1, 0.2, -0.8)


def test_limits_are_those_of_the_move_else_the_program_else_the_robot(robot):
    fast = {'speed_m_s': 2.0, 'jerk_m_s3': math.inf}
    program = parse({'limits': fast, 'moves': [to(0, 0, -0.8, speed_m_s=0.5), to(0, 0, -0.7)]}, robot)
    own, common = (statement.limits for statement in program.statements)
    assert own == Limits(0.5, 15.0, math.inf)
    assert common == Limits(2.0, 15.0, math.inf)


def test_one_hundred_points_are_read_and_not_101(robot):
    through = [[0.001 * n, 0.0, -0.8] for n in range(101)]
    assert len(statement({'move_sb': {'through_m': through[:100]}}, robot).through) == 100
    sentence = refusal(statement, {'move_sb': {'through_m': through}}, robot)
    assert sentence == 'moves[0].move_sb.through_m holds 101 entries, but must hold 1 to 100'


# what is refused


GOOD = {
    'name': 'x',
    'start_m': [0, 0, -0.75],
    'repeat': 2,
    'limits': {'speed_m_s': 1},
    'moves': [to(0, 0, -0.8)],
}


def changed(**fields):
    return {**GOOD, **fields}


def only(**kind):
    """Return a program of one statement."""
    return changed(moves=[kind])


@pytest.mark.parametrize(
    ('document', 'reason'),
    [
        (None, 'the program must be a mapping, not None'),
        ([], 'the program must be a mapping, not []'),
        ('moves', "the program must be a mapping, not 'moves'"),
        ({}, 'the program: missing key moves'),
        (
            changed(speed=1),
            "unknown key 'speed', expected one of constant_speed, faults, frame, frames, in_position, limits, moves, "
            'name, patterns, payload_kg, points, points_mm, repeat, start_m',
        ),
        (changed(**{'': 1}), "unknown key ''"),
        ({**GOOD, 1: 2}, 'unknown key 1'),
        (changed(name=3), 'name must be a text, not 3'),
        (changed(name='a\nb'), "name must be one line of at most 100 characters, not 'a\\nb'"),
        (changed(name='x' * 101), 'name must be one line of at most 100 characters, not '),
        (changed(repeat=0), 'repeat is 0, but must be a whole number between 1 and 10000'),
        (changed(repeat=1.5), 'repeat is 1.5'),
        (changed(repeat=True), 'repeat is True'),
        (changed(repeat=10_001), 'repeat is 10001'),
        (changed(repeat='2'), "repeat is '2'"),
        (changed(payload_kg=-1), 'payload_kg is -1, but must be between 0 and 10'),
        (changed(payload_kg=10.001), 'payload_kg is 10.001, but must be between 0 and 10'),
        (changed(payload_kg='1'), "payload_kg must be a number, not '1'"),
        (changed(moves=[]), 'moves must be a list of at least one move'),
        (changed(moves=None), 'moves must be a list'),
        (changed(moves={'move_l': {}}), 'moves must be a list'),
        (
            changed(repeat=10_000, moves=[to(0, 0, -0.8)] * 3),
            'the program has 30000 moves, the limit is 20000',
        ),
        (changed(moves=['go']), "moves[0] must be a mapping, not 'go'"),
        (
            changed(moves=[to(0, 0, -0.8), {}]),
            'moves[1] must hold exactly one of move_l, move_c, move_sb, arch, cubic, joints, turn, dwell, output, '
            'for_each',
        ),
        (changed(moves=[{'dwell': {'time_s': 1}, 'move_l': {}}]), 'moves[0] must hold exactly one of '),
        (only(jump=1), "moves[0]: unknown key 'jump'"),
        (only(move_l=None), 'moves[0].move_l must be a mapping, not None'),
        (only(move_l={}), 'moves[0].move_l: missing key to_m'),
        (only(move_l={'to_m': [0, 0, -0.8], 'to': 1}), "moves[0].move_l: unknown key 'to'"),
        (only(move_l={'to_m': [0, 0]}), 'moves[0].move_l.to_m must be a list of 3 numbers [m]'),
        (only(move_l={'to_m': 'home'}), "moves[0].move_l.to_m: unknown point 'home', the points are: none"),
        (changed(moves=[to(0, 'a', -0.8)]), "moves[0].move_l.to_m[1] must be a number, not 'a'"),
        (changed(moves=[to(0, True, -0.8)]), 'moves[0].move_l.to_m[1] must be a number, not True'),
        (changed(moves=[to(0, math.nan, -0.8)]), 'moves[0].move_l.to_m[1] must be a number, not nan'),
        (changed(moves=[to(0, math.inf, -0.8)]), 'moves[0].move_l.to_m must be finite'),
        (changed(moves=[to(0, 0, -750)]), 'farther than 10 m: are these millimetres?'),
        (
            changed(moves=[to(0, 0, -0.8, blend_m=-0.1)]),
            'moves[0].move_l.blend_m is -0.1, but must be between 0 and 1',
        ),
        (
            changed(moves=[to(0, 0, -0.8, blend_m=20)]),
            'moves[0].move_l.blend_m is 20, but must be between 0 and 1',
        ),
        (
            changed(moves=[to(0, 0, -0.8, blend_m=1e-5)]),
            'moves[0].move_l.blend_m is 1e-05, but must be 0 or at least',
        ),
        (changed(moves=[to(0, 0, -0.8, blend_m=None)]), 'moves[0].move_l.blend_m must be a number, not None'),
        (changed(moves=[to(0, 0, -0.8, strict=1)]), 'moves[0].move_l.strict must be true or false, not 1'),
        (only(move_l={'to_m': {}}), 'moves[0].move_l.to_m: missing key by_m'),
        (only(move_l={'to_m': {'by': [0, 0, 0]}}), "moves[0].move_l.to_m: unknown key 'by'"),
        (
            only(move_l={'to_m': {'by_m': 'x'}}),
            "moves[0].move_l.to_m.by_m must be a list of 3 numbers [m], not 'x'",
        ),
        (
            only(move_l={'to_m': {'by_m': [0, 0, 50]}}),
            'moves[0].move_l.to_m.by_m is [0, 0, 50] m, farther than 10 m',
        ),
        (
            only(move_l={'to_m': {'point': 'x', 'by_m': [0, 0, 0]}}),
            "moves[0].move_l.to_m.point: unknown point 'x'",
        ),
        (only(move_c={'to_m': [0, 0, -0.8]}), 'moves[0].move_c: missing key via_m'),
        (only(move_c={'via_m': [0, 0, -0.8]}), 'moves[0].move_c: missing key to_m'),
        (
            only(move_c={'via_m': 5, 'to_m': [0, 0, -0.8]}),
            'moves[0].move_c.via_m must be a list of 3 numbers [m]',
        ),
        (only(move_sb={}), 'moves[0].move_sb: missing key through_m'),
        (
            only(move_sb={'through_m': []}),
            'moves[0].move_sb.through_m holds 0 entries, but must hold 1 to 100',
        ),
        (only(move_sb={'through_m': 'a'}), 'moves[0].move_sb.through_m must be a list, not'),
        (
            only(move_sb={'through_m': [[0, 0, -0.8], [0, 0]]}),
            'moves[0].move_sb.through_m[1] must be a list of 3 numbers',
        ),
        (only(cubic={'to_m': [0, 0, -0.8]}), 'moves[0].cubic: missing key duration_s'),
        (
            only(cubic={'to_m': [0, 0, -0.8], 'duration_s': 0}),
            'moves[0].cubic.duration_s is 0, but must be between 0.001 and 3600',
        ),
        (
            only(cubic={'to_m': [0, 0, -0.8], 'duration_s': 1, 'end_velocity_m_s': [1, 2]}),
            'moves[0].cubic.end_velocity_m_s must be a list of 3 numbers [m/s]',
        ),
        (
            only(cubic={'to_m': [0, 0, -0.8], 'duration_s': 1, 'end_velocity_m_s': [0, 0, 1e300]}),
            'moves[0].cubic.end_velocity_m_s may be up to 100 m/s on each axis',
        ),
        (only(cubic={'to_m': [0, 0, -0.8], 'duration_s': 1, 'speed_m_s': 1}), "unknown key 'speed_m_s'"),
        (only(dwell=1), 'moves[0].dwell must be a mapping, not 1'),
        (only(dwell={'time_s': 0}), 'moves[0].dwell.time_s is 0, but must be positive and at most 3600'),
        (only(dwell={'time_s': 3601}), 'moves[0].dwell.time_s is 3601, but'),
        (only(output={'name': 'gripper'}), 'moves[0].output: missing key value'),
        (
            only(output={'name': 'horn', 'value': True}),
            f"moves[0].output.name is 'horn', but must be one of {', '.join(OUTPUTS)}",
        ),
        (
            only(output={'name': ['gripper'], 'value': True}),
            "moves[0].output.name is ['gripper'], but must be one of",
        ),
        (only(output={'name': 'gripper', 'value': 1}), 'moves[0].output.value must be true or false, not 1'),
        (
            only(output={'name': 'gripper', 'value': True, 'before_m': -1}),
            'moves[0].output.before_m is -1, but must be between 0 and 10',
        ),
        (
            only(output={'name': 'gripper', 'value': True, 'payload_kg': 1e6}),
            'moves[0].output.payload_kg is 1e+06, but must be between 0 and 10',
        ),
        (
            changed(start_m=[0, 0, -750.0]),
            'start_m is [0, 0, -750.0] m, farther than 10 m: are these millimetres?',
        ),
        (changed(start_m=None), 'start_m must be a list of 3 numbers [m], not None'),
        (changed(points=[1]), 'points must be a mapping, not [1]'),
        (changed(points={1: [0, 0, 0]}), 'points: the name of a point must be a text, not 1'),
        (changed(points={'a\nb': [0, 0, 0]}), 'points: the name of a point must be one line of at most 100'),
        (changed(points={'a': 'a'}), "points.a: unknown point 'a'"),
        (changed(points={'a': [0, 0, -800]}), 'points.a is [0, 0, -800] m, farther than 10 m'),
        (
            changed(points={'a': [0, 0, 1]}, moves=[{'move_l': {'to_m': 'b'}}]),
            "unknown point 'b', the points are: 'a'",
        ),
        (changed(limits=[1]), 'limits must be a mapping'),
        (changed(limits={'speed': 1}), "limits: unknown key 'speed'"),
        (changed(limits={'speed_m_s': 0}), 'limits.speed_m_s is 0.0, but must be a positive number'),
        (changed(limits={'speed_m_s': '1'}), "limits.speed_m_s must be a number, not '1'"),
        (changed(limits={'acceleration_m_s2': math.inf}), 'limits.acceleration_m_s2 is inf, but must be'),
        (changed(limits={'jerk_m_s3': -1}), 'limits.jerk_m_s3 is -1.0, but must be'),
        (
            changed(limits={'jerk_m_s3': 1e300}),
            'limits.jerk_m_s3 is 1e+300, but must be between 1e-06 and 1e+09',
        ),
        (changed(moves=[to(0, 0, -0.8, speed_m_s=-2)]), 'moves[0].move_l.speed_m_s is -2.0, but must be'),
        (changed(moves=[to(0, 0, -0.8, speed_m_s=1e-320)]), 'but must be between 1e-06 and 1e+09'),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else '',
)
def test_reader_reports_error_and_place(document, reason, robot):
    assert reason in refusal(parse, document, robot)


@pytest.mark.parametrize('number', [10**400, -(10**400), 16**5000], ids=['10^400', '-10^400', '16^5000'])
@pytest.mark.parametrize(
    'document',
    [
        lambda n: changed(moves=[to(0, 0, n)]),
        lambda n: changed(moves=[to(0, 0, -0.8, blend_m=n)]),
        lambda n: only(dwell={'time_s': n}),
        lambda n: only(cubic={'to_m': [0, 0, -0.8], 'duration_s': n}),
        lambda n: only(output={'name': 'gripper', 'value': n}),
        lambda n: changed(repeat=n),
        lambda n: changed(payload_kg=n),
        lambda n: changed(limits={'jerk_m_s3': n}),
        lambda n: changed(name=n),
        lambda n: changed(points={'a': [n, n, n]}),
        lambda n: {**GOOD, n: 1},
        lambda n: n,
    ],
)
def test_numbers_beyond_all_machine_numbers_are_rejected(document, number, robot):
    refusal(parse, document(number), robot)


@pytest.mark.parametrize(
    ('where', 'document'),
    [
        ('name', lambda text: changed(name=text)),
        ('points', lambda text: changed(points={text: [0, 0]})),
        ('unknown point', lambda text: changed(points={'a': [0, 0, 0]}, moves=[{'move_l': {'to_m': text}}])),
        ('output', lambda text: only(output={'name': text, 'value': True})),
        ('unknown key', lambda text: changed(**{text: 1})),
        ('moves[0]', lambda text: changed(moves=[{text: 1}])),
    ],
)
def test_multi_line_text_is_not_repeated_in_the_message(where, document, robot):
    assert where in refusal(parse, document('go\n' * 1000), robot)


def test_list_of_many_points_with_long_names_is_shortened(robot):
    points = {f'{n:->100}': [0.0, 0.0, -0.8] for n in range(1000)}
    refusal(parse, changed(points=points, moves=[{'move_l': {'to_m': 'x'}}]), robot)


# files


def written(tmp_path, text):
    path = tmp_path / 'program.yaml'
    path.write_text(text)
    return path


def test_a_program_without_a_name_is_called_after_its_file(robot, tmp_path):
    path = written(tmp_path, 'moves: [{move_l: {to_m: [0, 0, -0.8], jerk_m_s3: .inf}}]')
    program = programs.load(path, robot.motion)
    assert (program.name, program.statements[0].limits.jerk_m_s3) == ('program', math.inf)


BOMB = 'a: &a [x, x]\n' + '\n'.join(
    f'{n}: &{n} [*{p}, *{p}]' for p, n in itertools.pairwise('abcdefghijklmnopqrstuvw')
)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('moves: &a [*a]', 'aliases are not allowed'),
        (BOMB, 'aliases are not allowed'),
        ('moves: [', 'is not valid YAML'),
        (
            'moves: []\nmoves: []',
            ":2:1: program file is not valid YAML: the key 'moves' occurs twice",
        ),
        ('[' * 100_000, 'is not valid YAML'),
        ('x' * (4 * 1024 * 1024 + 1), 'is larger than 4 MiB'),
        ('moves: !!python/object/apply:os.system ["true"]', 'is not valid YAML'),
        ('moves: [{dwell: {time_s: .nan}}]', 'moves[0].dwell.time_s must be a number, not nan'),
        ('moves: [{dwell: {time_s: 1e999}}]', 'moves[0].dwell.time_s '),
        ('', 'the program must be a mapping, not None'),
    ],
    ids=['alias', 'bomb', 'open', 'twice', 'deep', 'large', 'object', 'nan', 'infinite', 'empty'],
)
def test_file_without_a_program_is_rejected_with_one_message(text, reason, robot, tmp_path):
    assert reason in refusal(programs.load, written(tmp_path, text), robot.motion)


def test_unreadable_file_is_named(robot, tmp_path):
    assert 'cannot read program file nowhere: ' in refusal(programs.load, 'nowhere', robot.motion)
    assert 'cannot read program file ' in refusal(programs.load, tmp_path, robot.motion)
    (tmp_path / 'x.yaml').write_bytes(b'name: \xff\xfe')
    assert 'is not valid YAML' in refusal(programs.load, tmp_path / 'x.yaml', robot.motion)


BAD = """\
name: many mistakes
repeat: 0
limits: {spede_m_s: 1.0, acceleration_m_s2: fast}
points:
  pick: [0.1, 0.0]
  place: [0.2, 0.0, -0.8]
moves:
  - move_l: {to_m: [0.1, abc, -0.8], strict: 1}
  - move_l: {to_m: palce}
  - move_l: {to_m: pick}
  - movel: {to_m: place}
  - cubic: {to_m: place}
  - output: {name: griper, value: true}
"""
MISTAKES = [
    '2:9: repeat is 0, but must be a whole number between 1 and 10000',
    "3:10: limits: unknown key 'spede_m_s', expected one of acceleration_m_s2, jerk_m_s3, speed_m_s, "
    'torque_rate_n_m_s: did you mean speed_m_s?',
    "3:45: limits.acceleration_m_s2 must be a number, not 'fast'",
    '5:9: points.pick must be a list of 3 numbers [m], not [0.1, 0.0]',
    "8:26: moves[0].move_l.to_m[1] must be a number, not 'abc'",
    '8:46: moves[0].move_l.strict must be true or false, not 1',
    "9:20: moves[1].move_l.to_m: unknown point 'palce', the points are: 'pick', 'place': did you mean place?",
    "11:5: moves[3]: unknown key 'movel', expected one of move_l, move_c, move_sb, arch, cubic, joints, turn, dwell, "
    'output, for_each: did you mean move_l?',
    '12:12: moves[4].cubic: missing key duration_s',
    f"13:20: moves[5].output.name is 'griper', but must be one of {', '.join(OUTPUTS)}: did you mean gripper?",
]


def test_all_errors_of_a_file_are_reported_with_place_and_suggestion(robot, tmp_path):
    path = written(tmp_path, BAD)
    told = refusal(programs.load, path, robot.motion).removesuffix('; the search ended after 10 errors')
    assert told.split('; ') == [f'{path}:{mistake}' for mistake in MISTAKES]


def test_ten_errors_are_enough(robot, tmp_path):
    path = written(tmp_path, 'moves:\n' + '- {dwell: {time_s: -1}}\n' * 1000)
    sentence = refusal(programs.load, path, robot.motion)
    assert sentence.count('moves[') == 10
    assert sentence.endswith('; the search ended after 10 errors')


def test_error_in_a_fault_of_a_program_has_its_place(robot, tmp_path):
    text = 'moves: [{dwell: {time_s: 1}}]\nfaults:\n- {fault: drop_mtd, axis: axis1}\n- {fault: kill, node: axis6}'
    one, two = refusal(programs.load, written(tmp_path, text), robot.motion).split('; ')
    assert "yaml:3:11: faults[0].fault is 'drop_mtd'" in one
    assert one.endswith('did you mean drop_mdt?')
    assert "yaml:4:23: faults[1].node is 'axis6'" in two


def test_text_from_a_message_has_line_and_column(robot):
    text = '{"moves": [{"move_l": {"to_m": [0, "x", -0.8]}}]}'
    sentence = refusal(parse, yaml_file.parse(text, 'the program', ProgramError), robot)
    assert sentence == "line 1, column 36: moves[0].move_l.to_m[1] must be a number, not 'x'"


def test_a_small_number_in_json_is_a_number(robot):
    text = json.dumps({'moves': [{'move_l': {'to_m': [0.00001, 0.0, -0.8]}}]})
    assert '1e-05' in text
    (move,) = parse(yaml_file.parse(text, 'it', ProgramError), robot).statements
    assert move.to.point_m == (1e-5, 0.0, -0.8)


def test_read_document_can_be_written(tmp_path):
    document = yaml_file.parse(BAD, 'it', ProgramError)
    path = tmp_path / 'again.yaml'
    yaml_file.write(path, document)
    assert yaml_file.read(path, 'it', ProgramError) == document


def test_the_parsers_in_c_and_in_python_read_the_same(monkeypatch):
    one = yaml_file.parse(BAD, 'it', ProgramError)
    monkeypatch.setattr(yaml_file, 'LOADER', yaml.SafeLoader)
    other = yaml_file.parse(BAD, 'it', ProgramError)
    assert one == other
    assert one['moves'].places == other['moves'].places
    assert one['limits'].key_places == other['limits'].key_places


def test_packaged_programs_are_found_by_their_names(robot):
    names = programs.packaged_names()
    assert 'experiment1' in names
    for name in names:
        assert programs.load(name, robot.motion).statements


def test_a_folder_hides_no_packaged_program_of_its_name(robot, tmp_path, monkeypatch):
    wanted = programs.load('packaging', robot.motion).name
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'packaging').mkdir()  # of results, say
    assert programs.load('packaging', robot.motion).name == wanted
