"""Facts about moves (thesis 5, 6): virtual master, paths, the plan's tables, programs and why they are refused."""

import contextlib
import datetime as dt
import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.motion.checks import check_move, demand
from delta3_pacdrive.motion.master import plan_master, rest, sample_master
from delta3_pacdrive.motion.path import line, point, sample_path
from delta3_pacdrive.motion.plan import MOVES_MAX, Move, MoveKind, Plan, plan_at

HOME = (0.0, 0.0, -0.75)
LIMIT = 1e-9  # relative; rounding of the profile's phases
JUMP = 1e-6  # relative to the limit; times are stored from the start, so a phase of 1 us knows its length to 1e-9
EXACT = 1e-12

lengths = st.floats(1e-5, 2.0)
speeds = st.floats(0.01, 10.0)
accelerations = st.floats(0.1, 200.0)
jerks = st.one_of(st.floats(1.0, 1e5), st.just(math.inf))


def parse(text_or_document, robot):
    return programs.parse(text_or_document, robot.motion)


def plan(moves, robot, position=HOME, **fields):
    """Plan a program of statements for a robot at a position."""
    return programs.plan(parse({'moves': moves, **fields}, robot), position, robot)


def to(x, y, z, **limits):
    return {'move_l': {'to_m': [x, y, z], **limits}}


def refusal(function, *arguments, **options):
    """Return the sentence with which a program is refused."""
    with pytest.raises(ProgramError) as caught:
        function(*arguments, **options)
    sentence = str(caught.value)
    assert sentence
    assert '\n' not in sentence
    assert len(sentence) < 500
    return sentence


# virtual master


@given(lengths, speeds, accelerations, jerks)
def test_a_master_keeps_its_limits_and_never_turns_back(length, speed, acceleration, jerk):
    phases = plan_master(length, speed, acceleration, jerk)
    times = np.union1d(np.linspace(0.0, phases[-1, 0], 500), phases[:, 0])
    s, v, a = sample_master(times, phases).T
    assert (v >= -LIMIT * speed).all()
    assert v.max() <= speed * (1.0 + LIMIT)
    assert np.abs(a).max() <= acceleration * (1.0 + LIMIT)
    assert (np.diff(s) >= -EXACT * length).all()
    if math.isfinite(jerk):
        assert np.abs(phases[:, 4]).max() <= jerk * (1.0 + LIMIT)


@given(lengths, speeds, accelerations, jerks)
def test_a_master_starts_at_rest_and_ends_exactly_at_its_length_at_rest(length, speed, acceleration, jerk):
    phases = plan_master(length, speed, acceleration, jerk)
    start, end, after = sample_master([0.0, phases[-1, 0], phases[-1, 0] + 10.0], phases)
    assert start[:2].tolist() == [0.0, 0.0]
    assert end.tolist() == after.tolist() == [length, 0.0, 0.0]
    assert sample_master([-1.0], phases)[0].tolist() == [0.0, 0.0, 0.0]


@given(lengths, speeds, accelerations, jerks)
def test_a_master_has_no_jump_in_place_speed_and_with_finite_jerk_acceleration(
    length, speed, acceleration, jerk
):
    phases = plan_master(length, speed, acceleration, jerk)
    assert (np.diff(phases[:, 0]) > 0.0).all()
    for before, after in itertools.pairwise(phases):
        t, (_, s, v, a, j) = after[0] - before[0], before
        assert s + t * (v + t * (a / 2.0 + t * j / 6.0)) == pytest.approx(after[1], abs=JUMP * length)
        assert v + t * (a + t * j / 2.0) == pytest.approx(after[2], abs=JUMP * speed)
        if math.isfinite(jerk):
            assert a + t * j == pytest.approx(after[3], abs=JUMP * acceleration)


@given(speeds, accelerations, st.floats(1.0, 1e5), st.floats(0.0, 2.0))
def test_with_all_seven_phases_the_time_is_that_of_the_closed_formula(speed, acceleration, jerk, cruise_s):
    """T = L/v + v/a + a/j, if full acceleration and full speed are reached."""
    jerk = max(jerk, 1.001 * acceleration**2 / speed)
    length = speed * (speed / acceleration + acceleration / jerk + 0.001 + cruise_s)
    phases = plan_master(length, speed, acceleration, jerk)
    assert len(phases) == 8
    assert phases[-1, 0] == pytest.approx(
        length / speed + speed / acceleration + acceleration / jerk, rel=LIMIT
    )


