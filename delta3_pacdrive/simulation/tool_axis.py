"""The simulated rotary axis on the bus: its drive and its mechanics, bus cycle by bus cycle.

Arguments of the kernels here:

``tool``
    Array of one record ``TOOL``, shape (1,).
``currents``
    Receives the currents of its motor in an exchange period [A], shape (steps, 1).
``payload_kg``
    Payload of the robot in this bus cycle [kg].
``control``
    Control word S-0-0134 of the MDT.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.control.cycle.rotary_axis import answer_turn, command_turn, error_at_places
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters, rotary_axis_parameters
from delta3_pacdrive.recording.signals import TURN_SIGNALS
from delta3_pacdrive.robot.drive.arrays import DRIVE
from delta3_pacdrive.robot.drive.mc4 import MC4, mc4_begin_cycle, mc4_run_period
from delta3_pacdrive.robot.plant.tool_axis import TOOL_PLANT, ToolAxis, advance_tool

TOOL = np.dtype(
    [
        ('drive', DRIVE, (1,)),
        ('plant', TOOL_PLANT, (1,)),
        ('exchanges', 'i8'),  # per bus cycle
        ('received', 'i8'),  # whether the drive receives the MDT
        ('status', 'i8'),  # S-0-0135
        # error of the true angle [rad], set-point delay removed: in the last AT, and maximum at the ends of moves
        ('true_error', 'f8'),
        ('true_place_error_max', 'f8'),
    ],
    align=True,
)
NAMES = tuple(TURN_SIGNALS)
TURN_COMMAND, TURN_POSITION, TURN_ERROR, TURN_SPEED, TURN_CURRENT, TURN_TRUE = range(len(NAMES))


@kernel
def run_tool(command, torque, control, payload_kg, tool, currents):
    """Run one bus cycle of drive and axis; sets the status.

    Parameters
    ----------
    command, torque
        Motor shaft [rad] and torque [N m] of the MDT.
    control, payload_kg, tool, currents
        As above.

    """
    r = tool[0]
    shaft = r.plant[0].shaft
    r.status = mc4_begin_cycle(
        r.received != 0, command, torque, control, (shaft[0], shaft[1], shaft[2]), r.drive, 0
    )
    for _ in range(r.exchanges):
        brake = mc4_run_period((shaft[0], shaft[1], shaft[2]), r.drive, 0, currents)
        advance_tool(currents, brake, payload_kg, r.plant)


@kernel
def note_turn_command(cycle, angle, tool, signals):
    """Record the commanded ``angle`` [rad] of a ``cycle``, and the true one, in ``signals``, shape (6, cycles)."""
    signals[TURN_COMMAND, cycle] = angle
    signals[TURN_TRUE, cycle] = tool[0].plant[0].state.angle


@kernel
def command_tool(cycle, control, task, timeline, payload_kg, parts):
    """Command the axis and run its bus cycle, after the arms; return whether its status word changes.

    Parameters
    ----------
    cycle
        Number of the bus cycle.
    task, timeline
        As in ``command_cycle``.
    control, payload_kg
        As above.
    parts
        Rotations, ``ROTARY`` and ``TOOL`` records, currents, and signals of shape (6, cycles).

    """
    turns, rotary, tool, currents, signals = parts
    before, c = tool[0].status, rotary[0].constants
    command_turn(cycle, task, timeline, turns, rotary)
    note_turn_command(cycle, rotary[0].state.angle, tool, signals)
    run_tool(task[0].motors[c.index], task[0].torques[c.index], control, payload_kg, tool, currents)
    return before != tool[0].status


@kernel
def answer_tool(cycle, task, parts):
    """Evaluate the feedback of the axis in a bus cycle, and record it.

    Parameters
    ----------
    cycle
        Number of the bus cycle.
    task
        As in ``command_cycle``.
    parts
        As in ``command_tool``, with signals of shape (6, cycles).

    """
    answer = parts[2][0].drive[0].state.answer
    answer_turn(cycle, answer[0], answer[2], task, parts[1])
    note_turn(cycle, parts)


@kernel
def note_turn(cycle, parts):
    """Record the feedback of the axis in a bus cycle, its evaluation, and the true values.

    Parameters
    ----------
    cycle, parts
        As in ``answer_tool``.

    """
    _, rotary, tool, _, signals = parts
    answer, constants = tool[0].drive[0].state.answer, tool[0].drive[0].constants
    t, ratio = rotary[0].state, rotary[0].constants.gear_ratio
    signals[TURN_POSITION, cycle] = answer[0] / ratio
    signals[TURN_ERROR, cycle] = t.error
    signals[TURN_SPEED, cycle] = answer[1] / ratio
    signals[TURN_CURRENT, cycle] = answer[2] / constants.torque_constant
    r = tool[0]
    before, r.true_error = r.true_error, t.due - signals[TURN_TRUE, cycle]
    r.true_place_error_max = max(r.true_place_error_max, error_at_places(cycle, r.true_error, before, rotary))


class ToolDrive:
    """The fourth drive and its axis."""

    def __init__(self, parameters: Parameters) -> None:
        bus, own = parameters.bus, rotary_axis_parameters(parameters, 0)
        samples = round(bus.exchange_period_s / parameters.drive.current_period_s)
        # arrays of the compiled loops: one record TOOL, and the motor currents of an exchange period [A]
        self.record: NDArray[Any] = np.zeros(1, TOOL)
        self.currents: Floats = np.zeros((samples, 1))
        self.drive = MC4(own, 0, (self.record['drive'][0], self.currents))
        self.axis = ToolAxis(parameters, self.record['plant'][0])
        self.record['exchanges'] = round(bus.cycle_time_s / bus.exchange_period_s)
        self.record['received'] = 1

    def cycle(self, command_rad: float, torque_n_m: float, control: int, payload_kg: float) -> None:
        """Run one bus cycle; see ``run_tool``."""
        run_tool(command_rad, torque_n_m, control, payload_kg, self.record, self.currents)

    @property
    def status(self) -> int:
        """Status word S-0-0135 of the last AT."""
        return int(self.record['status'][0])

    def to_dict(self) -> dict[str, float]:
        """Return results known only to a simulation, under their names in run results."""
        return {'turn_place_error_max_rad': float(self.record['true_place_error_max'][0])}

    @property
    def answer(self) -> tuple[float, float, float]:
        """Position [rad], speed [rad/s] and torque [N m] of the motor shaft in the last AT."""
        position, speed, torque = self.drive.answer.tolist()
        return position, speed, torque
