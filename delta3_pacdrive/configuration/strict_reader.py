"""Strict reader of documents: reports up to ten errors, each with its place and rule."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

from delta3_pacdrive.configuration.key_units import base_key, base_unit, in_base_unit, with_units
from delta3_pacdrive.configuration.source_positions import Place, place_in, place_of, place_of_key
from delta3_pacdrive.errors import Delta3Error, shown

ERRORS_MAX = 10
NAME_MAX = 60  # longer names are not typing errors

_Value = TypeVar('_Value')


class Refusal(Exception):  # noqa: N818 (it never leaves a reader)
    """A value breaks a rule; without a place, that of the value being read applies."""

    def __init__(self, sentence: str, place: Place | None = None) -> None:
        super().__init__(sentence)
        self.place = place


class Reported(Refusal):
    """A value is invalid, and the errors are recorded."""

    def __init__(self) -> None:
        super().__init__('')


class _EnoughError(Exception):
    """The maximum number of errors is reached."""


class Errors:
    """Errors of a document."""

    def __init__(self, source: str = '') -> None:
        self._source = source
        self._found: dict[str, Place] = {}

    def add(self, refusal: Refusal, place: Place | None) -> None:
        """Add an error with its place."""
        place = refusal.place or place
        if not self._source:
            where = f'line {place.line}, column {place.column}: ' if place else ''
        else:
            where = f'{self._source}:{place.line}:{place.column}: ' if place else f'{self._source}: '
        sentence = f'{where}{refusal}'
        self._found.setdefault(sentence, place or Place(0, 0))
        if len(self._found) >= ERRORS_MAX:
            raise _EnoughError

    def noted(self, place: Place | None = None) -> _Noted:
        """Return a block that records the rejection that ends it; execution continues after the block."""
        return _Noted(self, place)

    @contextmanager
    def raised_as(self, kind: type[Delta3Error]) -> Iterator[None]:
        """Raise all recorded errors as one exception, in the order of the file."""
        more = []
        try:
            yield
        except _EnoughError:
            more = [f'the search ended after {ERRORS_MAX} errors']
        if self._found:
            raise kind.of_all([*sorted(self._found, key=lambda one: self._found[one]), *more])


class _Noted:
    """Block whose rejection is recorded; not a generator, because programs enter hundreds of thousands."""

    __slots__ = ('_errors', '_place')

    def __init__(self, errors: Errors, place: Place | None) -> None:
        self._errors, self._place = errors, place

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if not isinstance(error, Refusal):
            return False
        if not isinstance(error, Reported):
            self._errors.add(error, self._place)
        return True


def read_document(
    document: Any, file: str, kind: type[Delta3Error], read: Callable[[Any, Errors], _Value]
) -> _Value:
    """Return a document as read by ``read``; ``file`` names a document that was not read from a file.

    All errors are raised as one exception of a kind, each with its place.
    """
    errors = Errors(getattr(document, 'source', '') or file)
    found: list[_Value] = []
    with errors.raised_as(kind), errors.noted(place_of(document)):
        found.append(read(document, errors))
    return found[0]


class Section:
    """A mapping that is read key by key; an error in one value does not hide those in others.

    A key in metres or radians may also be given in millimetres or degrees: ``to_mm`` for ``to_m``.

    Raises
    ------
    Refusal
        The value is not a mapping.

    """

    def __init__(
        self, value: Any, where: str, errors: Errors, allowed: Iterable[str], required: Iterable[str] = ()
    ) -> None:
        if not isinstance(value, dict):
            raise Refusal(f'{where} must be a mapping, not {shown(value)}', place_of(value))
        self._value, self._where, self._errors = value, where, errors
        self._given: dict[str, str] = {}  # given keys by their base keys
        allowed = sorted(allowed)
        for key in value:
            with errors.noted(place_of_key(value, key)):
                base = key if key in allowed else base_key(key, allowed)
                if not base:
                    raise Refusal(f'{where}: unknown key {shown(key)}, {expected(key, allowed)}')
                if base in self._given:
                    raise Refusal(f'{where} holds {self._given[base]} and {key}: give one of them')
                self._given[base] = key
        meant = {name for key in value for name in with_units(key, allowed)}
        for key in required:
            if key not in self._given and key not in meant:
                with errors.noted(place_of(value)):
                    raise Refusal(f'{where}: missing key {key}')

    def __contains__(self, key: str) -> bool:
        return key in self._given

    def allow_one_of(self, alternatives: Iterable[str]) -> None:
        """Reject more than one of several keys."""
        given = [key for key in alternatives if key in self._given]
        if len(given) > 1:
            refuse(f'{self._where} holds {" and ".join(given)}: give one of them')

    def read(
        self,
        key: str,
        reader: Callable[[Any, str], _Value],
        default: Any = None,
        prefix: str | None = None,
    ) -> _Value:
        """Return the value of a key as converted by ``reader``; the default if it is missing or invalid."""
        if key not in self._given:
            return default  # type: ignore[no-any-return]
        given = self._given[key]
        where = f'{self._where}.{given}' if prefix is None else f'{prefix}{given}'
        with self._errors.noted(place_in(self._value, given)):
            value = in_base_unit(given, self._value[given])
            try:
                return reader(value, where)
            except Refusal as refusal:
                if given == key or isinstance(refusal, Reported):
                    raise
                raise Refusal(f'{refusal} (in {base_unit(given)})', refusal.place) from None
        return default  # type: ignore[no-any-return]


def chosen_kind(value: Any, where: str, key: str, kinds: Collection[str]) -> str:
    """Return the kind of a mapping, which one of its keys gives."""
    if not isinstance(value, dict):
        refuse(f'{where} must be a mapping, not {shown(value)}')
    kind = value.get(key)
    if not isinstance(kind, str) or kind not in kinds:
        names = f'{", ".join(kinds)}{nearest_of(kind, kinds)}'
        refuse(f'{where}.{key} is {shown(kind)}, but must be one of {names}', place_in(value, key))
    return kind


def expected(value: Any, allowed: Iterable[str]) -> str:
    """List the allowed values and suggest the closest match."""
    names = list(allowed)
    units = with_units(value, names)
    return f'expected one of {", ".join(names)}' + (
        f': did you mean {" or ".join(units)}?' if units else nearest_of(value, names)
    )


def nearest_of(value: Any, names: Iterable[str]) -> str:
    """Return a suggestion of the closest name, empty if none is close."""
    if not isinstance(value, str) or len(value) > NAME_MAX:
        return ''
    nearest = difflib.get_close_matches(value, [name for name in names if len(name) <= NAME_MAX], 1)
    return f': did you mean {nearest[0]}?' if nearest else ''


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, such as ``1 move`` and ``2 moves``."""
    return f'{count} {noun}' if count == 1 else f'{count} {noun}s'


def refuse(sentence: str, place: Place | None = None) -> NoReturn:
    """Raise a Refusal."""
    raise Refusal(sentence, place)


@contextmanager
def at(place: Place | None) -> Iterator[None]:
    """Set the place of a rejection that has none."""
    try:
        yield
    except Refusal as refusal:
        refusal.place = refusal.place or place
        raise
