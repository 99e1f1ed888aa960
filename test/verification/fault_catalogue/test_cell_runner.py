"""Tests of failures in cells: each case of the catalogue has its specified effect, and a strict verdict."""

from dataclasses import replace

import pytest

from delta3_pacdrive.cli import faults
from delta3_pacdrive.verification.fault_catalogue.cell_cases import CASES
from delta3_pacdrive.verification.fault_catalogue.cell_runner import cases, robot_of, run_case


@pytest.fixture(scope='module')
def robot():
    return robot_of(None)


@pytest.mark.parametrize('case', CASES, ids=lambda case: case.text)
def test_each_case_gives_its_message_and_parts_and_the_script_continues(robot, case):
    row = run_case(case, robot).to_row()
    assert row['ok'], faults.line_of(row)
    assert row['recovered_s'] is not None
    assert row['deviation_m'] < 0.5e-3


def test_case_with_another_reply_is_not_as_expected(robot):
    (sticks,) = cases('input sticks')
    for other in (
        replace(sticks, code='belt'),
        replace(sticks, sentence='moon'),
        replace(sticks, outcomes={'lost': 1}),
    ):
        row = run_case(other, robot).to_row()
        assert not row['ok']
        assert 'NOT AS EXPECTED' in faults.line_of(row)


def test_a_script_that_dies_is_a_problem(robot):
    (sticks,) = cases('input sticks')
    found = run_case(replace(sticks, script=lambda robot, notice: robot.wait_input('moon')), robot)
    assert "unknown input 'moon'" in found.to_row()['problem']
    assert not found.as_expected


def test_cases_of_cells_are_chosen_by_their_text_and_need_no_robot(capsys):
    assert faults.main(['--only', 'input sticks', '--json']) == 0
    assert '"state": "in a cell"' in capsys.readouterr().out
