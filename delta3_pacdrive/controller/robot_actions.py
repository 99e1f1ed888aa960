"""What the state of the robot wants told, asked and done."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.controller.motion_state import Event, MotionState
from delta3_pacdrive.errors import Reason
from delta3_pacdrive.faults.fault import Fault
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.sercos.service_channel import Access, Answer


@dataclass(frozen=True)
class Entered:
    """An event has led the motion to a state."""

    state: MotionState
    event: Event


@dataclass(frozen=True)
class Followed:
    """The master follows a motion profile, or will."""

    profile: MotionProfile


@dataclass(frozen=True)
class Located:
    """The robot stands at a place [m] and can take a program, from a bus cycle on."""

    tcp_m: Floats
    cycle: int


@dataclass(frozen=True)
class Switched:
    """Outputs or the payload have changed with the command of a bus cycle."""

    cycle: int


@dataclass(frozen=True)
class Asked:
    """A drive is asked through its service channel; ``done`` is called with its number and the answer."""

    index: int
    access: Access
    done: Callable[[int, Answer], None]


@dataclass(frozen=True)
class Injected:
    """Faults of a program count from a bus cycle on."""

    faults: tuple[Fault, ...]
    cycle: int


@dataclass(frozen=True)
class Answered:
    """A request that had to wait is answered: refused with a reason, or done, with a sentence."""

    request: Any
    reason: Reason | None
    sentence: str


@dataclass(frozen=True)
class Said:
    """Something for the log, an error if it is one."""

    sentence: str
    error: bool = False


Action = Entered | Followed | Located | Switched | Asked | Injected | Answered | Said
