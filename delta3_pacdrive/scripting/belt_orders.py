"""Orders of a script with belts: entering a belt, work in the frame of a part, leaving, resuming after a hold."""

import math
from contextlib import suppress

from delta3_pacdrive.belts.knowledge import TrackOrder
from delta3_pacdrive.belts.meeting import (
    AHEAD_S,
    Meeting,
    Work,
    first_moved_s,
    meet,
    offset_on,
    require_feasible,
    transition_off,
)
from delta3_pacdrive.belts.prediction import SETTLED_CYCLES
from delta3_pacdrive.belts.synchronization import ZERO, Miss, MissReason, Motion
from delta3_pacdrive.control.motion_state import percent_allowed
from delta3_pacdrive.errors import (
    Code,
    Delta3Error,
    ProgramError,
    Reason,
    RefusedError,
    RunError,
    ScriptError,
    WaitTimeoutError,
)
from delta3_pacdrive.planning.paths.move import TRACK
from delta3_pacdrive.planning.program.model import Dwell, Output
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.scripting.belt_block import (
    DWELL_S,
    Block,
    Leaving,
    belt_error,
    check_block,
    require_way_out,
)
from delta3_pacdrive.scripting.link import Link
from delta3_pacdrive.scripting.moves import Written
from delta3_pacdrive.scripting.script_orders import ScriptOrders

LATE_CYCLES = 2  # margin before the last cycle in which work on a belt can follow the preceding moves
APART_CYCLES = 2
CANCEL_TRIES = 2
SURE_S = 0.01  # a shorter wait for a part is not decided again
CLOCK_CYCLES = 30  # from a belt decision to its order with a clock, in addition to the time of the order


