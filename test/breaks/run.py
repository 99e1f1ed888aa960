#!/usr/bin/env python3
"""Mutation tests with meaning: apply one deliberate defect at a time and check that the tests detect it.

    python test/breaks/run.py                     all breaks
    python test/breaks/run.py --only voltage      breaks whose id, file or reason contains a text
    python test/breaks/run.py --changed main      breaks in files that differ from a git revision
    python test/breaks/run.py --list              print the catalogue

The YAML files next to this script list the breaks. Each row has these keys:

    id           unique name
    file         source file, relative to the package
    old, new     source text that occurs exactly once in that file, and its replacement
    also         optional list of further changes, each with file, old and new
    why          the resulting defect of the robot
    tests        files and options for pytest that must detect it
    equivalent   optional: the reason why no test can detect it

``old`` is matched token by token, so line breaks, indentation, quotes, comments and trailing commas of the source do
not matter. A break is applied to a copy of the package, never to the sources or the installed package. A test that
fails with the break must pass without it.

Status of a break:

    killed           a test failed, or the tests did not end in time
    survived         all tests passed: a test is missing
    equivalent       all tests passed, as the catalogue expects
    not equivalent   a test detects a break that the catalogue calls equivalent
    no proof         the test fails without the break as well, or pytest could not collect or select a test
    does not apply   the old text does not occur exactly once

The exit status is 0 if all breaks are killed or equivalent, otherwise 1.
"""

import argparse
import json
import os
import queue
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import yaml

PACKAGE = 'delta3_pacdrive'
HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
REQUIRED = {'id', 'file', 'old', 'new', 'why', 'tests'}
OPTIONAL = {'also', 'equivalent'}
TIME_LIMIT_S = 600.0
PASSED, FAILED = 0, 1  # exit status of pytest
NOT_THE_COPY = 3
TOKEN = re.compile(
    r'#[^\n]*|"""(?:\\.|[^\\])*?"""|\'\'\'(?:\\.|[^\\])*?\'\'\''
    r'|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|[A-Za-z_]\w*|\d[\w.]*|\S',
    re.DOTALL,
)
BOOT = f"""\
import sys
import {PACKAGE}
from pathlib import Path
if not Path({PACKAGE}.__file__).is_relative_to(Path(sys.argv[1])):
    print(f'pytest would import {{{PACKAGE}.__file__}} instead of the copy in {{sys.argv[1]}}')
    sys.exit({NOT_THE_COPY})
import pytest
class Failures:
    def pytest_runtest_logreport(self, report):
        if report.failed:
            with open(sys.argv[2], 'a', encoding='utf-8') as file:
                file.write(report.nodeid + '\\n')
sys.exit(pytest.main(sys.argv[3:], plugins=[Failures()]))
"""
COMPILE_KERNELS = f"""\
from {PACKAGE} import parameters, simulation
simulation.load_kernels(parameters.load())
"""


def tokens(text: str) -> list[tuple[str, int, int]]:
    """Return (token, start, end) without comments and trailing commas, strings with single quotes."""
    found: list[tuple[str, int, int]] = []
    for match in TOKEN.finditer(text):
        token = match[0]
        if token.startswith('#'):
            continue
        if token in ')]}' and found and found[-1][0] == ',':
            found.pop()
        if len(token) > 1 and token[0] == '"' and "'" not in token:
            token = token.replace('"', "'")
        found.append((token, match.start(), match.end()))
    return found


def occurrences(source: str, text: str) -> list[tuple[int, int]]:
    """Return start and end of each occurrence of a text in a source, compared by tokens."""
    have, wanted = tokens(source), [token for token, _, _ in tokens(text)]
    words = [token for token, _, _ in have]
    return [
        (have[k][1], have[k + len(wanted) - 1][2])
        for k in range(len(have) - len(wanted) + 1)
        if words[k] == wanted[0] and words[k : k + len(wanted)] == wanted
    ]


def replaced(source: str, old: str, new: str) -> str:
    """Return a source with the only occurrence of a text replaced, indented like the text it replaces."""
    ((start, end),) = occurrences(source, old)
    lines = new.rstrip().split('\n')
    written = len(lines[0]) - len(lines[0].lstrip())
    if written:
        line = source[source.rfind('\n', 0, start) + 1 : start]
        lines = [' ' * len(line) + one[written:] for one in lines]
    return source[:start] + '\n'.join(lines).lstrip() + source[end:]


