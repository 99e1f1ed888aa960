"""Planning of a program's statements once through: they become moves, with their outputs and payloads."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.configuration.checked import Errors, Refusal
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import curves
from delta3_pacdrive.motion.arch import Clearances, best_arch
from delta3_pacdrive.motion.blending import PathSegment, StatementError, blamed_on, blended, name_of
from delta3_pacdrive.motion.curves import COINCIDENT_M, Curve
from delta3_pacdrive.motion.joint_trajectory import plan_joints
from delta3_pacdrive.motion.plan import OUTPUTS, MoveKind
from delta3_pacdrive.motion.planned_move import (
    Event,
    PlannedMove,
    event_rows,
    plan_cubic,
    plan_dwell,
    plan_move,
)
from delta3_pacdrive.motion.program import (
    Aim,
    Arch,
    Cubic,
    Dwell,
    Joints,
    MoveC,
    MoveL,
    MoveSB,
    Output,
    PathMove,
    Program,
    Statement,
    Target,
    point_text,
)
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

# shapes of arches that are known: by statement, start, end and payload
Arches = dict[tuple[Arch, tuple[float, ...], tuple[float, ...], float], Curve]
POINT_DECIMALS = 9  # of points [m] that are one
JOINED_MAX = 300  # moves that blends may join to one over several rounds
BEHIND_M = 1.0  # places an event behind the end of a move: it is due when the move is over


@dataclass(frozen=True)
class Part:
    """Statements of a program that are planned together, by their numbers; a blend at their end may be left out."""

    numbers: tuple[int, ...]
    ends_exactly: bool = False


def whole(program: Program) -> Part:
    """Return all statements of a program."""
    return Part(tuple(range(len(program.statements))))


def parts(program: Program) -> list[Part]:
    """Return what is planned one after the other to drive all rounds of a program.

    That is each round by itself, unless a blend joins the end of each round to the begin of the next: then it is what
    comes before the first stop, what lies between two stops of neighbouring rounds, and what follows the last one.

    Raises
    ------
    ProgramError
        It stops nowhere, and is too long to be one move.

    """
    statements, rounds = program.statements, program.repeat
    numbers = tuple(range(len(statements)))
    moving = [n for n in numbers if not isinstance(statements[n], Output)]
    if rounds == 1 or not moving or not _goes_on(statements[moving[-1]]):
        return [whole(program)] * rounds
    if not isinstance(statements[moving[0]], PathMove):
        return [whole(program)] * rounds  # which is refused: nothing follows that blend
    stops = [n for n in moving if not _goes_on(statements[n])]
    if not stops:
        if len(moving) * rounds > JOINED_MAX:
            raise ProgramError(
                f'the program rounds every corner: {len(moving)} moves in {rounds} rounds would be one move, '
                f'the limit is {JOINED_MAX}; let one of them end exactly'
            )
        return [Part(numbers * rounds, ends_exactly=True)]
    first = stops[0] + 1
    while first < len(statements) and isinstance(statements[first], Output):
        first += 1
    before, behind = numbers[:first], numbers[first:]
    return [Part(before), *[Part(behind + before)] * (rounds - 1), Part(behind, ends_exactly=True)]


def _goes_on(statement: Statement) -> bool:
    """Whether a statement ends in a blend."""
    return isinstance(statement, PathMove) and statement.blend_m > 0.0


class RoundPlanner:
    """Planner of a program's statements once through, or of a part of them."""

    def __init__(
        self,
        program: Program,
        here: Floats,
        payload_kg: float,
        parameters: Parameters,
        returning: bool,
        open_end: bool,
        progress: Callable[[int, int], None] | None,
        heat: float = 0.0,
        arches: Arches | None = None,
        part: Part | None = None,
    ) -> None:
        self._part = whole(program) if part is None else part
        self._statements, self._places = program.statements, program.places
        self._errors = Errors(program.source)
        self._failed = False  # whether anything could not be planned
        self._broken = False  # whether that was the last move
        self._open_end, self._progress = open_end, progress
        self._arches: Arches = {} if arches is None else arches
        self._heat = heat  # what the warmth of the motors weighs beside the time of time-optimal moves
        self.notices: list[str] = []
        self._returning = returning  # whether the first move may begin beyond limits
        self._parameters = parameters
        self.here, self.payload = here, payload_kg
        self._planned: list[PlannedMove] = []
        self._segments: list[PathSegment] = []
        self._pending: list[tuple[int, Output]] = []  # outputs, with the number of segments before them
        self._cubics: list[tuple[Curve, int, str]] = []
        self._cubic_velocity: Floats = np.zeros(3)
        self.open_from: int | None = None  # first statement of a last move that a blend keeps open

    def planned(self) -> list[PlannedMove]:
        """Plan all statements; raises ProgramError that names those that cannot be planned, up to ten.

        Behind a statement that cannot be planned planning goes on where that would have ended.
        """
        with self._errors.raised_as(ProgramError):
            for done, n in enumerate(self._part.numbers):
                statement = self._statements[n]
                if self._progress is not None:
                    self._progress(done, len(self._part.numbers))
                where = f'moves[{n}].{_name(statement)}'
                with self._noted(n, where):
                    self._end_before(statement)
                end = self._end_of(statement)
                with self._noted(n, where):
                    self._take(statement, n, where)
                if self._broken:
                    self.here = end
            with self._noted(n, where):
                self._end()
        return self._planned

    @contextmanager
    def _noted(self, number: int, where: str) -> Iterator[None]:
        """Note why a statement cannot be planned, and forget the move that it belongs to."""
        try:
            with blamed_on(number, where):
                yield
        except StatementError as error:
            self._segments, self._pending, self._cubics = [], [], []
            self._cubic_velocity = np.zeros(3)
            self._broken = self._failed = True
            place = self._places[error.number] if self._places else None
            self._errors.add(Refusal(str(error)), place)

    def _end_before(self, statement: Statement) -> None:
        """End the move before a statement, if that does not go on with it."""
        if not isinstance(statement, Cubic | Output):
            self._end_cubics()
        if isinstance(statement, Dwell | Cubic | Joints):
            if self._segments and self._segments[-1].blend_m > 0.0:
                last = self._segments[-1]
                raise StatementError(last.number, f'{last.name} has blend_m, which needs a move that follows')
            self._end_move()
        elif not isinstance(statement, Output) and self._segments and self._segments[-1].blend_m == 0.0:
            self._end_move()

    def _end(self) -> None:
        """End the last move."""
        self._end_cubics()
        if self._segments and self._segments[-1].blend_m > 0.0:
            last = self._segments[-1]
            if self._open_end:
                self.notices.append(
                    f'{last.name}: blend_m waits for a move that follows; without one it ends exactly'
                )
                self.open_from = self._segments[0].number - sum(1 for count, _ in self._pending if not count)
            elif not self._part.ends_exactly:
                raise StatementError(last.number, f'{last.name}: blend_m needs a move that follows')
        self._end_move()
        if self._pending and not self._failed:
            self._attach_behind_the_last()

    def _take(self, statement: Statement, number: int, where: str) -> None:
        if isinstance(statement, Output):
            self._take_output(statement)
            return
        self._broken = False
        if isinstance(statement, Dwell):
            self._dwell(statement.time_s, number, where)
        elif isinstance(statement, Cubic):
            self._take_cubic(statement, number, where)
        elif isinstance(statement, Joints):
            self._take_joints(statement, number, where)
        else:
            self._take_segment(statement, number, where)

    def _take_output(self, output: Output) -> None:
        if np.abs(self._cubic_velocity).max() > 0.0:
            raise ProgramError('an output cannot stand between the cubics of a sequence')
        self._end_cubics()
        if not self._broken:
            self._pending.append((len(self._segments), output))
        elif output.payload_kg is not None:  # there is no move that it could belong to
            self.payload = output.payload_kg

    def _take_segment(self, statement: PathMove, number: int, name: str) -> None:
        if isinstance(statement, Arch):
            curve, kind = self._arch(statement, number, name), MoveKind.SPLINE
        else:
            curve, kind = _curve_of(self.here, statement)
        if curve.length_m < COINCIDENT_M:
            raise ProgramError(f'the robot already stands at {point_text(self.here)} m')
        self._segments.append(
            PathSegment(
                curve,
                statement.limits,
                statement.blend_m,
                statement.strict,
                kind,
                number,
                name,
                statement.time_optimal,
                statement.torque_rate_n_m_s,
            )
        )
        self.here = curve.at(curve.length_m)[0]

    def _arch(self, statement: Arch, number: int, name: str) -> Curve:
        """Return the best arch from here on for the payload that is carried."""
        end = _resolve(statement.to, self.here)
        key = (
            statement,
            tuple(np.round(self.here, POINT_DECIMALS)),
            tuple(np.round(end, POINT_DECIMALS)),
            self.payload,
        )
        if key not in self._arches:
            room = Clearances(self.here, end, statement.up_m, statement.down_m, statement.keep_out)

            def cost(curve: Curve) -> float:
                segment = PathSegment(
                    curve,
                    statement.limits,
                    0.0,
                    False,
                    MoveKind.SPLINE,
                    number,
                    name,
                    statement.time_optimal,
                    statement.torque_rate_n_m_s,
                )
                stretches = [(curve.length_m, statement.limits)]
                planned = plan_move([segment], curve, stretches, [], self.payload, self._parameters)
                return planned.move.duration_s if statement.aim == Aim.TIME else planned.energy.lost_j

            self._arches[key] = best_arch(room, cost)
        return self._arches[key]

    def _take_cubic(self, statement: Cubic, number: int, name: str) -> None:
        end = _resolve(statement.to, self.here)
        velocity = np.array(statement.end_velocity_m_s)
        curve = curves.timed_cubic(self.here, end, self._cubic_velocity, velocity, statement.duration_s)
        self._cubics.append((curve, number, name))
        self.here, self._cubic_velocity = end, velocity

    def _take_joints(self, statement: Joints, number: int, name: str) -> None:
        events = self._take_outputs(0.0)
        returning = self._returning and not self._planned and not self._failed
        with blamed_on(number, name):
            planned = plan_joints(
                statement.points, self.here, self.payload, name, self._parameters, returning
            )
        places = ((number, planned.move.length_m),)
        self._append(replace(planned, statements=places), events)
        self.here = planned.move.end_m()

    def _end_of(self, statement: Statement) -> Floats:
        """Return where a robot stands behind a statement."""
        if isinstance(statement, Joints):
            angles = np.array(statement.points[-1].angles_rad)
            end = kinematics.forward(angles, self._parameters.kinematics, unreachable='nan')
            return self.here if np.isnan(end).any() else end
        return _end_of(statement, self.here)

    def _end_cubics(self) -> None:
        """Time and check a sequence of cubics, which begins and ends at rest."""
        if not self._cubics:
            return
        sequence, self._cubics = self._cubics, []
        _, number, name = sequence[-1]
        with blamed_on(number, name):
            if np.abs(self._cubic_velocity).max() > 0.0:
                raise ProgramError('the last cubic of a sequence must end with end_velocity_m_s [0, 0, 0]')
            curve = curves.joined([one for one, _, _ in sequence])
        events = self._take_outputs(0.0)
        returning = self._returning and not self._planned and not self._failed
        with blamed_on(number, name):
            planned = plan_cubic(curve, self.payload, name, self._parameters, returning)
        places = tuple((one, planned.move.length_m) for _, one, _ in sequence)
        self._append(replace(planned, statements=places), events)

    def _dwell(self, time_s: float, number: int, name: str) -> None:
        events = self._take_outputs(0.0)
        planned = plan_dwell(self.here, time_s, self.payload, name, self._parameters)
        self._append(replace(planned, statements=((number, 0.0),)), events)

    def _end_move(self) -> None:
        """Join the segments with their blends, and time and check the move that they make."""
        segments, self._segments = self._segments, []
        if not segments:
            return
        curve, ends, stretches = blended(segments)
        outputs, self._pending = self._pending, []
        payload = self.payload
        events = [self._event(output, count, ends, curve, segments) for count, output in outputs]
        for event in sorted(events, key=lambda event: event.distance_m):
            if event.payload_kg is not None:
                self.payload = event.payload_kg
        returning = self._returning and not self._planned and not self._failed
        with blamed_on(segments[0].number, name_of(segments)):
            planned = plan_move(
                segments, curve, stretches, events, payload, self._parameters, returning, self._heat
            )
        places = tuple((one.number, end) for one, end in zip(segments, ends, strict=True))
        self._planned.append(replace(planned, statements=places))

    def _event(
        self, output: Output, count: int, ends: list[float], curve: Curve, segments: list[PathSegment]
    ) -> Event:
        distance = (ends[count - 1] if count else 0.0) - output.before_m
        if not -COINCIDENT_M <= distance <= curve.length_m:
            before = segments[max(count - 1, 0)]
            raise StatementError(
                before.number,
                f'{before.name}: an output {output.before_m:g} m before its end would lie before the '
                f'start of the move, which is {curve.length_m:.4g} m long',
            )
        return Event(max(distance, 0.0), OUTPUTS.index(output.name), output.value, output.payload_kg)

    def _attach_behind_the_last(self) -> None:
        """Give outputs at the end of the program to the end of its last move."""
        if not self._planned:
            raise ProgramError('an output needs a move or a dwell before it or after it')
        last = self._planned.pop()
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

    def _append(self, planned: PlannedMove, events: Floats) -> None:
        """Append a move with more events behind those that it has."""
        move = replace(planned.move, events=np.vstack([planned.move.events, events]))
        self._planned.append(replace(planned, move=move))


