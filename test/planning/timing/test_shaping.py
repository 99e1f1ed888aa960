"""Tests of input shaping: the shaped master and the residual vibration."""

import math

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.planning.paths.move import MoveKind, check_phases
from delta3_pacdrive.planning.paths.virtual_master import plan_master, sample_master
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.timing.shaping import Shaper, excited_mode, mean_modes
from planned import around, dwell, motors, only, plan, refusal, to

SHAPINGS = ('zv', 'zvd', 'smooth')
FREQUENCY_HZ, DAMPING = 48.0, 0.3
PERIOD_S = 1.0 / (FREQUENCY_HZ * math.sqrt(1.0 - DAMPING**2))
EXACT = 1e-12
QUICK = {'speed_m_s': 3.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20_000.0}


def shaped(robot, kind, **values):
    return robot.replace(
        control__shaping=kind, **{f'control__{name}': value for name, value in values.items()}
    )


def left(kind, frequency_hz, damping=DAMPING):
    """Share of a vibration that the shaper for 48 Hz leaves."""
    return Shaper.of(kind, FREQUENCY_HZ, DAMPING).residual(frequency_hz, damping)


@pytest.mark.parametrize('kind', SHAPINGS)
def test_a_shaper_is_a_mean(kind):
    shaper = Shaper.of(kind, FREQUENCY_HZ, DAMPING)
    assert shaper.weights.sum() == pytest.approx(1.0, abs=EXACT)
    assert (shaper.weights > 0.0).all()
    assert shaper.delays_s[0] == 0.0
    assert (np.diff(shaper.delays_s) > 0.0).all()


def test_zv_lasts_half_a_period_and_the_other_shapers_at_most_one():
    durations = {kind: Shaper.of(kind, FREQUENCY_HZ, DAMPING).duration_s / PERIOD_S for kind in SHAPINGS}
    assert durations['zv'] == pytest.approx(0.5)
    assert durations['zvd'] == pytest.approx(1.0)
    assert 0.9 < durations['smooth'] < 1.0


@pytest.mark.parametrize('kind', SHAPINGS)
def test_shaper_removes_its_vibration(kind):
    assert left(kind, FREQUENCY_HZ) < EXACT


def test_wrong_frequency_leaves_the_smallest_residual_with_zvd():
    for wrong in (0.9, 1.1):
        assert left('zvd', wrong * FREQUENCY_HZ) < 0.02
        assert left('zvd', wrong * FREQUENCY_HZ) < 0.25 * left('zv', wrong * FREQUENCY_HZ)
        assert left('smooth', wrong * FREQUENCY_HZ) < left('zv', wrong * FREQUENCY_HZ)


def test_smooth_leaves_less_of_fast_vibrations_than_zvd():
    assert left('smooth', 2.0 * FREQUENCY_HZ, 0.05) < 0.5 * left('zvd', 2.0 * FREQUENCY_HZ, 0.05)


@pytest.mark.parametrize('kind', SHAPINGS)
@pytest.mark.parametrize('jerk', [20_000.0, math.inf])
def test_a_shaped_master_is_the_sum_of_delayed_ones(kind, jerk):
    phases = plan_master(0.3, 3.0, 100.0, jerk)
    shaper = Shaper.of(kind, FREQUENCY_HZ, DAMPING)
    found = shaper.shaped(phases)
    check_phases(found, 'shaped')
    assert found[-1].tolist() == [phases[-1, 0] + shaper.duration_s, 0.3, 0.0, 0.0, 0.0]
    times = np.linspace(1e-7, found[-1, 0] - 1e-7, 997)  # beside every joint of two phases
    wanted = np.zeros((len(times), 4))
    for weight, delay in zip(shaper.weights, shaper.delays_s, strict=True):
        inside = (times >= delay) & (times <= delay + phases[-1, 0])
        wanted[inside] += weight * sample_master(times[inside] - delay, phases)
        wanted[times > delay + phases[-1, 0], 0] += weight * 0.3
    assert np.abs(sample_master(times, found) - wanted)[:, :2].max() < 1e-9