@given(lengths, accelerations, st.floats(1.0, 1e5))
def test_shorter_moves_take_the_time_of_their_closed_formulas(length, acceleration, jerk):
    fast = 1e3  # never reached
    if length < 2.0 * acceleration**3 / jerk**2:
        expected = 4.0 * (length / (2.0 * jerk)) ** (1.0 / 3.0)
    else:
        ramp = acceleration / jerk
        peak = 0.5 * acceleration * (math.sqrt(ramp**2 + 4.0 * length / acceleration) - ramp)
        expected = 2.0 * (peak / acceleration + ramp)
    assert plan_master(length, fast, acceleration, jerk)[-1, 0] == pytest.approx(expected, rel=LIMIT)


@given(lengths, speeds, accelerations)
def test_with_infinite_jerk_the_master_is_a_trapezoid_or_a_triangle(length, speed, acceleration):
    if length >= speed**2 / acceleration:
        expected = length / speed + speed / acceleration
    else:
        expected = 2.0 * math.sqrt(length / acceleration)
    assert plan_master(length, speed, acceleration, math.inf)[-1, 0] == pytest.approx(expected, rel=LIMIT)


@pytest.mark.parametrize('place', range(4))
@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, -math.inf, math.inf])
def test_a_limit_that_is_not_positive_is_named(place, value):
    arguments = [0.5, 1.0, 10.0, 600.0]
    arguments[place] = value
    name = ('length_m', 'speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')[place]
    if name == 'jerk_m_s3' and value == math.inf:
        assert plan_master(*arguments)[-1, 1] == 0.5
    else:
        assert f'{name} is {value}' in refusal(plan_master, *arguments)


def test_a_resting_master_rests():
    assert sample_master([0.0, 0.1, 0.2, 5.0], rest(0.2)).tolist() == [[0.0, 0.0, 0.0]] * 4


# paths

coordinates = st.floats(-1.0, 1.0)
points = st.tuples(coordinates, coordinates, coordinates)


@given(points, points)
def test_a_line_is_straight_even_and_meets_its_ends(start, end):
    segments, length = line(start, end)
    assert length == pytest.approx(math.dist(start, end), rel=EXACT)
    if length < 1e-6:
        return
    share = np.linspace(0.0, 1.0, 11)[:, None]
    p, tangent, curvature = np.moveaxis(sample_path(share[:, 0] * length, segments), 1, 0)
    expected = (1.0 - share) * np.array(start) + share * np.array(end)
    assert np.abs(p - expected).max() < EXACT
    assert p[0].tolist() == list(start)
    assert np.linalg.norm(tangent, axis=1) == pytest.approx(np.ones(11), abs=1e-9)
    assert not curvature.any()


def test_a_point_stays_where_it_is():
    assert sample_path([0.0], point([0.1, 0.2, -0.8]))[0].tolist() == [[0.1, 0.2, -0.8], [0.0] * 3, [0.0] * 3]


def test_cubic_pieces_cut_from_one_cubic_are_that_cubic():
    """Each piece has its own origin; its powers are those of the distance from there."""
    cubics = np.array([[0.1, -0.3, 2.0, -1.5], [0.0, 0.7, -1.0, 0.4], [-0.8, 0.2, 0.5, 0.6]])  # x, y, z
    cuts = [0.0, 0.3, 0.31, 0.8]
    segments = np.zeros((4, 13))
    for n, cut in enumerate(cuts):
        segments[n, 0] = cut
        for axis, c in enumerate(cubics):
            taylor = [np.polynomial.Polynomial(c).deriv(k)(cut) / math.factorial(k) for k in range(1, 4)]
            segments[n, 1 + 4 * axis : 5 + 4 * axis] = [np.polynomial.Polynomial(c)(cut), *taylor]
    s = np.array([0.0, 0.1, 0.2999, 0.3, 0.305, 0.31, 0.5, 0.7999, 0.8, 1.0])
    sampled = sample_path(s, segments)
    for axis, c in enumerate(cubics):
        for order in range(3):
            expected = (
                np.polynomial.Polynomial(c).deriv(order)(s) if order else np.polynomial.Polynomial(c)(s)
            )
            assert np.abs(sampled[:, order, axis] - expected).max() < EXACT * 10.0