@dataclass(frozen=True)
class Break:
    """One row of the catalogue; ``changes`` are (file, old, new)."""

    id: str
    changes: tuple[tuple[str, str, str], ...]
    why: str
    tests: str
    equivalent: str = ''

    def misfits(self, package: Path) -> list[str]:
        """Return a sentence for each change that does not apply exactly once to a package."""
        sentences = []
        for file, old, new in self.changes:
            path = package / file
            count = len(occurrences(path.read_text(encoding='utf-8'), old)) if path.is_file() else 0
            if old == new:
                sentences.append(f'{file}: old and new are equal')
            elif count != 1:
                sentences.append(f'{file} contains {old!r} {count} times')
        return sentences


@dataclass(frozen=True)
class Result:
    """Status of a break; ``seen_by`` are the tests that failed."""

    id: str
    status: str
    seconds: float
    detail: str
    seen_by: tuple[str, ...] = ()


def load_catalogue(folder: Path = HERE) -> list[Break]:
    """Read all breaks; raise ValueError for a row with wrong keys and for an id used twice."""
    breaks = []
    for path in sorted(folder.glob('*.yaml')):
        for row in yaml.safe_load(path.read_text(encoding='utf-8')):
            empty = [key for key in row.keys() - {'new'} if not row[key]]
            if row.keys() - REQUIRED - OPTIONAL or REQUIRED - row.keys() or empty:
                raise ValueError(
                    f'{path.name}: {row.get("id")} has the keys {sorted(row)}, required {sorted(REQUIRED)}'
                )
            changes = [(one['file'], one['old'], one['new']) for one in (row, *row.get('also', ()))]
            equivalent = str(row.get('equivalent', '')).strip()
            breaks.append(Break(row['id'], tuple(changes), row['why'].strip(), row['tests'], equivalent))
    if double := [name for name, count in Counter(one.id for one in breaks).items() if count > 1]:
        raise ValueError(f'ids used twice: {", ".join(double)}')
    return breaks


