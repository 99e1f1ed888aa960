"""Tests of the speed over blended sequences: every place runs at the speed that its own limits allow."""

from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.adapted_program import rest_of
from delta3_pacdrive.planning.paths.path_dynamics import tcp_motion
from delta3_pacdrive.planning.paths.virtual_master import sample_master
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.timing.move_grid import limits_at

LIMITS = {'speed_mm_s': 500, 'acceleration_mm_s2': 20000, 'jerk_mm_s3': 2000000}
KEPT = 1.0 + 2e-4  # of a limit between two grid points of the planner
NEARLY_SINGLE = 5e-4  # of the speed of a single statement, taken from all of it
NEARLY = 1.0 - 2e-4  # of a speed that is reached
STEPS = 20_000
TIGHT = [  # straight, tangent arc of 20 mm, straight
    ('move_l', {'to_mm': [80, -60, -800], 'blend_mm': 0.5}),
    ('move_c', {'via_mm': [94.142136, -54.142136, -800], 'to_mm': [100, -40, -800], 'blend_mm': 0.5}),
    ('move_l', {'to_mm': [100, 80, -800]}),
]


def planned(robot, start_mm, moves, **head):
    document = {
        'start_mm': start_mm,
        'limits': LIMITS,
        'moves': [{kind: keys} for kind, keys in moves],
        **head,
    }
    program = program_file.parse(document, robot.motion)
    return program_planner.plan(program, program.start_m, robot)


def driven(found, number=0):
    """Distance [m], TCP speed, acceleration and jerk of a move over even times, and its limits there."""
    move = found.plan.move(number)
    master = sample_master(np.linspace(0.0, move.duration_s, STEPS + 1)[1:-1], move.master)
    motion = tcp_motion(move.sample(master[:, 0]), *master.T[1:])
    return master[:, 0], motion, limits_at(master[:, 0], found.stretches[number])


def between(distance, speed, start_m, end_m):
    return speed[(distance > start_m) & (distance < end_m)]


def require_limits(found):
    _, motion, limits = driven(found)
    for power, (value, limit) in enumerate(zip(motion, limits, strict=True), start=1):
        assert ((value / limit) ** (1.0 / power)).max() < KEPT


@pytest.mark.parametrize('strict', [False, True])
def test_a_tight_corner_costs_no_speed_on_the_straights(robot, strict):
    moves = [(kind, keys | {'strict': strict}) for kind, keys in TIGHT]
    found = planned(robot, [-100, -60, -800], moves)
    distance, (speed, *_), _ = driven(found)
    length = found.plan.move(0).length_m
    for start, end in ((0.02, 0.16), (length - 0.10, length - 0.02)):
        assert between(distance, speed, start, end).min() > 0.5 * NEARLY
    assert not found.notices
    require_limits(found)


@pytest.mark.parametrize('blend_mm', [0.1, 0.5, 10.0])
@pytest.mark.parametrize('slow_m', [0.02, 0.2, 0.499])
def test_the_speed_between_two_limits_of_a_straight_line_is_monotonic(robot, blend_mm, slow_m):
    speeds = 1e3 * slow_m, 1000.0
    for first, second in (speeds, speeds[::-1]):
        corner = 0 if first < second else 120
        moves = [
            ('move_l', {'to_mm': [corner, -60, -800], 'blend_mm': blend_mm, 'speed_mm_s': first}),
            ('move_l', {'to_mm': [200, -60, -800], 'speed_mm_s': second}),
        ]
        found = planned(robot, [-80, -60, -800], moves)
        distance, (speed, *_), _ = driven(found)
        corner_m = 1e-3 * (corner + 80)
        across = between(distance, speed, corner_m - 0.05, corner_m + 0.05)
        change = np.diff(across) * np.sign(second - first)
        assert change.min() > -1e-9
        assert across.min() > slow_m * NEARLY
        assert speed.max() > NEARLY
        require_limits(found)


@pytest.mark.parametrize('blend_mm', [0.1, 0.2, 2.0, 40.0])
@pytest.mark.parametrize('repeat', [1, 2])
def test_arcs_of_one_circle_have_no_dip(robot, blend_mm, repeat):
    last = {'blend_mm': blend_mm} if repeat > 1 else {}
    moves = [
        ('move_c', {'via_mm': [0, 80, -800], 'to_mm': [-80, 0, -800], 'blend_mm': blend_mm}),
        ('move_c', {'via_mm': [0, -80, -800], 'to_mm': [80, 0, -800], **last}),
    ]
    found = planned(robot, [80, 0, -800], moves, repeat=repeat)
    distance, (speed, *_), _ = driven(found)
    length = found.plan.move(0).length_m
    assert length == pytest.approx(repeat * 2.0 * np.pi * 0.08, rel=1e-7)
    assert between(distance, speed, 0.03, length - 0.03).min() > 0.5 * NEARLY
    require_limits(found)


@pytest.mark.parametrize('blend_mm', [0.1, 1.0])
def test_collinear_lines_of_one_speed_have_no_dip(robot, blend_mm):
    moves = [
        ('move_l', {'to_mm': [x, -60, -800], **({'blend_mm': blend_mm} if x < 200 else {})})
        for x in (-20, 90, 200)
    ]
    found = planned(robot, [-80, -60, -800], moves)
    distance, (speed, *_), _ = driven(found)
    assert between(distance, speed, 0.03, 0.25).min() > 0.5 * NEARLY


