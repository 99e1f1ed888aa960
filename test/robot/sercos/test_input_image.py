"""Tests of the inputs that the master keeps by bus cycle."""

from delta3_pacdrive.robot.sercos.buffers import InputImage
from delta3_pacdrive.robot.sercos.bus_time import NEVER


def test_without_inputs_no_cycle_waits_for_any() -> None:
    image = InputImage()
    image.begin(7, ())
    assert image.is_complete(NEVER - 1)
    assert image.take(7) == 0


def test_cycle_is_complete_with_its_inputs_and_reports_them() -> None:
    image = InputImage()
    image.begin(7, ('part', 'vacuum'))
    assert not image.is_complete(7)
    image.put(7, 0b10)
    assert image.is_complete(7)
    assert not image.is_complete(8)
    assert image.take(7) == image.bits == 0b10


def test_inputs_that_are_lost_are_those_of_the_cycle_before() -> None:
    image = InputImage()
    image.begin(0, ('part',))
    image.put(0, 1)
    image.put(2, 0)
    assert [image.take(cycle) for cycle in (0, 1, 2)] == [1, 1, 0]
    image.put(5, 1)
    assert image.lost == 3


def test_repeated_and_past_inputs_change_nothing() -> None:
    image = InputImage()
    image.begin(5, ('part',))
    image.put(4, 1)
    assert not image.is_complete(5)
    image.put(5, 1)
    image.put(5, 0)
    assert image.take(5) == 1
    assert image.lost == 0


def test_new_operation_keeps_values_of_the_same_inputs_only() -> None:
    image = InputImage()
    image.begin(0, ('part',))
    image.put(0, 1)
    image.take(0)
    image.put(1, 0)
    image.begin(9, ('part',))
    assert image.bits == 1
    assert not image.is_complete(9)
    image.begin(20, ('other',))
    assert image.bits == 0
