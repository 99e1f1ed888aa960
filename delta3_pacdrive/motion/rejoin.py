"""Courses that bring the master back to its plan: after a stop, or at another override, without leaving the path."""

import math

import numpy as np
from ruckig import InputParameter, Result, Ruckig, Trajectory

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.motion.master import profile_rows, sample_master
from delta3_pacdrive.motion.plan import Move, MoveKind
from delta3_pacdrive.motion.timeline import Course, Timeline

CANDIDATES = 200  # places of a move at which the plan may be joined
OVER_PLAN = (
    1.0 + 1e-3
)  # how far the speed may exceed that of the plan at the same place, on its sampled course
ROUNDING = 1.0 + 1e-9  # room for ruckig, whose start and target must lie within the limits
END_M = 1e-7  # a master this close to the end of its move is there


def rejoin(timeline: Timeline, cycle: int, rate: float) -> Course:
    """Return a course from a bus cycle on that goes over to the plan at a rate as early as the limits allow.

    Raises
    ------
    ProgramError
        There is no way back to the plan within the limits of the move.

    """
    now = timeline.at(cycle)
    move = timeline.plan.move(now.number)
    if move.kind == MoveKind.DWELL:
        return Course(cycle, now.number, _rest_of_dwell(timeline, cycle, rate), rate)
    if move.length_m - now.distance_m < END_M and now.speed_m_s < END_M:
        return Course(cycle, now.number, np.array([[0.0, move.length_m, 0.0, 0.0, 0.0]]), rate)
    before = timeline.course.rate if timeline.course else 1.0
    room = max(1.0, rate, before)
    for gentle in (1.0, 0.5, 0.25, 0.1):
        table = _join(
            move,
            (now.distance_m, now.speed_m_s, now.acceleration_m_s2),
            rate,
            room,
            (move.stop_acceleration * room**2 * gentle, move.stop_jerk * room**3 * gentle),
        )
        if table is not None:
            return Course(cycle, now.number, table, rate)
    raise ProgramError(f'no way back to the plan from s = {now.distance_m:.4f} m of move {now.number + 1}')


def _rest_of_dwell(timeline: Timeline, cycle: int, rate: float) -> Floats:
    """Phases of what is left of a dwell at another rate."""
    left = max(timeline.left_of_move_s(cycle), 0.0)
    return np.array([[0.0] * 5, [left / rate, 0.0, 0.0, 0.0, 0.0]])


def _join(
    move: Move, state: tuple[float, float, float], rate: float, room: float, limits: tuple[float, float]
) -> Floats | None:
    """Phases from a state (s, v, a) to the earliest place where the plan, at its rate, can be joined; None: nowhere."""
    s0, v0, a0 = state
    times = np.linspace(0.0, move.duration_s, CANDIDATES + 1)
    planned = sample_master(times, move.master)
    planned[-1] = move.length_m, 0.0, 0.0, 0.0
    if move.kind == MoveKind.CUBIC:
        planned[-1, 1] = 1.0
    ahead = np.flatnonzero(planned[:, 0] > s0 + END_M)
    for n in ahead:
        s, v, a = float(planned[n, 0]), float(planned[n, 1]) * rate, float(planned[n, 2]) * rate**2
        # both the start and the target must be possible within the limits of the connection
        acceleration = max(limits[0], abs(a0), abs(a))
        table = _connection(
            (s0, v0, a0), (s, v, a), acceleration, limits[1], room * float(planned[:, 1].max())
        )
        if table is None or not _stays_under(table, times, planned, max(room * OVER_PLAN, rate)):
            continue
        rest = _remainder(move.master, float(times[n]), rate)
        rest[:, 0] += table[-1, 0]
        return np.vstack([table[:-1], rest])
    return None


def _connection(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    acceleration_max: float,
    jerk_max: float,
    speed_max: float,
) -> Floats | None:
    wish = InputParameter(1)
    wish.current_position, wish.current_velocity, wish.current_acceleration = ([value] for value in start)
    wish.target_position, wish.target_velocity, wish.target_acceleration = ([value] for value in end)
    wish.max_velocity = [max(speed_max, start[1], end[1]) * ROUNDING]
    wish.max_acceleration, wish.max_jerk = [acceleration_max * ROUNDING], [jerk_max]
    if not math.isfinite(jerk_max):
        wish.current_acceleration = wish.target_acceleration = [0.0]
    trajectory = Trajectory(1)
    if Ruckig(1).validate_input(wish, False, False) is False:
        return None
    if Ruckig(1).calculate(wish, trajectory) not in (Result.Working, Result.Finished):
        return None
    return profile_rows(trajectory)


def _stays_under(table: Floats, times: Floats, planned: Floats, factor: float) -> bool:
    """Whether the phases never turn back nor exceed the planned speed at the same place."""
    s, v, _, _ = sample_master(np.linspace(0.0, table[-1, 0], 64), table[:, :5])[:-1].T
    allowed = np.interp(s, planned[:, 0], planned[:, 1]) * factor
    return bool((v >= -1e-9).all() and (v <= allowed + 1e-3 * planned[:, 1].max()).all())


def _remainder(master: Floats, time: float, rate: float) -> Floats:
    """Phases of a master from a time on, at a rate, their times from 0 on."""
    row = int(np.searchsorted(master[:, 0], time, side='right')) - 1
    rest = master[row:].copy()
    if row < len(master) - 1:
        s, v, a, j = sample_master([time], master)[0]
        rest[0] = time, s, v, a, j
    rest[:, 0] = (rest[:, 0] - time) / rate
    rest[:, 2:] *= np.array([rate, rate**2, rate**3])
    rest[-1, 2:] = 0.0
    return rest
