"""Tests of a planned move: limits of TCP and motors, and reductions of speed."""

import math
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.virtual_master import master_at_distances, plan_master, sample_master
from delta3_pacdrive.planning.plan import Plan, sample_plan
from planned import (
    ACCELERATION,
    CURRENT,
    EXACT,
    GEAR,
    HOME,
    JERK,
    SPEED,
    STEP_S,
    around,
    dwell,
    motors,
    only,
    plan,
    refusal,
    through,
    to,
)
from thoroughness import examples

# programs and what they do


def planned_or_not(robot, moves, **fields):
    """Plan a program drawn blindly: circles and splines may leave the workspace, corners may turn back."""
    try:
        return plan(robot, moves, **fields)
    except ProgramError:
        assume(False)


def tcp(one):
    """Largest speed, acceleration and jerk of the TCP by finite differences of its positions every 0.25 ms."""
    times = np.arange(0.0, one.duration_s + STEP_S, STEP_S)
    p, _, _ = sample_plan(one, times)
    largest = [np.linalg.norm(np.diff(p, order, axis=0), axis=1).max() / STEP_S**order for order in (1, 2, 3)]
    return np.array(largest)


def in_order(limits):
    return [limits[name] for name in ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')]


# places well inside the workspace, where most circles through three of them stay inside too
places = st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.9, -0.76)).map(list)
finite_limits = st.fixed_dictionaries(
    {
        'speed_m_s': st.floats(0.2, 3.0),
        'acceleration_m_s2': st.floats(2.0, 40.0),
        'jerk_m_s3': st.floats(50.0, 3000.0),
    }
)
free_jerk_limits = st.fixed_dictionaries(
    {
        'speed_m_s': st.floats(0.2, 3.0),
        'acceleration_m_s2': st.floats(2.0, 40.0),
        'jerk_m_s3': st.just(math.inf),
    }
)
any_limits = st.one_of(finite_limits, free_jerk_limits)
blends = st.floats(0.002, 0.03)
lines = places.map(lambda p: [to(*p)])
circles = st.tuples(places, places).map(lambda pq: [around(*pq)])
splines = st.lists(places, min_size=2, max_size=6).map(lambda points: [through(points)])
blended = st.lists(st.tuples(places, blends), min_size=2, max_size=4).map(
    lambda legs: [*(to(*p, blend_m=r) for p, r in legs[:-1]), to(*legs[-1][0])]
)
blended_curves = st.tuples(places, blends, places, places, blends, places).map(
    lambda x: [to(*x[0], blend_m=x[1]), around(x[2], x[3], blend_m=x[4]), to(*x[5])]
)
KINDS = {
    'line': lines,
    'circle': circles,
    'spline': splines,
    'blended': blended,
    'blended curves': blended_curves,
}


# limits of the TCP


@pytest.mark.parametrize('kind', KINDS)
def test_the_tcp_keeps_speed_acceleration_and_jerk(kind, robot):
    @settings(max_examples=examples(40))
    @given(KINDS[kind], any_limits)
    def holds(moves, limits):
        planned = planned_or_not(robot, moves, limits=limits)
        assert len(planned.plan) == 1
        speed, acceleration, jerk = tcp(planned.plan)
        assert speed <= SPEED * limits['speed_m_s']
        assert acceleration <= ACCELERATION * limits['acceleration_m_s2']
        assert jerk <= JERK * limits['jerk_m_s3']

    holds()


@pytest.mark.parametrize('kind', ['circle', 'spline', 'blended'])
def test_a_limit_of_the_tcp_is_nearly_met(kind, robot):
    """A move slower than it need be keeps all limits as well: one of them must be used."""

    @settings(max_examples=examples(25))
    @given(KINDS[kind], any_limits)
    def holds(moves, limits):
        planned = planned_or_not(robot, moves, limits=limits)
        used = tcp(planned.plan) / in_order(limits)
        assert used.max() > 0.7

    holds()


@pytest.mark.parametrize('jerk', [100.0, 600.0, math.inf])
def test_line_is_driven_with_the_unchanged_time_optimal_master(jerk, robot):
    planned = plan(robot, [to(0.2, 0.1, -0.85, jerk_m_s3=jerk)])
    move = planned.plan.move(0)
    assert move.length_m == pytest.approx(math.dist(HOME, (0.2, 0.1, -0.85)), rel=EXACT)
    assert np.array_equal(move.master, plan_master(move.length_m, 1.5, 15.0, jerk))
    assert planned.notices == ()


