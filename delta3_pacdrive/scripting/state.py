"""Robot state for scripts."""

from collections.abc import Mapping
from dataclasses import dataclass

from delta3_pacdrive.planning.program.model import Point


@dataclass(frozen=True)
class State:
    """State of the robot in the latest evaluated bus cycle.

    Attributes
    ----------
    cycle, time_s
        Number of the bus cycle, and bus time since the start of the script [s].
    motion
        ``idle``, ``moving``, ``stopping`` or ``stopped``.
    position_m, command_m
        Actual and commanded TCP position [m].
    left_s
        Remaining time of the ordered moves [s]; inf while the robot is held.
    outputs, inputs
        Values by name.
    payload_kg
        Payload set by the outputs [kg].
    late
        Number of decisions that took effect late; 0 without a clock.

    """

    cycle: int
    time_s: float
    motion: str
    position_m: Point
    command_m: Point
    left_s: float
    outputs: Mapping[str, bool]
    inputs: Mapping[str, bool]
    payload_kg: float
    late: int = 0
