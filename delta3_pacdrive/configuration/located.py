"""Documents that remember where in their file each value stands; otherwise they are plain mappings and lists."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml
from yaml.representer import SafeRepresenter


class Place(NamedTuple):
    """Where something begins; both count from 1."""

    line: int
    column: int


class Fields(dict[Any, Any]):
    """A mapping, with the places of its keys and of its values."""

    __slots__ = ('key_places', 'place', 'places', 'source')

    def __init__(self, place: Place) -> None:
        super().__init__()
        self.place = place
        self.source = ''  # of a whole document: the name of its file
        self.places: dict[Any, Place] = {}
        self.key_places: dict[Any, Place] = {}


class Items(list[Any]):
    """A list, with the places of its items."""

    __slots__ = ('place', 'places', 'source')

    def __init__(self, place: Place) -> None:
        super().__init__()
        self.place = place
        self.source = ''
        self.places: list[Place] = []


def place_in(container: Any, key: Any) -> Place | None:
    """Return where a value of a mapping or a list stands, if it is known."""
    if isinstance(container, Fields):
        return container.places.get(key)
    if isinstance(container, Items):
        place: Place = container.places[key]
        return place
    return None


def place_of_key(container: Any, key: Any) -> Place | None:
    """Return where a key stands, if it is known."""
    return container.key_places.get(key) if isinstance(container, Fields) else None


def place_of(value: Any) -> Place | None:
    """Return where a mapping or a list begins, if it is known."""
    return value.place if isinstance(value, (Fields, Items)) else None


def numbered(items: list[Any], where: str) -> Iterator[tuple[Any, str, Place | None]]:
    """Return each item with its name and its place."""
    for n, item in enumerate(items):
        yield item, f'{where}[{n}]', place_in(items, n)


# what was read can be written again
yaml.SafeDumper.add_representer(Fields, SafeRepresenter.represent_dict)
yaml.SafeDumper.add_representer(Items, SafeRepresenter.represent_list)
