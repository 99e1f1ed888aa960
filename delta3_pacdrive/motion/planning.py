"""Planning of a program: statements become moves that are timed and checked as a whole before anything moves."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.motion import curves, timing
from delta3_pacdrive.motion.checks import Excess, Limits, check_arms, check_workspace, excess
from delta3_pacdrive.motion.curves import COINCIDENT_M, Curve
from delta3_pacdrive.motion.demand import (
    CENTRIFUGAL,
    INERTIAL,
    RATE,
    WEIGHT,
    Demand,
    path_demand,
    timed_demand,
)
from delta3_pacdrive.motion.master import end_acceleration, master_at_distances, plan_master, rest
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.plan import MOVES_MAX, OUTPUTS, Move, MoveKind, Plan
from delta3_pacdrive.motion.program import (
    Cubic,
    Dwell,
    MoveC,
    MoveL,
    MoveSB,
    Output,
    Point,
    Program,
    Statement,
    Target,
    point_text,
)
from delta3_pacdrive.motion.timeline import RATE_MAX
from delta3_pacdrive.parameters import Parameters

START_TOLERANCE_M = (
    1e-3  # how far the robot may stand from the start of a program; the first move begins there
)
MOVE_MAX_S = 3600.0
SHARES_MAX = 6  # halvings of the share of the acceleration that a jerk-limited master uses
WINDOW_MIN_S = 1e-3  # shortest time in which a smoothed master changes its acceleration
GRID_MIN, GRID_MAX, GRID_M, GRID_PER_PIECE = 97, 4001, 2.5e-3, 8
BEFORE = 1e-9  # of a move's length: distance between both sides of a place
END_REFINEMENTS = 7  # halvings of the grid towards both ends, where a master starts and stops
KEPT = 1.0 + 1e-3  # a limit is kept if time need not be stretched by more
NEARLY_KEPT = (
    1.0 + 5e-4
)  # what is left after planning with local limits is taken from the time of the whole move
ROUNDS_MAX = 8  # of planning with local limits, before all of the move is made slower
BEHIND_M = 1.0  # places an event behind the end of a move: it is due when the move is over
CURVATURE_SHARE, JERK_SHARE = 0.98, 0.8  # of the TCP's limits that may be used up by the path's bend alone


@dataclass(frozen=True)
class Leg:
    """One statement's stretch of a move: its curve, limits, and what it is called in sentences."""

    curve: Curve
    limits: Limits
    blend_m: float
    strict: bool
    kind: MoveKind
    name: str


@dataclass(frozen=True)
class Event:
    """An output or a payload that changes at a distance [m] on a move."""

    distance_m: float
    output: int
    value: float
    payload_kg: float | None


@dataclass(frozen=True)
class Effort:
    """What the rms current at any rate needs: integrals per motor, (3,) each [A^2 s], and times [s].

    Dwells are apart, because a program whose moves are slowed down dwells no longer.
    """

    moving: Floats
    mixed: Floats
    standing: Floats
    duration_s: float
    dwelling: Floats
    dwell_s: float
    rate_max: float  # at which every motor still keeps its limits

    def times(self, count: float) -> 'Effort':
        """Return the effort of doing it ``count`` times."""
        return Effort(
            count * self.moving,
            count * self.mixed,
            count * self.standing,
            count * self.duration_s,
            count * self.dwelling,
            count * self.dwell_s,
            self.rate_max,
        )

    def __add__(self, other: 'Effort') -> 'Effort':
        """Return the effort of doing one after the other."""
        return Effort(
            self.moving + other.moving,
            self.mixed + other.mixed,
            self.standing + other.standing,
            self.duration_s + other.duration_s,
            self.dwelling + other.dwelling,
            self.dwell_s + other.dwell_s,
            min(self.rate_max, other.rate_max),
        )

    def rms(self, rate: float, override: float = 1.0) -> Floats:
        """Rms current [A] of each motor, (3,), with moves planned at a rate and everything driven at an override."""
        r = rate * override
        square = r**4 * self.moving + 2.0 * r**2 * self.mixed + self.standing
        # a rate of 0 is the limit of slowness: then no dwell counts beside the moves
        dwells = rate if self.duration_s > 0.0 else 1.0
        square = np.maximum(square, 0.0) + dwells * self.dwelling
        return np.asarray(np.sqrt(square / (self.duration_s + dwells * self.dwell_s)))


