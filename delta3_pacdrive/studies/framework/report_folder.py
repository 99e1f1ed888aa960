"""Report folder: tables, figures and a summary of a command, and a page that shows them.

Every file contains its provenance.
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

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import FigureError, ReportError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.framework.figure_style import add_foot, save
from delta3_pacdrive.studies.framework.index_page import IndexPage, download_link
from delta3_pacdrive.studies.framework.provenance import (
    Provenance,
    json_text,
    os_errors_as,
    write_json,
    write_table,
    write_text,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Drawings = Mapping[str, Callable[[], 'Figure']]

SUMMARY, INDEX = 'report.json', 'index.html'


@dataclass(frozen=True)
class Table:
    """Table written as CSV; cells that are None or nan stay empty."""

    name: str  # of the file
    header: Sequence[str]  # column names with units
    rows: Iterable[Sequence[Any]]

    @staticmethod
    def of_columns(name: str, columns: Mapping[str, ArrayLike]) -> Table:
        """Return a table of numeric columns, each of shape (n,)."""
        return Table(name, list(columns), np.column_stack(list(columns.values())).tolist())

    @staticmethod
    def of_rows(name: str, rows: Sequence[Mapping[str, Any]]) -> Table:
        """Return a table of one or more rows, each a mapping of column names to cells."""
        return Table(name, list(rows[0]), [list(row.values()) for row in rows])


def columns_of(title: str, values: Floats, labels: Iterable[str] = '123') -> dict[str, Floats]:
    """Return the columns of an array by title; ``{}`` in the title is replaced by the label."""
    return {title.format(label): column for label, column in zip(labels, values.T, strict=True)}


class ReportFolder:
    """Writes the results of one command.

    Attributes
    ----------
    path
        Folder; created with the first file.
    provenance
        Written into every file.

    """

    def __init__(self, path: Path, provenance: Provenance) -> None:
        self.path, self.provenance = path, provenance
        self._files: list[Path] = []
        self._page = IndexPage()

    @property
    def files(self) -> list[str]:
        """The page and all files written so far."""
        return [str(path) for path in (self.path / INDEX, *self._files)]

    def add(self, path: Path) -> None:
        """Add a file that was written elsewhere into the folder."""
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
        """Draw figures, given by file name, and write them as PNG; raises FigureError.

        The caption is the summary line of the drawing function. ``with_foot`` adds the provenance to the image.
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
        """Write tables, figures and finally the summary of a study, which is returned; raises Delta3Error."""
        for table in tables:
            self.table(table)
        self.figures(drawings, with_foot=True)
        return self.summary(title, document, text)

    def summary(self, title: str, document: dict[str, Any], text: Iterable[str]) -> dict[str, Any]:
        """Write the page and the summary, and return the summary, which lists all files; raises ReportError.

        ``document`` contains the results without provenance, ready for JSON; ``text`` the same as lines.
        """
        path = self.path / SUMMARY
        origin = {'ok': True, 'provenance': self.provenance.lines()}
        document = origin | document | {'files': [str(path), *self.files]}
        self.page(title, text, download_link(path, json_text(document).encode()))
        write_json(document, path)  # last: its presence means that the folder is complete
        return document

    def page(self, title: str, text: Iterable[str] = (), more: str = '') -> None:
        """Write the page of the folder; raises ReportError."""
        html = self._page.html(title, self.provenance.lines(), '\n'.join(text).strip('\n'), more)
        self.make()
        write_text(html, self.path / INDEX)

    def make(self) -> None:
        """Create the folder, before anything is computed; raises ReportError."""
        with os_errors_as(f'cannot write to {self.path}'):
            self.path.mkdir(parents=True, exist_ok=True)

    def clear(self, patterns: Iterable[str]) -> None:
        """Remove the files of an earlier command, so that the folder does not look complete; raises ReportError."""
        with os_errors_as(f'cannot write to {self.path}'):
            for pattern in (SUMMARY, INDEX, *patterns):
                for path in self.path.glob(pattern):
                    path.unlink()


def require_writable_folder(folder: str | Path | None) -> None:
    """Reject a folder that cannot be written, before anything is computed; raises ReportError."""
    if folder is not None and (why := whole_file.folder_refusal(Path(folder))):
        raise ReportError(f'cannot write to {folder}: {why}')


def _title(figure: Figure) -> str:
    """Return the title of a figure without TeX markup."""
    text = re.sub(r'\$(.*?)\$', lambda found: re.sub(r'\\mathrm|[{}\\]', '', found[1]), figure.get_suptitle())
    return text.strip().rstrip('.') + '.' if text.strip() else ''


def _caption(draw: Any) -> str:
    while isinstance(draw, partial):
        draw = draw.func
    return (draw.__doc__ or '').partition('\n')[0]
