"""Format detection for text tables: encoding, separator, line of the headings, columns without a heading.

Everything is detected from the cells at the beginning of the file.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from delta3_pacdrive.recording.tables.quantities import UNITS, unit_named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from delta3_pacdrive.recording.tables.column_file import Form

COMMA, TAB = ',', '\t'
BEGIN = 1 << 16  # characters used for detection
LINES_MAX = 400  # lines used for detection
MARKS = {b'\xef\xbb\xbf': 'utf-8-sig', b'\xff\xfe\x00\x00': 'utf-32', b'\x00\x00\xfe\xff': 'utf-32',
         b'\xff\xfe': 'utf-16', b'\xfe\xff': 'utf-16'}  # fmt: skip
OF_WINDOWS = 'cp1252'
WORDY = 0.5  # largest share of numbers in a row of words
SEPARATORS = (';', TAB, '|', COMMA)
DATE = re.compile(
    r'(\d{4})-(\d\d)-(\d\d)[T ](\d\d):(\d\d)(?::(\d\d)(?:[.,](\d{1,9}))?)?\s*(Z|[+-]\d\d:?\d\d)?'
)  # ISO 8601
NUMBER = re.compile(
    r'[-+]?(\d+[.,]?\d*|[.,]\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)|null|n/a|na|#n/a|-{0,3}', re.IGNORECASE
)


def encoding_of(begin: bytes) -> str:
    """Return the encoding of a text from its first bytes, UTF-16 also without a mark; '' if it is not text."""
    for mark, encoding in MARKS.items():
        if begin.startswith(mark):
            return encoding
    if b'\0' in begin:
        zeros = [begin[n::2].count(0) for n in (0, 1)]
        if min(zeros) == 0 and max(zeros) > 0.9 * (len(begin) // 2):  # ASCII characters
            return 'utf-16-be' if zeros[0] else 'utf-16-le'
        return ''
    try:
        begin.decode('utf-8')
    except UnicodeDecodeError as error:
        if error.start < len(begin) - 4 or len(begin) < BEGIN:  # not just a character cut at the end
            return OF_WINDOWS
    return 'utf-8'


def separator_of(lines: Sequence[str], form: Form) -> tuple[str, int]:
    """Return the separator of lines and the index of the line with the headings."""
    rows_by = {mark: [cells_of(line, mark) for line in lines] for mark in SEPARATORS}
    scores = {mark: _score(rows) for mark, rows in rows_by.items()}
    separator = form.separator or max(SEPARATORS, key=lambda mark: (scores[mark], len(rows_by[mark][0])))
    rows = rows_by[separator]
    usual = _usual(rows)[0]
    numbers = next((n for n, row in enumerate(rows) if len(row) == usual and _numeric(row) > WORDY), 0)
    begins_with_table = len(rows[0]) in (usual, usual - 1) and usual > 2
    if begins_with_table or not numbers or form.skip_lines or not form.headings:
        return separator, 0
    above = numbers - 1
    return separator, above - (above > 0 and are_units(rows[above]))


def columns_of(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a heading for each column of the rows, '' for one without a heading.

    Rows that are one longer than the headings end with a separator, or begin with an index. A separator at the end
    leaves the last cell of every row empty; an index counts upwards.
    """
    if rows and are_units(rows[0]):
        rows = rows[1:]
    if not rows or not all(headings) or any(len(row) != len(headings) + 1 for row in rows):
        return list(headings)
    if not any(row[-1] for row in rows):
        return [*headings, '']
    counts = [int(row[0]) for row in rows if row[0].isdecimal()]
    is_index = len(counts) == len(rows) and all(a < b for a, b in pairwise(counts))
    return ['', *headings] if is_index else list(headings)


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a row contains units."""
    return any(cells) and all(unit_named(cell.strip(' []')) in UNITS for cell in cells if cell)


def is_number(text: str) -> bool:
    """Return whether a cell is a number in the syntax of Python."""
    try:
        float(text)
    except ValueError:
        return False
    return '_' not in text


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without surrounding blanks."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _usual(rows: Sequence[Sequence[str]]) -> tuple[int, int]:
    """Return the most frequent number of cells in the later rows, and its frequency."""
    later = rows[len(rows) // 2 :]
    return Counter(map(len, later)).most_common(1)[0] if later else (0, 0)


def _score(rows: Sequence[Sequence[str]]) -> float:
    """Return how much rows resemble a table, from 0 to 1: rows of equal length with numbers."""
    later = rows[len(rows) // 2 :]
    usual, often = _usual(rows)
    if usual < 2:
        return 0.0
    return often / len(later) * sum(_numeric(row) for row in later if len(row) == usual) / often


def _numeric(row: Sequence[str]) -> float:
    """Return the share of cells that are numbers, dates or empty."""
    return sum(bool(NUMBER.fullmatch(cell) or DATE.fullmatch(cell)) for cell in row) / max(len(row), 1)
