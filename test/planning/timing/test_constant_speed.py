"""Tests of constant path speed: evenness of accepted moves and correct values in rejections."""

import re

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.path_dynamics import tcp_motion
from delta3_pacdrive.planning.paths.virtual_master import sample_master
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program_planner import plan

LIMITS = {'speed_m_s': 0.5, 'acceleration_m_s2': 20.0, 'jerk_m_s3': 2000.0}
EVEN = 1e-3  # of the speed by which it may differ, in the guide
STEPS = 20_000
NAMED_SPEED = re.compile(r'the largest constant speed is ([0-9.e-]+) m/s')
NAMED_BLEND = re.compile(r'blend_m ([0-9.e-]+) at moves\[(\d+)\]')
CORNER = [
    ('move_l', {'to_m': [0.0, 0.0, -0.8], 'blend_m': 0.02}),
    ('move_l', {'to_m': [0.0, 0.1, -0.8]}),
]
CORNER_START = [-0.1, 0.0, -0.8]


def read(robot, start_m, moves, speed=0.5, **head):
    document = {
        'start_m': start_m,
        'limits': LIMITS | {'speed_m_s': speed},
        'constant_speed': True,
        'moves': [{kind: keys} for kind, keys in moves],
        **head,
    }
    return program_file.parse(document, robot.motion)


def planned(robot, start_m, moves, speed=0.5, **head):
    program = read(robot, start_m, moves, speed, **head)
    return plan(program, program.start_m, robot)


def refusal(robot, *program, **more):
    with pytest.raises(ProgramError) as caught:
        planned(robot, *program, **more)
    return str(caught.value)


def require_even(found, speed):
    """Evaluate a plan densely: the speed rises, is even, and falls."""
    for move in found.plan.moves:
        master = sample_master(np.linspace(0.0, move.duration_s, STEPS + 1)[1:-1], move.master)
        (values, *_) = tcp_motion(move.sample(master[:, 0]), *master.T[1:])
        first, last = np.flatnonzero(values >= (1.0 - 1.3 * EVEN) * speed)[[0, -1]]  # and 0.03 % by the path
        assert values[first : last + 1].min() >= (1.0 - 1.3 * EVEN) * speed
        assert values.max() <= (1.0 + 1e-3) * speed
        assert (np.diff(values[:first]) > -1e-9).all()
        assert (np.diff(values[last + 1 :]) < 1e-9).all()


def random_path(rng):
    """Straights of 60 to 100 mm between corners, an arc now and then; blends from much too small to large enough."""
    place, heading, moves = np.array([0.0, 0.0]), rng.uniform(0.0, 6.0), []
    count = int(rng.integers(2, 5))
    for n in range(count):
        ahead = np.array([np.cos(heading), np.sin(heading)])
        end = place + rng.uniform(0.06, 0.1) * ahead
        keys = {'to_m': [*end.tolist(), -0.8]}
        kind = 'move_l'
        if rng.random() < 0.25:
            kind, middle = 'move_c', 0.5 * (place + end) + 0.01 * np.array([-ahead[1], ahead[0]])
            keys['via_m'] = [*middle.tolist(), -0.8]
        if n + 1 < count:
            keys['blend_m'] = float(rng.choice([0.0005, 0.003, 0.01, 0.02]))
        moves.append((kind, keys))
        place, heading = end, heading + rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.9)
    return [0.0, 0.0, -0.8], moves


@pytest.mark.parametrize('seed', [1, 3, 4, 5, 6, 100, 104, 118])
def test_named_speed_and_blends_are_possible_and_a_larger_speed_is_not(robot, seed):
    rng = np.random.default_rng(seed)
    start, moves = random_path(rng)
    text = refusal(robot, start, moves)
    largest = float(NAMED_SPEED.search(text)[1])
    require_even(planned(robot, start, moves, largest), largest)
    assert 'constant_speed requires' in refusal(robot, start, moves, 1.001 * largest)
    blends = NAMED_BLEND.findall(text)
    assert bool(blends) != ('no blend allows' in text)
    if blends:
        larger = [(kind, dict(keys)) for kind, keys in moves]
        for blend, number in blends:
            assert float(blend) > larger[int(number)][1]['blend_m']
            larger[int(number)][1]['blend_m'] = float(blend)
        require_even(planned(robot, start, larger), 0.5)
    else:
        assert any(kind == 'move_c' for kind, _ in moves) or len(moves) > 2


def test_the_rejection_names_place_speed_and_blend(robot):
    text = refusal(robot, CORNER_START, CORNER)
    assert text.startswith(
        'moves[0].move_l to moves[1].move_l: the speed falls to 0.4436 m/s at 0.08 m from its start, in '
        'moves[0].move_l, but constant_speed requires 0.5 m/s; the largest constant speed is '
    )
    assert 0.4436 <= float(NAMED_SPEED.search(text)[1]) < 0.5
    assert float(NAMED_BLEND.search(text)[1]) == pytest.approx(0.0234, rel=0.01)


def test_a_line_is_even_if_it_is_as_long_as_run_up_and_run_out(robot):
    way = 0.5 * (0.5 / 20.0 + 20.0 / 2000.0)  # run-up and run-out of 0.5 m/s
    for length, allowed in ((1.001 * way, True), (0.99 * way, False)):
        line = [('move_l', {'to_m': [length, 0.0, -0.8]})]
        if allowed:
            require_even(planned(robot, [0.0, 0.0, -0.8], line), 0.5)
        else:
            text = refusal(robot, [0.0, 0.0, -0.8], line)
            assert text.startswith('moves[0].move_l: the speed reaches only 0.49')
            assert text.endswith('no blend allows 0.5 m/s')


