"""Facts about what a bring-up makes of its options before its first process starts."""

import math

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.bringup.options import Options, check_options
from delta3_pacdrive.errors import ProgramError

TURNS = 'start_turn_deg: 30\nmoves: [{turn: {to_deg: 90}}]\n'


def test_a_tool_stands_where_its_program_starts(robot, tmp_path):
    path, program = tmp_path / 'turning.yaml', tmp_path / 'program.yaml'
    program.write_text(TURNS)
    parameters.write(robot.replace(rotary__present=True), path)
    machine, _, planned = check_options(Options(program, path))
    assert machine.rotary.home_deg == pytest.approx(30.0)
    assert planned.plan.end_turn_rad == pytest.approx(math.pi / 2)


def test_a_program_that_turns_is_refused_by_name_where_there_is_no_rotary_axis(tmp_path):
    program = tmp_path / 'program.yaml'
    program.write_text(TURNS)
    with pytest.raises(ProgramError, match=r'the robot has no rotary axis \(rotary.present is false\)'):
        check_options(Options(program))
