"""Declarations of the values that files contain, as fields of dataclasses; ``schema`` reads them.

The annotation of a field selects its reader; these functions add descriptions, ranges and choices. A field with a
default is optional in files.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Any

ENTRIES_MAX = 10_000  # of a list
Path = tuple[str | int, ...]  # keys and numbers of items, from a record to a value
Rules = Iterator[
    tuple[Path, str]
]  # violated rules: path to a value, and the message after the name of the value


def quantity(description: str, low: float = -math.inf, high: float = math.inf, **more: Any) -> Any:
    """Declare a number, or a tuple of numbers, with its description and closed range."""
    return _declared({'description': description, 'low': low, 'high': high}, more)


def positive(description: str, high: float = math.inf, **more: Any) -> Any:
    """Declare a number above zero."""
    return quantity(description, math.nextafter(0.0, 1.0), high, **more)


def switch(description: str) -> Any:
    """Declare a boolean."""
    return quantity(description, False, True)


def choice(description: str, choices: tuple[str, ...], required: bool = False) -> Any:
    """Declare a string out of several; the first is the default unless the value is required."""
    metadata = {'description': f'{description}: {" or ".join(choices)}', 'choices': choices}
    return _declared(metadata, {} if required else {'default': choices[0]})


def text(description: str, characters_max: int, **more: Any) -> Any:
    """Declare one line of text."""
    return _declared({'description': description, 'characters_max': characters_max}, more)


def reference(description: str, section: str, **more: Any) -> Any:
    """Declare a name, or a list of names, that another section of the file defines."""
    return _declared({'description': description, 'section': section}, more)


def entries(description: str, least: int = 0, most: int = ENTRIES_MAX, **more: Any) -> Any:
    """Declare a list, or a mapping by name, with the limits of its length."""
    return _declared({'description': description, 'least': least, 'most': most}, more)


def own_name(characters_max: int = 60) -> Any:
    """Declare the name of a record, which is its key in a mapping."""
    return field(metadata={'own_name': True, 'characters_max': characters_max})


def read_by(read: Callable[[Any, str], Any], description: str = '', **more: Any) -> Any:
    """Declare a value with its own reader, which takes the value and its name."""
    return _declared({'description': description, 'read': read}, more)


def contextual(reader: str, **more: Any) -> Any:
    """Declare a value whose reader depends on its surroundings in the document; ``reader`` names it."""
    return _declared({'reader': reader}, more)


def derived(record: type, convert: Callable[[Any], Any], description: str = '', **more: Any) -> Any:
    """Declare a value that is computed from a record in the file."""
    return _declared({'description': description, 'record': record, 'convert': convert}, more)


def internal(**more: Any) -> Any:
    """Declare a field that files do not contain."""
    return field(metadata={'internal': True}, **more)


def _declared(metadata: dict[str, Any], more: dict[str, Any]) -> Any:
    """Return a field; ``key``: its key in files, ``absent``: its value without the key."""
    for name in ('key', 'absent'):
        if name in more:
            metadata[name] = more.pop(name)
    return field(metadata=metadata, **more)
