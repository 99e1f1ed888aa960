"""Messages in JSON: a dataclass describes keys, types and limits, and one codec writes and reads all of them."""

import json
import math
from collections.abc import Mapping
from dataclasses import Field, asdict, dataclass, field, fields
from types import EllipsisType
from typing import Any, ClassVar, Self, get_args, get_type_hints

from delta3_pacdrive.errors import TelegramError, shown

COUNT_MAX = 2**53  # larger numbers are not exact in JSON


@dataclass(frozen=True)
class JsonMessage:
    """A message written as a JSON object with a key for each field.

    A field whose default is None is omitted if it is None, unless it is ``nullable``. All other keys are required, also
    those with a default. Numbers are finite and smaller than ``number_max``; a tuple is a list.
    """

    number_max: ClassVar[float] = COUNT_MAX
    further: ClassVar[str] = ''  # field of type dict for all other keys; '': there are none

    def to_fields(self) -> dict[str, Any]:
        """Return the values by key, ready for JSON."""
        values = asdict(self)
        more = values.pop(self.further) if self.further else {}
        known = _known(type(self))
        written = {name: value for name, value in values.items() if value is not None or _null(known[name])}
        return {
            name: list(value) if isinstance(value, tuple) else value for name, value in written.items()
        } | more

    def to_json(self) -> str:
        """Return the message as JSON."""
        return json.dumps(self.to_fields())

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Parse the output of ``to_json``; raises TelegramError."""
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            raise TelegramError(f'{shown(text)} is not a valid {cls.__name__.lower()}') from None
        return cls.from_fields(values)

    @classmethod
    def from_fields(cls, values: object) -> Self:
        """Build the message from values by key, as parsed from JSON; raises TelegramError."""
        given: Mapping[str, Any] = values if isinstance(values, Mapping) else {}
        known, kind = _known(cls), cls.__name__.lower()
        needed = [name for name, own in known.items() if own.default is not None or _null(own)]
        if not given.keys() >= set(needed) or (given.keys() - known.keys() and not cls.further):
            raise TelegramError(f'a {kind} must have the keys {", ".join(needed)}')
        kinds, found = get_type_hints(cls), dict[str, Any]()
        for name, own in known.items():
            if name in given and not (given[name] is None and _null(own)):
                require(given[name], kinds[name], f'{name} of a {kind}', cls.number_max, _nan(own))
            if name in given:
                found[name] = tuple(given[name]) if isinstance(given[name], list) else given[name]
        if cls.further:
            found[cls.further] = {name: value for name, value in given.items() if name not in known}
        return cls(**found)


def nullable(nan: bool = False) -> Any:
    """Return a field that is always written, null if it is None; with ``nan`` its numbers may be nan."""
    return field(default=None, metadata={'null': True, 'nan': nan})


def _null(own: Field[Any]) -> bool:
    return bool(own.metadata.get('null'))


def _nan(own: Field[Any]) -> bool:
    return bool(own.metadata.get('nan'))


def _known(cls: type[JsonMessage]) -> dict[str, Field[Any]]:
    """Return the fields of a message that are keys."""
    return {own.name: own for own in fields(cls) if own.name != cls.further}


def require(value: Any, kind: Any, what: str, number_max: float = COUNT_MAX, nan: bool = False) -> None:
    """Raise TelegramError if a value does not have the type of its field."""
    if type(None) in get_args(kind):
        (kind,) = set(get_args(kind)) - {type(None)}
    if members := get_args(kind):
        any_number = isinstance(members[-1], EllipsisType)
        if not isinstance(value, list) or not (any_number or len(value) == len(members)):
            count = '' if any_number else f'{len(members)} '
            items = 'texts' if members[0] is str else 'numbers'
            raise TelegramError(f'{what} must be a list of {count}{items}, not {shown(value)}')
        for one in value:
            require(one, members[0], what, number_max, nan)
        return
    accepted = (int, float) if kind is float else str if issubclass(kind, str) else kind
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise TelegramError(f'{what} is {shown(value)}, but must be of type {kind.__name__}')
    is_nan = isinstance(value, float) and math.isnan(value)
    if isinstance(value, (int, float)) and not (abs(value) < number_max or (nan and is_nan)):
        raise TelegramError(f'{what} is {shown(value)}, which is out of range')