def test_shapers_for_several_vibrations_remove_each_of_them():
    vibrations = [(27.0, 0.27), (36.0, 0.37), (73.0, 0.31)]
    shaper = Shaper.of_each('modes', vibrations)
    assert shaper.weights.sum() == pytest.approx(1.0, abs=EXACT)
    assert (np.diff(shaper.delays_s) >= 0.0).all()
    assert [shaper.residual(*one) < EXACT for one in vibrations] == [True] * 3
    periods_s = sum(1.0 / (hz * math.sqrt(1.0 - damping**2)) for hz, damping in vibrations)
    assert shaper.duration_s == pytest.approx(periods_s, abs=EXACT)


def test_modes_shape_a_move_for_the_vibrations_of_all_arms_at_its_end(robot):
    ends = (0.4, 0.1, -0.9)
    found = mean_modes(np.array(ends), 0.5, robot)
    assert len(found) == 3
    assert found == sorted(found)
    longer = Shaper.of_each('modes', found).duration_s
    plain, smooth = (
        only(plan(shaped(robot, kind), [to(*ends, **QUICK)], payload_kg=0.5)).duration_s
        for kind in ('none', 'modes')
    )
    assert smooth - plain == pytest.approx(longer, abs=1e-6)
    both = [excited_mode(np.array(ends), np.eye(3)[n : n + 1], 0.5, robot) for n in range(3)]
    assert all(any(one == pytest.approx(mode) for mode in found) for one in both)
    single = shaped(robot, 'modes', shaping_frequency_hz=48.0)
    assert only(plan(single, [to(*ends, **QUICK)])).duration_s - plain == pytest.approx(
        Shaper.of('zvd', 48.0, 0.35).duration_s, abs=1e-6
    )


def swing(phases, frequency_hz, damping):
    """Amplitude of an oscillator that a master has moved, after its end, over its greatest acceleration."""
    size, rest = math.tau * frequency_hz, math.sqrt(1.0 - damping**2)
    times = np.linspace(0.0, phases[-1, 0], 20_001)
    pushed = sample_master(times, phases)[:, 2]
    kernel = np.exp((-damping + 1j * rest) * size * (times[-1] - times))
    steps = 0.5 * (pushed[1:] * kernel[1:] + pushed[:-1] * kernel[:-1])
    return abs(complex(steps.sum())) * (times[1] - times[0])


@pytest.mark.parametrize('kind', SHAPINGS)
def test_a_shaped_master_leaves_an_oscillator_at_rest(kind):
    phases = plan_master(0.3, 3.0, 100.0, 20_000.0)
    found = Shaper.of(kind, FREQUENCY_HZ, DAMPING).shaped(phases)
    assert swing(found, FREQUENCY_HZ, DAMPING) < 1e-4 * swing(phases, FREQUENCY_HZ, DAMPING)


def test_without_shaping_a_plan_is_the_same_to_the_bit(robot):
    moves = [to(0.1, 0.0, -0.8, blend_m=0.02), to(0.1, 0.1, -0.8), dwell(0.1)]
    before = plan(robot, moves)
    other = robot.replace(control__shaping_frequency_hz=30.0, control__shaping_damping=0.1)
    for one, same in zip(before.plan.moves, plan(other, moves).plan.moves, strict=True):
        assert one.master.tobytes() == same.master.tobytes()


