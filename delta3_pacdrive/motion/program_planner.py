"""Planning of a program: statements become moves that are timed and checked as a whole before anything moves."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.configuration.checked import Errors, Refusal
from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.motion import curves, time_parametrization
from delta3_pacdrive.motion.blending import Leg, blended
from delta3_pacdrive.motion.curves import COINCIDENT_M, Curve
from delta3_pacdrive.motion.execution import RATE_MAX
from delta3_pacdrive.motion.limits import Limits, excess
from delta3_pacdrive.motion.move_planner import (
    NO_TCP_LIMITS,
    Draft,
    Effort,
    Event,
    check_legal_samples,
    demand_at,
    event_rows,
    plan_cubic,
    plan_move,
    require_holdable,
)
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.plan import MOVES_MAX, OUTPUTS, Move, MoveKind, Plan
from delta3_pacdrive.motion.program import (
    Cubic,
    Dwell,
    MoveC,
    MoveL,
    MoveSB,
    Output,
    Program,
    Statement,
    Target,
    point_text,
)
from delta3_pacdrive.motion.virtual_master import rest
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

SAME_DECIMALS = 9  # of two starts [m] that are one
START_TOLERANCE_M = (
    1e-3  # how far the robot may stand from the start of a program; the first move begins there
)
BEHIND_M = 1.0  # places an event behind the end of a move: it is due when the move is over


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
        Sentences about moves that were slowed down (by how much, where, and by which limit) and about faults that
        are due after the end.
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


def plan(
    program: Program,
    position_m: ArrayLike,
    parameters: Parameters,
    returning: bool = False,
    open_end: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Planned:
    """Plan and check every move of a program for a robot that stands at ``position_m``.

    With ``returning`` the first move may begin beyond limits, if it leads back (see ``checks``). With ``open_end``
    other moves may follow later: the last one may have a blend, and ends exactly as long as none does. ``progress`` is
    called before each statement that is planned with the number of those done and of all.

    Raises
    ------
    ProgramError
        The robot stands elsewhere than the program starts, or moves break limits; says which, how and where, up to ten.

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
    drafts: list[Draft] = []
    order: list[int] = []
    open_notices: list[str] = []
    known: dict[tuple[tuple[float, ...], float], tuple[list[int], Floats, float]] = {}
    for round_number in range(program.repeat):
        # rounds that begin a rounding error apart are the same
        key = (tuple(np.round(here, SAME_DECIMALS).tolist()), payload)
        if key not in known:
            last = open_end and round_number + 1 == program.repeat
            round_ = _Round(program, here, payload, parameters, returning and not order, last, progress)
            numbers = []
            for draft in round_.drafts():
                numbers.append(len(drafts))
                drafts.append(draft)
            open_notices = round_.notices
            known[key] = numbers, round_.here, round_.payload
        numbers, here, payload = known[key]
        order.extend(numbers)
        if len(order) > MOVES_MAX:
            raise ProgramError(f'the program has more than {MOVES_MAX} moves')
    return _whole(program, drafts, order, parameters, open_notices)


def capped(program: Program, caps: tuple[float, float, float]) -> Program:
    """Return a program none of whose moves exceeds a speed, an acceleration and a jerk; 0: no cap.

    Raises
    ------
    ProgramError
        A cubic has its times, which no cap can keep.

    """
    speed, acceleration, jerk = (cap or math.inf for cap in caps)
    statements: list[Statement] = []
    for n, statement in enumerate(program.statements):
        if isinstance(statement, Cubic):
            raise ProgramError(f'moves[{n}].cubic: its duration is fixed, it takes no cap of speed')
        if isinstance(statement, MoveL | MoveC | MoveSB):
            own = statement.limits
            limits = Limits(
                min(own.speed_m_s, speed), min(own.acceleration_m_s2, acceleration), min(own.jerk_m_s3, jerk)
            )
            statements.append(replace(statement, limits=limits))
        else:
            statements.append(statement)
    return replace(program, statements=tuple(statements))


