"""A belt: how it moves, what its encoder tells, and where its parts are.

The encoder sits on the shaft of the belt. What lies on the belt goes with its surface, which may slip on the shaft:

    x_surface = x_shaft - slip,   count = floor(increments_per_m x_shaft)
"""

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

Place = tuple[float, float, float]  # [m]
WIDTH_M = 0.4
BOUNCES_MAX = 3  # of a light barrier, after a part


@dataclass(frozen=True)
class SpeedChange:
    """From a time on [s] the belt goes over to a speed [m/s] with an acceleration [m/s^2]."""

    after_s: float
    speed_m_s: float
    acceleration_m_s2: float = 2.0


@dataclass(frozen=True)
class Stream:
    """Parts that come on a belt.

    Attributes
    ----------
    part
        Type of them.
    count
        How many.
    spacing_m
        From one to the next [m].
    spread_m
        How far a part may be beside its place, along the belt and across, evenly drawn [m].
    spread_rad
        How far it may be turned [rad].
    also
        Other types that come among them, evenly drawn.

    """

    part: str
    count: int
    spacing_m: float
    spread_m: tuple[float, float] = (0.0, 0.0)
    spread_rad: float = 0.0
    also: tuple[str, ...] = ()


@dataclass(frozen=True)
class LightBarrier:
    """A light barrier across the belt: what it sees of the middle of a part.

    Attributes
    ----------
    at_m
        Its place on the belt [m].
    delay_s
        From the passing to the latching of the encoder [s]; the count is that of this instant.
    bounce_s
        After a part it may latch up to three times more, within this time [s].

    """

    at_m: float
    delay_s: float = 0.0
    bounce_s: float = 0.0


@dataclass(frozen=True)
class Camera:
    """A camera takes a picture each time that the belt has gone a way.

    Attributes
    ----------
    at_m, length_m
        Middle and length of what it sees of the belt [m].
    every_m
        Way from one picture to the next [m].
    latency_s
        From a picture to what it tells [s].
    noise_m, noise_rad
        Standard deviations of a place, along and across [m], and of an angle [rad].
    missed_share, doubled_share
        Of the parts in a picture: how many it does not see, how many it tells twice.

    """

    at_m: float
    length_m: float
    every_m: float
    latency_s: float = 0.0
    noise_m: float = 0.0
    noise_rad: float = 0.0
    missed_share: float = 0.0
    doubled_share: float = 0.0


@dataclass(frozen=True)
class Belt:
    """A belt.

    Attributes
    ----------
    name
        Of the belt.
    origin_m
        Where it begins: the middle of its surface [m].
    direction_rad
        In which it runs, about the vertical, 0 along x [rad].
    length_m
        From its begin to its end [m].
    increments_per_m
        Of its encoder [1/m].
    speed
        What it does, in the order of time; it stands before.
    jitter_m_s, jitter_hz
        Amplitude [m/s] and frequency [Hz] of a speed that swings about that.
    slip
        Share of the way of the shaft that the surface lags behind.
    stream
        Its parts; None: there are none.
    barrier
        None: nothing latches.
    camera
        None: nothing sees the parts.
    window_m
        From where to where along it a robot may work on it [m]; None: nowhere.
    width_m
        Of its surface [m].

    """

    name: str
    origin_m: Place
    direction_rad: float
    length_m: float
    increments_per_m: float
    speed: tuple[SpeedChange, ...] = ()
    jitter_m_s: float = 0.0
    jitter_hz: float = 0.0
    slip: float = 0.0
    stream: Stream | None = None
    barrier: LightBarrier | None = None
    camera: Camera | None = None
    window_m: tuple[float, float] | None = None
    width_m: float = WIDTH_M

    def place_m(self, along_m: float, across_m: float = 0.0) -> Place:
        """Place of the surface [m]; ``across_m`` is to the left of the direction."""
        x, y, z = self.origin_m
        c, s = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return (x + c * along_m - s * across_m, y + s * along_m + c * across_m, z)


@dataclass(frozen=True)
class Latch:
    """What a light barrier has latched: number of the part [by coming], count of the encoder, and its bus cycle."""

    part: int
    count: int
    cycle: int


class BeltMotion:
    """A belt moves as its file says: where it is at a time is a formula, so that no error adds up.

    Parameters
    ----------
    belt
        What it is.

    """

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
        """Way of the shaft at a time [m]."""
        begin, at, speed, acceleration = self._rows[bisect_right(self._times, time_s) - 1]
        t = 0.0 if math.isinf(begin) else time_s - begin
        way = at + t * (speed + 0.5 * acceleration * t)
        if self._belt.jitter_hz > 0.0 and time_s > 0.0:
            rate = math.tau * self._belt.jitter_hz
            way += self._belt.jitter_m_s / rate * (1.0 - math.cos(rate * time_s))
        return way

    def surface_m(self, time_s: float) -> float:
        """Way of the surface at a time [m]."""
        return (1.0 - self._belt.slip) * self.shaft_m(time_s)

    def count(self, time_s: float) -> int:
        """What the encoder reads at a time."""
        return math.floor(self._belt.increments_per_m * self.shaft_m(time_s))


