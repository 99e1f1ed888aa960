"""``cell.simulate``: a robot that is simulated as far as a script asks, and the trace of all that it did."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from delta3_pacdrive.cell.belt_robot import BeltRobot
from delta3_pacdrive.cell.inputs import Given
from delta3_pacdrive.cell.place import of_caller
from delta3_pacdrive.cell.simulated import SimulatedLink
from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.parameters import Parameters, load, of_run
from delta3_pacdrive.peripherals.cell import Cell
from delta3_pacdrive.peripherals.cell_file import cell_of
from delta3_pacdrive.recording.acquisition import Acquisition
from delta3_pacdrive.recording.trace import Trace

LONGEST_S = 600.0  # of bus time
CellSource = Cell | str | Path | Mapping[str, Any] | None


class Simulation(BeltRobot):
    """The robot of a script that is simulated."""

    def __init__(self, link: SimulatedLink, name: str) -> None:
        super().__init__(link, name)
        self._simulated, self._name = link, name
        self._trace: Trace | None = None

    @property
    def trace(self) -> Trace:
        """Every signal of the run, cycle by cycle; raises RunError as long as the script has not ended."""
        if self._trace is None:
            raise RunError('the trace of a simulated script is there once the script has ended')
        return self._trace

    def end(self, why: str = '') -> None:
        """End the simulation: with the moves that are ordered, or, if there is a reason why not, held on the path."""
        try:
            if why:
                self.give_up()
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
    """Simulate a robot while a script decides what it does.

    Parameters
    ----------
    parameters
        Of the robot, or their file; without them the nominal robot, whose controller knows the model.
    inputs
        Of each input its changes, ``{'part': [(0.4, True), (0.9, False)]}``, at times [s] since the script began; or a
        function that returns all inputs by name for the number of a bus cycle.
    name
        Of the script in traces and reports; without it that of its file.
    longest_s
        Bus time after which the simulation ends [s].
    signals
        On request: ``payload``, ``outputs``, ``lost_telegrams``, and ``drive_`` with the name of a channel.
    acquisition
        Takes what oscilloscopes in the drives show.
    cell
        Cell of the robot instead of ``inputs``, with gripper, parts and sensors: a cell file, ``'cell'`` for the
        packaged one, what such a file would hold, or a ``Cell``.
    around
        Former name of ``cell``.

    Yields
    ------
    robot
        What the script calls. Once the script has ended, ``robot.trace`` has every signal of the run: an error in the
        script leaves the robot in a stop on its path.

    Raises
    ------
    ScriptError
        A call is refused, or the robot has stopped by a fault; tells file and line of the script.
    ParameterError, CellError
        Parameters or cell cannot be read.

    """
    if not longest_s > 0.0:
        raise RunError(f'longest_s is {longest_s}, but must be positive')
    given = parameters if isinstance(parameters, Parameters) else load(of_run(_text(parameters)))
    if around is not None:
        warnings.warn('around= of cell.simulate is now called cell=', DeprecationWarning, stacklevel=3)
        if cell is not None:
            raise RunError('cell= and its former name around= are both given')
    link = SimulatedLink(
        given, inputs, longest_s, acquisition, signals, cell_of(around if cell is None else cell)
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