def test_gentle_curve_is_driven_with_the_unchanged_time_optimal_master(robot):
    moves = [around((0.1, 0.1, -0.8), (0.2, 0.0, -0.8), speed_m_s=0.05, acceleration_m_s2=2.0)]
    move = plan(robot, moves).plan.move(0)
    assert np.array_equal(move.master, plan_master(move.length_m, 0.05, 2.0, 600.0))


CRUISES = {
    'line': to(0.4, 0.1, -0.85),
    'circle': around((0.2, 0.2, -0.85), (0.3, -0.2, -0.8)),
    'spline': through([(0.1, 0.05, -0.78), (0.2, 0.12, -0.82), (0.3, 0.1, -0.84), (0.4, 0.0, -0.85)]),
}


@pytest.mark.parametrize('kind', CRUISES)
@pytest.mark.parametrize('speed', [0.3, 0.8, 1.0])
def test_tcp_cruises_at_the_requested_speed_within_a_thousandth(kind, speed, robot):
    """Also where bends make it speed up and brake more gently than asked: that costs no speed in between."""
    planned = plan(robot, [CRUISES[kind]], limits={'speed_m_s': speed})
    times = np.arange(0.0, planned.plan.duration_s, STEP_S)
    p, _, _ = sample_plan(planned.plan, times)
    found = np.linalg.norm(np.diff(p, axis=0), axis=1) / STEP_S
    cruise = np.abs(found / speed - 1.0) < 1e-3
    move = planned.plan.move(0)
    free = plan_master(move.length_m, speed, 15.0, 600.0)
    asked = np.diff(free[:, 0])[(free[:-1, 3] == 0.0) & (free[:-1, 4] == 0.0)].sum()
    assert np.count_nonzero(cruise) * STEP_S > 0.8 * asked > 0.05
    # in one piece
    first, last = np.flatnonzero(cruise)[[0, -1]]
    assert cruise[first : last + 1].all()


# motors


FAST = st.fixed_dictionaries(
    {
        'speed_m_s': st.floats(3.0, 15.0),
        'acceleration_m_s2': st.floats(50.0, 900.0),
        'jerk_m_s3': st.one_of(st.floats(5e3, 1e6), st.just(math.inf)),
    }
)


@pytest.mark.parametrize('kind', KINDS)
def test_motors_keep_their_speed_and_peak_current_for_any_request(kind, robot):
    @settings(max_examples=examples(25))
    @given(KINDS[kind], FAST, st.floats(0.0, 5.0))
    def holds(moves, limits, payload_kg):
        # a long rest, so that the rms current does not matter
        planned = planned_or_not(robot, [*moves, dwell(300.0)], limits=limits, payload_kg=payload_kg)
        one = only(planned)
        speed, current, _ = motors(robot, one, payload_kg)
        assert np.abs(speed).max() <= SPEED * robot.motor.max_speed_rad_s
        assert np.abs(current).max() <= CURRENT * robot.motor.peak_current_a
        used = tcp(one) / in_order(limits)
        assert (used <= [SPEED, ACCELERATION, JERK]).all()
        if planned.notices:
            assert len(planned.notices) == 1
            assert planned.notices[0].startswith('moves[0].')
            # slowed down to a limit, not to a crawl
            motor = max(
                np.abs(speed).max() / robot.motor.max_speed_rad_s,
                np.abs(current).max() / robot.motor.peak_current_a,
            )
            assert max(motor, used.max()) > 0.6

    holds()


NOTICE = re.compile(
    r'^moves\[0\]\.move_l is slowed down, ([\d.]+) s instead of ([\d.]+) s: (current|speed|voltage) of motor ([123]) '
    r'would be ([\d.]+) (A|rpm|V) at s = ([\d.]+) m, \((.+), (.+), (.+)\) m, the limit is ([\d.]+) \6$'
)


