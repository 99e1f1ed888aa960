"""A Delta-3 robot on a PacDrive motion controller, emulated on ROS 2.

The public face of the package, all of it without ROS:

    import delta3_pacdrive as d3

    robot = d3.load_parameters()                                  # or a file, or 'rich': the built robot
    trace = d3.simulate('experiment1', robot)                     # or a file, or a program
    trace = d3.load_trace('my_bag')                               # of a robot that was recorded
    theta = d3.kinematics.inverse([0.1, 0.0, -0.8], robot)        # rad, of points of shape (..., 3)
    tau = d3.dynamics.inverse(theta, [0.0] * 3, [0.0] * 3, robot)     # N m
"""

from __future__ import annotations

from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from delta3_pacdrive import dynamics, kinematics
    from delta3_pacdrive.motion.program import Program
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.peripherals.cell import Cell
    from delta3_pacdrive.recording.trace import Trace

__all__ = [
    'Parameters',
    'Program',
    'Trace',
    '__version__',
    'dynamics',
    'kinematics',
    'load_parameters',
    'load_program',
    'load_trace',
    'simulate',
]

# what is loaded when it is asked for first: numerical libraries take half a second
_LAZY = {
    'Parameters': 'delta3_pacdrive.parameters',
    'Program': 'delta3_pacdrive.motion.program',
    'Trace': 'delta3_pacdrive.recording.trace',
}


def load_parameters(path: str | Path | None = None) -> Parameters:
    """Read the parameters of a robot.

    Parameters
    ----------
    path
        A parameter file, or ``rich``: the built robot, or ``model``: feed-forward of the whole model, or several
        joined: ``rich+model``. Without it the packaged nominal robot.

    Returns
    -------
    robot
        Frozen groups ``kinematics``, ``dynamics``, ``motor``, ``drive``, ``motion``, ``bus`` and ``rich``, in SI units.

    Raises
    ------
    ParameterError
        The file cannot be read or breaks rules; names up to ten places and the rules.

    """
    from delta3_pacdrive import parameters

    return parameters.load(path)


def load_program(
    source: str | Path | Mapping[str, Any],
    parameters: Parameters,
    cell: Cell | str | Path | Mapping[str, Any] | None = None,
) -> Program:
    """Read a motion program.

    Parameters
    ----------
    source
        A YAML file, the name of a packaged program such as ``experiment1``, or what such a file would hold.
    parameters
        Of the robot: what the program does not limit, they do.
    cell
        What stands around the robot, as ``simulate`` takes it: the program may use its names of outputs.

    Returns
    -------
    program
        Its statements, read but not planned yet.

    Raises
    ------
    ProgramError
        The file cannot be read or breaks rules; names up to ten places and the rules.
    CellError
        The same of the cell.

    """
    from delta3_pacdrive.motion import program_file
    from delta3_pacdrive.motion.output_names import OWN
    from delta3_pacdrive.peripherals.cell_file import cell_of

    around = cell_of(cell)
    outputs = OWN if around is None else around.output_names
    if isinstance(source, (str, PathLike)):
        return program_file.load(source, parameters.motion, outputs)
    return program_file.parse(source, parameters.motion, outputs=outputs)


def load_trace(path: str | Path) -> Trace:
    """Read a recording.

    Parameters
    ----------
    path
        A trace (``.npz``, or ``.csv`` with units in its header), or the folder of a bag.

    Returns
    -------
    trace
        Its signals, as those of ``simulate``; a bag has no true values, which no topic tells.

    Raises
    ------
    TraceError
        There is no such recording, or it cannot be read.

    """
    from delta3_pacdrive.recording import trace_file

    return trace_file.load(path)


def simulate(
    program: Program | str | Path,
    parameters: Parameters | None = None,
    signals: Sequence[str] = (),
    cell: Cell | str | Path | Mapping[str, Any] | None = None,
) -> Trace:
    """Run a program on a robot, without ROS and without a clock: the same control and plant code as the nodes.

    Parameters
    ----------
    program
        A program, its file, or the name of a packaged one.
    parameters
        Of the robot; without them those of ``delta3 simulate``: nominal, with the controller of the thesis for its
        packaged programs, else with the one that knows the model.
    signals
        What is told on request only, by names and patterns: ``payload``, ``outputs``, ``tcp_speed``, ``drive_*``.
    cell
        Cell of the robot: a cell file, ``'cell'`` for the packaged one, what such a file would hold, or a ``Cell``. Its
        gripper takes real parts then; ``trace.meta['cell']`` tells what has happened to them.

    Returns
    -------
    trace
        Every signal cycle by cycle: ``trace.time_s`` [s], shape (n,), ``trace['current']`` [A], ``trace['tcp_error']``
        [m] and so on, shape (n, 3); ``trace.meta['figures']`` has the figures of the run.

    Raises
    ------
    ProgramError
        The program cannot be read, or a move breaks a limit; says which, where and by how much.
    CellError
        The cell cannot be read; names up to ten places and the rules.
    RunError
        A drive cannot be enabled.
    TraceError
        There is no such signal.

    """
    from delta3_pacdrive.motion.program import Program
    from delta3_pacdrive.parameters import of_run
    from delta3_pacdrive.peripherals.cell_file import cell_of
    from delta3_pacdrive.simulation import run

    if parameters is None:
        named = program.source if isinstance(program, Program) else program
        parameters = load_parameters(of_run(None, named or None))
    read = program if isinstance(program, Program) else load_program(program, parameters, cell)
    around = cell_of(cell)
    if not signals:
        return run(read, parameters, cell=around)
    from delta3_pacdrive.analysis import trace_export

    trace_export.require_known(signals)
    return trace_export.completed(
        run(read, parameters, signals=trace_export.on_request(signals), cell=around), signals
    )


def __getattr__(name: str) -> Any:
    if name == '__version__':
        from importlib import metadata

        return metadata.version(__name__)
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    if name in ('dynamics', 'kinematics'):
        return import_module(f'{__name__}.{name}')
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return __all__
