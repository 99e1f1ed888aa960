"""What a script has noted and ordered, in bus time: planned as a whole, for a bus cycle that is still to come."""

import math
from collections.abc import Callable
from dataclasses import replace

from delta3_pacdrive.cell.link import Link, Seen
from delta3_pacdrive.cell.moves import Moves, Start, Written
from delta3_pacdrive.cell.values import TIME_MAX_S
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, Reason, RefusedError, ScriptError
from delta3_pacdrive.motion.execution import OVERRIDE_MIN
from delta3_pacdrive.motion.resume import resume

BATCH_MAX = 100  # statements that are planned together
AHEAD_S = 1.0  # of motion may be left when a full batch is ordered behind it
TRIES_MAX = 5  # of an order that comes too late on a bus with a clock


class ScriptOrders:
    """The orders of one script.

    An order is decided on the answers of one bus cycle, and takes effect a fixed number of cycles later
    (``decision_cycles`` of the parameters).

    Parameters
    ----------
    link
        To the robot.
    name
        Of the script.

    Attributes
    ----------
    moves
        What is driven.
    batch
        What is noted.
    effect
        Bus cycle in which the newest order takes effect.
    late, late_cycles
        Decisions that have taken effect later than they should, as a bus with a clock waits for nobody; and by how many
        bus cycles at most.

    """

    def __init__(self, link: Link, name: str) -> None:
        self._link, self.parameters = link, link.parameters
        self.moves = Moves(name, link.parameters)
        self.batch: list[Written] = []
        self.effect = link.look().cycle
        self.late, self.late_cycles = 0, 0

    def cycles_of(self, time_s: float) -> int:
        """Return in how many bus cycles a time [s] is over."""
        return math.ceil(time_s / self.parameters.bus.cycle_time_s - 1e-9)

    # what is driven ---------------------------------------------------------------------------------------------------

    @property
    def held(self) -> bool:
        """Whether the robot is held on its path, or will be."""
        timeline = self.moves.timeline
        return timeline is not None and timeline.profile is not None and timeline.profile.held

    def seen(self) -> Seen:
        """Return the newest bus cycle whose answers are evaluated; a program that is over in it is over."""
        seen = self._link.look()
        if seen.motion is MotionState.IDLE:
            self.moves.end()
        return seen

    def ready(self) -> Seen:
        """Return what is seen once the order before has taken effect."""
        self.go_to(self.effect)
        return self.seen()

    # waits ------------------------------------------------------------------------------------------------------------

    def go_to(self, cycle: int) -> None:
        """Let the bus go on to a cycle."""
        self._link.wait(WaitCondition(cycle, cycle))

    def wait_for(self, condition: WaitCondition) -> bool:
        """Let the bus go on until a condition is met or its latest cycle is over; return whether it is met."""
        cycles = self.parameters.in_position_cycles
        return self._link.wait(replace(condition, in_position_cycles=cycles))

    def wait_for_moves(self, left_cycles: int) -> None:
        """Let the bus go on until the robot stands behind all moves, or at most so many bus cycles of them are left."""
        self.wait_for(WaitCondition(self.effect, self._latest(), left_cycles=left_cycles))

    def come_to_the_end(self) -> None:
        """Let the bus go on until nothing is under way."""
        if self.held:
            sentence = 'the robot is held, so that its moves never end: resume it first'
            raise ScriptError(Reason(Code.STATE, sentence))
        self._link.wait(WaitCondition(self.effect, self._latest(), over=True))
        self.seen()

    def _latest(self) -> int:
        """Return the latest bus cycle of a wait for moves, which end by themselves or with a fault."""
        timeline = self.moves.timeline
        late_s = TIME_MAX_S if timeline is None else TIME_MAX_S + timeline.plan.duration_s / OVERRIDE_MIN
        return self._link.look().cycle + round(late_s / self.parameters.bus.cycle_time_s)

    # moves ------------------------------------------------------------------------------------------------------------

    def order(self) -> None:
        """Plan what is noted, and order it."""
        if self.batch:
            self._order_batch()

    def _order_batch(self) -> None:
        batch, self.batch = self.batch, []
        seen = self.ready()
        if len(batch) >= BATCH_MAX and self.moves.seconds_left(seen.cycle) > AHEAD_S and not self.held:
            left = round(AHEAD_S / self.parameters.bus.cycle_time_s)
            self.wait_for_moves(left)
            seen = self.seen()
        timeline = self.moves.timeline
        stands = timeline.end_cycle if timeline is not None and self.held else 0

        def order(late: int) -> int:
            here = self.seen()
            moves = self.moves.copy()
            cycle = max(seen.cycle + self.parameters.decision_cycles, stands)
            if moves.timeline is not None:  # who stands starts as soon as he can
                cycle += late
            ordered = moves.order(self._on_time(batch, cycle), cycle, here.planned_m, here.turn_rad)
            if isinstance(ordered, Start):
                effect = self._link.start(ordered.planned, ordered.cycle, ordered.override)
                if effect != cycle:
                    moves.start_later(ordered, effect)
            else:
                effect = self._link.extend(ordered)
            self.moves = moves
            return effect

        self._take_effect(self._in_time(order, seen.cycle), seen.cycle, stands)

    def _on_time(self, batch: list[Written], cycle: int) -> list[Written]:
        """Return what is ordered if it takes effect in a bus cycle."""
        return batch

    def _in_time(self, order: Callable[[int], int], decided: int) -> int:
        """Give an order that was decided on in a bus cycle; return from which one on it counts.

        On a bus with a clock it may come too late, or the program that it should follow has ended meanwhile. Then it is
        given again, for a later cycle.
        """
        late = self._link.extra_cycles
        for _ in range(TRIES_MAX - 1 if late else 0):
            try:
                return order(late)
            except RefusedError as error:
                if error.reason.code not in (Code.LATE, Code.STATE):
                    raise
            late = max(self._link.look().cycle - decided, 0) + self._link.extra_cycles
        return order(late)

    def _take_effect(self, effect: int, decided: int, stands: int = 0) -> None:
        """Note from which bus cycle on the newest order counts, and whether that is late."""
        self.effect = effect
        late = effect - max(decided + self.parameters.decision_cycles, stands)
        if late > 0:
            self.late += 1
            self.late_cycles = max(self.late_cycles, late)

    # motion profiles --------------------------------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop on the path, unless the robot is held already."""
        seen = self.ready()
        if self.moves.timeline is None:
            raise ScriptError(Reason(Code.STATE, f'hold: {motion_sentence(seen.motion)}'))
        if self.held:
            return
        profile = self._link.hold(seen.cycle + self.parameters.decision_cycles)
        self.moves.follow(profile)
        self.effect = profile.cycle

    def require_override(self, override: float) -> None:
        """Reject an override (1 = as planned) that exceeds a limit of the motion; raises ProgramError."""
        self.moves.require_override(override)

    def change(self, override: float) -> None:
        """Drive on with an override, 1 = as planned, also after ``hold``."""
        seen = self.ready()
        timeline = self.moves.timeline
        if timeline is None:
            return
        held = self.held
        if held:
            self.go_to(timeline.end_cycle)  # on a robot that is up, who stands can go on
            self._come_to_rest()
            seen = self.seen()
        cycle = seen.cycle + self.parameters.decision_cycles
        if held:
            cycle = max(cycle, timeline.end_cycle)
        elif cycle >= timeline.end_cycle:
            return  # for the next program
        stands = self._way_back(cycle) if held else 0

        def change(late: int) -> int:
            self.seen()
            if self.moves.timeline is None:
                return seen.cycle  # over meanwhile: for the next program
            profile = resume(timeline, self._go_back(cycle + late) if held else cycle + late, override)
            effect = self._link.change(profile)
            self.moves.follow(replace(profile, cycle=effect))
            return effect

        self._take_effect(self._in_time(change, seen.cycle), seen.cycle, stands)

    def _come_to_rest(self) -> None:
        """Let the bus go on until a robot stands whose plan was held."""

    def _way_back(self, cycle: int) -> int:
        """Return the bus cycle in which the plan can go on, if a robot that was held begins to move in a cycle."""
        return cycle

    def _go_back(self, cycle: int) -> int:
        """Let the robot begin to move in a cycle if it goes on; return in which one the plan goes on."""
        return self._way_back(cycle)

    # the end ----------------------------------------------------------------------------------------------------------

    def finish(self) -> None:
        """Order what is noted, and let the bus go on until nothing is under way."""
        self.order()
        self.come_to_the_end()

    def give_up(self) -> int:
        """Drop what is noted, stop on the path, and let the bus go on until the robot stands.

        Returns the bus cycle from which on it stands, -1 if nothing was under way.
        """
        self.batch.clear()
        seen = self.ready()
        if self.moves.timeline is None:
            return -1
        if not self.held:
            self.moves.follow(self._link.hold(seen.cycle + self.parameters.decision_cycles))
        stands = self.moves.timeline.end_cycle
        self.go_to(stands + self.parameters.in_position_cycles)
        return stands