@dataclass(frozen=True)
class Planned:
    """A program that is planned and checked.

    Attributes
    ----------
    name
        Of the program.
    plan
        Moves in the order in which they are driven.
    notices
        Sentences about moves that were slowed down: by how much, where, and by which limit.
    rms_current_a
        Of each motor over the whole program.
    rate_max
        Largest override at which every motor still keeps its limits.
    repeat
        How many rounds of its statements the plan holds.

    """

    name: str
    plan: Plan
    notices: tuple[str, ...]
    rms_current_a: tuple[float, float, float]
    rate_max: float
    repeat: int


@dataclass
class _Draft:
    """A move that is planned, with what the whole program needs to know about it."""

    move: Move
    effort: Effort
    notices: list[str] = field(default_factory=list)


def plan(program: Program, position_m: ArrayLike, parameters: Parameters) -> Planned:
    """Plan and check every move of a program for a robot that stands at ``position_m``.

    Raises
    ------
    ProgramError
        The robot stands elsewhere than the program starts, or a move breaks a limit; says which, how and where.

    """
    here = np.array(position_m, dtype=np.float64)
    if program.start_m is not None:
        distance = float(np.linalg.norm(here - program.start_m))
        if distance > START_TOLERANCE_M:
            raise ProgramError(
                f'program "{program.name}" starts at {point_text(program.start_m)} m, but the robot stands at '
                f'{point_text(here)} m, {distance * 1e3:.1f} mm away'
            )
    payload = parameters.dynamics.payload_mass_kg if program.payload_kg is None else program.payload_kg
    drafts: list[_Draft] = []
    order: list[int] = []
    known: dict[tuple[Point, float], tuple[list[int], Floats, float]] = {}
    for _ in range(program.repeat):
        key = ((float(here[0]), float(here[1]), float(here[2])), payload)
        if key not in known:
            round_ = _Round(program.statements, here, payload, parameters)
            numbers = []
            for draft in round_.drafts():
                numbers.append(len(drafts))
                drafts.append(draft)
            known[key] = numbers, round_.here, round_.payload
        numbers, here, payload = known[key]
        order.extend(numbers)
        if len(order) > MOVES_MAX:
            raise ProgramError(f'the program has more than {MOVES_MAX} moves')
    return _whole(program, drafts, order, parameters)


def _whole(program: Program, drafts: list[_Draft], order: list[int], parameters: Parameters) -> Planned:
    """Check what only the whole program shows, the rms current, and put the plan together."""
    counts = np.bincount(order, minlength=len(drafts))
    used = [n for n in range(len(drafts)) if counts[n]]
    if not used:
        raise ProgramError('the program moves nothing and takes no time')
    effort = drafts[used[0]].effort.times(counts[used[0]])
    for n in used[1:]:
        effort = effort + drafts[n].effort.times(counts[n])
    notices = [notice for draft in drafts for notice in draft.notices]
    nominal = parameters.motor.nominal_current_a
    moves = [draft.move for draft in drafts]
    rate = 1.0
    if effort.rms(1.0).max() > nominal:
        rate = _rate_for_rms(effort, nominal, program)
        moves = [_slower(move, 1.0 / rate) for move in moves]
        axis = int(np.argmax(effort.rms(1.0)))
        notices.append(
            f'all moves take {1.0 / rate:.3g} times as long: the rms current of motor {axis + 1} over the program '
            f'would be {effort.rms(1.0)[axis]:.4g} A, the limit is {nominal:g} A'
        )
    rate_max = min(effort.rate_max / rate, RATE_MAX)
    while rate_max > 1.0 and effort.rms(rate, rate_max).max() > nominal:
        rate_max = max(1.0, rate_max - 0.01)
    rms = effort.rms(rate).tolist()
    return Planned(
        program.name,
        Plan.of(moves, order),
        tuple(notices),
        (rms[0], rms[1], rms[2]),
        rate_max,
        program.repeat,
    )


def _rate_for_rms(effort: Effort, nominal: float, program: Program) -> float:
    """Return the largest rate at which the rms current is kept."""
    if effort.rms(0.0).max() >= nominal:
        raise ProgramError(
            f'program "{program.name}": the weight alone asks for an rms current of {effort.rms(0.0).max():.4g} A, '
            f'the limit is {nominal:g} A'
        )
    if any(getattr(statement, 'strict', False) for statement in program.statements):
        rms = effort.rms(1.0).max()
        raise ProgramError(
            f'program "{program.name}": the rms current would be {rms:.4g} A, the limit is {nominal:g} A (strict)'
        )
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effort.rms(middle).max() <= nominal else (low, middle)
    return low


