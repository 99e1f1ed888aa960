"""Moves in which the tool turns: the turn over the path, and the limits of the rotary axis that slow a move down.

The angle goes evenly with the distance on the path of a statement: it begins and ends with the statement, and is as
smooth as the master is. Where a blend rounds the corner between two statements, it rounds the turn as well: over the
blend, speed and acceleration of the turn pass over from one to the other.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import curves
from delta3_pacdrive.motion.blending import ROUNDING_M, PathSegment
from delta3_pacdrive.motion.execution import OVERRIDE_MAX
from delta3_pacdrive.motion.limits import BETWEEN_SAMPLES, Limits, phase_voltage_max
from delta3_pacdrive.motion.move import STANDING, Move, MoveKind
from delta3_pacdrive.motion.move_grid import Stretches
from delta3_pacdrive.motion.move_planner import require_end_of_time
from delta3_pacdrive.motion.planned_move import KEPT, PlannedMove, key_of_kept_time, plan_dwell, slowed_down
from delta3_pacdrive.motion.thermal_load import ThermalLoad
from delta3_pacdrive.motion.turns import TURN_COLUMNS, between, sample_turn
from delta3_pacdrive.motion.virtual_master import plan_master, sample_master
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

SAMPLES = 400  # over the time of a move, beside the ends of its phases
BEFORE = 1e-9  # of a move's duration: the sample right before the end of a phase
SLOPE_SAMPLES = 17  # of a stretch, at which the turn is looked at
ROUNDS_MAX = 12  # of planning with lower limits
ROUNDING_DEG = 1e-6  # by which an angle may be beyond its limit
STEEPEST = 1e-12  # [rad/m] below which nothing turns
NO_AXIS = 'it turns the tool, but the robot has no rotary axis (rotary.present is false)'


@dataclass(frozen=True)
class TurnLimits:
    """What the rotary axis can do with a part [rad/s], [rad/s^2], [rad/s^3], and what keeps its acceleration.

    Attributes
    ----------
    current_per_acceleration
        Current of its motor for an acceleration [A s^2/rad] beside that for friction, ``friction_a``.
    by_current
        Whether the current keeps the acceleration, and not ``rotary.acceleration_max_deg_s2``.

    """

    speed_rad_s: float
    acceleration_rad_s2: float
    jerk_rad_s3: float
    current_per_acceleration: float
    friction_a: float
    by_current: bool

    @staticmethod
    def of(parameters: Parameters, payload_kg: float) -> 'TurnLimits':
        """Return the limits of a robot that carries a payload."""
        rotary, constant = parameters.rotary, parameters.rotary.torque_constant_n_m_a
        drop = rotary.winding_resistance_ohm / 2.0 * rotary.peak_current_a
        by_voltage = (phase_voltage_max(parameters) - drop) * 3.0 / constant / rotary.gear_ratio
        speed = min(math.radians(rotary.speed_max_deg_s), max(by_voltage, 0.0))
        friction = rotary.static_friction_n_m + rotary.viscous_friction_n_m_s_rad * speed * rotary.gear_ratio
        per_acceleration = rotary.shaft_inertia_kg_m2(payload_kg) * rotary.gear_ratio / constant
        by_current = (rotary.peak_current_a - friction / constant) / per_acceleration
        told = math.radians(rotary.acceleration_max_deg_s2)
        if min(speed, by_current) <= 0.0:
            raise ProgramError('the motor of the rotary axis has neither current nor voltage left for a turn')
        return TurnLimits(
            speed,
            min(told, by_current),
            math.radians(rotary.jerk_max_deg_s3),
            per_acceleration,
            friction / constant,
            by_current < told,
        )


@dataclass(frozen=True)
class TurnViolation:
    """How far a timed turn exceeds its limits.

    Attributes
    ----------
    distance
        On the path, of each sample, shape (n,).
    stretch
        Factor of time that each sample needs to keep every limit, shape (n,).
    text
        The worst in words: quantity, value, limit and place.

    """

    distance: Floats
    stretch: Floats
    text: str

    @property
    def worst(self) -> float:
        """Largest factor of time that a sample needs."""
        return float(self.stretch.max())


def turn_motion(times_s: Floats, master: Floats, rows: Floats) -> tuple[Floats, Floats]:
    """Master (n, 4) at times, and angle, speed, acceleration and jerk of the turn there [rad, s], shapes (n, 4)."""
    m = sample_master(times_s, master)
    (v, a, j), (angle, first, second, third) = m.T[1:], sample_turn(m[:, 0], rows).T
    turn = [
        angle,
        first * v,
        second * v**2 + first * a,
        third * v**3 + 3.0 * second * v * a + first * j,
    ]
    return m, np.stack(turn, axis=1)


def turn_violation(master: Floats, rows: Floats, limits: TurnLimits) -> TurnViolation:
    """Compare the turn of a move with the limits of the rotary axis."""
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
    told = [
        ('the speed of the tool', math.degrees(speed[n]), math.degrees(limits.speed_rad_s), 'deg/s'),
        (
            'the acceleration of the tool',
            math.degrees(acceleration[n]),
            math.degrees(limits.acceleration_rad_s2),
            'deg/s2',
        ),
        ('the jerk of the tool', math.degrees(jerk[n]), math.degrees(limits.jerk_rad_s3), 'deg/s3'),
    ]
    if limits.by_current:
        current, most = (
            limits.current_per_acceleration * value + limits.friction_a
            for value in (acceleration[n], limits.acceleration_rad_s2)
        )
        told[1] = 'the current of the motor of the rotary axis', current, most, 'A'
    what, value, limit, unit = told[quantity]
    text = f'{what} would be {value:.4g} {unit} at s = {m[n, 0]:.4f} m, the limit is {limit:.4g} {unit}'
    return TurnViolation(m[:, 0], stretches.max(axis=0), text)


def check_turn(move: Move, override: float, parameters: Parameters) -> float:
    """Refuse a move of a foreign writer that the rotary axis cannot follow at an override; raises ProgramError.

    Returns the largest override at which it would not be refused.
    """
    if not len(move.turns):
        return math.inf
    rotary = parameters.rotary
    if not rotary.present:
        raise ProgramError(NO_AXIS)
    times = np.linspace(0.0, move.duration_s * (1.0 - BEFORE), SAMPLES)
    m, turn = turn_motion(times, move.master, move.turns)
    angle, speed = np.degrees(turn[:, 0]), np.abs(turn[:, 1]) * rotary.gear_ratio * override
    low, high = rotary.angle_min_deg, rotary.angle_max_deg
    beyond = np.maximum(low - angle, angle - high)
    n = int(np.argmax(beyond))
    if not beyond[n] <= ROUNDING_DEG:
        raise ProgramError(
            f'the tool would be at {angle[n]:.6g} deg at s = {m[n, 0]:.4f} m, the limits are {low:g} and {high:g} deg'
        )
    n, limit = int(np.argmax(speed)), rotary.max_speed_rad_s * (1.0 + BETWEEN_SAMPLES)
    if not speed[n] <= limit:
        raise ProgramError(
            f'the speed of the motor of the rotary axis would be {speed[n]:.4g} rad/s at s = {m[n, 0]:.4f} m, the '
            f'limit is {rotary.max_speed_rad_s:.4g} rad/s'
        )
    return override * limit / float(speed[n]) if speed[n] > 0.0 else math.inf


def turn_rows(segments: Sequence[PathSegment], ends_m: Sequence[float], length_m: float) -> Floats:
    """Return the turn over the path that ``blending.blended`` makes of segments, whose ends on it are given.

    Between blends the angle is that of the statement at the same place of its own path, whatever is blended with it.
    """
    rows: list[list[float]] = []
    here, cut = 0.0, 0.0
    for n, segment in enumerate(segments):
        last = n + 1 == len(segments)
        start, end = segment.turn_rad or (0.0, 0.0)
        own_m, radius = segment.curve.length_m, 0.0 if last else segment.blend_m
        slope, free = (end - start) / own_m, own_m - cut - radius
        corner = 0.0 if last or radius == 0.0 else 2.0 * (ends_m[n] - here - max(free, 0.0))
        if free > ROUNDING_M or not rows:
            rows.append([here, start + slope * cut, slope, 0.0, 0.0, 0.0, 0.0])
            here = length_m if last else here + max(free, 0.0)
        if corner > 0.0:
            after = segments[n + 1]
            begin, target = after.turn_rad or (0.0, 0.0)
            next_slope = (target - begin) / after.curve.length_m
            bend = between((end - slope * radius, slope), (begin + next_slope * radius, next_slope), corner)
            if rows[-1][0] == here:
                rows.pop()
            rows.append([here, *bend])
            here += corner
        cut = radius
    return np.array(rows, dtype=np.float64).reshape(-1, TURN_COLUMNS)


def slopes(rows: Floats, stretches: Stretches) -> Floats:
    """Return the largest slope of a turn [rad/m] in each stretch of a move."""
    ends = [0.0, *(end for end, _ in stretches)]
    places = np.linspace(ends[:-1], ends[1:], SLOPE_SAMPLES)
    found = np.abs(sample_turn(places.ravel(), rows)[:, 1]).reshape(places.shape)
    return np.asarray(found.max(axis=0))


Plan = Callable[[list[PathSegment], Stretches], PlannedMove]


def plan_turning_move(
    plan: Plan,
    segments: list[PathSegment],
    stretches: Stretches,
    rows: Floats,
    limits: TurnLimits,
    name: str,
) -> PlannedMove:
    """Plan a move in which the tool turns, slower if its axis asks for that.

    Parameters
    ----------
    plan
        Plans the move with limits of the TCP, whatever the tool does.
    segments, stretches
        Of the move, as it is asked for.
    rows
        Its turn, shape (n, 7).
    limits
        Of the rotary axis.
    name
        Of the move, in sentences.

    Raises
    ------
    ProgramError
        The axis asks for a slower move, and a statement is strict; or the move is refused as any other.

    """
    planned = plan(segments, stretches)
    found = turn_violation(planned.move.master, rows, limits)
    if found.worst > KEPT:
        if kept := key_of_kept_time(segments):
            raise ProgramError(f'{found.text} ({kept})')
        asked_s = planned.move.duration_s
        planned = _slower(plan, segments, stretches, rows, limits)
        planned.notices.append(slowed_down(name, planned.move.duration_s, asked_s, found.text))
    override = 1.0 / max(turn_violation(planned.move.master, rows, limits).worst, 1.0 / OVERRIDE_MAX)
    load = replace(planned.load, override_max=max(1.0, min(planned.load.override_max, override)))
    return replace(planned, move=replace(planned.move, turns=rows), load=load)


def _slower(
    plan: Plan, segments: list[PathSegment], stretches: Stretches, rows: Floats, limits: TurnLimits
) -> PlannedMove:
    """Plan a move within limits of the TCP so low that the turn keeps its own."""
    steepness = slopes(rows, stretches)
    ends = np.array([end for end, _ in stretches])
    factors = np.ones(len(stretches))
    for _ in range(ROUNDS_MAX):
        lower = [
            (end, _lowered(told, slope, factor, limits))
            for (end, told), slope, factor in zip(stretches, steepness, factors, strict=True)
        ]
        lower_segments = segments
        if len(segments) == 1:
            lower_segments = [replace(segments[0], limits=lower[0][1])]
        planned = plan(lower_segments, lower)
        found = turn_violation(planned.move.master, rows, limits)
        if found.worst <= KEPT:
            return planned
        stretch = np.searchsorted(ends[:-1], found.distance, side='left')
        np.maximum.at(needed := np.ones(len(factors)), stretch, found.stretch)
        factors *= needed
    raise ProgramError(f'it cannot be made slow enough for the tool: {found.text}')


def _lowered(told: Limits, slope: float, factor: float, limits: TurnLimits) -> Limits:
    """Return limits of the TCP with which a turn of a slope keeps its own, and as many times slower again."""
    if slope <= STEEPEST:
        return told
    turn = Limits(limits.speed_rad_s / slope, limits.acceleration_rad_s2 / slope, limits.jerk_rad_s3 / slope)
    low = told.lower(turn)
    return Limits(low.speed_m_s / factor, low.acceleration_m_s2 / factor**2, low.jerk_m_s3 / factor**3)


def turn_load(move: Move, parameters: Parameters) -> ThermalLoad:
    """Sum up what the turn of a move asks of the motor of the rotary axis, with the payload at its start."""
    none, time_s = np.zeros(1), move.duration_s
    if not np.abs(move.turns[:, 2:]).any():
        dwells = move.kind in STANDING  # which last no longer where all moves are slower
        moves_s, dwell_s = (0.0, time_s) if dwells else (time_s, 0.0)
        return ThermalLoad(none, none, none, moves_s, none, dwell_s, OVERRIDE_MAX)
    rotary, limits = parameters.rotary, TurnLimits.of(parameters, move.payload_kg)
    times = np.linspace(0.0, time_s * (1.0 - BEFORE), SAMPLES)
    _, turn = turn_motion(times, move.master, move.turns)
    speed, moving = rotary.gear_ratio * turn[:, 1], limits.current_per_acceleration * turn[:, 2]
    friction = rotary.static_friction_n_m * np.sign(speed) + rotary.viscous_friction_n_m_s_rad * speed
    standing = friction / rotary.torque_constant_n_m_a
    mean = [
        np.array([time_s * float(values.mean())]) for values in (moving**2, moving * standing, standing**2)
    ]
    return ThermalLoad(mean[0], mean[1], mean[2], time_s, none, 0.0, OVERRIDE_MAX)


def plan_turn(
    here: Floats, turn_rad: tuple[float, float], payload_kg: float, name: str, parameters: Parameters
) -> PlannedMove:
    """Let the tool turn from an angle to another one while the robot stands; the master goes by the angle."""
    start, end = turn_rad
    limits = TurnLimits.of(parameters, payload_kg)
    phases = plan_master(abs(end - start), limits.speed_rad_s, limits.acceleration_rad_s2, limits.jerk_rad_s3)
    require_end_of_time(float(phases[-1, 0]))
    dwelt = plan_dwell(here, float(phases[-1, 0]), payload_kg, name, parameters)
    rows = np.zeros((1, TURN_COLUMNS))
    rows[0, 1], rows[0, 2] = start, math.copysign(1.0, end - start)
    move = Move(
        MoveKind.TURN,
        phases,
        curves.point(here).segments,
        limits.acceleration_rad_s2,
        limits.jerk_rad_s3,
        payload_kg,
        turns=rows,
    )
    return replace(dwelt, move=move, load=replace(dwelt.load, override_max=1.0))
