"""Tables as text: our own CSV, and what others write: semicolons, decimal commas, byte order marks, empty cells.

A line that begins with ``#`` is a comment; one that holds a JSON object tells the meta data of a trace. Then come the
headings, perhaps a row of units, and rows of numbers. The file is read in pieces, so that ten million rows need little
more memory than their numbers.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.column_file import Form
from delta3_pacdrive.recording.quantities import UNITS, unit_named
from delta3_pacdrive.recording.table import Table
from delta3_pacdrive.recording.trace import reason

SIZE_MAX_BYTES = 1 << 31
PIECE = 1 << 22  # characters that are read at once
LINE_MAX = 1 << 20  # characters of a line: longer ones are no table
MARKS = {b'\xef\xbb\xbf': 'utf-8-sig', b'\xff\xfe\x00\x00': 'utf-32', b'\x00\x00\xfe\xff': 'utf-32',
         b'\xff\xfe': 'utf-16', b'\xfe\xff': 'utf-16'}  # fmt: skip
OF_WINDOWS = 'cp1252'
# a cell that says that there is no number
NO_NUMBER = re.compile(r'(?<![^;,\t|\n])[ ]*(?:null|n/a|na|#n/a|-{1,3})[ ]*(?![^;,\t|\n])', re.IGNORECASE)
COMMENT = re.compile('^#.*', re.MULTILINE)
COMMA, POINT = ',', '.'


def read(path: Path, form: Form | None = None, words: Sequence[str] = (), what: str = 'trace') -> Table:
    """Read a table.

    Parameters
    ----------
    path, form
        Of the file; None: its form is found out.
    words
        Headings of columns that hold words instead of numbers.
    what
        The file is called when it cannot be read.

    Raises
    ------
    TraceError
        The file cannot be read, is no text, or a row holds something else than numbers; names the line.

    """
    try:
        whole_file.require_regular(path)
        if path.stat().st_size > SIZE_MAX_BYTES:
            raise TraceError(f'{path} is larger than {SIZE_MAX_BYTES >> 20} MiB')
        with path.open('rb') as stream:
            return _Reader(path, form or Form(), words).read(stream)
    except (OSError, UnicodeError, csv.Error) as error:
        raise TraceError(f'cannot read {what} {path}: {reason(error)}') from error


@dataclass
class _Reader:
    """The reader of one file: what it has found out about its form, and where it is."""

    path: Path
    form: Form
    words: Sequence[str] = ()
    separator: str = COMMA
    headings: list[str] = field(default_factory=list)
    meta: dict[str, Any] = field(default_factory=dict)
    line: int = 0  # the last one of what was read
    decimals: set[str] = field(default_factory=set)
    texts: dict[str, list[str]] = field(default_factory=dict)
    comments: list[str] = field(default_factory=list)

    def read(self, stream: IO[bytes]) -> Table:
        """Read the whole file, and close it."""
        encoding = self.form.encoding or self._encoding(stream)
        with io.TextIOWrapper(stream, encoding) as text:
            tables = [self._numbers(piece) for piece in self._behind_headings(self._pieces(text))]
        if not self.headings:
            raise TraceError(f'{self.path} is empty: it has no headings and no numbers')
        rows = [table for table in tables if len(table)]
        values = np.concatenate(rows) if rows else np.empty((0, len(self.headings)))
        named = len(self.headings)
        while named and not self.headings[named - 1] and np.isnan(values[:, named - 1]).all():
            named -= 1  # every line ends in a separator
        about = self.meta, self.texts, self.comments
        return Table(self.path, self.headings[:named], values[:, :named], *about)

    def _encoding(self, stream: IO[bytes]) -> str:
        begin = stream.read(1 << 16)
        stream.seek(0)
        for mark, encoding in MARKS.items():
            if begin.startswith(mark):
                return encoding
        if b'\0' in begin:
            raise TraceError(f'{self.path} is no text: it holds a zero byte, and no byte order mark')
        try:
            begin.decode('utf-8')
        except UnicodeDecodeError as error:
            if error.start < len(begin) - 4 or len(begin) < 1 << 16:  # else a character was cut in two
                return OF_WINDOWS
        return 'utf-8'

    def _pieces(self, text: IO[str]) -> Iterator[str]:
        """Yield the text in pieces of whole lines."""
        rest = ''
        while piece := text.read(PIECE):
            rest += piece
            cut = rest.rfind('\n') + 1
            if cut:
                yield rest[:cut]
                rest = rest[cut:]
            if len(rest) > LINE_MAX:
                raise TraceError(f'{self.path} is no table: a line has more than {LINE_MAX} characters')
        if rest:
            yield rest + '\n'

    def _behind_headings(self, pieces: Iterator[str]) -> Iterator[str]:
        """Read comments and headings, and pass on what stands behind them."""
        skip = self.form.skip_lines
        for piece in pieces:
            lines = piece.splitlines(keepends=True)
            for n, line in enumerate(lines):
                if skip:
                    skip -= 1
                elif line.startswith('#'):
                    self._comment(line)
                elif line.strip():
                    self.line += n + self.form.headings
                    behind = lines[n + self.form.headings :] or next(pieces, '').splitlines(keepends=True)
                    self._head(line, behind[0] if behind else '')
                    if self._units(behind):
                        self.line += 1
                        behind = behind[1:]
                    yield ''.join(behind)
                    yield from pieces
                    return
            self.line += len(lines)

    def _comment(self, line: str) -> None:
        text = line[1:].strip()
        if text.startswith('{'):
            try:
                self.meta.update(json.loads(text))
            except (ValueError, RecursionError):
                raise TraceError(f'the line of meta data in {self.path} is no JSON object') from None
        else:
            self.comments.append(text)

    def _head(self, line: str, below: str) -> None:
        """Find out the separator, and part the headings."""
        candidates = [mark for mark in (';', '\t', '|', ',') if mark in line]
        found = candidates or [mark for mark in (';', '\t', '|') if mark in below]
        self.separator = self.form.separator or (found or [COMMA])[0]
        cells = [cell.strip() for cell in next(csv.reader([line], delimiter=self.separator))]
        if self.form.headings:
            self.headings = cells
            if all(_is_number(cell) for cell in cells):
                raise TraceError(f'{self.path} begins with numbers, expected headings like time [s]')
        else:
            self.headings = [f'column {n}' for n in range(1, len(cells) + 1)]

    def _units(self, lines: list[str]) -> bool:
        """Take in a row of units below the headings; return whether there is one."""
        if not lines or not self.form.headings:
            return False
        cells = [cell.strip() for cell in next(csv.reader([lines[0]], delimiter=self.separator), [])]
        units = [unit_named(cell.removeprefix('[').removesuffix(']')) for cell in cells]
        if len(units) != len(self.headings) or not all(
            unit in UNITS or not heading or (heading in self.words and not unit)
            for unit, heading in zip(units, self.headings, strict=True)
        ):
            return False
        self.headings = [
            f'{name} [{unit}]' if unit else name for name, unit in zip(self.headings, units, strict=True)
        ]
        return True

    def _numbers(self, text: str) -> Floats:
        """Return the numbers of whole lines, nan where a cell is empty."""
        lines, first = text.count('\n'), self.line + 1
        self.line += lines
        text = COMMENT.sub('', text)
        if not text.strip():
            return np.empty((0, len(self.headings)))
        text = self._without_words(text)
        told = self._prepared(text)
        try:
            found = np.loadtxt(io.StringIO(told), delimiter=self.separator, comments=None, ndmin=2)
        except ValueError:
            told = NO_NUMBER.sub('nan', told)
            try:
                found = np.loadtxt(io.StringIO(told), delimiter=self.separator, comments=None, ndmin=2)
            except ValueError:
                self._refuse(told, text, first)
        if found.shape[1] != len(self.headings):
            self._refuse(told, text, first)
        return np.asarray(found, dtype=np.float64)

    def _without_words(self, text: str) -> str:
        """Keep the cells that hold words, and return the lines without them."""
        places = {n: name for n, name in enumerate(self.headings) if name in self.words}
        if not places:
            return text
        lines = []
        for line in text.splitlines():
            cells = next(csv.reader([line], delimiter=self.separator), [])
            if len(cells) == len(self.headings):
                for n, name in places.items():
                    self.texts.setdefault(name, []).append(cells[n].strip())
                    cells[n] = ''
            lines.append(self.separator.join(cells))
        return '\n'.join(lines) + '\n'

    def _prepared(self, text: str) -> str:
        """Return the text with decimal points, without quotes, and with nan in empty cells."""
        separator = self.separator
        text = text.replace('"', '').replace('\u202f', '').replace('\xa0', '')
        if separator != COMMA:
            self.decimals.update(mark for mark in (COMMA, POINT) if mark in text)
            if len(self.decimals) > 1:
                raise TraceError(
                    f'{self.path} holds commas and points in its numbers: nobody knows which of them part thousands'
                )
            if self.form.decimal and self.decimals - {self.form.decimal}:
                other = ''.join(self.decimals)
                raise TraceError(
                    f'{self.path} holds numbers with {shown(other)}, its column file says {shown(self.form.decimal)}'
                )
            if COMMA in self.decimals:
                text = text.replace(COMMA, POINT)
        mark = re.escape(separator)
        text = re.sub(f'(?<={mark})[ ]*(?={mark}|\n)', 'nan', text)
        return re.sub(f'^[ ]*(?={mark})', 'nan', text, flags=re.MULTILINE)

    def _refuse(self, told: str, text: str, first: int) -> None:
        """Refuse the first row that is none; raises TraceError."""
        number = first
        for line, own in zip(told.splitlines(), text.splitlines(), strict=True):
            cells = line.split(self.separator)
            if line.strip():
                if len(cells) != len(self.headings):
                    raise TraceError(
                        f'line {number} of {self.path} has {len(cells)} values, the header {len(self.headings)} columns'
                    )
                for cell, typed in zip(cells, own.split(self.separator), strict=False):
                    if not _is_number(cell):
                        raise TraceError(
                            f'line {number} of {self.path} holds {shown(typed)}, not only numbers'
                        )
            number += 1
        raise TraceError(f'{self.path} holds a row from line {first} on that is none of numbers')


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return '_' not in text