def _slower(move: Move, factor: float) -> Move:
    return move if move.kind == MoveKind.DWELL else replace(move, master=timing.slowed(move.master, factor))


class _Round:
    """Planning of a program's statements once through."""

    def __init__(
        self, statements: tuple[Statement, ...], here: Floats, payload_kg: float, parameters: Parameters
    ) -> None:
        self._statements = statements
        self._parameters = parameters
        self.here, self.payload = here, payload_kg
        self._drafts: list[_Draft] = []
        self._legs: list[Leg] = []
        self._pending: list[tuple[int, Output]] = []  # outputs, with the number of legs before them
        self._cubics: list[tuple[Curve, str]] = []
        self._cubic_velocity: Floats = np.zeros(3)

    def drafts(self) -> list[_Draft]:
        """Plan all statements; raises ProgramError that names the statement."""
        for n, statement in enumerate(self._statements):
            where = f'moves[{n}]'
            try:
                self._take(statement, where)
            except (ProgramError, UnreachableError) as error:
                text = str(error)
                named = text.startswith('moves[')
                raise ProgramError(text if named else f'{where}.{_name(statement)}: {text}') from None
        self._end_cubics()
        if self._legs and self._legs[-1].blend_m > 0.0:
            raise ProgramError(f'{self._legs[-1].name}: blend_m needs a move that follows')
        self._end_move()
        if self._pending:
            self._attach_behind_the_last()
        return self._drafts

    def _take(self, statement: Statement, where: str) -> None:
        if not isinstance(statement, Cubic | Output):
            self._end_cubics()
        if isinstance(statement, Output):
            if np.abs(self._cubic_velocity).max() > 0.0:
                raise ProgramError('an output cannot stand between the cubics of a sequence')
            self._end_cubics()
            self._pending.append((len(self._legs), statement))
        elif isinstance(statement, Dwell):
            self._require_exact_stop()
            self._end_move()
            self._dwell(statement.time_s)
        elif isinstance(statement, Cubic):
            self._require_exact_stop()
            self._end_move()
            self._take_cubic(statement, where)
        else:
            self._take_leg(statement, where)

    def _require_exact_stop(self) -> None:
        if self._legs and self._legs[-1].blend_m > 0.0:
            raise ProgramError(f'{self._legs[-1].name} has blend_m, which needs a move that follows')

    def _take_leg(self, statement: MoveL | MoveC | MoveSB, where: str) -> None:
        if self._legs and self._legs[-1].blend_m == 0.0:
            self._end_move()
        curve, kind = _CURVES[type(statement)](self.here, statement)
        if curve.length_m < COINCIDENT_M:
            raise ProgramError(f'the robot already stands at {point_text(self.here)} m')
        name = f'{where}.{_name(statement)}'
        self._legs.append(Leg(curve, statement.limits, statement.blend_m, statement.strict, kind, name))
        self.here = curve.at(curve.length_m)[0]

    def _take_cubic(self, statement: Cubic, where: str) -> None:
        end = _resolve(statement.to, self.here)
        velocity = np.array(statement.end_velocity_m_s)
        curve = curves.timed_cubic(self.here, end, self._cubic_velocity, velocity, statement.duration_s)
        self._cubics.append((curve, f'{where}.cubic'))
        self.here, self._cubic_velocity = end, velocity

    def _end_cubics(self) -> None:
        """Time and check a sequence of cubics, which begins and ends at rest."""
        if not self._cubics:
            return
        sequence, self._cubics = self._cubics, []
        name = sequence[-1][1]
        if np.abs(self._cubic_velocity).max() > 0.0:
            raise ProgramError(
                f'{name}: the last cubic of a sequence must end with end_velocity_m_s [0, 0, 0]'
            )
        curve = curves.joined([one for one, _ in sequence])
        limits = self._parameters.motion
        bounds = Limits(limits.speed_max_m_s, limits.acceleration_max_m_s2, math.inf)
        events = self._take_outputs(0.0)
        self._append(_plan_cubic(curve, bounds, self.payload, name, self._parameters), events)

    def _dwell(self, time_s: float) -> None:
        curve = curves.point(self.here)
        samples = sample_path([0.0], curve.segments)
        _check_legal_samples(np.zeros(1), samples, self._parameters)
        events = self._take_outputs(0.0)
        times = np.zeros(1)
        d = _demand(
            times, np.zeros((1, 4)), samples, np.zeros(1, np.int64), (self.payload,), self._parameters
        )
        _require_holdable(excess(d, _NO_TCP_LIMITS, self._parameters, motors_only=True))
        square = d.standing_current_a[0] ** 2 * time_s
        effort = Effort(np.zeros(3), np.zeros(3), np.zeros(3), 0.0, square, time_s, RATE_MAX)
        move = Move(MoveKind.DWELL, rest(time_s), curve.segments, payload_kg=self.payload)
        self._append(_Draft(move, effort), events)

    def _end_move(self) -> None:
        """Join the legs with their blends, and time and check the move that they make."""
        legs, self._legs = self._legs, []
        if not legs:
            return
        curve, ends, stretches = _blended(legs)
        outputs, self._pending = self._pending, []
        payload = self.payload
        events = [self._event(output, count, ends, curve, legs) for count, output in outputs]
        for event in sorted(events, key=lambda event: event.distance_m):
            if event.payload_kg is not None:
                self.payload = event.payload_kg
        draft = _plan_move(legs, curve, stretches, events, payload, self._parameters)
        self._drafts.append(draft)

    def _event(self, output: Output, count: int, ends: list[float], curve: Curve, legs: list[Leg]) -> Event:
        distance = (ends[count - 1] if count else 0.0) - output.before_m
        if not -COINCIDENT_M <= distance <= curve.length_m:
            raise ProgramError(
                f'{legs[max(count - 1, 0)].name}: an output {output.before_m:g} m before its end would lie before the '
                f'start of the move, which is {curve.length_m:.4g} m long'
            )
        return Event(max(distance, 0.0), OUTPUTS.index(output.name), output.value, output.payload_kg)

    def _attach_behind_the_last(self) -> None:
        """Give outputs at the end of the program to the end of its last move."""
        if not self._drafts:
            raise ProgramError('an output needs a move or a dwell before it or after it')
        last = self._drafts.pop()
        self._append(last, self._take_outputs(last.move.length_m + BEHIND_M))

    def _take_outputs(self, distance: float) -> Floats:
        """Return outputs that wait for a move as events at a distance on it; their payload is carried from now on."""
        outputs, self._pending = [output for _, output in self._pending], []
        if any(output.before_m > 0.0 for output in outputs):
            raise ProgramError('before_m of an output needs a move right before it')
        for output in outputs:
            if output.payload_kg is not None:
                self.payload = output.payload_kg
        return _event_rows([Event(distance, OUTPUTS.index(o.name), o.value, o.payload_kg) for o in outputs])

    def _append(self, draft: _Draft, events: Floats) -> None:
        """Append a move with more events behind those that it has."""
        move = replace(draft.move, events=np.vstack([draft.move.events, events]))
        self._drafts.append(replace(draft, move=move))


