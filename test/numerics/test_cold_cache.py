"""Tests of an empty cache of compiled kernels; ``test/run`` runs them first.

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
import json, sys
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.numerics import kernel
from delta3_pacdrive.simulation import warm_up
shown, saved = [], []
kernel_watched = kernel.watched
def watched(tell):
    return kernel_watched(lambda: (saved.append(1), tell()))
warm_up.watched = watched
robot = parameters.load(sys.argv[1]) if sys.argv[1:] else None
simulation.compile_kernels(robot, lambda done, total: shown.append((done, total)))
answer = {'saved': len(saved), 'shown': shown, 'all': kernel.all_compiled(robot.kind if robot else '')}
print(json.dumps(answer | {'compiled': kernel.compiled(), 'kernels': kernel.kernels()}))
"""
RUN = """
import json, sys
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.numerics import kernel
saved = []
with kernel.watched(lambda: saved.append(1)):
    for kind in sys.argv[1].split(','):
        simulation.precompile(parameters.load(kind))
print(json.dumps(len(saved)))
"""


@pytest.fixture(scope='module')
def cold(tmp_path_factory):
    """Return a cache that holds no file: that of all tests, if they have begun with such a one, or another."""
    own = tmp_path_factory.mktemp('kernels')
    cache = Path(os.environ.get('NUMBA_CACHE_DIR') or own)
    if any(path.is_file() for path in cache.rglob('*')):
        cache = own
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('NUMBA_CACHE_DIR', str(cache))
        yield cache


def answers_of(program, *kinds):
    """Return the outputs of a program in parallel processes, one for each kind of robot."""
    processes = [
        subprocess.Popen(
            [sys.executable, '-P', '-c', program, *filter(None, [kind])],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for kind in kinds
    ]
    try:
        results = [(process, *process.communicate(timeout=LIMIT_S)) for process in processes]
    finally:
        for process in processes:
            process.kill()
    for process, _, errors in results:
        assert process.returncode == 0, errors
    return [json.loads(output) for _, output, _ in results]


def test_two_processes_that_meet_a_cold_cache_compile_every_kernel_once(cold):
    answers = answers_of(COMPILE, '', '')
    assert min(answer['saved'] for answer in answers) == 0
    for answer in answers:
        assert answer['all']
        assert 100 < answer['compiled'] <= answer['kernels']
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
    assert answers_of(RUN, 'delta3') == [0]


def test_additional_kernels_of_a_kind_of_robot_are_compiled_before_it_runs(cold):
    answers_of(COMPILE, '')
    before = len(list(cold.rglob('*.nbc')))
    answers = answers_of(COMPILE, 'rich', 'rich', 'rotary')
    assert min(answer['saved'] for answer in answers[:2]) == 0  # who comes second waits for the first
    assert all(answer['all'] for answer in answers)
    assert {total for answer in answers for _, total in answer['shown']} == {0}
    assert max(done for answer in answers for done, _ in answer['shown']) > 10
    (both,) = answers_of(COMPILE, 'rich+rotary')
    assert both['all']
    # two processes have compiled them together, and none twice
    assert sum(answer['saved'] for answer in [*answers, both]) <= len(list(cold.rglob('*.nbc'))) - before
    assert answers_of(RUN, 'rich,rotary,rich+rotary') == [0]