# moves and plans


def moves_of(robot):
    return plan(
        [to(0.0, 0.0, -0.8), {'dwell': {'time_s': 0.1}}, to(0.2, 0.1, -0.85, jerk_m_s3=math.inf)], robot
    )


def test_a_move_survives_its_message_to_the_last_bit(robot):
    moves = moves_of(robot)
    for number, move in enumerate(moves):
        row = move.to_array(number, len(moves))
        back, n, count = Move.from_array(row.tolist())
        assert (n, count, back.kind) == (number, 3, move.kind)
        assert back.master.tobytes() == move.master.tobytes()
        assert back.segments.tobytes() == move.segments.tobytes()


def spoilt(row, index, value):
    row = row.copy()
    row[index] = value
    return row


@pytest.mark.parametrize(
    ('spoil', 'reason'),
    [
        (lambda row: [], 'a row of finite numbers'),
        (lambda row: row[:5], 'a row of finite numbers'),
        (lambda row: row[None, :], 'a row of finite numbers'),
        (lambda row: spoilt(row, 0, math.nan), 'a row of finite numbers'),
        (lambda row: spoilt(row, -1, math.inf), 'a row of finite numbers'),
        (lambda row: spoilt(row, 4, 2.5), 'whole numbers'),
        (lambda row: spoilt(row, 1, -1.0), 'whole numbers'),
        (lambda row: spoilt(row, 0, 7.0), 'version 7 and kind 1 is unknown'),
        (lambda row: spoilt(row, 3, 99.0), 'version 1 and kind 99 is unknown'),
        (lambda row: spoilt(row, 1, 3.0), '3 of 3'),
        (lambda row: spoilt(row, 2, MOVES_MAX + 1), f'0 of {MOVES_MAX + 1}'),
        (lambda row: spoilt(row, 4, 1.0), '1 phases'),
        (lambda row: spoilt(row, 5, 0.0), '0 segments'),
        (lambda row: spoilt(row, 4, 9.0), 'does not fit its header'),
        (lambda row: spoilt(row, 5, 1e300), 'does not fit its header'),
        (lambda row: row[:-1], 'does not fit its header'),
        (lambda row: np.append(row, 0.0), 'does not fit its header'),
        (lambda row: spoilt(row, 6 + 5, -0.1), 'do not increase'),
    ],
)
def test_a_malformed_plan_message_is_refused(spoil, reason, robot):
    row = moves_of(robot)[0].to_array(0, 3)
    assert reason in refusal(Move.from_array, spoil(row))


def test_pieces_out_of_order_are_refused():
    segments = np.zeros((2, 13))
    move = Move(MoveKind.LINE, rest(1.0), segments)
    assert 'do not increase' in refusal(Move.from_array, move.to_array(0, 1))


def test_a_plan_strings_moves_together_where_and_when_the_last_one_ends(robot):
    moves = moves_of(robot)
    joined = Plan.of(moves)
    assert joined.duration_s == pytest.approx(sum(move.duration_s for move in moves), rel=EXACT)
    number, seen = 0, []
    for time in np.arange(0.0, joined.duration_s + 0.01, 0.25e-3):
        p, s, v, number = plan_at(time, number, joined.moves, joined.phases, joined.segments)
        assert v >= -LIMIT
        assert -LIMIT <= s <= moves[number].length_m + LIMIT
        seen.append((number, *p))
    seen = np.array(seen)
    assert seen[0, 1:].tolist() == list(HOME)
    assert np.abs(seen[-1, 1:] - [0.2, 0.1, -0.85]).max() < EXACT
    assert np.abs(np.diff(seen[:, 1:], axis=0)).max() < 1.01 * 1.5 * 0.25e-3  # no jump at the joints of moves
    assert sorted(set(seen[:, 0])) == [0.0, 1.0, 2.0]
    for number, move in enumerate(moves):
        begins = sum(m.duration_s for m in moves[:number])
        first = np.flatnonzero(seen[:, 0] == number)[0] * 0.25e-3
        assert begins - EXACT <= first <= begins + 0.25e-3 + EXACT
        assert np.abs(move.end_m() - [[0, 0, -0.8], [0, 0, -0.8], [0.2, 0.1, -0.85]][number]).max() < EXACT


