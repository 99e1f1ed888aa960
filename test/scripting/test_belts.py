"""Tests of scripts on belts with real drives: true TCP position, and unchanged other signals."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, scripting
from delta3_pacdrive.errors import Code
from test.support.belts import QUICK, apart_m, around, pick, speed_of

RMS_M, MAX_M = 0.10e-3, 0.25e-3  # what is promised of the nominal robot
RUNS = {
    'slow': [speed_of(0.5)],
    'fast': [speed_of(1.5)],
    # goes, stops and goes on while the robot is on it
    'stops': [speed_of(0.5), speed_of(0.0, after_s=1.2), speed_of(0.5, after_s=1.55)],
}
GRIP_S = {'slow': 0.06, 'fast': 0.06, 'stops': 0.6}


@pytest.fixture(scope='module')
def robot():
    return parameters.load(parameters.MODEL_CONTROLLER)


def picked(robot, speed, grip_s=0.06, count=1, **of_belt):
    with scripting.simulate(
        robot, cell=around(speed, count, **of_belt), signals=['cell_belts', 'outputs']
    ) as called:
        for _ in range(count):
            pick(called, grip_s)
    return called.trace


@pytest.fixture(scope='module')
def runs(robot):
    return {name: picked(robot, speed, GRIP_S[name]) for name, speed in RUNS.items()}


@pytest.mark.parametrize('name', RUNS)
def test_true_tcp_follows_the_true_part_within_the_promised_error(runs, name):
    far, _ = apart_m(runs[name])
    assert len(far) >= 1e3 * GRIP_S[name] - 5
    assert np.sqrt(np.mean(far**2)) < RMS_M
    assert far.max() < MAX_M


@pytest.mark.parametrize('name', RUNS)
def test_parts_are_taken_from_the_belt_and_placed(runs, name):
    report = runs[name].meta['cell']
    assert report['outcomes']['placed'] == 1
    assert report['missed'] == 0
    assert report['place_error_max_m'] < 0.3e-3


def test_belt_stops_while_the_robot_is_on_a_part(runs):
    _, cycles = apart_m(runs['stops'])
    speeds = np.diff(runs['stops'].signals['cell_belts'][:, 0])[cycles] / 1e-3
    assert (speeds.max(), speeds.min()) == pytest.approx((0.5, 0.0), abs=1e-9)


def test_the_command_never_jumps_and_keeps_its_limits(runs):
    for run in runs.values():
        speed = np.diff(run.signals['tcp_command'], axis=0) / 1e-3
        assert np.linalg.norm(speed, axis=1).max() < 4.0
        # the plan and what is added have 40 m/s2 each; what noise of the encoder adds is small beside that
        assert np.linalg.norm(np.diff(speed, axis=0), axis=1).max() / 1e-3 < 80.0


def test_internal_bits_are_not_outputs(runs):
    run = runs['slow']
    assert {change['name'] for change in run.meta['outputs']} == {'gripper'}
    assert run.signals['outputs'][:, 1:].max() == 0.0


def test_end_is_as_planned_after_the_robot_has_left_the_belt(runs):
    for run in runs.values():
        assert run.signals['tcp_command'][-1] == pytest.approx((0.0, -0.2, -0.85), abs=1e-12)


def test_the_same_script_gives_the_same_bits(robot, runs):
    again = picked(robot, RUNS['fast'])
    for name, signal in runs['fast'].signals.items():
        assert np.array_equal(signal, again.signals[name], equal_nan=True), name


def test_the_delay_of_the_light_barrier_is_taken_off(robot):
    far, _ = apart_m(picked(robot, RUNS['fast'], barrier={'at_mm': 300, 'delay_s': 0.004}))
    assert far.max() < MAX_M  # 4 ms at 1.5 m/s would be 6 mm


def test_belt_that_a_script_ignores_changes_no_bit(robot):
    def moved(cell_around):
        with scripting.simulate(robot, cell=cell_around) as called:
            called.move_l(to_mm=[50, 0, -800])
        return called.trace

    with_belt, without = moved(around(RUNS['slow'], 1)), moved(around(None, 0))
    for name, signal in without.signals.items():
        assert np.array_equal(signal, with_belt.signals[name], equal_nan=True), name


def test_parts_too_close_together_are_skipped_with_a_reason(robot):
    codes = []
    stream = {'part': 'bar', 'count': 4, 'spacing_mm': 150}
    with scripting.simulate(robot, cell=around(RUNS['fast'], 4, stream=stream)) as called:
        for _ in range(4):
            try:
                pick(called)
            except scripting.WaitTimeoutError:
                break
            except scripting.ScriptError as error:
                codes.append(error.code)
    outcomes = called.trace.meta['cell']['outcomes']
    assert set(codes) <= {Code.BELT}
    assert outcomes['placed'] >= 1
    assert outcomes['placed'] + outcomes['passed'] + outcomes['waiting'] == 4


def test_the_robot_may_wait_and_decide_on_a_belt(robot):
    def decide(called):
        called.wait()
        seen.append(called.position())
        called.wait_time(0.05)
        seen.append(called.position())

    seen = []
    with scripting.simulate(robot, cell=around(RUNS['slow'], 1)) as called, called.track('line', **QUICK):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        decide(called)
        called.move_l(to_mm=[0, 20, 60], **QUICK)
    # it stands on the belt, which goes on
    assert seen[1][0] - seen[0][0] == pytest.approx(0.5 * 0.05, abs=2e-4)
    assert seen[1][1:] == pytest.approx(seen[0][1:], abs=1e-4)


def test_short_move_after_the_work_waits_until_the_robot_has_left_the_belt(robot):
    with scripting.simulate(robot, cell=around(RUNS['fast'], 1)) as called:
        with called.track('line', **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)
        called.move_l(to_mm=[75, 100, -800], **QUICK)
        called.wait()
        here = called.position()
    assert here == pytest.approx((0.075, 0.1, -0.8), abs=1e-4)


def test_one_part_after_the_other_may_be_looked_at_from_the_same_place_above_it(robot):
    with scripting.simulate(robot, cell=around(RUNS['slow'], 2)) as called:
        for _ in range(2):
            with called.track('line', timeout_s=5.0, **QUICK):
                called.move_l(to_mm=[0, 0, 60], **QUICK)
    commanded = called.trace.signals['tcp_command']
    assert np.ptp(commanded[-8:], axis=0).max() == 0.0
    # twice it came to the speed of the belt
    on_belt = np.abs(np.diff(commanded[:, 0]) / 1e-3 - 0.5) < 2e-3
    begins = np.flatnonzero(np.diff(on_belt.astype(int)) == 1)
    assert np.count_nonzero(np.diff(begins) > 200) == 1
    assert np.linalg.norm(np.diff(commanded, n=2, axis=0), axis=1).max() / 1e-6 < 85.0


def test_a_script_ends_once_the_robot_has_left_the_belt(robot):
    with scripting.simulate(robot, cell=around(RUNS['slow'], 1)) as called, called.track('line', **QUICK):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
    assert np.ptp(called.trace.signals['tcp_command'][-3:], axis=0).max() < 1e-6


def test_tcp_follows_the_part_on_a_belt_of_1_5_m_s_that_brakes_and_starts_with_2_m_s2(robot):
    speed = [speed_of(1.5), speed_of(0.0, after_s=1.36), speed_of(1.5, after_s=2.3)]
    barrier, window_mm = {'at_mm': 50, 'delay_s': 0.0005}, [450, 1200]
    with scripting.simulate(
        robot, cell=around(speed, 3, barrier=barrier, window_mm=window_mm), signals=['cell_belts']
    ) as called:
        called.move_l(to_mm=[-250, 100, -800], **QUICK)
        part = [called.part('line') for _ in range(3)][-1]
        with called.track('line', part, **QUICK):
            called.move_l(to_mm=[0, 0, 40], **QUICK)
            called.move_l(to_mm=[0, 0, 20], **QUICK)
            called.output('gripper', True, payload_kg=0.2)
            called.wait()
            called.wait_time(0.95)  # while it brakes from 1.5 m/s, and begins to go again
            called.move_l(to_mm=[0, 0, 60], **QUICK)
        called.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
        called.output('gripper', False, payload_kg=0.0)
    far, cycles = apart_m(called.trace, part.along_m)
    speeds = np.diff(called.trace.signals['cell_belts'][:, 0])[cycles] / 1e-3
    assert (speeds.max(), speeds.min()) == pytest.approx((1.5, 0.0), abs=1e-9)
    assert len(far) > 900
    assert np.sqrt(np.mean(far**2)) < RMS_M
    assert far.max() < MAX_M
    assert called.trace.meta['cell']['outcomes']['placed'] == 1


def test_circles_arches_and_cubics_are_driven_in_the_frame_of_the_part(robot):
    with scripting.simulate(robot, cell=around([speed_of(0.5)], 1), signals=['cell_belts']) as called:
        with called.track('line', **QUICK):
            called.move_l(to_mm=[-60, 0, 60], **QUICK)
            called.move_c(
                via_mm=[0, 60, 60], to_mm=[60, 0, 60], speed_m_s=1.0, acceleration_m_s2=20.0, jerk_m_s3=2000.0
            )
            called.arch(to_mm=[0, 0, 20], up_mm=10, down_mm=15, **QUICK)
            called.output('gripper', True, payload_kg=0.2)
            called.dwell(0.06)
            called.cubic(to_mm=[0, 0, 50], duration_s=0.15)
        called.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
        called.output('gripper', False, payload_kg=0.0)
    trace = called.trace
    far, _ = apart_m(trace)
    assert far.max() < MAX_M
    assert trace.meta['cell']['outcomes']['placed'] == 1
    way = trace.signals['cell_belts'][:, 0]
    x, y, z = trace.signals['tcp_true'].T
    x, y, z = x + 0.7 - way, y - 0.1, z + 0.87  # seen from the part
    on = (np.abs(z - 0.06) < 1e-4) & (y > 5e-3) & (np.hypot(x, y) < 0.08)
    assert on.sum() > 150
    assert np.abs(np.hypot(x, y)[on] - 0.06).max() < MAX_M


def works_along(called, override=100.0):
    """Work on the belt with a move of 0.9 m/s along it."""
    along = QUICK | {'speed_m_s': 0.9}
    with called.track('line', **(QUICK | {'speed_m_s': 1.3})):
        called.move_l(to_mm=[0, 0, 60], **along)
        called.move_l(to_mm=[120, 0, 60], **along)
        called.override(override)
        called.wait()


def along_belt(robot, limit_m_s, speed, override=100.0):
    """Return the highest commanded TCP speed of a bus cycle [m/s], and the error of the script."""
    limited, error = robot.replace(motion__tcp_speed_limit_m_s=limit_m_s), None
    with scripting.simulate(limited, cell=around(speed, 1, window_mm=[250, 1100])) as called:
        try:
            works_along(called, override)
        except scripting.ScriptError as refusal:
            error = str(refusal)
    speeds = np.linalg.norm(np.diff(called.trace.signals['tcp_command'], axis=0), axis=1) / 1e-3
    return speeds.max(), error


def test_belt_and_move_together_keep_the_tcp_speed_limit_in_every_cycle(robot):
    fastest, error = along_belt(robot, 1.92, [speed_of(1.0)])
    assert error is None
    assert 0.98 * 1.9 < fastest <= 1.92


def test_belt_and_move_with_an_excessive_sum_of_speeds_are_rejected_before_motion(robot):
    fastest, error = along_belt(robot, 1.91, [speed_of(1.0)])
    assert fastest == 0.0
    assert 'TCP speed would be 1.89' in error
    assert 'the limit is 1.891 m/s, 99% of motion.tcp_speed_limit_m_s' in error


def test_an_override_on_a_belt_does_not_exceed_the_tcp_speed_limit(robot):
    fastest, error = along_belt(robot, 2.3, [speed_of(1.0)], override=120.0)
    assert 'override is 120 %, but together with the belt the TCP speed limit allows at most 108 %' in error
    assert fastest <= 2.3


def test_the_robot_stops_when_the_belt_makes_it_too_fast(robot):
    faster = {'after_s': 0.65, 'speed_m_s': 1.2, 'acceleration_m_s2': 2.0}
    fastest, error = along_belt(robot, 1.75, [speed_of(0.8), faster])
    assert 'together with the belt the TCP would run at 1.7' in error
    assert 'm/s, the limit is 1.75 m/s' in error
    assert fastest <= 1.75


def test_limits_of_four_metres_a_second_for_belt_and_moves_together_keep_a_limit_of_four(robot):
    limited = robot.replace(motion__tcp_speed_limit_m_s=4.0)
    with scripting.simulate(limited, cell=around([speed_of(1.5)], 1, window_mm=[250, 1200])) as called:
        part = called.part('line')
        with pytest.raises(scripting.ScriptError, match=r'TCP speed would be 4\.\d+ m/s'):
            gets_over(called, part, QUICK)
        gets_over(called, part, QUICK | {'speed_m_s': 2.0})
    speeds = np.linalg.norm(np.diff(called.trace.signals['tcp_command'], axis=0), axis=1) / 1e-3
    assert 2.0 < speeds.max() <= 4.0


def gets_over(called, part, limits):
    with called.track('line', part, **QUICK):
        called.move_l(to_mm=[0, 0, 60], **limits)
        called.move_l(to_mm=[250, 0, 60], **limits)
