"""State of the cell around a running robot from its messages: the pose of every part at an instant."""

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.cell import cell_scene
from delta3_pacdrive.cell.cell_scene import REACH_MAX_M, Kind, Thing
from delta3_pacdrive.cell.part_places import angle_rad, place_m
from delta3_pacdrive.cell.parts import How, Stay
from delta3_pacdrive.cell.parts_report import read_message
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.view.values import PARTS_MAX, CellInstant, PartPlace, Point


@dataclass(frozen=True)
class _Present:
    """A part in the cell: its pose at the start of its stay, the time of that message [ns], and the stay."""

    place: PartPlace
    sent_ns: int
    stay: Stay


class CellNow:
    """The current state of a cell; invalid messages are ignored."""

    def __init__(self) -> None:
        self.things: tuple[Thing, ...] = ()
        self.changes = 0  # of ``things``
        self._belts: dict[str, Thing] = {}
        self._parts: dict[int, _Present] = {}  # by number, in the order of their newest messages
        self._before: tuple[float, dict[str, float]] = (-math.inf, {})  # bus time [s], counts
        self._newest = self._before

    def clear(self) -> None:
        """Remove everything: the cell has gone."""
        self._parts.clear()
        self._use(())

    def _use(self, things: tuple[Thing, ...]) -> None:
        if things != self.things:
            self.things = things
            self.changes += 1
        self._belts = {thing.name: thing for thing in things if thing.kind is Kind.BELT}

    def take_scene(self, text: str, sent_ns: int = 0) -> None:
        """Process a message of ``cell/scene``; parts of earlier messages belong to a previous cell."""
        with suppress(TelegramError, ValueError, RecursionError):
            self._use(tuple(cell_scene.read(json.loads(text))))
            self._parts = {n: one for n, one in self._parts.items() if one.sent_ns >= sent_ns}

    def take_parts(self, text: str, sent_ns: int = 0) -> None:
        """Process a message of ``cell/parts``."""
        with suppress(TelegramError):
            for number, document in read_message(text).parts.items():
                self._parts.pop(number, None)
                present = _present(document, sent_ns)
                if present is not None:
                    self._parts[number] = present
            while len(self._parts) > PARTS_MAX:
                del self._parts[next(iter(self._parts))]

    def take_counts(self, time_s: float, counts: Mapping[str, float]) -> None:
        """Process the encoder counts of the belts at a bus time [s]."""
        if time_s != self._newest[0]:
            self._before, self._newest = self._newest, (time_s, dict(counts))

    def at(self, time_s: float, tcp_m: Point, turn_rad: float = 0.0) -> CellInstant:
        """Return the moving objects at a bus time [s], for a TCP position [m] and a tool angle [rad]."""
        counts = {name: self._count(name, time_s) for name in self._belts if name in self._newest[1]}
        ways = {
            name: count / self._belts[name].increments_per_m
            for name, count in counts.items()
            if self._moves(name)
        }
        parts = tuple(self._now(one, counts, tcp_m, turn_rad) for one in self._parts.values())
        return CellInstant(parts, ways)

    def _moves(self, name: str) -> bool:
        return name in self._belts and self._belts[name].increments_per_m > 0.0

    def _count(self, name: str, time_s: float) -> float:
        """Return the count of a belt at a time, interpolated between the last two messages and limited to them."""
        (before_s, before), (newest_s, newest) = self._before, self._newest
        if name not in before or not before_s < newest_s:
            return newest[name]
        share = min(max((time_s - before_s) / (newest_s - before_s), 0.0), 1.0)
        return before[name] + share * (newest[name] - before[name])

    def _now(self, one: _Present, counts: Mapping[str, float], tcp_m: Point, turn_rad: float) -> PartPlace:
        stay, way, direction = one.stay, 0.0, 0.0
        if stay.how is How.LYING:
            return one.place
        if stay.how is How.RIDING and stay.belt in counts and self._moves(stay.belt):
            belt = self._belts[stay.belt]
            way, direction = (counts[stay.belt] - stay.count) / belt.increments_per_m, belt.angle_rad
        place = place_m(stay, tcp_m, way, direction, turn_rad) or stay.at_m
        return replace(one.place, at_m=place, angle_rad=angle_rad(stay, turn_rad))


def _present(document: dict[str, Any], sent_ns: int) -> _Present | None:
    """Return a part from its document, None if it has gone or is out of range."""
    if not document['stays']:
        return None
    last = document['stays'][-1]
    x, y, z = last['at_m']
    length, width, height = document['size_m']
    near = (
        max(map(abs, (x, y, z))) <= REACH_MAX_M
        and 0.0 < min(document['size_m']) <= max(document['size_m']) <= REACH_MAX_M
    )
    if last['how'] == How.GONE or not near:
        return None
    stay = Stay(**last | {'how': How(last['how']), 'at_m': (x, y, z)})
    place = PartPlace(
        document['number'], document['type'], (length, width, height), (x, y, z), stay.angle_rad
    )
    return _Present(place, sent_ns, stay)
