"""Belts on the bus: their axes, and readings by bus cycle, kept until the cycle is evaluated."""

import json
import math
from collections.abc import Sequence
from typing import Any

from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.belts.tracking import BeltReading
from delta3_pacdrive.robot.sercos.bus_time import NEVER


class BeltImage:
    """Readings of all belts of one bus."""

    def __init__(self) -> None:
        self.expected = NEVER  # next cycle with expected readings; NEVER without belts
        self._waiting: dict[int, Sequence[BeltReading]] = {}

    def begin(self, cycle: int, belts: int) -> None:
        """Start cyclic operation with a cycle and a number of belts."""
        self.expected = cycle if belts else NEVER
        self._waiting.clear()

    def put(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Store the readings of a cycle; repeated ones are ignored.

        The next command waits for them, so they arrive in order without gaps.
        """
        if cycle == self.expected:
            self._waiting[cycle] = readings
            self.expected = cycle + 1

    def is_complete(self, cycle: int) -> bool:
        """Whether the readings of a cycle have arrived, or are not expected."""
        return cycle < self.expected

    def take(self, cycle: int) -> Sequence[BeltReading]:
        """Remove and return the readings of a complete cycle."""
        return self._waiting.pop(cycle)


LARGEST = 1e9  # limit of announced numbers
NAME_MAX = 200  # characters


def belts_text(belts: Sequence[BeltAxes]) -> str:
    """Return belts as JSON for an announcement."""
    return json.dumps(
        [
            {
                **belt._asdict(),
                'window': None if belt.window is None else [belt.window.begin_m, belt.window.end_m],
            }
            for belt in belts
        ]
    )


def read_belts(text: str) -> tuple[BeltAxes, ...]:
    """Return the belts of an announcement; raises ValueError if it is invalid."""
    try:
        described = json.loads(text)
        found = tuple(_belt(one) for one in described)
    except (KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError('the announcement of the belts is invalid') from error
    if not isinstance(described, list) or len({belt.name for belt in found}) < len(found):
        raise ValueError('the announcement of the belts is invalid, or two have one name')
    return found


def _belt(facts: dict[str, Any]) -> BeltAxes:
    window, (x, y, z) = facts['window'], map(float, facts['origin_m'])
    names = 'direction_rad', 'increments_per_m', 'barrier_m', 'barrier_delay_s', 'camera_every_m'
    numbers = {name: float(facts[name]) for name in names}
    begin_m, end_m = (0.0, 0.0) if window is None else map(float, window)
    if facts.keys() != set(BeltAxes._fields) or not all(map(_is_name, (facts['name'], *facts['types']))):
        raise ValueError('the announcement of a belt is invalid')
    if not all(abs(number) < LARGEST for number in (x, y, z, begin_m, end_m, *numbers.values())):
        raise ValueError(f'a number of belt {facts["name"]} is out of its range')
    if numbers['increments_per_m'] <= 0.0 or math.copysign(1.0, end_m - begin_m) < 0.0:
        raise ValueError(f'belt {facts["name"]} has no increments, or its window ends before it begins')
    return BeltAxes(
        name=facts['name'],
        origin_m=(x, y, z),
        window=None if window is None else TrackWindow(begin_m, end_m),
        types=tuple(facts['types']),
        **numbers,
    )


def _is_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= NAME_MAX and value.isprintable()