def _name(statement: Statement) -> str:
    return {
        MoveL: 'move_l', MoveC: 'move_c', MoveSB: 'move_sb', Cubic: 'cubic', Dwell: 'dwell', Output: 'output'
    }[type(statement)]  # fmt: skip


def _resolve(target: Target, here: Floats) -> Floats:
    return here + np.array(target.point_m) if target.relative else np.array(target.point_m)


def _line_of(here: Floats, statement: MoveL) -> tuple[Curve, MoveKind]:
    return curves.line(here, _resolve(statement.to, here)), MoveKind.LINE


def _arc_of(here: Floats, statement: MoveC) -> tuple[Curve, MoveKind]:
    return curves.arc(here, _resolve(statement.via, here), _resolve(statement.to, here)), MoveKind.ARC


def _spline_of(here: Floats, statement: MoveSB) -> tuple[Curve, MoveKind]:
    points = [here]
    for target in statement.through:
        points.append(_resolve(target, points[-1]))
    return curves.spline(np.array(points)), MoveKind.SPLINE


_CURVES: dict[type, Callable[..., tuple[Curve, MoveKind]]] = {
    MoveL: _line_of,
    MoveC: _arc_of,
    MoveSB: _spline_of,
}


# geometry of a move ---------------------------------------------------------------------------------------------------


