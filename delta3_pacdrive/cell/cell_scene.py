"""Geometry of a cell for display: horizontal areas, as a document for traces, bags and a topic."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from typing import Any

from delta3_pacdrive.belts.model import Belt, Place
from delta3_pacdrive.cell.cell import Box, Cell
from delta3_pacdrive.errors import TelegramError, shown

BEAM_M = 0.004  # displayed width of a light barrier
THINGS_MAX = 5000  # a cell file has at most 1,000 names per section
REACH_MAX_M = 1e4  # a box of 1,000 places at a pitch of 10 m


class Kind(StrEnum):
    """Kind of an area."""

    BELT = 'belt'
    WINDOW = 'window'  # section of a belt in which a robot may work
    BARRIER = 'barrier'
    CAMERA = 'camera'  # field of view on a belt
    BOX = 'box'
    SUPPLY = 'supply'
    SENSOR = 'sensor'


@dataclass(frozen=True)
class Thing:
    """A horizontal rectangle of the cell."""

    kind: Kind
    name: str  # in the cell file; areas of a belt have the name of the belt
    at_m: Place  # middle
    angle_rad: float  # about the vertical
    size_m: tuple[float, float]  # length and width; for a sensor the diameter of its range
    increments_per_m: float = 0.0  # of a belt's encoder


def document_of(cell: Cell) -> dict[str, Any]:
    """Return the scene of a cell as a document."""
    return {'cell': cell.name, 'things': [asdict(thing) for thing in things_of(cell)]}


def things_of(cell: Cell) -> list[Thing]:
    """Return the areas of a cell: belts with their sections, boxes, supplies, sensors."""
    found = [thing for belt in cell.belts.values() for thing in _of_belt(belt)]
    largest = max((part.size_m for part in cell.parts.values()), default=(0.1, 0.1, 0.1))
    found += [_of_box(box, largest) for box in cell.boxes.values()]
    for supply in cell.supplies.values():
        length, width, _ = cell.parts[supply.part].size_m
        found.append(Thing(Kind.SUPPLY, supply.name, supply.at_m, supply.angle_rad, (length, width)))
    for name, one in cell.inputs.items():
        if one.sensor is not None:
            seen = 2.0 * one.sensor.radius_m
            found.append(Thing(Kind.SENSOR, name, one.sensor.at_m, 0.0, (seen, seen)))
    return found


def _of_belt(belt: Belt) -> Iterable[Thing]:
    def part(kind: Kind, begin_m: float, end_m: float, increments_per_m: float = 0.0) -> Thing:
        middle, size = belt.place_m(0.5 * (begin_m + end_m)), (end_m - begin_m, belt.width_m)
        return Thing(
            kind=kind,
            name=belt.name,
            at_m=middle,
            angle_rad=belt.direction_rad,
            size_m=size,
            increments_per_m=increments_per_m,
        )

    yield part(Kind.BELT, 0.0, belt.length_m, belt.increments_per_m)
    if belt.window_m is not None:
        yield part(Kind.WINDOW, *belt.window_m)
    if belt.camera is not None:
        half = 0.5 * belt.camera.length_m
        yield part(Kind.CAMERA, belt.camera.at_m - half, belt.camera.at_m + half)
    if belt.barrier is not None:
        at = belt.barrier.at_m
        yield part(Kind.BARRIER, at - 0.5 * BEAM_M, at + 0.5 * BEAM_M)


def _of_box(box: Box, part_m: Place) -> Thing:
    """Return the area of a box: one pitch per place, or the size of the largest part without a pitch."""
    spans = [(count - 1) * pitch for count, pitch in zip((box.columns, box.rows), box.pitch_m, strict=True)]
    sides = [abs(pitch) or part for pitch, part in zip(box.pitch_m, part_m, strict=False)]
    x, y, z = box.at_m
    middle = (x + 0.5 * spans[0], y + 0.5 * spans[1], z)
    return Thing(Kind.BOX, box.name, middle, 0.0, (abs(spans[0]) + sides[0], abs(spans[1]) + sides[1]))


def brings_parts(things: Iterable[Thing]) -> bool:
    """Whether the cell supplies parts, so that a display need not infer them from the gripper."""
    return any(thing.kind in (Kind.BELT, Kind.SUPPLY) for thing in things)


def read(document: Any) -> list[Thing]:
    """Return the areas of a received document; raises TelegramError if it is invalid."""
    try:
        things = document['things']
        if not isinstance(document['cell'], str) or not isinstance(things, list) or len(things) > THINGS_MAX:
            raise ValueError('no list of things, or too long a one')
        return [_read(one) for one in things]
    except (ValueError, KeyError, TypeError, OverflowError):
        raise TelegramError(f'{shown(document)} is not a valid scene of a cell') from None


def _read(document: dict[str, Any]) -> Thing:
    names = [field.name for field in fields(Thing)]
    if sorted(document) != sorted(names):
        raise ValueError('other fields')
    (x, y, z), (length, width) = document['at_m'], document['size_m']
    numbers = [x, y, z, document['angle_rad'], length, width]
    for value in numbers:
        if isinstance(value, bool) or not abs(value) <= REACH_MAX_M:
            raise ValueError('no length or angle')
    per_m, name = document['increments_per_m'], document['name']
    if isinstance(per_m, bool) or not 0.0 <= per_m < math.inf or not isinstance(name, str):
        raise ValueError('no encoder, or no name')
    kind, angle = Kind(document['kind']), document['angle_rad']
    return Thing(
        kind=kind,
        name=name,
        at_m=(x, y, z),
        angle_rad=angle,
        size_m=(length, width),
        increments_per_m=float(per_m),
    )
