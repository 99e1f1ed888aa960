"""Tests of time-optimal moves: duration, and limits of motors and TCP."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.plan import Plan, sample_plan
from planned import ACCELERATION, CURRENT, JERK, SPEED, STEP_S, dwell, motors, only, output, plan, refusal, to
from thoroughness import examples

OPTIMAL = {'time_optimal': True}
HERE = (-0.1525, 0.0, -0.85)
WINDOW, TORQUE_RATE = (
    4,
    1.03,
)  # the torque rate is kept from one grid point to the next, and nearly over each 1 ms


def cycle(height=0.025, way=0.305, blend=0.025, **options):
    """Half a packaging cycle: up, across, and down."""
    steps = ((0.0, 0.0, height), (way, 0.0, 0.0), (0.0, 0.0, -height))
    blends = ({'blend_m': blend}, {'blend_m': blend}, {})
    return [
        {'move_l': {'to_m': {'by_m': list(step)}, **corner, **options}}
        for step, corner in zip(steps, blends, strict=True)
    ]


def tcp(one):
    """Largest speed, acceleration and jerk of the TCP by differences."""
    p, _, _ = sample_plan(one, np.arange(0.0, one.duration_s + STEP_S, STEP_S))
    return [np.linalg.norm(np.diff(p, order, axis=0), axis=1).max() / STEP_S**order for order in (1, 2, 3)]


def torque_rates(robot, one, payload_kg):
    """Changes of the motors' torques without friction [N m/s], over 1 ms."""
    speed, current, _ = motors(robot, one, payload_kg)
    m = robot.motor
    friction = m.static_friction_n_m * np.tanh(speed / m.friction_smoothing_rad_s)
    torque = current * m.torque_constant_n_m_a - friction - m.viscous_friction_n_m_s_rad * speed
    return np.abs(torque[WINDOW:] - torque[:-WINDOW]) / (WINDOW * STEP_S)


def test_with_the_same_limits_it_is_faster(robot):
    limits = {'speed_m_s': 4.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20000.0}
    plain = plan(robot, cycle(**limits), HERE).plan
    optimal = plan(robot, cycle(**limits, **OPTIMAL), HERE).plan
    assert optimal.duration_s < 0.97 * plain.duration_s  # measured: 163.2 of 168.8 ms
    speed, acceleration, jerk = tcp(optimal)
    assert speed <= SPEED * 4.0
    assert acceleration <= ACCELERATION * 100.0
    assert jerk <= JERK * 20000.0


def test_packaging_makes_at_least_165_picks_a_minute_within_the_nominal_current(robot):
    moves = [
        output(payload_kg=0.5), dwell(0.03), *cycle(),
        output(value=False, payload_kg=0.0), dwell(0.03), *cycle(way=-0.305),
    ]  # fmt: skip
    planned = plan(robot, moves, HERE, **OPTIMAL, limits={'jerk_m_s3': 20000.0}, payload_kg=0.0, repeat=10)
    assert 60.0 * planned.repeat / planned.plan.duration_s >= 165.0
    assert 0.97 * 4.1 <= max(planned.rms_current_a) <= 4.1
    assert not planned.notices


@pytest.mark.parametrize('payload', [0.0, 2.0, 10.0])
@pytest.mark.parametrize(
    'limits',
    [
        {'jerk_m_s3': 20000.0},
        {'torque_rate_n_m_s': 1000.0},
        {'torque_rate_n_m_s': 300.0, 'speed_m_s': 2.0},
        {'jerk_m_s3': 400.0},
        {'jerk_m_s3': math.inf},
    ],
)
def test_every_limit_is_kept(limits, payload, robot):
    planned = plan(robot, [*cycle(**limits), dwell(5.0)], HERE, payload_kg=payload, **OPTIMAL)
    one = only(planned)
    speed, current, _ = motors(robot, one, payload)
    assert np.abs(current).max() <= CURRENT * 17.0
    assert np.abs(speed).max() <= SPEED * robot.motor.max_speed_rad_s
    assert tcp(one)[0] <= SPEED * limits.get('speed_m_s', math.inf)
    assert tcp(one)[2] <= JERK * limits.get('jerk_m_s3', math.inf)
    if 'torque_rate_n_m_s' in limits:
        rates = torque_rates(robot, one, payload)
        assert 0.9 * limits['torque_rate_n_m_s'] <= rates.max() <= TORQUE_RATE * limits['torque_rate_n_m_s']


