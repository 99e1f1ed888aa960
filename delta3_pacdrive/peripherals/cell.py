"""A packaging cell as values: what its file says. Places are in the frame ``base``, lengths in m, times in s.

Times count from the start of the program, as those of faults do.
"""

import math
from dataclasses import dataclass, field

from delta3_pacdrive.motion.move import OUTPUTS
from delta3_pacdrive.motion.output_names import NamedOutput, OutputNames
from delta3_pacdrive.peripherals.belt import Belt

Place = tuple[float, float, float]  # [m]

STANDARD_GRAVITY_M_S2 = 9.80665
FALLEN_FAR_M = 0.005  # a part that is let go higher than that above its support falls, and is not placed


def turned(place_m: Place, angle_rad: float) -> Place:
    """Return a place that is turned about the vertical through the origin [m]; not a bit of it changes at 0 rad."""
    if angle_rad == 0.0:
        return place_m
    (x, y, z), cos, sin = place_m, math.cos(angle_rad), math.sin(angle_rad)
    return (cos * x - sin * y, sin * x + cos * y, z)


@dataclass(frozen=True)
class Delays:
    """How a binary signal follows what it tells.

    Attributes
    ----------
    on_s, off_s
        From a change to its effect [s].
    bounce_s
        For how long it goes to and fro after each change [s].

    """

    on_s: float = 0.0
    off_s: float = 0.0
    bounce_s: float = 0.0


@dataclass(frozen=True)
class Change:
    """An input is set from a time on [s], by whoever plays the plant around the cell."""

    after_s: float
    value: bool


@dataclass(frozen=True)
class Sensor:
    """A sensor sees whether a part lies, or hangs, within a radius [m] of a place [m] beside it, at any height."""

    at_m: Place
    radius_m: float


@dataclass(frozen=True)
class Input:
    """An input: what it follows, and how fast.

    Attributes
    ----------
    name
        Of the input.
    delays
        Of its signal.
    changes
        What it is set to, in the order of time; empty: it follows the sensor.
    sensor
        None: only ``changes`` set it, or an output.
    follows
        Output of the robot that it follows, with the delays of that; empty: none.

    """

    name: str
    delays: Delays = Delays()
    changes: tuple[Change, ...] = ()
    sensor: Sensor | None = None
    follows: str = ''


@dataclass(frozen=True)
class CellOutput:
    """An output of the robot has a name in the cell: ``delays`` are those of what hangs at it."""

    output: str
    delays: Delays = Delays()


@dataclass(frozen=True)
class VacuumSwitch:
    """The vacuum switch: an input that is on from a vacuum on [Pa], and off again below a lower one [Pa]."""

    input: str
    on_pa: float
    off_pa: float
    delays: Delays = Delays()


@dataclass(frozen=True)
class Cup:
    """The vacuum cup with its valve.

    Attributes
    ----------
    output
        The output of the robot that opens the valve.
    valve
        From the output to the valve.
    diameter_m
        Of the area that the vacuum works on [m].
    vacuum_pa
        What the pump reaches on a part [Pa], below the pressure around it.
    open_share
        Share of that which a cup without a part reaches.
    build_up_s, decay_s
        Time constants of the vacuum [s].
    height_tolerance_m, lateral_tolerance_m
        How far the cup may be from the middle of a part's top, up and down and beside it, to close on it [m].
    offset_m
        From the TCP to the middle of the cup [m].
    switch
        None: nothing tells the vacuum.

    """

    output: str
    diameter_m: float
    vacuum_pa: float
    valve: Delays = Delays()
    open_share: float = 0.1
    build_up_s: float = 0.0
    decay_s: float = 0.0
    height_tolerance_m: float = 0.0015
    lateral_tolerance_m: float = 0.005
    offset_m: Place = (0.0, 0.0, 0.0)
    switch: VacuumSwitch | None = None

    @property
    def area_m2(self) -> float:
        """Area that the vacuum works on [m^2]."""
        return 0.25 * math.pi * self.diameter_m**2


@dataclass(frozen=True)
class PartType:
    """A type of parts.

    Attributes
    ----------
    name
        Of the type.
    mass_kg
        Of one part [kg].
    size_m
        Length, width and height [m].
    friction
        Between cup and part: the force along the cup over the force onto it.

    """

    name: str
    mass_kg: float
    size_m: Place
    friction: float


