"""What was around the robot in a run, and where each part was: things that stand there, belts, parts with their stays.

A part goes with what bears it. So the way of its belt and the TCP say where it is, in every bus cycle.
"""

import json
import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from delta3_pacdrive.analysis.run_signals import positive
from delta3_pacdrive.errors import TelegramError, TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.peripherals import cell_scene
from delta3_pacdrive.peripherals.cell import Place
from delta3_pacdrive.peripherals.cell_scene import Kind, Thing
from delta3_pacdrive.peripherals.part_places import angle_rad, place_m
from delta3_pacdrive.peripherals.parts import How, Stay
from delta3_pacdrive.peripherals.parts_report import PartsLog
from delta3_pacdrive.recording.trace import Trace

Document = Mapping[str, Any]


@dataclass(frozen=True)
class CellStory:
    """The story of a cell.

    Attributes
    ----------
    name
        Of the cell.
    things
        What stands there; empty for a recording of before this was told.
    parts
        Documents of ``PartRecord``, by their numbers: the newest ones. Without ``stays`` nobody knows where one was.
    outcomes
        How many of all parts have come to each outcome.
    cycles
        Bus cycles of the recording, in their order, shape (cycles,).
    ways
        How far each belt has gone in them [m], by its name, shape (cycles,); nan where nobody knows.
    counted
        Whether ways are counts of encoders: then the count of a stay says where its belt was.

    """

    name: str
    things: tuple[Thing, ...]
    parts: tuple[Document, ...]
    outcomes: Mapping[str, int]
    cycles: Floats
    ways: Mapping[str, Floats]
    counted: bool = False

    @cached_property
    def belts(self) -> Mapping[str, Thing]:
        """Belts by their names."""
        return {thing.name: thing for thing in self.things if thing.kind is Kind.BELT}

    @cached_property
    def stays(self) -> tuple[tuple[Stay, ...], ...]:
        """Where each part was, in the order of ``parts`` and of their bus cycles."""
        return tuple(
            tuple(sorted((_stay(told) for told in part['stays']), key=lambda stay: stay.cycle))
            for part in self.parts
        )

    @cached_property
    def spans(self) -> tuple[Floats, Floats]:
        """Bus cycles from which on each part is there, and from which on it is gone, shape (parts,)."""
        gone = Stay(0, How.GONE, (0.0, 0.0, 0.0), 0.0)
        found = [
            (stays[0].cycle, stays[-1].cycle if stays[-1].how is How.GONE else math.inf)
            for stays in (own or (gone,) for own in self.stays)
        ]
        begins, ends = np.array(found, dtype=np.float64).reshape(-1, 2).T
        return begins, ends

    def ways_m(self, belt: str, cycles: Floats) -> Floats:
        """Return how far a belt has gone in bus cycles [m], shape of these; nan where nobody knows."""
        if belt not in self.ways:
            return np.full(np.shape(cycles), np.nan)
        return np.interp(cycles, self.cycles, self.ways[belt], left=math.nan, right=math.nan)

    def way_m(self, belt: str, cycle: float) -> float:
        """Return how far a belt has gone in a bus cycle [m]; nan if nobody knows."""
        known = self.ways.get(belt)
        if known is None:
            return math.nan
        n = int(np.searchsorted(self.cycles, cycle))
        near = slice(max(n - 1, 0), n + 1)  # whoever plays a long run asks often
        return float(np.interp(cycle, self.cycles[near], known[near], left=math.nan, right=math.nan))

    def begin_m(self, stay: Stay) -> float:
        """Return how far its belt had gone when a part began to ride on it [m]; nan if nobody knows."""
        if not self.counted:
            return self.way_m(stay.belt, stay.cycle)
        belt = self.belts.get(stay.belt)
        return stay.count / belt.increments_per_m if belt and belt.increments_per_m else math.nan

    def at(self, cycle: int, tcp_m: Place, turn_rad: float = 0.0) -> Iterator[tuple[Document, Place, float]]:
        """Tell where parts are at the begin of a bus cycle.

        Parameters
        ----------
        cycle
            Of the bus.
        tcp_m
            The TCP with which a part in hand goes [m].
        turn_rad
            Angle of the tool with which it turns [rad].

        Yields
        ------
        Each part that is there, the middle of its underside [m], and its angle about the vertical [rad].

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


def _stay(told: Document) -> Stay:
    x, y, z = told['at_m']
    rest = told['angle_rad'], told['belt'], told['count']
    return Stay(told['cycle'], How(told['how']), (x, y, z), *rest)


def cycles_of(trace: Trace) -> Floats:
    """Return the bus cycles of a trace, shape (cycles,); raises TraceError."""
    return np.rint(trace.time_s / positive(trace, 'cycle_time_s'))


def of_trace(trace: Trace, name: str) -> CellStory | None:
    """Return what the trace of a simulation tells of its cell; None if it had none.

    Parameters
    ----------
    trace
        Of the simulation.
    name
        Of its file, for refusals.

    Raises
    ------
    TraceError
        It tells nonsense of its cell, or does not tell its cycle time.

    """
    told = trace.meta.get('cell')
    if told is None:
        return None
    log, scene = PartsLog(), trace.meta.get('cell_scene')
    try:
        log.add(json.dumps(told))
        things = () if scene is None else tuple(cell_scene.read(scene))
    except TelegramError:
        raise TraceError(f'what {name} tells of its cell cannot be read') from None
    ways: dict[str, Floats] = {}
    if 'cell_belts' in trace.signals:
        names = [thing.name for thing in things if thing.kind is Kind.BELT]
        ways = dict(zip(names, trace['cell_belts'].T, strict=False))
    return told_of(log, things, trace, ways)


def told_of(
    log: PartsLog, things: tuple[Thing, ...], trace: Trace, ways: Mapping[str, Floats], counted: bool = False
) -> CellStory | None:
    """Return the story of a log of parts and of things; None if neither tells anything.

    Parameters
    ----------
    log
        Of the parts.
    things
        What stands there.
    trace
        Of the run.
    ways
        Of the belts in its cycles [m], by their names, each of shape (cycles,).
    counted
        Whether these are counts of encoders.

    """
    report = log.report()
    if report is None and not things:
        return None
    report = report or {'cell': '', 'parts': [], 'outcomes': {}}
    parts, outcomes = tuple(report['parts']), report['outcomes']
    return CellStory(report['cell'], things, parts, outcomes, cycles_of(trace), ways, counted)
