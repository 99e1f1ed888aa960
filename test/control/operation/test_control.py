"""Tests of control of the robot: ownership, loss, and rejections that name the owner."""

import pytest

from delta3_pacdrive.control.operation.control import Control, Operator
from delta3_pacdrive.errors import Code
from delta3_pacdrive.robot.sercos.watchdog import OPERATOR_APPEARS_S, OPERATOR_SILENT_S

PERIOD_S = 0.1
ANNA, BERT = Operator('a1', 'Anna'), Operator('b2', 'Bert')


@pytest.fixture
def control() -> Control:
    return Control(PERIOD_S)


def look_until(control: Control, start_s: float, end_s: float) -> list[str]:
    """Check every period; return the client that lost control."""
    steps = round((end_s - start_s) / PERIOD_S)
    lost = [control.poll(start_s + step * PERIOD_S) for step in range(1, steps + 1)]
    return [operator.name for operator in lost if operator]


def test_every_client_may_move_the_robot_without_a_controlling_one(control: Control) -> None:
    assert control.refusal('') is None
    assert control.refusal('a1') is None


def test_only_the_controlling_client_may_move_the_robot(control: Control) -> None:
    assert control.take(ANNA, False, 0.0) is None
    assert control.refusal('a1') is None
    for other in ('', 'b2'):
        reason = control.refusal(other)
        assert reason is not None
        assert (reason.code, 'Anna has control' in reason.sentence) == (Code.CONTROL, True)


def test_second_operator_is_rejected_unless_it_takes_control(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    reason = control.take(BERT, False, 0.0)
    assert reason is not None
    assert reason.code == Code.CONTROL
    assert (control.operator, control.changes, control.losses) == (ANNA, 1, 0)
    assert control.take(BERT, True, 0.0) is None
    assert (control.operator, control.changes, control.losses) == (BERT, 2, 1)
    assert control.refusal('a1') is not None


def test_taking_control_twice_changes_nothing(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    assert control.take(ANNA, False, 1.0) is None
    assert (control.changes, control.losses) == (1, 0)


def test_released_control_is_free_and_was_not_lost(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    assert control.release('b2') is not None
    assert control.operator == ANNA
    assert control.release('a1') is None
    assert (control.operator, control.changes, control.losses) == (None, 2, 0)
    assert control.release('a1') is not None


def test_silent_client_loses_control_once_after_the_limit_and_not_before(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    control.receive_heartbeat('a1', 1, 0.0)
    assert look_until(control, 0.0, OPERATOR_SILENT_S - 2 * PERIOD_S) == []
    control.receive_heartbeat('a1', 2, OPERATOR_SILENT_S - 2 * PERIOD_S)
    assert look_until(control, OPERATOR_SILENT_S - 2 * PERIOD_S, 2 * OPERATOR_SILENT_S - 3 * PERIOD_S) == []
    assert look_until(control, 2 * OPERATOR_SILENT_S - 3 * PERIOD_S, 3 * OPERATOR_SILENT_S) == ['Anna']
    assert (control.operator, control.losses) == (None, 1)


def test_first_heartbeat_is_awaited_longer(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    assert look_until(control, 0.0, OPERATOR_APPEARS_S - PERIOD_S) == []
    assert look_until(control, OPERATOR_APPEARS_S - PERIOD_S, OPERATOR_APPEARS_S + 2 * PERIOD_S) == ['Anna']
    control.take(BERT, False, 10.0)
    control.receive_heartbeat('b2', 1, 10.0)
    control.take(ANNA, True, 10.0)  # the heartbeat of who was there before is not hers
    assert look_until(control, 10.0, 10.0 + OPERATOR_APPEARS_S - PERIOD_S) == []


def test_played_back_heartbeats_keep_no_client_in_control(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    for number in range(1, 6):
        control.receive_heartbeat('a1', number, 0.0)
    lost = []
    for step in range(1, 40):
        control.receive_heartbeat('a1', 1 + step % 5, step * PERIOD_S)
        lost.append(control.poll(step * PERIOD_S))
    assert [operator.name for operator in lost if operator] == ['Anna']


def test_heartbeat_of_another_operator_keeps_no_client_in_control(control: Control) -> None:
    control.take(ANNA, False, 0.0)
    lost = []
    for step in range(1, 60):
        control.receive_heartbeat('b2', step, step * PERIOD_S)
        lost.append(control.poll(step * PERIOD_S))
    assert [operator.name for operator in lost if operator] == ['Anna']


@pytest.mark.parametrize(
    'operator', [Operator('', 'x'), Operator('a', ''), Operator('a', 'x' * 101), Operator('a', 'x\ny')]
)
def test_operator_with_an_invalid_name_receives_no_control(operator: Operator, control: Control) -> None:
    reason = control.take(operator, True, 0.0)
    assert reason is not None
    assert reason.code == Code.CONTENT
    assert control.operator is None
