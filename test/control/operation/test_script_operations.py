"""Tests of the state that a script reads: its keys are those of release 0.2.0, with a key for each rotary axis."""

import json

import pytest

from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.script_operations import Snapshot

SEEN = {
    'cycle': 7,
    'motion': 'moving',
    'command_m': [0.0, 0.1, -0.75],
    'position_m': [0.0, 0.2, -0.75],
    'outputs': 2,
    'payload_kg': 0.3,
    'inputs': 1,
    'planned_m': [0.0, 0.3, -0.75],
}


@pytest.mark.parametrize('turns', [{}, {'turn_rad': 0.5}, {'turn_rad': 0.0, 'turn_rad_2': -0.1}])
def test_the_state_is_read_and_written_with_a_key_for_each_rotary_axis(turns: dict[str, float]) -> None:
    snapshot = Snapshot.from_document(SEEN | turns)
    assert snapshot.turns_rad == tuple(turns.values())
    assert (snapshot.motion, snapshot.planned_m) == (MotionState.MOVING, (0.0, 0.3, -0.75))
    assert json.loads(json.dumps(snapshot.to_document())) == SEEN | turns


def test_a_robot_without_belts_omits_the_position_of_the_plan() -> None:
    seen = {key: value for key, value in SEEN.items() if key != 'planned_m'}
    assert Snapshot.from_document(seen).planned_m == (0.0, 0.1, -0.75)
