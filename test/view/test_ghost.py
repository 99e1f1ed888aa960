"""Tests of the ghost: position, rotation of its tool, and visibility."""

import numpy as np
import pytest

from delta3_pacdrive.view.figure import FAR_M, FAR_RAD, ghost_of
from delta3_pacdrive.view.values import Instant, TurnInstant

TCP, ERROR = np.array([0.1, 0.0, -0.8]), np.array([1e-4, 0.0, -2e-4])
TRUE = TCP + np.array([0.0, 3e-4, 0.0])


def instant(turn=None, true=TRUE):
    return Instant(1.0, np.zeros(3), true_m=true, turns=() if turn is None else (turn,))


@pytest.mark.parametrize(
    ('kind', 'place', 'turn'),
    [('command', TCP + 100 * ERROR, 0.5 + 0.3), ('true', TCP + 100 * (TRUE - TCP), 0.5 - 0.2)],
)
def test_offset_is_the_magnified_error_of_tcp_and_tool(kind, place, turn):
    there, angle = ghost_of(instant(TurnInstant(0.5, 0.003, 0.498)), TCP, ERROR, kind, 100.0)
    assert there == pytest.approx(place)
    assert angle == pytest.approx(turn)


def test_motion_ends_at_the_last_valid_set_point():
    there, angle = ghost_of(instant(TurnInstant(0.5, -0.1)), TCP, 10 * ERROR, 'command', 1000.0)
    assert np.linalg.norm(there - TCP) == pytest.approx(FAR_M)
    assert angle == pytest.approx(0.5 - FAR_RAD)


def test_a_turn_alone_is_seen_and_an_error_that_only_tints_is_not():
    nothing = np.zeros(3)
    there, angle = ghost_of(instant(TurnInstant(0.0, 0.01)), TCP, nothing, 'command', 10.0)
    assert there.tolist() == TCP.tolist()
    assert angle == pytest.approx(0.1)
    assert ghost_of(instant(TurnInstant(0.0, 0.001)), TCP, nothing, 'command', 10.0) is None
    assert ghost_of(instant(), TCP, ERROR, 'command', 1.0) is None


def test_result_needs_true_values_and_positions():
    turn = TurnInstant(0.0, 1.0, 1.0)
    assert ghost_of(instant(turn), TCP, ERROR, 'none', 100.0) is None
    assert ghost_of(instant(turn, None), TCP, ERROR, 'true', 100.0) is None
    assert ghost_of(instant(turn), TCP, np.full(3, np.nan), 'command', 100.0) is None
    assert ghost_of(instant(TurnInstant(0.5)), TCP, ERROR, 'true', 100.0)[1] == 0.5