def _blended(legs: list[Leg]) -> tuple[Curve, list[float], list[tuple[float, Limits]]]:
    """Join legs with rounded corners.

    Returns the curve, the distance of each leg's end (the middle of its blend) on it, and stretches (end, limits).
    """
    pieces: list[Curve] = []
    ends: list[float] = []
    stretches: list[tuple[float, Limits]] = []
    length, cut = 0.0, 0.0
    for n, leg in enumerate(legs):
        radius = leg.blend_m if n + 1 < len(legs) else 0.0
        free = leg.curve.length_m - cut - radius
        if free < -COINCIDENT_M:
            raise ProgramError(
                f'{leg.name}: its blends overlap: {cut:g} m at its start and {radius:g} m at its end on a length of '
                f'{leg.curve.length_m:.4g} m'
            )
        if radius > 0.0 and radius > legs[n + 1].curve.length_m:
            raise ProgramError(
                f'{leg.name}: blend_m is {radius:g}, but the next move is only {legs[n + 1].curve.length_m:.4g} m long'
            )
        if free > COINCIDENT_M:
            pieces.append(leg.curve.part(cut, leg.curve.length_m - radius))
            length += pieces[-1].length_m
            stretches.append((length, leg.limits))
        if radius > 0.0:
            try:
                corner = curves.blend(leg.curve, legs[n + 1].curve, radius)
            except ProgramError as error:
                raise ProgramError(f'{leg.name}: {error}') from None
            pieces.append(corner)
            ends.append(length + 0.5 * corner.length_m)
            length += corner.length_m
            stretches.append((length, _lower(leg.limits, legs[n + 1].limits)))
        else:
            ends.append(length)
        cut = radius
    curve = curves.joined(pieces) if len(pieces) > 1 else pieces[0]
    return curve, ends, stretches


def _lower(a: Limits, b: Limits) -> Limits:
    return Limits(
        min(a.speed_m_s, b.speed_m_s),
        min(a.acceleration_m_s2, b.acceleration_m_s2),
        min(a.jerk_m_s3, b.jerk_m_s3),
    )


def _grid(curve: Curve) -> Floats:
    """Distances at which a move is checked: even within each piece of the path, finer towards both ends of the move."""
    edges = np.append(curve.segments[:, 0], curve.length_m)
    lengths = np.diff(edges)
    step = curve.length_m / min(max(GRID_MIN, curve.length_m / GRID_M), GRID_MAX)
    counts = np.maximum(np.ceil(lengths / step), GRID_PER_PIECE).astype(int)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    inner = (np.repeat(edges[:-1], counts) + number * np.repeat(lengths / counts, counts))[1:]
    refined = min(inner[0], curve.length_m - inner[-1]) * 0.5 ** np.arange(END_REFINEMENTS, 0, -1)
    return np.concatenate([edges[:1], refined, inner, curve.length_m - refined[::-1], edges[-1:]])


def _check_legal_samples(distance: Floats, samples: Floats, parameters: Parameters) -> None:
    check_workspace(distance, samples[:, 0], parameters)
    coefficients = path_demand(
        samples, np.zeros(len(samples), np.int64), (parameters.dynamics.payload_mass_kg,), parameters
    )
    check_arms(distance, samples[:, 0], coefficients, parameters)


# timing of a move -----------------------------------------------------------------------------------------------------

_NO_TCP_LIMITS = (np.array(np.inf), np.array(np.inf), np.array(np.inf))


def _demand(
    times: Floats,
    master: Floats,
    samples: Floats,
    payload: NDArray[np.int64],
    payloads: tuple[float, ...],
    parameters: Parameters,
) -> Demand:
    return timed_demand(
        times, master, samples, path_demand(samples, payload, payloads, parameters), parameters
    )


def _require_holdable(found: Excess) -> None:
    if not math.isfinite(found.worst):
        raise ProgramError(f'{found.text}, even at standstill')


def _require_end_of_time(duration_s: float) -> None:
    if not duration_s <= MOVE_MAX_S:
        raise ProgramError(f'it would take {duration_s:.3g} s, the limit is {MOVE_MAX_S:g} s')


def _event_rows(events: list[Event]) -> Floats:
    rows = [(e.distance_m, e.output, e.value, -1.0 if e.payload_kg is None else e.payload_kg) for e in events]
    return np.array(sorted(rows, key=lambda row: row[0]), dtype=np.float64).reshape(-1, 4)


