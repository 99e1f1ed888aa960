"""Actions of the controller: what planner and transformation task publish, send, log and reply.

State machines return actions in order, and the nodes carry them out; a ``Job`` of the planner is one as well. Actions
of bus master and slaves concern telegrams only: ``robot.sercos.master``, ``robot.sercos.slave``.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from delta3_pacdrive.control.messages import FAULT, ORDER, RequestReport
from delta3_pacdrive.control.motion_state import Event, MotionState
from delta3_pacdrive.errors import Reason
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.paths.move import Move
from delta3_pacdrive.robot.faults.fault import Fault
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer


@dataclass(frozen=True)
class Entered:
    """Publish the motion state; the planner, which repeats the state of the task, does not know the event."""

    state: MotionState
    event: Event | None = None


@dataclass(frozen=True)
class Replied:
    """Reply to a request: rejected with a reason, or done, with a description.

    A ``routine`` reply, one of a stream of requests, is not logged.
    """

    request: Any
    reason: Reason | None
    sentence: str
    routine: bool = False


@dataclass(frozen=True)
class Logged:
    """Log a message."""

    sentence: str
    error: bool = False


# transformation task --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Followed:
    """Publish the motion profile that the master follows now or from its cycle on."""

    profile: MotionProfile


@dataclass(frozen=True)
class Located:
    """Publish the position [m] of the robot, which is ready for a program from a bus cycle on."""

    tcp_m: Floats
    cycle: int


@dataclass(frozen=True)
class Switched:
    """Publish outputs and payload, which have changed with the command of a bus cycle."""

    cycle: int


@dataclass(frozen=True)
class AccessRequested:
    """Access a drive through its service channel; ``done`` is called with its index and the response."""

    index: int
    access: Access
    done: Callable[[int, Answer], None]


@dataclass(frozen=True)
class Injected:
    """Inject faults of a program, counted from a bus cycle."""

    faults: tuple[Fault, ...]
    cycle: int


# planner --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ordered:
    """Send a plan to the transformation task, or moves appended to the present one."""

    number: int
    moves: tuple[Move, ...]
    faults: tuple[Fault, ...]
    row: tuple[float, ...]  # start cycle, override, numbers of the moves; of appended moves see ``Extension``
    kind: str = ORDER

    def rows(self) -> Iterator[tuple[str, Any]]:
        """Yield kind and values of each row of the message: moves, faults, and the row that ends them."""
        count = len(self.moves)
        yield from ((move.kind.name, move.to_array(n, count)) for n, move in enumerate(self.moves))
        yield from ((FAULT, fault.to_row()) for fault in self.faults)
        yield self.kind, self.row


@dataclass(frozen=True)
class Revoked:
    """Revoke an order."""

    number: int


@dataclass(frozen=True)
class Changed:
    """Send a motion profile to the transformation task."""

    number: int
    profile: MotionProfile


@dataclass(frozen=True)
class Overridden:
    """Send the override, 1 = as planned, which the transformation task applies to set points."""

    number: int
    override: float


@dataclass(frozen=True)
class Cancelled:
    """Cancel a job of the planning thread."""

    number: int


@dataclass(frozen=True)
class Reported:
    """Publish the progress of a request for moves."""

    report: RequestReport


class Arrival(Enum):
    """Outcome of a trajectory with tolerances."""

    REACHED = 'the arms have reached the goal'
    OFF_PATH = 'an arm violated its path tolerance'
    OFF_GOAL = 'an arm was off the goal, or still moving, after the goal time'
    CANCELLED = 'the trajectory was cancelled'


@dataclass(frozen=True)
class Settled:
    """Report the outcome of the trajectory of a request."""

    identity: str
    arrival: Arrival
    reason: Reason | None


PlannerAction = Ordered | Revoked | Changed | Overridden | Cancelled | Reported | Settled | Entered | Replied
RobotAction = Entered | Followed | Located | Switched | AccessRequested | Injected | Replied | Logged
