"""Reads cells of tables by heading, numbers of lines of text, and curves of figures.

``report_contents``, ``series_contents`` and ``text_contents`` declare which number of the summary belongs in which cell
and in which line, ``place_figures.CONTENTS`` which signals are the curves of a figure. ``reading`` checks every report
that a test writes.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from unittest import mock

import numpy as np

from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from figures_read import function_of, name_of, read_figure
from place_figures import CONTENTS
from report_contents import TABLES
from series_contents import series_of
from text_contents import LINES

NUMBER = re.compile(r'(?<![\w.^])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)')


def read(summary, text, tables):
    """Compare tables and text of a study with its summary."""
    lines = [' '.join(line.split()) for line in text]
    for table in tables:
        if expected := TABLES.get(table.name):
            read_table(table, expected(summary))
        else:
            read_series(table, summary)
        for words, values in LINES.get(table.name, lambda _: ())(summary):
            read_line(lines, words, values)


def read_table(table, expected):
    """Compare the cells of a table with the values expected under its headings, in the order of the columns."""
    rows = list(table.rows)
    assert len(rows) == len(expected), table.name
    for row, wanted in zip(rows, expected, strict=True):
        cells = zip(table.header, row, strict=True)
        for heading, value in wanted:
            # each search continues after the column found before: a heading may occur twice
            cell = next((cell for title, cell in cells if title == heading), KeyError)
            assert same(cell, value), f'{table.name}, {heading}: {cell}, the summary has {value}'


def read_series(table, summary):
    """Compare values computed from the columns of a table of samples with the summary."""
    make = series_of(table.name)
    assert make is not None, f'nothing declares the contents of {table.name}'
    columns = {}
    for n, title in enumerate(table.header):
        values = [row[n] for row in table.rows]
        columns[title] = np.array(values) if all(isinstance(one, int | float) for one in values) else values
    for what, found, expected, tolerance in make(summary, columns, table.name):
        near = abs(found - expected) <= tolerance * abs(expected)
        assert near, f'{table.name}, {what}: {found}, the summary has {expected}'


def same(cell, value):
    """Return whether a cell holds a value; texts of numbers hold their digits, an empty cell holds None."""
    if value is None or value != value:
        return cell is None or cell == '' or cell != cell
    if isinstance(cell, str) and not isinstance(value, str):
        return agrees(cell, value)
    return cell == value


def read_line(lines, words, values):
    """Require a line with these words and with other numbers that agree with the values in all printed digits."""
    found = [line for line in lines if words in line]
    assert found, f'no line with {words!r}'
    if values is not None:
        others = [NUMBER.findall(line.replace(words, ' ', 1)) for line in found]
        assert any(len(texts) >= len(values) and all(map(agrees, texts, values)) for texts in others), (
            f'{found}: the summary has {values} in the line {words!r}'
        )


def agrees(text, value):
    """Return whether a printed number is the value, rounded to the digits that are printed."""
    digits, _, exponent = text.partition('e')
    unit = 10.0 ** (int(exponent or 0) - len(digits.partition('.')[2]))
    # %g drops zeros behind whole numbers of more than its digits, and rounds large ones
    return abs(float(text) - value) <= 0.501 * unit + 1e-9 * abs(value)


def curves(figure):
    """Return the values of all curves of a figure by title, label of the vertical axis, and label of the curve."""
    return {
        (
            axes.get_title('left') or axes.get_title(),
            axes.get_ylabel(),
            str(line.get_label()),
        ): line.get_ydata()
        for axes in figure.axes
        for line in axes.get_lines()
    }


@contextmanager
def reading() -> Iterator[None]:
    """Read every report of a study that is written meanwhile."""
    results, figures = ReportFolder.results, ReportFolder.figures

    def read_results(folder, title, document, text, tables, drawings):
        text, tables = list(text), [replace(table, rows=list(table.rows)) for table in tables]
        read(document, text, tables)
        return results(folder, title, document, text, tables, drawings)

    def read_figures(folder, drawings, with_foot=False):
        return figures(folder, {name: _read(draw) for name, draw in drawings.items()}, with_foot)

    with mock.patch.multiple(ReportFolder, results=read_results, figures=read_figures):
        yield


def read_drawing(draw):
    """Draw a figure and compare it with its signals; return the figure."""
    function, arguments, named = function_of(draw)
    figure = draw()
    if not function.__module__.startswith('delta3_pacdrive.'):
        return figure  # of a test
    read_figure(figure, *CONTENTS[name_of(function)](*arguments, **named))
    return figure


def _read(draw):
    def drawn():
        return read_drawing(draw)

    drawn.__doc__ = function_of(draw)[0].__doc__  # the caption
    drawn.__wrapped__ = draw
    return drawn