def test_a_plan_needs_a_move():
    assert 'at least one move' in refusal(Plan.of, [])


def curved_move():
    """A parabola x = s, y = s^2 / 2, z = -0.8 - s / 10, as an arc or a spline will be."""
    segments = np.zeros((1, 13))
    segments[0, [2, 7, 9, 10]] = [1.0, 0.5, -0.8, -0.1]
    return Move(MoveKind.LINE, plan_master(0.3, 1.5, 15.0, 600.0), segments)


@pytest.mark.parametrize(
    'make', [lambda robot: plan([to(0.3, 0.2, -0.9)], robot)[0], lambda robot: curved_move()]
)
def test_demand_is_the_derivative_of_inverse_kinematics_over_time(make, robot):
    move = make(robot)
    d = demand(move, robot)
    inner = (d.time_s > 0.01) & (d.time_s < move.duration_s - 0.01)

    def theta_at(shift):
        s = sample_master(d.time_s[inner] + shift, move.master)[:, 0]
        return kinematics.inverse(sample_path(s, move.segments)[:, 0], robot.kinematics)

    h = 1e-4
    rate = (theta_at(h) - theta_at(-h)) / (2.0 * h)
    acceleration = (theta_at(h) + theta_at(-h) - 2.0 * theta_at(0.0)) / h**2
    # second order in h; a jerk of 600 m/s3 jumps at the phases' ends
    assert np.abs(d.arm_speed_rad_s[inner] - rate).max() < 1e-4
    assert np.abs(d.arm_acceleration_rad_s2[inner] - acceleration).max() < 0.2
    assert np.array_equal(d.motor_speed_rad_s, 32.0 * d.arm_speed_rad_s)


def test_a_resting_move_demands_the_holding_current(robot):
    d = demand(Move(MoveKind.DWELL, rest(0.1), point(HOME)), robot)
    assert np.abs(d.motor_current_a + 0.2782).max() < 1e-4  # the parameter study's 0.28 A at home
    assert not d.motor_speed_rad_s.any()


# programs: reading

GOOD = {
    'name': 'x',
    'start_m': [0, 0, -0.75],
    'repeat': 2,
    'limits': {'speed_m_s': 1},
    'moves': [to(0, 0, -0.8)],
}


def changed(**fields):
    return {**GOOD, **fields}


