#!/usr/bin/env python3
"""Breaks the robot on purpose, one break at a time, and looks whether the tests see it.

    python test/breaks/run.py                     every break of the catalogue
    python test/breaks/run.py --only voltage      breaks whose id, file or reason holds a text
    python test/breaks/run.py --list              what there is
    python test/breaks/run.py --jobs 2 --json     two at a time; the result as JSON

Run it in an environment with the test dependencies, from anywhere. All take over two hours, two at a time.

The catalogue is the YAML files beside this one, one for each room of the package. Whoever adds a capability adds its
breaks. A break is a row:

    id           its name
    file         source file in the package
    old, new     text that occurs exactly once there, and what takes its place
    also         optional: more changes, each with file, old, new
    why          what robot this is
    tests        files and options for pytest: the tests that should see it
    equivalent   optional: why no test can see it

Each break is applied to a copy of the package, never to the sources and never to what is installed. The copy comes
first on the path of the tests' interpreter, which makes sure that it has imported the copy. At the end every test that
has seen a break runs on the copy as it is: what fails there proves nothing.

killed           a test failed, or they did not end in time: the break was seen
survived         every test passed: a fact is missing
equivalent       every test passed, and the catalogue says why it must
does not apply   the text does not occur exactly once: the break belongs to code of yesterday
no proof         the test that saw it fails without the break as well; or none could be collected, or was selected
not equivalent   a test sees what the catalogue calls equivalent

The exit status is 0 if all breaks are killed or equivalent, else 1.

Compiled kernels know the sources that they are made of: a break compiles only what it changes, and what imports that.
``--work DIR`` keeps copy and kernels for the next call.
"""

import argparse
import json
import os
import queue
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

PACKAGE = 'delta3_pacdrive'
HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
KEYS = {'id', 'file', 'old', 'new', 'also', 'why', 'tests', 'equivalent'}
REQUIRED = {'id', 'file', 'old', 'new', 'why', 'tests'}
TIME_LIMIT_S = 600.0
GOOD = ('killed', 'equivalent')
PASSED, FAILED, UNFIT = 0, 1, 3  # pytest's exit status; whatever is neither of the first two tells nothing
LARGEST_CONTROL = 30  # tests of one file in a process
BOOT = f"""\
import sys
import {PACKAGE}
from pathlib import Path
copy = Path(sys.argv[1])
if not Path({PACKAGE}.__file__).is_relative_to(copy):
    print(f'tested would be {{{PACKAGE}.__file__}} instead of the copy in {{copy}}')
    sys.exit({UNFIT})
import pytest
class Failures:
    def pytest_runtest_logreport(self, report):
        if report.failed:
            with open(sys.argv[2], 'a', encoding='utf-8') as file:
                file.write(report.nodeid + '\\n')
sys.exit(pytest.main(sys.argv[3:], plugins=[Failures()]))
"""
# Compiles what the user's cache does not have yet, and copies what it has for these sources (and a few versions more).
COPY_KERNELS = f"""\
import shutil, sys
from pathlib import Path
from {PACKAGE} import parameters, simulation
from {PACKAGE}.numerics import kernel
simulation.load_kernels(parameters.load())
here, there = kernel.CACHE_DIRECTORY, Path(sys.argv[1]) / kernel.CACHE_DIRECTORY.name
there.mkdir(mode=0o700, parents=True, exist_ok=True)
for mark in here.glob(kernel.MARK + '*'):
    for name in mark.read_text(encoding='utf-8').split():
        if (here / name).is_dir():
            shutil.copytree(here / name, there / name, dirs_exist_ok=True)
    shutil.copy2(mark, there)
"""


@dataclass(frozen=True)
class Break:
    """One row of the catalogue; ``changes`` are (file, old, new)."""

    id: str
    changes: tuple[tuple[str, str, str], ...]
    why: str
    tests: str
    equivalent: str = ''

    def misfits(self, package: Path) -> list[str]:
        """Sentences about texts that do not occur exactly once in a package."""
        sentences = []
        for file, old, new in self.changes:
            path = package / file
            count = path.read_text(encoding='utf-8').count(old) if path.is_file() else 0
            if count != 1 or old == new:
                sentences.append(
                    f'{file} holds {old!r} {count} times' if old != new else f'{file}: no change'
                )
        return sentences


@dataclass
class Result:
    """What became of a break; ``seen_by`` are the test that saw it, or all if they did not end."""

    id: str
    status: str
    seconds: float
    detail: str
    seen_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """How tests ended: pytest's exit status, a word about it, and the tests that failed."""

    status: int
    detail: str
    failed: tuple[str, ...] = ()


