"""Displayed values of the page and its UI commands as plain records."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from delta3_pacdrive.numerics.types import Floats

PARTS_MAX = 1000  # drawn parts of a cell: the newest
Point = tuple[float, float, float]


def _zeros() -> Floats:
    return np.zeros(3)


@dataclass(frozen=True)
class PartPlace:
    """A part at an instant, with the pose of the centre of its underside."""

    number: int
    type: str
    size_m: Point  # length, width, height
    at_m: Point
    angle_rad: float  # about the vertical


@dataclass(frozen=True)
class CellInstant:
    """The parts of a cell at an instant, and the distance travelled by each belt [m]."""

    parts: tuple[PartPlace, ...] = ()
    ways_m: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TurnInstant:
    """A rotary axis of the tool at an instant."""

    angle_rad: float  # by the encoder of its motor
    error_rad: float = 0.0  # command minus actual without the set-point delay
    true_rad: float | None = None  # None: unknown


def tool_angle_rad(turns: Sequence[TurnInstant]) -> float:
    """Return the angle of the tool: each of the ``turns`` is a rotation relative to the axis before."""
    return sum((turn.angle_rad for turn in turns), 0.0)


@dataclass(frozen=True)
class Instant:
    """The state of the robot at an instant; all arrays have shape (3,)."""

    time_s: float  # of the bus
    theta_rad: Floats
    lag_rad: Floats = field(default_factory=_zeros)  # following error of each arm, dead time removed (7.3)
    torque_n_m: Floats = field(default_factory=_zeros)
    current_a: Floats = field(default_factory=_zeros)
    overload: Floats = field(default_factory=_zeros)  # I2t of each motor; its drive trips at 1
    speed_m_s: float = 0.0  # of the TCP
    true_m: Floats | None = None  # true TCP of the built robot; None: unknown
    error_m: Floats = field(default_factory=_zeros)  # TCP command minus actual without the set-point delay
    cell: CellInstant | None = None
    turns: tuple[TurnInstant, ...] = ()  # of each rotary axis; empty if unknown


@dataclass(frozen=True)
class DriveFacts:
    """State of a drive, its brake (free, held, empty: unknown) and its warnings."""

    state: str = ''
    brake: str = ''
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class InputFacts:
    """State of an input of a cell, and whether it is forced."""

    name: str
    on: bool
    forced: bool = False


@dataclass(frozen=True, kw_only=True)
class Facts:
    """The values of the readout, in addition to an instant."""

    state: str = ''  # of the motion: idle, moving, steered, stopping, stopped, error; empty without a robot
    enabled: bool = False  # torque is requested
    in_torque: bool = False
    phase: str = ''
    cycle: int = 0
    bus_time_s: float = 0.0
    override: float = 1.0  # playback speed of a recording
    overruns: int = 0  # since the start of cyclic operation
    lost_telegrams: int = 0
    waiting: str = ''  # reason for waiting
    fault: str = ''
    sources: tuple[str, ...] = ()  # possible sources of the fault
    drives: tuple[DriveFacts, ...] = (DriveFacts(), DriveFacts(), DriveFacts())
    move: int = 0
    moves: int = 0
    remaining_s: float | None = 0.0  # None: unknown, as the robot is held
    queue: int = 0  # moves
    working: str = ''  # planning progress
    operator: str = ''  # in control
    recording: str = ''  # title of a recording
    payload_kg: float | None = 0.0  # None: the cell shows the part in the gripper
    outputs: int = 0  # bits
    inputs: tuple[InputFacts, ...] = ()
    controller: str = ''  # description; empty while unknown


@dataclass(frozen=True)
class UiCommand:
    """A command from the page.

    The action is one of ``delta3 move``, or ``packaged`` (name of a program), ``program`` (its text), ``step`` (a
    direction such as +x, a distance [mm] and a speed [mm/s]), ``press`` (heartbeat of a held button: direction and
    speed), ``jog`` (number of the press that starts a motion), ``inject`` (a fault in YAML), ``teach`` (a name),
    ``forget``, ``input`` (a request of the service of that name), ``procedure`` (an axis and the IDN of a procedure
    command), ``end_procedure``, ``scope`` (the setting of an oscilloscope, see ``scope_panel``) and ``end_scope``.
    """

    action: str
    text: str = ''
    by_force: bool = False  # take control over from another operator
    time_s: float = field(default_factory=time.monotonic, compare=False)  # monotonic clock
