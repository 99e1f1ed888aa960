"""Actions of the robot state: messages to publish, drives to access, faults to inject."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.control.motion_state import Event, MotionState
from delta3_pacdrive.errors import Reason
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.robot.faults.fault import Fault
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer


@dataclass(frozen=True)
class Entered:
    """An event has changed the motion state."""

    state: MotionState
    event: Event


@dataclass(frozen=True)
class Followed:
    """The master follows a motion profile now or from its cycle on."""

    profile: MotionProfile


@dataclass(frozen=True)
class Located:
    """The robot is at a position [m], ready for a program, from a bus cycle on."""

    tcp_m: Floats
    cycle: int


@dataclass(frozen=True)
class Switched:
    """Outputs or payload have changed with the command of a bus cycle."""

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


@dataclass(frozen=True)
class Replied:
    """Reply to a waiting request: rejected with a reason, or done, with a description."""

    request: Any
    reason: Reason | None
    sentence: str


@dataclass(frozen=True)
class Logged:
    """Log a message."""

    sentence: str
    error: bool = False


Action = Entered | Followed | Located | Switched | AccessRequested | Injected | Replied | Logged
