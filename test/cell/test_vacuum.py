"""Tests of valve, vacuum and the force of a cup."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.cell.binary_signal import BinarySignal
from delta3_pacdrive.cell.cell import Cup, Delays
from delta3_pacdrive.cell.gripper import Vacuum, force_needed_n

CYCLE_S = 1e-3
CUP = Cup('gripper', 0.04, 6e4, build_up_s=0.01, decay_s=0.005, open_share=0.1)


def signal(**delays):
    return BinarySignal(Delays(**delays), CYCLE_S, np.random.default_rng(1))


def test_signal_has_its_delay_on_and_off():
    follower = signal(on_s=0.003, off_s=0.001)
    told = [follower.step(value) for value in [False, *[True] * 6, *[False] * 3]]
    assert told == [False, *[False] * 3, *[True] * 3, True, False, False]


def test_signal_without_a_delay_equals_its_source():
    follower = signal()
    values = [True, False, True, True, False]
    assert [follower.step(value) for value in values] == values


def test_a_change_that_is_shorter_than_its_delay_has_no_effect():
    follower = signal(on_s=0.003)
    assert not any(follower.step(value) for value in [True, True, False] * 10)


def test_bouncing_signal_toggles_and_then_holds():
    told = [follower.step(True) for follower in [signal(bounce_s=0.02)] for _ in range(60)]
    assert 3 < sum(told[:20]) < 17
    assert all(told[20:])
    again = signal(bounce_s=0.02)
    assert told == [again.step(True) for _ in range(60)]


def test_the_vacuum_builds_up_and_decays_with_its_time_constants():
    vacuum = Vacuum(CUP, CYCLE_S)
    forces = [vacuum.step(opened=True, closed_by_part=True) for _ in range(10)]
    share = 1.0 - math.exp(-1.0)
    assert vacuum.pressure_pa == pytest.approx(6e4 * share, rel=1e-12)
    assert forces[-1] == pytest.approx(6e4 * share * math.pi * 0.02**2, rel=1e-12)
    for _ in range(5):
        vacuum.step(opened=False, closed_by_part=True)
    assert vacuum.pressure_pa == pytest.approx(6e4 * share / math.e, rel=1e-12)


def test_cup_without_a_part_reaches_a_share_of_the_vacuum():
    vacuum = Vacuum(CUP, CYCLE_S)
    for _ in range(200):
        vacuum.step(opened=True, closed_by_part=False)
    assert vacuum.pressure_pa == pytest.approx(6e3)


def test_vacuum_without_time_constants_is_immediate():
    vacuum = Vacuum(Cup('gripper', 0.04, 6e4), CYCLE_S)
    assert vacuum.step(opened=True, closed_by_part=True) == pytest.approx(75.398, rel=1e-5)
    assert vacuum.step(opened=False, closed_by_part=True) == 0.0


def test_at_rest_a_part_needs_its_weight():
    assert force_needed_n(0.5, 0.5, (0.0, 0.0, 0.0)) == pytest.approx((4.903325, 4.903325))


def test_lateral_holding_force_is_friction_of_the_force_left_by_the_weight():
    # 0.5 kg at 30 m/s2 sideways: 15 N, for which friction of 0.5 asks for 30 N more
    needed, normal = force_needed_n(0.5, 0.5, (18.0, -24.0, 0.0))
    assert needed - normal == pytest.approx(30.0)
    # pressed on by falling faster than a stone, it needs less, but never less than nothing
    assert force_needed_n(0.5, 0.5, (0.0, 0.0, -20.0))[0] == 0.0


@given(
    st.floats(1e-3, 10.0),
    st.floats(0.01, 10.0),
    st.tuples(*[st.floats(-200.0, 200.0)] * 3),
    st.floats(0.0, 1000.0),
)
def test_part_holds_exactly_if_weight_and_friction_hold(mass, friction, acceleration, force):
    needed, normal = force_needed_n(mass, friction, acceleration)
    lateral = mass * math.hypot(*acceleration[:2])
    slack = 1e-9 * (force + needed + lateral / friction + 1.0)
    if force > needed + slack:
        assert normal <= force
        assert lateral <= friction * (force - normal) + slack * friction
    elif force < needed - slack:
        assert normal > force or lateral > friction * (force - normal)
