"""Evaluation of a planned program over time, and of each move with its limits."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS, Parameters, rotary_axis_parameters
from delta3_pacdrive.planning.limits.energy import Energy, energy
from delta3_pacdrive.planning.limits.gear_load import GearLoad, gear_load
from delta3_pacdrive.planning.limits.joint_forces import JointForces, joint_forces
from delta3_pacdrive.planning.limits.limits import arm_bounds, workspace_bounds
from delta3_pacdrive.planning.limits.supply import MotorMotion, load_of_motion
from delta3_pacdrive.planning.limits.temperature import (
    HeatLoad,
    heat_load,
    motion_heat_load,
    no_heat_load,
    temperatures,
)
from delta3_pacdrive.planning.paths.move import STANDING, TIMED, UNCHANGED, Move, MoveKind
from delta3_pacdrive.planning.paths.path_dynamics import (
    PARALLEL,
    SERIAL,
    SWING,
    THETA,
    WEIGHT,
    PathDynamics,
    moving_torque,
    path_coefficients,
    timed_dynamics,
)
from delta3_pacdrive.planning.paths.virtual_master import extremes, master_at_distances, sample_master
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned, plan
from delta3_pacdrive.planning.rotating_move import TurnLimits, turn_motion, turn_samples, turn_violation
from delta3_pacdrive.planning.timing.move_grid import limits_at
from delta3_pacdrive.studies.framework.columns import key_of_unit
from delta3_pacdrive.studies.framework.study import OnProgress, silent
from delta3_pacdrive.studies.places.planning import limiters
from delta3_pacdrive.studies.places.planning.limiters import Limiter
from delta3_pacdrive.studies.places.planning.study import (
    MoveRow,
    PlanStudy,
    Quantity,
    Samples,
    StatementRow,
    TurnRow,
    Use,
)

STEP_S, SAMPLES_MIN, SAMPLES_MAX = 1e-3, 200, 4000  # of a move
SAMPLES_KEPT = 400_000  # of a plan: 150 MB
BEFORE = 1e-9  # offset of the sample before the end of a phase, relative to the duration of a move
AT_LIMIT = 0.95  # share from which a limit counts as used up
QUANTITIES = tuple(Quantity)
LIMITING = QUANTITIES[:-3]  # quantities that limit single samples
STANDING_M_S = 1e-9


@dataclass(frozen=True)
class _Part:
    """One move with its samples."""

    move: Move
    times: Floats
    master: Floats
    samples: Floats
    coefficients: Floats
    dynamics: PathDynamics
    forces: JointForces
    limits: tuple[Floats, Floats, Floats] | None  # speed, acceleration and jerk of the TCP
    limiters: tuple[Limiter, ...]
    leading: NDArray[np.int64]  # index of the leading limiter


def study(planned: Planned, parameters: Parameters, on_progress: OnProgress = silent) -> PlanStudy:
    """Evaluate the first round of a planned program; the samples of a long program are thinned."""
    count = planned.first_round
    numbers, starts = planned.plan.tables.order[:count].tolist(), planned.plan.tables.starts[:count].tolist()
    in_all = sum(_steps(planned.plan.moves[number]) for number in numbers)
    stride = -(-in_all // SAMPLES_KEPT)
    rows, pieces, distance_m = [], [], 0.0
    loads: dict[int, _Loads] = {}
    motions: list[list[MotorMotion]] = []
    for n, (number, start_s) in enumerate(zip(numbers, starts, strict=True)):
        on_progress('evaluating', n, count)
        part = _part(planned, number, parameters)
        loads[number] = _loads(part, parameters)
        if parameters.supply.enabled:
            motions.append(_motor_motions(part, start_s, parameters))
        row = _row(planned, number, part, parameters, n=n, start_s=start_s)
        piece = _piece(planned, part, parameters, n=n, start_s=start_s, before_m=distance_m)
        rows.append(row)
        pieces.append(_thinned(piece, stride))
        distance_m += row.length_m
    load = None
    if motions:
        load = load_of_motion([MotorMotion.joined(one) for one in zip(*motions, strict=True)], parameters)
    of_round = _of_round(planned, loads, parameters)
    heats = [(of_round.heat, parameters)]
    heats += [(one, rotary_axis_parameters(parameters, n)) for n, one in enumerate(of_round.turns)]
    return PlanStudy(
        planned,
        _joined(pieces),
        tuple(rows),
        of_round.energy,
        of_round.gears,
        temperatures(heats, planned.override_max),
        supply=load,
    )


def _motor_motions(part: _Part, start_s: float, parameters: Parameters) -> list[MotorMotion]:
    """Return the motions of the arms and of each rotary axis in a move."""
    d = part.dynamics
    motions = [MotorMotion(start_s + d.time_s, d.motor_current_a, d.motor_speed_rad_s, parameters)]
    for number in range(len(parameters.rotary_axes)):
        times, speed, standing, moving = turn_samples(part.move, number, parameters)
        own = rotary_axis_parameters(parameters, number)
        motions.append(MotorMotion(start_s + times, (standing + moving)[:, None], speed[:, None], own))
    return motions


class _Loads(NamedTuple):
    """Additive loads of a move."""

    energy: Energy
    gears: GearLoad
    heat: HeatLoad
    turns: tuple[HeatLoad, ...]  # of the rotary axes

    def plus(self, other: '_Loads') -> '_Loads':
        """Return the loads of both motions."""
        turns = tuple(one + more for one, more in zip(self.turns, other.turns, strict=True))
        return _Loads(self.energy + other.energy, self.gears + other.gears, self.heat + other.heat, turns)

    def times(self, count: float) -> '_Loads':
        """Return the loads of ``count`` repetitions."""
        turns = tuple(one.times(count) for one in self.turns)
        return _Loads(self.energy.times(count), self.gears.times(count), self.heat.times(count), turns)


def _loads(part: _Part, parameters: Parameters) -> _Loads:
    d = part.dynamics
    turns = tuple(_turn_heat(part.move, number, parameters) for number in range(len(parameters.rotary_axes)))
    return _Loads(energy(d, parameters), gear_load(d, parameters), heat_load(d, parameters), turns)


def _turn_heat(move: Move, number: int, parameters: Parameters) -> HeatLoad:
    """Return the heat load of the motor of a rotary axis in a move."""
    times, *columns = turn_samples(move, number, parameters)
    speed, standing, moving = (one[:, None] for one in columns)
    own = rotary_axis_parameters(parameters, number)
    return motion_heat_load(times, speed, standing, standing + moving, parameters=own)


def _of_round(planned: Planned, known: dict[int, _Loads], parameters: Parameters) -> _Loads:
    """Return the mean loads per round; ``known`` contains those of moves by number."""
    none = np.zeros(3)
    loads = _Loads(
        Energy(),
        GearLoad(none, none, none, 0.0),
        no_heat_load(ARMS),
        tuple(no_heat_load(1) for _ in parameters.rotary_axes),
    )
    for number, count in zip(*np.unique(planned.plan.tables.order, return_counts=True), strict=True):
        one = known.get(int(number)) or _loads(_part(planned, int(number), parameters), parameters)
        loads = loads.plus(one.times(float(count)))
    return loads.times(1.0 / planned.repeat)


def of_program(program: Program, parameters: Parameters, on_progress: OnProgress = silent) -> PlanStudy:
    """Plan a program from its start, or from home, and evaluate it; raises ProgramError."""
    start = parameters.motion.home_m if program.start_m is None else program.start_m
    planned = plan(program, start, parameters, progress=partial(on_progress, 'planning'))
    return study(planned, parameters, on_progress)


def _part(planned: Planned, number: int, parameters: Parameters) -> _Part:
    move, stretches = planned.plan.moves[number], planned.stretches[number]
    times = _times(move, _passed_s(planned, number))
    master = sample_master(times, move.master)
    # the last sample belongs to the last phase, not to the standstill after it
    master[-1, 1:] = sample_master([(1.0 - BEFORE) * move.duration_s], move.master)[0, 1:]
    samples = move.sample(master[:, 0])
    payload, carried = _payloads(move, master[:, 0])
    coefficients = path_coefficients(samples, payload, carried, parameters)
    kilograms = np.asarray(carried)[payload]
    dynamics = timed_dynamics(times, master, samples, coefficients, parameters, kilograms)
    limits = limits_at(master[:, 0], stretches) if stretches else None
    found, rate = (
        limiters.of_motion(dynamics, master, samples, limits, parameters),
        planned.torque_rates_n_m_s[number],
    )
    if math.isfinite(rate):
        torque = moving_torque(master, coefficients) + coefficients[:, WEIGHT]
        found += limiters.of_torque_rate(times, _steps(move), torque, payload, rate)
    leading = np.asarray(np.argmax([one.stretch for one in found], axis=0))
    if move.kind not in (*STANDING, *TIMED, MoveKind.TURN):
        heat = limiters.of_rms_current(times, planned.rms_current_a, parameters.motor.nominal_current_a)
        if heat is not None:  # leads where no other limit is used up
            leading[np.maximum.reduce([one.used for one in found]) < AT_LIMIT] = len(found)
            found += (heat,)
    return _Part(
        move=move,
        times=times,
        master=master,
        samples=samples,
        coefficients=coefficients,
        dynamics=dynamics,
        forces=joint_forces(*_of_tcp(dynamics), parameters, kilograms),
        limits=limits,
        limiters=found,
        leading=leading,
    )


def _of_tcp(d: PathDynamics) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and acceleration of the TCP."""
    return d.tcp_motion_m[:, 0], d.tcp_motion_m[:, 1], d.tcp_motion_m[:, 2]


