"""Docstrings and pages avoid habits of prose that slow readers down."""

import pytest

import prose


@pytest.mark.parametrize(
    'texts',
    [
        lambda: prose.docstrings(prose.SOURCE / 'delta3_pacdrive'),
        lambda: prose.docstrings(prose.SOURCE / 'test'),
        lambda: prose.pages(prose.SOURCE),
    ],
    ids=['docstrings', 'tests', 'pages'],
)
def test_each_habit_is_rare(texts):
    found = prose.rates([*texts()])
    assert {name: rate for name, rate in found.items() if rate > prose.HABITS[name][1]} == {}


@pytest.mark.parametrize(
    ('text', 'counts'),
    [
        ('Of the robot. What is driven is told to whoever asks.', [2, 1, 1, 0, 0, 0]),
        ('It stands beside the plate and is no motor. It is no longer there.', [0, 0, 0, 1, 1, 1]),
        ('In the plane of the arm, the angle is positive. Return the torque of the motor.', [0] * 6),
    ],
)
def test_each_habit_is_counted(text, counts):
    words = len(text.replace('.', '').replace(',', '').split())
    assert [round(rate * words / 1e4) for rate in prose.rates([('here', text)]).values()] == counts
