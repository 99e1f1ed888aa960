"""Facts about requests that wait: they are served in their order, taken back by their operator, and not for ever."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.messages import Reply, Request
from delta3_pacdrive.control.queue.request_queue import (
    NEWS_S,
    OPERATORS_MAX,
    PASSING,
    REMEMBERED_S,
    WAITING_MAX,
    ReceivedRequests,
    RequestQueue,
)
from delta3_pacdrive.errors import Code, Reason, RefusedError

STEPS = st.lists(
    st.one_of(
        st.tuples(st.just('add'), st.sampled_from('AB'), st.integers(1, 5)),
        st.tuples(st.just('withdraw'), st.sampled_from('AB'), st.integers(1, 5)),
        st.tuples(st.just('pop'), st.just(''), st.just(0)),
    ),
    max_size=40,
)


@given(steps=STEPS)
def test_after_any_steps_the_requests_that_wait_are_those_that_were_not_served_nor_taken_back(
    steps: list[tuple[str, str, int]],
) -> None:
    queue, expected = RequestQueue(), []
    for step, operator, number in steps:
        request = Request('me', operator, number, 0, 'start')
        if step == 'add':
            assert queue.add(request, 0.0, 0) is None
            expected.append(request)
        elif step == 'withdraw':
            given_up = queue.withdraw(operator, str(number))
            assert given_up == [one for one in expected if one == request]
            expected = [one for one in expected if one != request]
        elif expected:
            queue.pop()
            expected.pop(0)
        assert (queue.first.request if queue.first else None) == (expected[0] if expected else None)


def test_only_so_many_requests_wait() -> None:
    queue = RequestQueue()
    for number in range(WAITING_MAX):
        assert queue.add(Request('me', '', number, 0, 'start'), 0.0, 0) is None
    reason = queue.add(Request('me', '', WAITING_MAX, 0, 'start'), 0.0, 0)
    assert reason is not None
    assert reason.code == Code.STATE


def test_a_refusal_for_a_state_may_be_outdated_until_there_are_news_or_for_a_while() -> None:
    queue = RequestQueue()
    queue.add(Request('me', '', 1, 0, 'start'), 10.0, 7)
    waiting = queue.first
    assert waiting is not None
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
