"""Interface between a script and its robot, simulated or running, and the steering of the TCP through it."""

from typing import Protocol

from delta3_pacdrive.belts.knowledge import BeltKnowledge, TrackOrder
from delta3_pacdrive.control.cycle.set_points import SetPoint
from delta3_pacdrive.control.operation.script_operations import Snapshot
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Reason, RefusedError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.extension import Extension
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program.output_names import OutputNames
from delta3_pacdrive.planning.program_planner import Planned


class HeldError(RefusedError):
    """Another client has stopped the robot on its path; ``profile`` is the motion profile of the stop."""

    def __init__(self, reason: Reason, profile: MotionProfile) -> None:
        super().__init__(reason)
        self.profile = profile


class StoppedError(RefusedError):
    """Another client has stopped the robot on a belt; it no longer moves with the belt."""


class Link(Protocol):
    """Connection of a script to its robot.

    Every order takes effect in a future bus cycle. All methods raise Delta3Error.
    """

    @property
    def parameters(self) -> Parameters:
        """Parameters of the robot."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""

    @property
    def outputs(self) -> OutputNames:
        """Names of the outputs."""

    @property
    def tracking(self) -> BeltKnowledge:
        """State of the belts in the cycle of ``poll``; the same object for the whole script."""

    def poll(self) -> Snapshot:
        """Return the state in the latest evaluated bus cycle; takes no bus time."""

    @property
    def extra_cycles(self) -> int:
        """Additional bus cycles until an order can take effect; 0 without a clock."""

    def start(self, planned: Planned, cycle: int, override: float) -> int:
        """Start a program in a bus cycle; return the actual start cycle. A late order is rejected (``Code.LATE``)."""

    def extend(self, extension: Extension) -> int:
        """Append moves to the running program; return the bus cycle in which they take effect, like ``start``."""

    def change(self, profile: MotionProfile) -> int:
        """Change the motion profile for an override or a resume; return the bus cycle in which it takes effect."""

    def hold(self, cycle: int) -> MotionProfile:
        """Run the bus to a cycle and stop the robot on its path from that cycle."""

    def track(self, order: TrackOrder) -> None:
        """Set the belt for the next event of the plan that enters a belt."""

    def track_again(self, cycle: int) -> None:
        """Synchronize with the belt again after ``hold``, or leave it, from a bus cycle."""

    def steer(self, cycle: int, limits: Limits) -> None:
        """Let set points move the robot from a bus cycle on; ``cancel`` ends it."""

    def set_point(self, cycle: int, point: SetPoint) -> None:
        """Give a steered robot a set point that counts from a bus cycle on."""

    def cancel(self, cycle: int) -> None:
        """Run the bus to a cycle, stop from that cycle, and clear moves and belt once the robot is at rest."""

    def wait(self, condition: WaitCondition) -> bool:
        """Run the bus until a condition is met or its latest cycle has passed; return whether it is met.

        Raises RefusedError with ``Code.BELT`` once if the robot has lost its belt and is at rest.
        """