def _steps(move: Move) -> int:
    """Return the number of equidistant steps in which a move is evaluated."""
    return min(max(math.ceil(move.duration_s / STEP_S), SAMPLES_MIN), SAMPLES_MAX)


def _passed_s(planned: Planned, number: int) -> Floats:
    """Return the end time [s] of each statement of a blended sequence; empty for other moves."""
    parts = planned.parts[number] if planned.parts else ()
    move = planned.plan.moves[number]
    if not parts:
        return np.empty(0)
    passed = master_at_distances([min(end, move.length_m) for _, end in parts], move.master)[:, 0]
    passed[-1] = move.duration_s
    return passed


def _times(move: Move, passed_s: Floats) -> Floats:
    """Return equidistant times and both sides of phase boundaries; for a sequence also those of extreme speeds."""
    duration, joints = move.duration_s, move.master[1:, 0]
    even = np.linspace(0.0, duration, _steps(move) + 1)
    if len(joints) > SAMPLES_MAX and not len(passed_s):
        return even
    more = [passed_s, extremes(move.master)[0]] if len(passed_s) else []
    return np.unique(np.concatenate([even, joints, joints - BEFORE * duration, *more]).clip(0.0, duration))


def statement_rows(planned: Planned, number: int, parameters: Parameters) -> tuple[StatementRow, ...]:
    """Return the statements of a blended sequence; empty for other moves."""
    if not planned.parts[number]:
        return ()
    return _statement_rows(planned, number, _part(planned, number, parameters), parameters)


