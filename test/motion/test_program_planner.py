"""Facts about planning: what a program's moves keep, when they are slowed down, and why programs are refused."""

import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from delta3_pacdrive import dynamics, kinematics, simulation
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import curves, program_planner
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.path_dynamics import path_demand, timed_demand
from delta3_pacdrive.motion.plan import OUTPUTS, MoveKind, Plan, sample_plan
from delta3_pacdrive.motion.virtual_master import master_at_distances, plan_master, sample_master

HOME = (0.0, 0.0, -0.75)
EXACT = 1e-12
STEP_S = 0.25e-3
# A move is checked every 2.5 mm, at eight places of each piece of its path and where phases of its master meet, and may
# take a thousandth less time than it needs: up to 0.3 % of jerk
SPEED, ACCELERATION, JERK = 1.001, 1.003, 1.005
CURRENT = 1.02  # of the motors, only at the places of the path
GEAR = 32.0

# programs and what they do


def parse(robot, moves, **fields):
    return programs.parse({'moves': moves, **fields}, robot.motion)


def plan(robot, moves, position=HOME, **fields):
    """Plan a program of statements for a robot at a position."""
    return program_planner.plan(parse(robot, moves, **fields), position, robot)


def to(x, y, z, **options):
    return {'move_l': {'to_m': [x, y, z], **options}}


def around(via, end, **options):
    return {'move_c': {'via_m': list(via), 'to_m': list(end), **options}}


def through(points, **options):
    return {'move_sb': {'through_m': [list(p) for p in points], **options}}


def dwell(time_s):
    return {'dwell': {'time_s': time_s}}


def output(name='gripper', value=True, **options):
    return {'output': {'name': name, 'value': value, **options}}


def refusal(function, *arguments, **options):
    """Return the sentence with which a program is refused."""
    with pytest.raises(ProgramError) as caught:
        function(*arguments, **options)
    sentence = str(caught.value)
    assert '\n' not in sentence
    assert 0 < len(sentence) < 500
    return sentence


def planned_or_not(robot, moves, **fields):
    """Plan a program drawn blindly: circles and splines may leave the workspace, corners may turn back."""
    try:
        return plan(robot, moves, **fields)
    except ProgramError:
        assume(False)


def only(planned, number=0):
    """Return the plan of one of the moves."""
    return Plan.of([planned.plan.move(number)])


def tcp(one):
    """Largest speed, acceleration and jerk of the TCP by finite differences of its positions every 0.25 ms."""
    times = np.arange(0.0, one.duration_s + STEP_S, STEP_S)
    p, _, _ = sample_plan(one, times)
    largest = [np.linalg.norm(np.diff(p, order, axis=0), axis=1).max() / STEP_S**order for order in (1, 2, 3)]
    return np.array(largest)


def in_order(limits):
    return [limits[name] for name in ('speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')]


def motors(robot, one, payload_kg=None, step=STEP_S):
    """Motor speeds [rad/s] and currents [A], (n, 3): differences of inverse kinematics, (4.26) and friction."""
    if payload_kg is not None:
        robot = robot.replace(dynamics__payload_mass_kg=payload_kg)
    times = np.arange(0.0, one.duration_s + step, step)
    p, master, _ = sample_plan(one, times)
    theta = kinematics.inverse(p, robot.kinematics)
    rate = (theta[2:] - theta[:-2]) / (2.0 * step)
    acceleration = (theta[2:] + theta[:-2] - 2.0 * theta[1:-1]) / step**2
    torque = dynamics.inverse(theta[1:-1], rate, acceleration, robot) / GEAR
    m = robot.motor
    speed = GEAR * rate
    friction = m.static_friction_n_m * np.tanh(speed / m.friction_smoothing_rad_s)
    friction += m.viscous_friction_n_m_s_rad * speed
    return speed, (torque + friction) / m.torque_constant_n_m_a, master[1:-1, 0]


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
    @settings(max_examples=40)
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

    @settings(max_examples=25)
    @given(KINDS[kind], any_limits)
    def holds(moves, limits):
        planned = planned_or_not(robot, moves, limits=limits)
        used = tcp(planned.plan) / in_order(limits)
        assert used.max() > 0.7

    holds()


@pytest.mark.parametrize('jerk', [100.0, 600.0, math.inf])
def test_a_line_is_driven_with_the_time_optimal_master_itself(jerk, robot):
    planned = plan(robot, [to(0.2, 0.1, -0.85, jerk_m_s3=jerk)])
    move = planned.plan.move(0)
    assert move.length_m == pytest.approx(math.dist(HOME, (0.2, 0.1, -0.85)), rel=EXACT)
    assert np.array_equal(move.master, plan_master(move.length_m, 1.5, 15.0, jerk))
    assert planned.notices == ()


def test_a_gentle_curve_is_driven_with_the_time_optimal_master_itself(robot):
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
def test_on_the_cruise_the_tcp_keeps_the_asked_speed_within_a_thousandth(kind, speed, robot):
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
def test_motors_keep_their_speed_and_peak_current_whatever_is_asked(kind, robot):
    @settings(max_examples=25)
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
    limits = {'speed_m_s': 20.0, 'acceleration_m_s2': 400.0, 'jerk_m_s3': 1e5}
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


