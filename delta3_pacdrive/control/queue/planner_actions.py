"""Actions of the planner: plans and motion profiles to send, programs to plan, requests to answer."""

from dataclasses import dataclass
from enum import Enum

from delta3_pacdrive.control.messages import ORDER, Request, RequestReport
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.queue.planning_job import Job
from delta3_pacdrive.errors import Reason
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.planning.paths.move import Move
from delta3_pacdrive.robot.faults.fault import Fault


@dataclass(frozen=True)
class Ordered:
    """Send a plan to the transformation task, or moves appended to the present one."""

    number: int
    moves: tuple[Move, ...]
    faults: tuple[Fault, ...]
    row: tuple[float, ...]  # start cycle, override, numbers of the moves; of appended moves see ``Extension``
    kind: str = ORDER


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
class Working:
    """Start a job in the planning thread."""

    job: Job


@dataclass(frozen=True)
class Cancelled:
    """Cancel a job."""

    number: int


@dataclass(frozen=True)
class Replied:
    """Reply to a request: rejected with a reason, or done, with a description."""

    request: Request
    reason: Reason | None
    sentence: str


@dataclass(frozen=True)
class Reported:
    """Publish the progress of a request for moves."""

    report: RequestReport


class Arrival(Enum):
    """Outcome of a trajectory with tolerances."""

    REACHED = 'the arms have reached the goal'
    OFF_PATH = 'an arm violated its path tolerance'
    OFF_GOAL = 'an arm was off the goal, or still moving, after the goal time'
    GIVEN_UP = 'the trajectory was cancelled'


@dataclass(frozen=True)
class Settled:
    """Report the outcome of the trajectory of a request."""

    identity: str
    arrival: Arrival
    reason: Reason | None


@dataclass(frozen=True)
class Mirrored:
    """Publish the motion state."""

    state: MotionState


Action = Ordered | Revoked | Changed | Working | Cancelled | Replied | Reported | Settled | Mirrored
