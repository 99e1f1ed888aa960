"""Where the virtual master is in each bus cycle of a plan that is started, held, resumed and overridden.

A motion profile is what the master does from one bus cycle on: a table of phases over the rest of a move (none
at the start of a plan), then the following moves at an override (1 = as planned). To hold is a motion profile whose
table ends in standstill on the path. Planner and transformation task follow the same motion profiles, so that both know
the master in every cycle. As a message it is the topic ``motion/course``.

Arguments of the kernel here:

``time``
    Bus time since the motion profile began [s].
``number``
    Number of a move that is driven then or earlier.
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
from delta3_pacdrive.motion.move import Move, check_phases
from delta3_pacdrive.motion.plan import PLAN_MAX_S, Plan, Tables, advance_number, plan_master_at
from delta3_pacdrive.motion.virtual_master import (
    PHASE_COLUMNS,
    master_at,
    remainder,
    speeds_beside,
    way_to_rest,
)
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.sercos.bus_time import NEVER

OVERRIDE_MIN, OVERRIDE_MAX = 0.01, 1.5  # of an override
JOINED = 1e-6  # largest jump in distance [m], speed [m/s] (relative to 1) and, times a cycle, acceleration at a change
HARD_RISE_S = 2e-3  # in which a hard stop reaches its deceleration
HARDER, HARDER_MAX = 1.2, 80  # factor by which a stop is made quicker until it fits, and how often
FASTER = 1e-3  # by which a stop may be faster than the present motion profile at the same place
CYCLE_MAX = 2**53  # beyond it a number in a row is not exact
PROFILE_HEADER = 4  # cycle, number of the move, override, whether it ends held

PROFILE = np.dtype(
    [
        ('cycle', 'i8'),  # bus cycle at which it begins
        ('number', 'i8'),  # of the move that its table belongs to; later moves follow as planned
        ('rows', 'i8'),  # of the table
        ('duration', 'f8'),  # of the table [s]
        ('time', 'f8'),  # of the plan at the end of the table [s]
        ('override', 'f8'),  # plan time per bus time after the table
        ('held', 'i8'),
    ],
    align=True,
)


class TimelineArrays(NamedTuple):
    """The compiled code follows a timeline by these."""

    profile: NDArray[Any]  # one record PROFILE, shape (1,)
    table: Floats  # (n, 5) phases of the motion profile: see virtual_master
    tables: Tables  # the plan


@kernel
def plan_time_at(time, profile):
    """Return the time of the plan [s] that goes with a time behind the table of ``profile``, a record ``PROFILE``."""
    return profile.time + profile.override * (time - profile.duration)


@kernel
def profile_at(time, number, timeline):
    """Return number of the move, master distance, speed, acceleration, at a time since the motion profile began [s]."""
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
    """What the master does from a bus cycle on.

    Attributes
    ----------
    cycle
        Bus cycle at which it begins.
    number
        Number of the move driven then.
    table
        Phases (n, 5) over the rest of that move in bus time, from 0 on; the last row is the end, at rest.
    override
        Override of the moves after it, 1 = as planned.
    held
        Whether the master stays where the table ends.

    """

    cycle: int
    number: int
    table: Floats
    override: float = 1.0
    held: bool = False

    def to_array(self) -> Floats:
        """Return the motion profile as a row of numbers (for a message)."""
        header = np.array([self.cycle, self.number, self.override, float(self.held)])
        return np.concatenate([header, self.table.ravel()])

    @staticmethod
    def from_array(values: Any) -> 'MotionProfile':
        """Read back what ``to_array`` wrote; raises ProgramError."""
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
    """The master in one bus cycle: number of the move, distance [m], speed [m/s], acceleration [m/s^2]."""

    number: int
    distance_m: float
    speed_m_s: float
    acceleration_m_s2: float


class Timeline:
    """Where the master of one plan is in each bus cycle, as its motion profile has it."""

    def __init__(self, plan: Plan, cycle_time_s: float) -> None:
        self.plan = plan
        self.cycle_time_s = cycle_time_s
        self.record: NDArray[Any] = np.zeros(1, PROFILE)
        self.arrays = TimelineArrays(self.record, np.zeros((1, PHASE_COLUMNS)), plan.tables)
        self.profile: MotionProfile | None = None
        self._left_s = 0.0  # plan time left of a dwell in which the master was stopped

    def copy(self) -> 'Timeline':
        """Return a timeline that goes its own way from here on."""
        other = copy.copy(self)
        other.record = self.record.copy()
        other.arrays = self.arrays._replace(profile=other.record)
        return other

    def start(self, cycle: int, override: float = 1.0) -> None:
        """Drive the plan from its beginning from a bus cycle on."""
        self._follow(MotionProfile(cycle, 0, np.zeros((1, PHASE_COLUMNS)), override), plan_time_s=0.0)

    @property
    def start_cycle(self) -> int:
        """Bus cycle at which the present motion profile began; ``NEVER`` before a start."""
        return NEVER if self.profile is None else self.profile.cycle

    def check(self, profile: MotionProfile) -> None:
        """Refuse a motion profile that does not continue the present one without a jump.

        Raises
        ------
        ProgramError
            It begins before this one, belongs to another move, or would make the master jump or leave the move.

        """
        if self.profile is None:
            raise ProgramError('no program runs')
        if profile.cycle < self.profile.cycle or profile.number >= len(self.plan):
            raise ProgramError(f'a motion profile from bus cycle {profile.cycle} on comes too late')
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
        self._check_way(profile)

    def _check_way(self, profile: MotionProfile) -> None:
        """Refuse a motion profile that leaves its move, or ends nowhere."""
        move = self.plan.move(profile.number)
        if not -JOINED <= profile.table[:, 1].min() <= profile.table[:, 1].max() <= move.length_m + JOINED:
            raise ProgramError('a motion profile leaves its move')
        if not profile.held and abs(profile.table[-1, 1] - move.length_m) > JOINED:
            raise ProgramError('a motion profile does not reach the end of its move')

    def change(self, profile: MotionProfile) -> None:
        """Go over to another motion profile; raises ProgramError if it does not continue the present one."""
        self.check(profile)
        if profile.held:
            self._left_s = self.left_of_move_s(profile.cycle)
        self._follow(profile, float(self.plan.tables.starts[profile.number + 1]))

    def extended(self, plan: Plan, profile: MotionProfile) -> 'Timeline':
        """Return the timeline that goes over to another plan where a motion profile of that plan begins.

        Raises
        ------
        ProgramError
            No program runs, or the TCP would jump, in its place, its speed or its acceleration.

        """
        present = self.profile
        if present is None:
            raise ProgramError('no program runs')
        if profile.cycle <= present.cycle or profile.number >= len(plan) or profile.held != present.held:
            raise ProgramError(f'a plan from bus cycle {profile.cycle} on does not follow the present one')
        if profile.held and profile.cycle < self.end_cycle:
            raise ProgramError('the TCP does not stand yet')
        now = self.at(profile.cycle)
        before = self.plan.move(now.number)
        after = plan.move(profile.number)
        _, s, v, a, _ = profile.table[0].tolist()
        here = _tcp_motion(before, now.distance_m, now.speed_m_s, now.acceleration_m_s2)
        there = _tcp_motion(after, s, v, a)
        jerk_limited = np.isfinite(before.stop_jerk) and np.isfinite(after.stop_jerk)
        scale = np.array([1.0, 1.0, self.cycle_time_s if jerk_limited else 0.0])
        if not np.abs((here - there) * scale[:, None]).max() <= JOINED:
            raise ProgramError(f'a plan from bus cycle {profile.cycle} on does not continue the motion')
        turned, turns = before.turn_rad(now.distance_m), after.turn_rad(s)
        if turned is not None and turns is not None and not abs(turned - turns) <= JOINED:
            raise ProgramError(f'a plan from bus cycle {profile.cycle} on does not continue the turn')
        other = Timeline(plan, self.cycle_time_s)
        other._check_way(profile)
        other._left_s = self._left_s
        other._follow(profile, float(plan.tables.starts[profile.number + 1]))
        return other

    def left_of_move_s(self, cycle: int) -> float:
        """Plan time left of the present move in a bus cycle [s]."""
        record, profile = self.record[0], self.profile
        if profile is None or profile.held:
            return self._left_s
        number = self.at(cycle).number
        elapsed = (cycle - profile.cycle) * self.cycle_time_s - float(record['duration'])
        if elapsed < 0.0:
            return -elapsed * profile.override
        return float(self.plan.tables.starts[number + 1]) - float(record['time']) - profile.override * elapsed

    def rest_of_move(self, cycle: int) -> Floats:
        """Phases (n, 5) over what is left of the present move, in bus time from 0 on, as the motion profile has it."""
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
        """Return the master in a bus cycle of the present motion profile."""
        if self.profile is None:
            raise ProgramError('no program runs')
        time = (cycle - self.profile.cycle) * self.cycle_time_s
        number, s, v, a = profile_at(max(time, 0.0), 0, self.arrays)
        return MasterState(int(number), float(s), float(v), float(a))

    def first_cycle_in(self, number: int) -> int:
        """First bus cycle of the present motion profile in which a move to come, or the present one, is driven."""
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
        """First bus cycle in which the master stands at the end of plan or stop; ``NEVER`` before a start."""
        if self.profile is None:
            return NEVER
        return self.end_cycle_of(self.profile, float(self.record['time'][0]))

    def end_cycle_of(self, profile: MotionProfile, plan_time_s: float | None = None) -> int:
        """First bus cycle in which the master stands, if it follows a motion profile."""
        if plan_time_s is None:
            plan_time_s = float(self.plan.tables.starts[profile.number + 1])
        time = float(profile.table[-1, 0])
        if not profile.held:
            time += (self.plan.duration_s - plan_time_s) / profile.override
        return profile.cycle + math.ceil(time / self.cycle_time_s - 1e-9)

    def stop(self, cycle: int, acceleration_m_s2: float = 0.0) -> MotionProfile:
        """Return the motion profile that stops the master on its path, within the limits of the move where possible.

        With an acceleration beyond that of the move it takes that, its jerk rising within ``HARD_RISE_S``. It brakes
        harder where the present motion profile does so too, or its move would end before: it is nowhere faster.
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
            with suppress(ProgramError):  # limits that nobody can brake with
                table = way_to_rest(now.distance_m, now.speed_m_s, now.acceleration_m_s2, acceleration, jerk)
                if never_faster(table, present):
                    break
            if harder == 0:
                acceleration = max(acceleration, float(np.abs(present[:, 3]).max()))
                jerk = max(jerk, float(np.abs(present[:, 4]).max()))
            else:
                acceleration, jerk = acceleration * HARDER**2, jerk * HARDER**3
        else:
            table = present
        # rounding may carry a stop that ends with the move a little beyond it
        table[:, 1] = np.minimum(table[:, 1], move.length_m)
        return MotionProfile(cycle, now.number, table, override, held=True)


def _tcp_motion(move: Move, s: float, v: float, a: float) -> Floats:
    """Place, velocity and acceleration of the TCP for a master on a move, shape (3, 3)."""
    place, first, second, _ = move.sample([s])[0]
    return np.stack([place, v * first, a * first + v * v * second])


def never_faster(table: Floats, other: Floats) -> bool:
    """Whether phases never turn back, end no farther than others, and are nowhere faster at the same place."""
    speeds = speeds_beside(table, other)
    if speeds is None or not table[-1, 1] <= other[-1, 1] + JOINED:
        return False
    return bool((speeds[0] <= speeds[1] * (1.0 + FASTER) + FASTER * other[:, 2].max()).all())
