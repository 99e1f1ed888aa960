"""``scripting.simulate``: run a script on a simulated robot and record a trace."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from delta3_pacdrive.cell.cell import Cell
from delta3_pacdrive.cell.cell_file import cell_of
from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.parameters import Parameters, load, of_run
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.scripting.belt_robot import BeltRobot
from delta3_pacdrive.scripting.inputs import Given
from delta3_pacdrive.scripting.simulated_link import SimulatedLink
from delta3_pacdrive.scripting.source_position import of_caller

LONGEST_S = 600.0  # of bus time
CellSource = Cell | str | Path | Mapping[str, Any] | None


class Simulation(BeltRobot):
    """Simulated robot of a script."""

    def __init__(self, link: SimulatedLink, name: str) -> None:
        super().__init__(link, name)
        self._simulated, self._name = link, name
        self._trace: Trace | None = None

    @property
    def trace(self) -> Trace:
        """Signals of the run in every cycle; raises RunError before the script has ended."""
        if self._trace is None:
            raise RunError('the trace of a simulated script is available after the script has ended')
        return self._trace

    def end(self, why: str = '') -> None:
        """Finish the ordered moves, or with a reason ``why`` abort them on the path, and create the trace."""
        try:
            if why:
                self.abort()
            else:
                self.finish()
        except Delta3Error as error:
            if why:
                return self._keep(why)
            self._keep(str(error))
            raise
        return self._keep(why)

    def _keep(self, why: str) -> None:
        self._trace = self._simulated.trace(self._name, self.notices, why)


@contextmanager
def simulate(
    parameters: Parameters | str | Path | None = None,
    *,
    inputs: Given = None,
    name: str = '',
    longest_s: float = LONGEST_S,
    signals: Sequence[str] = (),
    acquisition: Acquisition | None = None,
    cell: CellSource = None,
    around: CellSource = None,
) -> Iterator[Simulation]:
    """Simulate a robot that is controlled by the script in the block.

    Parameters
    ----------
    parameters
        Parameters of the robot or their file; default: the nominal robot with the model-based controller.
    inputs
        Changes of each input, ``{'part': [(0.4, True), (0.9, False)]}``, at times since the start of the script [s]; or
        a function that returns all inputs by name for the number of a bus cycle.
    name
        Name of the script in traces and reports; default: its file name.
    longest_s
        Maximum bus time of the simulation [s].
    signals
        Additional signals: ``payload``, ``outputs``, ``lost_telegrams``, and ``drive_`` with the name of a channel.
    acquisition
        Receives the records of oscilloscopes in the drives.
    cell
        Cell with gripper, parts and sensors, in place of ``inputs``: a cell file, ``'cell'`` for the packaged one, the
        content of a file, or a ``Cell``.
    around
        Deprecated name of ``cell``.

    Yields
    ------
    robot
        Robot interface. After the block, ``robot.trace`` contains all signals of the run. An error in the script holds
        the robot on its path.

    Raises
    ------
    ScriptError
        A call is rejected, or a fault has stopped the robot; with file and line of the script.
    ParameterError, CellError
        Parameters or cell cannot be read.

    """
    if not longest_s > 0.0:
        raise RunError(f'longest_s is {longest_s}, but must be positive')
    given = parameters if isinstance(parameters, Parameters) else load(of_run(_text(parameters)))
    if around is not None:
        warnings.warn(
            'around= of scripting.simulate is deprecated, use cell=', DeprecationWarning, stacklevel=3
        )
        if cell is not None:
            raise RunError('cell= and its former name around= are both given')
    link = SimulatedLink(
        given,
        inputs,
        longest_s=longest_s,
        acquisition=acquisition,
        signals=signals,
        around=cell_of(around if cell is None else cell),
    )
    robot = Simulation(link, name or Path(of_caller().file).stem or 'script')
    try:
        yield robot
    except Exception as error:
        robot.end(str(error) or type(error).__name__)
        raise
    robot.end()


def _text(path: str | Path | None) -> str | None:
    return None if path is None else str(path)
