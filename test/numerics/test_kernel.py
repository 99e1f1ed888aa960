"""Tests of the cache of compiled kernels: owner, compilation and resistance to damage."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import delta3_pacdrive
from delta3_pacdrive.numerics import kernel

LIMIT_S = 400.0  # for a compilation on a busy machine
LOOK_S = 1e-3  # between two looks
MOMENTS = int(os.environ.get('DELTA3_MOMENTS', '8'))  # at which a node that starts is interrupted
PACKAGE = Path(delta3_pacdrive.__file__).parent
# a program that only needs a few kernels, and tells whether it had to compile
FORWARD = """
import json, sys, time
import numpy as np
from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.numerics import kernel
saved = []
with kernel.watched(lambda: saved.append(1)):
    p = kinematics.forward(np.array([0.3, 0.35, 0.4]), parameters.load().kinematics)
print(json.dumps({'package': kernel.__file__, 'compiled': len(saved), 'p': p.tolist()}))
"""


@contextmanager
def started(command, **options):
    """Start a process, which does not outlive the test."""
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def over_within(process, seconds):
    """Whether a process ends within some time."""
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def environment(cache, root=None):
    found = os.environ | {'NUMBA_CACHE_DIR': str(cache)}
    return found | ({'PYTHONPATH': str(root)} if root else {})


def output_of(program, cache, root=None):
    command = [sys.executable, '-P', '-c', program]
    done = subprocess.run(
        command, env=environment(cache, root), capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture
def copy(tmp_path):
    """Return a folder that holds a second copy of the package."""
    root = tmp_path / 'second place'
    shutil.copytree(PACKAGE, root / PACKAGE.name)
    if not (PACKAGE / 'config').is_dir():
        shutil.copytree(PACKAGE.parent / 'config', root / 'config')
    return root


@pytest.fixture(scope='module')
def compiled(tmp_path_factory):
    """Return the output of a program that filled a cache, and that cache."""
    cache = tmp_path_factory.mktemp('kernels') / 'cache'
    return output_of(FORWARD, cache), cache


@pytest.fixture
def first(compiled, tmp_path):
    """Return that output; the test has an own cache, filled by the program."""
    answer, cache = compiled
    shutil.copytree(cache, tmp_path / 'cache')
    return answer


@pytest.mark.long
def test_second_copy_of_the_sources_uses_the_kernels_compiled_by_the_first(copy, first, tmp_path):
    assert first['compiled'] > 5
    second = output_of(FORWARD, tmp_path / 'cache', copy)
    assert Path(second['package']).is_relative_to(copy)
    assert second['compiled'] == 0
    assert second['p'] == first['p']


def test_a_changed_formula_is_compiled_again_and_a_changed_report_is_not(copy, first, tmp_path):
    for name in (
        'studies/runs/run_figures.py',
        'cli/plot.py',
        'studies/drives/tuning/report.py',
        'ros/nodes/plant.py',
    ):
        with (copy / PACKAGE.name / name).open('a') as file:
            file.write('\n# an edit\n')
    assert output_of(FORWARD, tmp_path / 'cache', copy)['compiled'] == 0
    # errors holds no kernel, but what kinematics imports may change what its kernels do
    for name in ('kinematics.py', 'errors.py'):
        with (copy / PACKAGE.name / name).open('a') as file:
            file.write('\n# an edit\n')
        assert output_of(FORWARD, tmp_path / 'cache', copy)['compiled'] >= 3, name


def test_kernel_of_another_module_is_not_cached_because_its_callees_are_unknown():
    saved = []
    with kernel.watched(lambda: saved.append(True)):
        assert kernel.kernel(lambda x: 2.0 * x)(1.5) == 3.0
    assert not saved


PRODUCT = """
import json, sys
import numpy as np
from delta3_pacdrive.studies.runs import run_comparison
from delta3_pacdrive.numerics import kernel
kernel.row_at(1.0, np.eye(3), 0, 2)
idle = [name for name in ('scipy.linalg', 'scipy.signal', 'scipy.stats') if name in sys.modules]
product = kernel.kernel(lambda a, b: np.dot(a, b))(np.eye(2), np.full((2, 2), 3.0))
print(json.dumps({'idle': idle, 'product': product.tolist()}))
"""


@pytest.mark.long
def test_a_simulation_loads_no_linear_algebra_and_a_kernel_that_needs_some_has_it():
    command = [sys.executable, '-P', '-c', PRODUCT]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=True)
    assert json.loads(done.stdout) == {'idle': [], 'product': [[3.0, 3.0], [3.0, 3.0]]}


@pytest.mark.long
def test_a_damaged_binary_is_made_again(first, tmp_path):
    for number, path in enumerate((tmp_path / 'cache').rglob('*.nb[ci]')):
        path.write_bytes(path.read_bytes()[:100] if number % 2 else b'')
    again = output_of(FORWARD, tmp_path / 'cache')
    assert again['compiled'] == first['compiled']
    assert again['p'] == first['p']
    assert output_of(FORWARD, tmp_path / 'cache')['compiled'] == 0


def test_a_folder_that_others_can_write_holds_no_kernels(monkeypatch, tmp_path):
    cache, temporary = tmp_path / 'mine', tmp_path / f'delta3_pacdrive_{os.getuid()}'
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(cache))
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    assert kernel.cache_directory().is_relative_to(cache)
    assert kernel.cache_directory().stat().st_mode & 0o077 == 0
    cache.chmod(0o777)
    assert kernel.cache_directory().is_relative_to(temporary)
    temporary.chmod(0o777)  # as if another user had created it first
    with pytest.raises(
        kernel.KernelError, match='compiled kernels need a folder that only this user can write'
    ) as error:
        kernel.cache_directory()
    assert f'{cache}: other users can write to it; {temporary}: other users' in str(error.value)


NODE = [
    sys.executable,
    '-P',
    '-c',
    'from delta3_pacdrive.ros.nodes import start; raise SystemExit(start.plant())',
]


def test_one_signal_ends_a_node_that_compiles(tmp_path):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    with started(NODE, env=environment(tmp_path)) as process:
        assert re.match(rf'{kernel.COMPILING}: \d+ of \d+$', process.stderr.readline())
        while len(list(tmp_path.rglob('*.nbc'))) < 5:
            assert not over_within(process, LOOK_S)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=120.0)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == 'error: interrupted'
    assert 'Traceback' not in errors


MARK_COMPILED = """
import json, os
from delta3_pacdrive.numerics import kernel
kernel.mark_compiled()
left = {name for name in os.listdir(kernel.CACHE_DIRECTORY) if not name.endswith('lock')}
print(json.dumps({'compiled': kernel.all_compiled(), 'folder': str(kernel.FOLDER), 'left': sorted(left)}))
"""


def test_kernels_that_no_version_of_late_has_used_are_removed(tmp_path):
    present = Path(output_of(MARK_COMPILED, tmp_path)['folder'])
    now = time.time()
    for version in range(kernel.VERSIONS_KEPT + 1):  # the later, the longer ago
        (folder := present.with_name(f'old-{version}')).mkdir()
        (folder / kernel.MARK).touch()
        used = now - 2.0 * kernel.DAY_S - version
        os.utime(folder, (used, used))
    answer = output_of(MARK_COMPILED, tmp_path)
    assert answer['compiled']
    others = [f'old-{n}' for n in range(kernel.VERSIONS_KEPT - 1)]  # beside the present one
    assert answer['left'] == sorted([present.name, *others])
    for n in range(2 * kernel.VERSIONS_KEPT):
        present.with_name(f'today-{n}').mkdir()
    assert len(output_of(MARK_COMPILED, tmp_path)['left']) == 2 * kernel.VERSIONS_KEPT + 1


def test_a_version_that_is_used_is_not_old(tmp_path):
    folder = Path(output_of(MARK_COMPILED, tmp_path)['folder'])
    os.utime(folder, (1e9, 1e9))
    program = 'from delta3_pacdrive.numerics import kernel\nprint(int(kernel.all_compiled()))'
    assert output_of(program, tmp_path) == 1
    assert folder.stat().st_mtime > 1e9


def catches_sigterm(process):
    lines = Path(f'/proc/{process.pid}/status').read_text().splitlines()
    (mask,) = (int(line.split()[1], 16) for line in lines if line.startswith('SigCgt'))
    return bool(mask >> (signal.SIGTERM - 1) & 1)


@pytest.mark.long
def test_one_signal_at_any_moment_ends_a_node_that_starts(tmp_path):
    """Also while it loads kernels, where an exception would be lost in the compiler's callbacks."""
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    alone = os.environ | {'ROS_DOMAIN_ID': str(110 + os.getpid() % 100)}
    statuses = []
    for moment in range(MOMENTS):
        with started(NODE, env=alone, stdout=subprocess.PIPE) as process:
            while not catches_sigterm(process) and not over_within(process, LOOK_S):
                pass  # until then it is Python that starts, not the node
            if not over_within(process, (moment / MOMENTS) ** 2):
                process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=120.0)
        assert 'Traceback' not in errors
        assert process.returncode in (0, 130), errors  # 0: the node was up, and ended as a node ends
        statuses.append(process.returncode)
    assert statuses.count(130) >= MOMENTS // 4
