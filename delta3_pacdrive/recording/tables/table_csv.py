"""Reader of text tables: own CSV and that of other tools, with semicolons, decimal commas, quotes, dates, empty cells.

A line beginning with ``#`` is a comment; a JSON object in it is the metadata of a trace. Headings, optionally a row of
units, and rows of numbers follow. Separator and headings are detected at the beginning of the file, outside quotes;
lines above the headings are a preamble. The file is read in pieces, so that ten million rows need little more memory
than their numbers.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO, Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.tables.column_file import Form
from delta3_pacdrive.recording.tables.quantities import UNITS, plain, split_heading, unit_named
from delta3_pacdrive.recording.tables.table import Table
from delta3_pacdrive.recording.tables.table_format import (
    BEGIN,
    COMMA,
    DATE,
    LINES_MAX,
    OF_WINDOWS,
    cells_of,
    columns_of,
    encoding_of,
    is_number,
    separator_of,
)
from delta3_pacdrive.recording.trace import reason

SIZE_MAX_BYTES = 1 << 31
PIECE = 1 << 22  # characters read at a time
LINE_MAX = 1 << 20  # characters of a line; longer lines are not a table
# cells that mark a missing number
NO_NUMBER = re.compile(
    r'(?<![^;,\t|\x1f\n])[ ]*(?:null|n/a|na|#n/a|-{1,3})[ ]*(?![^;,\t|\x1f\n])', re.IGNORECASE
)
COMMENT = re.compile('^#.*', re.MULTILINE)
POINT, QUOTE = '.', '"'
CELL_END = '\x1f'  # ASCII separator, for cells that contain other separators
NAMES_OF_TIME = ('time', 'timestamp', 'date', 'datetime')
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LONG_NUMBER = re.compile(r'-?\d{16,19}')  # nanoseconds since 1970, which exceed the precision of a float


def read(path: Path, form: Form | None = None, words: Sequence[str] = (), kind: str = 'trace') -> Table:
    """Read a table.

    Parameters
    ----------
    path, form
        File and its format; None: detected.
    words
        Headings of columns with words instead of numbers.
    kind
        Kind of file in error messages.

    Raises
    ------
    TraceError
        The file cannot be read, is not text, or a row contains something else than numbers; names the line.

    """
    form = form or Form()
    try:
        whole_file.require_regular(path)
        if path.stat().st_size > SIZE_MAX_BYTES:
            raise TraceError(f'{path} is larger than {SIZE_MAX_BYTES >> 20} MiB')
        try:
            with path.open('rb') as stream:
                return _Reader(path, form, words).read(stream)
        except UnicodeDecodeError as error:
            if form.encoding or error.encoding not in ('utf-8', 'utf8'):
                raise
            with path.open('rb') as stream:  # a Windows character after the part used for detection
                return _Reader(path, replace(form, encoding=OF_WINDOWS), words, assumed=True).read(stream)
    except (OSError, UnicodeError, csv.Error) as error:
        raise TraceError(f'cannot read {kind} {path}: {reason(error)}') from error


@dataclass
class _Reader:
    """Reader of one file with the detected format and its state."""

    path: Path
    form: Form
    words: Sequence[str] = ()
    assumed: bool = False  # whether the encoding is a guess
    separator: str = COMMA
    headings: list[str] = field(default_factory=list)
    meta: dict[str, Any] = field(default_factory=dict)
    unnamed: int | None = None  # index of the column without a heading, if rows are longer than the headings
    line: int = 0  # last line read
    decimals: set[str] = field(default_factory=set)
    texts: dict[str, list[str]] = field(default_factory=dict)
    comments: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    exact: dict[int, int] = field(
        default_factory=dict
    )  # first value [ns] of columns of dates and of long numbers

    def read(self, stream: IO[bytes]) -> Table:
        """Read the whole file and close it."""
        encoding = self.form.encoding or self._encoding(stream)
        if self.assumed:
            self.notices.append('Its text is not UTF-8; it is read as Windows-1252 (cp1252)')
        with io.TextIOWrapper(stream, encoding) as text:
            tables = [self._numbers(piece) for piece in self._below_headings(self._pieces(text))]
        if not self.headings:
            raise TraceError(f'{self.path} is empty: it has no headings and no numbers')
        rows = [table for table in tables if len(table)]
        values = np.concatenate(rows) if rows else np.empty((0, len(self.headings)))
        self._require_unnamed(values)
        kept = [n for n, heading in enumerate(self.headings) if heading]
        filled = [
            n for n, heading in enumerate(self.headings) if not heading and not np.isnan(values[:, n]).all()
        ]
        if filled:
            self.notices.append(
                f'Columns without a heading are left out: {", ".join(str(n + 1) for n in filled)}'
            )
        if self.notices:
            self.meta['notices'] = [*self.meta.get('notices', ()), *self.notices]
        return Table(
            path=self.path,
            headings=[self.headings[n] for n in kept],
            values=values[:, kept],
            meta=self.meta,
            texts=self.texts,
            comments=self.comments,
        )

    def _require_unnamed(self, values: Floats) -> None:
        """Raise TraceError if an extra column is neither an index at the beginning nor empty at the end."""
        if self.unnamed is None:
            return
        column = values[:, self.unnamed]
        if self.unnamed:
            wrong, rule = ~np.isnan(column), 'a value after the last column with a heading'
        else:
            wrong = ~np.concatenate([[True], np.diff(column) > 0.0])
            rule = 'a first value without a heading that is not an increasing index'
        if wrong.any():
            raise TraceError(f'row {int(np.argmax(wrong)) + 1} of {self.path} has {rule}')

    def _encoding(self, stream: IO[bytes]) -> str:
        begin = stream.read(BEGIN)
        stream.seek(0)
        found = encoding_of(begin)
        if not found:
            raise TraceError(f'{self.path} is not text: it contains a zero byte, but no byte order mark')
        self.assumed = found == OF_WINDOWS
        return found

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
                raise TraceError(f'{self.path} is not a table: a line has more than {LINE_MAX} characters')
        if rest:
            yield rest + '\n'

    def _below_headings(self, pieces: Iterator[str]) -> Iterator[str]:
        """Parse comments, preamble and headings, and yield the text below them."""
        begin = ''
        for piece in pieces:
            begin += piece
            if len(begin) >= BEGIN:
                break
        lines, skip = list(io.StringIO(begin)), self.form.skip_lines
        table = [n for n, line in enumerate(lines) if n >= skip and line.strip() and line[0] != '#']
        first = len(lines)
        if table:
            self.separator, index = separator_of([lines[n] for n in table[:LINES_MAX]], self.form)
            first = table[index]
        if table and first != table[0]:
            self.notices.append(
                f'Lines 1 to {first} are left out as a preamble; the headings are in line {first + 1}'
            )
        for line in lines[skip:first]:
            if line[0] == '#':
                self._comment(line)
        if not table:
            return
        self.line = first + self.form.headings
        self._head(lines[first], lines[self.line :])
        self.line += self._units(lines[self.line :])
        self._find_exact(lines[self.line :])
        yield ''.join(lines[self.line :])
        yield from pieces

    def _comment(self, line: str) -> None:
        text = line[1:].strip()
        if text.startswith('{'):
            try:
                self.meta.update(json.loads(text))
            except (ValueError, RecursionError):
                raise TraceError(f'the line of metadata in {self.path} is not a JSON object') from None
        else:
            self.comments.append(text)

    def _head(self, line: str, below: Sequence[str]) -> None:
        """Parse the headings."""
        cells = cells_of(line, self.separator)
        if not self.form.headings:
            self.headings = [f'column {n}' for n in range(1, len(cells) + 1)]
            return
        if all(is_number(cell) for cell in cells):
            raise TraceError(f'{self.path} begins with numbers, expected headings like time [s]')
        rows = [
            cells_of(text, self.separator) for text in below[:LINES_MAX] if text.strip() and text[0] != '#'
        ]
        self.headings = columns_of(cells, rows)
        if len(self.headings) > len(cells):
            self.unnamed = 0 if self.headings[-1] else len(cells)

    def _find_exact(self, lines: Sequence[str]) -> None:
        """Find columns of dates and of long numbers, which are converted to offsets from their first value."""
        row = next((line for line in lines if line.strip() and line[0] != '#'), '')
        for n, cell in enumerate(cells_of(row, self.separator)[: len(self.headings)]):
            name, unit = split_heading(self.headings[n])
            if DATE.fullmatch(cell):
                if unit is None and plain(name) in NAMES_OF_TIME:
                    self.headings[n] = 'time [s]'
            elif not LONG_NUMBER.fullmatch(cell) or UNITS.get(unit or 's', ('', 0.0))[0] != 's':
                continue
            self.exact[n] = _exact(cell)
            self.notices.append(f'Times count from {cell}')

    def _units(self, lines: list[str]) -> bool:
        """Parse a row of units below the headings; return whether it exists."""
        if not lines or not self.form.headings:
            return False
        cells = cells_of(lines[0], self.separator)
        if self.unnamed is not None and len(cells) < len(self.headings):
            cells.insert(self.unnamed, '')
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
        """Return the numbers of whole lines, nan in empty cells."""
        lines, first = text.count('\n'), self.line + 1
        self.line += lines
        text = COMMENT.sub('', text)
        if not text.strip():
            return np.empty((0, len(self.headings)))
        text, mark = self._plain(text, first)
        prepared = self._prepared(text, mark)
        try:
            found = np.loadtxt(io.StringIO(prepared), delimiter=mark, comments=None, ndmin=2)
        except ValueError:
            prepared = NO_NUMBER.sub('nan', prepared)
            try:
                found = np.loadtxt(io.StringIO(prepared), delimiter=mark, comments=None, ndmin=2)
            except ValueError:
                self._reject(prepared, text, first, mark)
        if found.shape[1] != len(self.headings):
            self._reject(prepared, text, first, mark)
        found = np.asarray(found, dtype=np.float64)
        for n, values in self._exact_values.items():
            found[:, n] = values
        return found

    def _plain(self, text: str, first: int) -> tuple[str, str]:
        """Return lines without quotes, words, dates and long numbers, and the separator of their cells."""
        words = {n: name for n, name in enumerate(self.headings) if name in self.words}
        self._exact_values: dict[int, list[float]] = {n: [] for n in self.exact}
        if not words and not self.exact and (QUOTE not in text):
            return text, self.separator
        lines = []
        for number, line in enumerate(text.split('\n')[:-1], start=first):
            cells = cells_of(line, self.separator) if line.strip() else []
            if len(cells) == len(self.headings) or (cells and not any(cells[len(self.headings) :])):
                for n, name in words.items():
                    self.texts.setdefault(name, []).append(cells[n])
                    cells[n] = ''
                for n, begin in self.exact.items():
                    self._exact_values[n].append(self._since(cells[n], begin, number))
                    cells[n] = ''
            lines.append(CELL_END.join(cells))
        return '\n'.join(lines) + '\n', CELL_END

    def _since(self, cell: str, begin: int, number: int) -> float:
        """Return the time since the first one, nan for an empty cell; raises TraceError."""
        if not cell:
            return math.nan
        try:
            passed = _exact(cell) - begin
        except ValueError:
            raise TraceError(
                f'line {number} of {self.path} contains {shown(cell)}, expected a time like 2026-11-20 10:11:12.500 '
                'or a whole number, as in the first row'
            ) from None
        return passed * 1e-9 if DATE.fullmatch(cell) else float(passed)

    def _prepared(self, text: str, separator: str) -> str:
        """Return the text with decimal points, and with nan in empty cells."""
        text = text.replace('\u202f', '').replace('\xa0', '')
        if separator != COMMA:
            self.decimals.update(mark for mark in (COMMA, POINT) if mark in text)
            if len(self.decimals) > 1:
                raise TraceError(
                    f'{self.path} contains numbers with commas and points: the thousands separator is ambiguous'
                )
            if self.form.decimal and self.decimals - {self.form.decimal}:
                other = ''.join(self.decimals)
                raise TraceError(
                    f'{self.path} contains numbers with {shown(other)}, its column file has {shown(self.form.decimal)}'
                )
            if COMMA in self.decimals:
                text = text.replace(COMMA, POINT)
        mark = re.escape(separator)
        text = re.sub(f'(?<={mark})[ ]*(?={mark}|\n)', 'nan', text)
        return re.sub(f'^[ ]*(?={mark})', 'nan', text, flags=re.MULTILINE)

    def _reject(self, prepared: str, text: str, first: int, mark: str) -> None:
        """Raise TraceError for the first row that does not consist of numbers."""
        number = first
        for line, own in zip(prepared.splitlines(), text.splitlines(), strict=True):
            cells = line.split(mark)
            if line.strip():
                if len(cells) != len(self.headings):
                    raise TraceError(
                        f'line {number} of {self.path} has {len(cells)} values, the header {len(self.headings)} columns'
                    )
                for cell, typed in zip(cells, own.split(mark), strict=False):
                    if not is_number(cell):
                        raise TraceError(
                            f'line {number} of {self.path} contains {shown(typed)}, not only numbers'
                        )
            number += 1
        raise TraceError(f'{self.path} has a row from line {first} on that does not consist of numbers')


def _exact(text: str) -> int:
    """Return an integer, or the nanoseconds of a date; raises ValueError."""
    found = DATE.fullmatch(text)
    if not found:
        return int(text)
    numbers = [int(number or 0) for number in found.groups()[:6]]
    whole = datetime(*numbers, tzinfo=UTC) - EPOCH  # type: ignore[arg-type, misc]
    zone = found[8] or 'Z'
    if zone != 'Z':
        minutes = int(zone[1:3]) * 60 + int(zone[-2:])
        whole -= timedelta(minutes=minutes if zone[0] == '+' else -minutes)
    return whole // timedelta(seconds=1) * 10**9 + int((found[7] or '').ljust(9, '0'))