@dataclass(frozen=True)
class Supply:
    """A place where a part lies, and after a while another one when it was taken.

    Attributes
    ----------
    name
        Of the supply.
    part
        Type of its parts.
    at_m
        Middle of the underside of a part [m].
    angle_rad
        Of a part about the vertical [rad].
    count
        How many parts there are.
    refill_s
        From the taking of a part to the next one [s].

    """

    name: str
    part: str
    at_m: Place
    angle_rad: float = 0.0
    count: int = 1
    refill_s: float = 0.0


@dataclass(frozen=True)
class Box:
    """A box, a tray or a pallet: a grid of places for parts, one layer upon the other.

    Attributes
    ----------
    name
        Of the box.
    at_m
        Middle of the underside of a part at the first place [m].
    columns, rows
        Number of places in x and y.
    pitch_m
        Distance of the places in x and y [m].
    clears_s
        After which time a placed part is taken away [s]; infinite: never.

    """

    name: str
    at_m: Place
    columns: int = 1
    rows: int = 1
    pitch_m: tuple[float, float] = (0.0, 0.0)
    clears_s: float = math.inf

    def place_m(self, number: int) -> Place:
        """Middle of a place [m], counted from 0 along x first."""
        row, column = divmod(number, self.columns)
        x, y, z = self.at_m
        return (x + column * self.pitch_m[0], y + row * self.pitch_m[1], z)

    def nearest(self, x: float, y: float) -> tuple[int, float, float]:
        """Return the number of the place nearest to a point [m], and how far the point is from it in x and y [m]."""
        column = _index(x - self.at_m[0], self.pitch_m[0], self.columns)
        row = _index(y - self.at_m[1], self.pitch_m[1], self.rows)
        number = row * self.columns + column
        place = self.place_m(number)
        return number, x - place[0], y - place[1]


def _index(distance: float, pitch: float, count: int) -> int:
    return 0 if count == 1 else min(max(math.floor(distance / pitch + 0.5), 0), count - 1)


@dataclass(frozen=True)
class CellFault:
    """Something of the cell fails.

    Attributes
    ----------
    kind
        One of ``KINDS``.
    target
        Name of what it happens to, if there are several.
    value
        The number that belongs to the kind.
    after_s, for_s
        When it begins and how long it lasts [s].

    """

    kind: str
    target: str = ''
    value: float = 0.0
    after_s: float = 0.0
    for_s: float = math.inf


# what may fail: the section whose names are the target, and the key of its number
KINDS: dict[str, tuple[str, str]] = {
    'vacuum_failure': ('', ''),
    'input_stuck': ('inputs', 'value'),
    'encoder_jump': ('belts', 'jump_m'),
    'camera_dead': ('belts', ''),
}


@dataclass(frozen=True)
class Cell:
    """A cell.

    Attributes
    ----------
    name
        Of the cell.
    seed
        Of whatever is random in it.
    drop_max_m
        How high above its support a part may be let go [m].

    """

    name: str = 'cell'
    seed: int = 1
    drop_max_m: float = FALLEN_FAR_M
    cup: Cup | None = None
    inputs: dict[str, Input] = field(default_factory=dict)
    outputs: dict[str, CellOutput] = field(default_factory=dict)
    parts: dict[str, PartType] = field(default_factory=dict)
    supplies: dict[str, Supply] = field(default_factory=dict)
    boxes: dict[str, Box] = field(default_factory=dict)
    belts: dict[str, Belt] = field(default_factory=dict)
    faults: tuple[CellFault, ...] = ()

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of all inputs, that of the vacuum switch last."""
        switch = () if self.cup is None or self.cup.switch is None else (self.cup.switch.input,)
        return (*self.inputs, *switch)

    @property
    def output_names(self) -> OutputNames:
        """The outputs as programs name them: the robot's own names, and those of the cell."""
        delays = {one.output: one.delays for one in self.outputs.values()}
        if self.cup is not None:
            delays[self.cup.output] = self.cup.valve
        own = {name: name for name in OUTPUTS} | {name: one.output for name, one in self.outputs.items()}
        return {
            name: NamedOutput(output, delays[output].on_s, delays[output].off_s)
            if output in delays
            else NamedOutput(output)
            for name, output in own.items()
        }
