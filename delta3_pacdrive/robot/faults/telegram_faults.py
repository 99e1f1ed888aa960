"""Links that lose, delay, duplicate or corrupt telegrams."""

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from delta3_pacdrive.robot.faults.fault import GARBLED
from delta3_pacdrive.robot.faults.schedule import Schedule

Content = TypeVar('Content')


class FaultyLink(Generic[Content]):
    """Transmission of MDTs to one drive, or of ATs to the master, with injected faults.

    Parameters
    ----------
    faults
        Schedule of the receiver.
    kinds
        Kinds of faults that affect these telegrams.
    refuse
        Called for a corrupted telegram.

    """

    def __init__(self, faults: Schedule, kinds: frozenset[str], refuse: Callable[[str], None]) -> None:
        self._faults, self._kinds, self._refuse = faults, kinds, refuse
        # delayed telegrams: release cycle, axis, cycle, content
        self._held_back: list[tuple[int, str, int, Content]] = []

    def clear(self) -> None:
        """Discard delayed telegrams."""
        self._held_back.clear()

    def garbles(self, axis: str, cycle: int) -> bool:
        """Whether the telegram of a cycle arrives, but is garbled."""
        fault = self._faults.telegram(self._kinds, axis, cycle)
        return fault is not None and fault.kind in GARBLED

    def arrivals(self, axis: str, cycle: int, content: Content) -> Sequence[tuple[int, Content | None]]:
        """Return the telegrams that arrive when that of a cycle is due: cycles with contents, ``None`` if lost.

        A delayed telegram arrives after that of its release cycle, too late for its own.
        """
        if not self._faults.disturbs_telegrams and not self._held_back:
            return ((cycle, content),)
        fault = self._faults.telegram(self._kinds, axis, cycle)
        what, _, telegram = ('', '', '') if fault is None else fault.kind.partition('_')
        if what == 'delay' and fault is not None:
            self._held_back.append((cycle + int(fault.value), axis, cycle, content))
        arrivals: list[tuple[int, Content | None]] = [(cycle, content if what in ('', 'duplicate') else None)]
        if what == 'duplicate':
            arrivals.append((cycle, content))
        elif fault is not None and fault.kind in GARBLED:
            self._refuse(f'{axis}: the {telegram.upper()} of bus cycle {cycle} is garbled')
        late = [item for item in self._held_back if item[0] <= cycle and item[1] == axis]
        self._held_back = [item for item in self._held_back if item not in late]
        return [*arrivals, *(item[2:] for item in late)]
