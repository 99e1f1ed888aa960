"""Tests of the keyboard of ``delta3 move servo``."""

import json

import pytest

from delta3_pacdrive.cli import move, move_servo
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.cli.move_servo import (
    DIRECTIONS,
    FIRST_S,
    REPEATED_S,
    SPEED_MIN_M_S,
    Keyboard,
    keys_of,
)

STANDING = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('keys', 'direction'),
    [
        (('w', '\x1b[A'), (1.0, 0.0, 0.0)),
        (('s', '\x1b[B'), (-1.0, 0.0, 0.0)),
        (('a', '\x1b[D'), (0.0, 1.0, 0.0)),
        (('d', '\x1b[C'), (0.0, -1.0, 0.0)),
        (('r', '\x1b[5~'), (0.0, 0.0, 1.0)),
        (('f', '\x1b[6~'), (0.0, 0.0, -1.0)),
    ],
)
def test_each_key_moves_along_its_axis(keys, direction):
    for key in keys:
        keyboard = Keyboard(0.1, 0.5)
        assert not keyboard.press(key, 0.0)
        assert keyboard.velocity(0.0) == tuple(0.1 * share for share in direction)
    assert {key for key, one in DIRECTIONS.items() if one == direction} == set(keys)


def test_a_key_counts_until_it_may_repeat_and_then_until_the_next_repetition():
    keyboard = Keyboard(0.1, 0.5)
    keyboard.press('w', 1.0)
    assert keyboard.velocity(1.0 + FIRST_S - 1e-9) != STANDING
    assert keyboard.velocity(1.0 + FIRST_S) == STANDING
    keyboard.press('w', 2.0)
    keyboard.press('w', 2.0 + FIRST_S - 0.1)
    assert keyboard.velocity(2.0 + FIRST_S - 0.1 + REPEATED_S - 1e-9) != STANDING
    assert keyboard.velocity(2.0 + FIRST_S - 0.1 + REPEATED_S) == STANDING


def test_space_stops_and_another_key_replaces_the_first():
    keyboard = Keyboard(0.1, 0.5)
    keyboard.press('w', 0.0)
    keyboard.press(' ', 0.1)
    assert keyboard.velocity(0.1) == STANDING
    keyboard.press('w', 0.2)
    keyboard.press('a', 0.3)
    assert keyboard.velocity(0.3) == (0.0, 0.1, 0.0)
    keyboard.press('x', 0.3)
    assert keyboard.velocity(0.3) == (0.0, 0.1, 0.0)


def test_the_speed_stays_within_its_limits():
    keyboard = Keyboard(0.1, 0.2)
    for _ in range(10):
        keyboard.press('+', 0.0)
    assert keyboard.speed_m_s == 0.2
    for _ in range(100):
        keyboard.press('-', 0.0)
    assert keyboard.speed_m_s == SPEED_MIN_M_S
    assert Keyboard(0.1, 0.05).speed_m_s == 0.05


@pytest.mark.parametrize('key', ['q', '\x04', ''])
def test_the_steering_ends_with_q_and_with_the_input(key):
    assert Keyboard(0.1, 0.5).press(key, 0.0)


def test_sequences_of_a_terminal_are_single_keys():
    assert list(keys_of('w\x1b[A\x1b[5~q')) == ['w', '\x1b[A', '\x1b[5~', 'q']
    assert list(keys_of('\x1b[Zw')) == ['\x1b', '[', 'Z', 'w']
    assert list(keys_of('')) == []


def test_every_key_of_the_help_has_an_effect():
    named = move_servo.HELP.replace('up/down', '').replace('left/right', '').replace('page', '')
    for key in DIRECTIONS:
        assert len(key) > 1 or f'{key}/' in named or f'/{key}' in named


def test_without_a_terminal_nothing_is_sent(capsys):
    assert main(['move', 'servo', '--json']) == 1
    assert json.loads(capsys.readouterr().out)['error'] == 'move servo reads keys and needs a terminal'
    assert 'servo' in move.ACTIONS
