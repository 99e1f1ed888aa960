"""Conveyor belts: motion, encoder, light barrier and the parts on the surface.

The encoder is on the shaft. Parts move with the surface, which may slip on the shaft:

    x_surface = x_shaft - slip,   count = floor(increments_per_m x_shaft)
"""

import math
from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from delta3_pacdrive.configuration.fields import Rules, derived, own_name, quantity, reference

Place = tuple[float, float, float]  # [m]
REACH_M = 10.0
LENGTH_MIN_M = 1e-4
TIME_MAX_S = 1e5
DELAY_MAX_S = 10.0
PARTS_MAX = 100_000
BELT_MAX_M_S = 10.0
BOUNCES_MAX = 3  # false latches of a light barrier after a part


@dataclass(frozen=True)
class SpeedChange:
    """Change to a new speed with a constant acceleration, starting at a time after program start."""

    after_s: float = quantity('from program start', 0.0, TIME_MAX_S)
    speed_m_s: float = quantity('new speed', -BELT_MAX_M_S, BELT_MAX_M_S)
    acceleration_m_s2: float = quantity('of the change', 0.01, 100.0, default=2.0)


@dataclass(frozen=True)
class Encoder:
    """Encoder on the shaft of a belt."""

    bits: int = quantity('of a revolution', 4, 24)
    circumference_m: float = quantity('travel of a revolution', 0.01, REACH_M)

    @property
    def increments_per_m(self) -> float:
        """Increments per metre of travel."""
        return 2.0**self.bits / self.circumference_m


@dataclass(frozen=True)
class Jitter:
    """Sinusoidal speed error."""

    speed_m_s: float = quantity('amplitude', 0.0, 1.0)
    frequency_hz: float = quantity('frequency', 0.1, 100.0)


@dataclass(frozen=True)
class Stream:
    """Parts arriving on a belt; deviations from the nominal position are uniformly distributed."""

    part: str = reference('type of the parts', 'parts')
    count: int = quantity('number of parts', 1, PARTS_MAX)
    spacing_m: float = quantity('nominal distance', LENGTH_MIN_M, REACH_M)
    spread_m: tuple[float, float] = quantity(
        'largest deviation along and across the belt', 0.0, REACH_M, default=(0.0, 0.0)
    )
    spread_rad: float = quantity('largest rotation', 0.0, math.pi, default=0.0)
    also: tuple[str, ...] = reference('further part types, drawn with equal probability', 'parts', default=())


@dataclass(frozen=True)
class LightBarrier:
    """A light barrier across the belt, which latches the encoder count when the middle of a part passes."""

    at_m: float = quantity('distance from the start of the belt, within its length', 0.0, REACH_M)
    delay_s: float = quantity(
        'from passing to latching; the latched count is that of the later instant',
        0.0,
        DELAY_MAX_S,
        default=0.0,
    )
    bounce_s: float = quantity(
        'period after a part in which up to ``BOUNCES_MAX`` false latches occur',
        0.0,
        DELAY_MAX_S,
        default=0.0,
    )


@dataclass(frozen=True)
class Camera:
    """A camera that takes a picture each time the belt has moved a certain distance."""

    at_m: float = quantity('centre of the field of view along the belt, within its length', 0.0, REACH_M)
    length_m: float = quantity('of the field of view', LENGTH_MIN_M, REACH_M)
    every_m: float = quantity('belt travel between pictures', LENGTH_MIN_M, REACH_M)
    latency_s: float = quantity('from exposure to result', 0.0, DELAY_MAX_S, default=0.0)
    noise_m: float = quantity(
        'standard deviation of measured positions, along and across', 0.0, 0.1, default=0.0
    )
    noise_rad: float = quantity('standard deviation of measured angles', 0.0, math.pi, default=0.0)
    missed_share: float = quantity('probability that a visible part is not reported', 0.0, 1.0, default=0.0)
    doubled_share: float = quantity(
        'probability that a visible part is reported twice', 0.0, 1.0, default=0.0
    )


