"""Tests of the announcements of participants: accepted and rejected messages."""

import json

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.configuration_check import Identity
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.ros.wire.announcements import read_announcement


def announcement(inputs: str) -> DiagnosticStatus:
    facts = vars(Identity.of(parameters.load())) | {
        'links': '',
        'session': '',
        'bus_cycle': '0',
        'inputs': inputs,
    }
    message = DiagnosticStatus(name='plant', message=str(Occasion.STARTED))
    message.values = [KeyValue(key=key, value=str(value)) for key, value in facts.items()]
    return message


def test_the_names_of_inputs_are_read() -> None:
    assert read_announcement(announcement('["part", "düse 2"]')).inputs == ('part', 'düse 2')


@pytest.mark.parametrize(
    'names', [['\ud800'], [''], ['part', 'part'], ['a\nb'], ['x' * 101], [str(n) for n in range(17)], [1], {}]
)
def test_unusable_and_ambiguous_input_names_are_rejected(names: object) -> None:
    with pytest.raises(TelegramError, match="'plant' announces invalid inputs"):
        read_announcement(announcement(json.dumps(names)))
