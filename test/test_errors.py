"""Tests of faults and rejections as values."""

import json

import pytest

from delta3_pacdrive import memory
from delta3_pacdrive.control.messages import Reply
from delta3_pacdrive.errors import (
    Code,
    FaultCode,
    ParameterError,
    Reason,
    RobotFault,
    RunError,
    ScriptError,
    shown,
)

SHORT = RobotFault(FaultCode.DRIVE, 'axis2: 8905 over-current', 'axis2', 8905, 417)
SILENT = RobotFault(FaultCode.ANSWER_LOST, 'no AT of axis1, axis2', 'axis1, axis2, plant', 8506, 90)


@pytest.mark.parametrize('fault', [SHORT, SILENT, None])
def test_fault_survives_reports_about_it(fault: RobotFault | None) -> None:
    facts = json.loads(json.dumps(RobotFault.facts(fault)))
    assert RobotFault.of(facts, str(fault)) == fault


def test_fault_names_all_possible_causes() -> None:
    assert SILENT.sources == ('axis1', 'axis2', 'plant')
    assert RobotFault(FaultCode.EMERGENCY_STOP, 'emergency stop').sources == ()


def test_an_unknown_code_of_another_version_is_that_of_a_drive() -> None:
    assert [FaultCode.of(text) for text in ('plague', 'bus_time')] == [FaultCode.DRIVE, FaultCode.BUS_TIME]


def test_a_reply_that_rejects_because_of_a_fault_carries_its_value() -> None:
    reply = Reply('op', 4, True, False, 'fault', str(SHORT), 2, **RobotFault.facts(SHORT))
    assert Reply.from_json(reply.to_json()).reason == Reason(Code.FAULT, str(SHORT), SHORT)
    assert Reply('op', 4, True, True, '', 'planned').reason is None


def test_error_with_several_causes_names_each_of_them() -> None:
    error = ParameterError.of_all(f'cause {n}' for n in range(3))
    assert str(error) == 'cause 0; cause 1; cause 2'
    assert error.complaints == ('cause 0', 'cause 1', 'cause 2')
    assert ParameterError('one; and the same').complaints == ('one; and the same',)


@pytest.mark.parametrize(('length', 'text'), [(58, "'" + 58 * 'x' + "'"), (59, "'" + 56 * 'x' + '...')])
def test_a_value_of_60_characters_is_shown_whole_and_a_longer_one_is_cut(length: int, text: str) -> None:
    assert shown(length * 'x') == text
    assert len(text) == 60


def test_value_without_a_text_form_is_named_by_its_type() -> None:
    assert shown(10**5000) == 'a value of type int, too large to show'


@pytest.mark.parametrize(
    ('sentence', 'place', 'told'),
    [
        ('no part', 'pick.py:12', 'pick.py:12: no part'),
        ('pick.py:14: no part', 'pick.py:12', 'pick.py:14: no part'),
        ('no part', '', 'no part'),
    ],
)
def test_an_error_of_a_script_begins_with_its_place_once(sentence: str, place: str, told: str) -> None:
    error = ScriptError(Reason(Code.STATE, sentence, SHORT), place)
    assert (str(error), error.code, error.reason.fault, error.place) == (told, Code.STATE, SHORT, place)


@pytest.mark.parametrize(
    ('cores', 'in_a_graph', 'needed_mb'),
    [(1, False, 800), (2, False, 800), (3, False, 900), (8, False, 1400), (2, True, 1400), (4, True, 1600)],
)
def test_a_memory_limit_below_what_the_libraries_reserve_is_rejected(
    cores: int, in_a_graph: bool, needed_mb: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linear algebra holds 100 MB for each core beyond two."""
    limit = needed_mb * 10**6
    monkeypatch.setattr(memory.os, 'sched_getaffinity', lambda _: set(range(cores)))
    monkeypatch.setattr(memory.resource, 'getrlimit', lambda _: (limit, limit))
    memory.require(in_a_graph)
    limit -= 1
    with pytest.raises(
        RunError, match=f'limited to {needed_mb - 1} MB, but at least {needed_mb} MB are needed'
    ):
        memory.require(in_a_graph)
    limit = memory.resource.RLIM_INFINITY
    memory.require(in_a_graph)
