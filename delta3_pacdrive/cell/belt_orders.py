"""What a script orders where there are belts: getting on, work that goes with a part, leaving, coming back to it."""

import math
from contextlib import suppress

from delta3_pacdrive.cell.belt_block import STAND_S, Block, Leaving, belt_error, check_block, require_way_out
from delta3_pacdrive.cell.link import Link
from delta3_pacdrive.cell.moves import Written
from delta3_pacdrive.cell.script_orders import ScriptOrders
from delta3_pacdrive.controller.belt_knowledge import BeltKnowledge, TrackOrder
from delta3_pacdrive.controller.motion_state import percent_allowed
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
from delta3_pacdrive.motion.belt_meeting import (
    AHEAD_S,
    Meeting,
    Work,
    first_moved_s,
    meet,
    offset_on,
    require_feasible,
    transition_off,
)
from delta3_pacdrive.motion.belt_prediction import SETTLED_CYCLES
from delta3_pacdrive.motion.belt_synchronization import ZERO, Miss, MissReason, Motion
from delta3_pacdrive.motion.move import TRACK
from delta3_pacdrive.motion.program import Dwell, Output
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.sercos.bus_time import NEVER

LATE_CYCLES = 2  # before the last moment at which work on a belt can follow the moves before it
APART_CYCLES = 2
ABANDON_TRIES = 2
SURE_S = 0.01  # of a wait that is not decided anew
CLOCK_CYCLES = 30  # from a decision about a belt to its order, beside the time that orders take: with a clock