def _statement_rows(
    planned: Planned, number: int, part: _Part, parameters: Parameters
) -> tuple[StatementRow, ...]:
    weights, of_whole = np.gradient(part.times), _limited_as_a_whole(part.move, planned, parameters)
    passed_s = _passed_s(planned, number)
    bounds = np.searchsorted(part.times, passed_s).tolist()
    rows, first, begin_s, begin_m = [], 0, 0.0, 0.0
    for (name, end_m), end_s, last in zip(planned.parts[number], passed_s.tolist(), bounds, strict=True):
        own = slice(first, last + 1)
        speed = part.dynamics.tcp_speed_m_s[own]
        rows.append(
            StatementRow(
                name=name,
                start_s=begin_s,
                duration_s=end_s - begin_s,
                length_m=end_m - begin_m,
                speed_min_m_s=float(speed.min()),
                speed_max_m_s=float(speed.max()),
                limited_by=of_whole or _uses(part, own, weights[own] / weights[own].sum())[0],
            )
        )
        first, begin_s, begin_m = last, end_s, end_m
    return tuple(rows)


def _payloads(move: Move, distance_m: Floats) -> tuple[NDArray[np.int64], tuple[float, ...]]:
    """Return the index of the payload at each distance, and the payloads [kg]."""
    changes = move.events[move.events[:, 3] != UNCHANGED]
    index = np.searchsorted(changes[:, 0], distance_m, side='right')
    return index.astype(np.int64), (move.payload_kg, *changes[:, 3].tolist())


