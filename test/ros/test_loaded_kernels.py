"""Tests of kernels: all kernels of a bus cycle are loaded before the nodes start."""

from pathlib import Path

import pytest

from new_interpreter import printed
from thoroughness import some

SUPPORT = Path(__file__).parents[1] / 'support'
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
    overrides['supply__enabled'] = robot.supply.enabled
    overrides['thermal__in_drives'] = robot.thermal.in_drives
    drives = '1234' if robot.rotary.present else '123'
    task = graph.robot(('plant', *drives, 'task'), **overrides)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    end = task.controller.answered + 20
    graph.spin_until(lambda: task.controller.answered >= end, 'cycles')
finally:
    graph.close()
print(sorted(loaded().items() - before.items()))
"""


def late(*arguments: str) -> str:
    """Return the kernels that a new process loads while its bus runs."""
    return printed(STANDING, *arguments)[0]


PREPARED = [
    ('', 'load_cyclic_kernels'),
    ('rich+rotary+supply+thermal', 'load_cyclic_kernels'),
    ('', 'precompile'),
]


@pytest.mark.parametrize(
    ('kind', 'prepare'),
    some(PREPARED, PREPARED[1:]),
)
def test_no_kernel_is_loaded_in_a_bus_cycle(kind: str, prepare: str) -> None:
    assert late(kind, prepare) == '[]'


def test_unloaded_kernels_are_loaded_in_a_bus_cycle() -> None:
    assert 'task_cycle.command_cycle' in late('')  # else the test would see nothing
