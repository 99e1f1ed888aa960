"""Work on a belt in a script, from getting on to leaving."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.cell.moves import Written
from delta3_pacdrive.cell.place import ScriptPlace
from delta3_pacdrive.cell.values import TIME_MAX_S, TIMEOUT_S, number
from delta3_pacdrive.configuration.checked import nearest_of
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, shown
from delta3_pacdrive.motion.belt_meeting import BeltAxes, first_moved_s, require_feasible, transition_off
from delta3_pacdrive.motion.belt_synchronization import (
    Motion,
    TrackLimits,
    TrackWindow,
    Transition,
    transition_to_rest,
)
from delta3_pacdrive.motion.curves import COINCIDENT_M
from delta3_pacdrive.motion.part_queue import QueuedPart
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.program import Dwell, MoveL, Output, PathMove, Point
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.parameters.records import Motion as MotionLimits

LIMIT_MAX = 1e6  # of accelerations and jerks
INCREMENT_MAX_M = 20e-6
STAND_S = 0.002  # of a dwell instead of a move to where the plan stands


@dataclass
class Block:
    """Work on a belt, from getting on to leaving."""

    belt: int
    part: QueuedPart
    window: TrackWindow
    limits: TrackLimits
    timeout_s: float
    place: ScriptPlace
    begun: bool = False
    closed: bool = False
    stopped: bool = False  # somebody has stopped the robot, which goes with the belt no longer
    stands: bool = False  # its first move leads to where the plan stands already

    @property
    def reference_m(self) -> float:
        """Where along the belt the plan has the part [m]: in the middle of the window."""
        return 0.5 * (self.window.begin_m + self.window.end_m)

    def begun_at(self, start_m: Point, batch: Sequence[Written]) -> list[Written]:
        """Return the work for a plan that stands somewhere [m]: a first move to there is a dwell."""
        n, first = next((n, one) for n, (one, _) in enumerate(batch) if not isinstance(one, Output))
        self.stands = isinstance(first, MoveL) and math.dist(first.to.point_m, start_m) < COINCIDENT_M
        standing = [(Dwell(STAND_S), batch[n][1])] if self.stands else [batch[n]]
        return [*batch[:n], *standing, *batch[n + 1 :]]

    def first_s(self, plan: Plan) -> float:
        """Return when the first move of the work ends, in its plan [s]."""
        return STAND_S if self.stands else first_moved_s(plan)


@dataclass(frozen=True)
class Leaving:
    """The robot is to leave a belt in a bus cycle: how what goes with it goes to 0, as far as is known."""

    cycle: int
    belt: int
    way: Transition


def check_block(batch: Sequence[Written], closed: bool) -> None:
    """Refuse work on a belt that does not begin, or end, with an exact move."""
    moving = [one for one, _ in batch if not isinstance(one, Output)]
    if not moving or not isinstance(moving[0], PathMove):
        raise ProgramError(
            'track: the first thing to do on a belt must be a move, above the part: it gets on the belt'
        )
    if moving[0].blend_m > 0.0:
        raise ProgramError('track: the first move on a belt gets on it, and cannot have a blend')
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
    """Refuse work on a belt that nobody could end: no move may follow, or the script may be too late with it.

    Behind a whole block the robot leaves from where its plan ends, driven at a rate; an open one may last until the
    window ends. ``along_m`` is what is added there in the direction of the belt [m], ``speed_m_s`` that of the belt.
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
            end_s + way.duration_s,
            lambda time_s: belt.to_base(way.at(time_s - end_s)),
            parameters,
            rate,
        )
    except ProgramError as error:
        how = 'leaves the belt behind the work' if block.closed else 'stops where the window ends'
        raise ProgramError(f'track: no move follows, so that the robot {how}: {error}') from None


def require_fine(belt: BeltAxes) -> None:
    """Refuse work on a belt whose encoder is so coarse that its increments shake the robot."""
    increment_m = 1.0 / belt.increments_per_m
    if increment_m > INCREMENT_MAX_M:
        raise belt_error(
            f'track: an increment of the encoder of belt {belt.name} is {1e6 * increment_m:.0f} um, but must be '
            f'at most {1e6 * INCREMENT_MAX_M:.0f} um, as its rounding goes into the set points'
        )


def limits_of(keys: Mapping[str, Any], motion: MotionLimits) -> tuple[TrackLimits, float]:
    """Return the limits of getting on and leaving, and the time-out of a part [s]; raises ProgramError."""
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
    """Return the refusal of what cannot be done on a belt."""
    return RefusedError(Reason(Code.BELT, sentence))