def test_a_corner_in_the_run_up_is_rejected(robot):
    moves = [
        ('move_l', {'to_m': [0.01, 0.0, -0.8], 'blend_m': 0.002}),
        ('move_l', {'to_m': [0.01, 0.1, -0.8]}),
    ]
    assert 'the speed stays at ' in refusal(robot, [0.0, 0.0, -0.8], moves)


def test_a_circle_too_tight_has_no_blend(robot):
    circle = [('move_c', {'via_m': [0.01, 0.01, -0.8], 'to_m': [0.02, 0.0, -0.8], 'angle_deg': 720})]
    text = refusal(robot, [0.0, 0.0, -0.8], circle)
    largest = float(NAMED_SPEED.search(text)[1])
    assert largest == pytest.approx(np.sqrt(20.0 * 0.01), rel=0.03)  # acceleration and radius
    assert text.endswith('no blend allows 0.5 m/s')
    require_even(planned(robot, [0.0, 0.0, -0.8], circle, largest), largest)


def test_the_option_of_a_move_overrides_that_of_the_head(robot):
    moves = [(kind, keys | {'constant_speed': False}) for kind, keys in CORNER]
    assert planned(robot, CORNER_START, moves).plan.duration_s > 0.0
    moves = [(kind, keys | {'constant_speed': True}) for kind, keys in CORNER]
    assert 'constant_speed' in refusal(robot, CORNER_START, moves, constant_speed=False)
    mixed = [CORNER[0], ('move_l', CORNER[1][1] | {'constant_speed': False})]
    assert 'must have constant_speed all of them or none: moves[1].move_l' in refusal(
        robot, CORNER_START, mixed
    )


@pytest.mark.parametrize(
    ('kind', 'more', 'why'),
    [
        ('move_l', {'speed_m_s': 0.4}, 'needs one speed_m_s: moves[1].move_l has 0.4, moves[0].move_l 0.5'),
        ('move_l', {'time_optimal': True}, 'all of them or none'),
        ('arch', {'up_m': 0.001, 'down_m': 0.01}, 'moves[1].arch: constant_speed is not for arches'),
    ],
)
def test_path_unsuited_for_constant_speed_is_rejected(robot, kind, more, why):
    moves = [CORNER[0], (kind, CORNER[1][1] | more)]
    assert why in refusal(robot, CORNER_START, moves)


def test_neither_hot_motors_nor_shaping_nor_the_tool_slow_such_a_path_down(robot):
    fast = {'acceleration_m_s2': 200.0, 'jerk_m_s3': 1e5}
    line = [('move_l', {'to_m': [0.2, 0.0, -0.8], **fast})]
    assert 'rms current' in (text := refusal(robot, [0.0, 0.0, -0.8], line, 3.0))
    assert text.endswith('(constant_speed)')
    rotary = parameters.load('rotary')
    turn = [('move_l', {'to_m': [0.02, 0.0, -0.8], 'turn_deg': 170})]
    assert refusal(rotary, [0.0, 0.0, -0.8], turn, 0.3).endswith('(constant_speed)')


def test_a_path_that_waits_for_a_move_is_checked_when_that_arrives(robot):
    first = [('move_l', {'to_m': [0.005, 0.0, -0.8], 'blend_m': 0.002})]
    program = read(robot, [0.0, 0.0, -0.8], first)
    assert program_planner.plan(program, program.start_m, robot, open_end=True).open_from == 0
    whole = [*first, ('move_l', {'to_m': [0.1, 0.0, -0.8]})]
    require_even(planned(robot, [0.0, 0.0, -0.8], whole), 0.5)
    assert 'constant_speed' in refusal(
        robot, [0.0, 0.0, -0.8], [*first, ('move_l', {'to_m': [0.005, 0.1, -0.8]})]
    )


def test_more_than_ten_blends_are_counted(robot):
    moves = [
        (
            'move_l',
            {
                'to_m': [0.02 * (n // 2 + 1) - 0.15, -0.05 + 0.06 * ((n + 1) // 2 % 2), -0.8],
                'blend_m': 0.0005,
            },
        )
        for n in range(16)
    ]
    moves[-1][1].pop('blend_m')
    text = refusal(robot, [-0.15, -0.05, -0.8], moves, 0.2)
    assert len(NAMED_BLEND.findall(text)) == 10
    assert ' more moves allow 0.2 m/s' in text


def test_infinite_jerk_makes_no_pause(robot):
    limits = LIMITS | {'jerk_m_s3': float('inf')}
    line = [('move_l', {'to_m': [0.1, 0.0, -0.8]})]
    require_even(planned(robot, [0.0, 0.0, -0.8], line, limits=limits), 0.5)
    text = refusal(
        robot, CORNER_START, [('move_l', CORNER[0][1] | {'blend_m': 0.001}), CORNER[1]], limits=limits
    )
    named = float(NAMED_SPEED.search(text)[1])
    require_even(planned(robot, CORNER_START, [('move_l', CORNER[0][1] | {'blend_m': 0.001}), CORNER[1]],
                         limits=limits | {'speed_m_s': named}), named)  # fmt: skip