@dataclass(frozen=True)
class Belt:
    """A belt as described in the cell file."""

    name: str = own_name()
    origin_m: Place = quantity('middle of the surface at the start of the belt', -REACH_M, REACH_M)
    direction_rad: float = quantity(
        'direction of travel about the vertical, 0 along x', -math.tau, math.tau, absent=0.0
    )
    length_m: float = quantity('length', LENGTH_MIN_M, REACH_M)
    increments_per_m: float = derived(Encoder, lambda encoder: encoder.increments_per_m, key='encoder')
    speed: tuple[SpeedChange, ...] = ()  # in order of time; the belt is at rest before the first change
    jitter: Jitter | None = None
    slip: float = quantity("fraction of the shaft's travel by which the surface lags", -0.5, 0.5, default=0.0)
    stream: Stream | None = None
    barrier: LightBarrier | None = None
    camera: Camera | None = None
    window_m: tuple[float, float] | None = quantity(
        'begin and end of the section in which a robot may work; None: no section', 0.0, REACH_M, default=None
    )
    width_m: float = quantity('width', LENGTH_MIN_M, REACH_M, default=0.4)

    def broken_rules(self) -> Rules:
        """Yield violated rules between values."""
        for n, (before, after) in enumerate(pairwise(self.speed), 1):
            if after.after_s <= before.after_s:
                yield (
                    ('speed', n),
                    f'is at {after.after_s:g} s, but the change before it is at {before.after_s:g} s',
                )
        begin, end = self.window_m or (0.0, self.length_m)
        if not begin < end:
            yield ('window_m',), f'is from {begin:g} m to {end:g} m, but must go forward'
        for path, at_m in (
            (('barrier', 'at_m'), self.barrier.at_m if self.barrier else 0.0),
            (('camera', 'at_m'), self.camera.at_m if self.camera else 0.0),
            (('window_m',), end),
        ):
            if at_m > self.length_m:
                yield (
                    path,
                    f'is {at_m:g}, but must be between 0 and {self.length_m:g}, the length of the belt',
                )

    def place_m(self, along_m: float, across_m: float = 0.0) -> Place:
        """Position on the surface [m]; ``across_m`` is to the left of the direction of travel."""
        x, y, z = self.origin_m
        c, s = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return (x + c * along_m - s * across_m, y + s * along_m + c * across_m, z)


@dataclass(frozen=True)
class Latch:
    """Encoder count latched by a light barrier, with the number of the part."""

    part: int
    count: int
    cycle: int


class BeltMotion:
    """Closed-form motion of a belt, so that no error accumulates over time."""

    def __init__(self, belt: Belt) -> None:
        self._belt = belt
        # rows of time, distance, speed and acceleration, each until the next one
        rows = [(-math.inf, 0.0, 0.0, 0.0)]
        for change in belt.speed:
            at, speed = self._at(rows, change.after_s)
            rows = [row for row in rows if row[0] < change.after_s]
            difference = change.speed_m_s - speed
            rows.append((change.after_s, at, speed, math.copysign(change.acceleration_m_s2, difference)))
            duration = abs(difference) / change.acceleration_m_s2
            end = at + 0.5 * (speed + change.speed_m_s) * duration
            rows.append((change.after_s + duration, end, change.speed_m_s, 0.0))
        self._rows = rows
        self._times = [row[0] for row in rows]

    @staticmethod
    def _at(rows: list[tuple[float, float, float, float]], time_s: float) -> tuple[float, float]:
        before = [row for row in rows if row[0] <= time_s]
        begin, at, speed, acceleration = before[-1]
        t = 0.0 if math.isinf(begin) else time_s - begin
        return at + t * (speed + 0.5 * acceleration * t), speed + acceleration * t

    def shaft_m(self, time_s: float) -> float:
        """Travel of the shaft at a time [m]."""
        begin, at, speed, acceleration = self._rows[bisect_right(self._times, time_s) - 1]
        t = 0.0 if math.isinf(begin) else time_s - begin
        travel = at + t * (speed + 0.5 * acceleration * t)
        jitter = self._belt.jitter
        if jitter is not None and time_s > 0.0:
            rate = math.tau * jitter.frequency_hz
            travel += jitter.speed_m_s / rate * (1.0 - math.cos(rate * time_s))
        return travel

    def surface_m(self, time_s: float) -> float:
        """Travel of the surface at a time [m]."""
        return (1.0 - self._belt.slip) * self.shaft_m(time_s)

    def count(self, time_s: float) -> int:
        """Encoder count at a time."""
        return math.floor(self._belt.increments_per_m * self.shaft_m(time_s))


@dataclass
class OnBelt:
    """A part on the belt."""

    number: int
    along_m: float  # position at zero travel of the surface
    across_m: float
    angle_rad: float
    type: str = ''


