"""Motion states of the robot and their transitions."""

import math
from enum import StrEnum


class MotionState(StrEnum):
    """Motion of the TCP."""

    IDLE = 'idle'
    MOVING = 'moving'
    STEERED = 'steered'  # set points move it on line
    STOPPING = 'stopping'
    STOPPED = 'stopped'
    ERROR = 'error'
    COMMISSIONING = 'commissioning'  # a drive executes a procedure command


def sentence(state: str) -> str:
    """Return a motion state as a sentence, such as ``the robot is moving``."""
    return 'the robot is in the error state' if state == MotionState.ERROR else f'the robot is {state}'


UNDER_WAY = (MotionState.MOVING, MotionState.STOPPING, MotionState.STOPPED)  # a program is running or held


class Event(StrEnum):
    """Event of a motion."""

    START = 'start'  # a program starts
    CHANGE = 'change'  # the master switches to another motion profile: override, resume
    EXTEND = 'extend'  # moves are appended
    STEER = 'steer'  # set points move the robot from now on
    HOLD = 'hold'
    ABORT = 'abort'
    REST = 'stand'  # the master is at rest on its path
    CLEAR = 'give up'  # at rest, and the program was aborted
    END = 'end'  # the last feedback of the program has arrived
    FAIL = 'fail'  # a fault was found
    RESET = 'reset'  # faults are cleared
    COMMISSION = 'commission'  # a procedure command starts


TRANSITIONS = {
    (MotionState.IDLE, Event.START): MotionState.MOVING,
    (MotionState.IDLE, Event.STEER): MotionState.STEERED,
    (MotionState.STEERED, Event.HOLD): MotionState.STEERED,
    (MotionState.STEERED, Event.ABORT): MotionState.STEERED,
    (MotionState.STEERED, Event.END): MotionState.IDLE,
    (MotionState.MOVING, Event.CHANGE): MotionState.MOVING,
    (MotionState.MOVING, Event.EXTEND): MotionState.MOVING,
    (MotionState.MOVING, Event.HOLD): MotionState.STOPPING,
    (MotionState.MOVING, Event.ABORT): MotionState.STOPPING,
    (MotionState.MOVING, Event.END): MotionState.IDLE,
    (MotionState.STOPPING, Event.ABORT): MotionState.STOPPING,
    (MotionState.STOPPING, Event.REST): MotionState.STOPPED,
    (MotionState.STOPPING, Event.CLEAR): MotionState.IDLE,
    (MotionState.STOPPED, Event.CHANGE): MotionState.MOVING,
    (MotionState.STOPPED, Event.EXTEND): MotionState.STOPPED,
    (MotionState.STOPPED, Event.ABORT): MotionState.STOPPED,
    (MotionState.STOPPED, Event.CLEAR): MotionState.IDLE,
    (MotionState.ERROR, Event.RESET): MotionState.IDLE,
    (MotionState.IDLE, Event.COMMISSION): MotionState.COMMISSIONING,
    (MotionState.COMMISSIONING, Event.END): MotionState.IDLE,
    **{(state, Event.FAIL): MotionState.ERROR for state in MotionState},
}
"""Transitions; other events are rejected or ignored."""


def percent_allowed(override_max: float) -> int:
    """Return the largest whole percentage that does not exceed an override, 1 = as planned."""
    percent = math.floor(100.0 * override_max) + 1
    while percent / 100.0 > override_max:
        percent -= 1
    return percent


def at_percent(override: float) -> str:
    """Return the override as a suffix to a sentence, empty for 100 %."""
    return '' if override == 1.0 else f' at {100.0 * override:.4g} %'
