"""Facts about arches: their shape keeps the clearances, and is the best of those that do."""

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.arch import Clearances, arch
from delta3_pacdrive.motion.program import KeepOut
from planned import dwell, only, output, plan, refusal

HERE, THERE = (-0.1525, 0.0, -0.85), (0.1525, 0.05, -0.83)
FAST = {'limits': {'jerk_m_s3': 20000.0}, 'time_optimal': True}
SAME_M = 1e-9
DEEP = {'height_m': -0.79, 'margin_m': 0.03}


def over(to=THERE, up=0.01, down=0.02, **options):
    return {'arch': {'to_m': list(to), 'up_m': up, 'down_m': down, **options}}


def path(robot, *moves, start=HERE, **fields):
    """Points of the first move, shape (n, 3), and how long it takes."""
    move = only(plan(robot, [*moves, dwell(9.0)], start, **{**FAST, **fields})).move(0)
    return move.sample(np.linspace(0.0, move.length_m, 1001))[:, 0], move


def beside(points, end):
    return np.linalg.norm((points - end)[:, :2], axis=1)


@pytest.mark.parametrize('aim', ['time', 'energy'])
@pytest.mark.parametrize('keep_out', [None, DEEP])
def test_it_goes_straight_up_and_down_within_its_clearances_and_keeps_out(aim, keep_out, robot):
    options = {} if keep_out is None else {'keep_out': keep_out}
    points, move = path(robot, over(aim=aim, **options))
    assert np.allclose(points[[0, -1]], [HERE, THERE], atol=SAME_M)
    assert beside(points[points[:, 2] <= -0.85 + 0.01], HERE).max() <= SAME_M
    low = points[len(points) // 2 :]
    assert beside(low[low[:, 2] <= -0.83 + 0.02], THERE).max() <= SAME_M
    assert points[:, 2].max() >= -0.83 + 0.02
    if keep_out is not None:
        open_to = np.minimum(beside(points, HERE), beside(points, THERE)) <= DEEP['margin_m']
        assert points[~open_to, 2].min() >= -0.79 - 1e-5
    # its tangent and its curvature are continuous
    edges = move.segments[1:, 0]
    before, after = (move.sample(edges + shift) for shift in (-1e-9, 1e-9))
    assert np.abs(before[:, :3] - after[:, :3]).max() < 1e-3


def test_no_other_arch_of_the_family_is_faster_by_more_than_a_percent(robot):
    _, best = path(robot, over())
    room = Clearances(np.array(HERE), np.array(THERE), 0.01, 0.02)
    random = np.random.default_rng(1)
    durations = []
    for rise, share in random.uniform((0.0, 0.05), (0.1, 0.5), (25, 2)):
        curve = arch(room, room.lowest_top_m + rise, share)
        points = curve_points(curve)
        try:
            _, move = path(robot, {'move_sb': {'through_m': points}})
        except ProgramError:
            continue
        durations.append(move.duration_s)
    assert len(durations) > 15
    assert best.duration_s < 1.01 * min(durations)


def curve_points(curve):
    """Points of an arch for a spline, which is nearly the same path."""
    return [curve.at(s)[0].tolist() for s in np.linspace(0.0, curve.length_m, 41)[1:]]


def test_the_arch_for_energy_is_lower_and_slower_than_the_one_for_time(robot):
    quick, fast = path(robot, over())
    saving, slow = path(robot, over(aim='energy'))
    assert saving[:, 2].max() < quick[:, 2].max() - 5e-3
    assert slow.duration_s > 1.05 * fast.duration_s


def test_packaging_by_arches_makes_more_than_180_picks_a_minute(robot):
    box = {'height_m': -0.825, 'margin_m': 0.03}
    there, back = (over(end, 0.01, 0.01, keep_out=box) for end in ((0.1525, 0.0, -0.85), HERE))
    moves = [
        output(payload_kg=0.5), dwell(0.03), there, output(value=False, payload_kg=0.0), dwell(0.03), back
    ]  # fmt: skip
    planned = plan(robot, moves, HERE, **FAST, payload_kg=0.0, repeat=10)
    assert 600.0 / planned.plan.duration_s > 180.0
    assert max(planned.rms_current_a) <= 4.1


def test_without_time_optimal_it_keeps_the_limits_of_the_move(robot):
    points, move = path(robot, over(speed_m_s=1.0, acceleration_m_s2=10.0), time_optimal=False)
    assert np.allclose(points[-1], THERE, atol=SAME_M)
    assert move.master[:, 2].max() <= 1.001


def test_what_cannot_be_is_refused_with_its_reason(robot):
    assert 'above or below its start: use move_l' in refusal(
        plan, robot, [over((-0.1525, 0.0, -0.8))], HERE, **FAST
    )
    high = over(keep_out={'height_m': -0.6})
    assert 'no arch within the clearances can be driven' in refusal(plan, robot, [high], HERE, **FAST)
    assert 'aim' in refusal(plan, robot, [over(aim='beauty')], HERE, **FAST)
    assert 'height_m' in refusal(plan, robot, [over(keep_out={'margin_m': 0.1})], HERE, **FAST)


def test_a_margin_of_more_than_half_of_the_way_keeps_out_of_nothing_but_the_top(robot):
    points, _ = path(robot, over(keep_out={'height_m': -0.8, 'margin_m': 0.2}))
    assert points[:, 2].max() >= -0.8


def test_the_top_of_an_arch_is_over_what_it_keeps_out_of():
    room = Clearances(np.array(HERE), np.array(THERE), 0.01, 0.02, KeepOut(-0.7))
    assert room.lowest_top_m == -0.7