class BeltState:
    """State of a belt with its parts, advanced one bus cycle at a time.

    Parameters
    ----------
    start_cycle
        Bus cycle of time 0 of the belt.

    Attributes
    ----------
    count
        Encoder count at the beginning of this bus cycle.
    latches
        Light barrier events reported in this bus cycle, after their delay.

    """

    def __init__(
        self, belt: Belt, cycle_time_s: float, start_cycle: int, generator: np.random.Generator
    ) -> None:
        self.belt, self._cycle_time_s, self._start = belt, cycle_time_s, start_cycle
        self._motion = BeltMotion(belt)
        self.parts: list[OnBelt] = []
        self.latches: list[Latch] = []
        self.count = 0
        self.way_m = 0.0  # travel of the surface at the beginning of this bus cycle
        self._waiting = self._drawn(generator)
        self._generator = generator
        self._jump_m = 0.0
        self._barred: list[tuple[float, int]] = []  # latching time and part number of pending events

    def _drawn(self, generator: np.random.Generator) -> list[OnBelt]:
        stream = self.belt.stream
        if stream is None:
            return []
        found = []
        for n in range(stream.count):
            along, across, turn = generator.uniform(-1.0, 1.0, 3).tolist()
            at = -n * stream.spacing_m + along * stream.spread_m[0]
            found.append(OnBelt(n, at, across * stream.spread_m[1], turn * stream.spread_rad, stream.part))
        if stream.also:
            types = (stream.part, *stream.also)
            for part, drawn in zip(
                found, generator.integers(len(types), size=len(found)).tolist(), strict=True
            ):
                part.type = types[drawn]
        return sorted(found, key=lambda one: -one.along_m)

    def time_s(self, cycle: int) -> float:
        """Time of the beginning of a bus cycle [s], relative to ``start_cycle``."""
        return (cycle - self._start) * self._cycle_time_s

    def jump(self, jump_m: float) -> None:
        """Add an offset [m] to the encoder from now on."""
        if jump_m != self._jump_m:
            before, self._jump_m = self._jump_m, jump_m
            per_m = self.belt.increments_per_m
            self.count += math.floor(jump_m * per_m) - math.floor(before * per_m)

    def _count(self, time_s: float) -> int:
        return self._motion.count(time_s) + math.floor(self._jump_m * self.belt.increments_per_m)

    def place_m(self, part: OnBelt) -> Place:
        """Middle of the underside of a part at the beginning of this bus cycle [m]."""
        return self.belt.place_m(self.along_m(part), part.across_m)

    def along_m(self, part: OnBelt) -> float:
        """Position of a part along the belt at the beginning of this bus cycle [m]."""
        return part.along_m + self.way_m

    def step(self, cycle: int) -> list[OnBelt]:
        """Advance to a bus cycle; return the parts that entered the belt in it."""
        time = self.time_s(cycle)
        before, self.way_m = self.way_m, self._motion.surface_m(time)
        self.count = self._count(time)
        come = []
        while self._waiting and self._waiting[0].along_m + self.way_m >= 0.0:
            come.append(self._waiting.pop(0))
        self.parts += come
        if self.belt.barrier is not None:
            self._latch(cycle, before)
        return come

    def _latch(self, cycle: int, before: float) -> None:
        barrier = self.belt.barrier
        if barrier is None:
            return
        for part in self.parts:
            if part.along_m + before < barrier.at_m <= part.along_m + self.way_m:
                passed = self._passing(part, cycle) + barrier.delay_s
                self._barred.append((passed, part.number))
                if barrier.bounce_s > 0.0:
                    more = self._generator.uniform(0.0, barrier.bounce_s, BOUNCES_MAX).tolist()
                    self._barred += [(passed + later, part.number) for later in sorted(more)]
        now = self.time_s(cycle)
        self.latches = [Latch(number, self._count(at), cycle) for at, number in self._barred if at <= now]
        self._barred = [one for one in self._barred if one[0] > now]

    def _passing(self, part: OnBelt, cycle: int) -> float:
        """Return the time at which a part, known to pass in the last bus cycle, crosses the barrier."""
        low, high = self.time_s(cycle - 1), self.time_s(cycle)
        barrier = self.belt.barrier.at_m if self.belt.barrier is not None else 0.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            if part.along_m + self._motion.surface_m(middle) >= barrier:
                high = middle
            else:
                low = middle
        return high

    def surface_place(self, place: Place) -> tuple[float, float] | None:
        """Return the position along and across the belt [m] of a point in frame ``base``; None off the belt."""
        x, y = place[0] - self.belt.origin_m[0], place[1] - self.belt.origin_m[1]
        c, s = math.cos(self.belt.direction_rad), math.sin(self.belt.direction_rad)
        along, across = c * x + s * y, -s * x + c * y
        on_it = 0.0 <= along <= self.belt.length_m and abs(across) <= 0.5 * self.belt.width_m
        return (along, across) if on_it else None

    def put(self, part: OnBelt) -> None:
        """Place a part on the moving surface."""
        part.along_m -= self.way_m
        self.parts.append(part)

    def take(self, number: int) -> None:
        """Remove a part."""
        self.parts = [part for part in self.parts if part.number != number]

    def leave(self) -> list[OnBelt]:
        """Remove and return the parts that have passed the end of the belt."""
        gone = [part for part in self.parts if self.along_m(part) > self.belt.length_m]
        if gone:
            self.parts = [part for part in self.parts if self.along_m(part) <= self.belt.length_m]
        return gone
