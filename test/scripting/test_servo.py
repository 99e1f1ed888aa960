"""Tests of scripts that steer their robot on line, in a simulation."""

import math

import numpy as np
import pytest

from delta3_pacdrive import scripting
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.errors import ScriptError


def driven(robot, script, **options):
    """Return the trace of a script."""
    with scripting.simulate(robot, **options) as called:
        script(called)
    return called.trace


def test_velocities_move_the_tcp_until_the_block_ends_and_moves_follow(robot):
    seen = []

    def script(called):
        called.move_l(to_mm=[50, 0, -800])
        with called.servo() as steering:
            for _ in range(20):
                steering.velocity(0.2, 0.0, 0.0)
                called.wait_time(0.02)
            seen.append(called.state())
        seen.append(called.state())
        called.move_l(to_mm=[0, 0, -750])

    trace = driven(robot, script)
    moving, rest = seen
    assert (moving.motion, rest.motion) == ('steered', 'idle')
    # 0.4 s at 0.2 m/s, less the start, plus the stop
    assert rest.position_m == pytest.approx((0.13, 0.0, -0.8), abs=0.003)
    # in position: 0.07 to 0.3 mm at the TCP
    assert rest.position_m == pytest.approx(rest.command_m, abs=1e-4)
    assert trace['tcp_command'][-1] == pytest.approx((0.0, 0.0, -0.75), abs=1e-12)
    speed = np.linalg.norm(np.diff(trace['tcp_command'], axis=0), axis=1) / robot.bus.cycle_time_s
    assert speed.max() <= robot.motion.speed_max_m_s * 1.001
    assert trace.meta['stopped'] == ''


def test_a_script_that_stops_sending_lets_the_robot_rest_after_300_ms(robot):
    seen = []

    def script(called):
        with called.servo() as steering:
            steering.velocity(0.3, 0.0, 0.0)
            start = called.state().command_m
            called.wait_time(0.2)
            seen.append(math.dist(called.state().command_m, start))
            called.wait_time(0.1 + 2.0 * robot.decision_cycles * robot.bus.cycle_time_s)
            before = called.state().command_m
            called.wait_time(0.1)
            seen.append(math.dist(called.state().command_m, before))

    driven(robot, script)
    assert seen[0] > 0.02
    assert seen[1] == 0.0


def test_positions_are_followed_along_a_circle(robot):
    def place(time_s):
        angle = math.tau * time_s
        return 0.1 * math.cos(angle) - 0.1, 0.1 * math.sin(angle), -0.8

    begins = []

    def script(called):
        called.move_l(to_mm=[0, 0, -800])
        with called.servo(acceleration_m_s2=30.0, jerk_m_s3=3000.0) as steering:
            start = called.state().cycle
            begins.append(start)
            for n in range(100):
                steering.position(*place(0.02 * n))
                called.wait_until(called.state().time_s + 0.02)

    trace = driven(robot, script)
    first = begins[0] + robot.decision_cycles
    cycles = np.arange(first + 500, first + 1900)
    wanted = np.array([place((cycle - first) * robot.bus.cycle_time_s) for cycle in cycles])
    # the command leads by the time in which it is reached, so that the TCP itself is on time, within 3 ms
    assert np.linalg.norm(trace['tcp_actual'][cycles] - wanted, axis=1).max() < 0.003 * math.tau * 0.1


def test_limits_of_the_block_hold(robot):
    def script(called):
        with called.servo(speed_m_s=0.1, acceleration_m_s2=1.0, jerk_m_s3=20.0) as steering:
            for _ in range(50):
                steering.velocity(5.0, 0.0, 0.0)
                called.wait_time(0.02)

    trace = driven(robot, script)
    speed = np.diff(trace['tcp_command'][:, 0]) / robot.bus.cycle_time_s
    assert 0.0999 < speed.max() <= 0.1 * 1.001
    assert np.abs(np.diff(speed)).max() / robot.bus.cycle_time_s <= 1.0 * 1.001


@pytest.mark.parametrize(
    ('call', 'words'),
    [
        (lambda s: s.velocity(math.nan, 0.0, 0.0), 'finite'),
        (lambda s: s.position(0.0, 0.0, math.inf), 'finite'),
        (lambda s: s.velocity(0.1, 0.0, 0.0, belt='line'), "unknown belt 'line'"),
        (lambda s: (s.position(0.0, 0.0, -0.75), s.position(0.0, 0.0, -0.75)), 'not newer'),
    ],
)
def test_wrong_set_points_are_rejected_with_the_line_of_the_script(robot, call, words):
    def script(called):
        with called.servo() as steering:
            call(steering)

    with pytest.raises(ScriptError, match=words) as caught:
        driven(robot, script)
    assert 'test_servo.py' in str(caught.value)


@pytest.mark.parametrize('limits', [{'speed_m_s': 0.0}, {'jerk_m_s3': 1e9}, {'acceleration_m_s2': math.nan}])
def test_wrong_limits_are_rejected(robot, limits):
    def script(called):
        with called.servo(**limits):
            pass

    with pytest.raises(ScriptError, match='of a steered robot'):
        driven(robot, script)


def test_an_error_in_the_block_stops_the_robot(robot):
    def script(called):
        with called.servo() as steering:
            steering.velocity(0.3, 0.0, 0.0)
            called.wait_time(0.1)
            raise KeyError('of the script')

    with pytest.raises(KeyError):
        driven(robot, script)


def test_the_same_script_has_the_same_bits_again(robot):
    def script(called):
        with called.servo() as steering:
            for n in range(30):
                steering.velocity(0.5 * math.cos(n), 0.5 * math.sin(n), 0.1)
                called.wait_time(0.03)

    first, second = driven(robot, script), driven(robot, script)
    assert all(np.array_equal(first[name], second[name], equal_nan=True) for name in first.signals)


def test_the_end_of_the_steering_leaves_a_robot_with_belts_where_it_is(robot):
    cell = cell_file.parse(
        {
            'name': 'one belt',
            'belts': {
                'line': {
                    'origin_mm': [-700, 0, -870],
                    'length_mm': 1500,
                    'encoder': {'bits': 14, 'circumference_mm': 200},
                    'speed': [{'after_s': 0, 'speed_m_s': 0.15}],
                }
            },
        }
    )

    def script(called):
        with called.servo() as steering:
            for _ in range(20):
                steering.velocity(0.2, 0.0, 0.0)
                called.wait_time(0.02)
            for _ in range(20):
                steering.velocity(0.0, 0.0, 0.0, belt='line')
                called.wait_time(0.02)
        called.wait_time(0.2)

    trace = driven(robot, script, cell=cell)
    tcp = trace['tcp_command']
    assert tcp[-1, 0] > 0.1
    # within a cycle at 0.2 m/s
    assert np.abs(np.diff(tcp, axis=0)).max() < 0.3 * robot.bus.cycle_time_s
    assert trace.meta['stopped'] == ''
