"""What has happened to the parts of a cell, and how well: of a simulation, or of what a robot has told bit by bit."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.errors import TelegramError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.peripherals.parts import Outcome

ABOUT = ('cell', 'inputs', 'belts')


def report_of(
    about: Mapping[str, Any], parts: Sequence[dict[str, Any]], misses: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return the report of a cell.

    Parameters
    ----------
    about
        Names of the cell, of its inputs and its belts.
    parts, misses
        Documents of ``PartRecord`` and ``Miss``.

    """
    placed = [one for one in parts if one['outcome'] == Outcome.PLACED]
    errors: Floats = np.array(
        [one['place_error_m'][:2] for one in placed if one['where'] and one['where'] not in about['belts']]
    ).reshape(-1, 2)
    far = np.hypot(errors[:, 0], errors[:, 1])
    taken = [one for one in parts if one['picked_cycle'] >= 0]
    uses = [one['hold_use'] for one in taken]
    counts = {str(outcome): 0 for outcome in Outcome}
    for one in parts:
        counts[one['outcome']] += 1
    return {
        **{name: about[name] for name in ABOUT},
        'outcomes': counts,
        'picked': len(taken),
        'missed': len(misses),
        'place_error_max_m': float(far.max()) if len(far) else None,
        'place_error_rms_m': float(np.sqrt(np.mean(far**2))) if len(far) else None,
        'hold_use_max': max(uses, default=None),
        'parts': list(parts),
        'misses': list(misses),
    }


class PartsLog:
    """The log of a robot's cell, as it comes message by message."""

    def __init__(self) -> None:
        self._about: dict[str, Any] = {}
        self._parts: dict[int, dict[str, Any]] = {}
        self._misses: dict[int, dict[str, Any]] = {}

    def add(self, text: str) -> None:
        """Take a message; raises TelegramError for one that is none."""
        try:
            told = json.loads(text)
            parts = {int(one['number']): one for one in told['parts']}
            misses = {int(one['opened_cycle']): one for one in told['misses']}
            about = {name: told[name] for name in ABOUT}
        except (ValueError, KeyError, TypeError, RecursionError):
            raise TelegramError(f'{shown(text)} is no log of parts') from None
        self._about = about
        self._parts |= parts
        self._misses |= misses

    def report(self) -> dict[str, Any] | None:
        """Return the report of what was told, None if nothing was."""
        if not self._about:
            return None
        parts = [self._parts[number] for number in sorted(self._parts)]
        return report_of(self._about, parts, [self._misses[cycle] for cycle in sorted(self._misses)])
