"""Mappings and lists that remember the positions of their values in the file."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml
from yaml.representer import SafeRepresenter


class Place(NamedTuple):
    """Position in a file, counted from 1."""

    line: int
    column: int


class Fields(dict[Any, Any]):
    """A mapping with the positions of its keys and values."""

    __slots__ = ('key_places', 'place', 'places', 'source')

    def __init__(self, place: Place) -> None:
        super().__init__()
        self.place = place
        self.source = ''  # file name, of the root of a document
        self.places: dict[Any, Place] = {}
        self.key_places: dict[Any, Place] = {}


class Items(list[Any]):
    """A list with the positions of its items."""

    __slots__ = ('place', 'places', 'source')

    def __init__(self, place: Place) -> None:
        super().__init__()
        self.place = place
        self.source = ''
        self.places: list[Place] = []


def place_in(container: Any, key: Any) -> Place | None:
    """Return the position of a value in a mapping or list, if it is known."""
    if isinstance(container, Fields):
        return container.places.get(key)
    if isinstance(container, Items):
        place: Place = container.places[key]
        return place
    return None


def place_of_key(container: Any, key: Any) -> Place | None:
    """Return the position of a key, if it is known."""
    return container.key_places.get(key) if isinstance(container, Fields) else None


def place_of(value: Any) -> Place | None:
    """Return the position of a mapping or list, if it is known."""
    return value.place if isinstance(value, (Fields, Items)) else None


def numbered(items: list[Any], where: str) -> Iterator[tuple[Any, str, Place | None]]:
    """Yield each item with its name and position."""
    for n, item in enumerate(items):
        yield item, f'{where}[{n}]', place_in(items, n)


# documents read from files can be written again
yaml.SafeDumper.add_representer(Fields, SafeRepresenter.represent_dict)
yaml.SafeDumper.add_representer(Items, SafeRepresenter.represent_list)
