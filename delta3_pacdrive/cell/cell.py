"""Contents of a cell file as frozen records. Positions in frame ``base`` [m]; times from program start [s]."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

from delta3_pacdrive.belts.model import DELAY_MAX_S, LENGTH_MIN_M, PARTS_MAX, REACH_M, TIME_MAX_S, Belt, Place
from delta3_pacdrive.configuration.fields import (
    Rules,
    choice,
    entries,
    internal,
    own_name,
    quantity,
    reference,
    switch,
    text,
)
from delta3_pacdrive.errors import shown
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.planning.program.output_names import NamedOutput, OutputNames
from delta3_pacdrive.recording.signals import CELL_BELTS, CELL_INPUTS
from delta3_pacdrive.robot.sercos.words import PAYLOAD_MAX_KG

NAME_MAX = 60  # characters
NAMES_MAX = 1000  # per section
PLACES_MAX = 1000  # of a box, along x or y
ATMOSPHERE_PA = 101_325.0
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

    on_s: float = quantity('after switching on', 0.0, DELAY_MAX_S, default=0.0)
    off_s: float = quantity('after switching off', 0.0, DELAY_MAX_S, default=0.0)
    bounce_s: float = quantity('random values after each change', 0.0, DELAY_MAX_S, default=0.0)


@dataclass(frozen=True)
class Change:
    """An input value from a time on, set by the equipment around the cell."""

    after_s: float = quantity('from program start', 0.0, TIME_MAX_S)
    value: bool = switch('input value')


@dataclass(frozen=True)
class Sensor:
    """Detects parts, lying or gripped, whose horizontal distance from ``at_m`` is within a radius, at any height."""

    at_m: Place = quantity('position', -REACH_M, REACH_M)
    radius_m: float = quantity('radius', LENGTH_MIN_M, REACH_M)


@dataclass(frozen=True)
class Input:
    """An input with its source: scheduled changes, a sensor, or an output of the robot."""

    ALTERNATIVES: ClassVar = ('changes', 'sensor', 'follows')

    name: str = own_name()
    delays: Delays = Delays()
    changes: tuple[Change, ...] = ()  # in order of time; empty with another source
    sensor: Sensor | None = None
    follows: str = reference('output of the robot, with the delays of that output', 'outputs', default='')

    def broken_rules(self) -> Rules:
        """Yield violated rules between values."""
        for n, (before, after) in enumerate(pairwise(self.changes), 1):
            if after.after_s < before.after_s:
                yield (
                    ('changes', n),
                    f'is at {after.after_s:g} s, but the change before it is at {before.after_s:g} s',
                )


@dataclass(frozen=True)
class CellOutput:
    """A named output of the robot, with the delays of the connected device."""

    output: str = choice('output of the robot', OUTPUTS, required=True)
    delays: Delays = Delays()


@dataclass(frozen=True)
class VacuumSwitch:
    """Vacuum switch: an input with hysteresis, on at ``on_pa`` and off below ``off_pa``."""

    input: str = text('name of the input', NAME_MAX)
    on_pa: float = quantity('on from this vacuum on', 0.0, ATMOSPHERE_PA)
    off_pa: float = quantity('off below this vacuum', 0.0, ATMOSPHERE_PA)
    delays: Delays = Delays()


@dataclass(frozen=True)
class Cup:
    """Vacuum cup with its valve; without ``valve`` in the file, its output has the delays given in ``outputs``."""

    output: str = reference('output of the robot that opens the valve', 'outputs')
    diameter_m: float = quantity('diameter of the effective area', 1e-3, 1.0)
    vacuum_pa: float = quantity(
        'vacuum that the pump reaches with the cup closed, relative to ambient pressure', 100.0, ATMOSPHERE_PA
    )
    valve: Delays = Delays()
    open_share: float = quantity('fraction of that vacuum reached without a part', 0.0, 1.0, default=0.1)
    build_up_s: float = quantity('time constant of the build-up', 0.0, DELAY_MAX_S, default=0.0)
    decay_s: float = quantity('time constant of the decay', 0.0, DELAY_MAX_S, default=0.0)
    height_tolerance_m: float = quantity(
        'largest vertical distance between cup and top centre of a part at which the cup seals',
        0.0,
        REACH_M,
        default=0.0015,
    )
    lateral_tolerance_m: float = quantity('the same, horizontally', 0.0, REACH_M, default=0.005)
    offset_m: Place = quantity(
        'from the TCP to the centre of the cup', -REACH_M, REACH_M, default=(0.0, 0.0, 0.0)
    )
    switch: VacuumSwitch | None = None

    def broken_rules(self) -> Rules:
        """Yield violated rules between values."""
        if self.switch is not None:
            for name, value, high in (
                ('on_pa', self.switch.on_pa, self.vacuum_pa),
                ('off_pa', self.switch.off_pa, self.switch.on_pa),
            ):
                if value > high:
                    yield ('switch', name), f'is {value:g}, but must be between 0 and {high:g}'

    @property
    def area_m2(self) -> float:
        """Effective area of the vacuum [m^2]."""
        return 0.25 * math.pi * self.diameter_m**2


@dataclass(frozen=True)
class PartType:
    """A type of parts."""

    name: str = own_name()
    mass_kg: float = quantity('mass', 1e-3, PAYLOAD_MAX_KG)
    size_m: Place = quantity('along x, y and z', LENGTH_MIN_M, REACH_M)
    friction: float = quantity('coefficient between cup and part', 0.01, 10.0)


@dataclass(frozen=True)
class Supply:
    """A position at which parts are supplied one after the other."""

    name: str = own_name()
    part: str = reference('type of the parts', 'parts')
    at_m: Place = quantity('middle of the underside of a part', -REACH_M, REACH_M)
    angle_rad: float = quantity('of the parts about the vertical', -math.tau, math.tau, default=0.0)
    count: int = quantity('number of parts', 1, PARTS_MAX, default=1)
    refill_s: float = quantity('from removal of a part to the next one', 0.0, TIME_MAX_S, default=0.0)


@dataclass(frozen=True)
class Box:
    """A box, tray or pallet: a grid of places for parts, stacked in layers."""

    name: str = own_name()
    at_m: Place = quantity('middle of the underside of a part in the first place', -REACH_M, REACH_M)
    columns: int = quantity('places along x', 1, PLACES_MAX, default=1)
    rows: int = quantity('places along y', 1, PLACES_MAX, default=1)
    pitch_m: tuple[float, float] = quantity(
        'between the places along x and y', -REACH_M, REACH_M, default=(0.0, 0.0)
    )
    clears_s: float = quantity('time after which a placed part is removed', 0.0, TIME_MAX_S, default=math.inf)

    def broken_rules(self) -> Rules:
        """Yield violated rules between values."""
        for name, count, pitch in zip(
            ('columns', 'rows'), (self.columns, self.rows), self.pitch_m, strict=True
        ):
            if count > 1 and pitch == 0.0:
                yield (name,), f'is {count}, but pitch_m of that direction is 0'

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

    kind: str = internal()  # one of ``KINDS``
    target: str = internal(default='')
    value: float = internal(default=0.0)  # parameter of this kind
    after_s: float = quantity('from program start', 0.0, TIME_MAX_S, default=0.0)
    for_s: float = quantity('duration', 1e-3, TIME_MAX_S, default=math.inf)


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

    name: str = text('name of the cell', NAME_MAX, default='cell')
    seed: int = quantity('of all random effects', 0, 2**32 - 1, default=1)
    drop_max_m: float = quantity(
        'largest height above the support for releasing a part', 0.0, REACH_M, default=FALLEN_FAR_M
    )
    cup: Cup | None = None
    inputs: dict[str, Input] = entries('by name', most=NAMES_MAX, default_factory=dict)
    outputs: dict[str, CellOutput] = entries('by name', most=NAMES_MAX, default_factory=dict)
    parts: dict[str, PartType] = entries('by name', most=NAMES_MAX, default_factory=dict)
    supplies: dict[str, Supply] = entries('by name', most=NAMES_MAX, default_factory=dict)
    boxes: dict[str, Box] = entries('by name', most=NAMES_MAX, default_factory=dict)
    belts: dict[str, Belt] = entries('by name', most=NAMES_MAX, default_factory=dict)
    faults: tuple[CellFault, ...] = ()

    def broken_rules(self) -> Rules:
        """Yield violated rules between sections."""
        names: dict[str, str] = {}
        for name, one in self.outputs.items():
            if name in OUTPUTS:
                yield ('outputs', name), 'is the name of an output of the robot: use another name'
            elif one.output in names:
                yield ('outputs', name), f'is {one.output}, which already has the name {names[one.output]}'
            names.setdefault(one.output, name)
        if self.cup is not None and self.cup.switch is not None and self.cup.switch.input in self.inputs:
            yield ('cup',), f'has the switch {shown(self.cup.switch.input)}, which is already in inputs'
        for section, count, most in (
            ('inputs', len(self.input_names), CELL_INPUTS),
            ('belts', len(self.belts), CELL_BELTS),
        ):
            if count > most:
                yield (section,), f'holds {count} entries, but must hold at most {most}'

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
