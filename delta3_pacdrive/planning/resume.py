"""Return to a plan after a stop or at another override, and remaining moves of a plan after a fault."""

import math
from dataclasses import replace

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths import profiles
from delta3_pacdrive.planning.paths.move import STANDING, Move
from delta3_pacdrive.planning.paths.profiles import State
from delta3_pacdrive.planning.paths.virtual_master import (
    compared_speeds,
    master_at_distances,
    remainder,
    rest,
    sample_master,
)
from delta3_pacdrive.planning.plan import STANDING_M, Plan
from delta3_pacdrive.planning.program.model import MoveL, Program, Target

CANDIDATES = 200  # positions of a move at which the plan may be joined, evenly spaced in time
CLOSE_S = 1e-3  # time between those just ahead: in a corner of a sequence the speed changes within 25 ms
CLOSE_OVER_S = 0.25  # range of the close positions
OVER_PLAN = 1.0 + 1e-3  # permitted speed relative to the plan at the same position
ROUNDING = 1.0 + 1e-9  # tolerance for ruckig, whose start and target must lie within the limits
END_M = 1e-7  # distance from the end of a move that counts as its end
# delays after which the connection may start; the current motion profile continues until then [s]
DELAYS_S = (0.0, 0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 4.0, 8.0)
GENTLE = (1.0, 0.5, 0.25, 0.1)  # shares of the move's limits tried for a start from standstill


def resume(timeline: Timeline, cycle: int, override: float) -> MotionProfile:
    """Return the motion profile that reaches the plan at an override as early as the limits allow.

    If a moving master cannot do so before the end of its move, the override applies from the next move on.

    Raises
    ------
    ProgramError
        A master at rest cannot return to the plan within the limits of its move.

    """
    now = timeline.at(cycle)
    move = timeline.plan.move(now.number)
    if move.kind in STANDING:
        left = max(timeline.left_of_move_s(cycle), 0.0)
        return MotionProfile(cycle, now.number, rest(left / override), override)
    held = timeline.profile is not None and timeline.profile.held
    if held and move.length_m - now.distance_m < END_M:
        return MotionProfile(cycle, now.number, np.array([[0.0, move.length_m, 0.0, 0.0, 0.0]]), override)
    before = timeline.profile.override if timeline.profile else 1.0
    room = max(1.0, override, before)
    limits = (move.stop_acceleration * room**2, move.stop_jerk * room**3)
    if held:
        # rounding may place the end of a stop slightly after its last cycle
        at_rest = cycle >= timeline.end_cycle
        state = (now.distance_m, 0.0 if at_rest else now.speed_m_s, 0.0 if at_rest else now.acceleration_m_s2)
        for gentle in GENTLE:
            table = _join(move, state, override, room, (limits[0] * gentle, limits[1] * gentle))
            if table is not None:
                return MotionProfile(cycle, now.number, table, override)
        raise ProgramError(
            f'no way back to the plan from s = {now.distance_m:.4f} m of move {now.number + 1}'
        )
    present = timeline.rest_of_move(cycle)
    for delay in DELAYS_S:
        if delay >= present[-1, 0]:
            break
        s, v, a, _ = sample_master([delay], present)[0].tolist()
        table = _join(move, (s, v, a), override, room, limits)
        if table is not None:
            return MotionProfile(cycle, now.number, _after(present, delay, table), override)
    return MotionProfile(cycle, now.number, present, override)


def join_move(timeline: Timeline, cycle: int, move: Move, common_m: float) -> Floats | None:
    """Return phases that lead from the current move to another one with the same path up to a distance [m].

    The master may continue on the current profile for a while, and is nowhere faster than planned for either move.
    None if it is past the common path, or cannot join the other move.
    """
    now, profile = timeline.at(cycle), timeline.profile
    if profile is None or now.distance_m > common_m:
        return None
    if profile.held:
        return np.array([[0.0, now.distance_m, 0.0, 0.0, 0.0]])
    override = profile.override
    room = max(1.0, override)
    before = timeline.plan.move(now.number)
    limits = (
        min(before.stop_acceleration, move.stop_acceleration) * room**2,
        min(before.stop_jerk, move.stop_jerk) * room**3,
    )
    present = timeline.rest_of_move(cycle)
    for delay in DELAYS_S:
        s, v, a, _ = sample_master([min(delay, float(present[-1, 0]))], present)[0].tolist()
        if delay >= present[-1, 0] or s > common_m:
            break
        table = _join(move, (s, v, a), override, room=room, limits=limits, before=(before.master, common_m))
        if table is not None:
            return _after(present, delay, table)
    return None


def _after(present: Floats, delay: float, table: Floats) -> Floats:
    """Return the phases of the current motion profile up to a delay, then those of a table."""
    kept = present[present[:, 0] < delay]
    later = table.copy()
    later[:, 0] += delay
    return np.vstack([kept, later])


