"""Outputs that can be repeated: where a report, a table or a figure comes from, written with it."""

import csv
import hashlib
import json
import platform
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import Delta3Error, ReportError
from delta3_pacdrive.numerics.kernel import sources_digest
from delta3_pacdrive.parameters import DEFAULT_FILE, Parameters

PACKAGES = ('numpy', 'scipy', 'numba')


@dataclass(frozen=True)
class Provenance:
    """Provenance says how an output came about.

    Attributes
    ----------
    command
        As it was typed.
    seed
        Of everything random; None where nothing was random.
    parameters
        Checksum of the parameters, and the file they came from; ``none`` where nothing depends on them.
    inputs
        Programs and recordings, each with the digest of its bytes.
    versions
        Of Python and the packages that compute.

    """

    command: str
    seed: int | None
    parameters: str
    inputs: tuple[str, ...]
    versions: str

    @staticmethod
    def of(
        command: str,
        robot: Parameters | None = None,
        source: str | Path | None = None,
        inputs: Sequence[str] = (),
        seed: int | None = None,
    ) -> 'Provenance':
        """Note where an output comes from; ``source`` is the parameter file, if it is not the packaged one."""
        parameters = 'none' if robot is None else f'{robot.checksum} ({source or DEFAULT_FILE})'
        return Provenance(command, seed, parameters, tuple(inputs), versions())

    def lines(self) -> dict[str, str]:
        """Return all of it as texts by name."""
        return {
            'command': self.command,
            'seed': 'none' if self.seed is None else str(self.seed),
            'parameters': self.parameters,
            'inputs': '; '.join(self.inputs),
            'versions': self.versions,
        }


def versions() -> str:
    """Versions of Python and of the packages that compute, as one line."""
    try:
        own = metadata.version('delta3_pacdrive')
    except metadata.PackageNotFoundError:
        own = 'not installed'
    found = [f'delta3_pacdrive {own} (sources {sources_digest()})', f'Python {platform.python_version()}']
    return ', '.join([*found, *(f'{name} {metadata.version(name)}' for name in PACKAGES)])


@contextmanager
def os_errors_as(told: str, kind: type[Delta3Error] = ReportError) -> Iterator[None]:
    """Make an error of the file system, meanwhile, one of this package: ``told``, and why."""
    try:
        yield
    except OSError as error:
        raise kind(f'{told}: {error.strerror or error}') from error


def digest(path: Path) -> str:
    """Return a short digest of a file, or of the files in a folder; raises ReportError."""
    total = hashlib.sha256()
    with os_errors_as(f'cannot read {path}'):
        files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]
        for file in files:
            whole_file.require_regular(file)
            with file.open('rb') as stream:
                total.update(hashlib.file_digest(stream, 'sha256').digest())
    return total.hexdigest()[:16]


def json_text(document: Any) -> str:
    """Return a document as the text of a file."""
    return json.dumps(document, indent=1, allow_nan=False) + '\n'


def write_json(document: Any, path: Path) -> Path:
    """Write a document as ``write_text`` does, with the folder that it needs; raises ReportError."""
    with os_errors_as(f'cannot write {path}'):
        path.parent.mkdir(parents=True, exist_ok=True)
    return write_text(json_text(document), path)


def write_text(text: str, path: Path) -> Path:
    """Write a text so that a reader sees the old file or the new one, never half of it; raises ReportError."""
    with os_errors_as(f'cannot write {path}'):
        return whole_file.write_text(text, path)


def write_table(
    path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]], provenance: Provenance
) -> Path:
    """Write a CSV file: how it came about in lines that begin with '#', then a header with units, then the rows.

    The file is there whole or not at all.

    Raises
    ------
    ReportError
        The file cannot be written.

    """
    with os_errors_as(f'cannot write {path}'):
        path.parent.mkdir(parents=True, exist_ok=True)
        with (
            whole_file.atomic_path(path) as partial,
            partial.open('w', encoding='utf-8', newline='') as file,
        ):
            for name, text in provenance.lines().items():
                file.write(f'# {name}: {text}\n')
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(header)
            writer.writerows(rows)
    return path