@pytest.mark.parametrize(
    ('document', 'reason'),
    [
        (None, 'the program must be a mapping, not None'),
        ([], 'the program must be a mapping, not []'),
        ('moves', "the program must be a mapping, not 'moves'"),
        ({}, 'the program: missing key moves'),
        (
            changed(speed=1),
            "the program: unknown key 'speed', expected one of limits, moves, name, repeat, start_m",
        ),
        (changed(**{'': 1}), "unknown key ''"),
        ({**GOOD, 1: 2}, 'unknown key 1'),
        (changed(name=3), 'name must be a text, not 3'),
        (changed(repeat=0), 'repeat is 0, but must be a whole number between 1 and 10000'),
        (changed(repeat=1.5), 'repeat is 1.5'),
        (changed(repeat=True), 'repeat is True'),
        (changed(repeat=10_001), 'repeat is 10001'),
        (changed(repeat='2'), "repeat is '2'"),
        (changed(moves=[]), 'moves must be a list of at least one move'),
        (changed(moves=None), 'moves must be a list'),
        (changed(moves={'move_l': {}}), 'moves must be a list'),
        (
            changed(repeat=10_000, moves=[to(0, 0, -0.8)] * 3),
            'the program has 30000 moves, the limit is 20000',
        ),
        (changed(moves=['go']), "moves[0] must be a mapping, not 'go'"),
        (changed(moves=[to(0, 0, -0.8), {}]), 'moves[1] must hold exactly one of move_l, dwell'),
        (changed(moves=[{'jump': 1}]), "moves[0]: unknown key 'jump'"),
        (changed(moves=[{'move_l': None}]), 'moves[0].move_l must be a mapping, not None'),
        (changed(moves=[{'move_l': {}}]), 'moves[0].move_l: missing key to_m'),
        (changed(moves=[{'move_l': {'to_m': [0, 0, -0.8], 'to': 1}}]), "moves[0].move_l: unknown key 'to'"),
        (
            changed(moves=[{'move_l': {'to_m': [0, 0]}}]),
            'moves[0].move_l.to_m must be a list of 3 numbers [m]',
        ),
        (
            changed(moves=[{'move_l': {'to_m': 'home'}}]),
            'moves[0].move_l.to_m must be a list of 3 numbers [m]',
        ),
        (changed(moves=[to(0, 'a', -0.8)]), "moves[0].move_l.to_m[1] must be a number, not 'a'"),
        (changed(moves=[to(0, True, -0.8)]), 'moves[0].move_l.to_m[1] must be a number, not True'),
        (changed(moves=[to(0, math.nan, -0.8)]), 'moves[0].move_l.to_m[1] must be a number, not nan'),
        (changed(moves=[to(0, math.inf, -0.8)]), 'moves[0].move_l.to_m must be finite'),
        (changed(moves=[to(0, 0, -750)]), 'farther than 10 m: are these millimetres?'),
        (
            changed(start_m=[0, 0, -750.0]),
            'start_m is [0, 0, -750.0] m, farther than 10 m: are these millimetres?',
        ),
        (changed(start_m=None), 'start_m must be a list of 3 numbers [m], not None'),
        (changed(limits=[1]), 'limits must be a mapping'),
        (changed(limits={'speed': 1}), "limits: unknown key 'speed'"),
        (changed(limits={'speed_m_s': 0}), 'limits.speed_m_s is 0.0, but must be a positive number'),
        (changed(limits={'speed_m_s': '1'}), "limits.speed_m_s must be a number, not '1'"),
        (changed(limits={'acceleration_m_s2': math.inf}), 'limits.acceleration_m_s2 is inf, but must be'),
        (changed(limits={'jerk_m_s3': -1}), 'limits.jerk_m_s3 is -1.0, but must be'),
        (changed(moves=[to(0, 0, -0.8, speed_m_s=-2)]), 'moves[0].move_l.speed_m_s is -2.0, but must be'),
        (changed(moves=[{'dwell': 1}]), 'moves[0].dwell must be a mapping, not 1'),
        (
            changed(moves=[{'dwell': {'time_s': 0}}]),
            'moves[0].dwell.time_s is 0.0, but must be positive and at most 3600',
        ),
        (changed(moves=[{'dwell': {'time_s': 3601}}]), 'moves[0].dwell.time_s is 3601.0'),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else '',
)
def test_the_reader_says_what_is_wrong_and_where(document, reason, robot):
    assert reason in refusal(parse, document, robot)


@pytest.mark.parametrize('number', [10**400, -(10**400), 16**5000], ids=['10^400', '-10^400', '16^5000'])
@pytest.mark.parametrize(
    'document',
    [
        lambda n: changed(moves=[to(0, 0, n)]),
        lambda n: changed(moves=[{'dwell': {'time_s': n}}]),
        lambda n: changed(repeat=n),
        lambda n: changed(limits={'jerk_m_s3': n}),
        lambda n: changed(name=n),
        lambda n: n,
    ],
)
def test_numbers_beyond_all_machine_numbers_are_refused(document, number, robot):
    refusal(parse, document(number), robot)


def test_limits_come_from_the_move_else_the_program_else_the_robot(robot):
    fast = {'speed_m_s': 2.0, 'jerk_m_s3': math.inf}
    program = parse(changed(limits=fast, moves=[to(0, 0, -0.8, speed_m_s=0.5), to(0, 0, -0.7)]), robot)
    own, common = (statement.limits for statement in program.statements)
    assert (own.speed_m_s, own.acceleration_m_s2, own.jerk_m_s3) == (0.5, 15.0, math.inf)
    assert (common.speed_m_s, common.acceleration_m_s2, common.jerk_m_s3) == (2.0, 15.0, math.inf)


KEYS = st.sampled_from(
    ['name', 'start_m', 'repeat', 'limits', 'moves', 'move_l', 'dwell', 'to_m', 'time_s', 'speed_m_s']
)
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.binary(max_size=3),
    st.just(dt.date(2026, 1, 1)),
)
VALUES = st.recursive(
    SCALARS,
    lambda children: st.one_of(
        st.lists(children, max_size=4),
        st.dictionaries(st.one_of(KEYS, SCALARS.filter(lambda key: key == key)), children, max_size=4),
    ),
    max_leaves=12,
)
NUMBERS = st.one_of(st.floats(-1.0, 1.0), VALUES)
POINTS = st.one_of(st.lists(NUMBERS, min_size=3, max_size=3), VALUES)
STATEMENTS = st.one_of(
    st.fixed_dictionaries(
        {'move_l': st.fixed_dictionaries({'to_m': POINTS}, optional={'speed_m_s': NUMBERS})}
    ),
    st.fixed_dictionaries({'dwell': st.fixed_dictionaries({'time_s': NUMBERS})}),
    VALUES,
)
PROGRAMS = st.fixed_dictionaries(
    {'moves': st.one_of(st.lists(STATEMENTS, max_size=3), VALUES)},
    optional={
        'name': VALUES,
        'repeat': st.one_of(st.integers(1, 20_000), VALUES),
        'start_m': POINTS,
        'limits': VALUES,
    },
)


