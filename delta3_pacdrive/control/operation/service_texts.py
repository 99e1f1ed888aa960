"""Requests to the service channels of the drives as text, their responses, and a client for single values.

A request may begin with a mark chosen by the client, which its response repeats: "#3fa9 axis1 read S-0-0104" is
answered with "#3fa9 accepted: axis1: ...".
"""

import re
from collections.abc import Sequence
from typing import Protocol

from delta3_pacdrive.errors import TelegramError, shown
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, require_axis
from delta3_pacdrive.robot.sercos.service_channel import Access, Operation, parse_idn

_MARK = re.compile(r'\s*(#\S{1,32}(?:\s+|$))(.*)', re.DOTALL)
ACCEPTED, REFUSED = 'accepted', 'refused'
OPERATIONS = {operation.name.lower(): operation for operation in Operation}


def split_mark(text: str) -> tuple[str, str]:
    """Return the mark of a request or a response, such as "#3fa9" or empty, and the remaining text."""
    match = _MARK.match(text)
    return (match[1].rstrip(), match[2]) if match else ('', text)


def answer_text(accepted: bool, sentence: str) -> str:
    """Return a response as it is published."""
    return f'{ACCEPTED if accepted else REFUSED}: {sentence}'


def parse_answer(text: str) -> tuple[bool, str]:
    """Return whether the request was accepted, and the sentence; invalid responses count as rejections."""
    word, _, sentence = text.partition(': ')
    return word == ACCEPTED, sentence


def value_in(sentence: str) -> float:
    """Return the value in the sentence of an accepted access; raises TelegramError if there is none."""
    _, equals, value = sentence.rpartition(' = ')
    return _number(value.split(' ')[0] if equals else '')


def parse_request(text: str, drives: Sequence[str] = DRIVES) -> tuple[int, Access]:
    """Return drive index and access of a request; raises TelegramError or ParameterError."""
    words = text.split()
    for axis in words[:1]:
        require_axis(axis, drives, TelegramError)
    if len(words) < 3 or words[0] not in drives or words[1] not in OPERATIONS:
        raise TelegramError(
            f'{shown(text)} is not a request: expected "axis1 read S-0-0104", "axis1 write S-0-0104 60" or '
            '"axis1 command S-0-0099"'
        )
    operation = OPERATIONS[words[1]]
    if len(words) != (4 if operation == Operation.WRITE else 3):
        raise TelegramError(f'{shown(text)}: only "write" takes a value, and it needs one')
    value = _number(words[3]) if operation == Operation.WRITE else 0.0
    return list(drives).index(words[0]), Access(parse_idn(words[2]), operation, value)


def _number(text: str) -> float:
    try:
        # Python would accept 1_0 as 10
        return float(text if text.isascii() and '_' not in text else '')
    except ValueError:
        raise TelegramError(f'{shown(text)} is not a number') from None


class ServiceChannel(Protocol):
    """A client of the service channel, such as an operator."""

    def drive(self, request: str) -> str:
        """Return the reply to a request; raises ProgramError if it is rejected."""


class DriveValues:
    """Reads and writes values one at a time; raises ProgramError if a drive rejects the access."""

    def __init__(self, operator: ServiceChannel) -> None:
        self._operator = operator

    def read(self, axis: str, idn: str) -> float:
        """Return a value, in its unit."""
        return value_in(self._operator.drive(f'{axis} read {idn}'))

    def write(self, axis: str, idn: str, value: float) -> None:
        """Write a value, in its unit."""
        self._operator.drive(f'{axis} write {idn} {value!r}')
