"""Robot interface for scripts that work on belts: parts, free slots, and moves that follow a belt."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

from delta3_pacdrive.belts.knowledge import BeltKnowledge
from delta3_pacdrive.belts.meeting import BeltAxes
from delta3_pacdrive.belts.queue import PartQueue, QueuedPart, Rule
from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import Code, ProgramError, Reason, ScriptError, WaitTimeoutError, shown
from delta3_pacdrive.planning.program.frames import Frame
from delta3_pacdrive.planning.program.model import Statement
from delta3_pacdrive.scripting.arguments import TIMEOUT_S, number
from delta3_pacdrive.scripting.belt_block import Block, belt_error, limits_of, require_fine
from delta3_pacdrive.scripting.belt_orders import BeltOrders
from delta3_pacdrive.scripting.link import Link, StoppedError
from delta3_pacdrive.scripting.robot import Robot
from delta3_pacdrive.scripting.source_position import ScriptPlace, of_caller

MERGE_M = 0.01  # reports closer than this belong to one part
PITCH_MIN_M, PITCH_MAX_M = 1e-3, 10.0
ACROSS_MAX_M = 2.0


@dataclass(frozen=True)
class BeltState:
    """State of a belt from the latest AT; counters start with the script."""

    way_m: float
    speed_m_s: float
    waiting: int  # parts in the queue
    merged: int  # repeated reports of a part
    left: int  # parts that left the window before they were returned
    refused: int  # parts rejected because the queue was full
    bounced: int  # repeated latches of the light barrier
    jumps: int  # jumps of the encoder


class Offer(NamedTuple):
    """The next part of a belt."""

    part: QueuedPart
    left_m: float  # distance to the end of the window
    away_m: float  # distance to the robot along the belt
    waiting: int  # parts in the queue, including this one

    def rank(self, rule: Rule) -> float:
        """Return the sort key for a choice between belts; the smallest one is taken."""
        return {Rule.FIRST_IN: self.left_m, Rule.NEAREST: self.away_m, Rule.BY_LOAD: -self.waiting}[rule]


class BeltParts:
    """The queue of parts and the free slots of one belt."""

    def __init__(self, tracking: BeltKnowledge, belt: int) -> None:
        self._tracking, self._belt = tracking, belt
        self._queue = PartQueue(MERGE_M)
        self._slot_m: float | None = None  # position of the last slot
        self._before = self._counts()  # counters at the start of the script

    def offer(self, window: TrackWindow, robot_m: float, rule: Rule, kind: str) -> Offer | None:
        """Return the next part without removing it from the queue; None if there is none.

        ``robot_m`` is the position of the robot along the belt [m], ``kind`` the type of the part or empty.
        """
        self._update()
        way_m = self._tracking.now(self._belt).way_m
        part = self._queue.next(way_m, window, robot_m, rule, kind)
        if part is None:
            return None
        there = part.along_m + way_m
        return Offer(part, window.end_m - there, abs(there - robot_m), self._queue.waiting(kind))

    def take(self, part: QueuedPart) -> None:
        """Remove an offered part from the queue."""
        self._queue.take(part)

    def slot(self, pitch_m: float, across_m: float, window: TrackWindow) -> QueuedPart:
        """Return the next free slot upstream of the window, at least a pitch [m] after the preceding slot."""
        pitch_m = number('slot: pitch_m', pitch_m, PITCH_MIN_M, PITCH_MAX_M, ' m')
        across_m = number('slot: across_m', across_m, -ACROSS_MAX_M, ACROSS_MAX_M, ' m')
        along = window.begin_m - self._tracking.now(self._belt).way_m
        if self._slot_m is not None:
            along = min(along, self._slot_m - pitch_m)
        self._slot_m = along
        return QueuedPart('', along, across_m, belt=self._tracking.belts[self._belt].name)

    def now(self) -> BeltState:
        """Return the state of the belt."""
        self._update()
        tracking, n, queue = self._tracking, self._belt, self._queue
        there = tracking.now(n)
        counts = (now - before for now, before in zip(self._counts(), self._before, strict=True))
        dropped, bounced, jumps = counts
        refused = queue.refused + dropped
        return BeltState(
            there.way_m,
            there.speed_m_s,
            waiting=len(queue),
            merged=queue.merged,
            left=queue.left,
            refused=refused,
            bounced=bounced,
            jumps=jumps,
        )

    def _counts(self) -> tuple[int, int, int]:
        observed, n = self._tracking.observed, self._belt
        return observed.dropped[n], observed.bounced[n], observed.jumps[n]

    def _update(self) -> None:
        for one in self._tracking.take_parts(self._belt):
            self._queue.add(one)


class BeltRobot(Robot):
    """A robot controlled by a script, with belts."""

    def __init__(self, link: Link, name: str) -> None:
        self._work = BeltOrders(link, name)
        super().__init__(link, name, self._work)
        self._parts = [BeltParts(link.tracking, n) for n in range(len(link.tracking.belts))]

    # parts ------------------------------------------------------------------------------------------------------------

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
        names = tuple(belt.name for belt in tracking.belts)
        if name not in names:
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

    # work on a belt ---------------------------------------------------------------------------------------------------

    def track(
        self, belt: str, part: QueuedPart | None = None, **keys: Any
    ) -> AbstractContextManager[QueuedPart]:
        """Return a context for work on a belt: moves in the block are in the frame of a part and follow it.

        The robot leaves the belt at the end of the block.

        Parameters
        ----------
        belt
            Name of the belt.
        part
            Part from ``part`` or ``slot``; default: the next part.
        keys
            ``speed_m_s``, ``acceleration_m_s2`` (at least 4) and ``jerk_m_s3`` for entering and leaving the belt;
            ``timeout_s`` for the part to reach the window.

        Returns
        -------
        AbstractContextManager
            Yields the part.

        """
        return self._tracked(of_caller(), belt, part, keys)

    @contextmanager
    def _tracked(
        self, place: ScriptPlace, belt: str, part: QueuedPart | None, keys: dict[str, Any]
    ) -> Iterator[QueuedPart]:
        with self._errors_at(place):
            tracking, n = self._belt(belt)
            if (present := self._work.block) is not None:
                raise belt_error(
                    f'track: the robot already works on belt {tracking.belts[present.belt].name}'
                )
            require_fine(tracking.belts[n])
            window, (limits, timeout_s) = self._window(tracking, n), limits_of(keys, self.parameters.motion)
        if part is None:
            part = self.part(belt, timeout_s)
        with self._errors_at(place):
            if not isinstance(part, QueuedPart):
                raise ProgramError(
                    f'track: part is {shown(part)}, but must come from robot.part or robot.slot'
                )
            if part.belt not in ('', belt):
                raise ProgramError(f'track: the part is on belt {part.belt}, not on belt {belt}')
            self._order()
            block = Block(n, part, window, limits, timeout_s=timeout_s, place=place)
            self._work.begin(block)
        try:
            yield part
            with self._errors_at(place):
                self._count()
                self._work.close(block)
        except Exception as error:
            self._work.cancel_work(error)
            raise
        finally:
            self._work.block = None

    # statements on a belt ---------------------------------------------------------------------------------------------

    def _read(self, kind: str, keys: dict[str, Any]) -> Statement:
        block = self._work.block
        if block is None:
            return super()._read(kind, keys)
        belt = self._link.tracking.belts[block.belt]
        if kind == 'joints':
            raise belt_error('joints: arm angles are not possible on a belt')
        origin = belt.place_m(block.reference_m, block.part.across_m)
        part = Frame.turned(origin, yaw_rad=belt.direction_rad, name='belt').in_base
        return self._maker.make(kind, keys, part)

    @contextmanager
    def _errors_at(self, place: ScriptPlace) -> Iterator[None]:
        """Convert errors like the base class; cancel the work if the robot has lost its belt."""
        try:
            with super()._errors_at(place):
                try:
                    yield
                except StoppedError:
                    if self._work.block is not None:
                        self._work.block.stopped = True
                    raise
        except ScriptError as error:
            lost = self._link.tracking.lost is not None
            if lost and self._work.block is None and error.code is not Code.FAULT:
                self._work.abort_work()
            raise

    @property
    def _on_belt(self) -> bool:
        return self._work.block is not None


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
