"""Delta-3 robot with a PacDrive motion controller, emulated on ROS 2.

The public API of the package, all of it without ROS:

    import delta3_pacdrive as d3

    robot = d3.load_parameters()                                  # or a file, or 'rich': the built robot
    trace = d3.simulate('experiment1', robot)                     # or a file, or a program
    trace = d3.load_trace('my_bag')                               # recorded from a running robot
    theta = d3.kinematics.inverse([0.1, 0.0, -0.8], robot)        # rad, of points of shape (..., 3)
    tau = d3.dynamics.inverse(theta, [0.0] * 3, [0.0] * 3, robot)     # N m
"""

from __future__ import annotations

from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import renamed_modules

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from delta3_pacdrive import dynamics, kinematics
    from delta3_pacdrive.cell.cell import Cell
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.planning.program.model import Program
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

# imported on first access: numerical libraries take half a second
_LAZY = {
    'Parameters': 'delta3_pacdrive.parameters',
    'Program': 'delta3_pacdrive.planning.program.model',
    'Trace': 'delta3_pacdrive.recording.trace',
}


def load_parameters(path: str | Path | None = None) -> Parameters:
    """Read the parameters of a robot.

    Parameters
    ----------
    path
        A parameter file; ``rich``: the built robot; ``model``: feed-forward of the whole model; several joined with
        ``+``: ``rich+model``. Default: the packaged nominal robot.

    Returns
    -------
    robot
        Frozen groups ``kinematics``, ``dynamics``, ``motor``, ``drive``, ``motion``, ``bus`` and ``rich``, in SI units.

    Raises
    ------
    ParameterError
        The file cannot be read or breaks rules; lists up to ten places with the rules.

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
        A YAML file, the name of a packaged program such as ``experiment1``, or the content of such a file.
    parameters
        Robot whose limits apply where the program sets none.
    cell
        Cell of the robot, as in ``simulate``: the program may use its output names.

    Returns
    -------
    program
        Its statements, not yet planned.

    Raises
    ------
    ProgramError
        The file cannot be read or breaks rules; lists up to ten places with the rules.
    CellError
        The same for the cell.

    """
    from delta3_pacdrive.cell.cell_file import cell_of
    from delta3_pacdrive.planning.program import file_reader as program_file
    from delta3_pacdrive.planning.program.output_names import OWN

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
        A trace (``.npz``, or ``.csv`` with units in its header) or a bag folder.

    Returns
    -------
    trace
        The signals, as from ``simulate``; a bag has no true values, because no topic publishes them.

    Raises
    ------
    TraceError
        The recording does not exist or cannot be read.

    """
    from delta3_pacdrive.recording import trace_file

    return trace_file.load(path)


def simulate(
    program: Program | str | Path,
    parameters: Parameters | None = None,
    signals: Sequence[str] = (),
    cell: Cell | str | Path | Mapping[str, Any] | None = None,
) -> Trace:
    """Run a program on a robot without ROS and faster than real time, with the control and plant code of the nodes.

    Parameters
    ----------
    program
        A program, its file, or the name of a packaged one; others use the controller with the whole model.
    parameters
        Robot; default as in ``delta3 simulate``: nominal, with the controller of the thesis for its packaged programs
        and the model-based controller for all others.
    signals
        Optional signals, by names and patterns: ``payload``, ``outputs``, ``tcp_speed``, ``drive_*``.
    cell
        A cell file, ``'cell'`` for the packaged one, the content of such a file, or a ``Cell``. With a cell the
        gripper handles parts; ``trace.meta['cell']`` reports them.

    Returns
    -------
    trace
        Every signal cycle by cycle: ``trace.time_s`` [s], shape (n,), ``trace['current']`` [A], ``trace['tcp_error']``
        [m] and so on, shape (n, 3); ``trace.meta['figures']`` holds the figures of the run.

    Raises
    ------
    ProgramError
        The program cannot be read, or a move breaks a limit; names the move, the place and the excess.
    CellError
        The cell cannot be read; lists up to ten places with the rules.
    RunError
        A drive cannot be enabled.
    TraceError
        A signal is unknown.

    """
    from delta3_pacdrive.cell.cell_file import cell_of
    from delta3_pacdrive.parameters import of_run
    from delta3_pacdrive.planning.program.model import Program
    from delta3_pacdrive.simulation import run

    if parameters is None:
        named = program.source if isinstance(program, Program) else program
        parameters = load_parameters(of_run(None, named or None))
    read = program if isinstance(program, Program) else load_program(program, parameters, cell)
    around = cell_of(cell)
    if not signals:
        return run(read, parameters, cell=around)
    from delta3_pacdrive.studies.runs import trace_export

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


renamed_modules.install()
