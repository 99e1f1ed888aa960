"""Execution of a plan: position of the virtual master in each bus cycle under start, hold, resume and override.

A motion profile defines the master from one bus cycle on: a table of phases for the remainder of a move (empty at the
start of a plan), then the following moves at an override (1 = as planned). Holding is a motion profile whose table ends
at standstill on the path. Planner and transformation task evaluate the same motion profiles, so that both know the
master in every cycle. The profile is published as ``motion/course``.

Arguments of the kernel here:

``time``
    Bus time since the start of the motion profile [s].
``number``
    Number of the current move or an earlier one.
``timeline``
    A ``TimelineArrays``.
"""

import copy
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths.move import Move, check_phases
from delta3_pacdrive.planning.paths.rotations import are_joined
from delta3_pacdrive.planning.paths.virtual_master import (
    PHASE_COLUMNS,
    compared_speeds,
    master_at,
    phases_to_rest,
    remainder,
)
from delta3_pacdrive.planning.plan import PLAN_MAX_S, Plan, Tables, advance_number, plan_master_at
from delta3_pacdrive.robot.sercos.bus_time import NEVER

OVERRIDE_MIN, OVERRIDE_MAX = 0.01, 1.5
JOINED = (
    1e-6  # largest jump of distance [m], speed [m/s] and, times a bus cycle, acceleration at a profile change
)
HARD_RISE_S = 2e-3  # time in which a hard stop reaches its deceleration
HARDER, HARDER_MAX = 1.2, 80  # factor by which a stop is shortened until it fits, and maximum number of tries
FASTER = 1e-3  # relative speed by which a stop may exceed the current motion profile at the same position
CYCLE_MAX = 2**53  # larger numbers are not exact as floats
PROFILE_HEADER = 4  # cycle, number of the move, override, held

PROFILE = np.dtype(
    [
        ('cycle', 'i8'),  # first bus cycle
        ('number', 'i8'),  # of the move that the table belongs to; later moves follow as planned
        ('rows', 'i8'),  # of the table
        ('duration', 'f8'),  # of the table [s]
        ('time', 'f8'),  # plan time at the end of the table [s]
        ('override', 'f8'),  # plan time per bus time after the table
        ('held', 'i8'),
    ],
    align=True,
)


class TimelineArrays(NamedTuple):
    """Arrays of a timeline for the compiled code."""

    profile: NDArray[Any]  # one record PROFILE, shape (1,)
    table: Floats  # (n, 5) phases of the motion profile: see virtual_master
    tables: Tables  # the plan


@kernel
def plan_time_at(time, profile):
    """Return the plan time [s] for a bus time after the end of the table of ``profile``, a record ``PROFILE``."""
    return profile.time + profile.override * (time - profile.duration)


@kernel
def profile_at(time, number, timeline):
    """Return move number and master distance, speed, acceleration at a time since the start of the profile [s]."""
    c, table, tables = timeline.profile[0], timeline.table, timeline.tables
    if time < c.duration or c.held == 1:
        s, v, a = master_at(time, table, 0, c.rows)
        return c.number, s, v, a
    plan_time = plan_time_at(time, c)
    number = advance_number(plan_time, max(number, c.number), tables)
    s, v, a = plan_master_at(plan_time, number, tables)
    return number, s, c.override * v, c.override * c.override * a