class Timing:
    """Timing of one move: its grid, what the path asks there, and the limits that hold there."""

    def __init__(
        self,
        curve: Curve,
        stretches: list[tuple[float, Limits]],
        events: list[Event],
        payload_kg: float,
        parameters: Parameters,
    ) -> None:
        self.curve, self._parameters = curve, parameters
        self.distance = _grid(curve)
        self.places = _both_sides(self.distance)
        self.samples = sample_path(self.places, curve.segments)
        changes = [e for e in sorted(events, key=lambda e: e.distance_m) if e.payload_kg is not None]
        self._payloads = (payload_kg, *[float(e.payload_kg) for e in changes if e.payload_kg is not None])
        index = np.searchsorted([e.distance_m for e in changes], self.places, side='right')
        check_workspace(self.places, self.samples[:, 0], parameters)
        self._coefficients = path_demand(self.samples, index, self._payloads, parameters)
        check_arms(self.places, self.samples[:, 0], self._coefficients, parameters)
        where = np.searchsorted([end for end, _ in stretches], self.places, side='left')
        each = [stretches[min(n, len(stretches) - 1)][1] for n in where]
        self.speed = np.array([limits.speed_m_s for limits in each])
        self.acceleration = np.array([limits.acceleration_m_s2 for limits in each])
        self.jerk = np.array([limits.jerk_m_s3 for limits in each])

    def demand(self, phases: Floats) -> Demand:
        """Evaluate a master on both sides of the places of the grid."""
        passed = master_at_distances(self.places, phases)
        master = np.ascontiguousarray(passed[:, 1:])
        # the end is reached, as the start is left, with the acceleration and the jerk of the phase beside it
        master[-1, 2], master[-1, 3] = end_acceleration(phases), phases[-2, 4]
        return timed_demand(passed[:, 0], master, self.samples, self._coefficients, self._parameters)

    def excess(self, demand: Demand, motors_only: bool = False) -> Excess:
        """Compare a demand with the limits of the grid."""
        return excess(demand, (self.speed, self.acceleration, self.jerk), self._parameters, motors_only)

    def place_limits(self, with_motors: bool, speed: Floats, acceleration: Floats) -> timing.PlaceLimits:
        """Limits of every place for ``timing``."""
        motor, coefficients = self._parameters.motor, self._coefficients[::2]
        second = np.linalg.norm(self.samples[::2, 2], axis=1)
        third = _worse(np.linalg.norm(self.samples[:, 3], axis=1))
        with np.errstate(divide='ignore'):
            caps = [
                speed,
                np.sqrt(CURVATURE_SHARE * acceleration / second),
                (JERK_SHARE * self.jerk[::2] / third) ** (1.0 / 3.0),
            ]
        torque = np.full((len(speed), 3), np.inf)
        if with_motors:
            shaft = np.abs(coefficients[:, RATE]) * self._parameters.dynamics.gear_ratio
            emf = motor.torque_constant_n_m_a / 3.0
            drop = motor.winding_resistance_ohm / 2.0 * motor.nominal_current_a
            voltage_speed = (self._parameters.drive.dc_link_voltage_v / np.sqrt(6.0) - drop) / emf
            highest = min(motor.max_speed_rad_s, voltage_speed)
            with np.errstate(divide='ignore'):
                caps.append((highest / shaft).min(axis=1))
            fastest = np.minimum.reduce(caps)[:, None]
            friction = motor.static_friction_n_m + motor.viscous_friction_n_m_s_rad * shaft * fastest
            torque = motor.torque_constant_n_m_a * motor.peak_current_a - friction
        return timing.PlaceLimits(
            self.distance,
            np.minimum.reduce(caps),
            acceleration,
            second,
            np.ascontiguousarray(coefficients[:, INERTIAL]),
            np.ascontiguousarray(coefficients[:, CENTRIFUGAL]),
            np.ascontiguousarray(coefficients[:, WEIGHT]),
            torque,
        )

    def fastest(self, with_motors: bool) -> Floats:
        """Phases of the fastest master within the limits of every place.

        A jerk-limited master on a short way cannot use all of the acceleration, and is faster if it does not try to.
        """
        jerk, most = float(self.jerk.min()), float(self.acceleration.max())
        if not math.isfinite(jerk):
            return self._fastest(with_motors, 1.0)
        # the peak of the acceleration of a free master from rest to rest over this length
        share = min(float(np.cbrt(0.5 * jerk**2 * self.curve.length_m)) / most, 1.0)
        best = self._fastest(with_motors, share)
        for _ in range(SHARES_MAX):
            share *= 0.5
            other = self._fastest(with_motors, share)
            if other[-1, 0] >= best[-1, 0]:
                break
            best = other
        return best

    def _fastest(self, with_motors: bool, share: float) -> Floats:
        """Phases of the fastest master that uses no more than a share of the acceleration."""
        speed, acceleration = self.speed[::2].copy(), share * self.acceleration[::2]
        jerk = float(self.jerk.min())
        window = max(float(acceleration.max()) / jerk, WINDOW_MIN_S) if math.isfinite(jerk) else 0.0
        best, chosen = math.inf, np.empty((0, 5))
        for _ in range(ROUNDS_MAX):
            profile = timing.fastest(self.place_limits(with_motors, speed, acceleration), window)
            if not len(profile) or not profile[1:-1].all():
                _require_holdable(self.excess(self._standing(), motors_only=True))
                raise ProgramError('a motor cannot hold the arm somewhere on the path')
            _require_end_of_time(timing.duration(self.distance, profile) + window)
            phases, jerk_found = timing.smoothed(self.distance, profile, jerk, window)
            found = (
                self.excess(self.demand(phases), motors_only=False)
                if with_motors
                else self._tcp_excess(phases)
            )
            stretch = np.maximum(_worse(found.stretch), self._stretch_at_joints(phases))
            factor = max(
                float(stretch.max()), (jerk_found / jerk) ** (1.0 / 3.0) if math.isfinite(jerk) else 1.0, 1.0
            )
            if not math.isfinite(factor):
                raise ProgramError(found.text)
            if factor < best:
                best, chosen = factor, phases
            if factor <= NEARLY_KEPT:
                break
            window *= max(jerk_found / jerk, 1.0) if math.isfinite(jerk) else 1.0
            relief = timing.widened(self.distance, _spread(np.maximum(stretch, 1.0)), profile, window)
            speed /= relief
            acceleration /= relief**2
        return timing.slowed(chosen, best)

    def _standing(self) -> Demand:
        """Evaluate standstill at every place of the grid."""
        master = np.zeros((len(self.places), 4))
        master[:, 0] = self.places
        return timed_demand(master[:, 1], master, self.samples, self._coefficients, self._parameters)

    def _tcp_excess(self, phases: Floats) -> Excess:
        d = self.demand(phases)
        total = np.maximum.reduce(
            [
                d.tcp_speed_m_s / self.speed,
                np.sqrt(d.tcp_acceleration_m_s2 / self.acceleration),
                np.cbrt(d.tcp_jerk_m_s3 / self.jerk),
            ]
        )
        return Excess(total, '')

    def _stretch_at_joints(self, phases: Floats) -> Floats:
        """Factor of time that the TCP's limits ask for where phases meet, given to the places of the grid around."""
        t, s, v = np.diff(phases[:, 0]), phases[1:-1, 1], phases[1:-1, 2]
        _, first, second, third = np.moveaxis(sample_path(s, self.curve.segments), 1, 0)
        after = np.searchsorted(self.distance, s).clip(1, len(self.distance) - 1)
        limit = 2 * after  # the same place among those of both sides
        stretch = np.ones(len(self.distance))
        end = phases[:-1, 3] + t * phases[:-1, 4]
        for a, j in ((phases[1:-1, 3], phases[1:-1, 4]), (end[:-1], phases[:-2, 4])):
            acceleration = np.linalg.norm(first * a[:, None] + second * v[:, None] ** 2, axis=1)
            change = first * j[:, None] + 3.0 * second * (v * a)[:, None] + third * v[:, None] ** 3
            needed = np.maximum(
                np.sqrt(acceleration / self.acceleration[limit]),
                np.cbrt(np.linalg.norm(change, axis=1) / self.jerk[limit]),
            )
            np.maximum.at(stretch, after, needed)
            np.maximum.at(stretch, after - 1, needed)
        return stretch

    def effort(self, phases: Floats) -> Effort:
        """Sum up what a master asks of the motors."""
        d = self.demand(phases)
        weights = np.gradient(d.time_s) if len(d.time_s) > 1 else np.ones(1)
        return _effort(d, weights, float(phases[-1, 0]), self._parameters)


