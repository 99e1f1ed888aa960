"""One way to leave results behind: a folder of tables, figures and a summary, and a page that shows all of them.

Every file tells where it comes from. The page (``index_page``) holds pictures and tables itself, so that it can be sent
alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive import whole_file
from delta3_pacdrive.analysis.figure_style import add_foot, save
from delta3_pacdrive.analysis.index_page import IndexPage, offered
from delta3_pacdrive.analysis.provenance import (
    Provenance,
    json_text,
    os_errors_as,
    write_json,
    write_table,
    write_text,
)
from delta3_pacdrive.errors import FigureError, ReportError
from delta3_pacdrive.numerics.types import Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Drawings = Mapping[str, Callable[[], 'Figure']]

SUMMARY, INDEX = 'report.json', 'index.html'


@dataclass(frozen=True)
class Table:
    """A table is written as CSV; a cell without a value, None or nan, stays empty.

    Attributes
    ----------
    name
        Of the file.
    header
        Names of the columns, with units.
    rows
        Numbers and texts.

    """

    name: str
    header: Sequence[str]
    rows: Iterable[Sequence[Any]]

    @staticmethod
    def of_columns(name: str, columns: Mapping[str, ArrayLike]) -> Table:
        """Return the table of these columns of numbers, each of shape (n,)."""
        return Table(name, list(columns), np.column_stack(list(columns.values())).tolist())

    @staticmethod
    def of_rows(name: str, rows: Sequence[Mapping[str, Any]]) -> Table:
        """Return the table of rows whose cells are known by the names of the columns; one row at least."""
        return Table(name, list(rows[0]), [list(row.values()) for row in rows])


def columns_of(title: str, values: Floats, labels: Iterable[str] = '123') -> dict[str, Floats]:
    """Return the columns of an array by title, each with its label in the place of ``{}``."""
    return {title.format(label): column for label, column in zip(labels, values.T, strict=True)}


class ReportFolder:
    """A report folder takes the results of one command.

    Attributes
    ----------
    path
        Of the folder, which is made when the first file is written.
    provenance
        That goes into every file.

    """

    def __init__(self, path: Path, provenance: Provenance) -> None:
        self.path, self.provenance = path, provenance
        self._files: list[Path] = []
        self._page = IndexPage()

    @property
    def files(self) -> list[str]:
        """The page, and what was written so far."""
        return [str(path) for path in (self.path / INDEX, *self._files)]

    def add(self, path: Path) -> None:
        """Take in a file of the folder that somebody else has written."""
        self._files.append(path)
        self._page.add_file(path)

    def table(self, table: Table) -> Path:
        """Write a table as CSV; raises ReportError."""
        rows = [['' if cell is None or cell != cell else cell for cell in row] for row in table.rows]
        path = write_table(self.path / table.name, table.header, rows, self.provenance)
        self._files.append(path)
        self._page.add_table(path, table.header, rows)
        return path

    def figures(self, drawings: Drawings, with_foot: bool = False) -> list[Path]:
        """Draw figures, by file name, and write them as PNG; raises FigureError.

        The summary line of the function that draws a figure is its caption; ``with_foot`` it also tells its origin.
        """
        paths = []
        for name, draw in drawings.items():
            path, figure = self.path / name, draw()
            if with_foot:
                add_foot(figure, self.provenance)
            with os_errors_as(f'cannot write figures to {self.path}', FigureError):
                self.path.mkdir(parents=True, exist_ok=True)
                save(figure, path, self.provenance.lines())
            paths.append(path)
            self._page.add_figure(path, _title(figure), _caption(draw))
        self._files += paths
        return paths

    def results(
        self,
        title: str,
        document: dict[str, Any],
        text: Iterable[str],
        tables: Iterable[Table],
        drawings: Drawings,
    ) -> dict[str, Any]:
        """Write tables and figures of a study, and at last its summary, as ``summary`` does; raises Delta3Error."""
        for table in tables:
            self.table(table)
        self.figures(drawings, with_foot=True)
        return self.summary(title, document, text)

    def summary(self, title: str, document: dict[str, Any], text: Iterable[str]) -> dict[str, Any]:
        """Write the summary and the page, at last; return the summary, which then names all files; raises ReportError.

        Parameters
        ----------
        title
            Of the page.
        document
            The results, ready for JSON, without their provenance.
        text
            The same in lines for people.

        """
        path = self.path / SUMMARY
        origin = {'ok': True, 'provenance': self.provenance.lines()}
        document = origin | document | {'files': [str(path), *self.files]}
        self.page(title, text, offered(path, json_text(document).encode()))
        write_json(document, path)  # the last of all: who finds it finds everything
        return document

    def page(self, title: str, text: Iterable[str] = (), more: str = '') -> None:
        """Write the page that shows what is in the folder; raises ReportError."""
        told = '\n'.join(text).strip('\n')
        whole = self._page.html(title, self.provenance.lines(), told, more)
        self.make()
        write_text(whole, self.path / INDEX)

    def make(self) -> None:
        """Make the folder before anything is computed for it; raises ReportError."""
        with os_errors_as(f'cannot write to {self.path}'):
            self.path.mkdir(parents=True, exist_ok=True)

    def clear(self, patterns: Iterable[str]) -> None:
        """Remove what an earlier command left, so that nothing looks complete; raises ReportError."""
        with os_errors_as(f'cannot write to {self.path}'):
            for pattern in (SUMMARY, INDEX, *patterns):
                for path in self.path.glob(pattern):
                    path.unlink()


def require_writable_folder(folder: str | Path | None) -> None:
    """Refuse a folder that nothing can be written into, before anything is computed for it; raises ReportError."""
    if folder is not None and (why := whole_file.folder_refusal(Path(folder))):
        raise ReportError(f'cannot write to {folder}: {why}')


def _title(figure: Figure) -> str:
    """Return the title of a figure without the marks of its formulas."""
    text = re.sub(r'\$(.*?)\$', lambda found: re.sub(r'\\mathrm|[{}\\]', '', found[1]), figure.get_suptitle())
    return text.strip().rstrip('.') + '.' if text.strip() else ''


def _caption(draw: Any) -> str:
    while isinstance(draw, partial):
        draw = draw.func
    return (draw.__doc__ or '').partition('\n')[0]
