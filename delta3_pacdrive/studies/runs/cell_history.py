"""The cell around the robot during a run: fixed objects, belts, and the position of each part over time.

A part moves with its carrier, so its position in any bus cycle follows from the travel of its belt and from the TCP.
"""

import json
import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from delta3_pacdrive.belts.model import Place
from delta3_pacdrive.cell import cell_scene
from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.cell.part_places import angle_rad, place_m
from delta3_pacdrive.cell.parts import How, Stay
from delta3_pacdrive.cell.parts_report import PartsLog
from delta3_pacdrive.errors import TelegramError, TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs.run_signals import cycles_of

Document = Mapping[str, Any]


@dataclass(frozen=True)
class CellStory:
    """Objects and parts of a cell over a run."""

    name: str
    things: tuple[Thing, ...]  # objects of the scene; empty for recordings made before scenes were published
    # documents of PartRecord by number, newest only; positions unknown without 'stays'
    parts: tuple[Document, ...]
    outcomes: Mapping[str, int]  # number of parts by outcome
    cycles: Floats  # bus cycles of the recording in ascending order, shape (cycles,)
    ways: Mapping[str, Floats]  # travel of each belt in these cycles [m], shape (cycles,); nan if unknown
    # whether ways are encoder counts; then the count of a stay gives the position of its belt
    counted: bool = False

    @cached_property
    def belts(self) -> Mapping[str, Thing]:
        """Belts by name."""
        return {thing.name: thing for thing in self.things if thing.kind is Kind.BELT}

    @cached_property
    def stays(self) -> tuple[tuple[Stay, ...], ...]:
        """Stays of each part in the order of ``parts``, sorted by bus cycle."""
        return tuple(
            tuple(sorted((_stay(one) for one in part['stays']), key=lambda stay: stay.cycle))
            for part in self.parts
        )

    @cached_property
    def spans(self) -> tuple[Floats, Floats]:
        """Bus cycles at which each part appears and disappears, shape (parts,)."""
        gone = Stay(0, How.GONE, (0.0, 0.0, 0.0), 0.0)
        found = [
            (stays[0].cycle, stays[-1].cycle if stays[-1].how is How.GONE else math.inf)
            for stays in (own or (gone,) for own in self.stays)
        ]
        begins, ends = np.array(found, dtype=np.float64).reshape(-1, 2).T
        return begins, ends

    def ways_m(self, belt: str, cycles: Floats) -> Floats:
        """Return the travel of a belt in bus cycles [m], shape of ``cycles``; nan if unknown."""
        if belt not in self.ways:
            return np.full(np.shape(cycles), np.nan)
        return np.interp(cycles, self.cycles, self.ways[belt], left=math.nan, right=math.nan)

    def way_m(self, belt: str, cycle: float) -> float:
        """Return the travel of a belt in a bus cycle [m]; nan if unknown."""
        known = self.ways.get(belt)
        if known is None:
            return math.nan
        n = int(np.searchsorted(self.cycles, cycle))
        near = slice(max(n - 1, 0), n + 1)  # called for every frame of a playback: interpolate locally
        return float(np.interp(cycle, self.cycles[near], known[near], left=math.nan, right=math.nan))

    def begin_m(self, stay: Stay) -> float:
        """Return the travel of its belt when a part was put on it [m]; nan if unknown."""
        if not self.counted:
            return self.way_m(stay.belt, stay.cycle)
        belt = self.belts.get(stay.belt)
        return stay.count / belt.increments_per_m if belt and belt.increments_per_m else math.nan

    def at(self, cycle: int, tcp_m: Place, turn_rad: float = 0.0) -> Iterator[tuple[Document, Place, float]]:
        """Yield the parts present at a bus cycle, with the centre of the underside [m] and the angle about z [rad].

        A gripped part is carried by the TCP ``tcp_m`` with the angle ``turn_rad`` of the tool.
        """
        begins, ends = self.spans
        for n in np.flatnonzero((begins <= cycle) & (cycle < ends)).tolist():
            part, stays = self.parts[n], self.stays[n]
            stay = stays[bisect_right(stays, cycle, key=lambda one: one.cycle) - 1]
            if stay.how is How.GONE:
                continue
            way = direction = 0.0
            if stay.how is How.RIDING:
                belt = self.belts.get(stay.belt)
                way = self.way_m(stay.belt, cycle) - self.begin_m(stay)
                direction = belt.angle_rad if belt else math.nan
            place = place_m(stay, tcp_m, way, direction, turn_rad)
            if place is not None and all(map(math.isfinite, place)):
                yield part, place, angle_rad(stay, turn_rad)


def _stay(row: Document) -> Stay:
    x, y, z = row['at_m']
    return Stay(
        cycle=row['cycle'],
        how=How(row['how']),
        at_m=(x, y, z),
        angle_rad=row['angle_rad'],
        belt=row['belt'],
        count=row['count'],
    )


def of_trace(trace: Trace, name: str) -> CellStory | None:
    """Return the cell of a simulated trace; None if it had none.

    Raises
    ------
    TraceError
        The data of the cell in the file ``name``, or the cycle time, is invalid.

    """
    cell = trace.meta.get('cell')
    if cell is None:
        return None
    log, scene = PartsLog(), trace.meta.get('cell_scene')
    try:
        log.add(json.dumps(cell))
        things = () if scene is None else tuple(cell_scene.read(scene))
    except TelegramError:
        raise TraceError(f'{name}: the data of its cell cannot be read') from None
    ways: dict[str, Floats] = {}
    if 'cell_belts' in trace.signals:
        names = [thing.name for thing in things if thing.kind is Kind.BELT]
        ways = dict(zip(names, trace['cell_belts'].T, strict=False))
    return story_of(log, things, trace, ways)


def story_of(
    log: PartsLog, things: tuple[Thing, ...], trace: Trace, ways: Mapping[str, Floats], counted: bool = False
) -> CellStory | None:
    """Return the story of a cell; None if there are neither parts nor objects.

    ``ways`` is the travel of each belt in the cycles of ``trace`` [m], each of shape (cycles,); ``counted`` is whether
    it
    comes from encoder counts.
    """
    report = log.report()
    if report is None and not things:
        return None
    report = report or {'cell': '', 'parts': [], 'outcomes': {}}
    parts, outcomes = tuple(report['parts']), report['outcomes']
    return CellStory(
        name=report['cell'],
        things=things,
        parts=parts,
        outcomes=outcomes,
        cycles=cycles_of(trace).astype(np.float64),
        ways=ways,
        counted=counted,
    )
