"""Facts about kernels: whatever a bus cycle calls was loaded before the nodes began."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SUPPORT = Path(__file__).parents[1] / 'support'
LIMIT_S = 300.0
STANDING = f"""
import gc, sys
sys.path.insert(0, {str(SUPPORT)!r})
from numba.core.registry import CPUDispatcher
from delta3_pacdrive import parameters, simulation

def loaded():
    found = [one for one in gc.get_objects() if isinstance(one, CPUDispatcher)]
    return {{f'{{one.__module__}}.{{one.__name__}}': len(one.signatures) for one in found if one.signatures}}

kind, *names = sys.argv[1:]
robot = parameters.load(kind or None)
simulation.compile_kernels(robot)
for name in names:
    getattr(simulation, name)(robot)
before = loaded()
from robots import Graph

graph = Graph()
try:
    overrides = {{'rich__enabled': robot.rich.enabled, 'rotary__present': robot.rotary.present}}
    overrides['bus__exchange_period_s'] = robot.bus.exchange_period_s
    drives = '1234' if robot.rotary.present else '123'
    task = graph.robot(('plant', *drives, 'task'), **overrides)
    graph.spin_until(lambda: task.progress()['in_torque'], 'torque')
    end = task.controller.answered + 20
    graph.spin_until(lambda: task.controller.answered >= end, 'cycles')
finally:
    graph.close()
print(sorted(loaded().items() - before.items()))
"""


def late(*arguments: str) -> str:
    """Return the kernels that a new process loads while its bus runs."""
    done = subprocess.run(
        [sys.executable, '-P', '-c', STANDING, *arguments],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ('kind', 'prepare'),
    [('', 'load_cyclic_kernels'), ('rich+rotary', 'load_cyclic_kernels'), ('', 'rehearse')],
)
def test_no_kernel_is_loaded_in_a_bus_cycle(kind: str, prepare: str) -> None:
    assert late(kind, prepare) == '[]'


def test_kernels_that_nobody_has_loaded_are_loaded_in_a_bus_cycle() -> None:
    assert 'task_cycle.command_cycle' in late('')  # else the test would see nothing