def test_the_speed_that_is_refused_is_the_motors_greatest_on_the_way(robot):
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
            [to(0.3, 0.0, -0.75, speed_m_s=20.0, acceleration_m_s2=600.0, jerk_m_s3=1e6, strict=True)],
            'current of motor',
        ),
        (
            [to(0.0, 0.4, -0.9, speed_m_s=20.0, acceleration_m_s2=300.0, jerk_m_s3=1e6, strict=True)],
            ' of motor ',
        ),
        ([around((0.02, 0.02, -0.76), (0.04, 0.0, -0.75), strict=True)], 'TCP acceleration would be '),
        ([through([(0.02, 0.02, -0.76), (0.04, 0.0, -0.75), (0.0, 0.04, -0.75)], strict=True)], 'TCP '),
    ],
)
def test_a_strict_move_is_refused_and_any_other_slowed_down(moves, what, robot):
    sentence = refusal(plan, robot, [*moves, dwell(100.0)])
    assert what in sentence
    assert sentence.startswith('moves[0].move_')
    assert sentence.endswith(' (strict)')
    ((kind, fields),) = moves[0].items()
    planned = plan(robot, [{kind: {**fields, 'strict': False}}, dwell(100.0)])
    assert what in planned.notices[0]


def test_a_motor_that_cannot_hold_the_arm_is_refused_even_at_standstill(robot):
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
    """A program whose moves take longer dwells as long as before."""
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


def test_a_strict_program_that_would_overheat_a_motor_is_refused(robot):
    moves = [to(0.3, 0, -0.8, **{**BUSY, 'acceleration_m_s2': 100.0}), to(-0.3, 0, -0.8, strict=True)]
    cold = robot.replace(motor__nominal_current_a=1.0)
    sentence = refusal(plan, cold, moves, name='press')
    assert re.match(
        r'program "press": the rms current would be [\d.]+ A, the limit is 1 A \(strict\)$', sentence
    )


