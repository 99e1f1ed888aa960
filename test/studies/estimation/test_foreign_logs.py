"""Tests of logs of other programs: the instant of their samples, gaps, clocks and missing signals."""

import numpy as np
import pytest

from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.estimation import report
from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.measurement import completed, moving_rows, parts_of
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import OF_DRIVES, TABLE, values_of
from delta3_pacdrive.studies.estimation.replay_model import Replay, ReplayModel
from delta3_pacdrive.studies.estimation.run import OF_TIMING, Study
from delta3_pacdrive.studies.estimation.solver import fit
from delta3_pacdrive.studies.estimation.study import Settings

PERIOD_S = 62.5e-6


@pytest.fixture(scope='module')
def log():
    """A log with commanded motion of all axes for 0.3 s, with the currents of the replay."""
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
    assert {TABLE[symbol] for symbol in (*OF_TIMING, *OF_DRIVES)} <= set(foreign.quantities)
    assert foreign.timing == (*OF_TIMING, *OF_DRIVES)
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


def test_inductance_and_sampling_instant_compensate_each_other_and_widen_the_interval(log, robot):
    truth = {'L': 0.8 * robot.motor.winding_inductance_h, 't_I': PERIOD_S}
    replay = Replay(log, robot)
    measured = np.zeros_like(log['current'])
    measured[replay.rows] = replay.run(truth)['current']
    noisy = measured + 0.02 * np.random.default_rng(1).normal(size=measured.shape)
    quantities = tuple(TABLE[symbol] for symbol in ('K_m', 'L', 't_I'))
    problem = Problem(
        quantities, [ReplayModel(Trace(log.time_s, log.signals | {'current': noisy}), robot)], robot
    )
    found = fit(problem, np.array([problem.values(np.zeros(3))['K_m'] or 1.0, 0.01, 0.0]))
    spans = found.spans(problem, 't_I', 0.0, 2.0 * PERIOD_S)
    assert set(spans) == {'K_m', 'L'}
    low, high = spans['L']
    assert low < truth['L'] < high
    assert high - low > 0.4 * truth['L']  # a millihenry looks like 16 us
    (narrow, wide) = spans['K_m']
    assert wide - narrow < 0.1 * robot.motor.torque_constant_n_m_a
    assert found.spans(problem, 'm_b', 0.0, 1.0) == {}
    told = found.without({'L': 'for a reason'})
    assert told.estimates[1].verdict is Verdict.CONFOUNDED
    assert told.identifiability.findings[1].reason == 'for a reason'


ORDER = [1, 0, 2]


@pytest.fixture(scope='module')
def turns():
    """A log in which the axes move one after the other, with positions and currents of the replay."""
    time_s = np.arange(320) * 1e-3
    way = np.clip((time_s[:, None] - [0.01, 0.08, 0.15]) / 0.15, 0.0, 1.0)
    command = -2.0 + way**3 * (10.0 - 15.0 * way + 6.0 * way**2) * [3.0, -2.5, 2.0]
    speed = np.gradient(command, 1e-3, axis=0)
    return Trace(time_s, {'motor_command': command, 'motor_speed': speed, 'current': 0.0 * command})


