"""Cell data in a bag: the scene, the history of parts and the encoder counts of belts."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from delta3_pacdrive.cell import cell_scene
from delta3_pacdrive.cell.cell_scene import Kind, Thing
from delta3_pacdrive.cell.parts_report import PartsLog
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.bag_messages import PARTS, SCENE, Sessions
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.telegrams import BELTS_TOPIC
from delta3_pacdrive.studies.runs.cell_history import CellStory, story_of
from delta3_pacdrive.studies.runs.run_signals import cycles_of, positive


def read(trace: Trace) -> CellStory | None:
    """Return the cell recorded in the bag of a trace; None if there was none.

    Messages of unknown publishers are ignored.
    """
    if trace.messages is None:
        return None
    messages = _Messages(positive(trace, 'cycle_time_s'), trace.messages.sessions)
    trace.messages.decode({SCENE: messages.scene, PARTS: messages.parts, BELTS_TOPIC: messages.belts})
    return story_of(
        messages.log, messages.things, trace, messages.ways(cycles_of(trace).astype(np.float64)), counted=True
    )


class _Messages:
    """Collects the messages of a cell."""

    def __init__(self, period_s: float, sessions: Sessions) -> None:
        self._period_s, self._sessions = period_s, sessions
        self.log = PartsLog()
        self.things: tuple[Thing, ...] = ()
        self._counts: list[tuple[str, int, Mapping[str, float]]] = []  # session, bus cycle, counts by belt

    def scene(self, message: Any) -> None:
        """Store the scene."""
        self.things = tuple(cell_scene.read(json.loads(message.data)))

    def parts(self, message: Any) -> None:
        """Add a report on parts."""
        self.log.add(message.data)

    def belts(self, message: Any) -> None:
        """Add the encoder counts of a bus cycle."""
        stamp = message.header.stamp
        cycle = round((stamp.sec + stamp.nanosec / NANOSECONDS) / self._period_s)
        counts = dict(zip(message.name, message.position[: len(message.name)].tolist(), strict=True))
        if np.isfinite(list(counts.values())).all():
            self._counts.append((message.header.frame_id, cycle, counts))

    def ways(self, cycles: Floats) -> dict[str, Floats]:
        """Return the travel of each belt in the given bus cycles [m]; linear over missing cycles."""
        own = {cycle: counts for session, cycle, counts in self._counts if self._sessions.holds(session)}
        found = {}
        for thing in self.things:
            if thing.kind is Kind.BELT and thing.increments_per_m > 0.0:
                known = sorted(
                    (cycle, counts[thing.name]) for cycle, counts in own.items() if thing.name in counts
                )
                if known:
                    counted_cycles, counted = np.array(known).T
                    way = counted / thing.increments_per_m
                    found[thing.name] = np.interp(cycles, counted_cycles, way, left=np.nan, right=np.nan)
        return found