@settings(max_examples=200)
@given(st.one_of(PROGRAMS, VALUES))
def test_whatever_a_document_holds_it_is_a_program_or_refused_with_one_sentence(robot, document):
    try:
        program = parse(document, robot)
    except ProgramError as error:
        sentence = str(error)
    else:
        sentence = 'accepted'
        assert program.statements
        assert 1 <= program.repeat <= programs.REPEAT_MAX
    assert sentence
    assert '\n' not in sentence


@settings(max_examples=200)
@given(st.text(alphabet='moves:{}[]-, \n\tl_&*!#|>\'"0123.e\x00\x85\ud800', max_size=60))
@example('moves: &a [*a]')
@example('moves: [{move_l: {to_m: [0, 0, .nan]}}]')
def test_whatever_a_file_holds_it_is_a_program_or_refused(robot, tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / 'program.yaml'
    path.write_bytes(text.encode('utf-8', 'surrogatepass'))
    with contextlib.suppress(ProgramError):
        programs.load(path, robot.motion)


def test_packaged_programs_are_found_by_their_names(robot):
    assert 'experiment1' in programs.packaged_names()
    for name in programs.packaged_names():
        program = programs.load(name, robot.motion)
        start = program.start_m or robot.motion.home_m
        assert programs.plan(program, start, robot)
    assert 'cannot read program file nowhere' in refusal(programs.load, 'nowhere', robot.motion)


# programs: planning

FAST = {'speed_m_s': 20.0, 'acceleration_m_s2': 600.0, 'jerk_m_s3': 1e6}


@pytest.mark.parametrize(
    ('change', 'move', 'what', 'place'),
    [
        ({}, to(0.7, 0, -0.8), 'distance from the z axis is 0.7 m', '0.7000, 0.0000, -0.8000'),
        ({}, to(0, 0, -0.65), 'z is -0.65 m', '0.0000, 0.0000, -0.6500'),
        ({}, to(0, 0, -1.0), 'z is ', '0.0000, 0.0000, -1.0000'),
        (
            {'kinematics__arm_angle_max_deg': 40.0},
            to(0, 0.5, -0.9),
            'angle of arm 3 is 6',
            '0.0000, 0.5000, -0.9000',
        ),
        (
            {'kinematics__arm_angle_min_deg': -10.0},
            to(0.4, 0, -0.75),
            'angle of arm 1 is ',
            '0.4000, 0.0000, -0.7500',
        ),
        (
            {'kinematics__forearm_swing_max_deg': 10.0},
            to(0, 0.4, -0.8),
            'forearm swing of arm 1 is 24.9',
            '0.4000, -0.8',
        ),
        (
            {'kinematics__serial_singularity_min': 0.77},
            to(0.5, 0, -0.75),
            'the serial singularity of arm ',
            '-0.75',
        ),
        (
            {'kinematics__parallel_singularity_min': 0.6},
            to(0.5, 0, -0.9),
            'the parallel singularity is ',
            '0.5000, 0.0',
        ),
        ({}, to(0.4, 0.4, -0.9, **FAST), 'speed of motor 3 is ', ', -0.'),
        ({}, to(0.3, 0, -0.75, **FAST), 'current of motor 1 is ', ', -0.7'),
        ({'motor__peak_current_a': 0.8}, to(0.3, 0, -0.75), 'current of motor 1 is ', ', -0.7'),
        ({'motor__max_speed_rpm': 500.0}, to(0.3, 0, -0.75), 'speed of motor ', ', -0.7'),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else '',
)
def test_a_move_beyond_a_limit_is_refused_with_axis_value_limit_and_place(change, move, what, place, robot):
    sentence = refusal(plan, [to(0.0, 0.0, -0.76, speed_m_s=0.1), move], robot.replace(**change))
    assert sentence.startswith('moves[1].move_l to (')
    assert what in sentence
    _, _, where = sentence.partition(' at s = ')
    assert place in where
    assert ', the limit is ' in where


def test_a_point_that_no_arm_reaches_is_refused_with_the_arm(robot):
    deep = robot.replace(kinematics__workspace_bottom_m=-2.0)
    assert 'm is out of reach of arm 1' in refusal(plan, [to(0, 0, -1.6)], deep)


def test_the_speed_that_is_refused_is_the_motors_greatest_on_the_way(robot):
    slow = robot.replace(motor__max_speed_rpm=300.0)
    sentence = refusal(plan, [to(0.0, 0.0, -0.9)], slow)
    # straight down all arms turn alike: compare with the central difference of their angles over the path
    z = np.linspace(-0.75, -0.9, 20_001)
    theta = kinematics.inverse(np.stack([0.0 * z, 0.0 * z, z], axis=-1), robot.kinematics)[:, 0]
    s, v, _ = sample_master(np.linspace(0.0, 1.0, 20_001), plan_master(0.15, 1.5, 15.0, 600.0)).T
    rpm = np.interp(s, -0.75 - z, np.gradient(theta, -z)) * v * 32.0 * 60.0 / math.tau
    stated = float(sentence.split(' is ')[1].split(' rpm')[0])
    assert stated == pytest.approx(
        rpm.max(), rel=1e-3
    )  # sampled once per millisecond, printed with four digits
    assert 'the limit is 300 rpm' in sentence


def test_a_move_to_where_the_robot_stands_is_refused(robot):
    assert 'the robot already stands at (0, 0, -0.75) m' in refusal(plan, [to(*HOME)], robot)
    assert 'moves[1].move_l: the robot already stands' in refusal(
        plan, [to(0, 0, -0.8), to(0, 0, -0.8)], robot
    )
    assert 'already stands' in refusal(plan, [to(0, 0, -0.8)], robot, repeat=2)


@pytest.mark.parametrize('speed', [1e-3, 1e-10, 1e-320])
def test_a_very_slow_move_is_planned_or_refused_within_the_memory_of_a_machine(speed, robot):
    try:
        (move,) = plan([to(0, 0, -0.76, speed_m_s=speed)], robot)
    except ProgramError:
        return
    assert move.duration_s == pytest.approx(0.01 / speed, rel=0.01)


def test_a_robot_that_stands_elsewhere_is_named_with_its_distance(robot):
    sentence = refusal(plan, [to(0, 0, -0.8)], robot, position=(0.0, 0.02, -0.75), start_m=[0, 0, -0.75])
    assert 'starts at (0, 0, -0.75) m, but the robot stands at (0, 0.02, -0.75) m, 20.0 mm away' in sentence
    (move,) = plan([to(0, 0, -0.8)], robot, position=(0.0, 0.0009, -0.75), start_m=[0, 0, -0.75])
    assert sample_path([0.0], move.segments)[0, 0].tolist() == [0.0, 0.0009, -0.75]


def test_a_repeated_program_goes_on_from_where_it_ends(robot):
    moves = plan([to(0, 0, -0.8), to(0.1, 0, -0.8)], robot, repeat=3)
    assert len(moves) == 6
    ends = [move.end_m() for move in moves]
    starts = [sample_path([0.0], move.segments)[0, 0] for move in moves]
    for end, start in zip(ends[:-1], starts[1:], strict=True):
        assert np.abs(end - start).max() < EXACT


def test_a_path_that_touches_the_workspaces_edge_is_allowed(robot):
    assert len(plan([to(0, 0, -0.7), to(0, 0, -0.95), to(0.6, 0, -0.9), to(-0.3, 0, -0.7)], robot)) == 4


def test_a_dwell_needs_no_reach(robot):
    check_move(Move(MoveKind.DWELL, rest(1.0), point(HOME)), robot)
    (move,) = plan([{'dwell': {'time_s': 0.25}}], robot)
    assert (move.duration_s, move.length_m) == (0.25, 0.0)
