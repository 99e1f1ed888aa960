"""Tests of the latest status of the transformation task: accepted and ignored messages."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.messages import Status
from delta3_pacdrive.control.queue.task_status import FOREIGN_S, MASTER_SILENT_S, TaskStatus
from delta3_pacdrive.errors import Code

FIRST = Status(
    'aaaa', '', 1, '', 'idle', 'CP4', '', '', 1, (0.0, 0.0, -0.8), 0, '', '', 0, 0, 0, 100
)  # fmt: skip


@pytest.mark.parametrize(
    ('change', 'after_s', 'believed'),
    [
        ({'serial': 2}, 0.0, True),
        ({'serial': 1}, 0.0, False),  # heard a second time
        ({'serial': 0}, 0.0, False),  # overtaken
        ({'serial': 2, 'state': 'dancing'}, 0.0, False),
        ({'session': 'bbbb', 'previous': 'aaaa'}, 0.0, True),  # the same master, phased up anew
        ({'session': 'cccc', 'previous': 'eeee'}, 0.5 * MASTER_SILENT_S, False),  # another one beside it
        ({'session': 'cccc', 'previous': 'eeee'}, 2.0 * MASTER_SILENT_S, True),  # another one after it
    ],
)
def test_a_word_is_believed_that_is_new_and_of_the_same_master(change, after_s, believed):
    task = TaskStatus()
    assert task.take(FIRST, 10.0)
    status = replace(FIRST, **change)
    assert task.take(status, 10.0 + after_s) is believed
    assert task.newest is (status if believed else FIRST)
    assert task.received == 1 + believed


@pytest.mark.parametrize(
    ('change', 'foreign'),
    [
        ({'serial': 2}, False),
        ({'session': 'bbbb', 'previous': 'aaaa'}, False),
        ({'serial': 1}, True),  # a bag of this very session
        ({'session': 'cccc', 'previous': 'eeee'}, True),  # one of another
    ],
)
def test_message_of_another_session_reports_a_playback_for_a_while(change, foreign):
    task = TaskStatus()
    assert task.played_back(10.0) is None
    task.take(FIRST, 10.0)
    assert task.played_back(10.0) is None
    task.take(replace(FIRST, **change), 10.1)
    reason = task.played_back(10.1 + 0.9 * FOREIGN_S)
    assert (reason is not None) is foreign
    if foreign:
        assert reason.code == Code.FOREIGN
        assert reason.sentence.startswith('a recording is played back here')
    assert task.played_back(10.1 + 1.1 * FOREIGN_S) is None


@given(serials=st.lists(st.integers(0, 30), max_size=30))
def test_in_any_order_the_newest_word_is_that_with_the_largest_number(serials):
    task = TaskStatus()
    for serial in serials:
        task.take(replace(FIRST, serial=serial), 0.0)
    newest = task.newest.serial if task.newest else None
    assert newest == max(serials, default=None)
