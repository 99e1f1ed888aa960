"""Reader of YAML files: limited size and depth, no aliases (no bombs), one sentence for every error."""

import codecs
import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from yaml.reader import ReaderError

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.configuration.source_positions import Fields, Items, Place
from delta3_pacdrive.errors import Delta3Error, shown

SIZE_MAX_BYTES = 4 * 1024 * 1024


DEPTH_MAX = 50
_TEXT_TAGS = (None, '!', 'tag:yaml.org,2002:str')
# PyYAML (YAML 1.1) reads 2e4 and 1e-1 as strings and 010 as 8; this reader returns numbers and a string
_INTEGER = re.compile(r'[-+]?(0|[1-9][0-9]*(_[0-9]+)*|0x[0-9a-fA-F]+|0b[01]+)')
_NUMBER = re.compile(r'[-+]?([0-9]+(_[0-9]+)*\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?')
_LEADING_ZERO = re.compile(r'[-+]?0[0-9_]+')
_WORDS: dict[str, Any] = {
    **dict.fromkeys(('', '~', 'null', 'Null', 'NULL')),
    **{form: True for word in ('yes', 'true', 'on') for form in (word, word.title(), word.upper())},
    **{form: False for word in ('no', 'false', 'off') for form in (word, word.title(), word.upper())},
    **{sign + word: float(sign + 'inf') for sign in ('', '+', '-') for word in ('.inf', '.Inf', '.INF')},
    **dict.fromkeys(('.nan', '.NaN', '.NAN'), math.nan),
}
_NUMERIC = frozenset('0123456789+-.')
_FAILURES = (yaml.YAMLError, RecursionError, ValueError)
# the C parser needs a tenth of the time
LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def _place(mark: Any) -> Place:
    return Place(mark.line + 1, mark.column + 1)


def _broken(problem: str, event: Any) -> yaml.MarkedYAMLError:
    """Return the error for an event that is valid YAML but not allowed in these files."""
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)


def _scalar(event: Any) -> Any:
    text: str = event.value
    if not event.implicit[0]:  # in quotes, in a block, or with a tag
        if event.tag not in _TEXT_TAGS:
            raise _broken(f'tags are not allowed ({shown(event.tag)})', event)
        return text
    if text in _WORDS:
        return _WORDS[text]
    if text[0] in _NUMERIC and not _LEADING_ZERO.fullmatch(text):
        if _INTEGER.fullmatch(text):
            return int(text, 0)
        if _NUMBER.fullmatch(text):
            return float(text)
    return text


class _Builder:
    """Builds a document from parser events without recursion, so that its depth is limited only by ``DEPTH_MAX``."""

    def __init__(self) -> None:
        self.root: Any = None
        self._open: list[Fields | Items] = []
        self._keys: list[Any] = []  # of each open mapping: the key of the next value
        self._key_places: list[Place] = []
        self._documents = 0

    def take(self, event: Any) -> None:
        """Process the next event."""
        kind = type(event)
        if kind is yaml.ScalarEvent:
            self._put(_scalar(event), event)
        elif kind is yaml.SequenceStartEvent or kind is yaml.MappingStartEvent:
            self._begin(event, Items if kind is yaml.SequenceStartEvent else Fields)
        elif kind is yaml.SequenceEndEvent or kind is yaml.MappingEndEvent:
            self._open.pop()
            self._keys.pop()
            self._key_places.pop()
        elif kind is yaml.AliasEvent:
            raise _broken('aliases are not allowed', event)
        elif kind is yaml.DocumentStartEvent:
            self._documents += 1
            if self._documents > 1:
                raise _broken('a second document begins', event)

    def _begin(self, event: Any, kind: type[Fields] | type[Items]) -> None:
        if not event.implicit:
            raise _broken(f'tags are not allowed ({shown(event.tag)})', event)
        if len(self._open) >= DEPTH_MAX:
            raise _broken(f'lists and mappings are nested more than {DEPTH_MAX} deep', event)
        container = kind(_place(event.start_mark))
        self._put(container, event)
        self._open.append(container)
        self._keys.append(_NONE)
        self._key_places.append(container.place)

    def _put(self, value: Any, event: Any) -> None:
        place = _place(event.start_mark)
        if not self._open:
            self.root = value
            return
        parent = self._open[-1]
        if isinstance(parent, Items):
            parent.append(value)
            parent.places.append(place)
        elif self._keys[-1] is _NONE:
            if isinstance(value, (Fields, Items)):
                raise _broken('a key must not be a list or a mapping', event)
            if value == '<<':
                raise _broken('a mapping must not be merged into another', event)
            if value in parent:
                raise _broken(f'the key {shown(value)} occurs twice', event)
            self._keys[-1], self._key_places[-1] = value, place
        else:
            key = self._keys[-1]
            parent[key] = value
            parent.places[key] = place
            parent.key_places[key] = self._key_places[-1]
            self._keys[-1] = _NONE


