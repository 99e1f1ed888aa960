"""Tests of the options of a bring-up: their evaluation before the first process starts."""

import math

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.bringup.options import Options, check_options
from delta3_pacdrive.errors import ProgramError, RunError

TURNS = 'start_turn_deg: 30\nmoves: [{turn: {to_deg: 90}}]\n'


@pytest.mark.parametrize(
    ('prefix', 'reason'),
    [
        ('/cell/', 'begins with a letter or _'),
        ('a b', 'consists of letters'),
        ('a' * 101, 'the limit is 100'),
    ],
)
def test_prefix_of_frames_that_tf_rejects_is_rejected_before_the_start(prefix, reason):
    with pytest.raises(RunError, match=reason):
        check_options(Options(None, frame_prefix=prefix))


def test_tool_is_at_the_start_of_its_program(robot, tmp_path):
    path, program = tmp_path / 'turning.yaml', tmp_path / 'program.yaml'
    program.write_text(TURNS)
    parameters.write(robot.replace(rotary__present=True), path)
    machine, _, planned = check_options(Options(program, path))
    assert machine.rotary.home_deg == pytest.approx(30.0)
    assert planned.plan.end_turns_rad == pytest.approx((math.pi / 2,))


def test_program_with_rotation_is_rejected_without_a_rotary_axis(tmp_path):
    program = tmp_path / 'program.yaml'
    program.write_text(TURNS)
    with pytest.raises(ProgramError, match=r'the robot has no rotary axis \(rotary.present is false\)'):
        check_options(Options(program))
