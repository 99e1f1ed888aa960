"""Reader of records: a mapping of a file becomes a dataclass whose fields declare keys, ranges and choices.

The annotation of a field selects its reader:

    bool, int, float, str       a value; ``fields`` declares range, choices or length
    tuple[float, float]         a list of numbers
    StrEnum                     one of its values
    dataclass                   a mapping
    tuple[X, ...]               a list; a mapping by name, if X has a field ``own_name``
    dict[str, X]                a mapping by name

A record with a method ``broken_rules`` yields the violated rules between its values: path from the record to the
value, and what is wrong with it. A record with ``ALTERNATIVES`` has at most one of these keys.
"""

import dataclasses
import functools
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import Any, NamedTuple, TypeVar

from delta3_pacdrive.configuration.fields import ENTRIES_MAX, Path
from delta3_pacdrive.configuration.key_units import base_key
from delta3_pacdrive.configuration.source_positions import Place, numbered, place_in, place_of_key
from delta3_pacdrive.configuration.strict_reader import Errors, Reported, Section, refuse
from delta3_pacdrive.configuration.value_readers import (
    flag,
    line_of_text,
    number_between,
    numbers_between,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import shown

Read = Callable[[Any, str], Any]
ReadIn = Callable[['RecordReader', Any, str], Any]
_Record = TypeVar('_Record')
_INVALID: Any = object()


class _Field(NamedTuple):
    """A field of a record: its name, its reader, and its value without the key if this is not its default."""

    name: str
    read: ReadIn
    absent: Any


class Schema(NamedTuple):
    """Keys of a record."""

    fields: dict[str, _Field]  # by key
    required: tuple[str, ...]
    own_name: str  # field that contains the name of the record; empty without one
    name_max: int  # characters of the name


@functools.cache
def _schema_of(cls: Any) -> Schema:
    hints = typing.get_type_hints(cls)
    found: dict[str, _Field] = {}
    required, own_name, name_max = [], '', 60
    for one in dataclasses.fields(cls):
        if one.metadata.get('own_name'):
            own_name, name_max = one.name, one.metadata['characters_max']
        elif not one.metadata.get('internal'):
            key, absent = one.metadata.get('key', one.name), one.metadata.get('absent', _INVALID)
            found[key] = _Field(one.name, _reader_of(hints[one.name], one.metadata), absent)
            no_default = one.default is one.default_factory is dataclasses.MISSING
            if no_default and absent is _INVALID:
                required.append(key)
    return Schema(found, tuple(required), own_name, name_max)


def schema_of(cls: Any) -> Schema:
    """Return the schema of a dataclass."""
    return _schema_of(cls)


class RecordReader:
    """Reader of the records of a document.

    Parameters
    ----------
    names
        Names that references may use, by section, each with the value that replaces it.
    readers
        Readers of types that files describe in a form of their own.

    """

    def __init__(
        self,
        errors: Errors,
        names: Mapping[str, Mapping[str, Any]] | None = None,
        readers: Mapping[Any, Read] | None = None,
    ) -> None:
        self.errors, self.names, self.readers = errors, names or {}, readers or {}

    def record(
        self, cls: type[_Record], value: Any, where: str, prefix: str | None = None, **more: Any
    ) -> _Record:
        """Return a record, with the values ``more`` of fields that are not in its mapping.

        Raises
        ------
        Reported
            The record is invalid, and the errors are recorded.
        Refusal
            The value is not a mapping, or contains alternatives.

        """
        schema = schema_of(cls)
        fields = Section(value, where, self.errors, schema.fields, schema.required)
        fields.require_one(getattr(cls, 'ALTERNATIVES', ()))
        found = cls(**self.values(cls, fields, prefix), **more)
        broken = getattr(found, 'broken_rules', None)
        for path, sentence in broken() if broken is not None else ():
            with self.errors.noted(_place_of(value, path)):
                refuse(f'{path_text(where if prefix is None else prefix, path)} {sentence}')
        return found

    def values(self, cls: Any, fields: Section, prefix: str | None = None) -> dict[str, Any]:
        """Return the values of a record whose keys belong to a section, by field; raises as ``record``."""
        schema = schema_of(cls)
        found = {}
        for key, one in schema.fields.items():
            if key in fields:
                found[one.name] = fields.read(key, functools.partial(one.read, self), _INVALID, prefix)
            elif one.absent is not _INVALID:
                found[one.name] = one.absent
        if any(value is _INVALID for value in found.values()) or any(
            key not in fields for key in schema.required
        ):
            raise Reported
        return found

    def listed(
        self, value: Any, where: str, read: Read, least: int = 0, most: int = ENTRIES_MAX
    ) -> tuple[Any, ...]:
        """Return the items of a list; invalid ones are reported and skipped."""
        if not isinstance(value, list):
            refuse(f'{where} must be a list, not {shown(value)}')
        _counted(value, where, least, most)
        found = []
        for item, name, place in numbered(value, where):
            with self.errors.noted(place):
                found.append(read(item, name))
        return tuple(found)

    def named(
        self, cls: type[_Record], value: Any, where: str, least: int = 0, most: int = ENTRIES_MAX
    ) -> dict[str, _Record]:
        """Return the records of a mapping by name; invalid ones are reported and skipped."""
        if not isinstance(value, dict):
            refuse(f'{where} must be a mapping of names, not {shown(value)}')
        _counted(value, where, least, most)
        schema = schema_of(cls)
        found = {}
        for key, content in value.items():
            with self.errors.noted(place_of_key(value, key)):
                if not line_of_text(schema.name_max)(key, f'a name in {where}'):
                    refuse(f'a name in {where} is empty')
            more = {schema.own_name: str(key)} if schema.own_name else {}
            with self.errors.noted(place_in(value, key)):
                found[str(key)] = self.record(cls, content, path_text(where, (str(key),)), **more)
        return found


def path_text(where: str, path: Iterable[str | int]) -> str:
    """Return the name of the value at a path from ``where``."""
    for step in path:
        where += f'[{step}]' if isinstance(step, int) else f'{where and "."}{step}'
    return where


def _place_of(value: Any, path: Path) -> Place | None:
    """Return the position of the value at a path, or of the last container on the way to it."""
    place = None
    for step in path:
        if isinstance(value, dict):
            given = next((key for key in value if key == step or base_key(key, (str(step),))), None)
            if given is None:
                break
        else:
            given = step
        place, value = place_in(value, given), value[given]
    return place


def _reader_of(kind: Any, metadata: Mapping[str, Any]) -> ReadIn:
    """Return the reader of a field by its annotation and its metadata."""
    if typing.get_origin(kind) in (types.UnionType, typing.Union):
        kind = next(one for one in typing.get_args(kind) if one is not types.NoneType)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if 'read' in metadata:
        return _plain(metadata['read'])
    if 'record' in metadata:
        given, convert = metadata['record'], metadata['convert']
        return lambda reader, value, where: convert(reader.record(given, value, where))
    if origin is tuple and inner[-1] is not Ellipsis:
        low, high = metadata['low'], metadata['high']
        return _plain(numbers_between(len(inner), low, high, whole=inner[0] is int))
    if origin in (tuple, dict):
        return _several(kind, metadata)
    if 'section' in metadata:
        return lambda reader, value, where: _referred(reader, metadata['section'], value, where)
    if dataclasses.is_dataclass(kind):
        return _nested(kind)
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        choose = one_of(tuple(kind))
        return lambda _, value, where: kind(choose(value, where))
    return _plain(_simple(kind, metadata))


def _plain(read: Read) -> ReadIn:
    return lambda _, value, where: read(value, where)


def _nested(cls: Any) -> ReadIn:
    return lambda reader, value, where: (
        reader.readers[cls](value, where) if cls in reader.readers else reader.record(cls, value, where)
    )


def _simple(kind: Any, metadata: Mapping[str, Any]) -> Read:
    """Return the reader of a single value."""
    if kind is bool:
        return flag
    if kind is str:
        choices = metadata.get('choices')
        return one_of(choices) if choices else line_of_text(metadata['characters_max'])
    between: Callable[[Any, Any], Read] = whole_number_between if kind is int else number_between
    return between(metadata['low'], metadata['high'])


def _several(kind: Any, metadata: Mapping[str, Any]) -> ReadIn:
    """Return the reader of a list, or of a mapping by name."""
    is_dict = typing.get_origin(kind) is dict
    one: Any = typing.get_args(kind)[1 if is_dict else 0]
    least, most = metadata.get('least', 0), metadata.get('most', ENTRIES_MAX)
    own = schema_of(one).own_name if dataclasses.is_dataclass(one) else ''
    if not is_dict and not own:
        read = _reader_of(one, {name: metadata[name] for name in metadata if name == 'section'})
        return lambda reader, value, where: reader.listed(
            value, where, functools.partial(read, reader), least, most
        )

    def named(reader: RecordReader, value: Any, where: str) -> Any:
        found = reader.named(one, value, where, least, most)
        return found if is_dict else tuple(found.values())

    return named


def _referred(reader: RecordReader, section: str, value: Any, where: str) -> Any:
    """Return the value of a name that a section defines."""
    names = reader.names[section]
    if not names:
        refuse(f'{where} is {shown(value)}, but there are no {section}')
    return names[one_of(tuple(names))(value, where)]


def _counted(value: Any, where: str, least: int, most: int) -> None:
    """Reject lists and mappings that are too short or too long."""
    if not least <= len(value) <= most:
        count = f'{least} to {most}' if least else f'at most {most}'
        refuse(f'{where} holds {len(value)} entries, but must hold {count}')
