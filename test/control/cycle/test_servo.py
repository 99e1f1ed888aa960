"""Tests of steering on line: limits, boundaries, delay, stops, and the acceptance of set points."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.benchmarks.steering import Motion, SteeredRobot, curve, lag_s, stream
from delta3_pacdrive.control.cycle.servo import checked_limits, default_limits, limits_of
from delta3_pacdrive.control.cycle.set_points import (
    AHEAD_S,
    JUMP_M,
    STALE_S,
    STANDSTILL_S,
    SetPoint,
    SetPointKind,
    SetPointStream,
)
from delta3_pacdrive.control.cycle.transformation import DISABLE_CYCLES
from delta3_pacdrive.errors import Code, ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import Limits

ROBOT = parameters.load()
HOME = np.array(ROBOT.motion.home_m)
T = ROBOT.bus.cycle_time_s
DELAY_S = ROBOT.set_point_delay_cycles * T
USUAL = default_limits(ROBOT)
SHARE = 1e-3  # by which a limit may be exceeded


def steered(robot: Parameters = ROBOT, limits: Limits = USUAL, home: Floats = HOME) -> SteeredRobot:
    return SteeredRobot(robot, limits, home)


def constant(x: float, y: float, z: float) -> Callable[[float], tuple[float, float, float]]:
    return lambda _: (x, y, z)


def assert_within_limits(motion: Motion, robot: Parameters = ROBOT, limits: Limits = USUAL) -> None:
    """Check speed, acceleration, jerk, workspace, arms, motor speed, voltage and current of every command."""
    exceeded = {name: share for name, share in motion.shares(robot, limits).items() if share > 1.0 + SHARE}
    assert not exceeded


# velocities


def test_a_velocity_is_reached_and_kept():
    motion = steered().run(1000, stream(constant(0.2, -0.1, 0.0), SetPointKind.VELOCITY, 50.0))
    assert motion.velocity[300:] == pytest.approx(np.tile((0.2, -0.1, 0.0), (700, 1)), abs=1e-6)
    # position, velocity and acceleration belong together: constant jerk within a cycle
    chord = np.diff(motion.place, axis=0) / T
    mean = 0.5 * (motion.velocity[1:] + motion.velocity[:-1])
    mean -= np.diff(motion.acceleration, axis=0) * T / 12.0
    assert chord == pytest.approx(mean, abs=1e-9)
    assert_within_limits(motion)


@pytest.mark.parametrize(
    'velocity',
    [
        (1.5, 0.0, 0.0), (0.0, 0.0, 1.5), (0.0, 0.0, -1.5), (1.0, 1.0, -1.0), (-3.0, 0.5, 0.2), (0.0, 1e3, 1e3),
        (1e-9, 0.0, 0.0), (0.3, 0.0, 0.01),
    ],
)  # fmt: skip
def test_a_robot_slows_down_before_a_limit_and_rests_there(velocity):
    robot = steered()
    motion = robot.run(4000, stream(constant(*velocity), SetPointKind.VELOCITY, 100.0))
    assert_within_limits(motion)
    assert robot.task.servo.steered.held_back == (np.linalg.norm(velocity) > 1e-3)


@pytest.mark.parametrize('override', [0.01, 0.5, 1.0, 1.5])
def test_the_override_scales_velocities_within_the_limit_of_the_speed(override):
    robot = steered()
    robot.task.servo.set_override(override)
    motion = robot.run(1000, stream(constant(0.4, 0.0, 0.0), SetPointKind.VELOCITY, 50.0))
    assert motion.velocity[-1] == pytest.approx([0.4 * override, 0.0, 0.0], abs=1e-6)
    fast = steered(limits=replace(USUAL, speed_m_s=0.5))
    fast.task.servo.set_override(override)
    motion = fast.run(1000, stream(constant(0.6, 0.0, 0.0), SetPointKind.VELOCITY, 50.0))
    # 0.6 m/s times the override, at most 0.5 m/s times an override below 1
    due = min(0.6 * override, 0.5 * min(override, 1.0))
    assert motion.velocity[-1, 0] == pytest.approx(due, abs=1e-6)


def test_an_override_that_changes_during_the_motion_is_reached_within_the_limits():
    robot = steered()
    feed = stream(constant(0.4, 0.0, 0.0), SetPointKind.VELOCITY, 50.0)
    robot.run(500, feed)
    robot.task.servo.set_override(0.25)
    motion = robot.run(500, feed)
    assert motion.velocity[-1, 0] == pytest.approx(0.1, abs=1e-6)
    assert_within_limits(motion)


def test_the_override_limits_the_speed_towards_positions():
    robot = steered(limits=replace(USUAL, speed_m_s=0.4))
    robot.task.servo.set_override(0.5)
    ahead = HOME + np.array([0.05, 0.0, 0.0])
    motion = robot.run(400, stream(lambda _: tuple(ahead.tolist()), SetPointKind.POSITION, 50.0))
    assert motion.largest[0] == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize('speeds', [(0.3, 0.3, 0.3), (0.2, -0.1, 0.0)])
def test_speeds_of_the_arms_move_them(speeds):
    motion = steered().run(300, stream(constant(*speeds), SetPointKind.ARM_SPEEDS, 100.0))
    angles = kinematics.inverse(motion.place, ROBOT.kinematics)
    # 0.1 %: the velocity belongs to the command before, while the arms turn
    assert (angles[-1] - angles[-2]) / T == pytest.approx(np.array(speeds), abs=1e-3 * max(speeds))
    assert_within_limits(motion)


def test_a_robot_slides_along_a_limit():
    robot = steered()
    robot.run(2000, stream(constant(0.5, 0.0, 0.0), SetPointKind.VELOCITY, 100.0))
    motion = robot.run(8000, lambda now: [SetPoint(SetPointKind.VELOCITY, now, (0.3, 0.4, 0.0))])
    assert_within_limits(motion)
    x, y, _ = motion.place.T
    radius = 0.5 * ROBOT.kinematics.workspace_diameter_m
    assert np.hypot(x, y).min() > radius - 0.01
    # on the cylinder it comes to rest where its normal is the direction of the velocity
    assert math.atan2(y[-1], x[-1]) == pytest.approx(math.atan2(0.4, 0.3), abs=0.05)


# positions


@pytest.mark.parametrize('rate_hz', [20.0, 50.0, 125.0, 500.0])
def test_the_tcp_follows_a_smooth_stream_within_25_ms(rate_hz):
    motion = steered().run(3000, stream(curve, SetPointKind.POSITION, rate_hz))
    assert_within_limits(motion)
    # the parabola through positions every 50 ms leads a little
    assert -0.015 <= lag_s(motion, ROBOT) <= 0.025


def test_a_position_at_rest_is_reached_exactly():
    goal = (0.15, -0.05, -0.8)
    motion = steered().run(1500, stream(constant(*goal), SetPointKind.POSITION, 50.0))
    assert motion.place[-1] == pytest.approx(goal, abs=1e-7)
    assert_within_limits(motion)


# stops


@pytest.mark.parametrize('kind', list(SetPointKind))
@pytest.mark.parametrize('rate_hz', [20.0, 500.0])
def test_the_robot_rests_300_ms_after_the_last_set_point(kind, rate_hz):
    def straight(time_s: float) -> tuple[float, float, float]:
        return {
            SetPointKind.VELOCITY: (1.5, 0.0, 0.0),
            SetPointKind.POSITION: (time_s, 0.0, float(HOME[2])),
            SetPointKind.ARM_SPEEDS: (2.0, 1.0, 2.0),
        }[kind]

    robot = steered()
    feed = stream(straight, kind, rate_hz, jitter_s=0.0, lost=0.0, until_s=0.35)
    motion = robot.run(1000, feed)
    assert np.linalg.norm(motion.velocity, axis=1)[:350].max() > 0.5
    # bus cycle whose command is the last of the motion, as it is reached
    moving = np.flatnonzero(np.linalg.norm(motion.velocity, axis=1) > 1e-9)[-1]
    assert moving * T + DELAY_S - 0.35 <= STANDSTILL_S + 2.0 * T
    assert_within_limits(motion)


def test_a_stop_is_smooth_and_ends_the_steering():
    robot = steered()
    feed = stream(constant(0.8, 0.0, 0.0), SetPointKind.VELOCITY, 100.0)
    before = robot.run(300, feed)
    robot.task.servo.end(robot.cycle)
    rest = robot.task.servo.rest_cycle
    after = robot.run(400, feed)
    parts = 'place', 'velocity', 'acceleration'
    rows = [np.concatenate([getattr(before, name), getattr(after, name)]) for name in parts]
    assert_within_limits(Motion(*rows, T))
    assert not robot.task.servo.active
    assert robot.task.state['tracks'][0] == 0
    assert (after.place[rest - 300 :] == after.place[-1]).all()
    assert (robot.task.state['planned'] == robot.task.state['tcp']).all()
    assert 0.05 < (rest - 300) * T < 0.2


def test_a_hard_stop_is_that_of_a_fault():
    robot = steered()
    robot.run(300, stream(constant(1.5, 0.0, 0.0), SetPointKind.VELOCITY, 100.0))
    robot.task.stop_at(robot.cycle, hard=True)
    first = robot.run(1)
    assert robot.task.disable_cycle == robot.task.servo.rest_cycle + DISABLE_CYCLES
    motion = robot.run(200)
    assert np.linalg.norm(first.velocity) > 1.4
    assert not motion.velocity[-1].any()
    stop_s = (robot.task.servo.rest_cycle - 300) * T
    # 1.5 times the mean deceleration: the stop has a cubic velocity
    assert stop_s == pytest.approx(1.5 * 1.5 / ROBOT.motion.fault_stop_acceleration_m_s2, rel=0.15)
    assert motion.largest[1] <= ROBOT.motion.fault_stop_acceleration_m_s2 * (1.0 + SHARE)


# robots beyond a limit, heavy and small limits


def test_a_robot_beyond_a_limit_can_only_return():
    outside = np.array([0.61, 0.0, -0.8])
    robot = steered(home=outside)
    motion = robot.run(500, stream(constant(0.3, 0.0, 0.0), SetPointKind.VELOCITY, 100.0))
    assert motion.place[:, 0].max() <= 0.61 + 1e-6
    back = steered(home=outside).run(1000, stream(constant(-0.3, 0.0, 0.0), SetPointKind.VELOCITY, 100.0))
    assert back.place[-1, 0] < 0.5
    assert (np.diff(back.place[:, 0]) <= 1e-12).all()


@pytest.mark.parametrize(
    ('place', 'limits'),
    [
        ((0.23037878, -0.53206779, -0.94999998), Limits(10.8, 1.1756622630724542, 87.11214747157733)),
        ((0.42494116, 0.33324844, -0.94999995), Limits(11.3, 1.1428448988389994, 16670.97323763112)),
    ],
)
def test_a_robot_in_a_corner_of_several_limits_can_leave_it(place, limits):
    robot = steered(limits=limits, home=np.array(place))
    back = 5.0 * (np.array((0.0, 0.0, -0.8)) - place)
    feed = stream(constant(*back.tolist()), SetPointKind.VELOCITY, 100.0)
    motion = robot.run(500, feed)
    assert np.linalg.norm(motion.place[-1] - place) > 0.01
    assert_within_limits(motion, limits=limits)


@pytest.mark.parametrize(
    'limits',
    [Limits(0.001, 0.1, 1.0), Limits(15.0, 60.0, 1e4), Limits(15.0, 1000.0, 1e5), Limits(2.0, 5.0, 50.0)],
)
def test_small_and_large_limits_hold(limits):
    turning = stream(
        lambda t: (5.0 * math.cos(3.0 * t), 5.0 * math.sin(3.0 * t), math.cos(7.0 * t)),
        SetPointKind.VELOCITY,
        100.0,
    )
    assert_within_limits(steered(limits=limits).run(3000, turning), limits=limits)


def test_a_heavy_payload_slows_the_steps_not_the_checks():
    heavy = ROBOT.replace(dynamics__payload_mass_kg=8.0)
    limits = Limits(5.0, 200.0, 2e4)
    turning = stream(
        lambda t: (4.0 * math.cos(9.0 * t), 4.0 * math.sin(9.0 * t), 0.0), SetPointKind.VELOCITY, 100.0
    )
    assert_within_limits(steered(heavy, limits).run(2000, turning), heavy, limits)


@pytest.mark.parametrize('seed', range(20))
def test_random_streams_stay_within_all_limits_and_never_end(seed):
    random = np.random.default_rng(seed)
    limits = Limits(
        *(float(10.0 ** random.uniform(low, high)) for low, high in ((-1, 1), (0, 2), (1.5, 4.5)))
    )
    kind = SetPointKind.VELOCITY if seed % 2 else SetPointKind.POSITION
    values = random.normal(0.0, limits.speed_m_s if seed % 2 else 0.03, (200, 3))
    places = HOME + np.cumsum(values, axis=0)

    def value(time_s: float) -> tuple[float, float, float]:
        x, y, z = (values if seed % 2 else places)[int(time_s * 20.0) % 200]
        return float(x), float(y), float(z)

    robot = steered(limits=limits)
    motion = robot.run(1500, stream(value, kind, float(random.choice([20.0, 60.0, 400.0])), seed))
    assert_within_limits(motion, limits=limits)
    # it can still be steered home
    home = robot.run(
        3000,
        lambda now: [SetPoint(SetPointKind.VELOCITY, now, tuple(10.0 * (HOME - robot.task.state['tcp'][0])))],
    )
    assert_within_limits(home, limits=limits)


# acceptance


def velocity(time_s: float, *values: float, **more: int) -> SetPoint:
    x, y, z = values or (0.1, 0.0, 0.0)
    return SetPoint(SetPointKind.VELOCITY, time_s, (x, y, z), **more)


@pytest.mark.parametrize(
    ('point', 'code', 'words'),
    [
        (velocity(10.0, math.nan, 0.0, 0.0), Code.CONTENT, 'finite'),
        (velocity(10.0, 0.0, math.inf, 0.0), Code.CONTENT, 'finite'),
        (velocity(math.nan), Code.CONTENT, 'finite'),
        (velocity(10.0 - STALE_S - 1e-6), Code.LATE, 'old'),
        (velocity(10.0 + AHEAD_S + 1e-6), Code.CONTENT, 'ahead'),
        (velocity(9.9), Code.LATE, 'newer'),
        (velocity(9.89), Code.LATE, 'newer'),
    ],
)
def test_wrong_set_points_are_rejected_with_a_sentence(point, code, words):
    one = SetPointStream()
    assert one.take(velocity(9.9), 9.95) is None
    reason = one.take(point, 10.0)
    assert (reason.code, words in reason.sentence) == (code, True)


@pytest.mark.parametrize('time_s', [10.0 - STALE_S, 10.0, 10.0 + AHEAD_S])
def test_set_points_at_the_bounds_are_accepted(time_s):
    assert SetPointStream().take(velocity(time_s), 10.0) is None


@pytest.mark.parametrize(('step_m', 'accepted'), [(JUMP_M - 1e-9, True), (JUMP_M + 1e-6, False)])
def test_a_position_that_jumps_is_rejected(step_m, accepted):
    one = SetPointStream()
    for n in range(5):
        assert one.take(SetPoint(SetPointKind.POSITION, 0.02 * n, (0.0, 0.0, -0.8)), 0.02 * n) is None
    reason = one.take(SetPoint(SetPointKind.POSITION, 0.1, (step_m, 0.0, -0.8)), 0.1)
    assert (reason is None) == accepted


def test_a_rejected_set_point_changes_nothing():
    smooth = stream(constant(0.2, 0.1, 0.0), SetPointKind.VELOCITY, 100.0)
    wrong = stream(constant(0.2, 0.1, 0.0), SetPointKind.VELOCITY, 100.0)

    def disturbed(now_s: float) -> list[SetPoint]:
        bad = [velocity(now_s, math.nan, 0.0, 0.0), velocity(now_s - 1.0), velocity(now_s + 5.0)]
        return [*bad, *wrong(now_s), *bad]

    robot, other = steered(), steered()
    assert (robot.run(500, smooth).place == other.run(500, disturbed).place).all()
    assert other.task.servo.rejected == 3000


@pytest.mark.parametrize(
    ('text', 'limits'),
    [('', USUAL), ('{}', USUAL), ('{"speed_m_s": 0.5}', replace(USUAL, speed_m_s=0.5))],
)
def test_limits_of_a_request_replace_the_usual_ones(text, limits):
    assert limits_of(text, USUAL) == limits


@pytest.mark.parametrize(
    'text',
    [
        '[]',
        '{"speed_m_s": "x"}',
        '{"speed": 1}',
        '{"speed_m_s": 0}',
        '{"jerk_m_s3": 1e9}',
        'nan',
        '{"speed_m_s": NaN}',
    ],
)
def test_invalid_limits_of_a_request_are_rejected(text):
    with pytest.raises(ProgramError):
        limits_of(text, USUAL)


def test_the_limits_of_a_move_are_the_usual_ones():
    assert checked_limits(USUAL) == Limits(1.5, 15.0, 600.0)
    endless = ROBOT.replace(motion__jerk_max_m_s3=math.inf)
    assert default_limits(endless).jerk_m_s3 == 1e5
