"""Reader of records: a mapping of a file becomes a dataclass whose fields declare keys, ranges and choices.

The annotation of a field selects its reader:

    bool, int, float, str       a value; ``fields`` declares range, choices or length
    tuple[float, float]         a list of numbers
    StrEnum                     one of its values
    dataclass                   a mapping
    tuple[X, ...]               a list; a mapping by name, if X has a field ``own_name``
    dict[str, X]                a mapping by name

A record with a method ``broken_rules`` yields the violated rules between its values, each as ``fields.Rules``; the
method is called if all values are valid. A record with ``ALTERNATIVES`` has at most one of these keys.
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
Bind = Callable[['RecordReader'], Read]
_Record = TypeVar('_Record')
_INVALID: Any = object()
_NOTHING: Mapping[str, Any] = types.MappingProxyType({})


class _Field(NamedTuple):
    """A field of a record: name, reader for a document, and value without the key if this is not the default."""

    name: str
    bind: Bind
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
            found[key] = _Field(one.name, _binder_of(hints[one.name], one.metadata), absent)
            no_default = one.default is one.default_factory is dataclasses.MISSING
            if no_default and absent is _INVALID:
                required.append(key)
    return Schema(found, tuple(required), own_name, name_max)


def schema_of(cls: Any) -> Schema:
    """Return the schema of a dataclass."""
    return _schema_of(cls)  # mypy does not accept all classes as arguments of a cached function


class RecordReader:
    """Reader of the records of a document.

    Parameters
    ----------
    names
        Names that references may use, by section, each with the value that replaces it.
    readers
        Readers of types that files describe in a form of their own, and of ``contextual`` values by name.

    """

    def __init__(
        self,
        errors: Errors,
        names: Mapping[str, Mapping[str, Any]] | None = None,
        readers: Mapping[Any, Read] | None = None,
    ) -> None:
        self.errors, self.names, self.readers = errors, names or {}, readers or {}
        self._bound: dict[Any, list[tuple[str, str, Read, Any]]] = {}  # fields with bound readers, by class

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
        fields.allow_one_of(getattr(cls, 'ALTERNATIVES', ()))
        found = cls(**self.values(cls, fields, prefix), **more)
        broken = getattr(found, 'broken_rules', None)
        for path, sentence in broken() if broken is not None else ():
            with self.errors.noted(_place_of(value, path)):
                refuse(f'{path_text(where if prefix is None else prefix, path)} {sentence}')
        return found

    def values(
        self, cls: Any, fields: Section, prefix: str | None = None, known: Mapping[str, Any] = _NOTHING
    ) -> dict[str, Any]:
        """Return the values of a record whose keys belong to a section, by field; raises as ``record``.

        ``known`` are values that were read before.
        """
        bound = self._bound.get(cls)
        if bound is None:
            bound = self._bound[cls] = [
                (key, one.name, one.bind(self), one.absent) for key, one in schema_of(cls).fields.items()
            ]
        found = dict(known)
        is_valid = True
        for key, name, read, absent in bound:
            if name in known:
                continue
            if key in fields:
                found[name] = value = fields.read(key, read, _INVALID, prefix)
                is_valid &= value is not _INVALID
            elif absent is not _INVALID:
                found[name] = absent
        if not is_valid or any(key not in fields for key in schema_of(cls).required):
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
            count = f'{least} to {most} ' if least else ''
            refuse(f'{where} must be a mapping of {count}names, not {shown(value)}')
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


def _binder_of(kind: Any, metadata: Mapping[str, Any]) -> Bind:
    """Return the binder of a field by its annotation and its metadata."""
    if typing.get_origin(kind) in (types.UnionType, typing.Union):
        kind = next(one for one in typing.get_args(kind) if one is not types.NoneType)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if 'read' in metadata:
        return lambda _: metadata['read']
    if 'reader' in metadata:
        return lambda reader: reader.readers[metadata['reader']]
    if 'record' in metadata:
        return lambda reader: _converted(
            functools.partial(reader.record, metadata['record']), metadata['convert']
        )
    if origin is tuple and inner[-1] is not Ellipsis:
        numbers = numbers_between(len(inner), metadata['low'], metadata['high'], whole=inner[0] is int)
        return lambda _: numbers
    if origin in (tuple, dict):
        return _several(kind, metadata)
    if 'section' in metadata:
        return lambda reader: functools.partial(
            _referred, reader.names[metadata['section']], metadata['section']
        )
    if dataclasses.is_dataclass(kind):
        cls: Any = kind
        return lambda reader: reader.readers.get(cls) or functools.partial(reader.record, cls)
    read = _converted(one_of(tuple(kind)), kind) if issubclass(kind, StrEnum) else _simple(kind, metadata)
    return lambda _: read


def _converted(read: Read, convert: Callable[[Any], Any]) -> Read:
    return lambda value, where: convert(read(value, where))


def _simple(kind: Any, metadata: Mapping[str, Any]) -> Read:
    """Return the reader of a single value."""
    if kind is bool:
        return flag
    if kind is str:
        choices = metadata.get('choices')
        return one_of(choices) if choices else line_of_text(metadata['characters_max'])
    between: Callable[[Any, Any], Read] = whole_number_between if kind is int else number_between
    return between(metadata['low'], metadata['high'])


def _several(kind: Any, metadata: Mapping[str, Any]) -> Bind:
    """Return the binder of a list, or of a mapping by name."""
    is_dict = typing.get_origin(kind) is dict
    one: Any = typing.get_args(kind)[1 if is_dict else 0]
    limits = metadata.get('least', 0), metadata.get('most', ENTRIES_MAX)
    by_name = dataclasses.is_dataclass(one) and any(
        f.metadata.get('own_name') for f in dataclasses.fields(one)
    )
    if not is_dict and not by_name:
        bind = _binder_of(one, {name: metadata[name] for name in metadata if name == 'section'})

        def listed(reader: RecordReader) -> Read:
            read = bind(reader)
            return lambda value, where: reader.listed(value, where, read, *limits)

        return listed

    def named(reader: RecordReader) -> Read:
        make: Any = dict if is_dict else lambda found: tuple(found.values())
        return lambda value, where: make(reader.named(one, value, where, *limits))

    return named


def _referred(names: Mapping[str, Any], section: str, value: Any, where: str) -> Any:
    """Return the value of a name that a section defines."""
    if not names:
        refuse(f'{where} is {shown(value)}, but there are no {section}')
    return names[one_of(tuple(names))(value, where)]


def _counted(value: Any, where: str, least: int, most: int) -> None:
    """Reject lists and mappings that are too short or too long."""
    if not least <= len(value) <= most:
        count = f'{least} to {most}' if least else f'at most {most}'
        refuse(f'{where} holds {len(value)} entries, but must hold {count}')