def load_catalogue(folder: Path = HERE) -> list[Break]:
    """Read every break; raises ValueError for a row that is none, and for an id that stands twice."""
    breaks = []
    for path in sorted(folder.glob('*.yaml')):
        for row in yaml.safe_load(path.read_text(encoding='utf-8')):
            where = f'{path.name}: {row.get("id")}'
            if (
                row.keys() - KEYS
                or REQUIRED - row.keys()
                or not all(row[key] for key in row.keys() - {'new'})
            ):
                raise ValueError(f'{where} has the keys {sorted(row)}, expected {sorted(KEYS)}')
            changes = [(one['file'], one['old'], one['new']) for one in (row, *row.get('also', ()))]
            equivalent = str(row.get('equivalent', '')).strip()
            breaks.append(Break(row['id'], tuple(changes), row['why'].strip(), row['tests'], equivalent))
    double = [name for name, count in Counter(one.id for one in breaks).items() if count > 1]
    if double:
        raise ValueError(f'these ids stand twice: {", ".join(double)}')
    return breaks


class Workshop:
    """A copy of the package, in which one break after the other is tried."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.package = folder / 'copy' / PACKAGE
        # what a break has changed comes back from here, though somebody works on the sources meanwhile
        self._original = folder / 'original'
        ignore = shutil.ignore_patterns('__pycache__')
        for target in (self._original, self.package):
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(ROOT / PACKAGE, target, ignore=ignore)
            shutil.copytree(ROOT / 'config', target / 'config', ignore=ignore)
        kernels = folder / 'kernels'
        users = os.environ | {'PYTHONPATH': str(folder / 'copy'), 'PYTHONSAFEPATH': '1', 'MPLBACKEND': 'Agg'}
        users |= {'DELTA3_LONG': '1'}  # a break may be seen by a fact that takes long
        self.environment = users | {'NUMBA_CACHE_DIR': str(kernels)}
        subprocess.run([sys.executable, '-c', COPY_KERNELS, str(kernels)], env=users, check=True, cwd=folder)

    def attempt(self, one: Break) -> Result:
        """Try a break."""
        began = time.monotonic()
        if misfits := one.misfits(self.package):
            return Result(one.id, 'does not apply', 0.0, '; '.join(misfits))
        self._apply(one)
        try:
            outcome = self.run_tests('-x', *shlex.split(one.tests))
        finally:
            self._restore(one)
        detail = outcome.detail
        if outcome.status == PASSED:
            name, detail = ('equivalent', one.equivalent) if one.equivalent else ('survived', '')
        elif outcome.status == FAILED:
            name = 'not equivalent' if one.equivalent else 'killed'
        else:
            name = 'no proof'
        return Result(one.id, name, time.monotonic() - began, detail, outcome.failed)

    def blind(self, seen_by: tuple[str, ...]) -> bool:
        """Say whether what has seen a break fails without it as well."""
        return self.run_tests(*seen_by).status != PASSED

    def failing(self, tests: list[str]) -> set[str]:
        """Run tests of one file without a break; return those that do not pass."""
        outcome = self.run_tests(*tests)
        if outcome.status in (PASSED, FAILED) and (outcome.status == PASSED or outcome.failed):
            return set(outcome.failed)
        return {test for test in tests if self.blind((test,))}  # one of them hangs, or is not there

    def run_tests(self, *arguments: str) -> Outcome:
        """Run tests in the copy as it is at present."""
        noted = self.folder / 'failed'
        noted.unlink(missing_ok=True)
        options = ['-q', '--no-header', '--tb=no', '-p', 'no:cacheprovider', '-p', 'no:randomly']
        boot = [sys.executable, '-P', '-c', BOOT, str(self.folder / 'copy'), str(noted)]
        process = subprocess.Popen(
            [*boot, *options, *arguments], env=self.environment, cwd=ROOT, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=TIME_LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            chosen = tuple(argument for argument in arguments if argument != '-x')
            return Outcome(FAILED, f'no end within {TIME_LIMIT_S:g} s', chosen)
        failed = (
            tuple(dict.fromkeys(noted.read_text(encoding='utf-8').splitlines())) if noted.exists() else ()
        )
        lines = [line for line in output.splitlines() if line.startswith(('FAILED', 'ERROR'))]
        last = [line for line in output.splitlines() if line.strip()][-1:]
        status = process.returncode
        if status == FAILED and not failed:
            status = UNFIT  # nothing was collected, so no test has seen anything
        return Outcome(status, (lines or last or [''])[0], failed)

    def _apply(self, one: Break) -> None:
        for file, old, new in one.changes:
            path = self.package / file
            self._forget_bytecode(path)
            path.write_text(path.read_text(encoding='utf-8').replace(old, new), encoding='utf-8')

    def _restore(self, one: Break) -> None:
        for file, _, _ in one.changes:
            shutil.copy2(self._original / file, self.package / file)
            self._forget_bytecode(self.package / file)

    @staticmethod
    def _forget_bytecode(path: Path) -> None:
        """Bytecode knows its source by size and whole seconds only."""
        for compiled in (path.parent / '__pycache__').glob(f'{path.stem}.*.pyc'):
            compiled.unlink()


def controls(results: list[Result]) -> list[tuple[str, ...]]:
    """Divide the tests that have seen breaks into what runs in one process."""
    files: dict[str, list[str]] = {}
    alone = []
    for seen_by in dict.fromkeys(result.seen_by for result in results if result.status == 'killed'):
        if len(seen_by) == 1 and '::' in seen_by[0]:
            files.setdefault(seen_by[0].split('::')[0], []).append(seen_by[0])
        else:
            alone.append(seen_by)
    return alone + [
        tuple(tests[k : k + LARGEST_CONTROL])
        for tests in files.values()
        for k in range(0, len(tests), LARGEST_CONTROL)
    ]


def run(breaks: list[Break], folder: Path, jobs: int, report: Any) -> list[Result]:
    """Try breaks in as many copies as there are jobs; ``report`` is called with each, and again if it changes."""
    workshops: queue.SimpleQueue[Workshop] = queue.SimpleQueue()
    for number in range(jobs):
        (folder / f'job{number}').mkdir(parents=True, exist_ok=True)
        workshops.put(Workshop(folder / f'job{number}'))

    def attempt(one: Break) -> Result:
        workshop = workshops.get()
        try:
            result = workshop.attempt(one)
        finally:
            workshops.put(workshop)
        report(result)
        return result

    def control(tests: tuple[str, ...]) -> set[tuple[str, ...]]:
        workshop = workshops.get()
        try:
            if all('::' in test for test in tests):
                return {(test,) for test in workshop.failing(list(tests))}
            return {tests} if workshop.blind(tests) else set()
        finally:
            workshops.put(workshop)

    with ThreadPoolExecutor(jobs) as pool:
        results = list(pool.map(attempt, breaks))
        blind = set().union(*pool.map(control, controls(results)))
    for result in results:
        if result.seen_by in blind:
            result.status, result.detail = 'no proof', f'fails without the break: {" ".join(result.seen_by)}'
            report(result)
    return results


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description='Break the robot on purpose, one break at a time, and look whether the tests see it.'
    )
    parser.add_argument(
        '--only', metavar='TEXT', default='', help='breaks whose id, file or reason holds a text'
    )
    parser.add_argument('--list', action='store_true', help='print the catalogue')
    parser.add_argument('--jobs', metavar='N', type=int, default=1, help='breaks at a time')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    parser.add_argument(
        '--work', metavar='DIR', type=Path, help='folder for copies and kernels, kept for the next call'
    )
    return parser


def main() -> int:
    """Run the command; return the exit status."""
    options = _parser().parse_args()
    chosen = [
        one
        for one in load_catalogue()
        if options.only in one.id or options.only in one.why or any(options.only in c[0] for c in one.changes)
    ]
    if not chosen:
        print(f'error: no break holds the text {options.only!r}', file=sys.stderr)
        return 1
    if options.list:
        for one in chosen:
            mark = ' (equivalent)' if one.equivalent else ''
            print(f'{one.id:<36} {one.changes[0][0]:<28} {" ".join(one.why.split())}{mark}')
        return 0

    def report(result: Result) -> None:
        text = f'{result.status:<14} {result.id:<36} {result.seconds:6.1f} s  {result.detail}'
        print(text, file=sys.stderr if options.json else sys.stdout, flush=True)

    if options.work:
        results = run(chosen, options.work.resolve(), max(1, options.jobs), report)
    else:
        with tempfile.TemporaryDirectory(prefix='breaks-') as folder:
            results = run(chosen, Path(folder).resolve(), max(1, options.jobs), report)
    counts = Counter(result.status for result in results)
    if options.json:
        print(json.dumps({'counts': counts, 'results': [vars(result) for result in results]}))
    else:
        print(
            f'{len(results)} breaks: ' + ', '.join(f'{count} {name}' for name, count in counts.most_common())
        )
    return 0 if all(result.status in GOOD for result in results) else 1


if __name__ == '__main__':
    sys.exit(main())
