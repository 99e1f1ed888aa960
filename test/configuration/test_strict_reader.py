"""Tests of the strict reader: one report of all errors of a file, with their places."""

from pathlib import Path
from typing import Any

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.strict_reader import ERRORS_MAX, counted
from delta3_pacdrive.errors import Delta3Error, ProgramError
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.robot.faults import fault as faults

PROGRAM = """\
points: {above: [0.0, 0.0, -0.7]}
repeat: 0
moves:
- move_l: {to_m: abov, speed_m_s: -1}
- dwel: {time_s: 1}
- output: {name: griper, value: 1}
faults:
- {fault: drop_a, axis: axis1}
- {fault: kill, node: plnt}
"""
PROGRAM_MISTAKES = [
    '2:9: repeat is 0, but must be a whole number between 1 and 10000',
    "4:18: moves[0].move_l.to_m: unknown point 'abov', the points are: 'above': did you mean above?",
    '4:35: moves[0].move_l.speed_m_s is -1.0, but must be a positive number',
    "5:3: moves[1]: unknown key 'dwel', expected one of move_l, move_c, move_sb, arch, cubic, joints, turn, dwell, "
    'output, for_each: did you mean dwell?',
    "6:18: moves[2].output.name is 'griper', but must be one of ",
    '6:33: moves[2].output.value must be true or false, not 1',
    "8:11: faults[0].fault is 'drop_a', but must be one of ",
    "9:23: faults[1].node is 'plnt', but must be one of ",
]
FAULT = '{fault: encoder_jump, axis: axis9, jump_rad: yes, after: 1}'
FAULT_MISTAKES = [
    "line 1, column 29: fault.axis is 'axis9', but must be one of axis1, axis2, axis3, axis4, axis5: did you mean axis",
    'line 1, column 46: fault.jump_rad must be a number, not True',
    "line 1, column 51: fault: unknown key 'after', expected one of after_s, axis, fault, for_s, jump_rad: "
    'did you mean after_s?',
]


def mistakes(read: Any) -> list[str]:
    with pytest.raises(Delta3Error) as caught:
        read()
    return str(caught.value).split('; ')


def agree(told: list[str], expected: list[str], path: str = '') -> None:
    assert len(told) == len(expected), told
    for sentence, beginning in zip(told, expected, strict=True):
        assert sentence.startswith(path + beginning), sentence


def test_program_reports_all_its_errors(tmp_path: Path, robot: Any) -> None:
    path = tmp_path / 'program.yaml'
    path.write_text(PROGRAM)
    told = mistakes(lambda: program_file.load(path, robot.motion))
    agree(told, PROGRAM_MISTAKES, f'{path}:')


def test_fault_request_reports_all_its_errors() -> None:
    document = yaml_file.parse(FAULT, 'the fault', ProgramError)
    agree(mistakes(lambda: faults.parse(document, 'fault')), FAULT_MISTAKES)


def test_parameter_file_reports_all_its_errors(tmp_path: Path, robot: Any) -> None:
    path = parameters.write(robot, tmp_path / 'robot.yaml')
    lines = path.read_text().splitlines()
    expected = []
    for name, value, rule in (
        ('peak_current_a:', '-1.0', 'motor.peak_current_a is -1, but must be positive'),
        ('gear_in:', 'many', "dynamics.gear_in must be a number, not 'many'"),
        ('cycle_time_s:', '', 'bus.cycle_time_s must be a number, not None'),
    ):
        number, *_ = [n for n, line in enumerate(lines) if line.strip().startswith(name)]
        lines[number] = f'{lines[number].partition(":")[0]}: {value}'
        column = lines[number].index(':') + 2 + bool(value)
        expected.append((number, f'{number + 1}:{column}: {rule}'))
    path.write_text('\n'.join(lines))
    agree(mistakes(lambda: parameters.load(path)), [text for _, text in sorted(expected)], f'{path}:')


def test_every_broken_rule_between_parameters_is_reported_with_its_place(tmp_path: Path, robot: Any) -> None:
    path = parameters.write(robot, tmp_path / 'robot.yaml')
    text = path.read_text()
    for name, value in (('plate_radius_m', 1.5), ('workspace_bottom_m', -0.1), ('cycle_time_s', 0.003)):
        start = text.index(f' {name}:') + len(name) + 3
        text = text[:start] + str(value) + text[text.index('\n', start) :]
    path.write_text(text)
    told = mistakes(lambda: parameters.load(path))
    for name in ('kinematics.plate_radius_m', 'kinematics.workspace_bottom_m', 'bus.cycle_time_s'):
        (sentence,) = [one for one in told if f': {name} is ' in one]
        line = int(sentence.removeprefix(f'{path}:').partition(':')[0])
        assert name.rpartition('.')[2] in text.splitlines()[line - 1]


def test_search_ends_after_ten_errors(robot: Any) -> None:
    document = {'moves': [{'move_l': {}} for _ in range(20)]}
    told = mistakes(lambda: program_file.parse(document, robot.motion))
    assert len(told) == ERRORS_MAX + 1
    assert told[-1] == f'the search ended after {ERRORS_MAX} errors'


def test_a_key_without_a_unit_is_answered_with_the_keys_that_have_one_and_not_as_missing(robot):
    with pytest.raises(ProgramError) as refused:
        program_file.parse({'moves': [{'move_l': {'to': [0, 0, -0.8]}}]}, robot.motion)
    assert str(refused.value).endswith(': did you mean to_m or to_mm?')
    assert 'missing key' not in str(refused.value)


def test_one_move_is_counted_in_the_singular():
    assert [counted(number, 'move') for number in (0, 1, 2)] == ['0 moves', '1 move', '2 moves']
