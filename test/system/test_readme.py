"""The blocks of the README on robots run as they stand, in their order. All other blocks: ``../test_readme.py``."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

from delta3_pacdrive.ros.qos import LATCHED, REPORT

SOURCE = Path(__file__).parents[2]
END_S = 30.0


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Give the environment of somebody who has sourced this one: its commands, its packages, and a ``ros2``."""
    stand_in = tmp_path / 'bin' / 'ros2'
    stand_in.parent.mkdir()
    stand_in.write_text(
        f'#!/bin/sh\nexec "{sys.executable}" -P "{Path(__file__).with_name("ros2.py")}" "$@"\n',
        encoding='utf-8',
    )
    stand_in.chmod(0o755)
    path = [str(stand_in.parent), str(Path(sys.executable).parent), os.environ['PATH']]
    return os.environ | {'PATH': os.pathsep.join(path), 'AMENT_PREFIX_PATH': sys.prefix}


@pytest.fixture
def started(environment: dict[str, str], tmp_path: Path) -> Callable[[str], Any]:
    """Return what starts a command line, and ends it with Ctrl-C behind a block of code."""

    @contextmanager
    def start(line: str) -> Iterator[subprocess.Popen[str]]:
        process = subprocess.Popen(
            ['bash', '-c', f'exec {line}'],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                raise

    return start


@pytest.fixture
def run(environment: dict[str, str], shell: Callable[..., Any]) -> Callable[..., str]:
    """Return what runs a command line to its end, which has to be a good one; it returns what is printed."""

    def to_the_end(line: str, **options: Any) -> str:
        own = {key: environment[key] for key in ('PATH', 'AMENT_PREFIX_PATH')}
        done = shell(line, **own, **options)
        assert done.returncode == 0, f'{line}: {done.stdout[-2000:]}{done.stderr[-2000:]}'
        return str(done.stdout)

    return to_the_end


def rows_of(path: Path) -> list[list[str]]:
    """Return the rows of a table, those of its remarks left out."""
    lines = path.read_text(encoding='utf-8').splitlines()
    return [line.split(',') for line in lines if not line.startswith('#')]


def read_until(process: subprocess.Popen[str], text: str) -> str:
    """Read lines of a process until one holds a text; return that line."""
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if text in line:
            return line
    raise AssertionError(f'{text!r} was not printed: {"".join(lines)}')


@pytest.mark.timeout(600)
def test_the_first_command_installs_and_runs_in_a_copy_of_the_sources(
    readme_lines: Callable[[str], list[str]],
    shell: Callable[..., Any],
    tmp_path: Path,
    nothing_left_behind: None,
) -> None:
    (command,) = readme_lines('Run it')
    copy = tmp_path / 'copy'
    files = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=SOURCE, capture_output=True, text=True, check=True
    ).stdout.split('\0')
    for name in filter(None, files):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(SOURCE / name, copy / name)
    done = shell(command, cwd=copy, timeout=580.0, VIRTUAL_ENV='', PYTHONPATH='')
    assert done.returncode == 0, done.stdout + done.stderr
    assert ': done, ready after' in done.stdout


def test_single_nodes_make_a_robot_that_drives_its_program(
    readme_lines: Callable[[str], list[str]],
    started: Callable[[str], Any],
    run: Callable[..., str],
    graph: Any,
    nothing_left_behind: None,
) -> None:
    plant, drive, task, planner, bringup = readme_lines('Single nodes')
    assert all(
        line.startswith('ros2 run delta3_pacdrive ') for line in (plant, drive, task, planner, bringup)
    )
    drives = [drive.replace('axis:=1', f'axis:={n}').replace('drive_1', f'drive_{n}') for n in (1, 2, 3)]
    states = graph.listen(String, 'motion/state', LATCHED)
    progress = graph.listen(String, 'motion/progress', REPORT)

    def finished() -> bool:
        return bool(progress) and json.loads(progress[-1].data)['finished']

    first, second, third = drives
    with started(plant), started(first), started(second), started(third), started(task), started(planner):
        graph.spin_until(finished, 'the end of the program', 40.0)
    assert 'moving' in [state.data for state in states]
    assert 'experiment 1' in run(bringup)


def test_moves_of_any_ros_client_are_driven(
    started: Callable[[str], Any], run: Callable[..., str], graph: Any, nothing_left_behind: None
) -> None:
    text = ' '.join((SOURCE / 'README.md').read_text(encoding='utf-8').split())
    move, start = (
        text[text.index(begin) : text.index('`', text.index(begin))]
        for begin in ('ros2 topic pub --once', 'ros2 service call /start')
    )
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    with started('delta3 up'):
        run('delta3 move wait')
        run(move)
        graph.spin_until(lambda: any('planned' in answer.data for answer in answers), 'the answer')
        assert 'success=True' in run(start)
        run('delta3 move wait')
        facts = json.loads(run('delta3 move state --json'))
    assert facts['tcp_m'] == pytest.approx([0.1, 0.0, -0.8], abs=1e-4)


def test_a_gain_is_written_by_the_ros_parameter_of_the_readme(
    started: Callable[[str], Any], run: Callable[..., str], nothing_left_behind: None
) -> None:
    text = (SOURCE / 'README.md').read_text(encoding='utf-8')
    begin = text.index('ros2 param set')
    with started('delta3 up'):
        run('delta3 move wait')
        run(text[begin : text.index('`', begin)])
        assert '70' in run('delta3 drive 1 S-0-0104')


def test_the_lines_on_recordings_run_as_they_stand(
    readme_lines: Callable[[str], list[str]],
    started: Callable[[str], Any],
    run: Callable[..., str],
    graph: Any,
    tmp_path: Path,
    nothing_left_behind: None,
) -> None:
    record, plot, window = readme_lines('Recordings')
    states = graph.listen(String, 'recorder/state', LATCHED)
    with started('delta3 up'):
        run('delta3 move wait')
        with started(record):
            graph.spin_until(lambda: states, 'the recorder')
            run('delta3 move l 0.1 0 -0.8 --speed 0.2')
        run(plot)
        folder = tmp_path / 'figures'
        whole = rows_of(folder / 'signals.csv')
        run(window)
        part = rows_of(folder / 'signals.csv')
    assert 590 <= len(part) <= 610 < len(whole)
    assert len(part[0]) < len(whole[0])


def test_the_lines_on_faults_run_as_they_stand(
    readme_lines: Callable[[str], list[str]],
    started: Callable[[str], Any],
    run: Callable[..., str],
    graph: Any,
    tmp_path: Path,
    nothing_left_behind: None,
) -> None:
    kinds, inject, catalogue, soak, replay = readme_lines('Faults on purpose')
    assert len(run(kinds).splitlines()) >= 22
    with started('delta3 up'):
        run('delta3 move wait')
        run('delta3 move l 0.1 0 -0.8')
        run(inject)
    # half an hour, and ten minutes: until there is something, then Ctrl-C, which keeps it
    with started(catalogue) as process:
        read_until(process, 'drop_mdt')
    assert len((tmp_path / 'table.csv').read_text(encoding='utf-8').splitlines()) >= 2
    states = graph.listen(String, 'motion/state', LATCHED)
    with started(soak) as process:
        graph.spin_until(lambda: 'moving' in [state.data for state in states], 'the first program', 30.0)
    assert 'the figures are those until then' in process.communicate()[0]
    assert '1 programs in' in run(replay)
