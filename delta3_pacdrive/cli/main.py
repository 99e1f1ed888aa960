"""Entry point of ``delta3``: finds the sub-command and imports only what it needs."""

from __future__ import annotations

import os
import sys

from delta3_pacdrive import interrupts, memory
from delta3_pacdrive.errors import Delta3Error, RunError, loading_failure

# matrices here are small: threads of BLAS only wait for each other, for a quarter of the processor. Who asks for
# threads gets them. It has to be said before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

COMMANDS = {
    'run': 'start a robot, run a program, stop everything',
    'up': 'start a robot and keep it up for moves, until Ctrl-C',
    'move': 'send moves and programs to a robot that is up; hold, resume, override, abort',
    'faults': 'inject faults; the catalogue of every fault in every state',
    'soak': 'random programs with random faults, for minutes or hours',
    'drive': 'read and write values of a drive by IDN, while the robot is up',
    'io': 'inputs and outputs of a robot with a cell; set inputs from outside',
    'scope': 'the oscilloscope of the drives: channels at 16 kHz, triggers, pre-trigger',
    'check': 'read and plan program, parameter and fault files; every move, every mistake',
    'plan': 'what the planner makes of a program, without running it: what limits each move',
    'pose': 'one place: kinematics, all eight solutions, limits, torques, what the robot can do there',
    'workspace': 'maps of speed, acceleration, payload, accuracy and singularity; a million poses in seconds',
    'simulate': 'run a program without ROS, as fast as possible',
    'view': 'the robot, or a recording, in three dimensions in the browser',
    'record': 'record a running robot into a rosbag2 folder',
    'export': 'the robot as URDF or MJCF; the signals of a recording as a table',
    'plot': 'draw the figures of a bag or a trace',
    'report': 'one HTML page of one or more runs: 3-D, all signals, moves, figures',
    'compare': 'how far two runs are apart, signal by signal and move by move',
    'arm': 'kinematics of the two-link arm of chapter 3',
    'jacobian': 'joint motion through the Jacobian, with exact and with inexact lengths (11.2)',
    'estimate': 'parameters of motors, masses and geometry from traces (chapter 9)',
    'calibrate': 'how each arm is built, from measured places of the TCP; poses, parameters, zero angles',
    'experiment': 'experiments 1 to 3 of the thesis: model against robot (chapter 11)',
    'tune': 'step and frequency responses of the loops, margins, effect of gains on a program',
    'learn': 'the torques that a program still lacks, from repetitions of it, for simulate and run',
    'ripple': 'currents inside a bus cycle: cycle times and fine interpolations side by side',
    'sweep': 'many runs with varying parameters, on all cores or a cluster: distributions, effects, yield',
    'optimise': 'values of parameters and programs for which a number is best, within limits',
    'line': 'a shift of several robots at belts: who picks what by which rule, what is missed and why',
    'completion': 'print what a shell needs to complete all of this',
    'bench': 'measure: graph, robots, motion, simulate, kinematics, estimation, control, cell, sweep, network',
}
# these have a robot to bring to rest before they end
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

commands:
{commands}

delta3 COMMAND --help tells the options of a command.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status. Without arguments the process is this command, and no other."""
    own = arguments is None
    if own:
        _open_streams()
        interrupts.install()
        memory.collect_seldom()
        for stream in (sys.stdout, sys.stderr):
            # names of files need not be text, and no terminal need know every sign
            if hasattr(stream, 'reconfigure'):
                stream.reconfigure(errors='backslashreplace')
    status = _run(list(sys.argv[1:] if arguments is None else arguments), own)
    if own:
        interrupts.ignore()
        interrupts.end_within(interrupts.END_S, status)
    return status


def _open_streams() -> None:
    """Let a standard stream that is closed lead nowhere, so that no file which is opened later takes its place."""
    for name, mode in (('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w')):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding='utf-8'))  # noqa: SIM115 (it stays open)


def bringup() -> int:
    """Be ``ros2 run delta3_pacdrive bringup``."""
    return _be('run')


def record() -> int:
    """Be ``ros2 run delta3_pacdrive record``."""
    return _be('record')


def _be(command: str) -> int:
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
        print('error: there is not enough memory', file=sys.stderr)
        return 1
    except KeyboardInterrupt as error:  # before the command began to work
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
    if isinstance(error, Delta3Error):  # kernels that have no folder, while a command is imported
        print(f'error: {error}', file=sys.stderr)
    elif not isinstance(error, BrokenPipeError):
        print(f'error: cannot write the output: {error.strerror or error}', file=sys.stderr)
    from delta3_pacdrive.cli.output import discard_output

    discard_output()
    return 1


def _dispatch(arguments: list[str]) -> int:
    import importlib

    if not arguments or arguments[0] in ('-h', '--help'):
        lines = '\n'.join(f'  {name:<10} {text}' for name, text in COMMANDS.items())
        sys.stdout.write(HELP.format(commands=lines))
        return 0 if arguments else 2
    if arguments[0] == '--version':
        from importlib import metadata

        print(f'delta3_pacdrive {metadata.version("delta3_pacdrive")}')
        return 0
    command, *rest = arguments
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
    module = importlib.import_module(f'delta3_pacdrive.cli.{command}')
    with interrupts.raising(command in OF_ROBOTS):
        return int(module.main(rest))


def _check_surroundings(command: str, rest: list[str]) -> None:
    """Raise RunError if a command cannot work here, whatever its options are."""
    if {'-h', '--help'}.intersection(rest):
        return
    for_a_robot = _is_for_a_robot(command, rest)
    memory.require(for_a_robot)
    if for_a_robot:
        from delta3_pacdrive.ros import domain

        domain.check()


def _is_for_a_robot(command: str, rest: list[str]) -> bool:
    """Whether a command takes part in a ROS graph."""
    if command in ('drive', 'io', 'scope', 'faults', 'bench'):
        return rest[:1] not in (['list'], ['motion'], ['simulate'], ['kinematics'], ['cell'])
    return command in OF_ROBOTS or (command == 'experiment' and '--graph' in rest)


if __name__ == '__main__':
    sys.exit(main())