def _name(statement: Statement) -> str:
    return {
        MoveL: 'move_l', MoveC: 'move_c', MoveSB: 'move_sb', Arch: 'arch', Cubic: 'cubic', Joints: 'joints',
        Dwell: 'dwell', Output: 'output'
    }[type(statement)]  # fmt: skip


def _end_of(statement: Statement, here: Floats) -> Floats:
    """Return where a robot stands behind a statement."""
    if isinstance(statement, MoveSB):
        for target in statement.through:
            here = _resolve(target, here)
        return here
    return here if isinstance(statement, Dwell | Joints | Output) else _resolve(statement.to, here)


def _resolve(target: Target, here: Floats) -> Floats:
    return here + np.array(target.point_m) if target.relative else np.array(target.point_m)


def _curve_of(here: Floats, statement: PathMove) -> tuple[Curve, MoveKind]:
    """Return the path of a statement from a point [m] on, and what kind of move it is."""
    match statement:
        case MoveL(to=to):
            return curves.line(here, _resolve(to, here)), MoveKind.LINE
        case MoveC(via=via, to=to):
            return curves.arc(here, _resolve(via, here), _resolve(to, here)), MoveKind.ARC
        case MoveSB(through=through):
            points = [here]
            for target in through:
                points.append(_resolve(target, points[-1]))
            return curves.spline(np.array(points)), MoveKind.SPLINE
    raise TypeError(f'{type(statement).__name__} has no path')