def _whole(
    program: Program,
    drafts: list[Draft],
    order: list[int],
    parameters: Parameters,
    open_notices: list[str],
) -> Planned:
    """Check what only the whole program shows, the rms current, and put the plan together."""
    counts = np.bincount(order, minlength=len(drafts))
    used = [n for n in range(len(drafts)) if counts[n]]
    if not used:
        raise ProgramError('the program moves nothing and takes no time')
    effort = drafts[used[0]].effort.times(counts[used[0]])
    for n in used[1:]:
        effort = effort + drafts[n].effort.times(counts[n])
    notices = [notice for draft in drafts for notice in draft.notices] + open_notices
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
    plan_ = Plan.of(moves, order)
    notices += [
        f'{fault.text} is due {fault.after_s:g} s after the start, the program takes {plan_.duration_s:.4g} s at 100 %'
        for fault in program.faults
        if fault.after_s > plan_.duration_s
    ]
    return Planned(
        program.name,
        plan_,
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
    return (
        move
        if move.kind == MoveKind.DWELL
        else replace(move, master=time_parametrization.slowed(move.master, factor))
    )


class _Round:
    """Planning of a program's statements once through."""

    def __init__(
        self,
        program: Program,
        here: Floats,
        payload_kg: float,
        parameters: Parameters,
        returning: bool,
        open_end: bool,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self._statements, self._places = program.statements, program.places
        self._errors = Errors(program.source)
        self._failed = False  # whether anything could not be planned
        self._broken = False  # whether that was the last move
        self._open_end, self._progress = open_end, progress
        self.notices: list[str] = []
        self._returning = returning  # whether the first move may begin beyond limits
        self._parameters = parameters
        self.here, self.payload = here, payload_kg
        self._drafts: list[Draft] = []
        self._legs: list[Leg] = []
        self._pending: list[tuple[int, Output]] = []  # outputs, with the number of legs before them
        self._cubics: list[tuple[Curve, str]] = []
        self._cubic_velocity: Floats = np.zeros(3)

    def drafts(self) -> list[Draft]:
        """Plan all statements; raises ProgramError that names those that cannot be planned, up to ten.

        Behind a statement that cannot be planned planning goes on where that would have ended.
        """
        with self._errors.raised_as(ProgramError):
            for n, statement in enumerate(self._statements):
                if self._progress is not None:
                    self._progress(n, len(self._statements))
                where = f'moves[{n}].{_name(statement)}'
                with self._noted(where):
                    self._end_before(statement)
                end = _end_of(statement, self.here)
                with self._noted(where):
                    self._take(statement, where)
                if self._broken:
                    self.here = end
            with self._noted(where):
                self._end()
        return self._drafts

    @contextmanager
    def _noted(self, where: str) -> Iterator[None]:
        """Note why a statement cannot be planned, and forget the move that it belongs to."""
        try:
            yield
        except (ProgramError, UnreachableError) as error:
            text = str(error) if str(error).startswith('moves[') else f'{where}: {error}'
            number = int(text[len('moves[') : text.index(']')])
            self._legs, self._pending, self._cubics = [], [], []
            self._cubic_velocity = np.zeros(3)
            self._broken = self._failed = True
            self._errors.add(Refusal(text), self._places[number] if self._places else None)

    def _end_before(self, statement: Statement) -> None:
        """End the move before a statement, if that does not go on with it."""
        if not isinstance(statement, Cubic | Output):
            self._end_cubics()
        if isinstance(statement, Dwell | Cubic):
            if self._legs and self._legs[-1].blend_m > 0.0:
                raise ProgramError(f'{self._legs[-1].name} has blend_m, which needs a move that follows')
            self._end_move()
        elif not isinstance(statement, Output) and self._legs and self._legs[-1].blend_m == 0.0:
            self._end_move()

    def _end(self) -> None:
        """End the last move."""
        self._end_cubics()
        if self._legs and self._legs[-1].blend_m > 0.0:
            name = f'{self._legs[-1].name}: blend_m'
            if not self._open_end:
                raise ProgramError(f'{name} needs a move that follows')
            self.notices.append(f'{name} waits for a move that follows; without one it ends exactly')
        self._end_move()
        if self._pending and not self._failed:
            self._attach_behind_the_last()

    def _take(self, statement: Statement, where: str) -> None:
        if isinstance(statement, Output):
            self._take_output(statement)
            return
        self._broken = False
        if isinstance(statement, Dwell):
            self._dwell(statement.time_s)
        elif isinstance(statement, Cubic):
            self._take_cubic(statement, where)
        else:
            self._take_leg(statement, where)

    def _take_output(self, output: Output) -> None:
        if np.abs(self._cubic_velocity).max() > 0.0:
            raise ProgramError('an output cannot stand between the cubics of a sequence')
        self._end_cubics()
        if not self._broken:
            self._pending.append((len(self._legs), output))
        elif output.payload_kg is not None:  # there is no move that it could belong to
            self.payload = output.payload_kg

    def _take_leg(self, statement: MoveL | MoveC | MoveSB, name: str) -> None:
        curve, kind = _CURVES[type(statement)](self.here, statement)
        if curve.length_m < COINCIDENT_M:
            raise ProgramError(f'the robot already stands at {point_text(self.here)} m')
        self._legs.append(Leg(curve, statement.limits, statement.blend_m, statement.strict, kind, name))
        self.here = curve.at(curve.length_m)[0]

    def _take_cubic(self, statement: Cubic, name: str) -> None:
        end = _resolve(statement.to, self.here)
        velocity = np.array(statement.end_velocity_m_s)
        curve = curves.timed_cubic(self.here, end, self._cubic_velocity, velocity, statement.duration_s)
        self._cubics.append((curve, name))
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
        returning = self._returning and not self._drafts and not self._failed
        draft = plan_cubic(curve, bounds, self.payload, name, self._parameters, returning)
        self._append(draft, events)

    def _dwell(self, time_s: float) -> None:
        curve = curves.point(self.here)
        samples = sample_path([0.0], curve.segments)
        check_legal_samples(np.zeros(1), samples, self._parameters)
        events = self._take_outputs(0.0)
        times = np.zeros(1)
        d = demand_at(
            times, np.zeros((1, 4)), samples, np.zeros(1, np.int64), (self.payload,), self._parameters
        )
        require_holdable(excess(d, NO_TCP_LIMITS, self._parameters, motors_only=True))
        square = d.standing_current_a[0] ** 2 * time_s
        effort = Effort(np.zeros(3), np.zeros(3), np.zeros(3), 0.0, square, time_s, RATE_MAX)
        move = Move(MoveKind.DWELL, rest(time_s), curve.segments, payload_kg=self.payload)
        self._append(Draft(move, effort), events)

    def _end_move(self) -> None:
        """Join the legs with their blends, and time and check the move that they make."""
        legs, self._legs = self._legs, []
        if not legs:
            return
        curve, ends, stretches = blended(legs)
        outputs, self._pending = self._pending, []
        payload = self.payload
        events = [self._event(output, count, ends, curve, legs) for count, output in outputs]
        for event in sorted(events, key=lambda event: event.distance_m):
            if event.payload_kg is not None:
                self.payload = event.payload_kg
        returning = self._returning and not self._drafts and not self._failed
        draft = plan_move(legs, curve, stretches, events, payload, self._parameters, returning)
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
        return event_rows([Event(distance, OUTPUTS.index(o.name), o.value, o.payload_kg) for o in outputs])

    def _append(self, draft: Draft, events: Floats) -> None:
        """Append a move with more events behind those that it has."""
        move = replace(draft.move, events=np.vstack([draft.move.events, events]))
        self._drafts.append(replace(draft, move=move))


def _name(statement: Statement) -> str:
    return {
        MoveL: 'move_l', MoveC: 'move_c', MoveSB: 'move_sb', Cubic: 'cubic', Dwell: 'dwell', Output: 'output'
    }[type(statement)]  # fmt: skip


def _end_of(statement: Statement, here: Floats) -> Floats:
    """Return where a robot stands behind a statement."""
    if isinstance(statement, MoveSB):
        for target in statement.through:
            here = _resolve(target, here)
        return here
    return here if isinstance(statement, Dwell | Output) else _resolve(statement.to, here)


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
