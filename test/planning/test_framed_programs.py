"""Tests of programs with points in frames, for tools, and at the places of patterns."""

import math

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program.frames import Frame, Tool
from delta3_pacdrive.planning.program.model import KeepOut, Output
from delta3_pacdrive.planning.program.patterns import Grid, Layers

ROUNDING_M = 1e-15
TABLE = Frame.turned((0.05, 0.02, -0.9), yaw_rad=math.radians(30))
BOX = Frame.turned((0.1, -0.05, 0.02), yaw_rad=math.radians(60), parent=TABLE)
CUP = Tool((0.01, 0.0, -0.06), 0.2)
HEAD = """\
frames:
  table: {origin_mm: [50, 20, -900], yaw_deg: 30}
  box: {parent: table, origin_mm: [100, -50, 20], yaw_deg: 60}
tools:
  cup: {offset_mm: [10, 0, -60], mass_kg: 0.2}
  hook: {offset_mm: [0, 20, -40], mass_kg: 0.2}
"""
PATTERNS = """\
patterns:
  tray: {frame: table, rows: 2, columns: 2, pitch_mm: [40, 50]}
  box: {frame: box, rows: 1, columns: 2, pitch_mm: [30, 0], layers: 2, height_mm: 25, shift_mm: [5, 0]}
  stack: {rows: 1, columns: 1, pitch_mm: [0, 0], layers: 3, height_mm: 20, reverse: true}
"""


def same(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING_M)


def test_every_point_of_a_statement_is_in_its_frame(load):
    text = f"""{HEAD}frame: table
start_mm: [0, 0, 150]
moves:
- move_l: {{to_m: [0.1, 0.0, 0.1]}}
- move_c: {{via_m: [0.1, 0.1, 0.1], to_m: [0.0, 0.1, 0.1], frame: box}}
- move_sb:
    frame: box
    through_m: [[0.0, 0.0, 0.1], {{by_m: [0.0, 0.02, 0.0]}}, {{frame: base, at_m: [0.1, 0.0, -0.8]}}]
- cubic: {{to_m: {{at_mm: [10, 0, 100]}}, duration_s: 0.5, end_velocity_m_s: [0.1, 0.0, 0.2]}}
- move_l: {{to_m: [0.1, 0.0, -0.8], frame: base}}
"""
    program = load(text)
    line, circle, spline, cubic, plain = program.statements
    same(program.start_m, TABLE.to_base([0, 0, 0.15]))
    same(line.to.point_m, TABLE.to_base([0.1, 0.0, 0.1]))
    same(circle.via.point_m, BOX.to_base([0.1, 0.1, 0.1]))
    same(circle.to.point_m, BOX.to_base([0.0, 0.1, 0.1]))
    first, step, last = spline.through
    same(first.point_m, BOX.to_base([0.0, 0.0, 0.1]))
    same(step.point_m, BOX.directions_to_base([0.0, 0.02, 0.0]))
    assert (first.relative, step.relative, last.relative) == (False, True, False)
    assert last.point_m == (0.1, 0.0, -0.8)
    same(cubic.to.point_m, TABLE.to_base([0.01, 0.0, 0.1]))
    same(cubic.end_velocity_m_s, TABLE.directions_to_base([0.1, 0.0, 0.2]))
    assert plain.to.point_m == (0.1, 0.0, -0.8)


def test_working_point_of_the_tool_reaches_every_point_and_follows_every_step(load):
    text = f"""{HEAD}tool: cup
start_m: [0.0, 0.0, -0.8]
points: {{pick: [0.1, 0.0, -0.9]}}
moves:
- move_l: {{to_m: pick}}
- move_l: {{to_m: {{point: pick, by_mm: [0, 0, 50]}}}}
- move_l: {{to_m: {{by_mm: [0, 0, 50]}}}}
- move_l: {{to_m: pick, tool: hook}}
- arch: {{to_m: [0.0, 0.1, -0.9], up_m: 0.01, down_m: 0.01, keep_out: {{height_m: -0.88, margin_m: 0.05}}}}
"""
    program = load(text)
    at, above, step, hook, arch = program.statements
    same(program.start_m, CUP.plate_m([0.0, 0.0, -0.8]))
    same(at.to.point_m, (0.09, 0.0, -0.84))
    same(above.to.point_m, (0.09, 0.0, -0.79))
    same(step.to.point_m, (0.0, 0.0, 0.05))
    same(hook.to.point_m, (0.1, -0.02, -0.86))
    same(arch.to.point_m, (-0.01, 0.1, -0.84))
    assert arch.keep_out.height_m == pytest.approx(-0.82)  # nothing of the tool comes below -0.88 m


