"""Provenance of reports, tables and figures, stored in every output file."""

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

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import Delta3Error, ReportError
from delta3_pacdrive.numerics.kernel import sources_digest
from delta3_pacdrive.parameters import DEFAULT_FILE, Parameters

PACKAGES = ('numpy', 'scipy', 'numba')


@dataclass(frozen=True)
class Provenance:
    """Command, parameters, inputs and software versions that produced an output."""

    command: str  # as typed
    seed: int | None  # of all random numbers; None if there are none
    parameters: str  # checksum and file; 'none' if the output does not depend on parameters
    inputs: tuple[str, ...]  # programs and recordings, each with the digest of its bytes
    versions: str  # Python and numerical packages

    @staticmethod
    def of(
        command: str,
        robot: Parameters | None = None,
        source: str | Path | None = None,
        inputs: Sequence[str] = (),
        seed: int | None = None,
    ) -> 'Provenance':
        """Return the provenance of an output; ``source`` is the parameter file, None for the packaged one."""
        parameters = 'none' if robot is None else f'{robot.checksum} ({source or DEFAULT_FILE})'
        return Provenance(command, seed, parameters, tuple(inputs), versions())

    def lines(self) -> dict[str, str]:
        """Return the entries as texts by name."""
        return {
            'command': self.command,
            'seed': 'none' if self.seed is None else str(self.seed),
            'parameters': self.parameters,
            'inputs': '; '.join(self.inputs),
            'versions': self.versions,
        }

    def comments(self) -> list[str]:
        """Return the entries as comment lines of a text file."""
        return [f'# {name}: {text}' for name, text in self.lines().items()]


def versions() -> str:
    """Return the versions of Python and the numerical packages in one line."""
    try:
        own = metadata.version('delta3_pacdrive')
    except metadata.PackageNotFoundError:
        own = 'not installed'
    found = [f'delta3_pacdrive {own} (sources {sources_digest()})', f'Python {platform.python_version()}']
    return ', '.join([*found, *(f'{name} {metadata.version(name)}' for name in PACKAGES)])


@contextmanager
def os_errors_as(message: str, kind: type[Delta3Error] = ReportError) -> Iterator[None]:
    """Re-raise file system errors as errors of this package, with a message and the reason."""
    try:
        yield
    except OSError as error:
        raise kind(f'{message}: {error.strerror or error}') from error


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
    """Return a document as JSON text."""
    return json.dumps(document, indent=1, allow_nan=False) + '\n'


def write_json(document: Any, path: Path) -> Path:
    """Write a document atomically and create its folder; raises ReportError."""
    with os_errors_as(f'cannot write {path}'):
        path.parent.mkdir(parents=True, exist_ok=True)
    return write_text(json_text(document), path)


def write_text(text: str, path: Path) -> Path:
    """Write a text atomically; raises ReportError."""
    with os_errors_as(f'cannot write {path}'):
        return whole_file.write_text(text, path)


def write_table(
    path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]], provenance: Provenance
) -> Path:
    """Write a CSV file atomically: provenance lines that begin with '#', a header with units, the rows.

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
            file.writelines(f'{line}\n' for line in provenance.comments())
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(header)
            writer.writerows(rows)
    return path
