"""Messages in JSON: a dataclass describes keys, types and limits, and one codec writes and reads all of them."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import Field, asdict, dataclass, field, fields
from typing import Any, ClassVar, Self, get_args, get_origin, get_type_hints

from delta3_pacdrive.errors import TelegramError, shown

COUNT_MAX = 2**53  # larger numbers are not exact in JSON
NO_LIMITS = -math.inf, COUNT_MAX


@dataclass(frozen=True)
class JsonMessage:
    """A message written as a JSON object with a key for each field.

    A field whose default is None is omitted if it is None, unless it is ``nullable``. All other keys are required, also
    those with a default. Numbers are finite, at least ``number_min``, and their magnitude is below ``number_max``. A
    tuple is a list, another message an object.
    """

    title: ClassVar[str] = ''  # in error messages; '': the name of the class
    number_min: ClassVar[float] = -math.inf
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
            raise TelegramError(f'{shown(text)} is not {_title(cls)}') from None
        return cls.from_fields(values)

    @classmethod
    def from_fields(cls, values: object) -> Self:
        """Build the message from values by key, as parsed from JSON; raises TelegramError."""
        given: Mapping[str, Any] = values if isinstance(values, Mapping) else {}
        known, kind = _known(cls), _title(cls)
        needed = [name for name, own in known.items() if own.default is not None or _null(own)]
        if not given.keys() >= set(needed) or (given.keys() - known.keys() and not cls.further):
            raise TelegramError(f'{kind} must have the keys {", ".join(needed)}')
        kinds, found = get_type_hints(cls), dict[str, Any]()
        for name, own in known.items():
            if name in given:
                what, limits = f'{name} of {kind}', (cls.number_min, cls.number_max)
                is_null = given[name] is None and _null(own)
                found[name] = None if is_null else checked(given[name], kinds[name], what, limits, _nan(own))
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


def _title(cls: type[JsonMessage]) -> str:
    return cls.title or 'a ' + re.sub('(?<!^)(?=[A-Z])', ' ', cls.__name__).lower()


def checked(
    value: Any, kind: Any, what: str, limits: tuple[float, float] = NO_LIMITS, nan: bool = False
) -> Any:
    """Return the value of a field from its JSON; raises TelegramError if it does not have the type of the field."""
    if type(None) in get_args(kind):
        (kind,) = set(get_args(kind)) - {type(None)}
    if isinstance(kind, type) and issubclass(kind, JsonMessage):
        return kind.from_fields(value)
    if get_origin(kind) is tuple:
        members = get_args(kind)
        any_number = members[-1] is Ellipsis
        if not isinstance(value, list) or not (any_number or len(value) == len(members)):
            count = 'texts' if any_number else f'{len(members)} numbers'
            raise TelegramError(f'{what} must be a list of {count}, not {shown(value)}')
        return tuple(checked(one, members[0], what, limits, nan) for one in value)
    kind = get_origin(kind) or kind
    accepted = (int, float) if kind is float else str if issubclass(kind, str) else kind
    if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
        raise TelegramError(f'{what} is {shown(value)}, but must be of type {kind.__name__}')
    is_nan = isinstance(value, float) and math.isnan(value)
    if isinstance(value, (int, float)) and not (abs(value) < limits[1] or (nan and is_nan)):
        raise TelegramError(f'{what} is {shown(value)}, which is out of range')
    if isinstance(value, (int, float)) and value < limits[0]:
        raise TelegramError(f'{what} is {shown(value)}, but must be at least {limits[0]:g}')
    return value
