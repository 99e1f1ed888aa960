"""A camera above a belt: it sees parts, late, with noise, misses some and tells some twice."""

import math
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.peripherals.belt import BeltState, Camera


@dataclass(frozen=True)
class Sighting:
    """What a camera tells of a part.

    Attributes
    ----------
    type
        Of the part.
    along_m, across_m
        Where it was on the belt when the picture was taken [m].
    angle_rad
        Of the part against the direction of the belt [rad].
    count
        Of the encoder then.

    """

    type: str
    along_m: float
    across_m: float
    angle_rad: float
    count: int


class CameraState:
    """A camera goes with its belt from bus cycle to bus cycle.

    Parameters
    ----------
    camera
        What it is.
    cycle_time_s
        Of the bus [s].
    generator
        Of its noise, misses and doubles.

    Attributes
    ----------
    pictures
        How many it has taken.
    dead
        A dead camera takes none; what it has taken before it still tells.

    """

    def __init__(self, camera: Camera, cycle_time_s: float, generator: np.random.Generator) -> None:
        self._camera, self._generator = camera, generator
        self._latency_cycles = math.ceil(camera.latency_s / cycle_time_s - 1e-9)
        self._next_m = camera.every_m
        self._late: list[tuple[int, list[Sighting]]] = []
        self.pictures = 0
        self.dead = False

    @property
    def latency_cycles(self) -> int:
        """From a picture to the telling of what is in it [bus cycles]."""
        return self._latency_cycles

    def step(self, cycle: int, belt: BeltState) -> list[Sighting]:
        """Go on to a bus cycle, after the belt; return what is told in it."""
        if belt.way_m >= self._next_m:
            self._next_m += self._camera.every_m * math.ceil(
                (belt.way_m - self._next_m) / self._camera.every_m + 1e-9
            )
            if not self.dead:
                self.pictures += 1
                self._late.append((cycle + self._latency_cycles, self._seen(belt)))
        told = [one for due, seen in self._late if due <= cycle for one in seen]
        self._late = [row for row in self._late if row[0] > cycle]
        return told

    def _seen(self, belt: BeltState) -> list[Sighting]:
        camera, draw = self._camera, self._generator
        found: list[Sighting] = []
        for part in belt.parts:
            if abs(belt.along_m(part) - camera.at_m) > 0.5 * camera.length_m:
                continue
            missed, doubled = draw.random(2) < (camera.missed_share, camera.doubled_share)
            for _ in range(0 if missed else 2 if doubled else 1):
                along, across, turn = draw.standard_normal(3).tolist()
                found.append(
                    Sighting(
                        part.type,
                        belt.along_m(part) + camera.noise_m * along,
                        part.across_m + camera.noise_m * across,
                        part.angle_rad + camera.noise_rad * turn,
                        belt.count,
                    )
                )
        return found
