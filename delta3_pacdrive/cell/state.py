"""What a script is told of its robot."""

from collections.abc import Mapping
from dataclasses import dataclass

from delta3_pacdrive.motion.program import Point


@dataclass(frozen=True)
class State:
    """A robot in a bus cycle: the newest one whose answers are evaluated.

    Attributes
    ----------
    cycle, time_s
        Number of the bus cycle, and bus time since the script began [s].
    motion
        ``idle``, ``moving``, ``stopping`` or ``stopped``.
    position_m, command_m
        Where the TCP is, and where it is commanded to be [m].
    left_s
        Time of motion left of what is ordered [s]; inf while the robot is held.
    outputs, inputs
        By name.
    payload_kg
        What the outputs have gripped.
    late
        Decisions that have taken effect later than they should; none without a clock.

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