def test_named_point_is_a_fixed_place(load):
    text = f"""{HEAD}{PATTERNS}frame: table
points:
  pick: [0.1, 0.0, 0.05]
  put: {{frame: box, at_m: [0.0, 0.0, 0.05]}}
  over: {{point: put, by_m: [0.02, 0, 0], frame: box}}
moves:
- move_l: {{to_m: pick}}
- move_l: {{to_m: pick, frame: box}}
- move_l: {{to_m: {{point: pick, by_m: [0.02, 0.0, 0.0]}}, frame: box}}
- move_l: {{to_m: over}}
- for_each: {{place_of: tray, moves: [{{move_l: {{to_m: pick}}}}]}}
"""
    here, still, beside, over, *everywhere = load(text).statements
    pick = TABLE.to_base([0.1, 0.0, 0.05])
    same(here.to.point_m, pick)
    same(still.to.point_m, pick)
    same(beside.to.point_m, pick + BOX.directions_to_base([0.02, 0.0, 0.0]))
    same(over.to.point_m, BOX.to_base([0.02, 0.0, 0.05]))
    assert {one.to for one in everywhere} == {here.to}
    assert len(everywhere) == 4


def test_taught_frame_has_its_points_in_its_parent(load):
    points = 'taught_mm: [[100, -50, 20], [110, -50, 20], [0, 0, 20]]'
    (move,) = load(f'{HEAD}  '.replace('tools:', f'  shown: {{parent: table, {points}}}\ntools:') + """
moves: [{move_l: {to_m: [0.1, 0.0, 0.1], frame: shown}}]
""").statements  # fmt: skip
    taught = Frame.taught([[0.1, -0.05, 0.02], [0.11, -0.05, 0.02], [0, 0, 0.02]], parent=TABLE)
    same(move.to.point_m, taught.to_base([0.1, 0.0, 0.1]))


def test_the_frame_base_and_no_tool_change_no_bit(load):
    moves = """
moves:
- move_l: {to_m: [0.1, 0.02, -0.83]}
- move_c: {via_m: [0.11, 0.1, -0.81], to_m: [0.01, 0.1, -0.87]}
- arch: {to_m: [0.07, 0.1, -0.8], up_m: 0.013, down_m: 0.01, keep_out: {height_m: -0.79, margin_m: 0.03}}
- cubic: {to_m: [0.2, 0.0, -0.8], duration_s: 0.3, end_velocity_m_s: [-0.4, 0.3, 0.1]}
"""
    assert load(f'frame: base\ntools: {{none: {{}}}}\ntool: none\n{moves}') == load(moves)


def test_the_height_of_a_keep_out_is_that_of_its_frame(load):
    moves = 'moves: [{arch: {to_m: [0.1, 0, 0.05], up_m: 0, down_m: 0, keep_out: {height_m: 0.04}, frame: table}}]'
    (arch,) = load(f'{HEAD}{moves}').statements
    assert arch.keep_out == KeepOut(pytest.approx(-0.86), 0.0)


def test_a_tool_is_carried_from_the_start_to_the_end(load):
    moves = """moves:
- dwell: {time_s: 0.1}
- output: {name: gripper, value: true, payload_kg: 0.5}
- output: {name: gripper, value: false, payload_kg: 0.0}
- output: {name: output1, value: true}
"""
    bare, empty, loaded = (
        load(f'{HEAD}{head}{moves}') for head in ('', 'tool: cup\n', 'tool: cup\npayload_kg: 1\n')
    )
    payloads = [
        [one.payload_kg for one in p.statements if isinstance(one, Output)] for p in (bare, empty, loaded)
    ]
    assert payloads[0] == [0.5, 0.0, None]
    assert payloads[1] == payloads[2] == [pytest.approx(0.7), pytest.approx(0.2), None]
    assert (bare.payload_kg, empty.payload_kg, loaded.payload_kg) == (
        None,
        pytest.approx(0.2),
        pytest.approx(1.2),
    )


