"""Runs command lines and scripts in the process of the test."""

import contextlib
import os
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TextIO
from unittest import mock

from delta3_pacdrive.cli.main import main


def delta3(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run ``delta3`` with the arguments, as if in a separate process."""
    words = [str(word) for word in arguments]
    return _ended(['delta3', *words], lambda: main(words), cwd)


def script(path: Path, *arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a Python script as ``__main__``."""

    def run() -> int:
        runpy.run_path(str(path), run_name='__main__')
        return 0

    return _ended([str(path), *arguments], run, cwd)


def _ended(line: list[str], run: Callable[[], int], cwd: Path | None) -> subprocess.CompletedProcess[str]:
    with tempfile.TemporaryFile('w+') as output, tempfile.TemporaryFile('w+') as errors:
        with (
            contextlib.chdir(cwd or os.getcwd()),
            mock.patch.object(sys, 'argv', line),
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(errors),
        ):
            try:
                status = run()
            except SystemExit as end:
                status = _status(end, errors)
        return subprocess.CompletedProcess(line, status, _read(output), _read(errors))


def _status(end: SystemExit, errors: TextIO) -> int:
    if end.code is None or isinstance(end.code, int):
        return end.code or 0
    errors.write(f'{end.code}\n')
    return 1


def _read(file: TextIO) -> str:
    file.seek(0)
    return file.read()
