"""Readers and limits of values used in several sections of a cell file."""

from collections.abc import Callable
from typing import Any

from delta3_pacdrive.belts.model import Place
from delta3_pacdrive.configuration.source_positions import numbered
from delta3_pacdrive.configuration.strict_reader import refuse
from delta3_pacdrive.configuration.value_readers import number_between
from delta3_pacdrive.errors import shown

REACH_M = 10.0
TIME_MAX_S = 1e5
DELAY_MAX_S = 10.0
NAMES_MAX = 1000  # per section
PLACES_MAX = 1000  # of a box, along x or y
CHANGES_MAX = 10_000
PARTS_MAX = 100_000
BELT_MAX_M_S = 10.0
VACUUM_MAX_PA = 101_325.0  # atmospheric pressure


time_s, delay_s = number_between(0.0, TIME_MAX_S), number_between(0.0, DELAY_MAX_S)
length_m = number_between(1e-4, REACH_M)
distance_m = number_between(0.0, REACH_M)


def numbers(count: int, low: float, high: float) -> Callable[[Any, str], tuple[float, ...]]:
    """Return a reader of a list of ``count`` numbers from ``low`` to ``high``."""
    one = number_between(low, high)

    def read(value: Any, where: str) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != count:
            refuse(f'{where} must be a list of {count} numbers, not {shown(value)}')
        return tuple(one(item, item_where) for item, item_where, _ in numbered(value, where))

    return read


place_m: Callable[[Any, str], Place] = numbers(3, -REACH_M, REACH_M)  # type: ignore[assignment]
size_m: Callable[[Any, str], Place] = numbers(3, 1e-4, REACH_M)  # type: ignore[assignment]
pitch_m: Callable[[Any, str], tuple[float, float]] = numbers(2, -REACH_M, REACH_M)  # type: ignore[assignment]


def no_parts(value: Any, where: str) -> str:
    """Reject a part type in a cell without parts."""
    refuse(f'{where} is {shown(value)}, but the cell has no parts')


def listed(value: Any, where: str) -> Any:
    """Return the items of a list, each with its name and position."""
    if not isinstance(value, list):
        refuse(f'{where} must be a list, not {shown(value)}')
    if len(value) > CHANGES_MAX:
        refuse(f'{where} holds {len(value)} entries, but must hold at most {CHANGES_MAX}')
    return numbered(value, where)