def test_a_loop_drives_its_statements_at_each_place_one_after_the_other(load):
    text = f"""{HEAD}tool: cup
{PATTERNS}moves:
- dwell: {{time_s: 0.1}}
- for_each:
    place_of: box
    moves:
    - move_l: {{to_mm: [0, 0, 40]}}
    - move_l: {{to_mm: [0, 0, 0]}}
    - output: {{name: gripper, value: false}}
- dwell: {{time_s: 0.2}}
"""
    program = load(text)
    first, *loop, last = program.statements
    places = Layers(Grid(1, 2, (0.03, 0.0), frame=BOX), 2, 0.025, (0.005, 0.0))
    assert (first.time_s, last.time_s, len(loop)) == (0.1, 0.2, 3 * len(places))
    for n, place in enumerate(places):
        over, at, release = loop[3 * n : 3 * n + 3]
        same(over.to.point_m, np.add(CUP.plate_m(place), [0, 0, 0.04]))
        same(at.to.point_m, CUP.plate_m(place))
        assert isinstance(release, Output)
    assert program.names[0] == 'moves[0].dwell'
    assert program.names[5] == 'moves[1].for_each.moves[1].move_l at place 1 of box'
    assert program.names[-1] == 'moves[2].dwell'
    assert {program.places[n].line for n in (2, 5, 8)} == {18}


def test_several_patterns_are_combined_place_by_place(load):
    text = f"""{HEAD}{PATTERNS}moves:
- for_each:
    place_of: {{pick: tray, put: box}}
    first: 1
    moves:
    - move_l: {{to_mm: [0, 0, 10], frame: pick}}
    - move_l: {{to_m: {{frame: put, at_mm: [0, 0, 10]}}}}
"""
    program = load(text)
    tray, box = Grid(2, 2, (0.04, 0.05), frame=TABLE), Layers(
        Grid(1, 2, (0.03, 0.0), frame=BOX), 2, 0.025, (0.005, 0.0)
    )  # fmt: skip
    expected = [pattern[n] for n in (1, 2, 3) for pattern in (tray, box)]
    same([one.to.point_m for one in program.statements], np.add(expected, [0, 0, 0.01]))
    assert program.names[-1] == 'moves[0].for_each.moves[1].move_l at place 3 of tray and box'


def test_reversed_pattern_unstacks(load):
    moves = 'moves: [{for_each: {place_of: stack, moves: [{move_l: {to_m: [0, 0, 0.05]}}]}}]'
    program = load(f'{HEAD}frame: table\n{PATTERNS}{moves}')
    heights = [one.to.point_m[2] for one in program.statements]
    assert heights == pytest.approx([-0.81, -0.83, -0.85])


def test_unreachable_place_is_reported_with_line_and_position(load, robot, tmp_path):
    program = load("""\
patterns: {wide: {rows: 1, columns: 3, pitch_m: [0.5, 0]}}
moves:
- for_each:
    place_of: wide
    moves:
    - move_l: {to_m: [0, 0, -0.8], blend_m: 0.0}
    - move_l: {to_m: [0, 0, -0.85]}
""")
    with pytest.raises(ProgramError) as caught:
        program_planner.plan(program, (0.0, 0.0, -0.75), robot)
    place = f'{tmp_path}/program.yaml:6:7: moves[0].for_each.moves[0].move_l at place 2 of wide: '
    assert str(caught.value).startswith(place)


