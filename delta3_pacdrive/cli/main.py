"""Entry point of ``delta3``: selects the sub-command and imports only its module."""

from __future__ import annotations

import os
import sys

from delta3_pacdrive import interrupts, memory
from delta3_pacdrive.errors import Delta3Error, RunError, loading_failure

# The matrices are small: BLAS threads only wait for each other and cost a quarter of the processor time.
# The variable must be set before numpy is imported; a value set by the user is kept.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

COMMAND_GROUPS = {
    'Robots': {
        'run': 'start a robot, run a program, stop the robot',
        'up': 'start a robot and keep it running until Ctrl-C',
        'move': 'send moves and programs to a running robot; hold, resume, override, abort, reset',
        'io': 'list the inputs and outputs of a running robot; set inputs',
        'drive': 'read and write drive parameters by IDN through the service channel',
        'scope': 'oscilloscope in the drives: up to 16 kHz, with trigger and pre-trigger',
        'commission': 'acceptance protocol of a running robot: every value with its limit, figures',
        'view': 'show a running robot or a recording in 3-D in the browser',
        'record': 'record a running robot into a rosbag2 folder',
    },
    'Programs without a robot': {
        'check': 'validate program, parameter, cell and fault files; list moves and errors',
        'plan': 'plan a program without running it; show what limits each move',
        'pose': 'analyse one pose: kinematics, all eight solutions, limits, torques, capability',
        'workspace': 'map speed, acceleration, payload, accuracy and singularities over the workspace',
        'simulate': 'run a program or script without ROS, as fast as possible',
        'plot': 'plot a bag or a trace',
        'export': 'export the robot as URDF or MJCF, or the signals of a recording as a table',
        'report': 'write an HTML report of one or more runs: 3-D, signals, moves, figures',
        'compare': 'compare two runs signal by signal and move by move',
    },
    'Studies': {
        'experiment': 'repeat experiments 1 to 3 of the thesis: model against robot (chapter 11)',
        'jacobian': 'joint motion through the Jacobian with exact and inexact lengths (section 11.2)',
        'learn': 'learn the feed-forward torques of a program by iterative learning control',
        'line': 'simulate a shift of several robots at common belts',
        'sweep': 'run a program many times with varied parameters, on all cores or on a cluster',
        'optimise': 'optimise values of parameters and programs under constraints',
        'ripple': 'motor currents within a bus cycle for different cycle times and interpolations',
        'two-link': 'kinematics of the planar two-link arm (chapter 3)',
        'tune': 'step and frequency responses, stability margins, gains',
        'estimate': 'estimate parameters of motors, masses and geometry from traces (chapter 9)',
        'calibrate': 'identify the geometry of each arm from measured TCP positions',
    },
    'Faults': {
        'faults': 'inject faults; test every fault in every state',
        'soak': 'run random programs with random faults for minutes or hours',
    },
    'Tools': {
        'bench': 'benchmarks: graph, robots, planning, simulation, kinematics, control, network',
        'completion': 'print the completion script for bash',
    },
}
COMMANDS = {name: text for group in COMMAND_GROUPS.values() for name, text in group.items()}
FORMER_NAMES = {'arm': 'two-link'}  # deprecated names of commands
# commands that bring their robot to rest before they exit
OF_ROBOTS = frozenset(
    {'run', 'up', 'move', 'faults', 'soak', 'drive', 'io', 'scope', 'view', 'record', 'bench'}
)


HELP = """\
usage: delta3 [-h] [--version] [command]

A Delta-3 robot on a PacDrive controller, emulated on ROS 2.

positional arguments:
  command     one of the commands below

options:
  -h, --help  show this text
  --version   show the version

{commands}

delta3 COMMAND --help shows the options of a command.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status.

    Without arguments, use those of the process and install its signal handlers.
    """
    own = arguments is None
    if own:
        _open_streams()
        interrupts.install()
        memory.collect_seldom()
        for stream in (sys.stdout, sys.stderr):
            # file names may be invalid UTF-8, and terminals may lack characters
            if hasattr(stream, 'reconfigure'):
                stream.reconfigure(errors='backslashreplace')
    status = _run(list(sys.argv[1:] if arguments is None else arguments), own)
    if own:
        interrupts.ignore()
        interrupts.end_within(interrupts.END_S, status)
    return status


