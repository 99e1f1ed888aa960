"""Tests of the kernels of drives and plant with a CUDA compiler, which needs no GPU."""

import importlib.util
import subprocess
import sys

import pytest

# every kernel becomes a device function; what calls another one then finds that
COMPILE = """\
import sys
from types import SimpleNamespace
import numba.cuda.dispatcher
from numba import cuda, from_dtype, types
from numba.core.registry import CPUDispatcher
from delta3_pacdrive.robot.plant.built_robot import BUILT
from delta3_pacdrive.simulation import robot

numba.cuda.dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=(7, 5))  # there is none here
made = {}
for name, module in list(sys.modules.items()):
    for key, value in list(vars(module).items()) if name.startswith('delta3_pacdrive') else ():
        if isinstance(value, CPUDispatcher):
            setattr(module, key, made.setdefault(value, cuda.jit(device=True)(value.py_func)))
table, numbers = from_dtype(robot.ROBOT)[::1], types.float64[::1]
arguments = (numbers, types.int64, types.float64, table, BUILT_TYPE, types.float64[:, ::1])
code, _ = cuda.compile_ptx(robot.robot_cycle.py_func, arguments, device=True, cc=(7, 5))
print(code.count('.func'), 'robot_cycle' in code)
"""


@pytest.mark.skipif(importlib.util.find_spec('numba_cuda') is None, reason='numba-cuda is not installed')
@pytest.mark.parametrize('built', ['types.none', 'from_dtype(BUILT)[::1]'], ids=['rigid', 'built'])
def test_a_bus_cycle_of_drives_and_plant_is_compiled_for_a_gpu(built):
    done = subprocess.run(
        [sys.executable, '-P', '-c', COMPILE.replace('BUILT_TYPE', built)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    functions, named = done.stdout.split()
    assert int(functions) >= 1
    assert named == 'True'
