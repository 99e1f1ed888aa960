"""Tests of the queue: one growing program and the known part of its plan."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.queue.program_queue import ProgramQueue
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned

MOVES = [{'move_l': {'to_m': [0.1, 0.0, -0.75]}}, {'dwell': {'time_s': 0.5}}]


def read(robot: Parameters, **more: Any) -> Program:
    return program_file.parse({'moves': MOVES, **more}, robot.motion)


@pytest.fixture(scope='module')
def planned(robot: Parameters) -> tuple[Program, Planned]:
    program = read(robot)
    return program, program_planner.plan(program, robot.motion.home_m, robot)


def test_empty_queue_has_no_moves_and_zero_duration() -> None:
    assert ProgramQueue(None).size == (0, 0.0)


def test_moves_that_are_not_planned_count_as_often_as_they_are_repeated(robot: Parameters) -> None:
    assert ProgramQueue(read(robot)).size == (2, 0.0)
    assert ProgramQueue(read(robot, repeat=3)).size == (6, 0.0)


def test_planned_queue_has_a_known_duration(planned: tuple[Program, Planned]) -> None:
    queue = ProgramQueue(None)
    queue.put(*planned)
    moves, duration_s = queue.size
    assert moves == len(planned[1].plan)
    assert duration_s == planned[1].plan.duration_s > 0.5


def test_robot_at_another_position_keeps_the_moves_and_discards_the_plan(
    planned: tuple[Program, Planned],
) -> None:
    queue = ProgramQueue(None)
    queue.put(*planned)
    queue.clear_plan()
    assert (queue.program, queue.planned) == (planned[0], None)


def test_another_program_never_keeps_the_plan_of_the_last_one(
    robot: Parameters, planned: tuple[Program, Planned]
) -> None:
    queue = ProgramQueue(None)
    queue.put(*planned)
    queue.put(read(robot, repeat=2))
    assert (queue.planned, queue.size) == (None, (4, 0.0))


@given(events=st.lists(st.sampled_from(['put', 'put planned', 'forget', 'clear']), max_size=12))
def test_there_is_never_a_plan_without_a_program_nor_a_time_without_a_plan(
    events: list[str], planned: tuple[Program, Planned]
) -> None:
    queue = ProgramQueue(None)
    for event in events:
        match event:
            case 'put':
                queue.put(planned[0])
            case 'put planned':
                queue.put(*planned)
            case 'forget':
                queue.clear_plan()
            case 'clear':
                queue.clear()
        assert queue.program is not None or queue.planned is None
        assert (queue.size[1] > 0.0) == (queue.planned is not None)
        assert (queue.size[0] > 0) == (queue.program is not None)