@pytest.mark.parametrize('kind', SHAPINGS)
def test_shaped_move_keeps_its_path_and_is_longer_by_the_duration_of_the_shaper(kind, robot):
    moves = [to(0.1, 0.0, -0.8, **QUICK), around((0.15, 0.1, -0.8), (0.0, 0.15, -0.8)), dwell(0.1)]
    plain = plan(robot, moves)
    smooth = plan(shaped(robot, kind, shaping_frequency_hz=FREQUENCY_HZ, shaping_damping=DAMPING), moves)
    longer = Shaper.of(kind, FREQUENCY_HZ, DAMPING).duration_s
    assert smooth.plan.duration_s - plain.plan.duration_s == pytest.approx(2.0 * longer, rel=0.02)
    for one, other in zip(plain.plan.moves, smooth.plan.moves, strict=True):
        assert one.segments.tobytes() == other.segments.tobytes()
        assert other.length_m == pytest.approx(one.length_m, abs=EXACT)
    assert smooth.plan.moves[2].duration_s == 0.1  # who waits is not shaped


def test_move_with_given_times_is_not_shaped(robot):
    angles = [{'time_s': 0.4, 'angles_rad': [0.25, 0.25, 0.25], 'speeds_rad_s': [0, 0, 0]}]
    moves = [{'cubic': {'to_m': [0.05, 0.0, -0.78], 'duration_s': 0.4}}, {'joints': {'points': angles}}]
    found = plan(shaped(robot, 'zvd'), moves).plan
    assert [(move.kind, move.duration_s) for move in found.moves] == [
        (MoveKind.CUBIC, 0.4),
        (MoveKind.JOINTS, 0.4),
    ]


@pytest.mark.parametrize('kind', SHAPINGS)
def test_a_shaped_move_with_bends_keeps_every_limit(kind, robot):
    moves = [
        to(0.2, 0.0, -0.8, blend_m=0.03, **QUICK),
        to(0.2, 0.2, -0.8, blend_m=0.03, **QUICK),
        to(-0.1, 0.2, -0.85, **QUICK),
    ]
    found = plan(shaped(robot, kind), moves).plan
    places, _, _ = sample_plan(found, np.arange(0.0, found.duration_s, 1e-4))
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / 1e-4
    acceleration = np.linalg.norm(np.diff(places, 2, axis=0), axis=1) / 1e-8
    assert speed.max() < 1.002 * QUICK['speed_m_s']
    assert acceleration.max() < 1.005 * QUICK['acceleration_m_s2']
    _, currents, _ = motors(robot, found)
    assert np.abs(currents).max() < 1.02 * robot.motor.peak_current_a


def test_each_move_is_shaped_for_the_vibration_at_its_own_end(robot):
    robot = shaped(robot, 'zvd')
    durations = [
        plan(robot, [to(*end, **QUICK)]).plan.duration_s
        - plan(robot.replace(control__shaping='none'), [to(*end, **QUICK)]).plan.duration_s
        for end in ((0.2, 0.0, -0.75), (0.5, 0.0, -0.9))
    ]
    assert durations[1] > 1.2 * durations[0]  # far out the arms swing more slowly


def test_shaping_frequency_below_1_hz_is_rejected(robot):
    assert set(parameters.SHAPINGS) == {'none', *SHAPINGS, 'modes'}
    with pytest.raises(
        ParameterError, match=r'shaping_frequency_hz is 0\.5, but must be 0 \(computed\) or at least 1'
    ):
        shaped(robot, 'zvd', shaping_frequency_hz=0.5)
    with pytest.raises(ParameterError, match='shaping'):
        shaped(robot, 'zvdd')


def test_unlimited_jerk_is_rejected_where_shaping_needs_it(robot):
    moves = [to(0.2, 0.0, -0.8, blend_m=0.03), to(0.2, 0.2, -0.8, blend_m=0.03), to(0.0, 0.2, -0.8)]
    slow = shaped(robot, 'smooth', shaping_frequency_hz=2.0)
    assert plan(slow, moves).plan.duration_s > plan(robot, moves).plan.duration_s
    strict = [{'move_l': {**move['move_l'], 'strict': True}} for move in moves]
    assert plan(robot, strict)
    assert 'shaped against vibration, ' in refusal(plan, slow, strict)