class BeltOrders(ScriptOrders):
    """The orders of one script with belts."""

    def __init__(self, link: Link, name: str) -> None:
        super().__init__(link, name)
        self._tracking = link.tracking
        self.block: Block | None = None  # open block of the script; None outside track
        self._working: Block | None = None  # latest block
        self._leaving: Leaving | None = None
        self._override_max = math.inf  # limited by the TCP speed on the belt
        self._on_belt_cycle: float | None = None  # planned cycle to enter the belt, with a clock

    # work on a belt ---------------------------------------------------------------------------------------------------

    def begin(self, block: Block) -> None:
        """Open a block: the following statements are work on a belt."""
        self.block = self._working = block

    def close(self, block: Block) -> None:
        """Close a block: send the remaining work, after which the robot leaves the belt."""
        block.closed = True
        if block.begun:
            self.batch.append((Output(TRACK, 0.0), block.place))
        elif not self.batch:
            raise belt_error('track: the block contains no moves')
        self.order()

    def cancel_work(self, error: Exception) -> None:
        """Cancel the queued work after an error; a robot on the belt stops next to it."""
        self.batch.clear()
        by_fault = isinstance(error, ScriptError) and error.code is Code.FAULT
        if self.block is not None and self.block.begun and not by_fault:
            self.abort_work()

    def _order_batch(self) -> None:
        block, self._on_belt_cycle = self.block, None
        try:
            if block is None:
                self._delay_until_off_belt()
            elif block.stopped:
                raise belt_error('the robot was stopped and no longer moves with its belt')
            elif not block.begun:
                self._get_on(block)
            else:
                self._require_later(block)
        except Delta3Error:
            self.batch.clear()  # do not send rejected statements later
            raise
        super()._order_batch()
        if block is not None:
            block.begun = True
            if block.closed:
                self._note_leaving(block, None)

    def _get_on(self, block: Block) -> None:
        """Wait until the part is close enough, and prepend the entry to the belt to the batch."""
        check_block(self.batch, block.closed)
        self.ready()
        if self.held:
            raise belt_error('track: the robot is held: resume it first')
        nearly = self.parameters.decision_cycles + LATE_CYCLES
        self.wait_for_moves(nearly)
        latest = self._link.poll().cycle + self.cycles_of(block.timeout_s)
        # cycle since which the belt runs backwards; a belt that has just stopped is predicted to for a while
        backwards = NEVER
        planned: Planned | None = None
        cycle_s = self._cycle_s
        while True:
            seen = self.seen()
            if planned is None:
                batch = block.begun_at(self.moves.plan_end_m or seen.planned_m, self.batch)
                planned = self.moves.preview(batch, seen.planned_m, seen.turns_rad)
                seen = self.seen()  # with a clock, planning has taken bus time
            begin = self._begin_after(seen.cycle + self.parameters.decision_cycles + self._clock_cycles)
            found = self._meeting(block, planned, begin)
            if isinstance(found, Meeting) and found.wait_s <= SURE_S:
                break
            reason = found.reason if isinstance(found, Miss) else None
            backwards = min(backwards, seen.cycle) if reason is MissReason.BACKWARDS else NEVER
            settles = backwards <= seen.cycle < backwards + SETTLED_CYCLES
            if isinstance(found, Miss) and reason is not MissReason.NOT_COMING and not settles:
                raise belt_error(f'belt {self._tracking.belts[block.belt].name}: {found.sentence}')
            if seen.cycle >= latest:
                why = found.sentence if isinstance(found, Miss) else 'the part has not reached the window'
                raise WaitTimeoutError(
                    Reason(Code.TIMEOUT, f'track: {why}: not within {block.timeout_s:g} s')
                )
            wait_s = found.wait_s if isinstance(found, Meeting) else SURE_S
            self.go_to(seen.cycle + max(1, int(0.5 * wait_s / cycle_s)))
        self._require_bearable(planned, found, block)
        # with a clock, the cycle in which the order takes effect is unknown: _on_time shortens the wait
        self._on_belt_cycle = begin + found.wait_s / cycle_s if self._clock_cycles else None
        rate = self.moves.override
        before: list[Written] = []
        # the controller must detect the end of the preceding belt before the next one
        wait_s = max(found.wait_s, 0.0 if self._leaving is None else APART_CYCLES * cycle_s)
        if wait_s > 0.5 * cycle_s:
            before.append((Dwell(wait_s * rate), block.place))
        before.append((Output(TRACK, 1.0), block.place))
        if found.pad_s > 0.5 * cycle_s:
            before.append((Dwell(found.pad_s * rate), block.place))
        after = [(Output(TRACK, 0.0), block.place)] if block.closed else []
        self.batch = [*before, *batch, *after]
        met_s = found.pad_s + block.first_s(planned.plan) / rate
        part_m, reference_m = block.part.along_m, block.reference_m
        self._link.track(
            TrackOrder(
                block.belt,
                part_m,
                reference_m=reference_m,
                window=block.window,
                limits=block.limits,
                met_s=met_s,
            )
        )

    @property
    def _cycle_s(self) -> float:
        return self.parameters.bus.cycle_time_s

    def _begin_after(self, cycle: int) -> int:
        """Return the first bus cycle, not before ``cycle``, after all ordered moves."""
        timeline = self.moves.timeline
        return cycle if timeline is None else max(cycle, timeline.end_cycle)

    @property
    def _clock_cycles(self) -> int:
        """Expected additional delay of an order on a bus with a clock; 0 without a clock."""
        extra = self._link.extra_cycles
        return extra + CLOCK_CYCLES if extra else 0

    def _on_time(self, batch: list[Written], cycle: int) -> list[Written]:
        """Return the batch with the wait shortened to the planned entry of the belt."""
        due, block = self._on_belt_cycle, self.block
        if due is None or block is None:
            return batch
        wait_s = (due - self._begin_after(cycle)) * self._cycle_s
        on = next(n for n, (one, _) in enumerate(batch) if isinstance(one, Output) and one.name == TRACK)
        waits = [(Dwell(wait_s * self.moves.override), block.place)] if wait_s > 0.0 else []
        return [*waits, *batch[on:]]

    def _meeting(self, block: Block, planned: Planned, begin: int) -> Meeting | Miss:
        rate, there = self.moves.override, self._tracking.expected(block.belt, begin)
        work = Work(block.first_s(planned.plan) / rate, planned.plan.duration_s / rate)
        offset = self._tracking.belts[block.belt].of_base(self._offset_at(begin))
        return meet(
            block.part.along_m + there.way_m,
            there.speed_m_s,
            offset=offset,
            work=work,
            reference_m=block.reference_m,
            window=block.window,
            limits=block.limits,
        )

    def _offset_at(self, cycle: float) -> Motion:
        """Return the belt offset in a bus cycle during or after the robot leaves its last belt."""
        last = self._leaving
        if last is None:
            return Motion(ZERO)
        time_s = (cycle - last.cycle) * self._cycle_s
        return self._tracking.belts[last.belt].to_base(last.way.at(time_s))

    def _require_bearable(self, planned: Planned, found: Meeting, block: Block) -> None:
        belt, rate = self._tracking.belts[block.belt], self.moves.override
        whole_s = planned.plan.duration_s / rate

        def offset(time_s: float) -> Motion:
            return belt.to_base(offset_on(found, time_s + found.pad_s, block.reference_m))

        self._override_max = require_feasible(
            planned.plan, -found.pad_s, to_s=whole_s, offset=offset, parameters=self.parameters, rate=rate
        )
        on_it = offset_on(found, whole_s + found.pad_s, block.reference_m)
        require_way_out(
            planned.plan,
            block,
            belt=belt,
            along_m=on_it.place[0],
            speed_m_s=found.speed_m_s,
            parameters=self.parameters,
            rate=rate,
        )

    def _require_later(self, block: Block) -> None:
        """Raise ProgramError if further work exceeds limits at the present belt speed."""
        batch, timeline = self.batch, self.moves.timeline
        only_outputs = all(isinstance(one, Output) for one, _ in batch)
        if timeline is None or self.held or (only_outputs and not block.closed):
            return
        seen = self.ready()
        checked = [(Dwell(DWELL_S), block.place)] if only_outputs else batch
        planned, rate = self.moves.preview(checked, seen.planned_m, seen.turns_rad), self.moves.override
        begin = self._begin_after(seen.cycle + self.parameters.decision_cycles)
        belt, there = self._tracking.belts[block.belt], self._tracking.expected(block.belt, begin)
        begun_m = block.offset_m(there)

        def offset(time_s: float) -> Motion:
            along = begun_m + there.speed_m_s * time_s
            return belt.to_base(Motion((along, 0.0, 0.0), (there.speed_m_s, 0.0, 0.0)))

        whole_s = planned.plan.duration_s / rate
        allowed = require_feasible(
            planned.plan, 0.0, to_s=whole_s, offset=offset, parameters=self.parameters, rate=rate
        )
        self._override_max = min(self._override_max, allowed)
        along_m = begun_m + there.speed_m_s * whole_s
        require_way_out(
            planned.plan,
            block,
            belt=belt,
            along_m=along_m,
            speed_m_s=there.speed_m_s,
            parameters=self.parameters,
            rate=rate,
        )

    def _note_leaving(self, block: Block, cycle: int | None) -> None:
        """Record when and how the robot is expected to leave the belt."""
        timeline = self.moves.timeline
        if timeline is None:
            return
        end = timeline.end_cycle if cycle is None else cycle
        there = self._tracking.expected(block.belt, end)
        on_belt = Motion((block.offset_m(there), 0.0, 0.0), (there.speed_m_s, 0.0, 0.0))
        way = transition_off(on_belt, block.limits)
        self._leaving = Leaving(end, block.belt, way)

    def require_override(self, override: float) -> None:
        """Reject an override (1 = as planned) that exceeds a limit of the motion, alone or together with the belt."""
        super().require_override(override)
        if override > self._override_max and self._moves_with_belt:
            raise ProgramError(
                f'override is {100.0 * override:g} %, but together with the belt the TCP speed limit allows at most '
                f'{percent_allowed(self._override_max)} %'
            )

    @property
    def _moves_with_belt(self) -> bool:
        if self.block is not None:
            return self.block.begun
        last = self._leaving
        if last is None:
            return False
        left_s = (self._link.poll().cycle - last.cycle) * self._cycle_s
        return left_s < last.way.duration_s

    def change(self, override: float) -> None:
        """Continue with an override, 1 = as planned, also after ``hold``."""
        super().change(override)
        block = self._working
        if block is None or not block.closed or self.held:
            return
        # the override changes the cycle in which the plan leaves its belt
        leaves = self.moves.leaves_belt_in(self._link.poll().cycle)
        if leaves is not None:
            self._note_leaving(block, leaves)

    def _delay_until_off_belt(self) -> None:
        """Delay the moves after a belt so that the robot has left it before the first of them ends."""
        last, batch = self._leaving, self.batch
        if last is None or all(isinstance(one, Output) for one, _ in batch):
            return
        seen, cycle_s = self.ready(), self._cycle_s
        begin = self._begin_after(seen.cycle + self.parameters.decision_cycles)
        left_s = (last.cycle - begin) * cycle_s + last.way.duration_s + AHEAD_S
        if left_s <= 0.0 or self.held:
            self._leaving = None
            return
        planned, rate = self.moves.preview(batch, seen.planned_m, seen.turns_rad), self.moves.override
        first_s = first_moved_s(planned.plan) / rate
        pad_s = max(left_s - first_s, 0.0)
        if pad_s > 0.5 * cycle_s:
            self.batch = [(Dwell(pad_s * rate), batch[0][1]), *batch]

        def offset(time_s: float) -> Motion:
            return self._offset_at(begin + (time_s + pad_s) / cycle_s)

        allowed = require_feasible(
            planned.plan, -pad_s, to_s=first_s, offset=offset, parameters=self.parameters, rate=rate
        )
        self._override_max = min(self._override_max, allowed)

    def _come_to_rest(self) -> None:
        if self._tracking.belts:
            self.go_to(self._tracking.rest_cycle)  # the return path starts from rest

    def _resume_cycle(self, cycle: int) -> int:
        tracking, block = self._tracking, self._working
        if tracking.free:
            return cycle
        continues = cycle + math.ceil(tracking.back_s(cycle) / self._cycle_s)
        if block is not None and tracking.works:
            there = tracking.expected(block.belt, continues)
            done = block.part.along_m + there.way_m + there.speed_m_s * self._left_on_belt_s(cycle)
            if done > block.window.end_m:
                raise belt_error(
                    f'resume: the work would end at {1e3 * done:.1f} mm of belt '
                    f'{tracking.belts[block.belt].name}, but the window ends at {1e3 * block.window.end_m:.1f} mm'
                )
        return continues

    def _left_on_belt_s(self, cycle: int) -> float:
        return self.moves.left_on_belt_s(cycle) / self.moves.override

    def _return_to_belt(self, cycle: int) -> int:
        continues, tracking, block = self._resume_cycle(cycle), self._tracking, self._working
        if tracking.free:
            return continues
        left_s = self._left_on_belt_s(cycle)
        if block is not None and tracking.works and left_s > 0.0:
            self._note_leaving(block, continues + int(left_s / self._cycle_s))
        self._link.track_again(cycle)
        return continues

    # end --------------------------------------------------------------------------------------------------------------

    def abort_work(self) -> None:
        """Cancel the work on a belt and clear the queue; the robot stops next to the belt."""
        self.batch.clear()
        self.block = self._leaving = None
        for _ in range(CANCEL_TRIES):
            with suppress(RefusedError):  # another client may have stopped the robot or taken control
                try:
                    seen = self._link.poll()
                    self._link.cancel(max(self.effect, seen.cycle + self.parameters.decision_cycles))
                    seen = self._link.poll()
                except RunError:
                    return  # a fault has stopped the robot
                self.moves.clear(seen.payload_kg)
                self.effect = seen.cycle
                return

    def finish(self) -> None:
        """Send the queued moves and run the bus until all motion has finished and the robot has left its belt."""
        super().finish()
        last = self._leaving
        if last is None:
            return
        now = self._link.poll().cycle
        latest = now + int(last.way.duration_s / self._cycle_s) + self.parameters.decision_cycles
        while not self._tracking.free and now < latest:
            self.go_to(now + 1)
            now = self._link.poll().cycle
        self.go_to(now + self.parameters.in_position_cycles)

    def abort(self) -> int:
        """Clear the queue and stop on the path or on the belt; return the cycle from which the robot is at rest."""
        if self._tracking.free:
            return super().abort()
        self.abort_work()
        return self._link.poll().cycle