_NONE = object()


def read(path: str | Path, what: str, error: type[Delta3Error]) -> Any:
    """Return the document in ``path``; ``what`` ("program file") names it in the message of ``error``."""
    path = Path(path)
    try:
        whole_file.require_regular(path)
        with path.open('rb') as file:
            content = file.read(SIZE_MAX_BYTES + 1)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, 'strerror', None) or failure
        raise error(f'cannot read {what} {path}: {reason}') from failure
    if len(content) > SIZE_MAX_BYTES:
        raise error(f'{what} {path} is larger than {SIZE_MAX_BYTES // 1024**2} MiB')
    document = parse(content, what, error, str(path))
    if isinstance(document, (Fields, Items)):
        document.source = str(path)
    return document


def parse(content: bytes | str, what: str, error: type[Delta3Error], file: str = '') -> Any:
    """Return the document in a text; its mappings and lists know the positions of their values.

    The message of an error begins with ``file``, line and column, as far as they are known.
    """
    if len(content) > SIZE_MAX_BYTES:
        raise error(f'{what} is larger than {SIZE_MAX_BYTES // 1024**2} MiB')
    builder = _Builder()
    loader = event = None
    try:
        text = content.decode('utf-8-sig') if isinstance(content, bytes) else content
        loader = LOADER(text)
        while not isinstance(event := loader.get_event(), yaml.StreamEndEvent):
            builder.take(event)
    except _FAILURES as failure:
        place = _place_of(failure, content, event)
        where = f'line {place.line}, column {place.column}' if place else ''
        if file:
            where = f'{file}:{place.line}:{place.column}' if place else file
        raise error(
            f'{where}{where and ": "}{what} is not valid YAML: {_reason(failure, content)}'
        ) from failure
    finally:
        if loader is not None:
            loader.dispose()
    return builder.root


def _place_of(failure: Exception, content: bytes | str, event: Any) -> Place | None:
    """Return the position of a YAML error, None if it is unknown."""
    if isinstance(failure, yaml.MarkedYAMLError):
        mark = failure.problem_mark or failure.context_mark
        return _place(mark) if mark else None
    if isinstance(failure, UnicodeDecodeError):
        before = failure.object[: failure.start].decode(errors='replace')
    elif isinstance(failure, ReaderError):
        text = content if isinstance(content, str) else content.decode(errors='replace')
        if failure.encoding == 'unicode':  # the parser in Python counts characters, that in C bytes
            before = text[: failure.position]
        else:
            before = text.encode()[: failure.position].decode(errors='replace')
    else:
        return _place(event.start_mark) if event is not None else None
    return Place(before.count('\n') + 1, len(before) - before.rfind('\n'))


def _reason(failure: Exception, content: bytes | str) -> str:
    """Return the violated YAML rule in one line."""
    if isinstance(failure, UnicodeDecodeError):
        if isinstance(content, bytes) and content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return 'the encoding is UTF-16, but must be UTF-8'
        return f'the byte 0x{failure.object[failure.start]:02x} is not UTF-8'
    if isinstance(failure, yaml.MarkedYAMLError):
        parts = filter(None, (failure.context, failure.problem, failure.note))
        return ' '.join(', '.join(parts).split())
    if isinstance(failure, ReaderError):
        return f'the character U+{failure.character:04X} is not allowed'
    return ' '.join(str(failure).split()) or type(failure).__name__


def write(path: Path, document: Any, head: Iterable[str] = ()) -> None:
    """Write a document with the comment lines ``head`` at its top, atomically; raises OSError."""
    comments = ''.join(f'# {" ".join(line.split())}\n' for line in head)
    whole_file.write_text(comments + yaml.safe_dump(document, sort_keys=False), path)