def test_payload_change_during_motion_is_carried_from_there_on(robot):
    limits = {'torque_rate_n_m_s': 1000.0}
    gripping, dropping = cycle(), cycle()
    gripping.insert(1, output(payload_kg=8.0))
    dropping.insert(1, output(payload_kg=0.0))
    light, later, heavy, dropped = (
        only(plan(robot, [*moves, dwell(5.0)], HERE, payload_kg=payload, **OPTIMAL, limits=limits)).duration_s
        for moves, payload in ((cycle(), 0.0), (gripping, 0.0), (cycle(), 8.0), (dropping, 8.0))
    )
    assert 1.01 * light < later < 0.999 * heavy
    assert 1.01 * light < dropped < 0.95 * heavy


@settings(max_examples=examples(25), deadline=None)
@given(
    st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25), st.floats(-0.9, -0.8)),
    st.tuples(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25), st.floats(-0.9, -0.8)),
    st.floats(0.01, 0.05),
    st.sampled_from([0.002, 0.01, 0.02]),
    st.floats(0.0, 10.0),
    st.sampled_from([{'jerk_m_s3': 20000.0}, {'jerk_m_s3': 2000.0}, {'torque_rate_n_m_s': 800.0}]),
)
def test_picks_anywhere_keep_the_limits(robot, pick, place, height, blend, payload, limits):
    height = max(height, 2.1 * blend)
    if np.linalg.norm(np.subtract(pick, place)[:2]) < 0.05:
        place = (pick[0] + 0.1 * (-1.0 if pick[0] > 0.0 else 1.0), pick[1], place[2])
    moves = [
        to(pick[0], pick[1], pick[2] + height, blend_m=blend),
        to(place[0], place[1], place[2] + height, blend_m=blend),
        to(*place),
        dwell(30.0),
    ]
    one = only(plan(robot, moves, pick, payload_kg=payload, **OPTIMAL, limits=limits))
    _, current, _ = motors(robot, one, payload)
    assert np.abs(current).max() <= CURRENT * 17.0
    assert tcp(one)[2] <= JERK * limits.get('jerk_m_s3', math.inf)
    if 'torque_rate_n_m_s' in limits:
        assert torque_rates(robot, one, payload).max() <= TORQUE_RATE * limits['torque_rate_n_m_s']


def test_it_can_be_held_anywhere_on_its_path(robot):
    one = only(plan(robot, [*cycle(), dwell(5.0)], HERE, **OPTIMAL, limits={'jerk_m_s3': 20000.0}))
    for cycle_number in range(1, int(one.duration_s * 1e3), 7):
        timeline = Timeline(Plan.of([one.move(0)]), 1e-3)
        timeline.start(0)
        profile = timeline.stop(cycle_number)
        timeline.change(profile)
        stopped = timeline.at(timeline.end_cycle)
        assert stopped.speed_m_s == 0.0
        assert stopped.distance_m <= one.move(0).length_m


def test_a_heavier_arm_than_the_motors_hold_is_rejected(robot):
    weak = robot.replace(motor__peak_current_a=0.2, motor__nominal_current_a=0.2)
    sentence = refusal(plan, weak, cycle(), HERE, payload_kg=10.0, **OPTIMAL)
    assert 'even at standstill' in sentence


def test_blended_moves_are_either_all_time_optimal_or_none(robot):
    moves = cycle()
    moves[1]['move_l']['time_optimal'] = True
    assert 'must be time-optimal all of them or none' in refusal(plan, robot, moves, HERE)


def test_a_torque_rate_needs_a_time_optimal_move(robot):
    sentence = refusal(plan, robot, cycle(torque_rate_n_m_s=500.0), HERE)
    assert 'moves[0].move_l.torque_rate_n_m_s is a limit of time-optimal moves' in sentence