def test_a_smooth_joint_stays_on_both_curves(robot):
    moves = [
        ('move_l', {'to_mm': [0, -60, -800], 'blend_mm': 10}),
        ('move_l', {'to_mm': [100, -60, -800]}),
    ]
    found = planned(robot, [-100, -60, -800], moves)
    assert found.plan.move(0).length_m == pytest.approx(0.2, abs=1e-15)


def test_a_sharp_corner_of_many_costs_no_speed_elsewhere(robot):
    """A zigzag: its long straights run at the limit, independent of the corners between them."""
    rng = np.random.default_rng(7)
    for _ in range(4):
        turns = rng.uniform(-150.0, 150.0, 4)
        blends = rng.choice([0.2, 1.0, 4.0], 4)
        place, heading, moves = np.array([0.0, 0.0]), 0.0, []
        for n in range(5):
            place = place + 80.0 * np.array([np.cos(heading), np.sin(heading)])
            keys = {'to_mm': [*np.clip(place, -250, 250).tolist(), -800]}
            moves.append(('move_l', keys | ({'blend_mm': float(blends[n])} if n < 4 else {})))
            heading += np.radians(turns[n]) if n < 4 else 0.0
        found = planned(robot, [0, 0, -800], moves)
        distance, (speed, *_), _ = driven(found)
        assert between(distance, speed, 0.035, 0.045).min() > 0.5 * NEARLY
        require_limits(found)


CIRCLE = {'via_mm': [0, 80, -800], 'to_mm': [-80, 0, -800]}


@pytest.mark.parametrize('angle_deg', [1.0, 90.0, 180.0, 359.0, 360.0, 361.0, 720.0, 1234.5])
def test_a_circle_over_an_angle_is_one_move_at_constant_speed(robot, angle_deg):
    found = planned(robot, [80, 0, -800], [('move_c', CIRCLE | {'angle_deg': angle_deg})])
    move, angle = found.plan.move(0), np.radians(angle_deg)
    assert len(found.plan) == 1
    assert move.length_m == pytest.approx(0.08 * angle, rel=1e-9)
    end = [0.08 * np.cos(angle), 0.08 * np.sin(angle), -0.8]
    assert move.end_m() == pytest.approx(end, abs=1e-9)
    distance, (speed, *_), _ = driven(found)
    across = between(distance, speed, 0.02, move.length_m - 0.02)
    assert across.min(initial=0.5) > 0.5 * (1.0 - NEARLY_SINGLE)
    places = move.sample(np.linspace(0.0, move.length_m, 200))[:, 0]
    assert np.hypot(*places.T[:2]) == pytest.approx(0.08, abs=1e-8)


def test_turns_of_a_circle_end_where_they_began_and_can_be_blended(robot):
    moves = [
        ('move_l', {'to_mm': [80, 0, -800], 'blend_mm': 5}),
        ('move_c', CIRCLE | {'angle_deg': 720, 'blend_mm': 5}),
        ('move_l', {'to_mm': [80, 80, -800]}),
    ]
    found = planned(robot, [80, -80, -800], moves)
    distance, (speed, *_), _ = driven(found)
    assert between(distance, speed, 0.1, 1.0).min() > 0.5 * NEARLY
    assert found.plan.end_m() == pytest.approx([0.08, 0.08, -0.8], abs=1e-12)


@pytest.mark.parametrize(
    ('keys', 'text'),
    [
        (CIRCLE | {'to_mm': [80, 0, -800]}, 'give two other points of it, and angle_deg: 360'),
        (CIRCLE | {'angle_deg': 0}, 'must be positive and at most'),
        (CIRCLE | {'angle_deg': -90}, 'exchange via and to'),
        (CIRCLE | {'angle_deg': 36001}, r'at most 628.319 rad \(100 turns\)'),
        (CIRCLE | {'via_mm': [0, 0, -800], 'angle_deg': 360}, 'are on a line'),
        (CIRCLE | {'to_mm': [80, 0, -800], 'angle_deg': 360}, 'start and end of the circle coincide'),
    ],
)
def test_a_circle_that_is_not_one_is_rejected_with_a_suggestion(robot, keys, text):
    with pytest.raises(ProgramError, match=r'moves\[0\]\.move_c.*' + text):
        planned(robot, [80, 0, -800], [('move_c', keys)])


def test_program_continues_after_a_circle_over_an_angle(robot):
    moves = [('move_c', CIRCLE | {'angle_deg': 90}), ('move_l', {'to_mm': {'by_mm': [10, 0, 0]}})]
    program = program_file.parse(
        {'start_mm': [80, 0, -800], 'moves': [{k: v} for k, v in moves]}, robot.motion
    )
    assert rest_of(program, 1, robot).start_m == pytest.approx((0.0, 0.08, -0.8), abs=1e-9)
    unknown = replace(program, start_m=None)
    with pytest.raises(ProgramError, match='begin after a move to a point'):
        rest_of(unknown, 1, robot)
