"""Storage of the runs of a sweep in a folder, with atomically written parts.

``sweep.json`` identifies the sweep. A part ``part_00000001.parquet`` contains the rows of a batch and is named after
its first run. Finally ``runs.parquet`` and ``runs.csv`` contain all rows sorted by run, and the parts are removed.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.studies.fleet.sweep.study import Sweep
from delta3_pacdrive.studies.framework.provenance import versions

TABLE, MANIFEST, PARTS = 'runs.parquet', 'sweep.json', 'part_*.parquet'
NEEDED = "sweeps need dask, distributed and pyarrow: pip install 'delta3_pacdrive[sweep]'"
Row = dict[str, Any]


class Store:
    """Storage of the runs of a sweep."""

    def __init__(self, folder: Path, sweep: Sweep) -> None:
        self._folder, self._sweep = folder, sweep

    def open(self) -> dict[int, Row]:
        """Return the stored rows by number of the run.

        Raises
        ------
        SweepError
            The folder contains another sweep, or one of other sources, or cannot be read or written.

        """
        import pyarrow.parquet as parquet

        identity = {
            'name': self._sweep.name,
            'runs': self._sweep.runs,
            'digest': self._sweep.digest,
            'made_by': versions(),
        }
        manifest = self._folder / MANIFEST
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if manifest.exists():
                self._require_same(json.loads(manifest.read_text(encoding='utf-8')), identity)
            else:
                left = [
                    path.name for path in (self._folder / TABLE, *self._folder.glob(PARTS)) if path.exists()
                ]
                if left:
                    raise SweepError(f'{self._folder} contains {left[0]}, but no {MANIFEST}')
                with whole_file.atomic_path(manifest) as path:
                    path.write_text(json.dumps(identity, indent=1), encoding='utf-8')
            paths = [
                path for path in (self._folder / TABLE, *sorted(self._folder.glob(PARTS))) if path.exists()
            ]
            rows = [row for path in paths for row in parquet.read_table(path).to_pylist()]
        except SweepError:
            raise
        except (OSError, ValueError) as error:
            raise SweepError(f'cannot store a sweep in {self._folder}: {error}') from error
        return {row['run']: row for row in rows}

    def _require_same(self, stored: Any, identity: dict[str, Any]) -> None:
        if not isinstance(stored, dict) or stored.get('digest') != identity['digest']:
            what = f'sweep {stored.get("name")}' if isinstance(stored, dict) else 'other data'
            raise SweepError(
                f'{self._folder} contains {what}, which differs in definition or sources: choose another --output, or '
                'remove the folder'
            )

    def add(self, rows: Sequence[Row]) -> None:
        """Store the rows of a batch; raises SweepError."""
        self._write(rows, self._folder / f'part_{rows[0]["run"]:08d}.parquet')

    def finish(self, rows: Iterable[Row]) -> Path:
        """Merge all rows, sorted by run, and return the path of the table; raises SweepError."""
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
    """Return the type of a column, equal in all parts: integer, text, or floating point."""
    if name == 'run':
        return pa.int64()
    is_text = any(isinstance(row.get(name), str) for row in rows)
    return pa.string() if is_text or name in ('outcome', 'reason') else pa.float64()
