"""The share of cases that each run of the tests covers: some, or all with ``DELTA3_LONG=1``."""

import os
from collections.abc import Collection, Iterable
from typing import Any

import pytest

EVERYTHING = os.environ.get('DELTA3_LONG', '0') != '0'
PART = 4  # of the random examples of a property one in so many


def examples(number: int) -> int:
    """Return how many of the random examples of a property are looked at."""
    return number if EVERYTHING else -(-number // PART)


def some(cases: Iterable[Any], always: Collection[Any]) -> list[Any]:
    """Return the cases of a parametrized test; all but those of ``always`` are left to ``DELTA3_LONG=1``.

    A case that is a tuple has a value for each parameter of the test.
    """
    found = []
    for case in cases:
        values = case if isinstance(case, tuple) else (case,)
        found.append(pytest.param(*values, marks=() if case in always else pytest.mark.long))
    return found
