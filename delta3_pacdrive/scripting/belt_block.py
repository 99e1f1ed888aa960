"""Blocks of work on a belt, from entering to leaving it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.belts.meeting import BeltAxes, first_moved_s, require_feasible, transition_off
from delta3_pacdrive.belts.prediction import BeltEstimate
from delta3_pacdrive.belts.queue import QueuedPart
from delta3_pacdrive.belts.synchronization import (
    Motion,
    TrackLimits,
    TrackWindow,
    Transition,
    transition_to_rest,
)
from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.parameters.records import Motion as MotionLimits
from delta3_pacdrive.planning.paths.curves import COINCIDENT_M
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.model import Dwell, MoveL, Output, PathMove, Point
from delta3_pacdrive.scripting.arguments import TIME_MAX_S, TIMEOUT_S, number
from delta3_pacdrive.scripting.moves import Written
from delta3_pacdrive.scripting.source_position import ScriptPlace

LIMIT_MAX = 1e6  # upper bound of acceleration and jerk limits
INCREMENT_MAX_M = 20e-6
DWELL_S = 0.002  # duration of the dwell that replaces a first move of length 0


@dataclass
class Block:
    """Work on a belt, from entering to leaving it."""

    belt: int
    part: QueuedPart
    window: TrackWindow
    limits: TrackLimits
    timeout_s: float
    place: ScriptPlace
    begun: bool = False
    closed: bool = False
    stopped: bool = False  # another client has stopped the robot, which no longer moves with the belt
    first_is_dwell: bool = False  # the first move has length 0 and is replaced by a dwell

    @property
    def reference_m(self) -> float:
        """Planned position of the part along the belt [m]: the middle of the window."""
        return 0.5 * (self.window.begin_m + self.window.end_m)

    def offset_m(self, there: BeltEstimate) -> float:
        """Return the belt offset [m] of the part for a state of the belt."""
        return self.part.along_m + there.way_m - self.reference_m

    def begun_at(self, start_m: Point, batch: Sequence[Written]) -> list[Written]:
        """Return the statements of the block, with a first move of length 0 replaced by a dwell."""
        n, first = next((n, one) for n, (one, _) in enumerate(batch) if not isinstance(one, Output))
        self.first_is_dwell = isinstance(first, MoveL) and math.dist(first.to.point_m, start_m) < COINCIDENT_M
        first_written = [(Dwell(DWELL_S), batch[n][1])] if self.first_is_dwell else [batch[n]]
        return [*batch[:n], *first_written, *batch[n + 1 :]]

    def first_s(self, plan: Plan) -> float:
        """Return the end of the first move in the plan [s]."""
        return DWELL_S if self.first_is_dwell else first_moved_s(plan)


@dataclass(frozen=True)
class Leaving:
    """Expected motion of the robot off a belt, starting in a bus cycle: the belt offset decays to 0."""

    cycle: int
    belt: int
    way: Transition


def check_block(batch: Sequence[Written], closed: bool) -> None:
    """Raise ProgramError if the work on a belt does not start and end with an exact move."""
    moving = [one for one, _ in batch if not isinstance(one, Output)]
    if not moving or not isinstance(moving[0], PathMove):
        raise ProgramError('track: the first statement on a belt must be a move to a point above the part')
    if moving[0].blend_m > 0.0:
        raise ProgramError('track: the first move on a belt cannot have a blend')
    last = moving[-1]
    if closed and isinstance(last, PathMove) and last.blend_m > 0.0:
        raise ProgramError('track: the last move on a belt cannot have a blend')


def require_way_out(
    plan: Plan,
    block: Block,
    belt: BeltAxes,
    along_m: float,
    speed_m_s: float,
    parameters: Parameters,
    rate: float,
) -> None:
    """Raise ProgramError if the robot could not leave the belt within its limits without a further move.

    After a closed block the robot leaves from the end of the plan. An open block may last until the end of the window.
    ``along_m`` is the belt offset at the end of the plan [m], ``rate`` the override.
    """
    limits = block.limits
    if block.closed:
        way = transition_off(Motion((along_m, 0.0, 0.0), (speed_m_s, 0.0, 0.0)), limits)
    else:
        at_end = Motion((block.window.end_m - block.reference_m, 0.0, 0.0), (speed_m_s, 0.0, 0.0))
        way = transition_to_rest(at_end, limits.acceleration_m_s2, limits.jerk_m_s3)
    end_s = plan.duration_s / rate
    try:
        require_feasible(
            plan,
            end_s,
            to_s=end_s + way.duration_s,
            offset=lambda time_s: belt.to_base(way.at(time_s - end_s)),
            parameters=parameters,
            rate=rate,
        )
    except ProgramError as error:
        how = 'leaves the belt after the work' if block.closed else 'stops at the end of the window'
        raise ProgramError(f'track: if no move follows, the robot {how}: {error}') from None


def require_fine(belt: BeltAxes) -> None:
    """Raise RefusedError if the encoder of the belt is too coarse for smooth set points."""
    increment_m = 1.0 / belt.increments_per_m
    if increment_m > INCREMENT_MAX_M:
        raise belt_error(
            f'track: an increment of the encoder of belt {belt.name} is {1e6 * increment_m:.0f} um, but must be '
            f'at most {1e6 * INCREMENT_MAX_M:.0f} um, because its rounding affects the set points'
        )


def limits_of(keys: Mapping[str, Any], motion: MotionLimits) -> tuple[TrackLimits, float]:
    """Return the limits for entering and leaving a belt, and the timeout for a part [s]; raises ProgramError."""
    given = {
        'speed_m_s': motion.speed_max_m_s,
        'acceleration_m_s2': motion.acceleration_max_m_s2,
        'jerk_m_s3': motion.jerk_max_m_s3,
        'timeout_s': TIMEOUT_S,
    }
    for name in keys:
        if name not in given:
            raise ProgramError(f'track: unknown key {shown(name)}{nearest_of(name, tuple(given))}')
    given |= keys
    reserve = TrackLimits.belt_acceleration_m_s2
    acceleration = number('acceleration_m_s2', given['acceleration_m_s2'], 2.0 * reserve, LIMIT_MAX, ' m/s2')
    jerk = number('jerk_m_s3', given['jerk_m_s3'], 1.0, LIMIT_MAX, ' m/s3')
    speed = number('speed_m_s', given['speed_m_s'], 1e-3, math.inf, ' m/s')
    if speed > motion.tcp_speed_limit_m_s:
        raise ProgramError(
            f'track: speed_m_s is {speed}, but must not exceed motion.tcp_speed_limit_m_s '
            f'({motion.tcp_speed_limit_m_s})'
        )
    return TrackLimits(speed, acceleration, jerk), number('timeout_s', given['timeout_s'], 0.0, TIME_MAX_S)


def belt_error(sentence: str) -> RefusedError:
    """Return an error with ``Code.BELT``."""
    return RefusedError(Reason(Code.BELT, sentence))