MISTAKES = [
    ('frames: {a: {origin_m: [0, 0]}}', '1:24: frames.a.origin_m must be a list of 3 numbers [m], not [0, 0]'),
    ('frames: {a: {origin_mm: [0, 0, -90000]}}', '1:25: frames.a.origin_mm holds -90 m, farther than 10 m: are these'),
    ('frames: {a: {yaw: 1}}', "1:14: frames.a: unknown key 'yaw', expected one of"),
    ('frames: {a: {yaw_deg: .inf}}', "1:13: frames.a: frame 'a': its angles must be finite"),
    ('frames: {a: {parent: b}, b: {}}', "1:22: frames.a.parent: unknown frame 'b', the frames are: 'base'"),
    ('frames: {a: {parent: a}}', "1:22: frames.a.parent: unknown frame 'a'"),
    ('frames: {base: {}}', "1:10: frames: 'base' is a reserved name, choose another one for the frame"),
    ('frames: {place: {}}', "1:10: frames: 'place' is a reserved name"),
    ('frames: {a: {taught_m: [[0, 0, 0], [0, 0, 1]]}}', '1:24: frames.a.taught_m must be 3 points: the origin, one'),
    (
        'frames: {a: {taught_m: [[0, 0, 0], [0, 0, 1], [0, 0, 2]]}}',
        "1:13: frames.a: frame 'a': its taught points are on a line",
    ),
    (
        'frames: {a: {taught_m: [[0, 0, 0], [0, 0, 1], [0, 1, 0]], yaw_deg: 3}}',
        '1:13: frames.a: taught_m defines origin and axes of the frame: remove yaw_rad',
    ),
    ('frames: [a]', '1:9: frames must be a mapping'),
    ('frame: tabel', "1:8: frame: unknown frame 'tabel', the frames are: 'base'"),
    ('tools: {a: {mass_kg: 11}}', '1:22: tools.a.mass_kg is 11, but must be between 0 and 10'),
    ('tools: {a: {offset_m: [0, 0, -60]}}', "1:12: tools.a: tool 'a': offset_m is [0.0, 0.0, -60.0] m, farther"),
    ('tool: cup', "1:7: tool: unknown tool 'cup', the tools are: none"),
    (
        'tools: {a: {mass_kg: 4}}\ntool: a\npayload_kg: 7',
        '3:13: payload_kg and the tool are 11 kg together, the limit is 10 kg',
    ),
    ('patterns: {a: {rows: 2, columns: 2}}', '1:15: patterns.a: missing key pitch_m'),
    ('patterns: {a: {rows: 0, columns: 2, pitch_m: [1, 1]}}', '1:22: patterns.a.rows is 0, but must be a whole'),
    ('patterns: {a: {rows: 2, columns: 2, pitch_m: [1, 0]}}', '1:15: patterns.a: a grid has 2 rows, but pitch_m'),
    ('patterns: {a: {rows: 2, columns: 2, pitch_m: [1]}}', '1:46: patterns.a.pitch_m must be a list of 2 numbers'),
    (
        'patterns: {a: {rows: 1, columns: 1, pitch_m: [1, 1], height_m: 1}}',
        '1:15: patterns.a: height_m needs layers',
    ),
    (
        'patterns: {a: {rows: 1, columns: 1, pitch_m: [1, 1], layers: 2}}',
        '1:15: patterns.a: there are 2 layers, but height_m between them is 0',
    ),
    (
        'patterns: {a: {rows: 200, columns: 101, pitch_m: [1, 1]}}',
        '1:15: patterns.a has 20200 places, the limit is 20000',
    ),
    (
        'patterns: {a: {rows: 1, columns: 1, pitch_m: [1, 1], order: snail}}',
        "1:61: patterns.a.order is 'snail', but must be one of rows, snake: did you mean snake?",
    ),
    ('points: {a: {frame: box, at_m: [0, 0, 0]}}', "1:21: points.a.frame: unknown frame 'box'"),
    ('points: {a: {at_m: [0, 0, 0], by_m: [0, 0, 0]}}', '1:13: points.a: at_m is a complete position: remove'),
]  # fmt: skip


@pytest.mark.parametrize(('head', 'sentence'), MISTAKES)
def test_errors_of_the_head_are_reported_with_their_places(head, sentence, refused):
    assert refused(f'{head}\nmoves: [{{move_l: {{to_m: [0, 0, -0.8]}}}}]').startswith(sentence)


