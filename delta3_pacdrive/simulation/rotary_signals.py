"""Signals of a rotary axis in a simulation.

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

from delta3_pacdrive.control.cycle.rotary_axis import error_at_places
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import ARMS
from delta3_pacdrive.recording.signals import TURN_SIGNALS

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
