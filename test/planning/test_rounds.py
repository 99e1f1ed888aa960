"""Tests of program rounds joined by blends, so that the robot need not stop between them."""

import numpy as np
import pytest

from delta3_pacdrive.planning.plan import sample_plan
from planned import dwell, output, plan, refusal, to

HERE = (0.1, 0.0, -0.8)
CORNERS = ((0.1, 0.1, -0.8), (-0.1, 0.1, -0.8), (-0.1, -0.1, -0.8), (0.1, -0.1, -0.8))
QUICK = {'speed_m_s': 2.0, 'acceleration_m_s2': 30.0, 'jerk_m_s3': 2000.0}


def square(*blends):
    return [
        to(*corner, **({'blend_m': blend} if blend else {}))
        for corner, blend in zip(CORNERS, blends, strict=True)
    ]


def standstills(planned):
    """Times of rest of the TCP between start and end."""
    times = np.arange(5e-3, planned.plan.duration_s - 5e-3, 1e-3)
    _, master, _ = sample_plan(planned.plan, times)
    stands = np.abs(master[:, 1]) < 1e-3
    return int((np.diff(stands.astype(int)) == 1).sum()) + int(stands[0])


def test_blend_at_the_end_continues_into_the_next_round(robot):
    # it stops once a round, at the second corner
    joined = plan(robot, square(0.03, 0.0, 0.03, 0.03), HERE, repeat=4, limits=QUICK, time_optimal=True)
    stopping = plan(robot, square(0.03, 0.0, 0.03, 0.0), HERE, repeat=4, limits=QUICK, time_optimal=True)
    assert standstills(joined) == 4
    assert standstills(stopping) == 7
    assert joined.plan.duration_s < stopping.plan.duration_s
    assert np.allclose(joined.plan.end_m(), CORNERS[-1], atol=1e-9)
    # the rounds between are the same moves
    assert len(joined.plan.moves) <= 4
    assert joined.first_round == 2
    assert joined.names[0] == 'moves[0].move_l to moves[1].move_l'
    assert joined.names[1] == 'moves[2].move_l to moves[1].move_l'


def test_without_any_stop_all_rounds_are_one_move(robot):
    planned = plan(robot, square(0.03, 0.03, 0.03, 0.03), HERE, repeat=5, limits=QUICK)
    assert len(planned.plan) == 1
    assert standstills(planned) == 0
    p, _, _ = sample_plan(planned.plan, np.arange(0.0, planned.plan.duration_s, 1e-3))
    right = (p[:, 0] > 0.0).astype(int)
    assert (np.diff(right) == 1).sum() == 5


def test_too_many_corners_for_one_move_are_rejected(robot):
    sentence = refusal(plan, robot, square(0.03, 0.03, 0.03, 0.03), HERE, repeat=100, limits=QUICK)
    assert '4 moves in 100 rounds' in sentence
    assert 'let one of them end exactly' in sentence


@pytest.mark.parametrize('first', [dwell(0.1), output()])
def test_round_that_begins_without_motion(first, robot):
    moves = [first, *square(0.03, 0.0, 0.03, 0.03)]
    if 'dwell' in first:
        assert 'blend_m needs a move that follows' in refusal(
            plan, robot, moves, HERE, repeat=3, limits=QUICK
        )
        return
    planned = plan(robot, moves, HERE, repeat=3, limits=QUICK)
    # the output is switched in each round: at the start, then in the middle of the blend
    switched = [len(planned.plan.move(n).events) for n in range(len(planned.plan))]
    assert sum(switched) == 3


def test_single_round_needs_a_move_after_its_last_blend(robot):
    assert 'blend_m needs a move that follows' in refusal(
        plan, robot, square(0.03, 0.0, 0.03, 0.03), HERE, limits=QUICK
    )


def test_payloads_are_carried_on_into_the_next_round(robot):
    moves = square(0.03, 0.0, 0.03, 0.03)
    moves.insert(2, output(payload_kg=1.0))
    moves.insert(1, output(value=False, payload_kg=0.0))
    planned = plan(robot, moves, HERE, repeat=3, payload_kg=0.5, limits=QUICK)
    carried = [planned.plan.move(n).payload_kg for n in range(len(planned.plan))]
    # from the first corner on without, from the second one on with a part, which is let go again at the next first one
    assert carried == [0.5, 1.0, 1.0, 1.0]


def test_the_statements_end_where_the_last_round_drives_them(robot):
    planned = plan(robot, square(0.03, 0.0, 0.03, 0.03), HERE, repeat=3, limits=QUICK)
    order = [end for end in planned.ends if end is not None]
    assert len(order) == 4
    last = len(planned.plan) - 1
    assert [move for move, _ in planned.ends] == [last - 1, last - 1, last, last]