def test_the_notice_names_quantity_motor_value_place_and_limit(robot):
    limits = {'speed_m_s': 15.0, 'acceleration_m_s2': 400.0, 'jerk_m_s3': 1e5}
    planned = plan(robot, [to(0.3, 0.0, -0.75, **limits), dwell(10.0)])
    (notice,) = planned.notices
    found = NOTICE.match(notice)
    assert found, notice
    taken, asked, what, motor, value, _, s, x, y, z, limit = found.groups()
    assert float(taken) == pytest.approx(planned.plan.move(0).duration_s, rel=1e-3)
    master = plan_master(0.3, *limits.values())
    assert float(asked) == pytest.approx(master[-1, 0], rel=1e-3)
    assert (what, float(limit)) == ('current', 17.0)
    # what the asked master would draw, from differences of inverse kinematics
    line = curves.line(HOME, (0.3, 0.0, -0.75))
    h = 1e-5
    middle = master_at_distances([float(s)], master)[0, 0]
    around_it = sample_master(middle + np.array([-h, 0.0, h]), master)[:, 0]
    theta = kinematics.inverse(sample_path(around_it, line.segments)[:, 0], robot.kinematics)
    rate, bend = (theta[2] - theta[0]) / (2.0 * h), (theta[2] + theta[0] - 2.0 * theta[1]) / h**2
    torque = dynamics.inverse(theta[1], rate, bend, robot) / GEAR
    torque += 0.10 * np.tanh(GEAR * rate) + 3.0e-4 * GEAR * rate
    current = np.abs(torque) / robot.motor.torque_constant_n_m_a
    assert int(motor) == np.argmax(current) + 1
    assert float(value) == pytest.approx(
        current.max(), rel=5e-3
    )  # rounding of s, and of the second difference
    assert np.abs(np.array([float(x), float(y), float(z)]) - line.at(float(s))[0]).max() < 2e-4


def test_rejected_speed_is_the_largest_of_the_motor_on_the_path(robot):
    slow = robot.replace(motor__max_speed_rpm=300.0)
    sentence = refusal(plan, slow, [to(0.0, 0.0, -0.9, strict=True)])
    # straight down all arms turn alike: compare with the central difference of their angles over the path
    z = np.linspace(-0.75, -0.9, 20_001)
    theta = kinematics.inverse(np.stack([0.0 * z, 0.0 * z, z], axis=-1), robot.kinematics)[:, 0]
    s, v, _, _ = sample_master(np.linspace(0.0, 1.0, 20_001), plan_master(0.15, 1.5, 15.0, 600.0)).T
    rpm = np.interp(s, -0.75 - z, np.gradient(theta, -z)) * v * GEAR * 60.0 / math.tau
    stated = float(sentence.split(' would be ')[1].split(' rpm')[0])
    assert stated == pytest.approx(rpm.max(), rel=1e-3)  # checked every 2 mm, printed with four digits
    assert sentence.startswith('moves[0].move_l: speed of motor ')
    assert sentence.endswith(' m, the limit is 300 rpm (strict)')


@pytest.mark.parametrize(
    ('moves', 'what'),
    [
        (
            [to(0.3, 0.0, -0.75, speed_m_s=15.0, acceleration_m_s2=600.0, jerk_m_s3=1e6, strict=True)],
            'current of motor',
        ),
        (
            [to(0.0, 0.4, -0.9, speed_m_s=15.0, acceleration_m_s2=300.0, jerk_m_s3=1e6, strict=True)],
            ' of motor ',
        ),
        ([around((0.02, 0.02, -0.76), (0.04, 0.0, -0.75), strict=True)], 'TCP acceleration would be '),
        ([through([(0.02, 0.02, -0.76), (0.04, 0.0, -0.75), (0.0, 0.04, -0.75)], strict=True)], 'TCP '),
    ],
)
def test_a_strict_move_is_rejected_and_any_other_slowed_down(moves, what, robot):
    sentence = refusal(plan, robot, [*moves, dwell(100.0)])
    assert what in sentence
    assert sentence.startswith('moves[0].move_')
    assert sentence.endswith(' (strict)')
    ((kind, fields),) = moves[0].items()
    planned = plan(robot, [{kind: {**fields, 'strict': False}}, dwell(100.0)])
    assert what in planned.notices[0]


def test_a_motor_that_cannot_hold_the_arm_is_rejected_even_at_standstill(robot):
    weak = robot.replace(motor__peak_current_a=0.2, motor__nominal_current_a=0.1)
    for moves in (
        [to(0.0, 0.0, -0.8)],
        [dwell(0.1)],
        [{'cubic': {'to_m': [0, 0, -0.8], 'duration_s': 10.0}}],
    ):
        sentence = refusal(plan, weak, moves)
        assert 'current of motor ' in sentence
        assert ', the limit is 0.2 A, even at standstill' in sentence
        assert sentence.count('moves[0]') == 1


# rms current


BUSY = {'speed_m_s': 10.0, 'acceleration_m_s2': 250.0, 'jerk_m_s3': 3e5}


def rms(robot, planned, step=0.5e-3):
    _, current, _ = motors(robot, planned.plan, step=step)
    return np.sqrt((current**2).mean(axis=0))


