"""Tests of failures at belts: defined states of robot and parts, and a script that continues."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, scripting
from delta3_pacdrive.errors import Code
from test.support.belts import QUICK, apart_m, around, pick, speed_of

SLOW = [speed_of(0.4)]


@pytest.fixture(scope='module')
def robot():
    return parameters.load(parameters.MODEL_CONTROLLER)


def above(called, then, **track):
    """Get on the belt above the next part, and do something there."""
    with called.track('line', timeout_s=5.0, **QUICK, **track):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        then(called)


def stays(called, time_s, **track):
    """Get on the belt above the next part, and stay there for a time, until that is over."""
    above(called, lambda robot: robot.dwell(time_s), **track)
    called.wait()


def refused(called, script):
    """Return the error of a rejected script."""
    with pytest.raises(scripting.ScriptError) as told:
        script(called)
    return told.value


def stands(trace, cycles=8):
    """Whether the commanded TCP does not move at the end of a trace."""
    return np.ptp(trace.signals['tcp_command'][-cycles:], axis=0).max() == 0.0


def test_work_that_exceeds_the_window_is_rejected_and_the_robot_does_not_move(robot):
    with scripting.simulate(robot, cell=around(SLOW, 1)) as called:
        error = refused(called, lambda _: stays(called, 2.0))
        here = called.state()
    assert error.code is Code.BELT
    assert 'belt line: the part would be met at' in str(error)
    assert 'but the window ends at 1100.0 mm' in str(error)
    assert here.motion == 'idle'
    assert np.ptp(called.trace.signals['tcp_command'], axis=0).max() == 0.0


def test_accelerating_belt_carries_the_part_away_and_the_robot_stops_and_continues(robot):
    faster = [speed_of(0.3), speed_of(1.2, after_s=2.0)]
    with scripting.simulate(robot, cell=around(faster, 2)) as called:
        error = refused(called, lambda _: stays(called, 1.4))
        here = called.state()
        called.move_l(to_mm=[0, 0, -800])
    assert error.code is Code.BELT
    assert 'the window ends at 1100.0 mm, and the work is not done' in str(error)
    assert here.motion == 'idle'
    commanded = called.trace.signals['tcp_command']
    assert commanded[-1] == pytest.approx((0.0, 0.0, -0.8), abs=1e-9)
    # the plan and what is added have 40 m/s2 each
    assert np.linalg.norm(np.diff(commanded, n=2, axis=0), axis=1).max() / 1e-6 < 85.0


def test_a_belt_that_runs_back_out_of_the_window_ends_the_work(robot):
    back = [speed_of(0.3), speed_of(-0.3, after_s=2.6)]
    with scripting.simulate(robot, cell=around(back, 1)) as called:
        error = refused(called, lambda _: above(called, lambda _: called.wait_time(5.0)))
        here = called.state()
    assert error.code is Code.BELT
    assert 'it has stopped too early or runs backwards, the part is at 445.0 mm' in str(error)
    assert here.motion == 'idle'
    assert stands(called.trace)


def test_part_on_a_belt_at_rest_does_not_arrive(robot):
    stopped = [speed_of(0.5), speed_of(0.0, after_s=0.7)]

    def waits(called):
        called.wait_time(0.5)
        with called.track('line', timeout_s=1.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)

    with scripting.simulate(robot, cell=around(stopped, 1)) as called:
        error = refused(called, waits)
    assert isinstance(error, scripting.WaitTimeoutError)
    assert 'track: the belt is at rest with the part at' in str(error)
    assert 'within 1 s' in str(error)


def test_belt_that_stops_during_the_approach_is_met_at_its_standstill(robot):
    stops = [speed_of(0.5), speed_of(0.0, after_s=0.82)]
    with scripting.simulate(
        robot, cell=around(stops, 1, window_mm=[400, 1100]), signals=['cell_belts']
    ) as called:
        pick(called)
    assert called.trace.meta['cell']['outcomes']['placed'] == 1
    assert np.ptp(called.trace.signals['cell_belts'][-300:, 0]) == 0.0


def test_a_belt_that_stops_before_the_part_is_in_the_window_ends_the_work(robot):
    stops = [speed_of(0.5), speed_of(0.0, after_s=0.85)]
    with scripting.simulate(robot, cell=around(stops, 1)) as called:
        error = refused(called, lambda _: stays(called, 0.2))
    assert error.code is Code.BELT
    assert 'it has stopped too early or runs backwards' in str(error)
    assert stands(called.trace)


def test_robot_held_on_a_belt_rests_and_picks_the_same_part_when_resumed(robot):
    with scripting.simulate(robot, cell=around(SLOW, 1), signals=['cell_belts']) as called:
        with called.track('line', timeout_s=5.0, **QUICK):
            called.move_l(to_mm=[0, 0, 40], **QUICK)
            called.wait()
            called.hold()
            called.wait_time(0.3)
            stood = [called.position(), called.wait_time(0.05), called.position()]
            called.resume()
            called.move_l(to_mm=[0, 0, 20], **QUICK)
            called.output('gripper', True, payload_kg=0.2)
            called.dwell(0.06)
            called.move_l(to_mm=[0, 0, 40], **QUICK)
        called.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
        called.output('gripper', False, payload_kg=0.0)
    assert stood[0] == pytest.approx(stood[2], abs=2e-5)
    assert called.trace.meta['cell']['outcomes']['placed'] == 1
    far, _ = apart_m(called.trace)
    assert far.max() < 0.25e-3


def test_immediate_resume_continues_the_path_with_the_part(robot):
    with (
        scripting.simulate(
            robot, cell=around([speed_of(1.0)], 1, window_mm=[350, 1150]), signals=['cell_belts']
        ) as called,
        called.track('line', timeout_s=5.0, **QUICK),
    ):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        called.wait()
        called.move_l(to_mm=[0, 0, 30], speed_m_s=0.2)
        called.wait(left_s=0.1)
        called.hold()
        called.resume()
    down = np.diff(called.trace.signals['tcp_command'][:, 2])
    part = called.trace.signals['cell_belts'][:-1, 0] - 0.7
    behind = called.trace.signals['tcp_true'][:-1, 0] - part
    driven = np.flatnonzero(down < -5e-5)
    goes_on = driven[np.argmax(np.diff(driven)) + 1]
    assert np.diff(driven).max() > 50
    assert abs(behind[goes_on]) < 0.5e-3


def test_script_that_dies_after_losing_its_belt_reports_its_own_error(robot):
    def dies(called):
        called.dwell(1.4)
        called.wait(left_s=1.3)
        while called.state().motion == 'moving':
            called.wait_time(0.001)
        raise ValueError('no more')

    def run():
        with scripting.simulate(robot, cell=around(faster, 2)) as called:
            simulated.append(called)
            above(called, dies)

    simulated, faster = [], [speed_of(0.3), speed_of(1.2, after_s=2.0)]
    with pytest.raises(ValueError, match='no more'):
        run()
    assert stands(simulated[0].trace)


def test_rejected_move_after_the_belt_is_not_sent_later(robot):
    with scripting.simulate(robot, cell=around(SLOW, 1)) as called:
        above(called, lambda _: None)
        called.move_l(to_mm=[900, 0, -800], **QUICK)
        error = refused(called, lambda _: called.wait())
        called.move_l(to_mm=[0, 0, -800], **QUICK)
    assert 'the distance from the z axis' in str(error)
    assert called.trace.signals['tcp_command'][-1] == pytest.approx((0.0, 0.0, -0.8), abs=1e-9)


def test_a_later_move_on_the_belt_is_checked_with_the_motion_of_the_belt(robot):
    def goes_on(called):
        called.wait()
        called.wait_time(0.8)
        called.move_l(to_mm=[480, 0, 60], **QUICK)  # in reach where the plan has the part
        called.wait()

    with scripting.simulate(robot, cell=around(SLOW, 1)) as called:
        error = refused(called, lambda _: above(called, goes_on))
    assert 'after its start on the belt' in str(error)
    assert stands(called.trace)


def test_a_resume_that_would_not_be_done_in_the_window_is_rejected_and_the_work_dropped(robot):
    def too_long(called):
        called.dwell(0.3)
        called.wait(left_s=0.2)
        called.hold()
        called.wait_time(2.0)
        called.resume()

    with scripting.simulate(robot, cell=around(SLOW, 1)) as called:
        error = refused(called, lambda _: above(called, too_long))
        called.move_l(to_mm=[0, 0, -800])
    assert error.code is Code.BELT
    assert 'resume: the work would end at' in str(error)
    assert stands(called.trace)


@pytest.mark.parametrize('percent', [60, 120])
def test_an_override_changes_the_work_and_not_the_belt(robot, percent):
    with scripting.simulate(robot, cell=around(SLOW, 1), signals=['cell_belts']) as called:
        called.override(percent)
        pick(called)
    assert called.trace.meta['cell']['outcomes']['placed'] == 1
    far, _ = apart_m(called.trace)
    assert far.max() < 0.25e-3


@pytest.mark.parametrize('percent', [50, 75, 150])
def test_override_after_the_work_delays_moves_until_the_robot_has_left_the_belt(robot, percent):
    with scripting.simulate(robot, cell=around(SLOW, 1), signals=['outputs']) as called:
        above(called, lambda robot: robot.dwell(0.3))
        called.override(percent)
        called.move_l(to_m={'by_m': [0.0, 0.0, 0.001]}, **QUICK)
        called.output('output1', True)
        called.dwell(0.5)
    trace = called.trace
    ends = int(np.argmax(trace['outputs'][:, 1] > 0.0))
    assert ends > 0
    assert np.linalg.norm(trace['tcp_command'][ends + 1] - trace['tcp_command'][-1]) < 1e-5


def test_a_script_that_dies_on_a_belt_leaves_the_robot_in_a_stop(robot):
    def dies(called):
        called.wait()
        raise ValueError('no more')

    def run():
        with scripting.simulate(robot, cell=around(SLOW, 1)) as called:
            simulated.append(called)
            above(called, dies)

    simulated = []
    with pytest.raises(ValueError, match='no more'):
        run()
    trace = simulated[0].trace
    assert trace.meta['stopped'] == 'no more'
    assert stands(trace)


def test_an_encoder_that_jumps_once_loses_no_part(robot):
    jump = {'fault': 'encoder_jump', 'belt': 'line', 'jump_mm': 30, 'after_s': 1.7}
    with scripting.simulate(robot, cell=around(SLOW, 1, faults=[jump]), signals=['cell_belts']) as called:
        pick(called, grip_s=0.3)
    assert called.trace.meta['cell']['outcomes']['placed'] == 1
    far, _ = apart_m(called.trace)
    assert far.max() < 0.25e-3


def test_a_vacuum_that_fails_on_the_belt_is_seen_and_the_next_part_picked(robot):
    failure = {'fault': 'vacuum_failure', 'after_s': 1.0, 'for_s': 1.2}
    with scripting.simulate(robot, cell=around(SLOW, 2, faults=[failure])) as called:
        pick(called)
        pick(called)
    outcomes = called.trace.meta['cell']['outcomes']
    assert outcomes['placed'] == 1
    assert called.trace.meta['cell']['missed'] == 1


MISUSED = {
    'unknown belt': (lambda robot: robot.part('lime'), "unknown belt 'lime', the belts are: line"),
    'unknown key': (lambda robot: stays(robot, 0.1, speed=3), "track: unknown key 'speed'"),
    'no part': (
        lambda robot: robot.track('line', 3).__enter__(),
        'track: part is 3, but must come from robot.part or robot.slot',
    ),
    'a pitch that is a word': (
        lambda robot: robot.slot('line', 'a'),
        "slot: pitch_m is 'a', but must be a number",
    ),
    'a slot beside the world': (
        lambda robot: robot.slot('line', 0.1, float('nan')),
        'slot: across_m is nan m, but must be between -2 and 2 m',
    ),
    'slower than its reserve': (
        lambda robot: robot.track('line', acceleration_m_s2=1.0).__enter__(),
        'acceleration_m_s2 is 1 m/s2, but must be between 4 and',
    ),
}


@pytest.mark.parametrize('case', MISUSED)
def test_invalid_call_is_rejected_with_one_message(robot, case):
    call, sentence = MISUSED[case]
    with (
        scripting.simulate(robot, cell=around(SLOW, 1)) as called,
        pytest.raises(scripting.ScriptError) as told,
    ):
        call(called)
    assert sentence in str(told.value)


def test_belt_with_a_noisy_encoder_is_not_tracked(robot):
    coarse = {'bits': 10, 'circumference_mm': 200}
    with scripting.simulate(robot, cell=around(SLOW, 1, encoder=coarse)) as called:
        error = refused(called, lambda _: above(called, lambda _: None))
    assert error.code is Code.BELT
    assert 'an increment of the encoder of belt line is 195 um, but must be at most 20 um' in str(error)


@pytest.mark.parametrize('before_s', [0.0, 0.5])  # while the belt brakes to rest, and when it stands
def test_part_that_a_belt_at_rest_does_not_deliver_times_out_and_is_reported(before_s, robot):
    stops = [speed_of(0.4), speed_of(0.0, after_s=0.9)]  # the part has passed the light barrier, not more

    def waits(called):
        part = called.part('line', timeout_s=5.0)
        if before_s:
            called.wait_time(before_s)
        with called.track('line', part, timeout_s=1.0, **QUICK):
            called.move_l(to_mm=[0, 0, 60], **QUICK)

    with scripting.simulate(robot, cell=around(stops, 1)) as called:
        error = refused(called, waits)
    assert isinstance(error, scripting.WaitTimeoutError)
    assert error.code is Code.TIMEOUT
    assert 'track: the belt is at rest with the part at ' in str(error)
    assert 'and the window begins at 450.0 mm: not within 1 s' in str(error)


WRONG = {
    'nothing': (lambda robot: None, 'track: the block contains no moves'),
    'a dwell first': (lambda robot: robot.dwell(0.1), 'the first statement on a belt must be a move'),
    'a blend first': (
        lambda robot: [robot.move_l(to_mm=[0, n, 60], blend_mm=5, **QUICK) for n in (0, 20)],
        'the first move on a belt cannot have a blend',
    ),
    'out of reach': (lambda robot: robot.move_l(to_mm=[0, 900, 60], **QUICK), 'the distance from the z axis'),
    'another belt': (lambda robot: robot.track('line').__enter__(), 'the robot already works on belt line'),
}


@pytest.mark.parametrize('case', WRONG)
def test_invalid_work_is_rejected_before_motion(robot, case):
    work, sentence = WRONG[case]

    def wrong(called):
        with called.track('line', timeout_s=5.0, **QUICK):
            work(called)

    with scripting.simulate(robot, cell=around(SLOW, 1)) as called:
        error = refused(called, wrong)
    assert sentence in str(error)
    assert np.ptp(called.trace.signals['tcp_command'], axis=0).max() == 0.0


def test_cell_without_belts_is_rejected(robot):
    with scripting.simulate(robot, cell=around(None, 0)) as called:
        assert "unknown belt 'line', the belts are: none" in str(
            refused(called, lambda _: called.part('line'))
        )


def test_work_that_ends_where_the_robot_cannot_leave_the_belt_is_rejected_before_motion(robot):
    # at the end of its window the robot cannot come to rest within the workspace without a move that leads back
    near_the_rim = {'window_mm': [450, 1280]}
    with scripting.simulate(robot, cell=around([speed_of(1.5)], 1, **near_the_rim)) as called:
        error = refused(called, lambda _: above_only(called))
        here = called.state()
    assert 'track: if no move follows, the robot' in str(error)
    assert here.motion == 'idle'
    assert np.ptp(called.trace.signals['tcp_command'], axis=0).max() == 0.0


def above_only(called):
    """Synchronize with the belt and decide there about the next action."""
    with called.track('line', timeout_s=5.0, speed_m_s=4.0, acceleration_m_s2=10.0, jerk_m_s3=500.0):
        called.move_l(to_mm=[0, 0, 60], **QUICK)
        called.wait()
