"""Schedule of faults: the bus cycles at which they begin and end."""

import math
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.robot.faults.fault import DUPLICATES, KINDS, Fault, parse
from delta3_pacdrive.robot.sercos.bus_time import NEVER


@dataclass(frozen=True)
class Scheduled:
    """A fault in the bus cycles from ``first`` up to, but not including, ``end``."""

    fault: Fault
    first: int
    end: int

    @staticmethod
    def of(fault: Fault, cycle: int, cycle_time_s: float) -> 'Scheduled':
        """Schedule a fault relative to a bus cycle."""
        first = cycle + round(fault.after_s / cycle_time_s)
        if KINDS[fault.kind].telegram:
            return Scheduled(fault, first, first + fault.cycles)
        return Scheduled(
            fault, first, NEVER if math.isinf(fault.for_s) else first + math.ceil(fault.for_s / cycle_time_s)
        )

    def to_document(self) -> dict[str, Any]:
        """Return the fault as a document for a message."""
        return self.fault.to_document() | {'first': self.first, 'end': self.end}

    @staticmethod
    def from_document(value: Any) -> 'Scheduled':
        """Read the output of ``to_document``; raises ProgramError."""
        fault = parse(value, 'fault', 'first', 'end')
        first, end = value.get('first'), value.get('end')
        if not isinstance(first, int) or not isinstance(end, int) or not 0 <= first < end:
            raise ProgramError(f'a fault from bus cycle {shown(first)} to {shown(end)} is not valid')
        return Scheduled(fault, first, end)


class Schedule:
    """Faults of one participant, in bus time.

    Attributes
    ----------
    next_cycle
        Cycle of the next change, ``NEVER`` if none is due.
    active
        Faults in progress, in the order of their beginning.

    """

    def __init__(self) -> None:
        self.next_cycle = NEVER
        self.active: list[Fault] = []
        self._changes: list[tuple[int, bool, Scheduled]] = []  # cycle, whether the fault begins
        self._telegrams: list[Scheduled] = []

    def add(self, scheduled: Scheduled) -> None:
        """Add a fault."""
        if KINDS[scheduled.fault.kind].telegram:
            self._telegrams.append(scheduled)
            # a lost telegram cannot be duplicated
            self._telegrams.sort(key=lambda one: one.fault.kind in DUPLICATES)
            return
        self._changes.append((scheduled.first, True, scheduled))
        if scheduled.end < NEVER:
            self._changes.append((scheduled.end, False, scheduled))
        self._sort()

    def _sort(self) -> None:
        self._changes.sort(key=lambda change: change[:2])
        self.next_cycle = self._changes[0][0] if self._changes else NEVER

    def due(self, cycle: int) -> list[tuple[Fault, bool]]:
        """Remove and return the faults that begin (True) or end (False) up to a cycle, in order."""
        due = [change for change in self._changes if change[0] <= cycle]
        self._changes = [change for change in self._changes if change[0] > cycle]
        self._sort()
        for _, begins, scheduled in due:
            if begins and not KINDS[scheduled.fault.kind].once:
                self.active.append(scheduled.fault)
            elif not begins:
                self.active.remove(scheduled.fault)
        if any(scheduled.fault.kind == 'clear' for _, _, scheduled in due):
            self._telegrams.clear()
            self._changes.clear()
            self.active.clear()
            self.next_cycle = NEVER
        return [(scheduled.fault, begins) for _, begins, scheduled in due]

    def telegram(self, kinds: frozenset[str], axis: str, cycle: int) -> Fault | None:
        """Return the fault of the given kinds that affects the telegram of an axis in a cycle."""
        for scheduled in self._telegrams:
            fault = scheduled.fault
            if scheduled.first <= cycle < scheduled.end and fault.kind in kinds and fault.target == axis:
                return fault
        return None

    def next_event(self, cycle: int) -> int:
        """Return the first cycle, from a given one on, in which a fault begins, ends or affects a telegram."""
        disturbed = [max(one.first, cycle) for one in self._telegrams if one.end > cycle]
        return min([self.next_cycle, *disturbed])

    def clear_telegrams_before(self, cycle: int) -> None:
        """Remove telegram faults that have ended."""
        self._telegrams = [scheduled for scheduled in self._telegrams if scheduled.end > cycle]

    @property
    def disturbs_telegrams(self) -> bool:
        """Whether any telegram fault is pending or not yet removed."""
        return bool(self._telegrams)
