"""Parts: positions, outcome and history of each, and the support below a released part."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from delta3_pacdrive.belts.model import Place
from delta3_pacdrive.cell.cell import Box, PartType, turned


class Outcome(StrEnum):
    """Outcome of a part."""

    WAITING = 'waiting'  # at its source
    IN_HAND = 'in hand'
    PLACED = 'placed'
    DROPPED = 'dropped'  # released too high, or above nothing
    PRESSED = 'pressed'  # released below the height of its support
    LOST = 'lost'  # fell while being carried
    PASSED = 'passed'  # left the end of its belt


class How(StrEnum):
    """Support of a part during a stay."""

    LYING = 'lying'
    RIDING = 'riding'  # on a belt
    IN_HAND = 'in hand'
    GONE = 'gone'


STAYS_MAX = 200  # latest stays kept per part
DIGITS = 7  # of positions in records: 0.1 um


@dataclass(frozen=True)
class Stay:
    """Support of a part from a bus cycle on, until its next stay."""

    cycle: int
    how: How
    at_m: Place  # middle of its underside at the beginning of the cycle; IN_HAND: relative to the TCP in the tool frame
    angle_rad: float  # about the vertical; IN_HAND: relative to the tool
    belt: str = ''  # RIDING: name of the belt
    count: int = 0  # RIDING: encoder count at the beginning of the cycle


@dataclass
class PartRecord:
    """History of a part.

    Attributes
    ----------
    hold_needed_n, hold_force_n, hold_cycle
        Required and available holding force [N], and bus cycle, at the moment of ``hold_use``.

    """

    number: int
    type: str
    source: str  # supply or belt of its origin
    outcome: Outcome = Outcome.WAITING
    reason: str = ''
    picked_cycle: int = -1  # bus cycle in which it was gripped; -1: never
    pick_error_m: Place = (0.0, 0.0, 0.0)  # from the middle of its top to the cup when gripped
    hold_use: float = 0.0  # largest share of the holding force required while it was carried
    hold_needed_n: float = 0.0
    hold_force_n: float = 0.0
    hold_cycle: int = -1
    released_cycle: int = -1  # bus cycle in which it left the cup; -1: never
    where: str = ''  # box, supply or belt on which it was put
    place: int = -1  # number of the place in the box: layer by layer, along x first; -1 without a box
    place_error_m: Place = (0.0, 0.0, 0.0)  # distance from that place in x and y, and height of fall
    size_m: Place = (0.0, 0.0, 0.0)
    stays: list[Stay] = field(default_factory=list)

    def to_document(self) -> dict[str, Any]:
        """Return the record as a document."""
        return asdict(self)


@dataclass
class Miss:
    """Valve opened and closed without gripping a part."""

    opened_cycle: int
    closed_cycle: int
    reason: str

    def to_document(self) -> dict[str, Any]:
        """Return the record as a document."""
        return asdict(self)


@dataclass
class Part:
    """A part: type, middle of its underside [m], angle about the vertical [rad], and record."""

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
        origin_m: Place = (0.0, 0.0, 0.0),
        belt: str = '',
        count: int = 0,
        turn_rad: float = 0.0,
    ) -> None:
        """Append a stay to the record, with the pose relative to ``origin_m`` [m] and ``turn_rad`` [rad]."""
        x, y, z = (own - other for own, other in zip(self.at_m, origin_m, strict=True))
        x, y, z = (round(value, DIGITS) for value in turned((x, y, z), -turn_rad))
        angle = round(self.angle_rad - turn_rad, DIGITS)
        stays = self.record.stays
        stays.append(Stay(cycle=cycle, how=how, at_m=(x, y, z), angle_rad=angle, belt=belt, count=count))
        del stays[:-STAYS_MAX]

    def overlaps(self, other: 'Part') -> bool:
        """Whether the footprints of this part and another overlap, both taken as aligned with x and y."""
        mine, its = self.type.size_m, other.type.size_m
        return all(abs(self.at_m[i] - other.at_m[i]) < 0.5 * (mine[i] + its[i]) for i in range(2))


@dataclass(frozen=True)
class Landing:
    """Support of a released part: height [m], name of box, supply or belt, place, and distance from the place [m]."""

    height_m: float
    where: str = ''
    place: int = -1
    error_m: tuple[float, float] = (0.0, 0.0)


def landing(part: Part, boxes: Iterable[Box], lying: Iterable[Part]) -> Landing | None:
    """Return the support below a part; None without any.

    Parameters
    ----------
    part
        The part, at the position of its release.
    boxes
        Boxes of the cell, and its supplies as boxes of one place.
    lying
        All other parts; the highest one below supports the part.

    """
    x, y, _ = part.at_m
    base: Landing | None = None
    for box in boxes:
        number, dx, dy = box.nearest(x, y)
        half = (_reach(box.columns, box.pitch_m[0], part, 0), _reach(box.rows, box.pitch_m[1], part, 1))
        if abs(dx) <= half[0] and abs(dy) <= half[1] and (base is None or box.at_m[2] > base.height_m):
            base = Landing(box.at_m[2], box.name, number, (dx, dy))
    height = max((one.top_m[2] for one in lying if part.overlaps(one)), default=-math.inf)
    if base is None:
        return None if height == -math.inf else Landing(height)
    return Landing(max(height, base.height_m), base.where, base.place, base.error_m)


def _reach(count: int, pitch_m: float, part: Part, i: int) -> float:
    """Largest distance from a place at which a part still belongs to it [m]."""
    return 0.5 * abs(pitch_m) if count > 1 else 0.5 * part.type.size_m[i]
