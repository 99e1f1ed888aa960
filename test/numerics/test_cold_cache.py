"""The fact about a cache of compiled kernels in which there is nothing yet; ``test/run`` begins with it.

This module imports nothing of the package: the first import of a kernel already compiles some.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

LIMIT_S = 1000.0  # for a compilation on a busy machine
COMPILE = """
import json
from delta3_pacdrive import simulation
from delta3_pacdrive.numerics import kernel
from delta3_pacdrive.simulation import warm_up
shown, saved = [], []
kernel_watched = kernel.watched
def watched(tell):
    return kernel_watched(lambda: (saved.append(1), tell()))
warm_up.watched = watched
simulation.compile_kernels(lambda done, total: shown.append((done, total)))
answer = {'saved': len(saved), 'shown': shown, 'all': kernel.all_compiled()}
print(json.dumps(answer | {'compiled': kernel.compiled(), 'kernels': simulation.KERNELS}))
"""
RUN = """
import json
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.numerics import kernel
saved = []
with kernel.watched(lambda: saved.append(1)):
    simulation.rehearse(parameters.load())
print(json.dumps(len(saved)))
"""


@pytest.fixture
def cold(monkeypatch, tmp_path):
    """Return a cache that holds no file: that of all tests, if they have begun with such a one, or another."""
    cache = Path(os.environ.get('NUMBA_CACHE_DIR') or tmp_path)
    if any(path.is_file() for path in cache.rglob('*')):
        cache = tmp_path
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(cache))
    return cache


def started(program):
    """Start a program."""
    command = [sys.executable, '-P', '-c', program]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def answers_of(processes):
    """Return what programs answer that have come to their end."""
    results = [(process, *process.communicate(timeout=LIMIT_S)) for process in processes]
    for process, _, errors in results:
        assert process.returncode == 0, errors
    return [json.loads(output) for _, output, _ in results]


def test_two_processes_that_meet_a_cold_cache_compile_every_kernel_once(cold):
    processes = [started(COMPILE), started(COMPILE)]
    try:
        answers = answers_of(processes)
    finally:
        for process in processes:
            process.kill()
    assert min(answer['saved'] for answer in answers) == 0
    for answer in answers:
        assert answer['all']
        assert answer['compiled'] == answer['kernels']
        assert {total for _, total in answer['shown']} == {answer['kernels']}
        done = [count for count, _ in answer['shown']]
        assert done == sorted(done)
        assert len(set(done)) > 10  # also who waits sees how far the other one is
    binaries = len(list(cold.rglob('*.nbc')))
    # this process compiled some of them, its helpers the others, and none was compiled by both
    assert max(answer['saved'] for answer in answers) <= binaries
    if len(os.sched_getaffinity(0)) > 1:
        assert max(answer['saved'] for answer in answers) < binaries
    # nothing is compiled in the middle of a run
    assert answers_of([started(RUN)]) == [0]