def _open_streams() -> None:
    """Redirect closed standard streams to the null device, so that no later file gets their descriptors."""
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: SIM115 (it stays open)


def bringup() -> int:
    """Entry point of ``ros2 run delta3_pacdrive bringup``."""
    return _run_as('run')


def record() -> int:
    """Entry point of ``ros2 run delta3_pacdrive record``."""
    return _run_as('record')


def _run_as(command: str) -> int:
    sys.argv.insert(1, command)
    return main()


def _run(arguments: list[str], own: bool) -> int:
    try:
        status = _dispatch(arguments)
    except SystemExit as end:  # argparse: --help, a usage error
        if not own:
            raise
        status = end.code if isinstance(end.code, int) else 1
    except MemoryError:
        print('error: not enough memory', file=sys.stderr)
        return 1
    except KeyboardInterrupt as error:  # before the command started
        interrupts.ignore()
        print(f'error: {error}', file=sys.stderr)
        return interrupts.status(interrupts.asked()) if interrupts.asked() else 130
    except OSError as error:
        return _cannot_write(error)
    except Exception as error:
        sentence = loading_failure(error)
        if sentence is None:
            raise
        print(f'error: {sentence}', file=sys.stderr)
        return 1
    try:
        sys.stdout.flush()
    except OSError as error:
        return _cannot_write(error)
    return status


def _cannot_write(error: OSError) -> int:
    if isinstance(error, Delta3Error):  # no cache folder for kernels while a command is imported
        print(f'error: {error}', file=sys.stderr)
    elif not isinstance(error, BrokenPipeError):
        print(f'error: cannot write the output: {error.strerror or error}', file=sys.stderr)
    from delta3_pacdrive.cli.output import discard_output

    discard_output()
    return 1


def _dispatch(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ('-h', '--help'):
        blocks = [
            '\n'.join([f'{title}:', *(f'  {name:<10} {text}' for name, text in group.items())])
            for title, group in COMMAND_GROUPS.items()
        ]
        sys.stdout.write(HELP.format(commands='\n\n'.join(blocks)))
        return 0 if arguments else 2
    if arguments[0] == '--version':
        from importlib import metadata

        print(f'delta3_pacdrive {metadata.version("delta3_pacdrive")}')
        return 0
    command, *rest = arguments
    if command in FORMER_NAMES:
        from delta3_pacdrive.cli.command import warn_renamed

        former, command = command, FORMER_NAMES[command]
        warn_renamed(f'delta3 {former}', f'delta3 {command}')
    if command not in COMMANDS:
        from difflib import get_close_matches

        near = get_close_matches(command, COMMANDS, 1)
        hint = f'did you mean {near[0]}?' if near else f'expected one of {", ".join(COMMANDS)}'
        print(f'delta3: error: unknown command {command!r}: {hint}', file=sys.stderr)
        return 2
    try:
        _check_surroundings(command, rest)
    except RunError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    run = load_command(command)
    with interrupts.raising(command in OF_ROBOTS):
        return int(run(rest))


def load_command(name: str) -> Any:
    """Import the module of a command and return its entry point."""
    import importlib

    module = importlib.import_module(f'delta3_pacdrive.cli.{name.replace("-", "_")}')
    return module.main


def _check_surroundings(command: str, rest: list[str]) -> None:
    """Raise RunError if memory or the ROS domain do not permit the command."""
    if {'-h', '--help'}.intersection(rest):
        return
    for_a_robot = _is_for_a_robot(command, rest)
    memory.require(for_a_robot)
    if for_a_robot:
        from delta3_pacdrive.ros.wire import domain

        domain.check()


def _is_for_a_robot(command: str, rest: list[str]) -> bool:
    """Whether the command joins a ROS graph."""
    if command in ('drive', 'io', 'scope', 'faults', 'bench'):
        return rest[:1] not in (['list'], ['motion'], ['simulate'], ['kinematics'], ['cell'])
    return command in OF_ROBOTS or (command == 'experiment' and '--graph' in rest)


if __name__ == '__main__':
    sys.exit(main())
