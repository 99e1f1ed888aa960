"""Main functions of the node executables: help, and checks before a node is started.

They handle Ctrl-C before ROS and numba are loaded, which takes a second.
"""

import importlib
import signal
import sys

from delta3_pacdrive import interrupts, memory
from delta3_pacdrive.errors import RunError, loading_failure
from delta3_pacdrive.ros.wire import domain


def unit_robot() -> int:
    """Run the planner's process."""
    return _start('unit_robot')


def transformation_task() -> int:
    """Run the task's process."""
    return _start('transformation_task')


def mc4_drive() -> int:
    """Run a drive's process."""
    return _start('mc4_drive')


def plant() -> int:
    """Run the plant's process."""
    return _start('plant')


def robot_visualization() -> int:
    """Run the process of the visualization."""
    return _start('robot_visualization')


def _start(kind: str) -> int:
    interrupts.install()
    memory.collect_seldom()
    if {'-h', '--help'}.intersection(sys.argv[1:]):
        from delta3_pacdrive.ros import node_help

        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # a pager may close the pipe early
        print(node_help.text(kind), end='')  # noqa: T201 (a command line prints)
        return 0
    try:
        memory.require(in_a_graph=True)
        domain.check()
        module = importlib.import_module(f'delta3_pacdrive.ros.nodes.{kind}')
    except Exception as error:
        sentence = str(error) if isinstance(error, RunError) else loading_failure(error)
        if sentence is None:
            raise
        sys.stderr.write(f'error: {sentence}\n')
        return 1
    return int(module.main())