def test_a_weight_that_alone_overheats_a_motor_is_refused(robot):
    weak = robot.replace(motor__nominal_current_a=0.1)
    for moves in ([dwell(1.0)], [to(0.0, 0.0, -0.8, speed_m_s=0.01)]):
        sentence = refusal(plan, weak, moves, name='x')
        assert re.match(
            r'program "x": the weight alone asks for an rms current of 0.[\d]+ A, the limit is 0.1 A$',
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
    assert 1.0 <= planned.rate_max <= 1.5
    fast = at_rate(planned.plan, planned.rate_max)
    speed, current, _ = motors(robot, fast)
    used = [
        np.abs(speed).max() / robot.motor.max_speed_rad_s,
        np.abs(current).max() / robot.motor.peak_current_a,
        np.sqrt((current**2).mean(axis=0)).max() / robot.motor.nominal_current_a,
    ]
    assert max(used) <= CURRENT
    # a share of the current is the weight's and stays: more than a 0.05 larger override would exceed something
    if 1.0 < planned.rate_max < 1.5:
        assert max(used) > 0.9


# demand: what the path asks of arms and motors

CURVES = {
    'line': curves.line(HOME, (0.3, 0.2, -0.9)),
    'circle': curves.arc(HOME, (0.1, 0.1, -0.8), (0.2, -0.1, -0.9)),
    'spline': curves.spline([HOME, (0.1, 0.1, -0.8), (0.2, 0.0, -0.9), (0.1, -0.2, -0.8)]),
}


@pytest.mark.parametrize('kind', CURVES)
@pytest.mark.parametrize('payload_kg', [0.0, 0.5, 4.0])
def test_demand_is_the_derivative_of_inverse_kinematics_over_time(kind, payload_kg, robot):
    curve = CURVES[kind]
    master = plan_master(curve.length_m, 1.5, 15.0, 600.0)
    h = 1e-4
    times = np.linspace(0.01, master[-1, 0] - 0.01, 400)
    # away from the phases' ends, where the jerk jumps, and the pieces' joints, where the third derivative does
    at = sample_master(times, master)
    joints = np.concatenate([master_at_distances(curve.segments[:, 0], master)[:, 0], master[:, 0]])
    inner = np.abs(times[:, None] - joints).min(axis=1) > 2.0 * h
    times, at = times[inner], at[inner]
    samples = sample_path(at[:, 0], curve.segments)
    d = timed_demand(
        times, at, samples, path_demand(samples, np.zeros(len(at), np.int64), (payload_kg,), robot), robot
    )

    def theta_at(shift):
        s = sample_master(times + shift, master)[:, 0]
        return kinematics.inverse(sample_path(s, curve.segments)[:, 0], robot.kinematics)

    rate = (theta_at(h) - theta_at(-h)) / (2.0 * h)
    acceleration = (theta_at(h) + theta_at(-h) - 2.0 * theta_at(0.0)) / h**2
    assert np.abs(d.arm_speed_rad_s - rate).max() < 1e-4  # second order in h
    assert np.abs(d.arm_acceleration_rad_s2 - acceleration).max() < 1e-2
    assert np.array_equal(d.motor_speed_rad_s, GEAR * d.arm_speed_rad_s)
    loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
    torque = dynamics.inverse(d.arm_angle_rad, d.arm_speed_rad_s, d.arm_acceleration_rad_s2, loaded) / GEAR
    torque += 0.10 * np.tanh(d.motor_speed_rad_s) + 3.0e-4 * d.motor_speed_rad_s
    assert np.abs(d.motor_current_a - torque / 0.78).max() < 1e-9


def test_a_resting_robot_draws_the_holding_current(robot):
    planned = plan(robot, [dwell(0.25)])
    assert planned.rms_current_a == pytest.approx(
        [0.2782] * 3, abs=1e-4
    )  # the parameter study's 0.28 A at home
    move = planned.plan.move(0)
    assert (move.duration_s, move.length_m, move.kind) == (0.25, 0.0, MoveKind.DWELL)


@given(payload_kg=st.floats(0.0, 3.0))
def test_the_payload_weighs_on_the_motors(payload_kg, robot):
    theta = kinematics.inverse(HOME, robot.kinematics)
    weight = dynamics.gravity(theta, robot.replace(dynamics__payload_mass_kg=payload_kg)) / GEAR / 0.78
    for planned in (
        plan(robot, [dwell(1.0)], payload_kg=payload_kg),
        plan(robot, [output(payload_kg=payload_kg), dwell(1.0)]),
    ):
        assert planned.rms_current_a == pytest.approx(np.abs(weight).tolist(), rel=1e-3, abs=1e-4)


# refusals: workspace, arms, singularities, reach


@pytest.mark.parametrize(
    ('change', 'move', 'what', 'place'),
    [
        ({}, to(0.7, 0, -0.8), 'the distance from the z axis is 0.7 m', '(0.7000, 0.0000, -0.8000)'),
        ({}, to(0, 0, -0.65), 'z is -0.65 m', '(0.0000, 0.0000, -0.6500)'),
        ({}, to(0, 0, -1.0), 'z is -1 m', '(0.0000, 0.0000, -1.0000)'),
        ({}, around((0.1, 0.0, -0.98), (0.2, 0.0, -0.76)), 'z is -0.9', ', 0.0000, -0.9'),
        (
            {'kinematics__arm_angle_max_deg': 40.0},
            to(0, 0.5, -0.9),
            'the angle of arm 3 is 6',
            '(0.0000, 0.5000, -0.9000)',
        ),
        (
            {'kinematics__arm_angle_min_deg': -10.0},
            to(0.4, 0, -0.75),
            'the angle of arm 1 is ',
            '(0.4000, 0.0000, -0.7500)',
        ),
        (
            {'kinematics__forearm_swing_max_deg': 10.0},
            to(0, 0.4, -0.8),
            'the forearm swing of arm 1 is 24.9',
            '0.4000, -0.8',
        ),
        (
            {'kinematics__serial_singularity_min': 0.77},
            to(0.5, 0, -0.75),
            'the distance from the serial singularity of arm ',
            '-0.75',
        ),
        (
            {'kinematics__parallel_singularity_min': 0.6},
            to(0.5, 0, -0.9),
            'the distance from the parallel singularity is ',
            '(0.5000, 0.0',
        ),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else '',
)
def test_a_move_beyond_a_limit_is_refused_with_value_limit_and_place(change, move, what, place, robot):
    sentence = refusal(plan, robot.replace(**change), [to(0.0, 0.0, -0.76, speed_m_s=0.1), move])
    assert sentence.startswith(f'moves[1].{next(iter(move))}: {what}')
    _, _, where = sentence.partition(' at s = ')
    assert place in where
    assert ', the limit is ' in where


def test_a_point_that_no_arm_reaches_is_refused_with_the_arm(robot):
    deep = robot.replace(kinematics__workspace_bottom_m=-2.0)
    sentence = refusal(plan, deep, [to(0, 0, -1.6)])
    assert re.match(r'moves\[0\]\.move_l: \(0, 0, -1\.[34]\d*\) m is out of reach of arm 1$', sentence)


def test_a_path_that_touches_the_workspaces_edge_is_allowed(robot):
    planned = plan(robot, [to(0, 0, -0.7), to(0, 0, -0.95), to(0.6, 0, -0.9), to(-0.3, 0, -0.7)])
    assert len(planned.plan) == 4


OUTSIDE = (0.63, 0.0, -0.8)  # 30 mm


def plan_back(robot, moves, position=OUTSIDE, **fields):
    """Plan for a robot that was pushed to a position."""
    return program_planner.plan(parse(robot, moves, **fields), position, robot, returning=True)


@pytest.mark.parametrize(
    'moves',
    [
        [to(0.5, 0, -0.8)],
        [to(0.5, 0.3, -0.8), to(0.6, 0, -0.9)],
        [to(0.58, 0, -0.8, blend_m=0.01), to(0.2, 0, -0.75)],
        [output(), to(0.5, 0, -0.8)],
        [{'cubic': {'to_m': [0.5, 0, -0.8], 'duration_s': 1.0}}, dwell(0.1)],
    ],
)
def test_a_robot_that_was_pushed_out_of_the_workspace_may_come_back(moves, robot):
    p, _, _ = sample_plan(plan_back(robot, moves).plan, np.linspace(0.0, 2.0, 400))
    assert p[0] == pytest.approx(OUTSIDE)
    assert np.hypot(p[-1, 0], p[-1, 1]) <= 0.6
    assert 'the distance from the z axis is 0.6' in refusal(plan, robot, moves, OUTSIDE)


def test_an_arm_that_was_pushed_beyond_its_angle_may_come_back(robot):
    narrow = robot.replace(kinematics__arm_angle_max_deg=15.0)
    low = (0.0, 0.0, -0.93)
    assert len(plan_back(narrow, [to(0, 0, -0.8)], low).plan) == 1
    assert 'the angle of arm' in refusal(plan_back, narrow, [to(0, 0, -0.94)], low)
    assert 'the angle of arm' in refusal(plan, narrow, [to(0, 0, -0.8)], low)


@pytest.mark.parametrize(
    ('moves', 'what'),
    [
        ([to(0.64, 0, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.64 m'),
        ([to(0, 0.65, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.65 m'),
        ([to(-0.61, 0, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.61 m'),
        ([to(0.62, 0, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.62 m'),
        ([to(0.63, 0, -0.85)], 'moves[0].move_l: the distance from the z axis is 0.63 m'),
        (
            [around((0.5, 0.3, -0.8), (0.62, 0.02, -0.8))],
            'moves[0].move_c: the distance from the z axis is ',
        ),
        ([dwell(0.1), to(0.5, 0, -0.8)], 'moves[0].dwell: the distance from the z axis is 0.63 m'),
        ([to(0.5, 0, -0.8), to(0.61, 0, -0.8)], 'moves[1].move_l: the distance from the z axis is 0.61 m'),
        ([to(0.5, 0, -0.65)], 'moves[0].move_l: z is -0.65 m'),
    ],
)
def test_from_outside_the_workspace_only_the_first_move_leads_back_and_to_the_inside(moves, what, robot):
    assert refusal(plan_back, robot, moves).startswith(what)


def test_no_program_starts_outside_the_workspace_by_itself(robot):
    program = parse(robot, [to(0.5, 0, -0.8)], start_m=list(OUTSIDE))
    with pytest.raises(ProgramError, match=r'the distance from the z axis is 0\.63 m'):
        simulation.run(program, robot)


def test_a_move_to_where_the_robot_stands_is_refused(robot):
    assert refusal(plan, robot, [to(*HOME)]) == 'moves[0].move_l: the robot already stands at (0, 0, -0.75) m'
    assert 'moves[1].move_l: the robot already stands' in refusal(
        plan, robot, [to(0, 0, -0.8), to(0, 0, -0.8)]
    )
    assert 'moves[0].move_l: the robot already stands' in refusal(plan, robot, [to(0, 0, -0.8)], repeat=2)


def test_refusals_of_curves_name_the_statement(robot):
    first = to(0.1, 0, -0.8)
    line = around((0.2, 0, -0.8), (0.3, 0, -0.8))
    assert refusal(plan, robot, [first, line]).startswith(
        'moves[1].move_c: start, circle point and end are on a line'
    )
    same = through([(0.1, 0, -0.8), (0.2, 0, -0.8)])
    assert refusal(plan, robot, [first, same]) == 'moves[1].move_sb: points 0 and 1 of the spline coincide'
    back = through([(0.2, 0, -0.8), (0.1, 0, -0.8)])
    assert refusal(plan, robot, [first, back]).startswith(
        'moves[1].move_sb: the spline turns too sharply near (0.2000'
    )


@pytest.mark.parametrize('speed', [1e-2, 1e-3, 1e-5, 1e-6])
@pytest.mark.parametrize('blend_m', [0.0, 0.005])
def test_a_very_slow_move_is_planned_or_refused_within_the_memory_of_a_machine(speed, blend_m, robot):
    moves = [to(0, 0, -0.76, blend_m=blend_m), to(0.01, 0.0, -0.76)]
    length = (
        0.02
        if blend_m == 0.0
        else 0.01
        + curves.blend(
            curves.line(HOME, (0, 0, -0.76)), curves.line((0, 0, -0.76), (0.01, 0, -0.76)), blend_m
        ).length_m
    )
    if length / speed / (2 if blend_m == 0.0 else 1) > 3600.0:
        assert 'it would take ' in refusal(plan, robot, moves, limits={'speed_m_s': speed})
    else:
        planned = plan(robot, moves, limits={'speed_m_s': speed})
        assert planned.plan.duration_s == pytest.approx(length / speed, rel=0.05)


# where programs start and end


def test_a_robot_that_stands_elsewhere_is_named_with_its_distance(robot):
    sentence = refusal(
        plan, robot, [to(0, 0, -0.8)], position=(0.0, 0.02, -0.75), start_m=[0, 0, -0.75], name='a'
    )
    assert sentence == (
        'program "a" starts at (0, 0, -0.75) m, but the robot stands at (0, 0.02, -0.75) m, 20.0 mm away'
    )
    planned = plan(robot, [to(0, 0, -0.8)], position=(0.0, 0.0009, -0.75), start_m=[0, 0, -0.75])
    assert planned.plan.start_m().tolist() == [0.0, 0.0009, -0.75]


def ends_of(planned):
    return np.array([planned.plan.move(n).end_m() for n in range(len(planned.plan))])


def test_points_may_be_named_and_relative_to_the_robot_or_to_a_point(robot):
    points = {'pick': [0.1, 0.0, -0.85], 'place': [0.2, 0.1, -0.9]}
    moves = [
        {'move_l': {'to_m': 'pick'}},
        {'move_l': {'to_m': {'by_m': [0.0, 0.0, 0.05]}}},
        {'move_l': {'to_m': {'point': 'place', 'by_m': [0.0, 0.0, 0.1]}}},
        {
            'move_c': {
                'via_m': {'by_m': [0.05, 0.05, 0.0]},
                'to_m': {'point': 'pick', 'by_m': [0.0, 0.1, 0.0]},
            }
        },
        # each step of a spline is relative to the point before it
        {'move_sb': {'through_m': [{'by_m': [0.05, 0.0, 0.0]}, {'by_m': [0.05, 0.02, 0.0]}, 'place']}},
        {'cubic': {'to_m': {'by_m': [0.0, 0.0, 0.05]}, 'duration_s': 0.5}},
    ]
    planned = plan(robot, moves, points=points, start_m=[0.0, 0.0, -0.75])
    expected = [
        [0.1, 0.0, -0.85],
        [0.1, 0.0, -0.8],
        [0.2, 0.1, -0.8],
        [0.1, 0.1, -0.85],
        [0.2, 0.1, -0.9],
        [0.2, 0.1, -0.85],
    ]
    assert np.abs(ends_of(planned) - expected).max() < 1e-9
    passed = planned.plan.move(4)
    s = np.linspace(0.0, passed.length_m, 4001)
    p = sample_path(s, passed.segments)[:, 0]
    for point in ([0.15, 0.1, -0.85], [0.2, 0.12, -0.85]):
        assert np.linalg.norm(p - point, axis=1).min() < s[1]


def test_a_repeated_program_goes_on_from_where_it_ends(robot):
    planned = plan(robot, [to(0, 0, -0.8), to(0.1, 0, -0.8)], repeat=3)
    assert len(planned.plan) == 6
    starts = np.array([planned.plan.move(n).segments[0, 1::6] for n in range(6)])
    assert starts[0].tolist() == list(HOME)
    assert np.abs(ends_of(planned)[:-1] - starts[1:]).max() < EXACT


def test_each_different_round_is_planned_once(robot):
    """Round 1 begins at home, all others where a round ends."""
    planned = plan(robot, [to(0, 0, -0.8), to(0.1, 0, -0.8), dwell(0.1)], repeat=1000)
    assert (len(planned.plan), len(planned.plan.moves)) == (3000, 6)
    assert planned.plan.tables.order[:9].tolist() == [0, 1, 2, 3, 4, 5, 3, 4, 5]
    back = plan(robot, [to(0.1, 0, -0.8), to(*HOME)], repeat=1000)
    assert (len(back.plan), len(back.plan.moves)) == (2000, 2)


@settings(max_examples=20)
@given(st.lists(st.tuples(*[st.floats(-0.04, 0.04)] * 3), min_size=1, max_size=3))
def test_rounds_of_relative_moves_that_come_back_are_one_round_but_for_rounding(robot, steps):
    steps = [np.round(step, 3) for step in steps]
    assume(min(np.linalg.norm(step) for step in [*steps, np.sum(steps, axis=0)]) > 2e-3)
    there = [{'move_l': {'to_m': {'by_m': step.tolist()}}} for step in steps]
    back = {'move_l': {'to_m': {'by_m': (-np.sum(steps, axis=0)).tolist()}}}
    planned = plan(robot, [*there, back], position=(0.01, 0.02, -0.83), repeat=100)
    assert len(planned.plan.moves) <= 2 * (len(there) + 1)
    starts = np.array([planned.plan.move(n).segments[0, 1::6] for n in range(1, len(planned.plan))])
    assert np.abs(ends_of(planned)[:-1] - starts).max() < 1e-9


def test_a_payload_carried_into_the_next_round_makes_it_another_one(robot):
    moves = [to(0, 0, -0.8), output(payload_kg=2.0), to(*HOME)]
    planned = plan(robot, moves, repeat=4)
    assert len(planned.plan.moves) == 4
    assert [planned.plan.move(n).payload_kg for n in range(8)] == [0.5, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]


def test_relative_rounds_walk_on_until_they_leave_the_workspace(robot):
    step = {'move_l': {'to_m': {'by_m': [0.05, 0.0, 0.0]}}}
    assert np.abs(ends_of(plan(robot, [step], repeat=10))[-1] - [0.5, 0.0, -0.75]).max() < 1e-9
    assert 'the distance from the z axis is 0.65 m' in refusal(plan, robot, [step], repeat=20)


def test_a_program_may_have_no_more_moves_than_a_plan_holds(robot):
    assert 'the program has 30000 moves, the limit is 20000' in refusal(
        plan, robot, [dwell(1.0)] * 3, repeat=10_000
    )


def test_packaged_programs_are_planned_without_being_slowed_down(robot):
    for name in programs.packaged_names():
        program = programs.load(name, robot.motion)
        planned = program_planner.plan(program, program.start_m or robot.motion.home_m, robot)
        assert planned.name == program.name
        assert len(planned.plan) >= program.repeat
        assert all(' is slowed down, ' in notice for notice in planned.notices)


# blends


def test_inside_a_blended_move_the_speed_never_drops_to_zero(robot):
    planned = plan(
        robot,
        [
            to(0.1, 0.0, -0.75, blend_m=0.02),
            around((0.15, 0.1, -0.8), (0.1, 0.2, -0.8), blend_m=0.02),
            through([(0.0, 0.2, -0.85), (-0.1, 0.15, -0.8)], blend_m=0.02),
            to(-0.1, 0.0, -0.8),
        ],
    )
    assert len(planned.plan) == 1
    move = planned.plan.move(0)
    assert move.kind == MoveKind.BLENDED
    inner = np.linspace(0.05, move.length_m - 0.05, 500)
    assert master_at_distances(inner, move.master)[:, 2].min() > 0.2


def test_a_blended_move_stays_within_the_radius_of_its_corners_and_else_on_its_lines(robot):
    corners = np.array([HOME, (0.2, 0.0, -0.75), (0.2, 0.2, -0.85), (0.0, 0.2, -0.8)])
    radii = (0.03, 0.05)
    moves = [to(*corners[1], blend_m=radii[0]), to(*corners[2], blend_m=radii[1]), to(*corners[3])]
    move = plan(robot, moves).plan.move(0)
    s = np.linspace(0.0, move.length_m, 5000)
    p = sample_path(s, move.segments)[:, 0]
    off = np.min(
        [
            np.linalg.norm(
                p - a - np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)[:, None] * (b - a), axis=1
            )
            for a, b in itertools.pairwise(corners)
        ],
        axis=0,
    )
    near = [np.linalg.norm(p - c, axis=1) for c in corners[1:3]]
    inside = (near[0] < radii[0]) | (near[1] < radii[1])
    assert off[~inside].max() < 1e-9
    assert off[inside].max() > 1e-3
    assert np.abs(p[0] - corners[0]).max() < EXACT
    assert np.abs(p[-1] - corners[-1]).max() < 1e-9


def test_a_blend_may_use_up_the_whole_of_two_moves(robot):
    planned = plan(robot, [to(0.0, 0.0, -0.8, blend_m=0.05), to(0.05, 0.0, -0.8)])
    assert np.abs(ends_of(planned)[-1] - [0.05, 0.0, -0.8]).max() < 1e-9
    assert (
        len(
            plan(
                robot, [to(0, 0, -0.8, blend_m=0.025), to(0.05, 0, -0.8, blend_m=0.025), to(0.05, 0.05, -0.8)]
            ).plan
        )
        == 1
    )


@pytest.mark.parametrize(
    ('moves', 'reason'),
    [
        (
            [to(0.1, 0, -0.75, blend_m=0.06), to(0.1, 0.1, -0.75, blend_m=0.06), to(0, 0.1, -0.75)],
            'moves[1].move_l: its blends overlap: 0.06 m at its start and 0.06 m at its end on a length of 0.1 m',
        ),
        (
            [to(0.05, 0, -0.75, blend_m=0.06), to(0.1, 0.1, -0.75)],
            'moves[0].move_l: its blends overlap: 0 m at its start and 0.06 m at its end on a length of 0.05 m',
        ),
        (
            [to(0.1, 0, -0.75, blend_m=0.06), to(0.1, 0.05, -0.75)],
            'moves[0].move_l: blend_m is 0.06, but the next move is only 0.05 m long',
        ),
        ([to(0.1, 0, -0.75, blend_m=0.01)], 'moves[0].move_l: blend_m needs a move that follows'),
        (
            [to(0.1, 0, -0.75, blend_m=0.01), dwell(1.0)],
            'moves[1].dwell: moves[0].move_l has blend_m, which needs a move that follows',
        ),
        (
            [to(0.1, 0, -0.75, blend_m=0.01), {'cubic': {'to_m': [0, 0, -0.8], 'duration_s': 1.0}}],
            'moves[1].cubic: moves[0].move_l has blend_m, which needs a move that follows',
        ),
        (
            [to(0.1, 0, -0.75, blend_m=0.01), to(0.05, 0, -0.75)],
            'moves[0].move_l: the path turns back at this corner, which cannot be rounded; use blend_m: 0',
        ),
    ],
)
def test_a_blend_that_cannot_be_is_refused(moves, reason, robot):
    assert refusal(plan, robot, moves).endswith(
        reason.removeprefix('moves[1].dwell: ').removeprefix('moves[1].cubic: ')
    )


def test_each_leg_of_a_blended_move_keeps_its_own_speed(robot):
    legs = [to(0.2, 0.0, -0.75, blend_m=0.01, speed_m_s=1.2), to(0.2, 0.2, -0.75, speed_m_s=0.3)]
    move = plan(robot, legs).plan.move(0)
    s = np.linspace(0.0, move.length_m, 3000)
    p = sample_path(s, move.segments)[:, 0]
    v = master_at_distances(s, move.master)[:, 2]
    second = p[:, 0] > 0.2 - 0.01
    assert v[second].max() <= 0.3 * SPEED
    assert v[~second].max() > 1.0


# outputs


def place_on(move, point):
    """Distance on a move at which it passes nearest to a point."""
    s = np.linspace(0.0, move.length_m, 20_001)
    return s[np.argmin(np.linalg.norm(sample_path(s, move.segments)[:, 0] - point, axis=1))]


def events_of(planned):
    return [planned.plan.move(n).events.tolist() for n in range(len(planned.plan))]


def test_outputs_lie_at_the_end_of_the_move_before_them_or_ahead_of_it(robot):
    planned = plan(
        robot,
        [
            to(0.2, 0.0, -0.75),
            output(before_m=0.05, payload_kg=1.25),
            output('output3', False),
            to(0.2, 0.1, -0.75),
        ],
    )
    first, second = events_of(planned)
    assert first == [
        [pytest.approx(0.15), 0.0, 1.0, 1.25],
        [pytest.approx(0.2), OUTPUTS.index('output3'), 0.0, -1.0],
    ]
    assert second == []
    assert planned.plan.move(1).payload_kg == 1.25


def test_an_output_in_a_blended_move_lies_in_the_middle_of_the_corner(robot):
    planned = plan(robot, [to(0.2, 0.0, -0.75, blend_m=0.04), output(), to(0.2, 0.2, -0.75)])
    ((event,),) = events_of(planned)
    move = planned.plan.move(0)
    assert event[0] == pytest.approx(place_on(move, (0.2, 0.0, -0.75)), abs=2.0 * move.length_m / 20_000)
    before = plan(robot, [to(0.2, 0.0, -0.75, blend_m=0.04), output(before_m=0.1), to(0.2, 0.2, -0.75)])
    assert events_of(before)[0][0][0] == pytest.approx(event[0] - 0.1)


def test_outputs_without_a_move_before_them_lie_at_the_start_of_the_next_one(robot):
    planned = plan(
        robot, [output(), to(0.2, 0.0, -0.75), dwell(0.1), output('output1'), to(*HOME), dwell(0.1)]
    )
    first, pause, back, last = events_of(planned)
    assert first == [[0.0, 0.0, 1.0, -1.0]]
    assert pause == []
    assert back == [[0.0, 1.0, 1.0, -1.0]]
    assert last == []


def test_outputs_between_two_dwells_and_at_the_end_of_a_program_are_carried_out(robot):
    planned = plan(robot, [dwell(0.1), output(), dwell(0.1), output('gripper', False)])
    first, second = events_of(planned)
    assert first == []
    assert second[0] == [0.0, 0.0, 1.0, -1.0]
    assert second[1][0] > planned.plan.move(1).length_m  # due when the move is over
    assert second[1][1:] == [0.0, 0.0, -1.0]
    after_move = plan(robot, [to(0, 0, -0.8), output()])
    assert events_of(after_move)[0][0][0] == pytest.approx(0.05)


def test_events_are_in_order_of_their_places_and_the_last_one_decides_the_payload(robot):
    moves = [
        to(0.2, 0.0, -0.75),
        output(payload_kg=1.0),
        output('output1', before_m=0.1, payload_kg=2.0),
        to(*HOME),
    ]
    planned = plan(robot, moves)
    assert [row[3] for row in events_of(planned)[0]] == [2.0, 1.0]
    assert planned.plan.move(1).payload_kg == 1.0


@pytest.mark.parametrize(
    ('moves', 'reason'),
    [
        ([output()], 'an output needs a move or a dwell before it or after it'),
        (
            [to(0, 0, -0.8), output(before_m=0.06)],
            'moves[0].move_l: an output 0.06 m before its end would lie before',
        ),
        ([output(before_m=0.01), to(0, 0, -0.8)], 'would lie before the start of the move'),
        (
            [dwell(0.1), output(before_m=0.01), dwell(0.1)],
            'before_m of an output needs a move right before it',
        ),
        ([dwell(0.1), output(before_m=0.01)], 'before_m of an output needs a move right before it'),
        (
            [
                {'cubic': {'to_m': [0, 0, -0.8], 'duration_s': 1.0, 'end_velocity_m_s': [0.1, 0, 0]}},
                output(),
                {'cubic': {'to_m': [0, 0, -0.75], 'duration_s': 1.0}},
            ],
            'moves[1].output: an output cannot stand between the cubics of a sequence',
        ),
    ],
)
def test_an_output_without_a_place_is_refused(moves, reason, robot):
    assert reason in refusal(plan, robot, moves)


@pytest.mark.parametrize('kind', ['line', 'cubic'])
def test_a_heavy_payload_gripped_before_a_move_slows_it_down(kind, robot):
    end = [0.3, 0.0, -0.75]
    moves = {
        'line': [to(*end, speed_m_s=8.0, acceleration_m_s2=200.0, jerk_m_s3=1e5)],
        'cubic': [{'cubic': {'to_m': end, 'duration_s': 0.1}}],
    }[kind]
    rest = dwell(100.0)
    free = plan(robot, [*moves, rest])
    heavy = plan(robot, [output(payload_kg=8.0), *moves, rest])
    assert heavy.plan.move(0).duration_s > 1.2 * free.plan.move(0).duration_s
    _, current, _ = motors(robot, only(heavy), payload_kg=8.0)
    assert np.abs(current).max() <= CURRENT * robot.motor.peak_current_a
    assert np.abs(current).max() > 0.8 * robot.motor.peak_current_a


def test_a_payload_gripped_on_the_way_weighs_from_its_place_on(robot):
    limits = {'speed_m_s': 10.0, 'acceleration_m_s2': 600.0, 'jerk_m_s3': math.inf}
    moves = [
        to(-0.3, 0.1, -0.8),
        to(0.3, 0.0, -0.8, **limits),
        output(before_m=0.4, payload_kg=8.0),
        dwell(100.0),
    ]
    one = only(plan(robot, moves), 1)
    peak = robot.motor.peak_current_a
    _, light, s = motors(robot, one, payload_kg=0.5)
    _, heavy, _ = motors(robot, one, payload_kg=8.0)
    place = one.moves[0].events[0, 0]
    grid = 5e-3  # one place of the grid and its neighbour
    assert np.abs(light[s < place - grid]).max() <= CURRENT * peak
    assert np.abs(heavy[s > place + grid]).max() <= CURRENT * peak
    assert np.abs(heavy[s < place - grid]).max() > 1.5 * peak


# cubics of chapter 5


def cubic(x, y, z, duration_s, velocity=(0.0, 0.0, 0.0)):
    return {'cubic': {'to_m': [x, y, z], 'duration_s': duration_s, 'end_velocity_m_s': list(velocity)}}


def test_cubics_in_sequence_meet_with_the_prescribed_velocities_at_the_prescribed_times(robot):
    moves = [
        cubic(0.1, 0, -0.8, 0.4, (0.3, 0.2, 0.0)),
        cubic(0.2, 0.1, -0.8, 0.5, (0.0, 0.2, 0.1)),
        cubic(*HOME, 0.6),
    ]
    planned = plan(robot, moves)
    assert len(planned.plan) == 1
    assert planned.plan.move(0).kind == MoveKind.CUBIC
    assert planned.plan.duration_s == pytest.approx(1.5)
    h = 1e-5
    for time, place, velocity in (
        (0.4, (0.1, 0, -0.8), (0.3, 0.2, 0.0)),
        (0.9, (0.2, 0.1, -0.8), (0.0, 0.2, 0.1)),
    ):
        p, _, _ = sample_plan(planned.plan, [time - h, time, time + h])
        assert np.abs(p[1] - place).max() < 1e-9
        assert np.abs((p[2] - p[0]) / (2.0 * h) - velocity).max() < 1e-3
    p, _, _ = sample_plan(planned.plan, [0.0, h, 1.5 - h, 1.5])
    assert np.abs(p[[0, 3]] - HOME).max() < 1e-9
    assert np.abs(np.diff(p, axis=0)[[0, 2]]).max() < 1e-8


def test_a_dwell_or_a_move_ends_a_sequence_of_cubics(robot):
    planned = plan(robot, [cubic(0.1, 0, -0.8, 0.4), dwell(0.1), cubic(0, 0, -0.8, 0.4), to(*HOME), output()])
    kinds = [planned.plan.move(n).kind for n in range(4)]
    assert kinds == [MoveKind.CUBIC, MoveKind.DWELL, MoveKind.CUBIC, MoveKind.LINE]
    after = plan(robot, [cubic(0.1, 0, -0.8, 0.4), output(), cubic(0, 0, -0.8, 0.4)])
    assert [len(rows) for rows in events_of(after)] == [0, 1]


@pytest.mark.parametrize('follows', [[], [dwell(0.1)], [to(0.1, 0.1, -0.8)]])
def test_a_sequence_of_cubics_must_end_at_rest(follows, robot):
    sentence = refusal(plan, robot, [cubic(0.1, 0, -0.8, 0.4, (0.1, 0, 0)), *follows])
    assert sentence.endswith('the last cubic of a sequence must end with end_velocity_m_s [0, 0, 0]')
    assert sentence.startswith('moves[')


def test_a_cubic_too_quick_for_a_motor_is_slowed_down_as_a_whole(robot):
    planned = plan(robot, [cubic(0.3, 0, -0.75, 0.06), dwell(100.0)])
    (notice,) = planned.notices
    assert notice.startswith('moves[0].cubic is slowed down, ')
    speed, current, _ = motors(robot, only(planned))
    assert np.abs(current).max() <= CURRENT * robot.motor.peak_current_a
    assert np.abs(speed).max() <= SPEED * robot.motor.max_speed_rad_s
    move = planned.plan.move(0)
    u = np.linspace(0.0, 1.0, 11)
    p, _, _ = sample_plan(only(planned), u * move.duration_s)
    assert np.abs(p[:, 0] - 0.3 * (3.0 * u**2 - 2.0 * u**3)).max() < 1e-12


def test_a_cubic_that_leaves_the_workspace_is_refused(robot):
    sentence = refusal(plan, robot, [cubic(0.1, 0, -0.75, 1.0, (0, 0, 2.0)), cubic(*HOME, 1.0)])
    assert sentence.startswith('moves[1].cubic: z is ')


# several mistakes at once

MISTAKES = """\
moves:
  - move_l: {to_m: [0.1, 0, -0.8]}
  - move_l: {to_m: [0.9, 0, -0.8]}
  - output: {name: gripper, value: true, before_m: 0.002, payload_kg: 0.5}
  - move_c: {via_m: [0.1, 0.0, -0.8], to_m: [0.0, 0.0, -0.8]}
  - dwell: {time_s: 0.1}
  - move_sb: {through_m: [[0.1, 0, -0.8], [0.1, 0.1, -0.4]]}
  - cubic: {to_m: [0.1, 0, -0.8], duration_s: 2.0}
  - move_l: {to_m: [0.2, 0, -0.8], blend_m: 0.05}
"""


def test_everything_that_cannot_be_planned_is_told_with_its_place(robot, tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_text(MISTAKES, encoding='utf-8')
    read = programs.load(path, robot.motion)
    with pytest.raises(ProgramError) as error:
        program_planner.plan(read, robot.motion.home_m, robot)
    told = [sentence.split(': ')[:2] for sentence in str(error.value).split('; ')]
    assert told == [
        [f'{path}:3:5', 'moves[1].move_l'],
        [f'{path}:5:5', 'moves[3].move_c'],
        [f'{path}:7:5', 'moves[5].move_sb'],
        [f'{path}:8:5', 'moves[6].cubic'],  # begins where no robot can be
        [f'{path}:9:5', 'moves[7].move_l'],
    ]


def test_behind_a_move_that_cannot_be_planned_planning_goes_on_at_its_end(robot):
    far = {'move_l': {'to_m': [0.9, 0.0, -0.8]}}
    back = {'move_l': {'to_m': {'by_m': [-0.8, 0.0, 0.0]}}}  # begins outside, so that it is wrong as well
    near = {'move_l': {'to_m': {'by_m': [0.0, 0.1, 0.0]}}}  # from (0.1, 0, -0.8)
    read = programs.parse({'moves': [far, back, near]}, robot.motion)
    with pytest.raises(ProgramError) as error:
        program_planner.plan(read, robot.motion.home_m, robot)
    assert [sentence.split(':')[0] for sentence in str(error.value).split('; ')] == [
        'moves[0].move_l',
        'moves[1].move_l',
    ]


def test_ten_mistakes_are_enough(robot):
    moves = [{'move_l': {'to_m': [0.9, 0.01 * n, -0.8]}} for n in range(30)]
    with pytest.raises(ProgramError) as error:
        program_planner.plan(programs.parse({'moves': moves}, robot.motion), robot.motion.home_m, robot)
    *told, last = str(error.value).split('; ')
    assert len(told) == 10
    assert last == 'the search ended after 10 errors'


def test_an_output_is_not_blamed_for_the_move_that_it_belongs_to(robot):
    no_circle = {'move_c': {'via_m': [0.05, 0.0, -0.75], 'to_m': [0.1, 0.0, -0.75]}}
    grip = {'output': {'name': 'gripper', 'value': True, 'before_m': 0.01}}
    moves = [{'move_l': {'to_m': [0.0, 0.0, -0.75]}}, no_circle, grip, {'dwell': {'time_s': 0.1}}]
    with pytest.raises(ProgramError) as error:
        program_planner.plan(programs.parse({'moves': moves}, robot.motion), [0.0, 0.0, -0.8], robot)
    assert [sentence.split(':')[0] for sentence in str(error.value).split('; ')] == ['moves[1].move_c']
