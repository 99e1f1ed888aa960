"""Contents of a cell file as frozen records. Positions in frame ``base`` [m]; times from program start [s]."""

import math
from dataclasses import dataclass, field

from delta3_pacdrive.belts.model import Belt
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.planning.program.output_names import NamedOutput, OutputNames

Place = tuple[float, float, float]  # [m]

STANDARD_GRAVITY_M_S2 = 9.80665
FALLEN_FAR_M = 0.005  # a part released higher than this above its support counts as dropped


def turned(place_m: Place, angle_rad: float) -> Place:
    """Rotate a point about the vertical through the origin; bit-identical at 0 rad."""
    if angle_rad == 0.0:
        return place_m
    (x, y, z), cos, sin = place_m, math.cos(angle_rad), math.sin(angle_rad)
    return (cos * x - sin * y, sin * x + cos * y, z)


@dataclass(frozen=True)
class Delays:
    """Delays of a binary signal after a change of its source."""

    on_s: float = 0.0
    off_s: float = 0.0
    bounce_s: float = 0.0  # random values after each change


@dataclass(frozen=True)
class Change:
    """An input value from a time on, set by the equipment around the cell."""

    after_s: float
    value: bool


@dataclass(frozen=True)
class Sensor:
    """Detects parts, lying or gripped, whose horizontal distance from ``at_m`` is within a radius, at any height."""

    at_m: Place
    radius_m: float


@dataclass(frozen=True)
class Input:
    """An input with its source: scheduled changes, a sensor, or an output of the robot."""

    name: str
    delays: Delays = Delays()
    changes: tuple[Change, ...] = ()  # in order of time; empty with another source
    sensor: Sensor | None = None
    follows: str = ''  # output of the robot, with the delays of that output


@dataclass(frozen=True)
class CellOutput:
    """A named output of the robot, with the delays of the connected device."""

    output: str
    delays: Delays = Delays()


@dataclass(frozen=True)
class VacuumSwitch:
    """Vacuum switch: an input with hysteresis, on at ``on_pa`` and off below ``off_pa``."""

    input: str
    on_pa: float
    off_pa: float
    delays: Delays = Delays()


@dataclass(frozen=True)
class Cup:
    """Vacuum cup with its valve.

    Attributes
    ----------
    height_tolerance_m, lateral_tolerance_m
        Largest vertical and horizontal distance between cup and top centre of a part at which the cup seals [m].

    """

    output: str  # output of the robot that opens the valve
    diameter_m: float  # diameter of the effective area
    vacuum_pa: float  # vacuum that the pump reaches with the cup closed, relative to ambient pressure
    valve: Delays = Delays()
    open_share: float = 0.1  # fraction of that vacuum reached without a part
    build_up_s: float = 0.0  # time constant of the build-up
    decay_s: float = 0.0  # time constant of the decay
    height_tolerance_m: float = 0.0015
    lateral_tolerance_m: float = 0.005
    offset_m: Place = (0.0, 0.0, 0.0)  # from the TCP to the centre of the cup
    switch: VacuumSwitch | None = None

    @property
    def area_m2(self) -> float:
        """Effective area of the vacuum [m^2]."""
        return 0.25 * math.pi * self.diameter_m**2


@dataclass(frozen=True)
class PartType:
    """A type of parts."""

    name: str
    mass_kg: float
    size_m: Place
    friction: float  # coefficient between cup and part


@dataclass(frozen=True)
class Supply:
    """A position at which parts are supplied one after the other."""

    name: str
    part: str
    at_m: Place  # middle of the underside of a part
    angle_rad: float = 0.0
    count: int = 1
    refill_s: float = 0.0  # from removal of a part to the next one


@dataclass(frozen=True)
class Box:
    """A box, tray or pallet: a grid of places for parts, stacked in layers."""

    name: str
    at_m: Place  # middle of the underside of a part in the first place
    columns: int = 1  # along x
    rows: int = 1  # along y
    pitch_m: tuple[float, float] = (0.0, 0.0)
    clears_s: float = math.inf  # time after which a placed part is removed

    def place_m(self, number: int) -> Place:
        """Return the position of a place [m], counted from 0, along x first."""
        row, column = divmod(number, self.columns)
        x, y, z = self.at_m
        return (x + column * self.pitch_m[0], y + row * self.pitch_m[1], z)

    def nearest(self, x: float, y: float) -> tuple[int, float, float]:
        """Return the number of the nearest place, and the distance of the point from it in x and y [m]."""
        column = _index(x - self.at_m[0], self.pitch_m[0], self.columns)
        row = _index(y - self.at_m[1], self.pitch_m[1], self.rows)
        number = row * self.columns + column
        place = self.place_m(number)
        return number, x - place[0], y - place[1]


def _index(distance: float, pitch: float, count: int) -> int:
    return 0 if count == 1 else min(max(math.floor(distance / pitch + 0.5), 0), count - 1)


@dataclass(frozen=True)
class CellFault:
    """A scheduled failure of the cell."""

    kind: str  # one of ``KINDS``
    target: str = ''
    value: float = 0.0  # parameter of this kind
    after_s: float = 0.0
    for_s: float = math.inf


# kinds of failure: section of the target's name, key of the value
KINDS: dict[str, tuple[str, str]] = {
    'vacuum_failure': ('', ''),
    'input_stuck': ('inputs', 'value'),
    'encoder_jump': ('belts', 'jump_m'),
    'camera_dead': ('belts', ''),
}


@dataclass(frozen=True)
class Cell:
    """A packaging cell."""

    name: str = 'cell'
    seed: int = 1
    drop_max_m: float = FALLEN_FAR_M  # largest height above the support for releasing a part
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
        """Names of all inputs; the vacuum switch is last."""
        switch = () if self.cup is None or self.cup.switch is None else (self.cup.switch.input,)
        return (*self.inputs, *switch)

    @property
    def output_names(self) -> OutputNames:
        """Output names for programs: the robot's own and those of the cell."""
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