@pytest.mark.parametrize(
    ('changed', 'message'),
    [
        ({'current': lambda v: -v}, 'current: the log has the opposite sign'),
        ({'current': lambda v: v[:, ORDER]}, 'current: axes are exchanged in the log: 1 is 2, 2 is 1'),
        ({'current': lambda v: 1.414 * v}, 'as amplitude instead of rms would be'),
        ({'motor_position': lambda v: -v}, 'motor_position: the log has the opposite sign'),
        ({'motor_position': lambda v: v[:, ORDER]}, 'motor_position: axes are exchanged in the log'),
        ({'motor_position': np.degrees}, 'as degrees instead of radians would be'),
        ({'motor_speed': lambda v: v * 60.0 / (2.0 * np.pi)}, 'as rpm instead of rad/s would be'),
    ],
)
def test_signals_of_other_axes_signs_or_units_are_rejected(changed, message, turns, robot, tmp_path):
    replay = Replay(turns, robot)
    signals = {'motor_command': turns['motor_command']}
    for name, values in replay.run({}).items():
        whole = turns['motor_command'].copy() if name == 'motor_position' else np.zeros_like(turns['current'])
        whole[replay.rows] = values
        signals[name] = changed.get(name, lambda v: v)(whole)
    file = tmp_path / 'log.csv'
    trace_file.save(Trace(turns.time_s, signals), file)
    with pytest.raises(EstimationError, match=message) as caught:
        Study(Settings('motor', (str(file),)), tmp_path / 'out', 'test', lambda *_: None).run()
    assert str(caught.value).endswith('correct the file, or describe its columns with --columns')


def test_the_group_that_explains_a_log_is_named(turns, robot, tmp_path):
    heavy = robot.replace(dynamics__plate_mass_kg=1.6, dynamics__forearm_mass_kg=0.6)
    replay = Replay(turns, heavy)
    signals = {'motor_command': turns['motor_command']}
    rng = np.random.default_rng(4)
    for name, noise in {'current': 0.02, 'motor_speed': 0.05, 'motor_position': 0.0}.items():
        values = (
            turns['motor_command'].copy() if name == 'motor_position' else np.zeros_like(turns['current'])
        )
        values[replay.rows] = replay.run({})[name]
        signals[name] = values + noise * rng.normal(size=values.shape)
    file = tmp_path / 'log.csv'
    trace_file.save(Trace(turns.time_s, signals), file)
    found = Study(Settings('motor', (str(file),)), tmp_path / 'out', 'test', lambda *_: None).run()
    assert not found['model_holds']
    assert (found['other_group'], found['missing']) == ('masses', None)
    sentence = 'the quantities of the group masses explain them: estimate these with --group masses'
    assert sentence in report.text(found)
    assert report.refusal(found).endswith(sentence)


def test_a_column_file_corrects_the_sign_of_a_current(log, robot, tmp_path):
    rows = '\n'.join(
        ','.join(map(str, row)) for row in zip(log.time_s, *(-log['motor_speed'].T), strict=True)
    )
    (tmp_path / 'a.csv').write_text('t,a,b,c\n' + rows)
    signals = [f'- {{column: {name}, signal: motor_speed, axis: {n}, unit: rad/s, factor: -1}}\n' for n, name in
               enumerate('abc', start=1)]  # fmt: skip
    (tmp_path / 'c.yaml').write_text('columns:\n- {column: t, signal: time, unit: s}\n' + ''.join(signals))
    settings = Settings('motor', (str(tmp_path / 'a.csv'),), columns=str(tmp_path / 'c.yaml'))
    (found,) = Study(settings, tmp_path / 'out', 'test', lambda *_: None).traces(settings.inputs)
    np.testing.assert_allclose(found['motor_speed'], log['motor_speed'], rtol=1e-12)


@pytest.mark.parametrize('rate', [1.0, 1.005, 0.98])
def test_a_log_of_every_third_cycle_is_interpolated_and_compared_at_its_samples_only(rate, log, robot):
    rows = slice(0, None, 3)
    coarse = Trace(
        2.0 + rate * log.time_s[rows], {name: values[rows] for name, values in log.signals.items()}
    )
    (found,), notes = parts_of(coarse, robot, 'a.csv')
    assert notes[-1] == 'Every 3 bus cycles are sampled; the commands between them are interpolated'
    assert len(found.time_s) == 319
    np.testing.assert_allclose(np.diff(found.time_s), 1e-3, rtol=1e-9)
    # a cubic spline through a quintic of 8 rad in 0.3 s: h^4/384 of its fourth derivative, 3e-5 rad, more at its ends
    np.testing.assert_allclose(found['motor_command'], log['motor_command'][:319], atol=2e-4)
    np.testing.assert_allclose(found['motor_command'][::3], log['motor_command'][:319:3], rtol=1e-12)
    model = ReplayModel(found, robot)
    first = model.rows.start + -model.rows.start % 3
    assert model.measured.shape == (len(range(first, model.rows.stop, 3)), 3)
    assert model.blocks[0].period_s == pytest.approx(3e-3)
    assert parts_of(coarse, robot, 'a.csv', each_cycle=False)[0][0].time_s.shape == (107,)


