"""Parts: where each of them is, and what has happened to it."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from delta3_pacdrive.peripherals.cell import Box, PartType, Place, turned


class Outcome(StrEnum):
    """What has become of a part."""

    WAITING = 'waiting'  # where it came from
    IN_HAND = 'in hand'
    PLACED = 'placed'
    DROPPED = 'dropped'  # let go too high, or above nothing
    PRESSED = 'pressed'  # let go lower than there was room
    LOST = 'lost'  # fell while it was carried
    PASSED = 'passed'  # left the end of its belt


class How(StrEnum):
    """How a part stays where it is."""

    LYING = 'lying'
    RIDING = 'riding'  # on a belt
    IN_HAND = 'in hand'
    GONE = 'gone'


STAYS_MAX = 200  # the newest ones of a part: it may be carried to and fro for days
DIGITS = 7  # of places: 0.1 um


@dataclass(frozen=True)
class Stay:
    """From a bus cycle on a part goes with what bears it, until its next stay.

    Attributes
    ----------
    cycle
        Bus cycle at whose begin it is there.
    how
        What it goes with.
    belt, count
        The belt that it rides on, and what its encoder reads then; else empty and 0.
    at_m, angle_rad
        Middle of its underside then [m], and its angle about the vertical [rad]. In hand it is seen from the TCP, and
        from the tool of a rotary axis, with which it turns.

    """

    cycle: int
    how: How
    at_m: Place
    angle_rad: float
    belt: str = ''
    count: int = 0


@dataclass
class PartRecord:
    """What has happened to a part.

    Attributes
    ----------
    number
        Of the part, in the order in which parts came.
    type
        Name of its type.
    source
        The supply that it comes from.
    outcome
        What has become of it.
    reason
        Why, if something went wrong.
    picked_cycle
        Bus cycle from which on it was in hand; -1: never.
    pick_error_m
        From the middle of its top to the cup in that cycle [m].
    hold_use
        Greatest share of the holding force that it needed while it was carried.
    hold_needed_n, hold_force_n, hold_cycle
        What it needed then, what there was [N], and in which bus cycle.
    released_cycle
        Bus cycle in which it left the cup; -1: never.
    where, place
        Box and number of the place in which it is: layer by layer, along x first; -1 without a box.
    place_error_m
        From that place to the part in x and y, and how far it fell [m].
    size_m
        Its length, width and height [m].
    stays
        Where it has been, the newest ``STAYS_MAX``.

    """

    number: int
    type: str
    source: str
    outcome: Outcome = Outcome.WAITING
    reason: str = ''
    picked_cycle: int = -1
    pick_error_m: Place = (0.0, 0.0, 0.0)
    hold_use: float = 0.0
    hold_needed_n: float = 0.0
    hold_force_n: float = 0.0
    hold_cycle: int = -1
    released_cycle: int = -1
    where: str = ''
    place: int = -1
    place_error_m: Place = (0.0, 0.0, 0.0)
    size_m: Place = (0.0, 0.0, 0.0)
    stays: list[Stay] = field(default_factory=list)

    def to_document(self) -> dict[str, Any]:
        """Return it for a file."""
        return asdict(self)


@dataclass
class Miss:
    """The valve was opened and closed, and no part was in hand: when, and why."""

    opened_cycle: int
    closed_cycle: int
    reason: str

    def to_document(self) -> dict[str, Any]:
        """Return it for a file."""
        return asdict(self)


@dataclass
class Part:
    """A part: its type, the middle of its underside [m], its angle about the vertical [rad], and its record."""

    type: PartType
    at_m: Place
    angle_rad: float
    record: PartRecord

    @property
    def top_m(self) -> Place:
        """Middle of its top [m]."""
        x, y, z = self.at_m
        return (x, y, z + self.type.size_m[2])

    def stay(
        self,
        cycle: int,
        how: How,
        seen_from_m: Place = (0.0, 0.0, 0.0),
        belt: str = '',
        count: int = 0,
        turn_rad: float = 0.0,
    ) -> None:
        """Note how it stays where it is from a bus cycle on, seen from a place [m] that is turned by an angle [rad]."""
        x, y, z = (own - other for own, other in zip(self.at_m, seen_from_m, strict=True))
        x, y, z = (round(value, DIGITS) for value in turned((x, y, z), -turn_rad))
        angle = round(self.angle_rad - turn_rad, DIGITS)
        stays = self.record.stays
        stays.append(Stay(cycle, how, (x, y, z), angle, belt, count))
        del stays[:-STAYS_MAX]

    def is_above(self, other: 'Part') -> bool:
        """Whether another part lies below this one, seen from above; both as if they stood along x and y."""
        mine, its = self.type.size_m, other.type.size_m
        return all(abs(self.at_m[i] - other.at_m[i]) < 0.5 * (mine[i] + its[i]) for i in range(2))


@dataclass(frozen=True)
class Landing:
    """Where a part comes to rest that is let go: height of its support [m], and box, place and error of the place."""

    height_m: float
    where: str = ''
    place: int = -1
    error_m: tuple[float, float] = (0.0, 0.0)


def landing(part: Part, boxes: Iterable[Box], lying: Iterable[Part]) -> Landing | None:
    """Return where a part comes to rest below its place; None: there is nothing.

    Parameters
    ----------
    part
        At the place where it is let go.
    boxes
        Of the cell.
    lying
        All other parts; the highest one that the part is above bears it, or is in its way.

    """
    x, y, _ = part.at_m
    floor: Landing | None = None
    for box in boxes:
        number, dx, dy = box.nearest(x, y)
        half = (_reach(box.columns, box.pitch_m[0], part, 0), _reach(box.rows, box.pitch_m[1], part, 1))
        if abs(dx) <= half[0] and abs(dy) <= half[1] and (floor is None or box.at_m[2] > floor.height_m):
            floor = Landing(box.at_m[2], box.name, number, (dx, dy))
    height = max((one.top_m[2] for one in lying if part.is_above(one)), default=-math.inf)
    if floor is None:
        return None if height == -math.inf else Landing(height)
    return Landing(max(height, floor.height_m), floor.where, floor.place, floor.error_m)


def _reach(count: int, pitch_m: float, part: Part, i: int) -> float:
    """How far from a place a part still belongs to it [m]."""
    return 0.5 * abs(pitch_m) if count > 1 else 0.5 * part.type.size_m[i]
