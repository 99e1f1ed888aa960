"""Facts about faults and refusals as values."""

import json

import pytest

from delta3_pacdrive.controller.messages import Reply
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault

SHORT = RobotFault(FaultCode.DRIVE, 'axis2: 8905 over-current', 'axis2', 8905, 417)
SILENT = RobotFault(FaultCode.ANSWER_LOST, 'no AT of axis1, axis2', 'axis1, axis2, plant', 8506, 90)


@pytest.mark.parametrize('fault', [SHORT, SILENT, None])
def test_a_fault_survives_what_reports_tell_of_it(fault: RobotFault | None) -> None:
    facts = json.loads(json.dumps(RobotFault.facts(fault)))
    assert RobotFault.of(facts, str(fault)) == fault


def test_a_fault_names_all_who_may_be_its_cause() -> None:
    assert SILENT.sources == ('axis1', 'axis2', 'plant')
    assert RobotFault(FaultCode.EMERGENCY_STOP, 'emergency stop').sources == ()


def test_an_unknown_code_of_another_version_is_that_of_a_drive() -> None:
    assert [FaultCode.of(text) for text in ('plague', 'bus_time')] == [FaultCode.DRIVE, FaultCode.BUS_TIME]


def test_a_reply_that_refuses_because_of_a_fault_carries_its_value() -> None:
    reply = Reply('op', 4, True, False, 'fault', str(SHORT), 2, **RobotFault.facts(SHORT))
    assert Reply.from_json(reply.to_json()).reason == Reason(Code.FAULT, str(SHORT), SHORT)
    assert Reply('op', 4, True, True, '', 'planned').reason is None