@pytest.mark.parametrize('rest_s', [None, 0.1, 0.4])
def test_moves_that_would_overheat_a_motor_are_all_slowed_down_to_its_nominal_current(rest_s, robot):
    """A program with longer moves keeps its dwell times."""
    pause = [dwell(rest_s)] if rest_s else []
    planned = plan(robot, [to(0.3, 0, -0.8, **BUSY), to(-0.3, 0, -0.8, **BUSY), *pause], repeat=5)
    found = rms(robot, planned)
    assert found.max() == pytest.approx(robot.motor.nominal_current_a, rel=5e-3)
    assert planned.rms_current_a == pytest.approx(found.tolist(), rel=5e-3)
    notice = planned.notices[-1]
    assert re.match(
        r'all moves take [\d.]+ times as long: the rms current of motor 1 over the program would be [\d.]+ A, '
        r'the limit is 4.1 A$',
        notice,
    )
    free = plan(
        robot.replace(motor__nominal_current_a=16.0), [to(0.3, 0, -0.8, **BUSY), to(-0.3, 0, -0.8, **BUSY)]
    )
    factor = float(notice.split(' take ')[1].split(' times')[0])
    own = [planned.plan.move(n).duration_s for n in (0, 1)]
    assert own == pytest.approx([factor * free.plan.move(n).duration_s for n in (0, 1)], rel=5e-3)
    if rest_s:
        assert planned.plan.move(2).duration_s == rest_s
    unslowed = rms(
        robot,
        plan(
            robot.replace(motor__nominal_current_a=16.0),
            [to(0.3, 0, -0.8, **BUSY), to(-0.3, 0, -0.8, **BUSY), *pause],
            repeat=5,
        ),
    )
    stated = float(notice.split(' would be ')[1].split(' A')[0])
    assert stated == pytest.approx(unslowed.max(), rel=1e-2)


def test_a_rest_long_enough_keeps_the_motors_cool(robot):
    planned = plan(robot, [to(0.3, 0, -0.8, **BUSY), to(-0.3, 0, -0.8, **BUSY), dwell(5.0)], repeat=3)
    assert not any('rms' in notice for notice in planned.notices)
    assert planned.rms_current_a == pytest.approx(rms(robot, planned).tolist(), rel=5e-3)


def test_a_strict_program_that_would_overheat_a_motor_is_rejected(robot):
    moves = [to(0.3, 0, -0.8, **{**BUSY, 'acceleration_m_s2': 100.0}), to(-0.3, 0, -0.8, strict=True)]
    cold = robot.replace(motor__nominal_current_a=1.0)
    sentence = refusal(plan, cold, moves, name='press')
    assert re.match(
        r'program "press": the rms current of motor \d would be [\d.]+ A, the limit is 1 A \(strict\)$',
        sentence,
    )


def test_a_weight_that_alone_overheats_a_motor_is_rejected(robot):
    weak = robot.replace(motor__nominal_current_a=0.1)
    for moves in ([dwell(1.0)], [to(0.0, 0.0, -0.8, speed_m_s=0.01)]):
        sentence = refusal(plan, weak, moves, name='x')
        assert re.match(
            r'program "x": the weight alone requires an rms current of 0.[\d]+ A, the limit is 0.1 A$',
            sentence,
        )


def at_rate(one, rate):
    """Return the plan driven at an override."""
    moves = []
    for move in one.moves:
        master = move.master * np.array([1.0 / rate, 1.0, rate, rate**2, rate**3])
        moves.append(type(move)(move.kind, master, move.segments))
    return Plan.of(moves, one.tables.order)


@pytest.mark.parametrize('acceleration', [10.0, 80.0, 150.0, 250.0])
def test_at_the_largest_override_the_motors_still_keep_their_limits(acceleration, robot):
    limits = {'speed_m_s': 6.0, 'acceleration_m_s2': acceleration, 'jerk_m_s3': 200.0 * acceleration}
    moves = [to(0.3, 0.1, -0.8, **limits), to(-0.3, 0.0, -0.9, **limits), dwell(0.3)]
    planned = plan(robot, moves, repeat=3)
    assert 1.0 <= planned.override_max <= 1.5
    fast = at_rate(planned.plan, planned.override_max)
    speed, current, _ = motors(robot, fast)
    used = [
        np.abs(speed).max() / robot.motor.max_speed_rad_s,
        np.abs(current).max() / robot.motor.peak_current_a,
        np.sqrt((current**2).mean(axis=0)).max() / robot.motor.nominal_current_a,
    ]
    assert max(used) <= CURRENT
    # a share of the current is the weight's and stays: more than a 0.05 larger override would exceed something
    if 1.0 < planned.override_max < 1.5:
        assert max(used) > 0.9