class PackageCopy:
    """A copy of the package, to which breaks are applied one after the other."""

    def __init__(self, folder: Path, source: Path = ROOT / PACKAGE) -> None:
        self.folder = folder
        self.package = folder / 'copy' / PACKAGE
        self._original = folder / 'original'  # the sources may change during the run
        ignore = shutil.ignore_patterns('__pycache__')
        for target in (self._original, self.package):
            shutil.copytree(source, target, ignore=ignore)
        self._environment = os.environ | {
            'PYTHONPATH': str(folder / 'copy'), 'PYTHONSAFEPATH': '1', 'MPLBACKEND': 'Agg', 'DELTA3_LONG': '1',
            'NUMBA_CACHE_DIR': str(folder / 'kernels'),
        }  # fmt: skip
        self._passing: dict[tuple[str, ...], bool] = {}

    def compile(self) -> None:
        """Add the configuration and compile the kernels, which all breaks share."""
        shutil.copytree(ROOT / 'config', self.package / 'config')
        subprocess.run(
            [sys.executable, '-c', COMPILE_KERNELS], env=self._environment, check=True, cwd=self.folder
        )

    def attempt(self, one: Break) -> Result:
        """Apply a break, run its tests, and restore the copy."""
        began = time.monotonic()
        if misfits := one.misfits(self.package):
            return Result(one.id, 'does not apply', 0.0, '; '.join(misfits))
        for file, old, new in one.changes:
            path = self.package / file
            self._replace(path, replaced(path.read_text(encoding='utf-8'), old, new))
        try:
            status, detail, failed = self.run_tests('-x', *shlex.split(one.tests))
        finally:
            for file, _, _ in one.changes:
                self._replace(self.package / file, (self._original / file).read_text(encoding='utf-8'))
        if status == PASSED:
            name, detail = ('equivalent', one.equivalent) if one.equivalent else ('survived', '')
        elif status != FAILED:
            name = 'no proof'
        elif not self._passes(failed):
            name, detail = 'no proof', f'fails without the break: {" ".join(failed)}'
        else:
            name = 'not equivalent' if one.equivalent else 'killed'
        return Result(one.id, name, time.monotonic() - began, detail, failed)

    def run_tests(self, *arguments: str) -> tuple[int, str, tuple[str, ...]]:
        """Run tests with the copy; return the status of pytest, a line of its output, and the failed tests."""
        noted = self.folder / 'failed'
        noted.unlink(missing_ok=True)
        command = [
            sys.executable,
            '-P',
            '-c',
            BOOT,
            str(self.folder / 'copy'),
            str(noted),
            '-q',
            '--no-header',
        ]
        process = subprocess.Popen(
            [*command, '--tb=no', '-p', 'no:cacheprovider', *arguments],
            env=self._environment, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=TIME_LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return FAILED, f'no end within {TIME_LIMIT_S:g} s', tuple(a for a in arguments if a != '-x')
        failed = tuple(noted.read_text(encoding='utf-8').split('\n')[:-1]) if noted.exists() else ()
        lines = [line for line in output.splitlines() if line.startswith(('FAILED', 'ERROR'))]
        last = [line for line in output.splitlines() if line.strip()][-1:]
        status = process.returncode
        if status == FAILED and not failed:  # pytest collected nothing
            status = NOT_THE_COPY
        return status, (lines or last or [''])[0], failed

    def _passes(self, tests: tuple[str, ...]) -> bool:
        if tests not in self._passing:
            self._passing[tests] = self.run_tests(*tests)[0] == PASSED
        return self._passing[tests]

    @staticmethod
    def _replace(path: Path, source: str) -> None:
        # bytecode identifies its source only by size and whole seconds
        for compiled in (path.parent / '__pycache__').glob(f'{path.stem}.*.pyc'):
            compiled.unlink()
        path.write_text(source, encoding='utf-8')


def changed_files(revision: str) -> set[str]:
    """Return the files of the package that differ from a git revision."""
    command = ['git', 'diff', '--name-only', '--relative', revision, '--', '.']
    return set(
        subprocess.run(command, cwd=ROOT / PACKAGE, capture_output=True, text=True, check=True).stdout.split()
    )


def main() -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(
        description='Apply deliberate defects and check that the tests detect them.'
    )
    parser.add_argument(
        '--only', metavar='TEXT', default='', help='breaks whose id, file or reason contains it'
    )
    parser.add_argument(
        '--changed', metavar='REVISION', help='breaks in files that differ from a git revision'
    )
    parser.add_argument('--list', action='store_true', help='print the catalogue and exit')
    parser.add_argument('--jobs', metavar='N', type=int, default=1, help='number of breaks at a time')
    parser.add_argument('--json', action='store_true', help='print one JSON object per break')
    options = parser.parse_args()
    changed = changed_files(options.changed) if options.changed else None
    chosen = [
        one
        for one in load_catalogue()
        if any(options.only in text for text in (one.id, one.why, *(file for file, _, _ in one.changes)))
        and (changed is None or any(file in changed for file, _, _ in one.changes))
    ]
    if options.list or not chosen:
        for one in chosen:
            print(f'{one.id:<36} {one.changes[0][0]:<28} {one.why}')
        return 0

    counts: Counter[str] = Counter()
    copies: queue.SimpleQueue[PackageCopy] = queue.SimpleQueue()
    lock = threading.Lock()

    def attempt(one: Break) -> None:
        copy = copies.get()
        try:
            result = copy.attempt(one)
        finally:
            copies.put(copy)
        with lock:
            counts[result.status] += 1
            if options.json:
                print(json.dumps(vars(result)), flush=True)
            else:
                print(
                    f'{result.status:<14} {result.id:<36} {result.seconds:6.1f} s  {result.detail}',
                    flush=True,
                )

    with tempfile.TemporaryDirectory(prefix='breaks-') as folder, ThreadPoolExecutor(options.jobs) as pool:
        for number in range(options.jobs):
            copies.put(copy := PackageCopy(Path(folder).resolve() / str(number)))
            copy.compile()
        list(pool.map(attempt, chosen))
    summary = ', '.join(f'{count} {name}' for name, count in counts.most_common())
    print(f'{counts.total()} breaks: {summary}', file=sys.stderr)
    return 0 if counts.keys() <= {'killed', 'equivalent'} else 1


if __name__ == '__main__':
    sys.exit(main())
