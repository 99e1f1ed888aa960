"""Tests of waiting requests: order, withdrawal by their operator, and time limit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.actions import Replied
from delta3_pacdrive.control.messages import Reply, Request
from delta3_pacdrive.control.queue.request_queue import (
    NEWS_S,
    OPERATORS_MAX,
    PASSING,
    REMEMBERED_S,
    ReceivedRequests,
    Waiting,
)
from delta3_pacdrive.control.queue.request_service import WITHDRAWN, RequestService
from delta3_pacdrive.control.queue.task_status import TaskStatus
from delta3_pacdrive.errors import Code, Reason, RefusedError

STEPS = st.lists(
    st.one_of(
        st.tuples(st.just('add'), st.sampled_from('AB'), st.integers(1, 5)),
        st.tuples(st.just('withdraw'), st.sampled_from('AB'), st.integers(1, 5)),
        st.tuples(st.just('serve'), st.just(''), st.just(0)),
    ),
    max_size=40,
)


@given(steps=STEPS)
def test_after_any_steps_each_request_was_served_or_taken_back_once_in_its_order(
    steps: list[tuple[str, str, int]],
) -> None:
    actions: list[Replied] = []
    service = RequestService(TaskStatus(), actions.append)
    waiting: list[Request] = []
    expected: list[tuple[Request, str]] = []
    for step, operator, number in steps:
        if step == 'add':
            waiting.append(request(operator, number))
            assert service.add(waiting[-1], 0.0)
        elif step == 'withdraw':
            text = Request('me', operator, 99, 0, 'withdraw', str(number))
            service.withdraw(text, lambda: 'too late', lambda _: '')
            gone = [one for one in waiting if one == request(operator, number)]
            expected += [(one, str(WITHDRAWN)) for one in gone]
            waiting = [one for one in waiting if one not in gone]
        else:
            served = service.serve_next(2.0 * NEWS_S, lambda _: False, lambda _: service.reply('done'))
            assert served == bool(waiting)
            expected += [(one, 'done') for one in waiting[:1]]
            waiting = waiting[1:]
        answers = [(one.request, str(one.reason or one.sentence)) for one in actions]
        assert [one for one in answers if one[0].action == 'start'] == expected


def test_a_rejection_for_a_state_may_be_outdated_until_there_are_news_or_for_a_while() -> None:
    waiting = Waiting(Request('me', '', 1, 0, 'start'), 10.0, 7)
    for code in Code:
        reason = Reason(code, 'no')
        assert waiting.may_be_outdated(reason, 10.0 + 0.9 * NEWS_S, 7) == (code in PASSING)
        assert not waiting.may_be_outdated(reason, 10.0, 8)
        assert not waiting.may_be_outdated(reason, 10.0 + NEWS_S, 7)


def request(operator: str, number: int) -> Request:
    return Request('me', operator, number, 0, 'start')


def test_a_request_counts_once_however_many_other_operators_make_requests() -> None:
    received = ReceivedRequests()
    assert received.receive(request('A', 7), 0.0)
    for n in range(OPERATORS_MAX - 1):
        assert received.receive(request(f'other {n}', 1), 1.0)
    assert not received.receive(request('A', 7), 2.0)
    with pytest.raises(
        RefusedError, match='10000 operators, the limit, have made requests within 600 s'
    ) as error:
        received.receive(request('one more', 1), 3.0)
    assert error.value.reason.code is Code.STATE
    assert received.receive(request('A', 8), 4.0)  # those who are known are served
    assert not received.receive(request('other 0', 1), 5.0)


@pytest.mark.parametrize(('later_s', 'new'), [(REMEMBERED_S, False), (REMEMBERED_S + 1e-6, True)])
def test_an_operator_is_forgotten_some_time_after_its_newest_request(later_s: float, new: bool) -> None:
    received = ReceivedRequests()
    received.receive(request('A', 7), 0.0)
    received.receive(request('B', 1), 1.0)
    received.receive(request('A', 7), 2.0)  # a repetition counts as well
    assert received.receive(request('A', 7), 2.0 + later_s) is new


def test_forgotten_operators_make_room_for_others() -> None:
    received = ReceivedRequests(operators_max=1)
    assert received.receive(request('A', 1), 0.0)
    with pytest.raises(RefusedError):
        received.receive(request('B', 1), REMEMBERED_S)
    assert received.receive(request('B', 1), 1.5 * REMEMBERED_S)


@pytest.mark.parametrize('first', [-3, 0, 1, 2**52])
def test_numbers_start_anywhere_and_increase(first: int) -> None:
    received = ReceivedRequests()
    assert received.receive(request('A', first), 0.0)
    assert received.receive(request('A', first + 2), 0.0)
    assert not received.receive(request('A', first + 2), 0.0)
    with pytest.raises(
        RefusedError, match=f'request {first + 1} came after request {first + 2} of the same operator'
    ):
        received.receive(request('A', first + 1), 0.0)


def test_the_reply_to_the_newest_request_of_an_operator_is_kept() -> None:
    received = ReceivedRequests()

    def reply(operator: str, number: int) -> Reply:
        return Reply(operator, number, True, True, '', f'{operator} {number}')

    assert received.reply(request('A', 1)) is None
    for operator, number in (('A', 1), ('B', 7), ('A', 2)):
        received.receive(request(operator, number), 0.0)
        assert received.reply(request(operator, number)) is None
        received.note(reply(operator, number))
    received.note(reply('A', 1))  # of a request that has a successor
    received.note(reply('nobody', 1))
    assert received.reply(request('A', 2)) == reply('A', 2)
    assert received.reply(request('A', 1)) is None
    assert received.reply(request('B', 7)) == reply('B', 7)
    assert received.reply(request('nobody', 1)) is None
