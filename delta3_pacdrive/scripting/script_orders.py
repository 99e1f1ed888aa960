"""Orders of a script: batches of statements and motion profile changes, each for a future bus cycle."""

import math
from collections.abc import Callable
from dataclasses import replace

from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.operation.script_operations import Snapshot
from delta3_pacdrive.control.operation.wait_condition import WaitCondition
from delta3_pacdrive.errors import Code, RefusedError
from delta3_pacdrive.planning.execution import OVERRIDE_MIN
from delta3_pacdrive.planning.resume import resume
from delta3_pacdrive.scripting.arguments import TIME_MAX_S, script_error
from delta3_pacdrive.scripting.link import Link
from delta3_pacdrive.scripting.moves import Moves, Start, Written

BATCH_MAX = 100  # statements planned together
AHEAD_S = 1.0  # maximum remaining motion when a full batch is appended
TRIES_MAX = 5  # attempts for an order that is late on a bus with a clock


class ScriptOrders:
    """The orders of one script.

    A decision is based on the AT of one bus cycle. Its order takes effect a fixed number of cycles later
    (``decision_cycles`` of the parameters).
    """

    def __init__(self, link: Link, name: str) -> None:
        self._link, self.parameters = link, link.parameters
        self.moves = Moves(name, link.parameters)
        self.batch: list[Written] = []  # queued, not yet planned
        self.effect = link.poll().cycle  # bus cycle in which the latest order takes effect
        self.late, self.late_cycles = 0, 0  # late decisions, and their maximum delay

    def cycles_of(self, time_s: float) -> int:
        """Return the number of bus cycles that cover a time [s]."""
        return math.ceil(time_s / self.parameters.bus.cycle_time_s - 1e-9)

    # state ------------------------------------------------------------------------------------------------------------

    @property
    def held(self) -> bool:
        """Whether the robot is held on its path, or a hold is ordered."""
        timeline = self.moves.timeline
        return timeline is not None and timeline.profile is not None and timeline.profile.held

    def seen(self) -> Snapshot:
        """Return the latest state; record the end of a finished program."""
        seen = self._link.poll()
        if seen.motion is MotionState.IDLE:
            self.moves.end()
        return seen

    def ready(self) -> Snapshot:
        """Wait until the preceding order has taken effect, and return the state."""
        self.go_to(self.effect)
        return self.seen()

    # waits ------------------------------------------------------------------------------------------------------------

    def go_to(self, cycle: int) -> None:
        """Run the bus to a cycle."""
        self._link.wait(WaitCondition(cycle, cycle))

    def wait_for(self, condition: WaitCondition) -> bool:
        """Run the bus until a condition is met or its latest cycle has passed; return whether it is met."""
        cycles = self.parameters.in_position_cycles
        return self._link.wait(replace(condition, in_position_cycles=cycles))

    def wait_for_moves(self, left_cycles: int) -> None:
        """Run the bus until all moves have finished or at most ``left_cycles`` of them remain."""
        self.wait_for(WaitCondition(self.effect, self._latest(), left_cycles=left_cycles))

    def finish_motion(self) -> None:
        """Run the bus until all motion has finished."""
        if self.held:
            raise script_error(Code.STATE, 'the robot is held, so its moves cannot finish: resume it first')
        self._link.wait(WaitCondition(self.effect, self._latest(), over=True))
        self.seen()

    def _latest(self) -> int:
        """Return the latest bus cycle of a wait for moves."""
        timeline = self.moves.timeline
        late_s = TIME_MAX_S if timeline is None else TIME_MAX_S + timeline.plan.duration_s / OVERRIDE_MIN
        return self._link.poll().cycle + round(late_s / self.parameters.bus.cycle_time_s)

    # moves ------------------------------------------------------------------------------------------------------------

    def order(self) -> None:
        """Plan and send the queued statements."""
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
        rest_cycle = timeline.end_cycle if timeline is not None and self.held else 0

        def order(late: int) -> int:
            now = self.seen()
            moves = self.moves.copy()
            cycle = max(seen.cycle + self.parameters.decision_cycles, rest_cycle)
            if moves.timeline is not None:  # a robot at rest starts as early as possible
                cycle += late
            ordered = moves.order(self._on_time(batch, cycle), cycle, now.planned_m, now.turns_rad)
            if isinstance(ordered, Start):
                effect = self._link.start(ordered.planned, ordered.cycle, ordered.override)
                if effect != cycle:
                    moves.start_later(ordered, effect)
            else:
                effect = self._link.extend(ordered)
            self.moves = moves
            return effect

        self._take_effect(self._in_time(order, seen.cycle), seen.cycle, rest_cycle)

    def _on_time(self, batch: list[Written], cycle: int) -> list[Written]:
        """Return the statements for an order that takes effect in a bus cycle."""
        return batch

    def _in_time(self, order: Callable[[int], int], decided: int) -> int:
        """Send an order that was decided in a bus cycle; return the cycle in which it takes effect.

        On a bus with a clock, an order that is late, or whose program has ended meanwhile, is repeated for a later
        cycle.
        """
        late = self._link.extra_cycles
        for _ in range(TRIES_MAX - 1 if late else 0):
            try:
                return order(late)
            except RefusedError as error:
                if error.reason.code not in (Code.LATE, Code.STATE):
                    raise
            late = max(self._link.poll().cycle - decided, 0) + self._link.extra_cycles
        return order(late)

    def _take_effect(self, effect: int, decided: int, rest_cycle: int = 0) -> None:
        """Record the bus cycle in which the latest order takes effect, and its delay."""
        self.effect = effect
        late = effect - max(decided + self.parameters.decision_cycles, rest_cycle)
        if late > 0:
            self.late += 1
            self.late_cycles = max(self.late_cycles, late)

    # motion profiles --------------------------------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop on the path, unless the robot is held already."""
        seen = self.ready()
        if self.moves.timeline is None:
            raise script_error(Code.STATE, f'hold: {motion_sentence(seen.motion)}')
        if self.held:
            return
        profile = self._link.hold(seen.cycle + self.parameters.decision_cycles)
        self.moves.follow(profile)
        self.effect = profile.cycle

    def require_override(self, override: float) -> None:
        """Reject an override (1 = as planned) that exceeds a limit of the motion; raises ProgramError."""
        self.moves.require_override(override)

    def change(self, override: float) -> None:
        """Continue with an override, 1 = as planned, also after ``hold``."""
        seen = self.ready()
        timeline = self.moves.timeline
        if timeline is None:
            return
        held = self.held
        if held:
            self.go_to(timeline.end_cycle)  # a running robot resumes from rest only
            self._come_to_rest()
            seen = self.seen()
        cycle = seen.cycle + self.parameters.decision_cycles
        if held:
            cycle = max(cycle, timeline.end_cycle)
        elif cycle >= timeline.end_cycle:
            return  # applies to the next program
        rest_cycle = self._resume_cycle(cycle) if held else 0

        def change(late: int) -> int:
            self.seen()
            if self.moves.timeline is None:
                return seen.cycle  # finished meanwhile: applies to the next program
            profile = resume(timeline, self._return_to_belt(cycle + late) if held else cycle + late, override)
            effect = self._link.change(profile)
            self.moves.follow(replace(profile, cycle=effect))
            return effect

        self._take_effect(self._in_time(change, seen.cycle), seen.cycle, rest_cycle)

    def _come_to_rest(self) -> None:
        """Run the bus until a held robot is at rest."""

    def _resume_cycle(self, cycle: int) -> int:
        """Return the bus cycle in which the plan continues if a held robot starts to move in ``cycle``."""
        return cycle

    def _return_to_belt(self, cycle: int) -> int:
        """Start the return to the belt in a bus cycle; return the cycle in which the plan continues."""
        return self._resume_cycle(cycle)

    # the end ----------------------------------------------------------------------------------------------------------

    def finish(self) -> None:
        """Send the queued moves and run the bus until all motion has finished."""
        self.order()
        self.finish_motion()

    def abort(self) -> int:
        """Clear the queue and stop on the path; return the bus cycle from which the robot is at rest.

        Returns -1 if no motion was active.
        """
        self.batch.clear()
        seen = self.ready()
        if self.moves.timeline is None:
            return -1
        if not self.held:
            self.moves.follow(self._link.hold(seen.cycle + self.parameters.decision_cycles))
        rest_cycle = self.moves.timeline.end_cycle
        self.go_to(rest_cycle + self.parameters.in_position_cycles)
        return rest_cycle
