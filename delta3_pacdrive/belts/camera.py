"""Camera above a belt: reports parts with latency, noise, misses and duplicates."""

import math
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.belts.model import BeltState, Camera


@dataclass(frozen=True)
class Sighting:
    """A part seen by a camera: type, position and angle on the belt, and encoder count of the picture."""

    type: str
    along_m: float
    across_m: float
    angle_rad: float  # relative to the direction of the belt
    count: int


class CameraState:
    """State of a camera, advanced with its belt one bus cycle at a time.

    Attributes
    ----------
    pictures
        Number of pictures taken.
    dead
        A dead camera takes no pictures; pending results are still reported.

    """

    def __init__(self, camera: Camera, cycle_time_s: float, generator: np.random.Generator) -> None:
        self._camera, self._generator = camera, generator
        # bus cycles from a picture to its result
        self.latency_cycles = math.ceil(camera.latency_s / cycle_time_s - 1e-9)
        self._next_m = camera.every_m
        self._late: list[tuple[int, list[Sighting]]] = []
        self.pictures = 0
        self.dead = False

    def step(self, cycle: int, belt: BeltState) -> list[Sighting]:
        """Advance to a bus cycle, after the belt; return the parts reported in it."""
        if belt.way_m >= self._next_m:
            self._next_m += self._camera.every_m * math.ceil(
                (belt.way_m - self._next_m) / self._camera.every_m + 1e-9
            )
            if not self.dead:
                self.pictures += 1
                self._late.append((cycle + self.latency_cycles, self._seen(belt)))
        reported = [one for due, seen in self._late if due <= cycle for one in seen]
        self._late = [row for row in self._late if row[0] > cycle]
        return reported

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
