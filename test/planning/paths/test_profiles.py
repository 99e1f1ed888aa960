"""Tests of profiles: robustness to rounding, limits, and duration of at most the optimum."""

import math

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

from delta3_pacdrive.belts.synchronization import Motion, TrackLimits, transition_between, transition_to_rest
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths import profiles
from delta3_pacdrive.planning.paths.virtual_master import plan_master
from delta3_pacdrive.planning.program import file_reader as programs

FROM_REST, FROM_MOTION = 70_000, 30_000
ROUND = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5, 8.0])
KEPT = 1.0 + 1e-12  # share of a limit: some thousand roundings of a double, 1e-11 m/s of 10 m/s
TIME_ROUNDING = 1e-15  # share of a time of the table: four of its last places
SAME_M = 1e-13  # from distances of 10 m, speeds of 10 m/s
OPTIMAL = 1.0 + 1e-9  # of the shortest time; the oracle halves intervals down to its own rounding
HALVINGS = 100
WAY_MAX_M, SPEED_MAX_M_S = 10.0, 10.0


class Draw:
    """Random numbers of n cases together."""

    def __init__(self, count, seed):
        self.count, self.random = count, np.random.default_rng(seed)

    def round(self, *decades):
        """Return numbers of one or two digits, exactly as they are written."""
        digits, powers = self.random.choice(ROUND, self.count), self.random.choice(decades, self.count)
        return np.array([float(f'{digit}e{power}') for digit, power in zip(digits, powers, strict=True)])

    def some(self, share, values, others):
        return np.where(self.random.random(self.count) < share, values, others)

    def beside(self, values):
        """Move each number by up to three of its last places."""
        steps = self.random.integers(-3, 4, self.count)
        for n in range(3):
            toward = np.where(steps > 0, math.inf, 0.0)
            values = np.where(abs(steps) > n, np.nextafter(values, toward), values)
        return values

    def limits(self):
        """Return limits of speed, acceleration and jerk; often the acceleration is just reached, or the jerk 100 a."""
        speed, acceleration, jerk = self.round(-2, -1, 0), self.round(0, 1, 2), self.round(2, 3, 4)
        jerk = self.some(0.2, 100.0 * acceleration, jerk)
        speed = np.minimum(self.some(0.2, acceleration**2 / jerk, speed), SPEED_MAX_M_S)
        return self.beside(speed), self.beside(acceleration), self.some(0.1, math.inf, self.beside(jerk))

    def one_of(self, *values):
        return np.choose(self.random.integers(0, len(values), self.count), values)


def ramp(start, end, acceleration, jerk):
    """Return time and way of the fastest change between two speeds at zero acceleration."""
    change = abs(end - start)
    with np.errstate(invalid='ignore'):
        short = np.where(np.isinf(jerk), 0.0, 2.0 * np.sqrt(change / jerk))
        full = change / acceleration + acceleration / jerk
        time = np.where(change * jerk <= acceleration**2, short, full)
    return time, 0.5 * (start + end) * time


def shortest_time(way, start, end, speed, acceleration, jerk):
    """Return the shortest time between two speeds >= 0, by a search for the largest or smallest speed on the way."""

    def passing(between):
        (t0, s0), (t1, s1) = ramp(start, between, acceleration, jerk), ramp(between, end, acceleration, jerk)
        return t0 + t1, s0 + s1

    over = way >= ramp(start, end, acceleration, jerk)[1]
    near = np.where(over, np.maximum(start, end), np.minimum(start, end))
    far = extreme = np.where(over, speed, -speed)
    for _ in range(HALVINGS):
        middle = 0.5 * (near + far)
        enough = (passing(middle)[1] >= way) == over
        near, far = np.where(enough, near, middle), np.where(enough, middle, far)
    time, covered = passing(extreme)
    cruises = (covered < way) == over
    return np.where(cruises, time + (way - covered) / extreme, passing(far)[0])


