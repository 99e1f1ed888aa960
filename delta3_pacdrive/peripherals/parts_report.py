"""What has happened to the parts of a cell, and how well: of a simulation, or of what a robot has told bit by bit."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from delta3_pacdrive.errors import TelegramError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.peripherals.parts import STAYS_MAX, How, Miss, Outcome, PartRecord, Stay

ABOUT = ('cell', 'inputs', 'belts')
PLACE, NUMBER_MAX = 3, 2**53  # numbers of a place, and the largest that is told
KEPT_MAX = 10_000  # parts, and misses, that a log keeps one by one
# recordings of before they were told
OF_OLDER: dict[str, Any] = {'size_m': (0.0, 0.0, 0.0), 'stays': []}
NOT_OVER = (Outcome.WAITING, Outcome.IN_HAND)


@dataclass
class Totals:
    """What parts and misses come to, added up.

    Attributes
    ----------
    outcomes
        How many parts have come to each of them.
    picked, missed
        Parts that were taken, and how often there was none to take.
    placed, error_max_m, error_square_m2
        Parts that lie in places of boxes, the greatest distance from such a place, and the sum of all squares.
    hold_uses
        The greatest share of the holding force that a part has needed; empty if none was taken.

    """

    outcomes: dict[str, int] = field(default_factory=lambda: {str(outcome): 0 for outcome in Outcome})
    picked: int = 0
    missed: int = 0
    placed: int = 0
    error_max_m: float = 0.0
    error_square_m2: float = 0.0
    hold_uses: tuple[float, ...] = ()

    def with_more(
        self, about: Mapping[str, Any], parts: Sequence[dict[str, Any]], misses: Sequence[dict[str, Any]]
    ) -> 'Totals':
        """Return what it comes to with more parts and misses: documents of ``PartRecord`` and ``Miss``."""
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
            outcomes,
            self.picked + len(taken),
            self.missed + len(misses),
            self.placed + len(far),
            float(far.max(initial=self.error_max_m)),
            self.error_square_m2 + float(np.sum(far**2)),
            (max(uses),) if uses else (),
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
        Names of the cell, of its inputs and its belts.
    parts, misses
        Documents of ``PartRecord`` and ``Miss``.
    before
        What those come to that are not told one by one any more.

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


class Told(NamedTuple):
    """A message tells names of a cell, documents of parts by their numbers, and misses by the cycles of their begin."""

    about: dict[str, Any]
    parts: dict[int, dict[str, Any]]
    misses: dict[int, dict[str, Any]]


def read_message(text: str) -> Told:
    """Return what a message tells of parts; raises TelegramError for one that is none."""
    try:
        told = json.loads(text)
        parts = {one['number']: _read(PartRecord, one) for one in told['parts']}
        misses = {one['opened_cycle']: _read(Miss, one) for one in told['misses']}
        about = {name: told[name] for name in ABOUT}
        if not isinstance(about['cell'], str) or not all(map(_are_names, (about['inputs'], about['belts']))):
            raise ValueError('a cell, or what it has, has no name')
    except (ValueError, KeyError, TypeError, RecursionError, AttributeError):
        raise TelegramError(f'{shown(text)} is no log of parts') from None
    return Told(about, parts, misses)


class PartsLog:
    """The log of a robot's cell, as it comes message by message.

    It keeps what is not over, and the newest of what is; the rest stays in its counts and errors. A part of which
    it is told again after so many others, because it was taken out of a box, counts as one more.

    Parameters
    ----------
    kept_max
        Parts, and misses, that it keeps one by one.

    """

    def __init__(self, kept_max: int = KEPT_MAX) -> None:
        self._kept_max = kept_max
        self._about: dict[str, Any] = {}
        self._parts: dict[
            int, dict[str, Any]
        ] = {}  # by their numbers, in the order in which they were told last
        self._misses: dict[int, dict[str, Any]] = {}  # by the bus cycles in which the valve was opened
        self._before = Totals()

    def add(self, text: str) -> None:
        """Take a message; raises TelegramError for one that is none."""
        told = read_message(text)
        self._about = told.about
        for number, one in told.parts.items():
            self._parts.pop(number, None)
            self._parts[number] = one
        self._misses |= told.misses
        self._forget()

    def _forget(self) -> None:
        """Keep no more than may be kept: the oldest are added up."""
        more = max(len(self._parts) - self._kept_max, 0)
        over = islice((number for number, one in self._parts.items() if one['outcome'] not in NOT_OVER), more)
        parts = [self._parts.pop(number) for number in list(over)]
        missed = list(self._misses)[: max(len(self._misses) - self._kept_max, 0)]
        misses = [self._misses.pop(cycle) for cycle in missed]
        if parts or misses:
            self._before = self._before.with_more(self._about, parts, misses)

    def report(self) -> dict[str, Any] | None:
        """Return the report of what was told, None if nothing was."""
        if not self._about:
            return None
        parts = [self._parts[number] for number in sorted(self._parts)]
        misses = [self._misses[cycle] for cycle in sorted(self._misses)]
        return report_of(self._about, parts, misses, self._before)


def _read(kind: type[PartRecord | Miss | Stay], told: dict[str, Any]) -> dict[str, Any]:
    """Return the document of a part, a stay or a miss; raises ValueError or TypeError for what is none."""
    hints = get_type_hints(kind)
    if kind is PartRecord:
        told = OF_OLDER | told
    if told.keys() != hints.keys():
        raise ValueError(f'{shown(told)} has other fields')
    for name, value in told.items():
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
    return told


def _is_number(value: object, whole: bool) -> bool:
    kinds = int if whole else (int, float)
    return isinstance(value, kinds) and not isinstance(value, bool) and abs(value) < NUMBER_MAX


def _are_names(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)
