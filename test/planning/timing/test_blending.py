"""Tests of blends: sequences of moves without a stop."""

import itertools

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.paths.curves import UNEVEN
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.virtual_master import master_at_distances
from delta3_pacdrive.planning.timing.blending import ROUNDING_M
from planned import EXACT, HOME, SPEED, around, dwell, ends_of, plan, refusal, through, to


def test_inside_a_blended_move_the_speed_never_drops_to_zero(robot):
    planned = plan(
        robot,
        [
            to(0.1, 0.0, -0.75, blend_m=0.02),
            around((0.15, 0.1, -0.8), (0.1, 0.2, -0.8), blend_m=0.02),
            through([(0.0, 0.2, -0.85), (-0.1, 0.15, -0.8)], blend_m=0.02),
            to(-0.1, 0.0, -0.8),
        ],
    )
    assert len(planned.plan) == 1
    move = planned.plan.move(0)
    assert move.kind == MoveKind.BLENDED
    inner = np.linspace(0.05, move.length_m - 0.05, 500)
    assert master_at_distances(inner, move.master)[:, 2].min() > 0.2


def test_a_blended_move_stays_within_the_radius_of_its_corners_and_else_on_its_lines(robot):
    corners = np.array([HOME, (0.2, 0.0, -0.75), (0.2, 0.2, -0.85), (0.0, 0.2, -0.8)])
    radii = (0.03, 0.05)
    moves = [to(*corners[1], blend_m=radii[0]), to(*corners[2], blend_m=radii[1]), to(*corners[3])]
    move = plan(robot, moves).plan.move(0)
    s = np.linspace(0.0, move.length_m, 5000)
    p = sample_path(s, move.segments)[:, 0]
    off = np.min(
        [
            np.linalg.norm(
                p - a - np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)[:, None] * (b - a), axis=1
            )
            for a, b in itertools.pairwise(corners)
        ],
        axis=0,
    )
    near = [np.linalg.norm(p - c, axis=1) for c in corners[1:3]]
    inside = (near[0] < radii[0]) | (near[1] < radii[1])
    assert off[~inside].max() < 1e-9
    assert off[inside].max() > 1e-3
    assert np.abs(p[0] - corners[0]).max() < EXACT
    assert np.abs(p[-1] - corners[-1]).max() < 1e-9


def test_a_blend_may_use_up_the_whole_of_two_moves(robot):
    planned = plan(robot, [to(0.0, 0.0, -0.8, blend_m=0.05), to(0.05, 0.0, -0.8)])
    assert np.abs(ends_of(planned)[-1] - [0.05, 0.0, -0.8]).max() < 1e-9
    assert (
        len(
            plan(
                robot, [to(0, 0, -0.8, blend_m=0.025), to(0.05, 0, -0.8, blend_m=0.025), to(0.05, 0.05, -0.8)]
            ).plan
        )
        == 1
    )


@pytest.mark.parametrize(
    ('moves', 'reason'),
    [
        (
            [to(0.1, 0, -0.75, blend_m=0.06), to(0.1, 0.1, -0.75, blend_m=0.06), to(0, 0.1, -0.75)],
            'moves[1].move_l: its blends overlap: 0.06 m at its start and 0.06 m at its end on a length of 0.1 m',
        ),
        (
            [to(0.05, 0, -0.75, blend_m=0.06), to(0.1, 0.1, -0.75)],
            'moves[0].move_l: its blends overlap: 0 m at its start and 0.06 m at its end on a length of 0.05 m',
        ),
        (
            [to(0.1, 0, -0.75, blend_m=0.06), to(0.1, 0.05, -0.75)],
            'moves[0].move_l: blend_m is 0.06, but the next move is only 0.05 m long',
        ),
        ([to(0.1, 0, -0.75, blend_m=0.01)], 'moves[0].move_l: blend_m needs a move that follows'),
        (
            [to(0.1, 0, -0.75, blend_m=0.01), dwell(1.0)],
            'moves[1].dwell: moves[0].move_l has blend_m, which needs a move that follows',
        ),
        (
            [to(0.1, 0, -0.75, blend_m=0.01), {'cubic': {'to_m': [0, 0, -0.8], 'duration_s': 1.0}}],
            'moves[1].cubic: moves[0].move_l has blend_m, which needs a move that follows',
        ),
        (
            [to(0.1, 0, -0.75, blend_m=0.01), to(0.05, 0, -0.75)],
            'moves[0].move_l: the path turns back at this corner, which cannot be rounded; use blend_m: 0',
        ),
    ],
)
def test_impossible_blend_is_rejected(moves, reason, robot):
    assert refusal(plan, robot, moves).endswith(
        reason.removeprefix('moves[1].dwell: ').removeprefix('moves[1].cubic: ')
    )


def test_each_leg_of_a_blended_move_keeps_its_own_speed(robot):
    legs = [to(0.2, 0.0, -0.75, blend_m=0.01, speed_m_s=1.2), to(0.2, 0.2, -0.75, speed_m_s=0.3)]
    move = plan(robot, legs).plan.move(0)
    s = np.linspace(0.0, move.length_m, 3000)
    p = sample_path(s, move.segments)[:, 0]
    v = master_at_distances(s, move.master)[:, 2]
    second = p[:, 0] > 0.2 - 0.01
    assert v[second].max() <= 0.3 * SPEED
    assert v[~second].max() > 1.0


def jump_m(move):
    """Return by how much two places of a move are farther apart than the way between them."""
    s = np.linspace(0.0, move.length_m, 1001)
    chords = np.linalg.norm(np.diff(sample_path(s, move.segments)[:, 0], axis=0), axis=1)
    return float((chords - np.diff(s) * (1.0 + UNEVEN)).max())


@pytest.mark.parametrize('steps', [-3, -2, -1, 0, 1, 2, 3])
@pytest.mark.parametrize('by', [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_a_move_of_one_micrometre_is_driven_or_rejected_on_either_side_of_the_threshold(by, steps, robot):
    length = 1e-6 * (1.0 + steps * np.finfo(float).eps)
    tiny = {'move_l': {'to_m': {'by_m': [part * length for part in by]}}}
    try:
        planned = plan(robot, [tiny, dwell(0.01), tiny, to(0.1, 0.0, -0.75), tiny]).plan
    except ProgramError as error:
        assert 'the robot is already at' in str(error)  # noqa: PT017
    else:
        moves = [move for move in planned.moves if move.kind == MoveKind.LINE]
        assert len(moves) == 4
        assert all(jump_m(move) < ROUNDING_M for move in moves)


@pytest.mark.parametrize('left_m', [0.0, 1e-15, 1e-12, 1e-9, 1.1e-9, 1e-7, 1e-6, 1.1e-6, 1e-5])
def test_rest_of_a_line_between_two_blends_is_driven_without_a_jump(left_m, robot):
    radius = 1e-3
    between = {'move_l': {'to_m': {'by_m': [0.0, 2.0 * radius + left_m, 0.0]}, 'blend_m': radius}}
    last = {'move_l': {'to_m': {'by_m': [0.0, radius + left_m, 0.0]}}}
    for moves in (
        [to(0.1, 0.0, -0.75, blend_m=radius), between, to(0.2, 0.05, -0.75)],
        [to(0.1, 0.0, -0.75, blend_m=radius), last],
    ):
        move = plan(robot, moves).plan.move(0)
        assert jump_m(move) <= ROUNDING_M
    assert move.end_m() == pytest.approx((0.1, radius + left_m, -0.75), abs=1e-9)
