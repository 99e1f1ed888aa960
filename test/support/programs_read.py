"""Programs as documents and files, and their rejections."""

import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program import file_reader as programs

SENTENCE_MAX = 500  # of one error


def parse(document, robot):
    return programs.parse(document, robot.motion)


def refusal(function, *arguments, **options):
    """Return the message of a rejected program."""
    with pytest.raises(ProgramError) as caught:
        function(*arguments, **options)
    return checked(caught.value)


def checked(error):
    sentence = str(error)
    assert '\n' not in sentence
    assert all(0 < len(one) < SENTENCE_MAX for one in sentence.split('; '))
    return sentence
