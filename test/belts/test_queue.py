"""Tests of the part queue: uniqueness, order of assignment and counters of missed parts."""

import math

import pytest

from delta3_pacdrive.belts.queue import PartQueue, QueuedPart, Rule
from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.errors import ProgramError

WINDOW = TrackWindow(0.4, 1.0)


def part(along, across=0.0, kind='bar', angle=0.0):
    return QueuedPart(kind, along, across, angle)


def filled(*places, rule=Rule.FIRST_IN):
    queue = PartQueue(0.005, rule)
    assert all(queue.add(part(place)) for place in places)
    return queue


def hand_out(queue, *where):
    chosen = queue.next(*where)
    if chosen is not None:
        queue.take(chosen)
    return chosen


def test_part_reported_twice_counts_once_at_the_mean_position():
    queue = filled(0.1)
    assert not queue.add(part(0.103, 0.003, angle=0.3))
    assert not queue.add(part(0.1, 0.0, angle=0.0))
    assert (len(queue), queue.merged) == (1, 2)
    one = hand_out(queue, 0.0, WINDOW)
    assert (one.along_m, one.across_m, one.angle_rad) == pytest.approx((0.101, 0.001, 0.1))
    assert one.seen == 3


def test_angles_are_averaged_over_the_short_arc():
    queue = PartQueue(0.005)
    queue.add(part(0.0, angle=math.radians(179.0)))
    queue.add(part(0.0, angle=math.radians(-179.0)))
    assert hand_out(queue, 0.0, WINDOW).angle_rad == pytest.approx(math.pi)


def test_distant_parts_or_parts_of_another_type_are_separate():
    queue = filled(0.1, 0.106)
    assert queue.add(part(0.1, kind='box'))
    assert queue.add(part(0.1, 0.006))
    assert len(queue) == 4


def test_a_part_that_was_handed_out_is_not_handed_out_again():
    queue = filled(0.1)
    assert hand_out(queue, 0.0, WINDOW) is not None
    assert not queue.add(part(0.101))
    assert hand_out(queue, 0.0, WINDOW) is None


def test_first_in_is_the_most_advanced_part_and_nearest_the_one_next_to_the_robot():
    first = filled(0.1, 0.3, 0.2)
    assert [hand_out(first, 0.5, WINDOW).along_m for _ in range(3)] == [0.3, 0.2, 0.1]
    nearest = filled(0.1, 0.3, 0.2, rule=Rule.NEAREST)
    assert [hand_out(nearest, 0.5, WINDOW, 0.71).along_m for _ in range(3)] == [0.2, 0.3, 0.1]


def test_part_that_has_left_the_window_is_dropped_and_counted():
    queue = filled(0.1, 0.3, 0.2)
    assert hand_out(queue, 0.75, WINDOW).along_m == 0.2
    assert (len(queue), queue.left) == (1, 1)
    assert hand_out(queue, 2.0, WINDOW) is None
    assert queue.left == 2


def test_a_queue_is_bounded_and_counts_what_it_rejects():
    queue = PartQueue(0.005, size=3)
    assert [queue.add(part(0.1 * n)) for n in range(5)] == [True] * 3 + [False] * 2
    assert (len(queue), queue.refused) == (3, 2)


def test_invalid_distance_is_rejected():
    with pytest.raises(ProgramError, match='merge_m of a queue is nan, but must be a distance'):
        PartQueue(math.nan)
