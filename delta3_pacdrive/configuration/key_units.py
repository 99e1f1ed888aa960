"""Units in keys: millimetres for metres, degrees for radians, and their time derivatives."""

import math
import re
from collections.abc import Callable, Iterable
from typing import Any

from delta3_pacdrive.configuration.source_positions import Items

_KEY = re.compile(r'(?P<name>.+)_(?P<unit>mm|deg)(?P<per>(_s[23]?)?)')
_BASE = {'mm': 'm', 'deg': 'rad'}
# dividing rounds to the same float as the literal in metres
_CONVERSIONS: dict[str, Callable[[float], float]] = {'mm': lambda value: value / 1000.0, 'deg': math.radians}


def base_key(key: Any, allowed: Iterable[str]) -> str:
    """Return the key in metres or radians for one in millimetres or degrees; empty if none is allowed."""
    found = _KEY.fullmatch(key) if isinstance(key, str) else None
    if found is None:
        return ''
    base = f'{found["name"]}_{_BASE[found["unit"]]}{found["per"]}'
    return base if base in allowed else ''


def with_units(key: Any, allowed: Iterable[str]) -> list[str]:
    """Return the allowed keys, in all their units, that a key without a unit may mean: ``to`` for ``to_m``."""
    if not isinstance(key, str):
        return []
    names = set(allowed)
    return [
        f'{key}_{unit}'
        for base, units in (('m', ('m', 'mm')), ('rad', ('rad', 'deg')))
        for unit in units
        if f'{key}_{base}' in names
    ]


def base_unit(key: str) -> str:
    """Return the unit into which the values of a key are converted."""
    found = _KEY.fullmatch(key)
    return _BASE[found['unit']] + found['per'].replace('_', '/') if found else ''


def in_base_unit(key: str, value: Any) -> Any:
    """Convert numbers, and lists of numbers, to metres or radians; other values stay unchanged."""
    found = _KEY.fullmatch(key)
    return value if found is None else _converted(value, _CONVERSIONS[found['unit']])


def _converted(value: Any, convert: Callable[[float], float]) -> Any:
    if isinstance(value, bool) or not isinstance(value, (int, float, list)):
        return value
    if not isinstance(value, list):
        try:
            return convert(value)
        except OverflowError:
            return value
    items = [_converted(item, convert) for item in value]
    if isinstance(value, Items):
        kept = Items(value.place)
        kept.extend(items)
        kept.source, kept.places = value.source, value.places
        return kept
    return items
