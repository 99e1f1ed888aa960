"""Tests of arches: clearances, and the optimal shape that keeps them."""

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.arch import Clearances, arch, best_arch, plain_corners
from delta3_pacdrive.planning.limits.energy import heat_weight, price_of_time_w
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.planned_move import grouped, plan_move
from delta3_pacdrive.planning.program.model import KeepOut
from delta3_pacdrive.planning.timing.blending import PathSegment
from delta3_pacdrive.studies.places.planning.evaluation import study
from planned import dwell, only, output, plan, refusal, to

HERE, THERE = (-0.1525, 0.0, -0.85), (0.1525, 0.05, -0.83)
FAST = {'limits': {'jerk_m_s3': 20000.0}, 'time_optimal': True}
PACKAGING = {'speed_m_s': 4.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20000.0}
LIMITS = Limits(4.0, 100.0, 20000.0)
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
def test_arch_is_vertical_within_its_clearances_and_avoids_the_keep_out_volume(aim, keep_out, robot):
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
    assert np.abs(before[:, :2] - after[:, :2]).max() < 1e-5
    assert np.abs(before[:, 2] - after[:, 2]).max() < 1e-2  # of some 100 1/m in a bend that is 2 mm high


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


def corners(end, blend_m):
    """Up by 25 mm, across, and down, with rounded corners."""
    top_m = end[2] + 0.025
    return [
        to(-end[0], 0.0, top_m, blend_m=blend_m), to(end[0], 0.0, top_m, blend_m=blend_m), to(*end)
    ]  # fmt: skip


def lost_j(robot, *moves, **fields):
    """Energy lost in a round of 10 with a part of 0.5 kg on the way there, and rounds a minute."""
    there, back = moves
    grip, release = output(payload_kg=0.5), output(value=False, payload_kg=0.0)
    round_ = [grip, dwell(0.03), *there, release, dwell(0.03), *back]
    planned = plan(robot, round_, HERE, payload_kg=0.0, repeat=10, **fields)
    return study(planned, robot).energy.lost_j, 600.0 / planned.plan.duration_s


def test_time_optimal_arches_for_energy_lose_less_than_plain_corners_that_are_slower(robot):
    box = {'height_m': -0.825, 'margin_m': 0.03}
    ends = ((0.1525, 0.0, -0.85), HERE)
    arches = ([over(end, 0.01, 0.01, keep_out=box, aim='energy')] for end in ends)
    saving_j, rate = lost_j(robot, *arches, **FAST)
    corners_j, slower = lost_j(robot, *(corners(end, 0.025) for end in ends), limits=PACKAGING)
    assert slower < rate
    assert saving_j < 0.9 * corners_j


def test_with_its_thermal_limit_no_arch_for_time_loses_less_than_the_one_for_energy(robot):
    ends = ((0.1525, 0.0, -0.85), HERE)
    quick_j, saving_j = (
        lost_j(robot, *([over(end, 0.0, 0.0, aim=aim)] for end in ends), **FAST)[0]
        for aim in ('time', 'energy')
    )
    assert saving_j < 0.75 * quick_j


@pytest.mark.parametrize(('up', 'down'), [(0.01, 0.02), (0.0, 0.0), (0.03, 0.0)])
def test_no_plain_corners_within_the_clearances_are_better_than_the_arch_for_energy(up, down, robot):
    room = Clearances(np.array(HERE), np.array(THERE), up, down)
    found, cost = [], price_of_energy(robot)
    best = cost(best_arch(room, cost, corners=True))
    for top_m in room.lowest_top_m + np.array([0.0, 0.005, 0.01, 0.02]):
        for curve in plain_corners(room, top_m):
            found.append(cost(curve))
    assert best <= min(found)


def price_of_energy(robot):
    """Cost of a curve of packaging: its energy, and its time at the price of time."""

    def cost(curve):
        stretches = [(curve.length_m, LIMITS)]
        segment = PathSegment(curve, LIMITS, 0.0, False, MoveKind.SPLINE, 0, 'arch')
        planned = plan_move([segment], curve, stretches, [], 0.5, robot)
        return planned.energy.lost_j + price_of_time_w(robot) * planned.move.duration_s

    return cost


def test_a_second_costs_as_much_as_three_motors_lose_at_nominal_current(robot):
    motor = robot.motor
    assert price_of_time_w(robot) == pytest.approx(3 * 1.5 * motor.winding_resistance_ohm * 4.1**2)
    at_peak_w = 3 * 0.5 * motor.winding_resistance_ohm * motor.peak_current_a**2
    assert heat_weight(robot) == pytest.approx(at_peak_w / price_of_time_w(robot))


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


def test_impossible_arch_is_rejected_with_its_reason(robot):
    assert 'above or below its start: use move_l' in refusal(
        plan, robot, [over((-0.1525, 0.0, -0.8))], HERE, **FAST
    )
    high = over(keep_out={'height_m': -0.6})
    assert 'no arch within the clearances can be driven' in refusal(plan, robot, [high], HERE, **FAST)
    assert 'aim' in refusal(plan, robot, [over(aim='beauty')], HERE, **FAST)
    assert 'height_m' in refusal(plan, robot, [over(keep_out={'margin_m': 0.1})], HERE, **FAST)


def test_margin_above_half_the_range_excludes_only_the_top(robot):
    points, _ = path(robot, over(keep_out={'height_m': -0.8, 'margin_m': 0.2}))
    assert points[:, 2].max() >= -0.8


def test_top_of_an_arch_is_above_the_keep_out_volume():
    room = Clearances(np.array(HERE), np.array(THERE), 0.01, 0.02, KeepOut(-0.7))
    assert room.lowest_top_m == -0.7


@pytest.mark.parametrize('limits', [{}, {'acceleration_m_s2': 100.0, 'jerk_m_s3': 5000.0, 'speed_m_s': 4.0}])
def test_slowed_arches_give_one_notice_and_none_without_explicit_limits(limits, robot):
    there, back = (
        {'arch': {'to_m': [x, 0.0, -0.85], 'up_m': 0.03, 'down_m': 0.03, **limits}} for x in (0.15, -0.15)
    )
    planned = plan(robot, [there, back] * 10, (-0.15, 0.0, -0.85))
    slowed = [notice for notice in planned.notices if 'arch is slowed down' in notice]
    assert len(slowed) == len(limits and [0])
    assert all(notice.endswith(' (20 times)') for notice in slowed)


def test_combined_notice_counts_its_occurrences():
    one, two = (
        'moves[3].arch is slowed down, 0.2 s instead of 0.1 s',
        'moves[7].arch is slowed down, 4e-1 s instead of 0.3 s',
    )
    assert grouped([one, 'other', two]) == [f'{one} (2 times)', 'other']
    assert grouped([*grouped([one, two]), two]) == [f'{one} (3 times)']
