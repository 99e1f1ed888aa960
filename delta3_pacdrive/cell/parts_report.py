"""Reports on the parts of a cell, from a simulation or from the messages of a robot."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from delta3_pacdrive.cell.parts import STAYS_MAX, How, Miss, Outcome, PartRecord, Stay
from delta3_pacdrive.errors import TelegramError, shown
from delta3_pacdrive.numerics.types import Floats

ABOUT = ('cell', 'inputs', 'belts')
PLACE, NUMBER_MAX = 3, 2**53  # coordinates of a position, and limit of numbers in messages
KEPT_MAX = 10_000  # parts, and misses, that a log keeps individually
# fields missing in older recordings
OF_OLDER: dict[str, Any] = {'size_m': (0.0, 0.0, 0.0), 'stays': []}
NOT_OVER = (Outcome.WAITING, Outcome.IN_HAND)


@dataclass
class Totals:
    """Accumulated statistics of parts and misses.

    Attributes
    ----------
    placed, error_max_m, error_square_m2
        Number of parts in places of boxes, the largest distance from a place, and the sum of squared distances.

    """

    outcomes: dict[str, int] = field(default_factory=lambda: {str(outcome): 0 for outcome in Outcome})
    picked: int = 0
    missed: int = 0
    placed: int = 0
    error_max_m: float = 0.0
    error_square_m2: float = 0.0
    hold_uses: tuple[float, ...] = ()  # largest used share of the holding force; empty if no part was gripped

    def with_more(
        self, about: Mapping[str, Any], parts: Sequence[dict[str, Any]], misses: Sequence[dict[str, Any]]
    ) -> 'Totals':
        """Return the statistics with further documents of ``PartRecord`` and ``Miss``."""
        placed = [one for one in parts if one['outcome'] == Outcome.PLACED]
        errors: Floats = np.array(
            [
                one['place_error_m'][:2]
                for one in placed
                if one['where'] and one['where'] not in about['belts']
            ]
        ).reshape(-1, 2)
        far = np.hypot(errors[:, 0], errors[:, 1])
        taken = [one for one in parts if one['picked_cycle'] >= 0]
        uses = [*self.hold_uses, *(one['hold_use'] for one in taken)]
        outcomes = dict(self.outcomes)
        for one in parts:
            outcomes[one['outcome']] += 1
        return Totals(
            outcomes=outcomes,
            picked=self.picked + len(taken),
            missed=self.missed + len(misses),
            placed=self.placed + len(far),
            error_max_m=float(far.max(initial=self.error_max_m)),
            error_square_m2=self.error_square_m2 + float(np.sum(far**2)),
            hold_uses=(max(uses),) if uses else (),
        )


def report_of(
    about: Mapping[str, Any],
    parts: Sequence[dict[str, Any]],
    misses: Sequence[dict[str, Any]],
    before: Totals | None = None,
) -> dict[str, Any]:
    """Return the report of a cell.

    Parameters
    ----------
    about
        Names of the cell, its inputs and its belts.
    parts, misses
        Documents of ``PartRecord`` and ``Miss``.
    before
        Statistics of parts and misses that are no longer listed.

    """
    totals = (before or Totals()).with_more(about, parts, misses)
    errors = totals.placed
    return {
        **{name: about[name] for name in ABOUT},
        'outcomes': totals.outcomes,
        'picked': totals.picked,
        'missed': totals.missed,
        'place_error_max_m': totals.error_max_m if errors else None,
        'place_error_rms_m': math.sqrt(totals.error_square_m2 / errors) if errors else None,
        'hold_use_max': max(totals.hold_uses, default=None),
        'parts': list(parts),
        'misses': list(misses),
    }


class PartsMessage(NamedTuple):
    """Content of a message: names of the cell, parts by number, misses by the bus cycle of opening."""

    about: dict[str, Any]
    parts: dict[int, dict[str, Any]]
    misses: dict[int, dict[str, Any]]


def read_message(text: str) -> PartsMessage:
    """Parse a message about parts; raises TelegramError if it is invalid."""
    try:
        document = json.loads(text)
        parts = {one['number']: _read(PartRecord, one) for one in document['parts']}
        misses = {one['opened_cycle']: _read(Miss, one) for one in document['misses']}
        about = {name: document[name] for name in ABOUT}
        if not isinstance(about['cell'], str) or not all(map(_are_names, (about['inputs'], about['belts']))):
            raise ValueError('a cell, an input or a belt has no name')
    except (ValueError, KeyError, TypeError, RecursionError, AttributeError):
        raise TelegramError(f'{shown(text)} is not a valid log of parts') from None
    return PartsMessage(about, parts, misses)


class PartsLog:
    """Log of the parts of a robot's cell, built message by message.

    Unfinished parts and the latest finished ones are kept individually, older ones only in the statistics. An older
    part that is reported again, because it was removed from a box, counts twice.

    Parameters
    ----------
    kept_max
        Number of parts, and of misses, kept individually.

    """

    def __init__(self, kept_max: int = KEPT_MAX) -> None:
        self._kept_max = kept_max
        self._about: dict[str, Any] = {}
        self._parts: dict[int, dict[str, Any]] = {}  # by number, in order of their latest message
        self._misses: dict[int, dict[str, Any]] = {}  # by the bus cycle of opening
        self._before = Totals()

    def add(self, text: str) -> None:
        """Add a message; raises TelegramError if it is invalid."""
        message = read_message(text)
        self._about = message.about
        for number, one in message.parts.items():
            self._parts.pop(number, None)
            self._parts[number] = one
        self._misses |= message.misses
        self._compact()

    def _compact(self) -> None:
        """Move the oldest parts and misses beyond the limit to the statistics."""
        more = max(len(self._parts) - self._kept_max, 0)
        over = islice((number for number, one in self._parts.items() if one['outcome'] not in NOT_OVER), more)
        parts = [self._parts.pop(number) for number in list(over)]
        missed = list(self._misses)[: max(len(self._misses) - self._kept_max, 0)]
        misses = [self._misses.pop(cycle) for cycle in missed]
        if parts or misses:
            self._before = self._before.with_more(self._about, parts, misses)

    def report(self) -> dict[str, Any] | None:
        """Return the report, None before the first message."""
        if not self._about:
            return None
        parts = [self._parts[number] for number in sorted(self._parts)]
        misses = [self._misses[cycle] for cycle in sorted(self._misses)]
        return report_of(self._about, parts, misses, self._before)


def _read(kind: type[PartRecord | Miss | Stay], document: dict[str, Any]) -> dict[str, Any]:
    """Check and return the document of a part, stay or miss; raises ValueError or TypeError."""
    hints = get_type_hints(kind)
    if kind is PartRecord:
        document = OF_OLDER | document
    if document.keys() != hints.keys():
        raise ValueError(f'{shown(document)} has other fields')
    for name, value in document.items():
        if hints[name] in (Outcome, How):
            hints[name](value)
        elif hints[name] is str:
            if not isinstance(value, str):
                raise TypeError(f'{name} is {shown(value)}')
        elif hints[name] == list[Stay]:
            if not isinstance(value, list) or len(value) > STAYS_MAX:
                raise TypeError(f'{name} is {shown(value)}')
            for stay in value:
                _read(Stay, stay)
        else:
            whole, is_place = hints[name] is int, hints[name] not in (int, float)
            numbers = value if is_place else [value]
            if len(numbers) != (PLACE if is_place else 1):
                raise ValueError(f'{name} is {shown(value)}')
            if not all(_is_number(number, whole) for number in numbers):
                raise TypeError(f'{name} is {shown(value)}')
    return document


def _is_number(value: object, whole: bool) -> bool:
    kinds = int if whole else (int, float)
    return isinstance(value, kinds) and not isinstance(value, bool) and abs(value) < NUMBER_MAX


def _are_names(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)