def _join(
    move: Move,
    state: State,
    override: float,
    room: float,
    limits: tuple[float, float],
    before: tuple[Floats, float] | None = None,
) -> Floats | None:
    """Return phases from a state (s, v, a) to the first position at which the plan can be joined at an override.

    None if there is none. Up to a distance [m] they may be as fast as another master ``before``.
    """
    s0, v0, _ = state
    times = _candidates(move, s0)
    planned = sample_master(times, move.master)
    planned[-1] = move.length_m, move.master[-1, 2], 0.0, 0.0
    speed_max = room * float(planned[:, 1].max())
    s, v = planned[:, 0], planned[:, 1] * override
    # positions beyond the reach of the largest acceleration need not be tried
    near = np.abs(v**2 - v0**2) <= 2.0 * limits[0] * OVER_PLAN * (s - s0)
    for n in np.flatnonzero((s > s0 + END_M) & near):
        target = (float(s[n]), float(v[n]), float(planned[n, 2]) * override**2)
        table = _connection(state, target, limits, speed_max)
        if table is not None and _stays_under(table, move.master, max(room, override), speed_max, before):
            ahead = remainder(move.master, float(times[n]), override)
            ahead[:, 0] += table[-1, 0]
            return np.vstack([table[:-1], ahead])
    return None


def _candidates(move: Move, distance_m: float) -> Floats:
    """Return times of a move at which it may be joined from a distance on it, closely spaced just ahead."""
    times = np.linspace(0.0, move.duration_s, CANDIDATES + 1)
    if move.duration_s > CANDIDATES * CLOSE_S:
        start = float(master_at_distances([distance_m], move.master)[0, 0])
        ahead = start + np.arange(CLOSE_S, CLOSE_OVER_S, CLOSE_S)
        times = np.union1d(times, ahead[ahead < move.duration_s])
    return times


def _connection(start: State, end: State, limits: tuple[float, float], speed_max: float) -> Floats | None:
    """Return phases from state to state; None if there are none within the limits."""
    acceleration_max, jerk_max = limits
    if not math.isfinite(jerk_max):
        start, end = (*start[:2], 0.0), (*end[:2], 0.0)
    acceleration_max = max(acceleration_max, abs(start[2]), abs(end[2]))
    most = (max(speed_max, start[1], end[1]) * ROUNDING, acceleration_max * ROUNDING, jerk_max)
    try:
        return profiles.between(start, end, most)
    except ProgramError:
        return None


def _stays_under(
    table: Floats, master: Floats, factor: float, speed_max: float, before: tuple[Floats, float] | None
) -> bool:
    """Whether phases never run backwards nor exceed the planned speed, times a factor, at the same position."""
    speeds = compared_speeds(table, master)
    if speeds is None:
        return False
    taken, allowed = speeds
    if before is not None and (others := compared_speeds(table, before[0])) is not None:
        s = sample_master(np.linspace(0.0, table[-1, 0], len(taken) + 1), table)[:-1, 0]
        allowed = np.where(s <= before[1], np.maximum(allowed, others[1]), allowed)
    return bool((taken <= allowed * factor * OVER_PLAN + 1e-4 * speed_max).all())


def remaining_plan(timeline: Timeline) -> tuple[Floats, list[Move]]:
    """Return the stopping position of a program on its path [m], and its remaining moves.

    The first of them starts within its path; outputs switched before are not switched again.

    Raises
    ------
    ProgramError
        The program was not stopped, or is complete.

    """
    if timeline.profile is None or not timeline.profile.held:
        raise ProgramError(
            'the stopping position of the program on its path is unknown; it can only be restarted'
        )
    profile = resume(timeline, timeline.end_cycle, 1.0)
    plan, number = timeline.plan, profile.number
    move = plan.move(number)
    later = [plan.move(n) for n in range(number + 1, len(plan))]
    place = float(profile.table[0, 1])
    stopped_m = np.asarray(move.sample([place])[0, 0])
    if len(profile.table) > 1:
        ahead = move.events[move.events[:, 0] > place] if move.kind not in STANDING else move.events
        later.insert(0, replace(move, master=profile.table, events=ahead))
    if not later:
        raise ProgramError('the program was at its end')
    return stopped_m, later


def return_plan(timeline: Timeline, start_m: Floats, parameters: Parameters) -> Plan:
    """Return a plan from the current position straight to the path of a stopped program, then along it.

    Raises
    ------
    ProgramError
        The straight line is not permitted, the program was not stopped, or is complete.

    """
    on_path, moves = remaining_plan(timeline)
    if float(np.linalg.norm(start_m - on_path)) > STANDING_M:
        motion, (x, y, z) = parameters.motion, on_path.tolist()
        limits = Limits(motion.speed_max_m_s, motion.acceleration_max_m_s2, motion.jerk_max_m_s3)
        program = Program('way back', (MoveL(Target((x, y, z)), limits=limits),))
        back = program_planner.plan(program, start_m, parameters, returning=True).plan.moves
        # the tool stopped with the robot, and moving the arms by hand does not turn it
        moves = [*(move.with_turns(moves[0].start_turns_rad) for move in back), *moves]
    return Plan.of(moves)
