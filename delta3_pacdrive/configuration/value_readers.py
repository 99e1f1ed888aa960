"""Readers of single values, for ``Section.read``: each takes a value and its name and rejects invalid values."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from delta3_pacdrive.configuration.source_positions import numbered
from delta3_pacdrive.configuration.strict_reader import Refusal, nearest_of, refuse
from delta3_pacdrive.errors import shown


def number(value: Any, where: str) -> float:
    """Read a number; infinity is allowed."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        refuse(f'{where} must be a number, not {shown(value)}')
    try:
        read = float(value)
    except OverflowError:
        refuse(f'{where} is too large a number')
    if math.isnan(read):
        refuse(f'{where} must be a number, not nan')
    return read


def number_between(low: float, high: float) -> Callable[[Any, str], float]:
    """Return a reader of numbers from ``low`` to ``high``."""
    rule = range_text(low, high)

    def read(value: Any, where: str) -> float:
        found = number(value, where)
        if not low <= found <= high:
            text = f'{found:g}'
            refuse(f'{where} is {found if low <= float(text) <= high else text}, but must be {rule}')
        return found

    return read


def whole_number_between(low: int, high: int) -> Callable[[Any, str], int]:
    """Return a reader of integers from ``low`` to ``high``."""

    def read(value: Any, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            refuse(f'{where} is {shown(value)}, but must be a whole number {range_text(low, high)}')
        return value

    return read


def numbers_between(
    count: int, low: float, high: float, whole: bool = False
) -> Callable[[Any, str], tuple[Any, ...]]:
    """Return a reader of a list of ``count`` numbers from ``low`` to ``high``."""
    one: Callable[[Any, str], float] = (
        whole_number_between(int(low), int(high)) if whole else number_between(low, high)
    )

    def read(value: Any, where: str) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)) or len(value) != count:
            refuse(f'{where} must be a list of {count} numbers, not {shown(value)}')
        return tuple(one(item, f'{where}[{n}]') for n, item in enumerate(value))

    return read


def finite_numbers(unit: str, count: int = 3) -> Callable[[Any, str], Any]:
    """Return a reader of a list of ``count`` finite numbers in a unit; an error has the place of its number."""

    def read(value: Any, where: str) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            refuse(f'{where} must be a list of {count} numbers [{unit}], not {shown(value)}')
        found = []
        for item, name, place in numbered(value, where):
            try:
                found.append(number(item, name))
            except Refusal as refusal:
                refusal.place = place
                raise
        if not all(math.isfinite(item) for item in found):
            refuse(f'{where} must be finite, not {shown(value)}')
        return tuple(found)

    return read


def range_text(low: float, high: float) -> str:
    """Return a closed range in words."""
    if 0.0 < low < 1e-300:
        return 'positive' if high == math.inf else f'positive and at most {high:g}'
    least, most = (str(limit) if isinstance(limit, int) else f'{limit:g}' for limit in (low, high))
    return f'at least {least}' if high == math.inf else f'between {least} and {most}'


def one_of(names: Sequence[str]) -> Callable[[Any, str], str]:
    """Return a reader of one of ``names``; the error suggests the closest."""

    def read(value: Any, where: str) -> str:
        if value not in names:
            nearest = nearest_of(value, names)
            refuse(f'{where} is {shown(value)}, but must be one of {", ".join(names)}{nearest}')
        return str(value)

    return read


def flag(value: Any, where: str) -> bool:
    """Read true or false."""
    if not isinstance(value, bool):
        refuse(f'{where} must be true or false, not {shown(value)}')
    return value


def line_of_text(characters_max: int) -> Callable[[Any, str], str]:
    """Return a reader of one line of at most ``characters_max`` characters."""

    def read(value: Any, where: str) -> str:
        if not isinstance(value, str):
            refuse(f'{where} must be a text, not {shown(value)}')
        if len(value) > characters_max or not value.isprintable():
            refuse(f'{where} must be one line of at most {characters_max} characters, not {shown(value)}')
        return value

    return read
