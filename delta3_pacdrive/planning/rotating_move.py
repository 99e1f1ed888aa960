"""Moves with tool rotation: rotation over the path, and slow-down within the limits of the rotary axis.

The tool angle is linear in the path distance of a statement and therefore as smooth as the master. Where a blend rounds
the corner between two statements, it also blends their rotations: speed and acceleration of the rotation change
smoothly over the blend.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import OVERRIDE_MAX
from delta3_pacdrive.planning.limits.limits import BETWEEN_SAMPLES, Limits, phase_voltage_max
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.move import STANDING, Move, MoveKind
from delta3_pacdrive.planning.paths.rotations import TURN_COLUMNS, between, sample_turn, standing
from delta3_pacdrive.planning.paths.virtual_master import plan_master, sample_master
from delta3_pacdrive.planning.planned_move import KEPT, PlannedMove, key_of_kept_time, plan_dwell, slowed_down
from delta3_pacdrive.planning.thermal_load import ThermalLoad
from delta3_pacdrive.planning.timing.blending import ROUNDING_M, PathSegment
from delta3_pacdrive.planning.timing.move_grid import Stretches
from delta3_pacdrive.planning.timing.move_planner import require_duration

SAMPLES = 400  # over the time of a move, in addition to the ends of its phases
BEFORE = 1e-9  # distance of the sample before the end of a phase, relative to the duration of the move
SLOPE_SAMPLES = 17  # per stretch, for its steepest rotation
ROUNDS_MAX = 12  # of planning with lower limits
ROUNDING_DEG = 1e-6  # tolerance of angle limits
STEEPEST = 1e-12  # rotations below this slope [rad/m] are zero

UNLIMITED = Limits(math.inf, math.inf, math.inf)
# by the number of rotary axes of the robot
_NO_AXIS = (
    'it turns the tool, but the robot has no rotary axis (rotary.present is false)',
    'it turns a second rotary axis, but the robot has one (rotary_2.present is false)',
)
_AXIS_TEXTS = ((), ('the rotary axis',), ('axis4', 'axis5'))
_TOOL_TEXTS = ((), ('the tool',), ('the tool on axis4', 'the tool on axis5'))


def require_rotary_axes(count: int, present: int, where: str = '') -> None:
    """Raise ProgramError, with the place ``where``, if ``count`` exceeds the number of rotary axes of the robot."""
    if count > present:
        raise ProgramError(f'{where}{_NO_AXIS[present]}')


def axis_text(parameters: Parameters, number: int) -> str:
    """Return the name of a rotary axis in messages."""
    return _AXIS_TEXTS[len(parameters.rotary_axes)][number]


def tool_text(parameters: Parameters, number: int) -> str:
    """Return the words for the tool in messages on a rotary axis."""
    return _TOOL_TEXTS[len(parameters.rotary_axes)][number]


@dataclass(frozen=True)
class TurnLimits:
    """Limits of a rotary axis with a payload."""

    speed_rad_s: float
    acceleration_rad_s2: float
    jerk_rad_s3: float
    current_per_acceleration: float  # motor current per acceleration [A s^2/rad], without friction
    friction_a: float  # motor current for friction at the speed limit
    by_current: (
        bool  # whether the peak current limits the acceleration, and not ``rotary.acceleration_max_deg_s2``
    )
    axis: str  # name of the axis in messages
    tool: str  # the tool in messages on this axis

    @staticmethod
    def of(parameters: Parameters, payload_kg: float) -> 'tuple[TurnLimits, ...]':
        """Return the limits of each rotary axis for a robot with a payload."""
        return tuple(
            TurnLimits._of_axis(parameters, number, payload_kg)
            for number in range(len(parameters.rotary_axes))
        )

    @staticmethod
    def _of_axis(parameters: Parameters, number: int, payload_kg: float) -> 'TurnLimits':
        rotary = parameters.rotary_axes[number]
        constant, axis = rotary.torque_constant_n_m_a, axis_text(parameters, number)
        drop = rotary.winding_resistance_ohm / 2.0 * rotary.peak_current_a
        by_voltage = (phase_voltage_max(parameters) - drop) * 3.0 / constant / rotary.gear_ratio
        speed = min(math.radians(rotary.speed_max_deg_s), max(by_voltage, 0.0))
        friction = rotary.static_friction_n_m + rotary.viscous_friction_n_m_s_rad * speed * rotary.gear_ratio
        per_acceleration = rotary.shaft_inertia_kg_m2(payload_kg) * rotary.gear_ratio / constant
        by_current = (rotary.peak_current_a - friction / constant) / per_acceleration
        configured = math.radians(rotary.acceleration_max_deg_s2)
        if min(speed, by_current) <= 0.0:
            raise ProgramError(f'the motor of {axis} has neither current nor voltage left for a turn')
        return TurnLimits(
            speed,
            min(configured, by_current),
            jerk_rad_s3=math.radians(rotary.jerk_max_deg_s3),
            current_per_acceleration=per_acceleration,
            friction_a=friction / constant,
            by_current=by_current < configured,
            axis=axis,
            tool=tool_text(parameters, number),
        )


@dataclass(frozen=True)
class TurnViolation:
    """Result of comparing a timed rotation with its limits."""

    distance: Floats  # on the path, of each sample, shape (n,)
    stretch: Floats  # time factor that each sample needs to respect all limits, shape (n,)
    text: str  # worst violation: quantity, value, limit and position

    @property
    def worst(self) -> float:
        """Largest time factor of all samples."""
        return float(self.stretch.max())


def turn_motion(times_s: Floats, master: Floats, rows: Floats) -> tuple[Floats, Floats]:
    """Return master (n, 4), and tool angle, speed, acceleration and jerk [rad, s], (n, 4), at times."""
    m = sample_master(times_s, master)
    (v, a, j), (angle, first, second, third) = m.T[1:], sample_turn(m[:, 0], rows).T
    turn = [
        angle,
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3.0 * second * v * a + first * j,
    ]
    return m, np.stack(turn, axis=1)


def turn_violation(master: Floats, turns: Sequence[Floats], limits: Sequence[TurnLimits]) -> TurnViolation:
    """Compare the rotations during a move with the limits of each rotary axis."""
    found = [_violation(master, rows, of_axis) for rows, of_axis in zip(turns, limits, strict=True)]
    worst = max(found, key=lambda one: one.worst)
    return replace(worst, stretch=np.max([one.stretch for one in found], axis=0))


def _violation(master: Floats, rows: Floats, limits: TurnLimits) -> TurnViolation:
    joints, duration = master[1:, 0], float(master[-1, 0])
    times = np.unique(
        np.concatenate([np.linspace(0.0, duration, SAMPLES), joints, joints - BEFORE * duration]).clip(
            0.0, (1.0 - BEFORE) * duration
        )
    )
    m, turn = turn_motion(times, master, rows)
    speed, acceleration, jerk = np.abs(turn[:, 1:]).T
    stretches = np.stack(
        [
            speed / limits.speed_rad_s,
            np.sqrt(acceleration / limits.acceleration_rad_s2),
            np.cbrt(jerk / limits.jerk_rad_s3),
        ]
    )
    quantity, n = (int(index) for index in np.unravel_index(np.argmax(stretches), stretches.shape))
    quantities = [
        (f'the speed of {limits.tool}', math.degrees(speed[n]), math.degrees(limits.speed_rad_s), 'deg/s'),
        (
            f'the acceleration of {limits.tool}',
            math.degrees(acceleration[n]),
            math.degrees(limits.acceleration_rad_s2),
            'deg/s2',
        ),
        (f'the jerk of {limits.tool}', math.degrees(jerk[n]), math.degrees(limits.jerk_rad_s3), 'deg/s3'),
    ]
    if limits.by_current:
        current, most = (
            limits.current_per_acceleration * value + limits.friction_a
            for value in (acceleration[n], limits.acceleration_rad_s2)
        )
        quantities[1] = f'the current of the motor of {limits.axis}', current, most, 'A'
    what, value, limit, unit = quantities[quantity]
    text = f'{what} would be {value:.4g} {unit} at s = {m[n, 0]:.4f} m, the limit is {limit:.4g} {unit}'
    return TurnViolation(m[:, 0], stretches.max(axis=0), text)


def check_turn(move: Move, override: float, parameters: Parameters) -> float:
    """Check an externally created move against angle and speed limits of the rotary axes; raises ProgramError.

    Returns the largest permissible override.
    """
    require_rotary_axes(len(move.turns), len(parameters.rotary_axes))
    if 0 < len(move.turns) < len(parameters.rotary_axes):
        raise ProgramError(f'it turns {len(move.turns)} of {len(parameters.rotary_axes)} rotary axes')
    return min(
        (_check_axis(move, number, override, parameters) for number in range(len(move.turns))),
        default=math.inf,
    )


def _check_axis(move: Move, number: int, override: float, parameters: Parameters) -> float:
    """Check the rotation of one rotary axis as ``check_turn`` does."""
    rotary = parameters.rotary_axes[number]
    times = np.linspace(0.0, move.duration_s * (1.0 - BEFORE), SAMPLES)
    m, turn = turn_motion(times, move.master, move.turns[number])
    angle, speed = np.degrees(turn[:, 0]), np.abs(turn[:, 1]) * rotary.gear_ratio * override
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    beyond = np.maximum(low - angle, angle - high)
    n = int(np.argmax(beyond))
    if not beyond[n] <= ROUNDING_DEG:
        raise ProgramError(
            f'{tool_text(parameters, number)} would be at {angle[n]:.6g} deg at s = {m[n, 0]:.4f} m, the limits are '
            f'{low:g} and {high:g} deg'
        )
    n, limit = int(np.argmax(speed)), rotary.max_speed_rad_s * (1.0 + BETWEEN_SAMPLES)
    if not speed[n] <= limit:
        raise ProgramError(
            f'the speed of the motor of {axis_text(parameters, number)} would be {speed[n]:.4g} rad/s at '
            f's = {m[n, 0]:.4f} m, the limit is {rotary.max_speed_rad_s:.4g} rad/s'
        )
    return override * limit / float(speed[n]) if speed[n] > 0.0 else math.inf


def turn_rows(
    segments: Sequence[PathSegment], ends_m: Sequence[float], length_m: float
) -> tuple[Floats, ...]:
    """Return the rotation of each rotary axis over the path of ``blending.blended``.

    Between blends the angle at a position is that of the original statement, independent of its blends. The segments
    end on the path at ``ends_m``.
    """
    turns = zip(*(segment.turns_rad for segment in segments), strict=True)
    return tuple(_turn_rows(segments, of_axis, ends_m, length_m) for of_axis in turns)


def _turn_rows(
    segments: Sequence[PathSegment],
    turns_rad: Sequence[tuple[float, float]],
    ends_m: Sequence[float],
    length_m: float,
) -> Floats:
    """Return the rotation of one rotary axis with given angles at start and end of each segment."""
    if all(start == end for start, end in turns_rad):
        return standing([turns_rad[0][0]])[0]
    rows: list[list[float]] = []
    position, cut = 0.0, 0.0
    for n, segment in enumerate(segments):
        last = n + 1 == len(segments)
        start, end = turns_rad[n]
        own_m, radius = segment.curve.length_m, 0.0 if last else segment.blend_m
        slope, free = (end - start) / own_m, own_m - cut - radius
        corner = 0.0 if last or radius == 0.0 else 2.0 * (ends_m[n] - position - max(free, 0.0))
        if free > ROUNDING_M or not rows:
            rows.append([position, start + slope * cut, slope, 0.0, 0.0, 0.0, 0.0])
            position = length_m if last else position + max(free, 0.0)
        if corner > 0.0:
            after = segments[n + 1]
            begin, target = turns_rad[n + 1]
            next_slope = (target - begin) / after.curve.length_m
            bend = between((end - slope * radius, slope), (begin + next_slope * radius, next_slope), corner)
            if rows[-1][0] == position:
                rows.pop()
            rows.append([position, *bend])
            position += corner
        cut = radius
    return np.array(rows, dtype=np.float64).reshape(-1, TURN_COLUMNS)


def slopes(rows: Floats, stretches: Stretches) -> Floats:
    """Return the steepest rotation [rad/m] in each stretch of a move."""
    ends = [0.0, *(end for end, _ in stretches)]
    places = np.linspace(ends[:-1], ends[1:], SLOPE_SAMPLES)
    found = np.abs(sample_turn(places.ravel(), rows)[:, 1]).reshape(places.shape)
    return np.asarray(found.max(axis=0))


Plan = Callable[[list[PathSegment], Stretches], PlannedMove]


def plan_turning_move(
    plan: Plan,
    segments: list[PathSegment],
    stretches: Stretches,
    turns: Sequence[Floats],
    limits: Sequence[TurnLimits],
    name: str,
) -> PlannedMove:
    """Plan a move with tool rotation, slowed down if a rotary axis requires it.

    Parameters
    ----------
    plan
        Function that plans the move with given TCP limits, without the tool.
    segments, stretches
        Segments and requested TCP limits.
    turns
        Rotation of each rotary axis, shape (n, 7).
    limits
        Limits of each rotary axis.
    name
        Name of the move for messages.

    Raises
    ------
    ProgramError
        The axis requires a slower move and a statement is strict, or the move cannot be planned.

    """
    planned = plan(segments, stretches)
    found = turn_violation(planned.move.master, turns, limits)
    if found.worst > KEPT:
        if kept := key_of_kept_time(segments):
            raise ProgramError(f'{found.text} ({kept})')
        asked_s = planned.move.duration_s
        planned = _slower(plan, segments, stretches, turns, limits)
        planned.notices.append(slowed_down(name, planned.move.duration_s, asked_s, found.text))
    override = 1.0 / max(turn_violation(planned.move.master, turns, limits).worst, 1.0 / OVERRIDE_MAX)
    load = replace(planned.load, override_max=max(1.0, min(planned.load.override_max, override)))
    return replace(planned, move=replace(planned.move, turns=tuple(turns)), load=load)


def _slower(
    plan: Plan,
    segments: list[PathSegment],
    stretches: Stretches,
    turns: Sequence[Floats],
    limits: Sequence[TurnLimits],
) -> PlannedMove:
    """Plan a move with TCP limits reduced until the rotations respect their limits."""
    steepness = np.stack([slopes(rows, stretches) for rows in turns], axis=1)
    ends = np.array([end for end, _ in stretches])
    factors = np.ones(len(stretches))
    for _ in range(ROUNDS_MAX):
        lower = [
            (end, _lowered(requested, of_axes.tolist(), factor, limits))
            for (end, requested), of_axes, factor in zip(stretches, steepness, factors, strict=True)
        ]
        lower_segments = segments
        if len(segments) == 1:
            lower_segments = [replace(segments[0], limits=lower[0][1])]
        planned = plan(lower_segments, lower)
        found = turn_violation(planned.move.master, turns, limits)
        if found.worst <= KEPT:
            return planned
        stretch = np.searchsorted(ends[:-1], found.distance, side='left')
        np.maximum.at(needed := np.ones(len(factors)), stretch, found.stretch)
        factors *= needed
    raise ProgramError(f'it cannot be made slow enough for the tool: {found.text}')


def _lowered(
    requested: Limits, slopes_rad_m: Sequence[float], factor: float, limits: Sequence[TurnLimits]
) -> Limits:
    """Return TCP limits with which rotations of these slopes respect their limits, slowed down by a factor."""
    steep = [_over(one, slope) for one, slope in zip(limits, slopes_rad_m, strict=True) if slope > STEEPEST]
    if not steep:
        return requested
    low = functools.reduce(Limits.lower, steep, requested)
    return Limits(low.speed_m_s / factor, low.acceleration_m_s2 / factor**2, low.jerk_m_s3 / factor**3)


def _over(limits: TurnLimits, slope: float) -> Limits:
    """Return the limits of the master of a rotation with a slope [rad per unit of the master]."""
    return Limits(limits.speed_rad_s / slope, limits.acceleration_rad_s2 / slope, limits.jerk_rad_s3 / slope)


def turn_samples(move: Move, number: int, parameters: Parameters) -> tuple[Floats, Floats, Floats, Floats]:
    """Return times [s], motor speeds [rad/s] and currents for friction and motion [A] of a rotary axis in a move."""
    rotary, limits = parameters.rotary_axes[number], TurnLimits.of(parameters, move.payload_kg)[number]
    times = np.linspace(0.0, move.duration_s * (1.0 - BEFORE), SAMPLES)
    if number >= len(move.turns):  # the program does not turn it
        return times, *np.zeros((3, SAMPLES))
    _, turn = turn_motion(times, move.master, move.turns[number])
    speed, moving = rotary.gear_ratio * turn[:, 1], limits.current_per_acceleration * turn[:, 2]
    friction = rotary.static_friction_n_m * np.sign(speed) + rotary.viscous_friction_n_m_s_rad * speed
    return times, speed, friction / rotary.torque_constant_n_m_a, moving


def turn_load(move: Move, number: int, parameters: Parameters) -> ThermalLoad:
    """Return the load of the motor of rotary axis ``number`` during a move, with the payload at its start."""
    none, time_s, rows = np.zeros(1), move.duration_s, move.turns[number]
    if not np.abs(rows[:, 2:]).any():
        dwells = move.kind in STANDING  # dwells keep their duration when all moves are slowed down
        moves_s, dwell_s = (0.0, time_s) if dwells else (time_s, 0.0)
        return ThermalLoad(
            none, none, none, duration_s=moves_s, dwelling=none, dwell_s=dwell_s, override_max=OVERRIDE_MAX
        )
    _, _, standing, moving = turn_samples(move, number, parameters)
    mean = [
        np.array([time_s * float(values.mean())]) for values in (moving**2, moving * standing, standing**2)
    ]
    return ThermalLoad(
        mean[0], mean[1], mean[2], duration_s=time_s, dwelling=none, dwell_s=0.0, override_max=OVERRIDE_MAX
    )


def plan_turn(
    start_m: Floats,
    turns_rad: Sequence[tuple[float, float]],
    payload_kg: float,
    name: str,
    parameters: Parameters,
) -> PlannedMove:
    """Plan a rotation of the tool at a fixed TCP from a start to an end angle of each rotary axis.

    The master is the angle by which the axis with the largest rotation has turned; the others keep pace with it.
    """
    longest = max(abs(end - start) for start, end in turns_rad)
    turns = standing([start for start, _ in turns_rad])
    limits = UNLIMITED
    for rows, (start, end), of_axis in zip(
        turns, turns_rad, TurnLimits.of(parameters, payload_kg), strict=True
    ):
        rows[0, 2] = slope = (end - start) / longest
        if slope != 0.0:
            limits = limits.lower(_over(of_axis, abs(slope)))
    phases = plan_master(longest, limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
    require_duration(float(phases[-1, 0]))
    dwelt = plan_dwell(start_m, float(phases[-1, 0]), payload_kg, name, parameters)
    move = Move(
        MoveKind.TURN,
        master=phases,
        segments=curves.point(start_m).segments,
        stop_acceleration=limits.acceleration_m_s2,
        stop_jerk=limits.jerk_m_s3,
        payload_kg=payload_kg,
        turns=turns,
    )
    return replace(dwelt, move=move, load=replace(dwelt.load, override_max=1.0))