STATEMENTS = [
    ('move_l: {to_m: [0, 0, 0], frame: tabel}', "frame: unknown frame 'tabel', the frames are: 'base', 'box'"),
    ('move_l: {to_m: [0, 0, 0], tool: cupp}', "tool: unknown tool 'cupp', the tools are: 'cup', 'hook': did you"),
    (
        'move_l: {to_m: [0, 0, 0], tool: cup}',
        "tool: 'cup' weighs 0.2 kg, but the robot carries a tool of 0 kg, given in the head of the program",
    ),
    ('dwell: {time_s: 1, frame: table}', "dwell: unknown key 'frame', expected one of time_s"),
    ('output: {name: gripper, value: true, tool: cup}', "output: unknown key 'tool'"),
    ('joints: {points: [{time_s: 1, angles_rad: [0, 0, 0]}], frame: table}', "joints: unknown key 'frame'"),
    (
        'arch: {to_m: [0, 0, 0], up_m: 0, down_m: 0, keep_out: {height_m: 0}, frame: tilted}',
        'keep_out: a height needs a frame whose z axis is upright, not one tilted by 10 deg',
    ),
    ('for_each: {place_of: tary, moves: [{dwell: {time_s: 1}}]}', "place_of: unknown pattern 'tary', the patterns are"),
    ('for_each: {place_of: tray}', 'for_each: missing key moves'),
    ('for_each: {place_of: tray, moves: []}', 'for_each.moves must be a list of at least one move'),
    ('for_each: {place_of: {}, moves: [{dwell: {time_s: 1}}]}', 'for_each.place_of does not name a pattern'),
    ('for_each: {place_of: tray, first: 4, moves: [{dwell: {time_s: 1}}]}', 'first is 4, but must be a whole number'),
    (
        'for_each: {place_of: {a: tray, b: stack}, moves: [{dwell: {time_s: 1}}]}',
        'patterns of one loop must have the same number of places: tray has 4, stack has 3',
    ),
    (
        'for_each: {place_of: {a: tray, b: box}, moves: [{move_l: {to_m: [0, 0, 0]}}]}',
        'moves[0].move_l.to_m: give the place, frame: a or frame: b',
    ),
    ('for_each: {place_of: {table: tray}, moves: [{dwell: {time_s: 1}}]}', "'table' is a reserved name"),
    (
        'for_each: {place_of: tray, moves: [{for_each: {place_of: tray, moves: []}}]}',
        "moves[0]: unknown key 'for_each', expected one of move_l",
    ),
    (
        'for_each: {place_of: tray, moves: [{move_l: {to_m: [0, 0]}}]}',
        'moves[0].for_each.moves[0].move_l.to_m must be a list of 3 numbers [m], not [0, 0]',
    ),
]  # fmt: skip


@pytest.mark.parametrize(('statement', 'sentence'), STATEMENTS)
def test_errors_of_statements_are_reported_once_with_their_places(statement, sentence, refused):
    head = HEAD.replace('tools:', '  tilted: {pitch_deg: 10}\ntools:')
    told = refused(f'{head}{PATTERNS}moves:\n- {statement}\n')
    assert told.startswith('13:')
    assert sentence in told
    assert '; ' not in told


def test_a_loop_is_bounded_before_it_is_unrolled(refused, load):
    head = 'repeat: {}\npatterns: {{a: {{rows: 100, columns: 100, pitch_mm: [1, 1]}}}}\n'
    loop = 'for_each: {{place_of: a, moves: [{}]}}'
    two = loop.format('{dwell: {time_s: 1}}, {dwell: {time_s: 1}}')
    assert len(load(f'{head.format(1)}moves: [{{{two}}}]').statements) == 20_000
    assert 'the program has 20001 moves, the limit is 20000' in refused(
        f'{head.format(1)}moves: [{{dwell: {{time_s: 1}}}}, {{{two}}}]'
    )
    assert 'the program has 40000 moves' in refused(f'{head.format(2)}moves: [{{{two}}}]')
