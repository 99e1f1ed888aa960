"""Loops of program files over the places of a pattern, or of several at the same time."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.configuration.checked import Errors, refuse
from delta3_pacdrive.motion.frame_reader import PLACE, Places
from delta3_pacdrive.motion.point_reader import Named, Setting, named, read_named


@dataclass(frozen=True)
class PlaceLoop:
    """What a loop goes through.

    Attributes
    ----------
    name
        Of its patterns.
    places
        Of each pattern, all as many, by the name that the frame of the present place has in the loop.

    """

    name: str
    places: Mapping[str, Places]

    @property
    def count(self) -> int:
        """How many places each has."""
        return min(map(len, self.places.values()))

    def setting(self, number: int, outside: Setting) -> Setting:
        """Return in which frames points are told at a place: if they tell none, in that of the only pattern."""
        here = {name: places[number] for name, places in self.places.items()}
        choices = () if PLACE in here else tuple(here)
        return replace(outside, frame=here.get(PLACE), frames={**outside.frames, **here}, choices=choices)


def read_loop(
    value: Any, where: str, patterns: Mapping[str, Places | None], taken: Collection[str], errors: Errors
) -> PlaceLoop | None:
    """Read over which places a loop goes: the name of a pattern, or of several by names that are not ``taken``.

    None if a pattern is wrong, which has been told.
    """
    if not isinstance(value, dict):
        places = named(value, where, patterns, 'pattern')
        return None if places is None else PlaceLoop(str(value), {PLACE: places})
    found: Named[Places] = {}
    read_named(
        value, where, 'place', found, errors, lambda one, name: named(one, name, patterns, 'pattern'), taken
    )
    known = {name: places for name, places in found.items() if places is not None}
    if len(known) < len(value):
        return None
    if not known:
        refuse(f'{where} names no pattern')
    counts = {name: len(places) for name, places in known.items()}
    if len(set(counts.values())) > 1:
        told = ', '.join(f'{value[name]} has {count}' for name, count in counts.items())
        refuse(f'{where}: patterns that go together must have as many places: {told}')
    return PlaceLoop(' and '.join(str(one) for one in value.values()), known)
