"""What the planner wants done: plans and motion profiles to send, programs to plan, requests to answer."""

from dataclasses import dataclass
from enum import Enum

from delta3_pacdrive.controller.messages import ORDER, Request, RequestReport
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.planning_job import Job
from delta3_pacdrive.errors import Reason
from delta3_pacdrive.faults.fault import Fault
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.motion.move import Move


@dataclass(frozen=True)
class Ordered:
    """A plan goes to the transformation task, or moves behind those of the present one."""

    number: int
    moves: tuple[Move, ...]
    faults: tuple[Fault, ...]
    row: tuple[
        float, ...
    ]  # start cycle, override, numbers of the moves; of moves that follow see ``Extension``
    kind: str = ORDER


@dataclass(frozen=True)
class Revoked:
    """An order is taken back."""

    number: int


@dataclass(frozen=True)
class Changed:
    """A motion profile goes to the transformation task."""

    number: int
    profile: MotionProfile


@dataclass(frozen=True)
class Working:
    """A job begins in the planning thread."""

    job: Job


@dataclass(frozen=True)
class Cancelled:
    """A job is given up."""

    number: int


@dataclass(frozen=True)
class Replied:
    """A request is answered: refused with a reason, or done, with a sentence."""

    request: Request
    reason: Reason | None
    sentence: str


@dataclass(frozen=True)
class Reported:
    """Something has become of the moves of a request."""

    report: RequestReport


class Arrival(Enum):
    """What becomes of a trajectory that has tolerances."""

    REACHED = 'the arms have come to its goal'
    OFF_PATH = 'an arm was too far off on the way'
    OFF_GOAL = 'an arm was too far off, or still moved, when the goal time was over'
    GIVEN_UP = 'the goal is not waited for any more'


@dataclass(frozen=True)
class Settled:
    """A trajectory, known by its request, has violated its tolerances for a reason, or kept them to its goal."""

    identity: str
    arrival: Arrival
    reason: Reason | None


@dataclass(frozen=True)
class Mirrored:
    """The motion is in a state."""

    state: MotionState


Action = Ordered | Revoked | Changed | Working | Cancelled | Replied | Reported | Settled | Mirrored