@dataclass(frozen=True)
class MotionProfile:
    """Motion of the master from a bus cycle on."""

    cycle: int  # first bus cycle
    number: int  # of the current move
    table: Floats  # phases (n, 5) for the remainder of that move, in bus time from 0 on; ends at rest
    override: float = 1.0  # of the following moves, 1 = as planned
    held: bool = False  # whether the master stays at the end of the table

    def to_array(self) -> Floats:
        """Serialize to a row of numbers for a message."""
        header = np.array([self.cycle, self.number, self.override, float(self.held)])
        return np.concatenate([header, self.table.ravel()])

    @staticmethod
    def from_array(values: Any) -> 'MotionProfile':
        """Parse a row of ``to_array``; raises ProgramError."""
        row = np.asarray(values, dtype=np.float64)
        if row.ndim != 1 or len(row) < PROFILE_HEADER + PHASE_COLUMNS or not np.isfinite(row).all():
            raise ProgramError(
                'a motion profile must be a row of finite numbers with a header of 4 and at least one phase'
            )
        if (
            (len(row) - PROFILE_HEADER) % PHASE_COLUMNS
            or (row[:2] != np.floor(row[:2])).any()
            or (row[:2] < 0).any()
        ):
            raise ProgramError(
                'a motion profile must hold whole numbers in its header, and phases of 5 numbers'
            )
        table = row[PROFILE_HEADER:].reshape(-1, PHASE_COLUMNS).copy()
        if not table[-1, 0] <= PLAN_MAX_S or row[0] > CYCLE_MAX:
            raise ProgramError(
                f'a motion profile begins in bus cycle {row[0]:g} and takes {table[-1, 0]:.3g} s, '
                f'the limits are {CYCLE_MAX} and {PLAN_MAX_S:g} s'
            )
        if (np.diff(table[:, 0]) < 0.0).any() or table[0, 0] != 0.0 or table[-1, 2:].any():
            raise ProgramError('a motion profile must begin at time 0, go forward and end at rest')
        if not OVERRIDE_MIN <= row[2] <= OVERRIDE_MAX or row[3] not in (0.0, 1.0):
            raise ProgramError(
                f'a motion profile has an override of {row[2]:g}, '
                f'which must be between {OVERRIDE_MIN} and {OVERRIDE_MAX}'
            )
        check_phases(table, 'motion profile')
        return MotionProfile(int(row[0]), int(row[1]), table, float(row[2]), bool(row[3]))


@dataclass(frozen=True)
class MasterState:
    """Master in one bus cycle: number of the move, distance [m], speed [m/s], acceleration [m/s^2]."""

    number: int
    distance_m: float
    speed_m_s: float
    acceleration_m_s2: float