def check(tables, starts, ends, limits):
    """Require that profiles lead from start to end without a jump, within their limits."""
    for n, states in ((0, starts), (-1, ends)):
        found = np.array([table[n, 1:4] for table in tables])
        found[np.isinf(limits[2]), 2] = 0.0  # accelerations that are constant begin and end at once
        assert np.array_equal(found, states)
    sizes = [len(table) for table in tables]
    rows = np.vstack(tables)
    last = np.zeros(len(rows), bool)
    last[np.cumsum(sizes) - 1] = True
    speed, acceleration, jerk = np.repeat(np.stack(limits), sizes, axis=1)[:, ~last]
    (s, v, a, j), after = rows[~last, 1:].T, rows[np.flatnonzero(~last) + 1]
    t = after[:, 0] - rows[~last, 0]
    assert (t > 0.0).all()
    late = TIME_ROUNDING * after[:, 0]  # phases last from one time of the table to the next
    by_jerk = late * np.where(np.isinf(jerk), 0.0, jerk)
    assert (abs(s + t * (v + t * (a / 2.0 + t * j / 6.0)) - after[:, 1]) <= speed * late + SAME_M).all()
    end_v, end_a = v + t * (a + t * j / 2.0), a + t * j
    assert (abs(end_v - after[:, 2]) <= acceleration * late + SAME_M).all()
    with np.errstate(invalid='ignore', divide='ignore'):
        turn = np.where(j != 0.0, -a / j, 0.0).clip(0.0, t)
    for value in (v, end_v, v + turn * (a + turn * j / 2.0)):
        assert (abs(value) <= speed * KEPT + acceleration * late).all()
    for value in (a, end_a):
        assert (abs(value) <= acceleration * KEPT + by_jerk).all()
    assert ((abs(j) == jerk) | (j == 0.0)).all()


def test_a_length_from_rest_to_rest_at_any_threshold_is_driven_in_the_shortest_time():
    draw = Draw(FROM_REST, 1)
    speed, acceleration, jerk = limits = draw.limits()
    finite = np.isfinite(jerk)
    power = np.where(finite, acceleration**3 / jerk**2, 0.1)
    length = draw.beside(
        draw.one_of(
            power,
            2.0 * power,
            speed**2 / acceleration,
            speed**2 / acceleration + speed * acceleration / jerk,
            2.0 * ramp(0.0, speed, acceleration, jerk)[1],
            draw.round(-6, -5, -4, -3, -2, -1),
        )
    )
    length = np.minimum(length, WAY_MAX_M)
    asked = np.stack([length, *limits], axis=1).tolist()
    tables = [plan_master(*one) for one in asked]
    ends = np.stack([length, 0.0 * length, 0.0 * length], axis=1)
    check(tables, 0.0 * ends, ends, limits)
    times = np.array([table[-1, 0] for table in tables])
    assert (
        times <= shortest_time(length, 0.0 * length, 0.0 * length, *limits) * OPTIMAL + TIME_ROUNDING
    ).all()


def test_transition_between_any_motions_at_any_threshold_takes_the_shortest_time():
    draw = Draw(FROM_MOTION, 2)
    speed, acceleration, jerk = limits = draw.limits()
    shares = np.array([0.0, 0.1, 0.2, 0.25, 0.5, 2.0 / 3.0, 1.0])
    start, end = (speed * draw.random.choice(shares, draw.count) for _ in range(2))
    gap = np.where(np.isfinite(jerk), acceleration**2 / jerk, 0.0)
    above, below = (
        np.minimum(np.maximum(start, end) + gap, speed),
        np.maximum(np.minimum(start, end) - gap, 0.0),
    )

    def through(between):
        return ramp(start, between, acceleration, jerk)[1] + ramp(between, end, acceleration, jerk)[1]

    way = draw.beside(
        draw.one_of(
            through(speed),
            through(start),
            through(above),
            through(below),
            through(0.0 * speed),
            np.where(np.isfinite(jerk), 2.0 * acceleration**3 / jerk**2, 0.1),
            draw.round(-5, -4, -3, -2, -1),
        )
    )
    way, zero = way.clip(1e-6, WAY_MAX_M), 0.0 * way
    starts, ends = np.stack([zero, start, zero], axis=1), np.stack([way, end, zero], axis=1)
    asked = zip(starts.tolist(), ends.tolist(), np.stack(limits, axis=1).tolist(), strict=True)
    tables = [profiles.between(tuple(a), tuple(b), tuple(kept)) for a, b, kept in asked]
    check(tables, starts, ends, limits)
    times = np.array([table[-1, 0] for table in tables])
    assert (times <= shortest_time(way, start, end, *limits) * OPTIMAL + TIME_ROUNDING).all()


def in_ruckig(start, end, limits):
    request, trajectory = InputParameter(1), Trajectory(1)
    request.current_position, request.current_velocity, request.current_acceleration = ([x] for x in start)
    request.target_position, request.target_velocity, request.target_acceleration = ([x] for x in end)
    request.max_velocity, request.max_acceleration, request.max_jerk = ([x] for x in limits)
    Ruckig(1).calculate(request, trajectory)
    return trajectory


