"""Robot interface for scripts that work on belts."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from delta3_pacdrive.belts.queue import QueuedPart
from delta3_pacdrive.errors import Code, ProgramError, ScriptError, shown
from delta3_pacdrive.planning.program.frames import Frame
from delta3_pacdrive.planning.program.model import Statement
from delta3_pacdrive.scripting.belt_block import Block, belt_error, limits_of, require_fine
from delta3_pacdrive.scripting.belt_orders import BeltOrders
from delta3_pacdrive.scripting.link import Link, StoppedError
from delta3_pacdrive.scripting.parts_robot import PartsRobot
from delta3_pacdrive.scripting.source_position import ScriptPlace, of_caller


class BeltRobot(PartsRobot):
    """A robot controlled by a script, with belts."""

    def __init__(self, link: Link, name: str) -> None:
        self._work = BeltOrders(link, name)
        super().__init__(link, name, self._work)

    # calls ------------------------------------------------------------------------------------------------------------

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
            block = Block(n, part, window, limits, timeout_s, place)
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
        block, tracking = self._work.block, self._link.tracking
        if block is None or tracking is None:
            return super()._read(kind, keys)
        belt = tracking.belts[block.belt]
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
            tracking = self._link.tracking
            lost = tracking is not None and tracking.lost is not None
            if lost and self._work.block is None and error.code is not Code.FAULT:
                self._work.abort_work()
            raise

    @property
    def _on_belt(self) -> bool:
        return self._work.block is not None