class BeltOrders(ScriptOrders):
    """The orders of one script, with the belts on the bus.

    Parameters
    ----------
    link
        To the robot.
    name
        Of the script.

    Attributes
    ----------
    block
        The work on a belt that the script notes, None beside every belt.

    """

    def __init__(self, link: Link, name: str) -> None:
        super().__init__(link, name)
        self.block: Block | None = None
        self._working: Block | None = None  # the last one
        self._leaving: Leaving | None = None
        self._override_max = math.inf  # with which the TCP keeps its speed limit on the belt
        self._on_belt_cycle: float | None = None  # in which it is to get on, on a bus with a clock

    # work on a belt ---------------------------------------------------------------------------------------------------

    def begin(self, block: Block) -> None:
        """Take what is noted from now on for work on a belt."""
        self.block = self._working = block

    def close(self, block: Block) -> None:
        """Order the rest of the work; the robot leaves the belt behind it."""
        block.closed = True
        if block.begun:
            self.batch.append((Output(TRACK, 0.0), block.place))
        elif not self.batch:
            raise belt_error('track: there is nothing to do on the belt')
        self.order()

    def cancel_work(self, error: Exception) -> None:
        """Give up the work that is noted, for what has happened: the robot stands beside the belt if it was on it."""
        self.batch.clear()
        by_fault = isinstance(error, ScriptError) and error.code is Code.FAULT
        if self.block is not None and self.block.begun and not by_fault:
            self.abort_work()

    def _order_batch(self) -> None:
        block, tracking = self.block, self._link.tracking
        if tracking is None:
            return super()._order_batch()
        self._on_belt_cycle = None
        try:
            if block is None:
                self._delay_until_off_belt(tracking)
            elif block.stopped:
                raise belt_error(
                    'the robot was stopped, and goes with its belt no longer: there is nothing to do there'
                )
            elif not block.begun:
                self._get_on(block, tracking)
            else:
                self._require_later(block, tracking)
        except Delta3Error:
            self.batch.clear()  # what is refused is not ordered later
            raise
        super()._order_batch()
        if block is not None:
            block.begun = True
            if block.closed:
                self._note_leaving(block, tracking, None)
        return None

    def _get_on(self, block: Block, tracking: BeltKnowledge) -> None:
        """Put getting on before what is noted, as soon as the part is near enough."""
        check_block(self.batch, block.closed)
        self.ready()
        if self.held:
            raise belt_error('track: the robot is held: resume it first')
        nearly = self.parameters.decision_cycles + LATE_CYCLES
        self.wait_for_moves(nearly)
        latest = self._link.poll().cycle + self.cycles_of(block.timeout_s)
        backwards = (
            NEVER  # since then; one that has just come to rest is expected for a while to go on braking
        )
        planned: Planned | None = None
        cycle_s = self.parameters.bus.cycle_time_s
        while True:
            seen = self.seen()
            if planned is None:
                batch = block.begun_at(self.moves.plan_end_m or seen.planned_m, self.batch)
                planned = self.moves.preview(batch, seen.planned_m, seen.turn_rad)
                seen = self.seen()  # a clock has gone on
            timeline = self.moves.timeline
            begin = seen.cycle + self.parameters.decision_cycles + self._clock_cycles
            begin = begin if timeline is None else max(begin, timeline.end_cycle)
            found = self._meeting(block, tracking, planned, begin)
            if isinstance(found, Meeting) and found.wait_s <= SURE_S:
                break
            reason = found.reason if isinstance(found, Miss) else None
            backwards = min(backwards, seen.cycle) if reason is MissReason.BACKWARDS else NEVER
            settles = backwards <= seen.cycle < backwards + SETTLED_CYCLES
            if isinstance(found, Miss) and reason is not MissReason.NOT_COMING and not settles:
                raise belt_error(f'belt {tracking.belts[block.belt].name}: {found.sentence}')
            if seen.cycle >= latest:
                why = found.sentence if isinstance(found, Miss) else 'the part has not come to the window'
                raise WaitTimeoutError(
                    Reason(Code.TIMEOUT, f'track: {why}: not within {block.timeout_s:g} s')
                )
            wait_s = found.wait_s if isinstance(found, Meeting) else SURE_S
            self.go_to(seen.cycle + max(1, int(0.5 * wait_s / cycle_s)))
        self._require_bearable(planned, found, block, tracking)
        # on a clock nobody knows yet when the order will count: as much of the wait is left then as there is
        self._on_belt_cycle = begin + found.wait_s / cycle_s if self._clock_cycles else None
        rate = self.moves.override
        ahead: list[Written] = []
        # between leaving one belt and getting on the next the controller has to see that the robot leaves
        wait_s = max(found.wait_s, 0.0 if self._leaving is None else APART_CYCLES * cycle_s)
        if wait_s > 0.5 * cycle_s:
            ahead.append((Dwell(wait_s * rate), block.place))
        ahead.append((Output(TRACK, 1.0), block.place))
        if found.pad_s > 0.5 * cycle_s:
            ahead.append((Dwell(found.pad_s * rate), block.place))
        behind = [(Output(TRACK, 0.0), block.place)] if block.closed else []
        self.batch = [*ahead, *batch, *behind]
        met_s = found.pad_s + block.first_s(planned.plan) / rate
        part_m, reference_m = block.part.along_m, block.reference_m
        self._link.get_on(TrackOrder(block.belt, part_m, reference_m, block.window, block.limits, met_s))

    @property
    def _clock_cycles(self) -> int:
        """How much later an order will count on a bus with a clock, as far as is known; 0 without one."""
        extra = self._link.extra_cycles
        return extra + CLOCK_CYCLES if extra else 0

    def _on_time(self, batch: list[Written], cycle: int) -> list[Written]:
        """Let the robot wait only as long as is left until it is to get on its belt."""
        due, timeline, block = self._on_belt_cycle, self.moves.timeline, self.block
        if due is None or block is None:
            return batch
        begin = cycle if timeline is None else max(cycle, timeline.end_cycle)
        wait_s = (due - begin) * self.parameters.bus.cycle_time_s
        on = next(n for n, (one, _) in enumerate(batch) if isinstance(one, Output) and one.name == TRACK)
        waits = [(Dwell(wait_s * self.moves.override), block.place)] if wait_s > 0.0 else []
        return [*waits, *batch[on:]]

    def _meeting(self, block: Block, tracking: BeltKnowledge, planned: Planned, begin: int) -> Meeting | Miss:
        rate, there = self.moves.override, tracking.expected(block.belt, begin)
        work = Work(block.first_s(planned.plan) / rate, planned.plan.duration_s / rate)
        offset = tracking.belts[block.belt].of_base(self._offset_at(tracking, begin))
        return meet(
            block.part.along_m + there.way_m,
            there.speed_m_s,
            offset,
            work,
            block.reference_m,
            block.window,
            block.limits,
        )

    def _offset_at(self, tracking: BeltKnowledge, cycle: float) -> Motion:
        """Return what is added to the plan in a bus cycle, once the robot leaves, or has left, its last belt."""
        last = self._leaving
        if last is None:
            return Motion(ZERO)
        time_s = (cycle - last.cycle) * self.parameters.bus.cycle_time_s
        return tracking.belts[last.belt].to_base(last.way.at(time_s))

    def _require_bearable(
        self, planned: Planned, found: Meeting, block: Block, tracking: BeltKnowledge
    ) -> None:
        belt, rate = tracking.belts[block.belt], self.moves.override
        whole_s = planned.plan.duration_s / rate

        def offset(time_s: float) -> Motion:
            return belt.to_base(offset_on(found, time_s + found.pad_s, block.reference_m))

        self._override_max = require_feasible(
            planned.plan, -found.pad_s, whole_s, offset, self.parameters, rate
        )
        on_it = offset_on(found, whole_s + found.pad_s, block.reference_m)
        require_way_out(planned.plan, block, belt, on_it.place[0], found.speed_m_s, self.parameters, rate)

    def _require_later(self, block: Block, tracking: BeltKnowledge) -> None:
        """Refuse what the robot does not bear on the belt that it is on, at the speed that this has."""
        batch, timeline = self.batch, self.moves.timeline
        stands = all(isinstance(one, Output) for one, _ in batch)
        if timeline is None or self.held or (stands and not block.closed):
            return
        seen = self.ready()
        checked = [(Dwell(STAND_S), block.place)] if stands else batch
        planned, rate = self.moves.preview(checked, seen.planned_m, seen.turn_rad), self.moves.override
        begin = max(seen.cycle + self.parameters.decision_cycles, timeline.end_cycle)
        belt, there = tracking.belts[block.belt], tracking.expected(block.belt, begin)
        begun_m = block.part.along_m + there.way_m - block.reference_m

        def offset(time_s: float) -> Motion:
            along = begun_m + there.speed_m_s * time_s
            return belt.to_base(Motion((along, 0.0, 0.0), (there.speed_m_s, 0.0, 0.0)))

        whole_s = planned.plan.duration_s / rate
        allowed = require_feasible(planned.plan, 0.0, whole_s, offset, self.parameters, rate)
        self._override_max = min(self._override_max, allowed)
        along_m = begun_m + there.speed_m_s * whole_s
        require_way_out(planned.plan, block, belt, along_m, there.speed_m_s, self.parameters, rate)

    def _note_leaving(self, block: Block, tracking: BeltKnowledge, cycle: int | None) -> None:
        """Note when and how the robot will leave the belt, as far as is known."""
        timeline = self.moves.timeline
        if timeline is None:
            return
        end = timeline.end_cycle if cycle is None else cycle
        there = tracking.expected(block.belt, end)
        along = block.part.along_m + there.way_m - block.reference_m
        way = transition_off(Motion((along, 0.0, 0.0), (there.speed_m_s, 0.0, 0.0)), block.limits)
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
        left_s = (self._link.poll().cycle - last.cycle) * self.parameters.bus.cycle_time_s
        return left_s < last.way.duration_s

    def change(self, override: float) -> None:
        """Drive on with an override, 1 = as planned, also after ``hold``."""
        super().change(override)
        block, tracking = self._working, self._link.tracking
        if block is None or tracking is None or not block.closed or self.held:
            return
        # with another speed the plan leaves its belt in another cycle
        leaves = self.moves.leaves_belt_in(self._link.poll().cycle)
        if leaves is not None:
            self._note_leaving(block, tracking, leaves)

    def _delay_until_off_belt(self, tracking: BeltKnowledge) -> None:
        """Let moves behind a belt begin so late that the robot has left it before the first of them ends."""
        last, batch = self._leaving, self.batch
        if last is None or all(isinstance(one, Output) for one, _ in batch):
            return
        seen = self.ready()
        timeline, cycle_s = self.moves.timeline, self.parameters.bus.cycle_time_s
        begin = seen.cycle + self.parameters.decision_cycles
        begin = begin if timeline is None else max(begin, timeline.end_cycle)
        left_s = (last.cycle - begin) * cycle_s + last.way.duration_s + AHEAD_S
        if left_s <= 0.0 or self.held:
            self._leaving = None
            return
        planned, rate = self.moves.preview(batch, seen.planned_m, seen.turn_rad), self.moves.override
        first_s = first_moved_s(planned.plan) / rate
        pad_s = max(left_s - first_s, 0.0)
        if pad_s > 0.5 * cycle_s:
            self.batch = [(Dwell(pad_s * rate), batch[0][1]), *batch]

        def offset(time_s: float) -> Motion:
            return self._offset_at(tracking, begin + (time_s + pad_s) / cycle_s)

        allowed = require_feasible(planned.plan, -pad_s, first_s, offset, self.parameters, rate)
        self._override_max = min(self._override_max, allowed)

    def _come_to_rest(self) -> None:
        tracking = self._link.tracking
        if tracking is not None:
            self.go_to(tracking.rest_cycle)  # from where it gets on again is known once it stands

    def _resume_cycle(self, cycle: int) -> int:
        tracking, block = self._link.tracking, self._working
        if tracking is None or tracking.free:
            return cycle
        continues = cycle + math.ceil(tracking.back_s(cycle) / self.parameters.bus.cycle_time_s)
        if block is not None and tracking.works:
            there = tracking.expected(block.belt, continues)
            done = block.part.along_m + there.way_m + there.speed_m_s * self._left_on_belt_s(cycle)
            if done > block.window.end_m:
                raise belt_error(
                    f'resume: the part would be done with at {1e3 * done:.1f} mm of belt '
                    f'{tracking.belts[block.belt].name}, but the window ends at {1e3 * block.window.end_m:.1f} mm'
                )
        return continues

    def _left_on_belt_s(self, cycle: int) -> float:
        return self.moves.left_on_belt_s(cycle) / self.moves.override

    def _return_to_belt(self, cycle: int) -> int:
        continues, tracking, block = self._resume_cycle(cycle), self._link.tracking, self._working
        if tracking is None or tracking.free:
            return continues
        left_s = self._left_on_belt_s(cycle)
        if block is not None and tracking.works and left_s > 0.0:
            self._note_leaving(block, tracking, continues + int(left_s / self.parameters.bus.cycle_time_s))
        self._link.get_on_again(cycle)
        return continues

    # giving up --------------------------------------------------------------------------------------------------------

    def abort_work(self) -> None:
        """Give up work on a belt, and all that is noted: the robot stands beside the belt."""
        self.batch.clear()
        self.block = self._leaving = None
        for _ in range(ABANDON_TRIES):
            with suppress(RefusedError):  # somebody has stopped the robot meanwhile, or taken control of it
                try:
                    seen = self._link.poll()
                    self._link.abandon(max(self.effect, seen.cycle + self.parameters.decision_cycles))
                    seen = self._link.poll()
                except RunError:
                    return  # a fault has stopped the robot meanwhile
                self.moves.clear(seen.payload_kg)
                self.effect = seen.cycle
                return

    def finish(self) -> None:
        """Order what is noted, and let the bus go on until nothing is under way and the robot has left its belt."""
        super().finish()
        tracking, last = self._link.tracking, self._leaving
        if tracking is None or last is None:
            return
        now = self._link.poll().cycle
        latest = (
            now
            + int(last.way.duration_s / self.parameters.bus.cycle_time_s)
            + self.parameters.decision_cycles
        )
        while not tracking.free and now < latest:
            self.go_to(now + 1)
            now = self._link.poll().cycle
        self.go_to(now + self.parameters.in_position_cycles)

    def abort(self) -> int:
        """Drop what is noted, stop on the path or on the belt, and let the bus go on until the robot stands."""
        tracking = self._link.tracking
        if tracking is None or tracking.free:
            return super().abort()
        self.abort_work()
        return self._link.poll().cycle