@dataclass
class OnBelt:
    """A part on the belt: place on the surface when that has not moved [m], across it [m], angle [rad], type."""

    number: int
    along_m: float
    across_m: float
    angle_rad: float
    type: str = ''


class BeltState:
    """A belt with its parts goes from bus cycle to bus cycle.

    Parameters
    ----------
    belt
        What it is.
    cycle_time_s
        Of the bus [s].
    start_cycle
        Bus cycle from which its times count.
    generator
        Of where parts lie.

    Attributes
    ----------
    parts
        Those on it; they come at its begin.
    count
        Of the encoder at the begin of this bus cycle.
    latches
        What the light barrier tells in this bus cycle: what it has latched, once its delay has passed.

    """

    def __init__(
        self, belt: Belt, cycle_time_s: float, start_cycle: int, generator: np.random.Generator
    ) -> None:
        self.belt, self._cycle_time_s, self._start = belt, cycle_time_s, start_cycle
        self._motion = BeltMotion(belt)
        self.parts: list[OnBelt] = []
        self.latches: list[Latch] = []
        self.count = 0
        self._way = 0.0
        self._waiting = self._drawn(generator)
        self._generator = generator
        self._jump_m = 0.0
        self._barred: list[tuple[float, int]] = []  # time at which a part is latched, its number

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
        """Time of the begin of a bus cycle [s], as the times of the belt count."""
        return (cycle - self._start) * self._cycle_time_s

    @property
    def way_m(self) -> float:
        """Way of the surface at the begin of this bus cycle [m]."""
        return self._way

    def jump(self, jump_m: float) -> None:
        """Let the encoder read a way too much [m], from now on."""
        if jump_m != self._jump_m:
            before, self._jump_m = self._jump_m, jump_m
            per_m = self.belt.increments_per_m
            self.count += math.floor(jump_m * per_m) - math.floor(before * per_m)

    def _count(self, time_s: float) -> int:
        return self._motion.count(time_s) + math.floor(self._jump_m * self.belt.increments_per_m)

    def place_m(self, part: OnBelt) -> Place:
        """Where the underside of a part is at the begin of this bus cycle [m]."""
        return self.belt.place_m(self.along_m(part), part.across_m)

    def along_m(self, part: OnBelt) -> float:
        """Where a part is on the belt at the begin of this bus cycle [m]."""
        return part.along_m + self._way

    def step(self, cycle: int) -> list[OnBelt]:
        """Go on to a bus cycle; return the parts that have come in it."""
        time = self.time_s(cycle)
        before, self._way = self._way, self._motion.surface_m(time)
        self.count = self._count(time)
        come = []
        while self._waiting and self._waiting[0].along_m + self._way >= 0.0:
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
            if part.along_m + before < barrier.at_m <= part.along_m + self._way:
                passed = self._passing(part, cycle) + barrier.delay_s
                self._barred.append((passed, part.number))
                if barrier.bounce_s > 0.0:
                    more = self._generator.uniform(0.0, barrier.bounce_s, BOUNCES_MAX).tolist()
                    self._barred += [(passed + later, part.number) for later in sorted(more)]
        now = self.time_s(cycle)
        self.latches = [Latch(number, self._count(at), cycle) for at, number in self._barred if at <= now]
        self._barred = [one for one in self._barred if one[0] > now]

    def _passing(self, part: OnBelt, cycle: int) -> float:
        """Time at which a part passes the barrier, which it does in the bus cycle before this instant."""
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
        """Where a place of the frame ``base`` is along the belt and across it [m]; None: beside the belt."""
        x, y = place[0] - self.belt.origin_m[0], place[1] - self.belt.origin_m[1]
        c, s = math.cos(self.belt.direction_rad), math.sin(self.belt.direction_rad)
        along, across = c * x + s * y, -s * x + c * y
        on_it = 0.0 <= along <= self.belt.length_m and abs(across) <= 0.5 * self.belt.width_m
        return (along, across) if on_it else None

    def put(self, part: OnBelt) -> None:
        """Put a part on the surface as it is now."""
        part.along_m -= self._way
        self.parts.append(part)

    def take(self, number: int) -> None:
        """Take a part away."""
        self.parts = [part for part in self.parts if part.number != number]

    def leave(self) -> list[OnBelt]:
        """Return the parts that have left the end of the belt, once."""
        gone = [part for part in self.parts if self.along_m(part) > self.belt.length_m]
        if gone:
            self.parts = [part for part in self.parts if self.along_m(part) <= self.belt.length_m]
        return gone
