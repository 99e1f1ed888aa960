"""Cycle times of a robot, planned or interpolated in tables of plans.

A cycle begins when the robot has released the previous part. The robot moves above the part while it synchronizes with
the belt, moves down, grips, moves up, leaves the belt on its straight path to the place position, and releases. As in a
script, the work on the part is planned for a part in the middle of the window of a stopped belt (``program_planner``),
and synchronization separately (``belt_synchronization``). The cycle time is

    max(on(p), first(y)) + work(y) + max(off(d), back(y)) + release + decisions

with the position p of the part at the start of the cycle, its position d at the end of the work, and its distance y
from the middle of the belt. Each term has one argument and is tabulated.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.belts.meeting import AHEAD_S, transition_off
from delta3_pacdrive.belts.synchronization import ZERO, Motion, TrackLimits, transition_between
from delta3_pacdrive.errors import LineError, ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.studies.fleet.line.design import Line, LineBelt, LineRobot, PartKind

ALONG_STEP_M = 1e-2  # grid spacing along the belt
ACROSS_STEP_M = 5e-3
ACROSS_MIN = 5  # grid points across the belt
BEFORE_M = 0.3  # tables begin this far before the window: a robot starts before the part is in it
Statement = dict[str, object]


class Planned(NamedTuple):
    """Parts of a cycle that depend on the position of the part across the belt [s]."""

    first: float  # from the place position to above the part
    work: float  # down, grip and up
    back: float  # to the place position


@dataclass(frozen=True)
class Station:
    """Robot at a belt with parts of one type."""

    line: Line
    belt: LineBelt
    robot: LineRobot
    kind: PartKind

    @property
    def reference_m(self) -> float:
        """Position of the part in plans, along the belt from the middle of the base: the middle of the window."""
        return 0.5 * (self.robot.window.begin_m + self.robot.window.end_m)

    def planned(self, across_m: float) -> Planned:
        """Plan a cycle for a part at a distance from the middle of the belt; raises LineError."""
        line, robot = self.line, self.robot
        x, y, z = robot.middle_m
        top = [x + self.reference_m, y + across_m, z + self.kind.height_m]
        above, drop = [*top[:2], top[2] + line.above_m], list(robot.place_m)
        output = {'name': 'gripper', 'value': True, 'payload_kg': self.kind.mass_kg}
        held: list[Statement] = [{'output': output}]
        held += [{'dwell': {'time_s': line.grip_s}}] if line.grip_s else []
        work = [_straight(above), _straight(top), *held, _straight(above)]
        on = self._starts(work, drop, 0.0)
        back = self._starts([_straight(drop)], above, self.kind.mass_kg)
        return Planned(on[1], on[-1] - on[1], back[-1])

    def _starts(self, moves: list[Statement], start: list[float], payload_kg: float) -> list[float]:
        limits = self.line.limits
        document = {
            'start_m': start,
            'payload_kg': payload_kg,
            'limits': {
                'speed_m_s': limits.speed_m_s,
                'acceleration_m_s2': limits.acceleration_m_s2,
                'jerk_m_s3': limits.jerk_m_s3,
            },
            'moves': moves,
        }
        robot = self.line.parameters
        try:
            program = program_file.parse(document, robot.motion)
            return [float(t) for t in program_planner.plan(program, start, robot).plan.tables.starts]
        except ProgramError as error:
            raise LineError(f'{self.robot.name} cannot pick {self.kind.name}: {error}') from error

    def cycle_s(self, across_m: float, part_m: float) -> float:
        """Plan a whole cycle and return the time from one start to the next [s]; raises LineError."""
        planned, speed, limits = self.planned(across_m), self.belt.speed_m_s, self.line.limits
        part = part_m - self.reference_m
        picked = max(on_s(part, speed, limits), planned.first) + planned.work
        left = off_s(part + speed * picked, speed, limits)
        return picked + max(left, planned.back) + self.line.release_s + self.line.decision_s


def on_s(part_m: float, speed_m_s: float, limits: TrackLimits) -> float:
    """Return the time to synchronize with a belt [s]; ``part_m`` is relative to the reference, at the start."""
    relative = Motion((-part_m, 0.0, 0.0), (-speed_m_s, 0.0, 0.0))
    return transition_between(relative, Motion(ZERO), limits, speed_m_s).duration_s + AHEAD_S


def off_s(done_m: float, speed_m_s: float, limits: TrackLimits) -> float:
    """Return the time to leave a belt [s]; ``done_m`` is relative to the reference, at the end of the work."""
    return transition_off(Motion((done_m, 0.0, 0.0), (speed_m_s, 0.0, 0.0)), limits).duration_s + AHEAD_S


@lru_cache(maxsize=64)
def _synchronization(
    limits: TrackLimits, speed_m_s: float, low_m: float, high_m: float
) -> tuple[Floats, Floats, Floats]:
    """Return positions relative to the reference [m], and the times to get on and off a belt there [s].

    The cache is shared by robots with windows of the same length.
    """
    along = np.linspace(low_m, high_m, round((high_m - low_m) / ALONG_STEP_M) + 1)
    on = np.array([on_s(float(p), speed_m_s, limits) for p in along])
    return along, on, np.array([off_s(float(p), speed_m_s, limits) for p in along])


def _up(length_m: float) -> float:
    """Round a length up to a multiple of 50 mm."""
    return 0.05 * math.ceil(length_m / 0.05)


class CycleTable:
    """Cycle times of a station from tables; raises LineError if its cycles cannot be planned."""

    def __init__(self, station: Station) -> None:
        belt, window = station.belt, station.robot.window
        self.station, self._speed = station, belt.speed_m_s
        most = station.line.limits.speed_m_s
        tcp_most = station.line.parameters.motion.tcp_speed_limit_m_s
        if self._speed >= most:
            raise LineError(
                f'belt {belt.name} runs at {self._speed:g} m/s, but the limit of its robots is {most:g} m/s'
            )
        if self._speed + most > tcp_most:
            raise LineError(
                f'belt {belt.name} runs at {self._speed:g} m/s and its robots move relative to it at up to {most:g} '
                f'm/s, but motion.tcp_speed_limit_m_s of {station.robot.name} is {tcp_most:g}'
            )
        count = max(ACROSS_MIN, 2 * round(belt.spread_m / ACROSS_STEP_M) + 1) if belt.spread_m else 1
        self._across = np.linspace(-belt.spread_m, belt.spread_m, count)
        self._planned = np.array([station.planned(float(y)) for y in self._across])
        far = self._speed * float(self._planned.sum(axis=1).max())
        half = 0.5 * (window.end_m - window.begin_m)
        low, high = -_up(half + BEFORE_M + far), _up(half + far)
        along, self._on, self._off = _synchronization(station.line.limits, self._speed, low, high)
        self._along = along + station.reference_m
        # position at which a part is met; made monotonic for interpolation
        self._met = np.maximum.accumulate(self._along + self._speed * self._on)

    def _of_across(self, across_m: Floats) -> tuple[Floats, Floats, Floats]:
        first, work, back = (np.interp(across_m, self._across, column) for column in self._planned.T)
        return first, work, back

    def starts_m(self, across_m: Floats) -> tuple[Floats, Floats]:
        """Return the range of part positions in which the robot can start [m]; shapes as given.

        The range is empty (begin > end) if the robot cannot pick the part.
        """
        window, v = self.station.robot.window, self._speed
        first, work, _ = self._of_across(across_m)
        by_belt = np.interp(window.begin_m, self._met, self._along)
        earliest = np.minimum(by_belt, window.begin_m - v * first)
        last_met = window.end_m - v * work
        latest = np.minimum(np.interp(last_met, self._met, self._along), last_met - v * first)
        return earliest, latest

    def cycles_s(self, across_m: Floats, part_m: Floats) -> Floats:
        """Return the times from one start to the next [s]; shapes as given."""
        first, work, back = self._of_across(across_m)
        picked = np.maximum(np.interp(part_m, self._along, self._on), first) + work
        done = part_m + self._speed * picked
        back = np.maximum(np.interp(done, self._along, self._off), back)
        cycles: Floats = picked + back + self.station.line.release_s + self.station.line.decision_s
        return cycles


def _straight(to_m: list[float]) -> Statement:
    return {'move_l': {'to_m': to_m}}
