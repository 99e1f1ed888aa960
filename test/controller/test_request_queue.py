"""Facts about requests that wait: they are served in their order, taken back by their operator, and not for ever."""

from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.request_queue import NEWS_S, PASSING, WAITING_MAX, RequestQueue
from delta3_pacdrive.errors import Code, Reason

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
