"""Signals of a simulation besides those of the arms: rotary axes, and optional signals.

Optional signals are internal values of the task and the drives, recorded once per bus cycle. Without any, compiled
stretches of cycles run as usual. With some, cycles run one by one, with identical results.

Arguments of the kernels here:

``cycle``
    Number of a bus cycle.
``rotary``
    Array of one record ``control.cycle.rotary_axis.ROTARY``, shape (1,).
``robot``
    Array of one record ``ROBOT``, shape (1,).
``signals``
    Receives the signals of the axis in the order of ``NAMES``, shape (6, cycles).
"""

from collections.abc import Sequence

import numpy as np

from delta3_pacdrive.cell.world import World
from delta3_pacdrive.control.cycle.rotary_axis import error_at_places
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters
from delta3_pacdrive.recording.signals import OF_CELLS, OF_DRIVES, OUTPUT_COLUMNS, TURN_SIGNALS, columns_of
from delta3_pacdrive.robot.drive.channels import channel_named
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.simulation.robot import Robot

OF_TASK = ('payload', 'outputs', 'lost_telegrams', 'overruns', 'fault')
NAMES = tuple(TURN_SIGNALS)
TURN_COMMAND, TURN_POSITION, TURN_ERROR, TURN_SPEED, TURN_CURRENT, TURN_TRUE = range(len(NAMES))


@kernel
def note_turn_command(cycle, rotary, robot, signals):
    """Record the commanded angle [rad] of a bus cycle, and the true one at its start."""
    signals[TURN_COMMAND, cycle] = rotary[0].state.angle
    signals[TURN_TRUE, cycle] = robot[0].rotary[rotary[0].constants.index - ARMS].state.angle


@kernel
def note_turn(cycle, rotary, robot, signals):
    """Record the feedback of a bus cycle, its evaluation, and the true errors."""
    t, ratio, i = rotary[0].state, rotary[0].constants.gear_ratio, rotary[0].constants.index
    r, number = robot[0], i - ARMS
    signals[TURN_POSITION, cycle] = r.answers[0, i] / ratio
    signals[TURN_ERROR, cycle] = t.error
    signals[TURN_SPEED, cycle] = r.answers[1, i] / ratio
    signals[TURN_CURRENT, cycle] = r.answers[2, i] / r.drives[i].constants.torque_constant
    before, r.turn_errors[number] = r.turn_errors[number], t.due - signals[TURN_TRUE, cycle]
    r.turn_place_errors[number] = max(
        r.turn_place_errors[number], error_at_places(cycle, r.turn_errors[number], before, rotary)
    )


class OptionalSignals:
    """Recorder of the optional signals of a simulation.

    Parameters
    ----------
    names
        Names in ``OF_TASK``, ``drive_`` with a channel of the drives, or ``cell_`` with a signal of the cell; others
        are ignored.
    robot, parameters
        The simulated robot, and its parameters.
    world
        The cell around it, if any.

    """

    def __init__(
        self, names: Sequence[str], robot: Robot, parameters: Parameters, world: World | None = None
    ) -> None:
        self._drives, self._parameters, self._world = robot.drives[:ARMS], parameters, world
        self._of_cell: dict[str, list[list[float]]] = {
            name: [] for name in names if name.startswith(OF_CELLS) and world is not None
        }
        self._channels = {
            name: channel_named(name.removeprefix(OF_DRIVES)) for name in names if name.startswith(OF_DRIVES)
        }
        self._of_task = [name for name in OF_TASK if name in names]
        sources = dict.fromkeys(source for channel in self._channels.values() for source in channel.sources)
        self._columns = {source: place for place, source in enumerate(sources)}
        self._states: list[list[list[float]]] = []  # by cycle and axis
        self._task: dict[str, list[list[float]]] = {name: [] for name in self._of_task}

    def __bool__(self) -> bool:
        """Whether anything is recorded."""
        return bool(self._channels or self._of_task or self._of_cell)

    def note_begin(self) -> None:
        """Record the state of the drives before a bus cycle, which are their samples at the instant of the AT."""
        if self._channels:
            states = (drive.state[0] for drive in self._drives)
            self._states.append([[float(state[name]) for name in self._columns] for state in states])

    def note_end(self, task: Transformation, axes: AxisMonitor) -> None:
        """Record the state of the task after a bus cycle; without a clock nothing is late."""
        if self._of_cell and self._world is not None:
            signals = self._world.signals()
            for name, rows in self._of_cell.items():
                rows.append(signals[name])
        for name, rows in self._task.items():
            if name == 'payload':
                rows.append([task.payload])
            elif name == 'outputs':
                rows.append([float(task.outputs >> n & 1) for n in range(len(OUTPUT_COLUMNS))])
            elif name == 'lost_telegrams':
                rows.append([float(sum(axes.losses))])
            else:
                rows.append([0.0])

    def signals(self, fault_cycle: int) -> dict[str, Floats]:
        """Return the signals, shapes (cycles, columns); ``fault_cycle`` is that of a robot fault, or ``NEVER``."""
        found = {
            name: np.array(rows, dtype=np.float64).reshape(-1, len(columns_of(name, '')))
            for name, rows in (self._task | self._of_cell).items()
        }
        if 'fault' in found:
            found['fault'][fault_cycle:] = 1.0
        if self._channels:
            states = np.array(self._states, dtype=np.float64)
            for name, channel in self._channels.items():
                places = [self._columns[source] for source in channel.sources]
                of_axes = [
                    channel.formula(
                        self._parameters,
                        drive.constants[0],
                        *(np.ascontiguousarray(states[:, axis, place]) for place in places),
                    )
                    for axis, drive in enumerate(self._drives)
                ]
                found[name] = np.column_stack(of_axes)
        return found