def test_duration_equals_that_of_ruckig_away_from_thresholds():
    """Any accelerations at both ends, of numbers that meet no threshold."""
    random, found = np.random.default_rng(3), 0
    while found < 2000:
        speed, acceleration, jerk = 10.0 ** random.uniform((-1.0, 0.0, 2.0), (1.0, 2.0, 4.0))
        start, end = (
            (s, random.uniform(0.0, speed), random.uniform(-1.0, 1.0) * acceleration)
            for s in (0.0, speed**2 / acceleration * 10.0 ** random.uniform(-2.0, 1.0))
        )
        lead, come = (
            start[1] + start[2] * abs(start[2]) / (2.0 * jerk),
            end[1] - end[2] * abs(end[2]) / (2.0 * jerk),
        )
        if not 0.0 < min(lead, come) <= max(lead, come) < speed:
            continue
        found += 1
        table = profiles.between(start, end, (speed, acceleration, jerk))
        # ruckig accepts ends that are 1e-8 m or m/s off
        reference = in_ruckig(start, end, (speed, acceleration, jerk)).duration
        assert table[-1, 0] == pytest.approx(reference, rel=1e-6), (start, end, (speed, acceleration, jerk))


@pytest.mark.parametrize('jerk', [600.0, math.inf])
def test_rest_to_rest_has_the_bits_of_ruckig(jerk):
    for length in (1e-4, 0.0123, 0.0987, 0.31, 0.7):
        profile = in_ruckig((0.0, 0.0, 0.0), (length, 0.0, 0.0), (1.5, 15.0, jerk)).profiles[0][0]
        ruckigs = [row for t, *row in zip(profile.t, profile.p, profile.v, profile.a, profile.j) if t > 0.0]  # noqa: B905
        assert np.array_equal(plan_master(length, 1.5, 15.0, jerk)[:-1, 1:], ruckigs)


@pytest.mark.parametrize('jerk', [500.0, math.inf])
def test_a_state_that_must_exceed_a_limit_is_rejected(jerk):
    rest, limits = (1.0, 0.0, 0.0), (1.0, 10.0, jerk)
    profiles.between((0.0, 1.0, 0.0), rest, limits)
    with pytest.raises(ProgramError, match=r'no profile from 1\.01 m/s'):
        profiles.between((0.0, 1.01, 0.0), rest, limits)


def test_an_acceleration_that_leads_beyond_the_speed_is_rejected():
    with pytest.raises(ProgramError, match=r'no profile from 0 m/s, 0 m/s2 to 0\.99 m/s, -10 m/s2'):
        profiles.between((0.0, 0.0, 0.0), (1.0, 0.99, -10.0), (1.0, 10.0, 500.0))


def test_robot_synchronizes_with_a_belt_and_leaves_it_at_any_threshold():
    draw = Draw(2000, 4)
    _, acceleration, jerk = draw.limits()
    speed, belt = (
        draw.random.choice([1.0, 1.5, 2.0, 4.0], draw.count),
        draw.random.choice([0.0, 0.1, 0.25, 0.5], draw.count),
    )
    jerk = np.where(np.isfinite(jerk), jerk, 100.0 * acceleration)
    power = np.minimum(acceleration**3 / jerk**2, 0.1)
    cruise = 2.0 * ramp(0.0, speed, acceleration, jerk)[1]
    places = [
        draw.beside(draw.one_of(power, 2.0 * power, cruise, 0.0 * power, draw.round(-3, -2)))
        for _ in range(3)
    ]
    for place, v, a, j, of_belt in zip(
        np.stack(places, axis=1).tolist(),
        speed.tolist(),
        acceleration.tolist(),
        jerk.tolist(),
        belt.tolist(),
        strict=True,
    ):
        limits = TrackLimits(v, a, j, belt_acceleration_m_s2=0.0)
        start = Motion(tuple(place), (-of_belt, 0.0, 0.0))
        way = transition_between(start, Motion((0.0, 0.0, 0.0)), limits, of_belt)
        assert way.at(way.duration_s).place == (0.0, 0.0, 0.0)
        assert math.isfinite(transition_to_rest(start, a, j).duration_s)


def test_strokes_that_once_were_rejected_are_driven(robot):
    """18.75 mm is 2 a^3 / j^2 of the default limits; the other one is from ruckig's issue tracker."""
    moves = [{'move_l': {'to_m': {'by_m': [0.0, 0.0, z]}}} for z in (-0.01875, 0.01875)]
    plan = program_planner.plan(
        programs.parse({'moves': moves}, robot.motion), (0.123, 0.0, -0.71), robot
    ).plan
    assert [plan.move(n).duration_s for n in range(2)] == pytest.approx([0.1, 0.1])
    assert plan_master(7.8125e-6, 0.1, 2.5, 2000.0)[-1, 0] == pytest.approx(4 * 2.5 / 2000.0, rel=1e-6)