def _length(part: _Part) -> float:
    """Return the length of the TCP path [m]; the parameter of a cubic is the time, not the distance."""
    if part.move.kind in TIMED:
        return float(_distance(part.dynamics.tcp_speed_m_s, part.times)[-1])
    return 0.0 if part.move.kind == MoveKind.TURN else part.move.length_m


def _row(
    planned: Planned, number: int, part: _Part, parameters: Parameters, *, n: int, start_s: float
) -> MoveRow:
    weights = np.gradient(part.times) if len(part.times) > 1 else np.ones(1)
    weights = weights / weights.sum()
    uses = _uses(part, slice(None), weights)
    d, torque = part.dynamics, parameters.motor.torque_constant_n_m_a
    turn, turn_2, *_ = (*_turns(part, parameters), None, None)
    return MoveRow(
        number=n + 1,
        name=planned.names[number],
        kind=part.move.kind.name.lower(),
        start_s=start_s,
        duration_s=part.move.duration_s,
        length_m=_length(part),
        payload_kg=part.move.payload_kg,
        speed_max_m_s=float(d.tcp_speed_m_s.max()),
        acceleration_max_m_s2=float(d.tcp_acceleration_m_s2.max()),
        jerk_max_m_s3=float(d.tcp_jerk_m_s3.max()),
        motor_speed_max_rad_s=_of_axes(np.abs(d.motor_speed_rad_s).max(axis=0)),
        motor_torque_max_n_m=_of_axes(torque * np.abs(d.motor_current_a).max(axis=0)),
        motor_current_rms_a=_of_axes(np.sqrt(weights @ d.motor_current_a**2)),
        gear_torque_max_n_m=_of_axes(np.abs(d.gear_torque_n_m).max(axis=0)),
        rod_force_max_n=_of_axes(np.abs(part.forces.rod_n).max(axis=(0, 2))),
        spring_force_max_n=_of_axes(part.forces.spring_n.max(axis=0)),
        plate_force_max_n=float(np.abs(part.forces.plate_axial_n).max()),
        plate_moment_max_n_m=float(part.forces.plate_moment_n_m.max()),
        uses=tuple(uses),
        limited_by=_limited_by(uses, part.move, planned, parameters),
        distances=_distances(part, parameters),
        turn=turn,
        turn_2=turn_2,
        statements=_statement_rows(planned, number, part, parameters)
        if len(_passed_s(planned, number))
        else (),
    )


def _turns(part: _Part, parameters: Parameters) -> list[TurnRow]:
    """Return the rotation of each rotary axis during a move; empty if the move does not define them."""
    move, rows = part.move, []
    limits = TurnLimits.of(parameters, move.payload_kg)
    ends = zip(move.start_turns_rad, move.end_turns_rad, strict=True)
    for (start, end), table, of_axis in zip(ends, move.turns, limits, strict=False):
        _, turn = turn_motion(part.times[:-1], move.master, table)
        speed, acceleration = (float(value) for value in np.abs(turn[:, 1:3]).max(axis=0))
        current = of_axis.current_per_acceleration * acceleration + of_axis.friction_a
        rows.append(
            TurnRow(
                from_deg=math.degrees(start),
                to_deg=math.degrees(end),
                speed_max_deg_s=math.degrees(speed),
                acceleration_max_deg_s2=math.degrees(acceleration),
                motor_current_max_a=current * (speed > 0.0),
            )
        )
    return rows


def _is_turn_at_limit(move: Move, parameters: Parameters) -> bool:
    """Return whether a rotary axis limits the speed of a move."""
    limits = TurnLimits.of(parameters, move.payload_kg)[: len(move.turns)]
    return any(
        turn_violation(move.master, [rows], [of_axis]).worst >= AT_LIMIT
        for rows, of_axis in zip(move.turns, limits, strict=False)
    )


def _of_axes(values: Floats) -> tuple[float, ...]:
    return tuple(values.tolist())


def _uses(part: _Part, own: slice, weights: Floats) -> list[Use]:
    """Return the use of every limit in (a part of) a move, the most limiting first."""
    uses = [
        _use(one, own, float(weights[part.leading[own] == k].sum())) for k, one in enumerate(part.limiters)
    ]
    return sorted(
        _merged(uses), key=lambda use: (use.used >= AT_LIMIT, use.time_share, use.used), reverse=True
    )


