"""Tests of the wait conditions of scripts: each is met in the same bus cycle on every bus."""

import pytest

from delta3_pacdrive.control.operation.wait_condition import Commanded, WaitCondition
from delta3_pacdrive.robot.sercos.bus_time import NEVER

END = Commanded(1000, held=False, outputs=0, payload_kg=0.0)
HELD = Commanded(1000, held=True, outputs=0, payload_kg=0.0)

# condition, cycle, command, whether a program is under way, cycles within the window, inputs: met?
FACTS = [
    (WaitCondition(5, 9), 4, END, True, 0, 0, False),
    (WaitCondition(5, 9), 5, END, True, 0, 0, True),
    (WaitCondition(0, 9, inputs_on=0b10), 3, END, True, 0, 0b01, False),
    (WaitCondition(0, 9, inputs_on=0b10), 3, END, True, 0, 0b11, True),
    (WaitCondition(0, 9, inputs_off=0b10), 3, END, True, 0, 0b11, False),
    (WaitCondition(0, 9, inputs_off=0b10), 3, END, True, 0, 0b01, True),
    (WaitCondition(0, NEVER, left_cycles=50), 949, END, True, 0, 0, False),
    (WaitCondition(0, NEVER, left_cycles=50), 950, END, True, 0, 0, True),
    (WaitCondition(0, NEVER, left_cycles=50), 999, HELD, True, 0, 0, False),
    (WaitCondition(0, NEVER, left_cycles=50), 10, END, False, 0, 0, True),
    (WaitCondition(0, NEVER, left_cycles=0, in_position_cycles=10), 1008, END, True, 100, 0, False),
    (WaitCondition(0, NEVER, left_cycles=0, in_position_cycles=10), 1009, END, True, 100, 0, True),
    (WaitCondition(0, NEVER, left_cycles=0, in_position_cycles=10), 1200, END, True, 9, 0, False),
    (WaitCondition(0, NEVER, left_cycles=0), 10, END, False, 0, 0, True),
    (WaitCondition(0, NEVER, over=True), 2000, END, True, 999, 0, False),
    (WaitCondition(0, NEVER, over=True), 10, END, False, 0, 0, True),
]


@pytest.mark.parametrize('fact', FACTS, ids=range(len(FACTS)))
def test_a_condition_is_met_by(fact):
    condition, *answers, met = fact
    assert condition.met(*answers) is met


@pytest.mark.parametrize('fact', FACTS, ids=range(len(FACTS)))
def test_condition_is_met_in_its_earliest_cycle_at_the_soonest(fact):
    condition, _, commanded, loaded, _, inputs, _ = fact
    earliest = condition.earliest(commanded, loaded)
    assert not any(
        condition.met(cycle, commanded, loaded, 100, inputs) for cycle in range(min(earliest, 3000))
    )
