"""Facts about time-optimal moves against the optimum that direct collocation finds: CasADi with IPOPT."""

import os

import numpy as np
import pytest

from collocation import shortest_duration
from delta3_pacdrive.motion.curves import Curve
from planned import dwell, only, plan, to

casadi = pytest.importorskip('casadi', reason='CasADi is not installed: there is no optimum to compare with')

ABOVE = 1.03  # of the optimum
# Of the path. The optimum breaks limits between two places, and so is too short: of the first 40 picks it is up to
# 0.3 % (jerk) and 0.6 % (torque rate) longer with twice as many pieces.
STEPS = 1000
PICKS = int(os.environ.get('DELTA3_ORACLE_PICKS', '8'))  # about two seconds each
LIMITS = ({'jerk_m_s3': 20000.0}, {'torque_rate_n_m_s': 1000.0})


@pytest.mark.parametrize('number', range(PICKS))
def test_random_picks_are_at_most_3_percent_slower_than_the_optimum(number, robot):
    random = np.random.default_rng(number)
    low, high = (-0.25, -0.25, -0.9), (0.25, 0.25, -0.8)
    pick, place = random.uniform(low, high), random.uniform(low, high)
    while np.linalg.norm((place - pick)[:2]) < 0.1:
        place = random.uniform(low, high)
    height, payload = random.uniform(0.05, 0.08), random.uniform(0.0, 2.0)
    up = np.array([0.0, 0.0, height])
    moves = [to(*(pick + up), blend_m=0.02), to(*(place + up), blend_m=0.02), to(*place), dwell(60.0)]
    limits = LIMITS[number % len(LIMITS)]
    planned = plan(robot, moves, pick, payload_kg=payload, time_optimal=True, limits=limits)
    move = only(planned).move(0)
    best = shortest_duration(
        casadi,
        Curve(move.segments, move.length_m),
        move.master,
        robot,
        move.payload_kg,
        limits.get('jerk_m_s3', np.inf),
        limits.get('torque_rate_n_m_s', np.inf),
        STEPS,
    )
    assert best is not None
    print(f'pick {number}: {move.duration_s:.5f} s, {move.duration_s / best:.4f} of the optimum')
    assert 1.0 < move.duration_s / best < ABOVE
