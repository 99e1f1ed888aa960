"""Tests of faults: kinds, notation and targets."""

import json
import math

import pytest
import yaml

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.faults import fault as fault_table
from delta3_pacdrive.robot.faults.fault import KINDS, NAMES, Fault, Target, applies_to, parse
from delta3_pacdrive.robot.faults.schedule import Scheduled
from injected_faults import LINE, example

OF_PLANT = fault_table.SUPPLY_FAULTS | fault_table.THERMAL_FAULTS


@pytest.mark.parametrize('kind', NAMES)
def test_every_kind_is_read_and_written_the_same_way(kind):
    document = example(kind)
    fault = parse(document, 'fault')
    assert fault.to_document() == document
    assert Fault.from_row(fault.to_row()) == fault
    scheduled = Scheduled.of(fault, 100, 1e-3)
    assert Scheduled.from_document(json.loads(json.dumps(scheduled.to_document()))) == scheduled
    assert scheduled.first == 350
    assert KINDS[kind].text


@pytest.mark.parametrize('kind', NAMES)
def test_every_kind_applies_to_a_participant(kind):
    fault = parse(example(kind), 'fault')
    assert any(applies_to(fault, node) for node in fault_table.NODES)
    if KINDS[kind].target == Target.AXIS:
        assert not applies_to(fault, 'axis1')
    own = [node for node in fault_table.NODES if applies_to(fault, node)]
    if kind in ('brake_worn', 'brake_stuck', 'overload', 'payload_lost') or kind in OF_PLANT:
        assert own == ['plant']  # brakes, loads, heat and gripped parts belong to the machine
    elif kind in fault_table.AT_FAULTS or kind == 'emergency_stop':
        assert own == ['transformation_task']
    elif kind == 'clear':
        assert own == list(fault_table.NODES)
    else:
        assert own == [fault.target]


@pytest.mark.parametrize(
    ('document', 'sentence'),
    [
        (None, 'fault must be a mapping, not None'),
        ({}, 'fault.fault is None, but must be one of drop_mdt'),
        ({'fault': 'rain'}, "fault.fault is 'rain'"),
        ({'fault': 'drop_at'}, 'fault: missing key axis'),
        ({'fault': 'drop_at', 'axis': 'axis6'}, "fault.axis is 'axis6', but must be one of axis1"),
        ({'fault': 'drop_at', 'axis': 'axis1', 'cycles': 0}, 'fault.cycles is 0'),
        ({'fault': 'drop_at', 'axis': 'axis1', 'for_s': 1.0}, "unknown key 'for_s'"),
        ({'fault': 'encoder_jump', 'axis': 'axis1'}, 'missing key jump_rad'),
        (
            {'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': math.nan},
            'jump_rad must be a number, not nan',
        ),
        ({'fault': 'encoder_jump', 'axis': 'axis1', 'jump_rad': True}, 'jump_rad must be a number, not True'),
        ({'fault': 'dc_link', 'axis': 'axis1', 'voltage_v': 1e4}, 'between 0 and 1000'),
        ({'fault': 'kill', 'node': 'axis1', 'after_s': -1.0}, 'after_s is -1'),
        ({'fault': 'kill', 'node': 'recorder'}, "fault.node is 'recorder'"),
        ({'fault': 'payload_lost', 'for_s': 1.0}, "unknown key 'for_s'"),
    ],
)
def test_a_fault_that_breaks_a_rule_is_rejected_by_name(document, sentence):
    with pytest.raises(ProgramError) as caught:
        parse(document, 'fault')
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    'row', [[], [1.0] * 5, [99.0, 2, 0, 0, -1, 1], [0.5, 2, 0, 0, -1, 1], [0, 2, math.inf, 0, -1, 1]]
)
def test_row_of_numbers_that_is_not_a_fault_is_rejected(row):
    with pytest.raises(ProgramError):
        Fault.from_row(row)


def test_a_program_file_holds_faults(robot):
    text = yaml.safe_dump(LINE | {'faults': [example(kind) for kind in NAMES]})
    read = programs.parse(yaml.safe_load(text), robot.motion)
    assert [fault.kind for fault in read.faults] == list(NAMES)
    with pytest.raises(ProgramError, match=r'faults\[1\]\.fault is'):
        programs.parse(LINE | {'faults': [example('drop_at'), {'fault': 'x'}]}, robot.motion)
