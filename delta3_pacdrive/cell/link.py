"""What a script needs of a robot: the same few things of one that is simulated and of one that is up."""

from dataclasses import dataclass
from typing import Protocol

from delta3_pacdrive.controller.belt_knowledge import BeltKnowledge, TrackOrder
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.wait_condition import WaitCondition
from delta3_pacdrive.errors import Reason, RefusedError
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.motion.extension import Extension
from delta3_pacdrive.motion.output_names import OutputNames
from delta3_pacdrive.motion.program import Point
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.parameters import Parameters


class HeldError(RefusedError):
    """Somebody else than the script has stopped the robot on its path: ``profile`` is what the master follows."""

    def __init__(self, reason: Reason, profile: MotionProfile) -> None:
        super().__init__(reason)
        self.profile = profile


@dataclass(frozen=True)
class Seen:
    """A script sees this of a bus cycle: the newest one whose answers are evaluated.

    Attributes
    ----------
    cycle
        Number of the bus cycle.
    motion
        What is done with the TCP.
    command_m, position_m
        Where the TCP is commanded to be, and where it is.
    outputs, payload_kg
        Outputs as bits, and what they have gripped.
    inputs
        As bits.
    planned_m
        Where the plan has the TCP: elsewhere than it is commanded to be, as long as it goes with a belt.
    turn_rad
        Where the tool is commanded to be; None: the robot has no rotary axis.

    """

    cycle: int
    motion: MotionState
    command_m: Point
    position_m: Point
    outputs: int
    payload_kg: float
    inputs: int
    planned_m: Point
    turn_rad: float | None = None


class StoppedError(RefusedError):
    """Somebody has stopped a robot that goes with a belt, and does so no longer."""


class Link(Protocol):
    """A robot on which a script runs. Every order is for a bus cycle that is still to come; all raise Delta3Error."""

    @property
    def parameters(self) -> Parameters:
        """Of the robot."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""

    @property
    def outputs(self) -> OutputNames:
        """The outputs that a script may name."""

    @property
    def tracking(self) -> BeltKnowledge | None:
        """Belts on the bus, as they are known in the cycle that ``look`` tells of; None: there are none."""

    def look(self) -> Seen:
        """Return the newest bus cycle whose answers are evaluated; takes no bus time."""

    @property
    def extra_cycles(self) -> int:
        """So many bus cycles later than usual an order can take effect at the earliest; 0 without a clock."""

    def start(self, planned: Planned, cycle: int, override: float) -> int:
        """Start a program at a bus cycle; return the one in which it starts. Late, it is refused (``Code.LATE``)."""

    def extend(self, extension: Extension) -> int:
        """Let moves follow those that are driven; return the bus cycle from which on they do, as ``start`` does."""

    def change(self, profile: MotionProfile) -> int:
        """Go over to another motion profile, an override or a resume; return from which bus cycle on."""

    def hold(self, cycle: int) -> MotionProfile:
        """Let the bus go on to a cycle, and stop the robot on its path from there on."""

    def get_on(self, order: TrackOrder) -> None:
        """Say which belt is meant by the next event of the plan that gets on one."""

    def get_on_again(self, cycle: int) -> None:
        """Get on the belt again after ``hold``, or leave it, from a bus cycle on."""

    def abandon(self, cycle: int) -> None:
        """Let the bus go on to a cycle, stop from there on, and forget moves and belt once the robot stands."""

    def wait(self, condition: WaitCondition) -> bool:
        """Let the bus go on until a condition is met or its latest cycle is over; return whether it is met.

        Raises RefusedError with ``Code.BELT``, once, when the robot could not stay on a belt and stands.
        """