def _use(one: Limiter, own: slice, time_share: float) -> Use:
    worst = range(len(one.used))[own][int(np.argmax(one.used[own]))]
    return Use(
        quantity=one.quantity,
        axis=one.axis,
        peak=float(one.value[worst]),
        limit=float(one.limit[worst]),
        unit=one.unit,
        used=float(one.used[worst]),
        time_share=time_share,
    )


def _merged(uses: list[Use]) -> Iterable[Use]:
    """Merge uses of the same quantity and axis: curvature limits both acceleration and jerk."""
    found: dict[tuple[Quantity, int | None], Use] = {}
    for use in sorted(uses, key=lambda use: use.used, reverse=True):
        key = use.quantity, use.axis
        share = found[key].time_share if key in found else 0.0
        found[key] = replace(found.get(key, use), time_share=share + use.time_share)
    return found.values()


def _limited_by(uses: list[Use], move: Move, planned: Planned, parameters: Parameters) -> Use:
    """Return the limit of a move."""
    whole = _limited_as_a_whole(move, planned, parameters)
    if whole is not None:
        return whole
    if move.kind in TIMED and uses[0].used < AT_LIMIT:
        return _time(Quantity.TIME, move)
    return uses[0]


def _limited_as_a_whole(move: Move, planned: Planned, parameters: Parameters) -> Use | None:
    """Return the limit that determines the duration of a whole move; None if there is none."""
    if move.kind in STANDING:
        return _time(Quantity.TIME, move)
    if _is_turn_at_limit(move, parameters):
        return _time(Quantity.ROTARY, move)
    if planned.rate < 1.0:
        axis, nominal = int(np.argmax(planned.rms_current_a)), parameters.motor.nominal_current_a
        rms = planned.rms_current_a[axis]
        return Use(
            quantity=Quantity.RMS_CURRENT,
            axis=axis + 1,
            peak=rms,
            limit=nominal,
            unit='A',
            used=rms / nominal,
            time_share=1.0,
        )
    return None


def _time(quantity: Quantity, move: Move) -> Use:
    """Return the use of a quantity that determines the duration of a move."""
    duration = move.duration_s
    return Use(
        quantity=quantity, axis=None, peak=duration, limit=duration, unit='s', used=1.0, time_share=1.0
    )


def _distances(part: _Part, parameters: Parameters) -> dict[str, float]:
    """Return the least distance of a move to each limit of the pose, by the keys of ``delta3 pose`` with units."""
    c = part.coefficients
    bounds = (
        *workspace_bounds(part.dynamics.position_m, parameters),
        *arm_bounds(c[:, THETA], c[:, SWING], c[:, SERIAL], c[:, PARALLEL], parameters),
    )
    return {bound.key + key_of_unit(bound.unit): float(bound.margin.min()) for bound in bounds}


def _piece(
    planned: Planned, part: _Part, parameters: Parameters, *, n: int, start_s: float, before_m: float
) -> Samples:
    """Return the samples of the ``n``-th move of the plan; ``before_m`` is the path length of the moves before it."""
    d, master = part.dynamics, _along_the_path(part, before_m)
    return Samples(
        time_s=start_s + part.times,
        move=np.full(part.times.shape, n + 1),
        distance_m=master[:, 0],
        speed_m_s=master[:, 1],
        acceleration_m_s2=master[:, 2],
        jerk_m_s3=master[:, 3],
        position_m=d.position_m,
        tcp_speed_m_s=d.tcp_speed_m_s,
        tcp_acceleration_m_s2=d.tcp_acceleration_m_s2,
        tcp_jerk_m_s3=d.tcp_jerk_m_s3,
        curvature_1_m=_curvature(part.samples),
        speed_limit_m_s=_limit(part, 0),
        acceleration_limit_m_s2=_limit(part, 1),
        jerk_limit_m_s3=_limit(part, 2),
        arm_angle_rad=part.coefficients[:, THETA],
        motor_speed_rad_s=d.motor_speed_rad_s,
        motor_torque_n_m=parameters.motor.torque_constant_n_m_a * d.motor_current_a,
        motor_current_a=d.motor_current_a,
        gear_torque_n_m=d.gear_torque_n_m,
        rod_force_n=part.forces.larger_rods_n,
        spring_force_n=part.forces.spring_n,
        plate_force_n=part.forces.plate_axial_n,
        plate_moment_n_m=part.forces.plate_moment_n_m,
        used={quantity: _used(part, quantity) for quantity in LIMITING},
        leading=_leading(part, planned),
    )


