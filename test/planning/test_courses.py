"""Tests of the common part of moves that does not depend on the robot: limits, payloads and times."""

import numpy as np

from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.curves import line
from delta3_pacdrive.planning.paths.virtual_master import plan_master
from delta3_pacdrive.planning.timing.move_planner import MovePlanner

FROM, TO = np.array([0.0, 0.0, -0.85]), np.array([0.2, 0.0, -0.85])
LENGTH_M = 0.2
FAST, SLOW = Limits(1.0, 10.0, 500.0), Limits(0.5, 10.0, 500.0)
HELD = [(0.0, 0.5)]


def test_moves_on_the_same_path_have_limits_of_their_own(robot):
    curve = line(FROM, TO)
    for limits in (FAST, SLOW, FAST):
        planner = MovePlanner(curve, [(LENGTH_M, limits)], HELD, robot)
        np.testing.assert_array_equal(planner.speed, limits.speed_m_s)
    for at_m in (0.05, 0.15):
        planner = MovePlanner(curve, [(at_m, FAST), (LENGTH_M, SLOW)], HELD, robot)
        np.testing.assert_array_equal(planner.speed[planner.places < at_m - 1e-3], 1.0)
        np.testing.assert_array_equal(planner.speed[planner.places > at_m + 1e-3], 0.5)


def test_moves_on_the_same_path_carry_their_own_payload_from_its_grip_on(robot):
    curve, phases = line(FROM, TO), plan_master(LENGTH_M, 1.0, 10.0, 500.0)
    held = MovePlanner(curve, [(LENGTH_M, FAST)], HELD, robot).dynamics(phases)
    for at_m in (0.05, 0.15):
        planner = MovePlanner(curve, [(LENGTH_M, FAST)], [*HELD, (at_m, 2.0)], robot)
        differs = (planner.dynamics(phases).standing_current_a != held.standing_current_a).any(axis=1)
        np.testing.assert_array_equal(differs, planner.places >= at_m)


def test_each_motion_is_evaluated_once(robot):
    planner = MovePlanner(line(FROM, TO), [(LENGTH_M, FAST)], HELD, robot)
    fast, slow = (plan_master(LENGTH_M, speed, 10.0, 500.0) for speed in (1.0, 0.5))
    first = planner.dynamics(fast)
    assert planner.dynamics(fast) is first
    assert planner.dynamics(slow).tcp_speed_m_s.max() < 0.51 < 0.99 < first.tcp_speed_m_s.max()


def test_edited_phases_are_copies():
    first = plan_master(LENGTH_M, 1.0, 10.0, 500.0)
    kept = first.copy()
    first[:] = 0.0
    np.testing.assert_array_equal(plan_master(LENGTH_M, 1.0, 10.0, 500.0), kept)
