"""Steering on line as a stage of the transformation task: by set points, or towards a plan that may jump.

A steered robot leaves its ``planned`` position by an offset, as on a belt, so that following error, TCP error, torques
and gears are evaluated in the same way. After set points the offset becomes part of the position. A robot that is
smoothed follows its plan within all limits, and the stage ends when the offset has vanished.
"""

import json
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.belts.synchronization import ZERO
from delta3_pacdrive.control.cycle.set_points import REST, Goal, SetPoint, SetPointKind, SetPointStream
from delta3_pacdrive.control.cycle.stages import BeltStage, Stage
from delta3_pacdrive.control.cycle.steering import (
    POSITION,
    STOPPING,
    VELOCITY,
    begin_at,
    begin_stop,
    motion_by_arms,
    servo_record,
    servo_step,
)
from delta3_pacdrive.control.cycle.task_cycle import planned_motion
from delta3_pacdrive.errors import Code, ProgramError, Reason, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import triple
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import HARD_RISE_S, Timeline
from delta3_pacdrive.planning.limits.limits import Limits

MODES = {
    None: STOPPING,
    SetPointKind.VELOCITY: VELOCITY,
    SetPointKind.ARM_SPEEDS: VELOCITY,
    SetPointKind.POSITION: POSITION,
}
CLOSE_M = 1e-7  # offset from which on a smoothed robot is on its plan: less than an increment of the encoders
STANDING_M_S = 1e-5  # lower speeds are standstill
STALLED_S = 0.3  # time at rest before the end of its plan after which a smoothed robot cannot reach it
FASTER = 1.1  # share of the acceleration at the begin of a smoothed motion that its stop may have

JERK_MAX_M_S3 = 1e5  # steps of the acceleration are reached within milliseconds
RANGES = {'speed_m_s': (0.001, 20.0), 'acceleration_m_s2': (0.1, 1e3), 'jerk_m_s3': (1.0, JERK_MAX_M_S3)}


def default_limits(parameters: Parameters) -> Limits:
    """Return the limits of the TCP of a steered robot: those of a move."""
    motion = parameters.motion
    jerk = min(motion.jerk_max_m_s3, JERK_MAX_M_S3)
    return Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, jerk)


def checked_limits(limits: Limits) -> Limits:
    """Return limits of a steered robot; raises ProgramError for one that is out of range."""
    for name, (least, most) in RANGES.items():
        value = getattr(limits, name)
        if not least <= value <= most:
            raise ProgramError(f'{name} of a steered robot is {value:g}, but must be {least:g} to {most:g}')
    return limits


def limits_of(text: str, usual: Limits) -> Limits:
    """Return the limits of a request, JSON with some of them or empty; raises ProgramError."""
    try:
        given = json.loads(text or '{}')
        limits = replace(usual, **{name: float(value) for name, value in given.items()})
    except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        known = ', '.join(RANGES)
        raise ProgramError(f'limits of a steered robot are JSON with {known}, not {shown(text)}') from None
    return checked_limits(limits)


@dataclass(frozen=True)
class Steered:
    """State of a steered robot after a command."""

    active: bool  # whether set points move the robot
    held_back: bool  # whether a limit of the position slows it down
    accepted: int  # set points since the begin
    rejected: int


