"""Robot interface for scripts that receive parts and slots of belts."""

from collections.abc import Sequence

from delta3_pacdrive.belts.knowledge import BeltKnowledge
from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.queue import QueuedPart, Rule
from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import Code, ProgramError, Reason, WaitTimeoutError, shown
from delta3_pacdrive.scripting.belt_block import belt_error
from delta3_pacdrive.scripting.belt_parts import BeltParts, BeltState
from delta3_pacdrive.scripting.link import Link
from delta3_pacdrive.scripting.robot import Robot
from delta3_pacdrive.scripting.script_orders import ScriptOrders
from delta3_pacdrive.scripting.source_position import of_caller
from delta3_pacdrive.scripting.values import TIMEOUT_S


class PartsRobot(Robot):
    """A robot controlled by a script, with part queues of belts."""

    def __init__(self, link: Link, name: str, orders: ScriptOrders | None = None) -> None:
        super().__init__(link, name, orders)
        tracking = link.tracking
        self._parts = [BeltParts(tracking, n) for n in range(len(tracking.belts))] if tracking else []

    def part(
        self,
        belt: str | Sequence[str],
        timeout_s: float = TIMEOUT_S,
        rule: str = Rule.FIRST_IN,
        kind: str = '',
    ) -> QueuedPart:
        """Wait for the next part on one or several belts that can still be reached.

        Parameters
        ----------
        belt
            Name of a belt, or a list of names. Use ``track(part.belt, part)`` for the returned part.
        timeout_s
            Time after which the call raises ``WaitTimeoutError`` [s].
        rule
            Choice of the part: ``first in``: the part farthest downstream, on several belts the one that leaves its
            window first; ``nearest`` to the robot; or ``by load``: a part of the belt with the longest queue.
        kind
            Type of the part as reported by a camera; empty: any.

        """
        with self._errors_at(of_caller()):
            names = self._names_of(belt)
            known = [self._belt(name) for name in names]
            windows = [self._window(tracking, n) for tracking, n in known]
            if rule not in tuple(Rule):
                raise ProgramError(
                    f'part: rule is {shown(rule)}, but must be one of: {", ".join(Rule)}{nearest_of(rule, Rule)}'
                )
            if rule == Rule.BY_LOAD and len(names) < 2:
                raise ProgramError('part: rule by load requires a list of several belts')
            if kind != '':
                for tracking, n in known:
                    _require_detectable(kind, tracking.belts[n])
            latest = self._cycles('timeout_s', timeout_s)
            self._order()
            latest += self._link.poll().cycle
            while True:
                seen = self._link.poll()
                offers = [
                    (n, offer)
                    for (tracking, n), window in zip(known, windows, strict=True)
                    if (
                        offer := self._parts[n].offer(
                            window, tracking.belts[n].along_m(seen.position_m), Rule(rule), kind
                        )
                    )
                ]
                if offers:
                    n, offer = min(offers, key=lambda one: one[1].rank(Rule(rule)))
                    self._parts[n].take(offer.part)
                    return offer.part
                for tracking, n in known:
                    _require_camera(tracking, n)
                if seen.cycle >= latest:
                    where = ' or '.join(shown(name) for name in names)
                    raise WaitTimeoutError(
                        Reason(Code.TIMEOUT, f'part: none arrived on belt {where} within {timeout_s:g} s')
                    )
                self._orders.go_to(seen.cycle + 1)

    @staticmethod
    def _names_of(belt: str | Sequence[str]) -> tuple[str, ...]:
        """Return the belt names of a call; raises ProgramError."""
        names = (belt,) if isinstance(belt, str) else tuple(belt) if isinstance(belt, list | tuple) else ()
        if not names or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
            raise ProgramError(
                f'part: belt is {shown(belt)}, but must be a name or a list of different names'
            )
        return names

    def slot(self, belt: str, pitch_m: float, across_m: float = 0.0) -> QueuedPart:
        """Return the next free slot on a belt for placing a part.

        Parameters
        ----------
        belt
            Name of the belt.
        pitch_m
            Minimum distance from the preceding slot [m].
        across_m
            Offset from the centre line of the belt, positive to the left [m].

        """
        with self._errors_at(of_caller()):
            self._count()
            tracking, n = self._belt(belt)
            return self._parts[n].slot(pitch_m, across_m, self._window(tracking, n))

    def belt(self, belt: str) -> BeltState:
        """Return the state of a belt: travel, speed, waiting parts; takes no bus time."""
        with self._errors_at(of_caller()):
            self._count()
            _, n = self._belt(belt)
            return self._parts[n].now()

    def _belt(self, name: str) -> tuple[BeltKnowledge, int]:
        tracking = self._link.tracking
        names = () if tracking is None else tuple(belt.name for belt in tracking.belts)
        if tracking is None or name not in names:
            known = ', '.join(names) or 'none'
            raise ProgramError(f'unknown belt {shown(name)}, the belts are: {known}{nearest_of(name, names)}')
        return tracking, names.index(name)

    @staticmethod
    def _window(tracking: BeltKnowledge, n: int) -> TrackWindow:
        belt = tracking.belts[n]
        if belt.window is None:
            raise ProgramError(
                f'belt {belt.name} has no window_m in the cell file, which work on a belt requires'
            )
        return belt.window


def _require_camera(tracking: BeltKnowledge, n: int) -> None:
    """Raise RefusedError if the camera of a belt has failed."""
    blind_m = tracking.blind_m(n)
    if blind_m > 0.0:
        raise belt_error(
            f'part: the camera of belt {tracking.belts[n].name} is dead: no picture for {blind_m:.2f} m of belt travel'
        )


def _require_detectable(kind: str, belt: BeltAxes) -> None:
    """Raise ProgramError for a type of parts that does not exist or that the belt cannot detect."""
    if not belt.camera_every_m:
        raise ProgramError(f'part: belt {belt.name} has no camera to detect the kind of a part')
    if kind not in belt.types:
        known = ', '.join(belt.types)
        raise ProgramError(
            f'part: unknown kind {shown(kind)}, the parts of the cell are: {known}{nearest_of(kind, belt.types)}'
        )