class Timeline:
    """Plan in bus time: state of the master in each bus cycle under the current motion profile."""

    def __init__(self, plan: Plan, cycle_time_s: float) -> None:
        self.plan = plan
        self.cycle_time_s = cycle_time_s
        self.record: NDArray[Any] = np.zeros(1, PROFILE)
        self.arrays = TimelineArrays(self.record, np.zeros((1, PHASE_COLUMNS)), plan.tables)
        self.profile: MotionProfile | None = None
        self._left_s = 0.0  # remaining plan time of a dwell during which the master was stopped

    def copy(self) -> 'Timeline':
        """Return an independent copy."""
        other = copy.copy(self)
        other.record = self.record.copy()
        other.arrays = self.arrays._replace(profile=other.record)
        return other

    def start(self, cycle: int, override: float = 1.0) -> None:
        """Start the plan at a bus cycle."""
        self._follow(MotionProfile(cycle, 0, np.zeros((1, PHASE_COLUMNS)), override), plan_time_s=0.0)

    @property
    def start_cycle(self) -> int:
        """First bus cycle of the current motion profile; ``NEVER`` before a start."""
        return NEVER if self.profile is None else self.profile.cycle

    def check(self, profile: MotionProfile) -> None:
        """Check that a motion profile continues the current one.

        Raises
        ------
        ProgramError
            It starts before the current one, belongs to another move, makes the master jump, or leaves the move.

        """
        if self.profile is None:
            raise ProgramError('no program runs')
        if profile.cycle < self.profile.cycle or profile.number >= len(self.plan):
            raise ProgramError(f'a motion profile from bus cycle {profile.cycle} on is too late')
        now = self.at(profile.cycle)
        first = profile.table[0]
        move = self.plan.move(profile.number)
        gap = max(
            abs(first[1] - now.distance_m),
            abs(first[2] - now.speed_m_s),
            abs(first[3] - now.acceleration_m_s2) * self.cycle_time_s if np.isfinite(move.stop_jerk) else 0.0,
        )
        if profile.number != now.number or not gap <= JOINED:
            raise ProgramError(
                f'a motion profile from bus cycle {profile.cycle} on does not continue the motion'
            )
        self._check_path(profile)

    def _check_path(self, profile: MotionProfile) -> None:
        """Raise ProgramError if a motion profile leaves its move or does not reach its end."""
        move = self.plan.move(profile.number)
        if not -JOINED <= profile.table[:, 1].min() <= profile.table[:, 1].max() <= move.length_m + JOINED:
            raise ProgramError('a motion profile leaves its move')
        if not profile.held and abs(profile.table[-1, 1] - move.length_m) > JOINED:
            raise ProgramError('a motion profile does not reach the end of its move')

    def change(self, profile: MotionProfile) -> None:
        """Switch to another motion profile; raises ProgramError if it does not continue the current one."""
        self.check(profile)
        if profile.held:
            self._left_s = self.left_of_move_s(profile.cycle)
        self._follow(profile, float(self.plan.tables.starts[profile.number + 1]))

    def extended(self, plan: Plan, profile: MotionProfile) -> 'Timeline':
        """Return the timeline that switches to another plan at the start of a motion profile for that plan.

        Raises
        ------
        ProgramError
            No program is running, or position, speed or acceleration of the TCP would jump.

        """
        present = self.profile
        if present is None:
            raise ProgramError('no program runs')
        if profile.cycle <= present.cycle or profile.number >= len(plan) or profile.held != present.held:
            raise ProgramError(f'a plan from bus cycle {profile.cycle} on does not follow the present one')
        if profile.held and profile.cycle < self.end_cycle:
            raise ProgramError('the TCP is not at rest yet')
        now = self.at(profile.cycle)
        before = self.plan.move(now.number)
        after = plan.move(profile.number)
        _, s, v, a, _ = profile.table[0].tolist()
        present_tcp = _tcp_motion(before, now.distance_m, now.speed_m_s, now.acceleration_m_s2)
        next_tcp = _tcp_motion(after, s, v, a)
        jerk_limited = np.isfinite(before.stop_jerk) and np.isfinite(after.stop_jerk)
        scale = np.array([1.0, 1.0, self.cycle_time_s if jerk_limited else 0.0])
        if not np.abs((present_tcp - next_tcp) * scale[:, None]).max() <= JOINED:
            raise ProgramError(f'a plan from bus cycle {profile.cycle} on does not continue the motion')
        if not are_joined(before.turns_rad(now.distance_m), after.turns_rad(s)):
            raise ProgramError(f'a plan from bus cycle {profile.cycle} on does not continue the turn')
        other = Timeline(plan, self.cycle_time_s)
        other._check_path(profile)
        other._left_s = self._left_s
        other._follow(profile, float(plan.tables.starts[profile.number + 1]))
        return other

    def left_of_move_s(self, cycle: int) -> float:
        """Return the remaining plan time of the current move in a bus cycle [s]."""
        record, profile = self.record[0], self.profile
        if profile is None or profile.held:
            return self._left_s
        number = self.at(cycle).number
        elapsed = (cycle - profile.cycle) * self.cycle_time_s - float(record['duration'])
        if elapsed < 0.0:
            return -elapsed * profile.override
        return float(self.plan.tables.starts[number + 1]) - float(record['time']) - profile.override * elapsed

    def rest_of_move(self, cycle: int) -> Floats:
        """Return phases (n, 5) of the remainder of the current move, in bus time from 0 on."""
        record, profile = self.record[0], self.profile
        if profile is None:
            raise ProgramError('no program runs')
        elapsed = (cycle - profile.cycle) * self.cycle_time_s
        if elapsed < float(record['duration']):
            return remainder(profile.table, elapsed, 1.0)
        number = self.at(cycle).number
        time = float(record['time']) + profile.override * (elapsed - float(record['duration']))
        into_move = time - float(self.plan.tables.starts[number])
        return remainder(self.plan.move(number).master, into_move, profile.override)

    def _follow(self, profile: MotionProfile, plan_time_s: float) -> None:
        self.profile = profile
        self.arrays = self.arrays._replace(table=np.ascontiguousarray(profile.table))
        record = self.record[0]
        record['cycle'], record['number'] = profile.cycle, profile.number
        record['rows'], record['duration'] = len(profile.table), profile.table[-1, 0]
        record['time'], record['override'], record['held'] = plan_time_s, profile.override, profile.held

    def at(self, cycle: int) -> MasterState:
        """Return the master in a bus cycle."""
        if self.profile is None:
            raise ProgramError('no program runs')
        time = (cycle - self.profile.cycle) * self.cycle_time_s
        number, s, v, a = profile_at(max(time, 0.0), 0, self.arrays)
        return MasterState(int(number), float(s), float(v), float(a))

    def first_cycle_in(self, number: int) -> int:
        """Return the first bus cycle in which the current move or a later one is executed."""
        if self.profile is None:
            raise ProgramError('no program runs')
        if number <= self.profile.number:
            return self.profile.cycle
        record = self.record[0]
        time = float(record['duration'])
        time += (float(self.plan.tables.starts[number]) - float(record['time'])) / self.profile.override
        cycle = self.profile.cycle + max(math.ceil(time / self.cycle_time_s - 1e-9), 0)
        return cycle if self.at(cycle).number >= number else cycle + 1

    @property
    def end_cycle(self) -> int:
        """First bus cycle in which the master is at rest at the end of plan or stop; ``NEVER`` before a start."""
        if self.profile is None:
            return NEVER
        return self.end_cycle_of(self.profile, float(self.record['time'][0]))

    def end_cycle_of(self, profile: MotionProfile, plan_time_s: float | None = None) -> int:
        """Return the first bus cycle in which the master is at rest under a motion profile."""
        if plan_time_s is None:
            plan_time_s = float(self.plan.tables.starts[profile.number + 1])
        time = float(profile.table[-1, 0])
        if not profile.held:
            time += (self.plan.duration_s - plan_time_s) / profile.override
        return profile.cycle + math.ceil(time / self.cycle_time_s - 1e-9)

    def stop(self, cycle: int, acceleration_m_s2: float = 0.0) -> MotionProfile:
        """Return the motion profile that stops the master on its path, within the limits of the move where possible.

        A larger acceleration is used as given, with the jerk that reaches it within ``HARD_RISE_S``. The stop exceeds
        these limits where the current profile does so too or its move would end earlier: it is never faster than that.
        """
        now = self.at(cycle)
        override = 1.0 if self.profile is None else self.profile.override
        move = self.plan.move(now.number)
        present = self.rest_of_move(cycle)
        room = max(1.0, override)
        acceleration, jerk = move.stop_acceleration * room**2, move.stop_jerk * room**3
        if acceleration_m_s2 > acceleration:
            acceleration, jerk = acceleration_m_s2, max(jerk, acceleration_m_s2 / HARD_RISE_S)
        for harder in range(HARDER_MAX):
            with suppress(ProgramError):  # no stop within these limits
                table = phases_to_rest(
                    now.distance_m, now.speed_m_s, now.acceleration_m_s2, acceleration, jerk
                )
                if never_faster(table, present):
                    break
            if harder == 0:
                acceleration = max(acceleration, float(np.abs(present[:, 3]).max()))
                jerk = max(jerk, float(np.abs(present[:, 4]).max()))
            else:
                acceleration, jerk = acceleration * HARDER**2, jerk * HARDER**3
        else:
            table = present
        # rounding may place the end of a stop slightly beyond the end of the move
        table[:, 1] = np.minimum(table[:, 1], move.length_m)
        return MotionProfile(cycle, now.number, table, override, held=True)


def _tcp_motion(move: Move, s: float, v: float, a: float) -> Floats:
    """Return position, velocity and acceleration of the TCP for a master on a move, shape (3, 3)."""
    place, first, second, _ = move.sample([s])[0]
    return np.stack([place, v * first, a * first + v * v * second])


def never_faster(table: Floats, other: Floats) -> bool:
    """Whether phases never run backwards, end no later than others, and are nowhere faster at the same position."""
    speeds = compared_speeds(table, other)
    if speeds is None or not table[-1, 1] <= other[-1, 1] + JOINED:
        return False
    return bool((speeds[0] <= speeds[1] * (1.0 + FASTER) + FASTER * other[:, 2].max()).all())
