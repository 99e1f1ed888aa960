"""Read reports as people do: cells of tables by heading and numbers of lines of text, against the summary.

``report_contents`` declares which number of the summary belongs in which cell and in which line. ``reading`` checks
every report that a test writes.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from unittest import mock

from delta3_pacdrive.analysis.report_folder import ReportFolder
from report_contents import LINES, SERIES, TABLES

NUMBER = re.compile(r'(?<![\w.^])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\d)')


def read(summary, text, tables):
    """Compare tables and text of a study with its summary."""
    lines = [' '.join(line.split()) for line in text]
    for table in tables:
        assert table.name in TABLES or SERIES.fullmatch(table.name), f'{table.name} is not in TABLES'
        if expected := TABLES.get(table.name):
            read_table(table, expected(summary))
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


def same(cell, value):
    """Return whether a cell holds a value; texts of numbers hold their digits, an empty cell holds None."""
    if value is None or value != value:
        return cell is None or cell == '' or cell != cell
    if isinstance(cell, str) and not isinstance(value, str):
        return agrees(cell, value)
    return cell == value


def read_line(lines, words, values):
    """Require a line with these words, whose other numbers begin with the values, as far as their digits go."""
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


UNITS = r'%|[num]?m|m?s|m?deg|m?rad|k?g|[AV]|Hz|dB|N m|rpm|bits|(?:m|deg|rad)/s\S*'
ROUND = re.compile(rf'\((?:[\d.e-]+ )?(?:{UNITS})\)')


def read_figure(figure):
    """Require a title, no unit in round brackets in the label of an axis, and a curve for each entry of a legend."""
    titles = [
        figure.get_suptitle(),
        *(axes.get_title(at) for axes in figure.axes for at in ('left', 'center')),
    ]
    assert any(map(str.strip, titles)), 'a figure has no title'
    curves = {name for axes in figure.axes for name in axes.get_legend_handles_labels()[1]}
    for axes in figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert not ROUND.search(label), f'{label}: units are in square brackets'
        if legend := axes.get_legend():
            unknown = {text.get_text() for text in legend.get_texts()} - curves
            assert not unknown, f'{titles}: no curve has the label {unknown}'


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
        return figures(folder, {name: _read_drawing(draw) for name, draw in drawings.items()}, with_foot)

    with mock.patch.multiple(ReportFolder, results=read_results, figures=read_figures):
        yield


def _read_drawing(draw):
    def drawn():
        figure = draw()
        read_figure(figure)
        return figure

    function = draw
    while isinstance(function, partial):
        function = function.func
    drawn.__doc__ = function.__doc__  # the caption
    return drawn
