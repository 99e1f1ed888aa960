"""Facts about the newest word of the transformation task: which words a planner believes."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.controller.messages import Status
from delta3_pacdrive.controller.task_status import MASTER_SILENT_S, TaskStatus

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


@given(serials=st.lists(st.integers(0, 30), max_size=30))
def test_in_any_order_the_newest_word_is_that_with_the_largest_number(serials):
    task = TaskStatus()
    for serial in serials:
        task.take(replace(FIRST, serial=serial), 0.0)
    newest = task.newest.serial if task.newest else None
    assert newest == max(serials, default=None)