def _thinned(piece: Samples, stride: int) -> Samples:
    """Keep every ``stride``-th sample of a move, and the last."""
    if stride == 1:
        return piece
    count = len(piece.time_s)
    kept = np.append(np.arange(0, count - 1, stride), count - 1)
    return _mapped(lambda values: values[0][kept], [piece])


def _joined(pieces: list[Samples]) -> Samples:
    """Concatenate the samples of all moves."""
    return _mapped(np.concatenate, pieces)


def _mapped(change: Callable[[list[Floats]], Floats], pieces: Sequence[Samples]) -> Samples:
    """Apply a function to the arrays of several samples, field by field."""
    arrays = {
        one.name: change([getattr(piece, one.name) for piece in pieces])
        for one in fields(Samples)
        if one.name != 'used'
    }
    used = {quantity: change([piece.used[quantity] for piece in pieces]) for quantity in LIMITING}
    return Samples(**arrays, used=used)  # type: ignore[arg-type]  # mypy takes numbers of moves for floats


def _along_the_path(part: _Part, before_m: float) -> Floats:
    """Return distance since the start, speed, acceleration and jerk along the path, shape (n, 4)."""
    if part.move.kind == MoveKind.TURN:
        return np.asarray(np.zeros(part.master.shape) + np.array([before_m, 0.0, 0.0, 0.0]))
    if part.move.kind not in TIMED:
        return np.asarray(part.master + np.array([before_m, 0.0, 0.0, 0.0]))
    v = part.master[:, 1]
    # s' = |p'|, s'' = p'.p''/|p'|, s''' = (|p''|^2 + p'.p''' - s''^2)/|p'|
    _, p1, p2, p3 = (values * v[:, None] ** n for n, values in enumerate(np.moveaxis(part.samples, 1, 0)))
    speed = part.dynamics.tcp_speed_m_s
    with np.errstate(divide='ignore', invalid='ignore'):
        acceleration = (p1 * p2).sum(axis=1) / speed
        jerk = ((p2 * p2).sum(axis=1) + (p1 * p3).sum(axis=1) - acceleration**2) / speed
    return np.stack([before_m + _distance(speed, part.times), speed, acceleration, jerk], axis=1)


def _distance(speed: Floats, times: Floats) -> Floats:
    """Return the distance since the first sample [m] by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(np.diff(times) * 0.5 * (speed[1:] + speed[:-1]))])


def _curvature(samples: Floats) -> Floats:
    _, first, second, _ = np.moveaxis(samples, 1, 0)
    rate = np.linalg.norm(first, axis=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        bent = np.linalg.norm(np.cross(first, second), axis=1) / rate**3
    return np.where(rate > STANDING_M_S, bent, np.nan)


def _limit(part: _Part, k: int) -> Floats:
    """Return the k-th limit of the TCP; nan without a limit."""
    if part.limits is None:
        return np.full(part.times.shape, np.nan)
    return np.where(np.isfinite(part.limits[k]), part.limits[k], np.nan)


def _used(part: _Part, quantity: Quantity) -> Floats:
    own = [one.used for one in part.limiters if one.quantity == quantity]
    return np.asarray(np.maximum.reduce([np.zeros(part.times.shape), *own]))


def _leading(part: _Part, planned: Planned) -> NDArray[np.int64]:
    """Return the number of the leading quantity at each sample."""
    shape = part.times.shape
    if part.move.kind in STANDING:
        return np.full(shape, QUANTITIES.index(Quantity.TIME))
    if part.move.kind == MoveKind.TURN:
        return np.full(shape, QUANTITIES.index(Quantity.ROTARY))
    if planned.rate < 1.0:
        return np.full(shape, QUANTITIES.index(Quantity.RMS_CURRENT))
    numbers = np.array([QUANTITIES.index(one.quantity) for one in part.limiters])[part.leading]
    if part.move.kind in TIMED:
        used = np.maximum.reduce([one.used for one in part.limiters])
        return np.where(used >= AT_LIMIT, numbers, QUANTITIES.index(Quantity.TIME))
    return np.asarray(numbers)
