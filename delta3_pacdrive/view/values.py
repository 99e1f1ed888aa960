"""What the page shows, and what people ask for on it, as plain values."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from delta3_pacdrive.numerics.types import Floats

PARTS_MAX = 1000  # of a cell that are drawn: the newest
Point = tuple[float, float, float]


def _zeros() -> Floats:
    return np.zeros(3)


@dataclass(frozen=True)
class PartPlace:
    """A part at one moment.

    Attributes
    ----------
    number, type
        As ``PartRecord`` has them.
    size_m
        Its length, width and height [m].
    at_m, angle_rad
        Middle of its underside [m], and its angle about the vertical [rad].

    """

    number: int
    type: str
    size_m: Point
    at_m: Point
    angle_rad: float


@dataclass(frozen=True)
class CellInstant:
    """The parts of a cell at one moment, and how far the surfaces of its belts have come [m], by their names."""

    parts: tuple[PartPlace, ...] = ()
    ways_m: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TurnInstant:
    """The tool of a rotary axis at one moment.

    Attributes
    ----------
    angle_rad
        By the encoder of its motor [rad].
    error_rad
        Command minus actual, the set-point delay removed [rad].
    true_rad
        Where it really is [rad]; None where nobody knows.

    """

    angle_rad: float
    error_rad: float = 0.0
    true_rad: float | None = None


@dataclass(frozen=True)
class Instant:
    """What is known of the robot at one moment.

    Attributes
    ----------
    time_s
        Bus time [s].
    theta_rad
        Arm angles, shape (3,).
    lag_rad
        Following error of each arm, command minus actual with the dead time removed (7.3), shape (3,).
    torque_n_m, current_a
        Of each motor, shape (3,).
    overload
        I2t of each motor, 1 trips its drive, shape (3,).
    speed_m_s
        Of the TCP.
    true_m
        Where the TCP of the built robot really is [m], shape (3,); None where nobody knows.
    error_m
        TCP error as the robot tells it: command minus actual, the set-point delay removed [m], shape (3,).
    cell
        What moves around the robot; None: there is no cell.
    turn
        Of the tool; None: there is no rotary axis, or it is not known.

    """

    time_s: float
    theta_rad: Floats
    lag_rad: Floats = field(default_factory=_zeros)
    torque_n_m: Floats = field(default_factory=_zeros)
    current_a: Floats = field(default_factory=_zeros)
    overload: Floats = field(default_factory=_zeros)
    speed_m_s: float = 0.0
    true_m: Floats | None = None
    error_m: Floats = field(default_factory=_zeros)
    cell: CellInstant | None = None
    turn: TurnInstant | None = None


@dataclass(frozen=True)
class DriveFacts:
    """What a drive says of itself: its state, its brake (free, held, empty: unknown), what it warns of."""

    state: str = ''
    brake: str = ''
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class InputFacts:
    """An input of a cell: its name, whether it is on, and whether it was set from outside."""

    name: str
    on: bool
    forced: bool = False


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What there is to read about the robot, besides the numbers of an instant.

    Attributes
    ----------
    state
        Of the motion: idle, moving, stopping, stopped, error; empty while no robot is there.
    enabled, in_torque
        Whether the drives are to have torque, and whether they have.
    phase, cycle, bus_time_s
        Of the bus.
    override
        1 = as planned.
    overruns, lost_telegrams
        Counted since the bus is in cyclic operation.
    waiting
        For whom or what.
    fault, sources
        Sentence about the fault of the robot, and whose it is or may be; empty if there is none.
    drives
        One for each axis.
    move, moves, remaining_s
        Number of the move that is driven, how many there are, and how long they take; None of a robot that is held.
    queue, working
        Moves in the queue, and what is being planned.
    operator
        Who has control of the robot.
    recording
        Its title, if this is one; ``override`` is the speed at which it is played then.
    payload_kg, outputs
        What it is told to carry, None where a cell tells what is in hand; and its digital outputs as bits.
    inputs
        Of its cell.
    controller
        Which one it is, in words; empty as long as that is not known.

    """

    state: str = ''
    enabled: bool = False
    in_torque: bool = False
    phase: str = ''
    cycle: int = 0
    bus_time_s: float = 0.0
    override: float = 1.0
    overruns: int = 0
    lost_telegrams: int = 0
    waiting: str = ''
    fault: str = ''
    sources: tuple[str, ...] = ()
    drives: tuple[DriveFacts, ...] = (DriveFacts(), DriveFacts(), DriveFacts())
    move: int = 0
    moves: int = 0
    remaining_s: float | None = 0.0
    queue: int = 0
    working: str = ''
    operator: str = ''
    recording: str = ''
    payload_kg: float | None = 0.0
    outputs: int = 0
    inputs: tuple[InputFacts, ...] = ()
    controller: str = ''


@dataclass(frozen=True)
class Wish:
    """What somebody asks for on the page.

    Attributes
    ----------
    action
        As ``delta3 move`` has it; besides ``packaged`` (name of a program), ``program`` (its text), ``step`` (a
        direction such as +x, a distance [mm] and a speed [mm/s]), ``press`` (a beat of a button that is held: direction
        and speed), ``jog`` (number of the press that sets off), ``inject`` (a fault in YAML), ``teach`` (a name),
        ``forget``, ``input`` (a request of the service of that name), ``scope`` (what an oscilloscope is to record, as
        ``scope_panel`` reads it) and ``end_scope``.
    text
        What belongs to it.
    by_force
        Whether control of the robot is taken over from somebody else.
    time_s
        When it was asked for, on the clock that never jumps.

    """

    action: str
    text: str = ''
    by_force: bool = False
    time_s: float = field(default_factory=time.monotonic, compare=False)
