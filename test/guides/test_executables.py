"""Tests of installed executables: the command of the README in a copy of the sources, and single nodes."""

import json
import signal
import subprocess
import sysconfig
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

import pages
from delta3_pacdrive.ros.wire.qos import LATCHED, REPORT

END_S = 120.0  # beside robots in real time that leave the others little


def elsewhere(page: str) -> str:
    """Return the block of a page that is tested here."""
    (block,) = (
        block
        for block in pages.blocks(pages.SOURCE / page)
        if block.words == 'test/guides/test_executables.py'
    )
    return block.text


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Give the environment of a reader."""
    return pages.environment(tmp_path)


@contextmanager
def started(line: str, environment: dict[str, str]) -> Iterator[None]:
    """Start a command line, and end it with Ctrl-C after a block of code."""
    process = subprocess.Popen(['bash', '-c', f'exec {line}'], env=environment)
    try:
        yield
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            raise


@pytest.mark.long
def test_the_first_command_installs_and_runs_in_a_copy_of_the_sources(
    shell: Callable[..., Any], tmp_path: Path, nothing_left_behind: None
) -> None:
    copy = tmp_path / 'copy'
    pages.copy_sources(copy)
    # .ci/run installs everything into an empty environment; this one borrows the dependencies of that of the tests
    lender = tmp_path / 'lender'
    lender.mkdir()
    borrow = f'import site; site.addsitedir({sysconfig.get_path("purelib")!r})\n'
    (lender / 'sitecustomize.py').write_text(borrow, encoding='utf-8')
    fresh = {'VIRTUAL_ENV': '', 'PYTHONPATH': str(lender)}
    done = shell(elsewhere('README.md'), cwd=copy, timeout=580.0, **fresh)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ': done, ready after' in done.stdout
    lines = ['set -e', elsewhere('docs/get_started.md'), elsewhere('CONTRIBUTING.md'), 'command -v delta3']
    done = shell('\n'.join(lines), cwd=copy, **fresh)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == str(copy / '.venv' / 'bin' / 'delta3')


def test_the_first_commands_of_the_pages_are_those_that_the_tests_install_with() -> None:
    """``.ci/run`` runs ``test/run`` in an empty environment; ``delta3 run`` has tests in ``test/system``."""
    run = (pages.SOURCE / 'test' / 'run').read_text(encoding='utf-8')
    venv, install, start = elsewhere('README.md').strip().split(' && ')
    assert (venv, start) == ('python3 -m venv .venv', '.venv/bin/delta3 run')
    assert install == ".venv/bin/pip install '.[ros,view]'"
    assert elsewhere('docs/get_started.md').splitlines() == [
        venv,
        '. .venv/bin/activate',
        "pip install '.[ros,view]'",
    ]
    assert "pip install --quiet '.[all]'" in run
    assert '-m venv "$VIRTUAL_ENV"' in run


def test_single_nodes_make_a_robot_that_drives_its_program(
    environment: dict[str, str], graph: Any, tmp_path: Path, nothing_left_behind: None
) -> None:
    plant, drive, task, planner, bringup = elsewhere('docs/integrator.md').splitlines()
    assert all(
        line.startswith('ros2 run delta3_pacdrive ') for line in (plant, drive, task, planner, bringup)
    )
    drives = [drive.replace('axis:=1', f'axis:={n}').replace('drive_1', f'drive_{n}') for n in (1, 2, 3)]
    states = graph.listen(String, 'motion/state', LATCHED)
    progress = graph.listen(String, 'motion/progress', REPORT)

    def finished() -> bool:
        return bool(progress) and json.loads(progress[-1].data)['finished']

    with ExitStack() as nodes:
        for line in (plant, *drives, task, planner):
            nodes.enter_context(started(line, environment))
        graph.spin_until(finished, 'the end of the program', 300.0)
    assert 'moving' in [state.data for state in states]
    done = subprocess.run(
        ['bash', '-c', bringup], env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert 'experiment 1' in done.stdout
