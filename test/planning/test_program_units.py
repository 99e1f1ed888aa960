"""Tests of units in keys of a program, and of points relative to others."""

import math

import pytest

METRES = """\
start_m: [0.0, 0.0, -0.75]
limits: {speed_m_s: 1.5, acceleration_m_s2: 12.0, jerk_m_s3: 400.0}
points: {pick: [0.305, 0.0, -0.8], above: [0.305, 0.0, -0.75]}
moves:
- move_l: {to_m: {by_m: [0.0, 0.0, 0.015]}, blend_m: 0.01, speed_m_s: 0.7}
- move_l: {to_m: above}
- move_c: {via_m: [0.2, 0.1, -0.75], to_m: [0.1, 0.0, -0.75]}
- move_sb: {through_m: [[0.0, 0.1, -0.78], {point: pick, by_m: [0.0, 0.0, 0.05]}, pick]}
- arch: {to_m: [0.1, 0.1, -0.8], up_m: 0.013, down_m: 0.01, keep_out: {height_m: -0.79, margin_m: 0.03}}
- output: {name: gripper, value: true, before_m: 0.002}
- cubic: {to_m: [0.2, 0.0, -0.8], duration_s: 0.3, end_velocity_m_s: [-0.4, 0.0, 0.0]}
"""
MILLIMETRES = """\
start_mm: [0, 0, -750]
limits: {speed_mm_s: 1500, acceleration_mm_s2: 12000, jerk_mm_s3: 4e5}
points_mm: {pick: [305, 0, -800], above: {point: pick, by_mm: [0, 0, 50]}}
moves:
- move_l: {to_m: {by_mm: [0, 0, 15]}, blend_mm: 10, speed_mm_s: 700}
- move_l: {to_mm: above}
- move_c: {via_mm: [200, 100, -750], to_mm: [100, 0, -750]}
- move_sb: {through_mm: [[0, 100, -780], {point: pick, by_m: [0.0, 0.0, 0.05]}, pick]}
- arch: {to_mm: [100, 100, -800], up_mm: 13, down_mm: 10, keep_out: {height_mm: -790, margin_mm: 30}}
- output: {name: gripper, value: true, before_mm: 2}
- cubic: {to_mm: [200, 0, -800], duration_s: 0.3, end_velocity_mm_s: [-400, 0, 0]}
"""


def test_a_program_in_millimetres_is_to_the_bit_the_one_in_metres(load):
    metres, millimetres = load(METRES), load(MILLIMETRES)
    assert millimetres.start_m == metres.start_m
    assert millimetres.statements == metres.statements


def test_arm_angles_may_be_in_degrees(load):
    text = 'moves: [{joints: {points: [{time_s: 0.5, angles_deg: [20, 30, 45], speeds_deg_s: [0, 90, 0]}]}}]'
    (point,) = load(text).statements[0].points
    assert point.angles_rad == tuple(map(math.radians, (20, 30, 45)))
    assert point.speeds_rad_s == (0.0, math.radians(90), 0.0)


def test_point_is_explained_from_above_and_not_from_below(load, refused):
    chain = 'points: {a: [0, 0, -0.8], b: {point: a, by_mm: [100, 0, 0]}, c: {point: b, by_mm: [0, 0, 50]}}\n'
    (move,) = load(f'{chain}moves: [{{move_l: {{to_m: c}}}}]').statements
    assert move.to.point_m == pytest.approx((0.1, 0.0, -0.75), abs=1e-15)
    assert refused(
        'points: {b: {point: a, by_m: [0, 0, 0]}, a: [0, 0, -0.8]}\nmoves: [{move_l: {to_m: b}}]'
    ) == ("1:21: points.b.point: unknown point 'a', the points are: none")
    assert "points.a.point: unknown point 'a'" in refused(
        'points: {a: {point: a, by_m: [0, 0, 0]}}\nmoves: [{move_l: {to_m: a}}]'
    )


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        (
            'moves: [{move_l: {to_m: [0, 0, -0.8], to_mm: [0, 0, -800]}}]',
            '1:39: moves[0].move_l holds to_m and to_mm: give one of them',
        ),
        (
            'moves: [{arch: {to_mm: [0, 0, -800], up_mm: 12000, down_mm: 5}}]',
            '1:45: moves[0].arch.up_mm is 12, but must be between 0 and 1 (in m)',
        ),
        (
            'moves: [{move_l: {to_mm: [0, 0, -80000]}}]',
            '1:26: moves[0].move_l.to_mm is [0.0, 0.0, -80.0] m, farther than 10 m: are these millimetres? (in m)',
        ),
        (
            'moves: [{move_l: {to_mm: [0, abc, -800]}}]',
            "1:30: moves[0].move_l.to_mm[1] must be a number, not 'abc' (in m)",
        ),
        (
            'moves: [{move_l: {to_mm: [0, 0, -800], speed_mm_s: 20000}}]',
            '1:52: moves[0].move_l.speed_mm_s is 20.0, but must not exceed motion.tcp_speed_limit_m_s (15.0) (in m/s)',
        ),
        (
            'moves: [{move_l: {to_mm: [0, 0, -800], jerk_mm_s3: -1000}}]',
            '1:52: moves[0].move_l.jerk_mm_s3 is -1.0, but must be a positive number (in m/s3)',
        ),
        (
            'moves: [{dwell: {time_ms: 5}}]',
            "1:18: moves[0].dwell: unknown key 'time_ms', expected one of time_s",
        ),
        ('moves: [{move_l: {to_deg: [0, 0, -800]}}]', "1:19: moves[0].move_l: unknown key 'to_deg'"),
        (
            'points: {a: [0, 0, -0.8]}\npoints_mm: {a: [0, 0, -800]}\nmoves: [{move_l: {to_m: a}}]',
            "2:13: points_mm: the point 'a' already exists",
        ),
        (
            'payload_kg: 0.0\npayload_mm: 1\nmoves: [{dwell: {time_s: 1}}]',
            "2:1: the program: unknown key 'payload_mm'",
        ),
    ],
)
def test_a_unit_that_is_wrong_or_given_twice_is_rejected_with_its_place(text, sentence, refused):
    assert sentence in refused(text)


def test_unlimited_jerk_is_unlimited_in_any_unit(load):
    (move,) = load('moves: [{move_l: {to_m: [0, 0, -0.8], jerk_mm_s3: .inf}}]').statements
    assert move.limits.jerk_m_s3 == math.inf
