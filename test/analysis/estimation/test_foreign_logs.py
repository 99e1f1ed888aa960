"""Facts about logs of other programs: the instant of their samples, and what they do not show of the motors."""

import numpy as np
import pytest

from delta3_pacdrive.analysis.estimation.measurement import completed, moving_rows
from delta3_pacdrive.analysis.estimation.quantities import TABLE, values_of
from delta3_pacdrive.analysis.estimation.replay_model import Replay, ReplayModel
from delta3_pacdrive.analysis.estimation.run import OF_TIMING, Study
from delta3_pacdrive.analysis.estimation.study import Settings
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace

PERIOD_S = 62.5e-6


@pytest.fixture(scope='module')
def log():
    """A log whose commands move all axes for 0.3 s, with the currents of the replay."""
    time_s = np.arange(320) * 1e-3
    way = np.clip((time_s - 0.01) / 0.3, 0.0, 1.0)
    smooth = way**3 * (10.0 - 15.0 * way + 6.0 * way**2)
    command = -2.0 + np.outer(smooth, [8.0, -5.0, 3.0])
    speed = np.gradient(command, 1e-3, axis=0)
    return Trace(time_s, {'motor_command': command, 'motor_speed': speed, 'current': 0.0 * command})


def test_the_current_of_an_earlier_instant_is_that_of_the_current_loop_then(log, robot):
    replay = Replay(log, robot)
    own = replay.run({})['current']
    earlier = [replay.run({'t_I': n * PERIOD_S})['current'] for n in (1e-9, 1.0, 2.0)]
    np.testing.assert_allclose(earlier[0], own, rtol=0.0, atol=1e-9)
    half_way = replay.run({'t_I': 1.5 * PERIOD_S})['current']
    np.testing.assert_allclose(half_way, (earlier[1] + earlier[2]) / 2.0, rtol=0.0, atol=1e-12)
    assert np.abs(earlier[1] - own).max() > 1e-3
    np.testing.assert_array_equal(replay.run({'t_I': 0.0})['current'], own)


def test_a_log_with_earlier_samples_is_explained_by_their_instant_only(log, robot):
    current = Replay(log, robot).run({'t_I': PERIOD_S})['current']
    rows = Replay(log, robot).rows
    measured = np.zeros_like(log['current'])
    measured[rows] = current
    model = ReplayModel(Trace(log.time_s, log.signals | {'current': measured}, {}), robot)
    values = values_of(robot)
    assert np.abs(model.residuals(values | {'t_I': PERIOD_S})[0]).max() == 0.0
    assert np.abs(model.residuals(values)[0]).max() > 1e-3


@pytest.mark.parametrize('group', ['motor', 'masses'])
def test_timing_is_free_for_logs_of_other_programs_only(group, log, robot, tmp_path):
    trace_file.save(log, tmp_path / 'a.npz')

    def study(*known):
        settings = Settings(group, (str(tmp_path / 'a.npz'),), None, 'auto', 'auto', 0.0, 0, None, (), known)
        return Study(settings, tmp_path / 'out', 'test', lambda *_: None)

    foreign = study()
    foreign.allow_for_timing([log])
    assert {TABLE[symbol] for symbol in OF_TIMING} <= set(foreign.quantities)
    assert foreign.timing == OF_TIMING
    assert foreign.model_robot.bus.exchange_period_s == 2 * PERIOD_S
    own = study()
    own.allow_for_timing([Trace(log.time_s, log.signals, {'parameters': {}})])
    assert own.timing == ()
    assert TABLE['t_I'] not in own.quantities
    held = study('t_I', 'L')
    held.allow_for_timing([log])
    assert TABLE['t_I'] not in held.quantities


def test_a_log_without_speeds_is_completed_by_its_positions(log, robot):
    position = log['motor_command']
    arms = Trace(log.time_s, {'arm_position': position / robot.dynamics.gear_ratio})
    found = completed(arms, robot)
    np.testing.assert_allclose(found['motor_position'], position, rtol=1e-12)
    np.testing.assert_allclose(found['motor_speed'], log['motor_speed'], rtol=0.0, atol=1e-9)
    assert moving_rows(found) == moving_rows(log)
    assert completed(log, robot)['motor_speed'] is log['motor_speed']