def log_of(moving, count=1000):
    """Return a log without motion but for some ranges of its rows."""
    speed = np.zeros((count, 3))
    for rows in moving:
        speed[rows] = 5.0
    command = np.cumsum(speed, axis=0) * 1e-3
    return Trace(np.arange(count) * 1e-3 - 5.0, {'motor_command': command, 'motor_speed': speed})


def without(log, rows):
    kept = np.delete(np.arange(len(log.time_s)), rows)
    return Trace(log.time_s[kept], {name: values[kept] for name, values in log.signals.items()})


MOVING = [slice(100, 300), slice(500, 700), slice(800, 900)]


@pytest.mark.parametrize(
    ('gap', 'parts', 'left_out'),
    [
        (slice(0, 0), [(0, 1000)], None),
        (slice(400, 401), [(0, 400), (451, 1000)], 51),  # 50 ms of rest are enough
        (slice(200, 250), [(0, 200), (349, 1000)], 149),
        (slice(600, 601), [(0, 600), (749, 1000)], 149),
        (slice(850, 900), [(0, 850)], 150),  # nothing moves after it
        (slice(600, 749), [(0, 600), (799, 1000)], 199),  # just enough rest before the next motion
        (slice(600, 750), [(0, 600)], 400),  # 1 ms too little
    ],
)
def test_parts_between_gaps_begin_at_rest_and_the_rest_is_counted(gap, parts, left_out, robot):
    found, notes = parts_of(without(log_of(MOVING), gap), robot, 'a.csv')
    assert [
        (round(1e3 * (one.time_s[0] + 5.0)), round(1e3 * (one.time_s[-1] + 5.0)) + 1) for one in found
    ] == parts
    told = [note for note in notes if 'samples are omitted' in note]
    assert [note.split(' ', 1)[0] for note in told] == ([str(left_out)] if left_out else [])


def test_a_cell_without_a_number_is_a_gap(robot):
    log = log_of(MOVING)
    log.signals['motor_speed'][400, 1] = np.nan
    found, notes = parts_of(log, robot, 'a.csv')
    assert [len(one.time_s) for one in found] == [400, 549]
    assert notes[0].startswith('51 of 1000 samples are omitted')


def test_a_log_of_which_no_part_moves_from_rest_is_rejected(robot):
    with pytest.raises(EstimationError, match='begins at rest and moves'):
        parts_of(without(log_of([slice(0, 900)], 901), slice(1, 3)), robot, 'a.csv')


@pytest.mark.parametrize(
    ('rate', 'note'),
    [
        (1.0, None),
        (1.005, 'The clock is 0.5 % fast'),
        (0.98, 'The clock is 2 % slow'),
        (1.02, 'The clock is 2 % fast'),
        (1.021, None),  # another period
    ],
)
def test_a_clock_that_is_nearly_that_of_the_bus_is_corrected_and_named(rate, note, robot):
    log = log_of(MOVING)
    (found,), notes = parts_of(Trace(log.time_s * rate, log.signals), robot, 'a.csv')
    period = 1e-3 * rate if rate > 1.02 else 1e-3
    np.testing.assert_allclose(np.diff(found.time_s), period, rtol=1e-9)
    assert [one[: len(note or '')] for one in notes] == ([note] if note else [])
