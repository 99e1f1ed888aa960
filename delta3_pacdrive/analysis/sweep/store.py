"""What a sweep has done so far, in a folder: parts of its table that are there whole or not at all.

``sweep.json`` tells which sweep it is. A part ``part_00000001.parquet`` holds the rows of a batch, by its first run.
At the end ``runs.parquet`` and ``runs.csv`` hold all of them, sorted by their numbers, and the parts are gone.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from delta3_pacdrive import whole_file
from delta3_pacdrive.analysis.provenance import versions
from delta3_pacdrive.analysis.sweep.design import Sweep
from delta3_pacdrive.errors import SweepError

TABLE, MANIFEST, PARTS = 'runs.parquet', 'sweep.json', 'part_*.parquet'
NEEDED = "sweeps need dask, distributed and pyarrow: pip install 'delta3_pacdrive[sweep]'"
Row = dict[str, Any]


class Store:
    """The store of a sweep.

    Parameters
    ----------
    folder
        Where it is.
    sweep
        Which one it is.

    """

    def __init__(self, folder: Path, sweep: Sweep) -> None:
        self._folder, self._sweep = folder, sweep

    def open(self) -> dict[int, Row]:
        """Return the rows that are there, by the numbers of their runs.

        Raises
        ------
        SweepError
            The folder holds another sweep, or this one of other sources; or it cannot be read or written.

        """
        import pyarrow.parquet as parquet

        told = {
            'name': self._sweep.name,
            'runs': self._sweep.runs,
            'digest': self._sweep.digest,
            'made_by': versions(),
        }
        manifest = self._folder / MANIFEST
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if manifest.exists():
                self._require_same(json.loads(manifest.read_text(encoding='utf-8')), told)
            else:
                left = [
                    path.name for path in (self._folder / TABLE, *self._folder.glob(PARTS)) if path.exists()
                ]
                if left:
                    raise SweepError(f'{self._folder} holds {left[0]}, but does not tell of which sweep')
                with whole_file.atomic_path(manifest) as path:
                    path.write_text(json.dumps(told, indent=1), encoding='utf-8')
            paths = [
                path for path in (self._folder / TABLE, *sorted(self._folder.glob(PARTS))) if path.exists()
            ]
            rows = [row for path in paths for row in parquet.read_table(path).to_pylist()]
        except SweepError:
            raise
        except (OSError, ValueError) as error:
            raise SweepError(f'cannot keep a sweep in {self._folder}: {error}') from error
        return {row['run']: row for row in rows}

    def _require_same(self, there: Any, told: dict[str, Any]) -> None:
        if not isinstance(there, dict) or there.get('digest') != told['digest']:
            what = f'sweep {there.get("name")}' if isinstance(there, dict) else 'something else'
            raise SweepError(
                f'{self._folder} holds {what}, which is another one, or of other sources: choose another --output, or '
                'remove the folder'
            )

    def add(self, rows: Sequence[Row]) -> None:
        """Keep the rows of a batch; raises SweepError."""
        self._write(rows, self._folder / f'part_{rows[0]["run"]:08d}.parquet')

    def finish(self, rows: Iterable[Row]) -> Path:
        """Put all rows together, sorted by their runs; return the path of the table; raises SweepError."""
        path = self._folder / TABLE
        self._write(sorted(rows, key=lambda row: row['run']), path)
        for part in self._folder.glob(PARTS):
            part.unlink(missing_ok=True)
        return path

    def _write(self, rows: Sequence[Row], path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as parquet

        names = dict.fromkeys(name for row in rows for name in row)
        columns = {name: pa.array([row.get(name) for row in rows], _kind(pa, name, rows)) for name in names}
        table = pa.table(columns)
        try:
            with whole_file.atomic_path(path) as unfinished:
                parquet.write_table(table, unfinished)
        except OSError as error:
            raise SweepError(f'cannot write {path}: {error.strerror or error}') from error


def _kind(pa: Any, name: str, rows: Sequence[Row]) -> Any:
    """Return the type of a column, the same in every part: whole numbers, texts, or numbers."""
    if name == 'run':
        return pa.int64()
    told = any(isinstance(row.get(name), str) for row in rows)
    return pa.string() if told or name in ('outcome', 'reason') else pa.float64()
