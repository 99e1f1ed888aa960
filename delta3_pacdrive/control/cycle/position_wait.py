"""Waits at exact stops: the program continues once every drive is in position (S-0-0057).

Pure. The plan has a dwell (``MoveKind.IN_POSITION``) after each exact stop. The master rests in it longer than the
timeout, and leaves it a fixed number of bus cycles after the feedback that shows the robot in position, so that the
motion does not depend on the number of outstanding cycles.
"""

import math

import numpy as np

from delta3_pacdrive.control.cycle.stages import Event, Schedule, Stage
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, rotary_axis_parameters
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS, rest
from delta3_pacdrive.robot.sercos.bus_time import NEVER

NONE = -1  # no move


class PositionWait(Stage):
    """Waits of one program after the other at exact stops."""

    def __init__(self, parameters: Parameters, schedule: Schedule) -> None:
        self._schedule = schedule  # Event.EXACT_STOP: the master reaches the next exact stop
        bus, motion = parameters.bus, parameters.motion
        self._cycle_time_s, self._reaction = bus.cycle_time_s, bus.outstanding_cycles_max
        self._cycles, self._timeout_s = parameters.in_position_cycles, motion.in_position_timeout_s
        self._windows_rad = [parameters.drive.position_window_rad] * ARMS
        for number in range(len(parameters.rotary_axes)):
            self._windows_rad.append(rotary_axis_parameters(parameters, number).drive.position_window_rad)
        self._axes = parameters.axes
        self._stops = np.zeros(0, np.int64)  # numbers of the moves
        self._passed = NONE  # last exact stop that was left
        self._resting: MotionProfile | None = None
        self._leaving: MotionProfile | None = None
        # active exact stop as a move number, and first cycle of the wait
        self.number, self.since = NONE, NEVER

    @property
    def waits(self) -> bool:
        """Whether the master rests at an exact stop."""
        return self._resting is not None

    def is_long_enough(self, cycles: int) -> bool:
        """Whether drives that were within their windows for ``cycles`` cycles are in position."""
        return cycles >= self._cycles

    def start(self, timeline: Timeline) -> None:
        """Find the exact stops of the program."""
        self._passed = self.number = NONE
        self._note_stops(timeline)
        self.follow(timeline, '')

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Find the exact stops of an extended plan."""
        self._passed = max(self._passed - left_out, NONE)
        self.number = max(self.number - left_out, NONE)
        self._note_stops(timeline)
        self.follow(timeline, '')

    def clear_program(self, cycle: int, reason: str) -> None:
        """Clear the wait."""
        self._clear()

    def _clear(self) -> None:
        self._resting = self._leaving = None
        self._schedule.cancel(Event.EXACT_STOP)

    def _note_stops(self, timeline: Timeline) -> None:
        waits = np.array([move.kind == MoveKind.IN_POSITION for move in timeline.plan.moves])
        self._stops = np.flatnonzero(waits[timeline.plan.tables.order])

    def follow(self, timeline: Timeline, reason: str) -> None:
        """Schedule the next exact stop of another motion profile."""
        profile = timeline.profile
        if profile is None or profile is self._resting:
            return
        if profile is self._leaving:
            self._passed = profile.number
        self._clear()
        coming = self._stops[self._stops >= max(profile.number, self._passed + 1)]
        if not profile.held and len(coming):
            # a profile that starts at the stop takes effect for a cycle before the next wait, so that it is published
            first = max(timeline.first_cycle_in(int(coming[0])), profile.cycle + 1)
            self._schedule.set(Event.EXACT_STOP, first)

    def rest_at(self, cycle: int, timeline: Timeline) -> MotionProfile:
        """Return the motion profile that rests at the exact stop reached in a bus cycle."""
        number, profile = timeline.at(cycle).number, timeline.profile
        self.number, self.since = number, cycle
        longest_s = self._timeout_s + (self._cycles + 2 * self._reaction) * self._cycle_time_s
        override = 1.0 if profile is None else profile.override
        self._resting = MotionProfile(cycle, number, rest(longest_s), override)
        return self._resting

    def departure(self, cycle: int, timeline: Timeline) -> MotionProfile:
        """Return the motion profile that leaves the exact stop, after the feedback of a bus cycle."""
        override = 1.0 if timeline.profile is None else timeline.profile.override
        planned = math.ceil(timeline.plan.move(self.number).duration_s / override / self._cycle_time_s - 1e-9)
        first = max(cycle + self._reaction, self.since + planned)
        self._leaving = MotionProfile(first, self.number, np.zeros((1, PHASE_COLUMNS)), override)
        return self._leaving

    def fault(self, cycle: int, since: int, where: str, off_rad: Floats, within: int) -> RobotFault | None:
        """Return the fault of a robot that is not in position by a bus cycle, None before the timeout.

        ``off_rad`` are the deviations of all motors from their commands, ``within`` is the number of consecutive
        cycles within their windows.
        """
        waited_s = (cycle - since) * self._cycle_time_s
        if waited_s < self._timeout_s:
            return None
        off = np.abs(off_rad)
        worst = int(np.argmax(np.where(np.isfinite(off), off / self._windows_rad, np.inf)))
        axis, window = self._axes[worst], self._windows_rad[worst]
        sentence = f'not in position {waited_s:.3g} s after the set points came to rest {where}'
        if off[worst] <= window:
            counted = min(within, cycle + 1 - since)
            sentence += (
                f': all drives are within their position windows (S-0-0057) for only {counted} bus cycles, '
                f'{self._cycles} are needed'
            )
            return RobotFault(FaultCode.NOT_IN_POSITION, sentence, cycle=cycle)
        sentence += f': {axis} is {off[worst]:.4g} rad off, the position window (S-0-0057) is '
        sentence += f'{window:g} rad'
        return RobotFault(FaultCode.NOT_IN_POSITION, sentence, axis, cycle=cycle)
