"""Loops of program files over the positions of one pattern, or of several patterns in parallel."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.configuration.strict_reader import Errors, refuse
from delta3_pacdrive.planning.program.frame_reader import PLACE, Places
from delta3_pacdrive.planning.program.point_reader import Named, Setting, named, read_named


@dataclass(frozen=True)
class PlaceLoop:
    """Patterns that a loop iterates over."""

    name: str  # of the patterns, for messages
    places: Mapping[str, Places]  # frames of each pattern by loop variable; all of the same length

    @property
    def count(self) -> int:
        """Number of positions."""
        return min(map(len, self.places.values()))

    def setting(self, number: int, outside: Setting) -> Setting:
        """Return the setting of points at a position; with a single pattern its frame is the default frame."""
        frames = {name: places[number] for name, places in self.places.items()}
        choices = () if PLACE in frames else tuple(frames)
        return replace(outside, frame=frames.get(PLACE), frames={**outside.frames, **frames}, choices=choices)


def read_loop(
    value: Any, where: str, patterns: Mapping[str, Places | None], taken: Collection[str], errors: Errors
) -> PlaceLoop | None:
    """Read the patterns of a loop: the name of one, or several by names that are not ``taken``.

    None if a pattern is invalid, which is reported elsewhere.
    """
    if not isinstance(value, dict):
        places = named(value, where, patterns, 'pattern')
        return None if places is None else PlaceLoop(str(value), {PLACE: places})
    found: Named[Places] = {}
    read_named(
        value,
        where,
        'place',
        found=found,
        errors=errors,
        read=lambda one, name: named(one, name, patterns, 'pattern'),
        reserved=taken,
    )
    known = {name: places for name, places in found.items() if places is not None}
    if len(known) < len(value):
        return None
    if not known:
        refuse(f'{where} does not name a pattern')
    counts = {name: len(places) for name, places in known.items()}
    if len(set(counts.values())) > 1:
        sizes = ', '.join(f'{value[name]} has {count}' for name, count in counts.items())
        refuse(f'{where}: patterns of one loop must have the same number of places: {sizes}')
    return PlaceLoop(' and '.join(str(one) for one in value.values()), known)