class Servo(Stage):
    """Steering of the TCP by set points after ``begin``, or towards a plan after ``smooth``; inactive until then.

    ``record`` is the array of one record ``TASK`` of the task; ``changed`` is called at the begin and at the end.
    """

    def __init__(self, parameters: Parameters, record: NDArray[Any], changed: Callable[[], None]) -> None:
        self._parameters, self._task, self._changed = parameters, record, changed
        self._state = record['state']
        self._record = servo_record(parameters, default_limits(parameters))
        self._time = parameters.bus.cycle_time_s
        self._delay = parameters.set_point_delay_cycles
        self._belts: BeltStage | None = None
        self._stream = SetPointStream()
        self.active = False
        self._override = 1.0
        self._timeline: Timeline | None = None  # of the plan that is followed; None: set points
        self._rested = 0  # cycles at rest after the end of the plan, before it is reached
        self.begins = self.rest_cycle = 0  # first cycle of a motion, and first one at rest after a stop
        self._leaving = self._halted = False
        self._scheduled: deque[tuple[int, SetPoint]] = deque()
        self.accepted = self.rejected = 0

    def precompile(self, timeline: Timeline) -> None:
        """Compile and load the calculations of a step, because a bus cycle has no time for it."""
        begin_at(ZERO, ZERO, ZERO, self._record, self._task)
        servo_step(self._record, self._task)
        begin_stop(self._record)
        motion_by_arms(ZERO, self._record, self._task)
        planned_motion(0, self._task, timeline.arrays)

    def begin(self, cycle: int, limits: Limits, belts: BeltStage) -> None:
        """Let set points move the robot, which is at rest, from a future bus cycle on."""
        self._record = servo_record(self._parameters, limits)
        self._record['override'] = self._override
        self._belts, self._timeline = belts, None
        begin_at(triple(self._state['tcp'][0]), ZERO, ZERO, self._record, self._task)
        self._stream.clear()
        self._scheduled.clear()
        self.active, self._leaving, self._halted = True, False, False
        self.begins, self.rest_cycle = cycle, 0
        self.accepted = self.rejected = 0
        self._changed()

    def smooth(self, cycle: int, timeline: Timeline, before: Timeline | None = None) -> None:
        """Follow a plan from a bus cycle on, within all limits; ``before`` is the plan of a robot in motion."""
        if not self.smooths:
            motion = triple(self._state['tcp'][0]), ZERO, ZERO
            if before is not None:
                motion = planned_motion(cycle - 1, self._task, before.arrays)
            limits = default_limits(self._parameters)
            speed = self._parameters.motion.tcp_speed_limit_m_s
            faster = max(limits.acceleration_m_s2, FASTER * math.hypot(*motion[2]))
            self._record = servo_record(
                self._parameters, replace(limits, speed_m_s=speed, acceleration_m_s2=faster)
            )
            begin_at(*motion, self._record, self._task)
        self.active, self._leaving, self._halted = True, False, False
        self.begins, self.rest_cycle, self._rested = cycle, 0, 0
        self._timeline = timeline
        self._changed()

    def set_override(self, override: float) -> None:
        """Scale velocities, and the speed limit of positions, from the next command on; 1 = as commanded."""
        self._override = override
        if not self.smooths:  # a plan contains it
            self._record['override'] = override

    @property
    def smooths(self) -> bool:
        """Whether the robot follows a plan."""
        return self.active and self._timeline is not None

    @property
    def stalled(self) -> bool:
        """Whether a limit keeps the robot from the end of its plan."""
        return self.smooths and self._rested * self._time > STALLED_S

    @property
    def stands(self) -> bool:
        """Whether the last command was at rest."""
        return math.hypot(*self._record['v'][0].tolist()) < STANDING_M_S

    def extend(self, timeline: Timeline, left_out: int) -> None:
        """Follow the extended plan."""
        if self.smooths:
            self._timeline = timeline

    def clear_program(self, cycle: int, reason: str) -> None:
        """Leave a smoothed robot where it is."""
        if self.smooths:
            self.clear()

    def take(self, point: SetPoint, now_s: float) -> Reason | None:
        """Take a set point at a bus time [s]; return why it is rejected, None if it is not."""
        if point.belt < len(self._belts.belts if self._belts else ()):
            reason = self._stream.take(point, now_s)
        else:
            reason = Reason(Code.CONTENT, f'belt number {point.belt} does not exist')
        self.accepted += reason is None
        self.rejected += reason is not None
        return reason

    def schedule(self, cycle: int, point: SetPoint) -> None:
        """Take a set point in a future bus cycle; those of a script come in order."""
        self._scheduled.append((cycle, point))

    def prepare(self, cycle: int) -> None:
        """Set the offset of the command."""
        if self._timeline is not None:
            self._prepare_smoothed(cycle, self._timeline)
            return
        if not self.active:
            return
        while self._scheduled and self._scheduled[0][0] <= cycle:
            self.take(self._scheduled.popleft()[1], cycle * self._time)
        record = self._record[0]
        goal = self._goal(cycle)
        record['mode'] = MODES[goal.kind]
        record['goal'] = goal.position, goal.velocity, goal.acceleration
        at_rest = servo_step(self._record, self._task)
        state = self._state[0]
        state['tracks'] = 1
        state['offset'] = record['p'] - state['planned'], record['v'], record['a']
        if at_rest and self._leaving and cycle >= self.rest_cycle:
            state['tcp'] = record['p']  # the stage of the belts has reset it in this cycle
            self.clear()

    def _prepare_smoothed(self, cycle: int, timeline: Timeline) -> None:
        """Set the offset of the command from the plan, until it has vanished at rest."""
        if cycle < self.begins:
            return
        record, state = self._record[0], self._state[0]
        motion = np.array(planned_motion(cycle, self._task, timeline.arrays))
        if not self._halted:
            record['mode'], record['goal'] = POSITION, motion
        servo_step(self._record, self._task)
        offset = np.array([record['p'], record['v'], record['a']]) - motion
        state['tracks'], state['offset'] = 1, offset
        if cycle < timeline.end_cycle or self._halted:
            return
        if not self.stands:
            self._rested = 0
        elif np.abs(offset[0]).max() > CLOSE_M:
            self._rested += 1
        elif not timeline.record['held'][0]:
            state['tracks'] = 0
            self.active, self._timeline = False, None
            self._changed()
            return
        # the program lasts until the robot is on its plan
        state['end_cycle'] = max(int(state['end_cycle']), cycle + 1)
        self._changed()

    def _goal(self, cycle: int) -> Goal:
        if self._halted or cycle < self.begins:
            return REST
        # the command of this cycle is reached a delay later
        goal = self._stream.goal((cycle + self._delay) * self._time, float(self._record['stop_duration'][0]))
        if goal.kind is SetPointKind.ARM_SPEEDS:
            velocity, acceleration = motion_by_arms(goal.velocity, self._record, self._task)
            return replace(goal, velocity=velocity, acceleration=acceleration)
        if goal.belt < 0 or self._belts is None:
            return goal
        there, belt = self._belts.expected(goal.belt, cycle), self._belts.belts[goal.belt]
        u, v, w = goal.velocity
        return replace(goal, velocity=belt.turned((u + there.speed_m_s, v, w)))

    def halt(self, cycle: int, hard: bool = False, leaves_plan: bool = False) -> None:
        """Come to rest from the command of a bus cycle on and ignore set points; a hard stop replaces a soft one.

        A smoothed robot follows the soft stop of its plan, unless it ``leaves_plan``.
        """
        if not self.active or (not hard and (self._halted or (self.smooths and not leaves_plan))):
            return
        record = self._record[0]
        record['mode'] = STOPPING
        if hard:
            acceleration = max(
                self._parameters.motion.fault_stop_acceleration_m_s2, float(record['acceleration'])
            )
            record['acceleration'], record['jerk'] = acceleration, acceleration / HARD_RISE_S
            begin_stop(self._record)
        self._halted = True
        left_s = float(record['stop_duration'] - record['stop_time'])
        self.rest_cycle = cycle + math.ceil(left_s / self._time)

    def end(self, cycle: int) -> None:
        """Come to rest from the command of a bus cycle on, then leave the robot where it is."""
        self.halt(cycle)
        self._leaving = True

    def clear(self) -> None:
        """Leave the robot at rest where it is."""
        if not self.active:
            return
        self.active, self._timeline = False, None
        self._stream.clear()
        state = self._state[0]
        state['tracks'], state['planned'] = 0, state['tcp']
        self._changed()

    @property
    def velocity_m_s(self) -> Floats:
        """Velocity of the last command."""
        return np.array(self._record['v'][0])

    @property
    def steered(self) -> Steered:
        """State after the last command."""
        held_back = self.active and bool(self._record['held_back'][0])
        active = self.active and not self._halted and not self.smooths
        return Steered(active, held_back, self.accepted, self.rejected)