def _both_sides(distance: Floats) -> Floats:
    """Return every place of a grid and, but for the first, the place right before it.

    Where a piece of the path or a phase of the master ends, acceleration and jerk differ on both sides.
    """
    before = np.maximum(distance[1:] - BEFORE * distance[-1], 0.5 * (distance[1:] + distance[:-1]))
    return np.concatenate([distance[:1], np.stack([before, distance[1:]], axis=1).ravel()])


def _worse(values: Floats) -> Floats:
    """Return the larger of the values on both sides of each place of a grid."""
    return np.concatenate([values[:1], np.maximum(values[1::2], values[2::2])])


def _spread(relief: Floats) -> Floats:
    """Return the larger of each value and its neighbours: a limit that moves a little still meets its place."""
    padded = np.pad(relief, 2, mode='edge')
    return np.asarray(np.maximum.reduce([padded[n : n + len(relief)] for n in range(5)]))


def _effort(d: Demand, weights: Floats, duration_s: float, parameters: Parameters) -> Effort:
    standing = d.standing_current_a
    moving = d.motor_current_a - standing
    motor = parameters.motor
    w = weights[:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        room = np.maximum(motor.peak_current_a - np.abs(standing), 1e-12) / np.abs(moving)
        speed = motor.max_speed_rad_s / np.abs(d.motor_speed_rad_s)
        volts = parameters.drive.dc_link_voltage_v / np.sqrt(6.0) / np.abs(d.phase_voltage_v)
    rate_max = min(float(np.sqrt(room).min()), float(speed.min()), float(np.sqrt(volts).min()), RATE_MAX)
    return Effort(
        (w * moving**2).sum(axis=0),
        (w * moving * standing).sum(axis=0),
        (w * standing**2).sum(axis=0),
        duration_s,
        np.zeros(3),
        0.0,
        max(rate_max, 1.0),
    )


def _plan_move(
    legs: list[Leg],
    curve: Curve,
    stretches: list[tuple[float, Limits]],
    events: list[Event],
    payload_kg: float,
    parameters: Parameters,
) -> _Draft:
    """Time one move and check it."""
    name = legs[0].name if len(legs) == 1 else f'{legs[0].name} to {legs[-1].name}'
    try:
        plan_ = Timing(curve, stretches, events, payload_kg, parameters)
        wish = legs[0].limits
        if len(legs) == 1:
            phases = plan_master(curve.length_m, wish.speed_m_s, wish.acceleration_m_s2, wish.jerk_m_s3)
        else:
            phases = plan_.fastest(with_motors=False)
        asked = float(phases[-1, 0])
        notices = []
        found = plan_.excess(plan_.demand(phases))
        if found.worst > KEPT:
            if any(leg.strict for leg in legs):
                raise ProgramError(f'{found.text} (strict)')
            phases = plan_.fastest(with_motors=True)
            taken = float(phases[-1, 0])
            notices.append(f'{name} is slowed down, {taken:.4g} s instead of {asked:.4g} s: {found.text}')
        _require_end_of_time(float(phases[-1, 0]))
    except (ProgramError, UnreachableError) as error:
        raise ProgramError(f'{name}: {error}') from None
    jerk = min(limits.jerk_m_s3 for _, limits in stretches)
    move = Move(
        legs[0].kind if len(legs) == 1 else MoveKind.BLENDED,
        phases,
        curve.segments,
        min(limits.acceleration_m_s2 for _, limits in stretches),
        jerk,
        payload_kg,
        _event_rows(events),
    )
    return _Draft(move, plan_.effort(phases), notices)


def _plan_cubic(curve: Curve, limits: Limits, payload_kg: float, name: str, parameters: Parameters) -> _Draft:
    """Check a sequence of cubics in time (chapter 5), and slow it down as a whole if a motor asks for that."""
    duration = curve.length_m
    times = np.linspace(0.0, duration, min(max(GRID_MIN, int(duration / 2e-3)), GRID_MAX))
    samples = sample_path(times, curve.segments)
    try:
        _check_legal_samples(times, samples, parameters)
        master = np.zeros((len(times), 4))
        master[:, 0], master[:, 1] = times, 1.0
        d = _demand(times, master, samples, np.zeros(len(times), np.int64), (payload_kg,), parameters)
        found = excess(d, _NO_TCP_LIMITS, parameters, motors_only=True)
        _require_holdable(found)
    except (ProgramError, UnreachableError) as error:
        raise ProgramError(f'{name}: {error}') from None
    factor, notices = 1.0, []
    if found.worst > KEPT:
        factor = found.worst
        notices.append(
            f'{name} is slowed down, {duration * factor:.4g} s instead of {duration:.4g} s: {found.text}'
        )
    phases = timing.slowed(np.array([[0.0, 0.0, 1.0, 0.0, 0.0], [duration, duration, 0.0, 0.0, 0.0]]), factor)
    speed = max(float(d.tcp_speed_m_s.max()), 1e-6)
    move = Move(
        MoveKind.CUBIC, phases, curve.segments, limits.acceleration_m_s2 / speed, math.inf, payload_kg
    )
    effort = _effort(d, np.gradient(times), duration, parameters)
    if factor > 1.0:
        effort = replace(
            effort,
            moving=effort.moving / factor**3,
            mixed=effort.mixed / factor,
            standing=effort.standing * factor,
            duration_s=duration * factor,
            rate_max=1.0,
        )
    return _Draft(move, effort, notices)
