"""Planning of one round of a program: statements become moves with their outputs and payloads."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.configuration.strict_reader import Errors, Refusal
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.arch import Clearances, best_arch
from delta3_pacdrive.planning.due_outputs import Due, DueOutputs
from delta3_pacdrive.planning.joint_trajectory import plan_joints
from delta3_pacdrive.planning.limits.energy import heat_weight, price_of_time_w
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.curves import COINCIDENT_M, Curve
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.planned_move import (
    ROUNDING_S,
    Event,
    PlannedMove,
    event_rows,
    plan_cubic,
    plan_dwell,
    plan_move,
)
from delta3_pacdrive.planning.program.model import (
    Aim,
    Angle,
    Arch,
    Cubic,
    Dwell,
    JointPoint,
    Joints,
    Output,
    PathMove,
    Program,
    Statement,
    Turn,
    point_text,
)
from delta3_pacdrive.planning.program.parts import Part
from delta3_pacdrive.planning.rotating_move import (
    TurnLimits,
    plan_turn,
    plan_turning_move,
    require_rotary_axes,
    tool_text,
    turn_rows,
)
from delta3_pacdrive.planning.statement_curves import curve_of, end_of, resolve
from delta3_pacdrive.planning.timing.blending import (
    PathSegment,
    StatementError,
    attributed_to,
    blended,
    name_of,
)
from delta3_pacdrive.planning.timing.constant_speed import UnevenSpeedError, advice
from delta3_pacdrive.planning.timing.move_grid import Stretches

# cache of arch shapes by statement, start, end and payload
Arches = dict[tuple[Arch, tuple[float, ...], tuple[float, ...], float], Curve]
POINT_DECIMALS = 9  # of identical points [m]
OPEN_CORNER = 'blend_m waits for a move that follows; without one it ends exactly'  # for notices
ANGLE_ROUNDING_RAD = 1e-9
COINCIDENT_RAD = 1e-6  # tolerance for identical angles
BEHIND_M = 1.0  # distance beyond the end of a move that makes an event due at its end


@dataclass(frozen=True)
class PlanRequest:
    """Inputs that are common to all rounds of a program."""

    program: Program
    parameters: Parameters
    returning: bool = False  # whether the first move may start beyond limits
    open_end: bool = False  # whether moves may be appended later
    progress: Callable[[int, int], None] | None = None
    arches: Arches = field(default_factory=dict)
    smoothed_from: JointPoint | None = None  # start of its only statement, a trajectory that is smoothed


class RoundPlanner:
    """Planner of a part of a program from a start position, payload and angles of the rotary axes."""

    def __init__(
        self,
        request: PlanRequest,
        part: Part,
        start_m: Floats,
        payload_kg: float,
        turns_rad: tuple[float, ...],
        heat: float = 0.0,
    ) -> None:
        self._request, self._part = request, part
        self._program, self._statements = request.program, request.program.statements
        self._parameters = request.parameters
        self._errors = Errors(request.program.source)
        self._failed = False  # whether any move could not be planned
        self._broken = False  # whether the last move could not be planned
        self._heat = heat  # weight of the motor losses relative to the time in time-optimal moves
        self.notices: list[str] = []
        self.position_m, self.payload = start_m, payload_kg
        self.turns = turns_rad  # angle of each rotary axis [rad]; empty: not defined by the plan
        self._planned: list[PlannedMove] = []
        self._segments: list[PathSegment] = []
        self._dues = DueOutputs()
        self._dwelt: _Dwelt | None = None  # dwell at the end of the planned moves
        self._cubics: list[tuple[Curve, int, str]] = []
        self._cubic_velocity: Floats = np.zeros(3)
        self.open_from: int | None = None  # first statement of a last move that ends in an open blend

    def planned(self) -> list[PlannedMove]:
        """Plan all statements; raises ProgramError that names up to ten that cannot be planned.

        After an error, planning continues at the end of the failed statement.
        """
        with self._errors.raised_as(ProgramError):
            for done, n in enumerate(self._part.numbers):
                statement = self._statements[n]
                if self._request.progress is not None:
                    self._request.progress(done, len(self._part.numbers))
                where = self._program.name_of(n)
                with self._noted(n, where):
                    self._end_before(statement)
                end = self._end_of(statement)
                with self._noted(n, where):
                    self._take(statement, n, where)
                if self._broken:
                    self.position_m = end
            with self._noted(n, where):
                self._end()
        return self._planned

    @contextmanager
    def _noted(self, number: int, where: str) -> Iterator[None]:
        """Record why a statement cannot be planned, and discard its move."""
        try:
            with attributed_to(number, where):
                yield
        except StatementError as error:
            self._segments, self._cubics, self._dwelt = [], [], None
            self._dues.clear()
            self._cubic_velocity = np.zeros(3)
            self._broken = self._failed = True
            self._errors.add(Refusal(str(error)), self._program.place_of(error.number))

    def _end_before(self, statement: Statement) -> None:
        """End the current move before a statement that does not continue it."""
        if not isinstance(statement, Cubic | Output):
            self._end_cubics()
        if isinstance(statement, Dwell | Cubic | Joints | Turn):
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
            if self._request.open_end:
                self._keep_open(last)
            elif not self._part.ends_exactly:
                raise StatementError(last.number, f'{last.name}: blend_m needs a move that follows')
        self._end_move()
        if len(self._dues) and not self._failed:
            self._dues.require_none_later()
            self._attach_to_last_move()

    def _keep_open(self, last: PathSegment) -> None:
        """Keep the last move open for an appended one, unless this would shift outputs."""
        if self._dues.any_shifted:
            self.notices.append(
                f'{last.name}: blend_m is ignored, because after_m, before_s or after_s of an output refers to its end'
            )
            return
        self.notices.append(f'{last.name}: {OPEN_CORNER}')
        self.open_from = self._segments[0].number - self._dues.before_the_first
        # an appended move changes the path, whose speed is checked then
        self._segments = [replace(one, constant_speed=False) for one in self._segments]

    def _take(self, statement: Statement, number: int, where: str) -> None:
        if isinstance(statement, Output):
            self._take_output(statement, number, where)
            return
        self._broken = False
        if isinstance(statement, Turn):
            self._take_turn(statement, number, where)
        elif isinstance(statement, Dwell):
            self._dwell(statement.time_s, number, where)
        elif isinstance(statement, Cubic):
            self._take_cubic(statement, number, where)
        elif isinstance(statement, Joints):
            self._take_joints(statement, number, where)
        else:
            self._take_segment(statement, number, where)

    def _take_output(self, output: Output, number: int, name: str) -> None:
        if np.abs(self._cubic_velocity).max() > 0.0:
            raise ProgramError('an output cannot be between the cubics of a sequence')
        self._end_cubics()
        due = Due(output, number, name, len(self._segments), output.after_s)
        if self._broken:  # its move could not be planned
            if output.payload_kg is not None:
                self.payload = output.payload_kg
        elif output.before_s > ROUNDING_S and not self._segments:
            self._take_lead(due)
        else:
            self._dues.add(due)

    def _take_lead(self, due: Due) -> None:
        """Add an output before the end of the dwell, or of the path over time, that was planned last."""
        if not self._planned:
            raise ProgramError('before_s of an output needs a move or a dwell right before it')
        if self._dwelt is not None:
            time_s = self._dwelt.time_s - due.output.before_s
            if time_s < -ROUNDING_S:
                raise ProgramError(
                    f'{due.output.before_s:g} s before the end of the previous dwell is before its start, it takes '
                    f'{self._dwelt.time_s:g} s'
                )
            self._dwelt = replace(self._dwelt, changes=(*self._dwelt.changes, (time_s, due.at(0.0))))
            self._plan_dwelt(self._dwelt)
            return
        last = self._planned[-1]
        event = due.timed(last, last.move.length_m)
        self._planned[-1] = replace(last, timed=(*last.timed, event))

    def _take_segment(self, statement: PathMove, number: int, name: str) -> None:
        if isinstance(statement, Arch):
            curve, kind = self._arch(statement, number, name), MoveKind.SPLINE
        else:
            curve, kind = curve_of(self.position_m, statement)
        if curve.length_m < COINCIDENT_M:
            raise ProgramError(f'the robot is already at {point_text(self.position_m)} m')
        turns = self._turned(statement.turns)
        self._segments.append(
            PathSegment(
                curve,
                statement.limits,
                statement.blend_m,
                statement.strict,
                kind,
                number=number,
                name=name,
                time_optimal=statement.time_optimal,
                torque_rate_n_m_s=statement.torque_rate_n_m_s,
                turns_rad=turns,
                heat=self._heat_weight(statement),
                is_arch=isinstance(statement, Arch),
                constant_speed=statement.constant_speed,
            )
        )
        self.position_m = curve.at(curve.length_m)[0]

    def _turned(self, angles: tuple[Angle, ...]) -> tuple[tuple[float, float], ...]:
        """Return start and end angle of each rotary axis for a statement [rad], and update the current angles."""
        starts, axes = self.turns, self._parameters.rotary_axes
        require_rotary_axes(len(angles), len(axes))
        ends = [angle.after(start) for angle, start in zip(angles, starts, strict=False)]
        self.turns = (*ends, *starts[len(ends) :])
        for number, (end, rotary) in enumerate(zip(ends, axes, strict=False)):
            low, high = rotary.angle_min_deg, rotary.angle_max_deg
            if not math.radians(low) - ANGLE_ROUNDING_RAD <= end <= math.radians(high) + ANGLE_ROUNDING_RAD:
                raise ProgramError(
                    f'{tool_text(self._parameters, number)} would turn to {math.degrees(end):.6g} deg, the limits are '
                    f'{low:g} and {high:g} deg'
                )
        return tuple(zip(starts, self.turns, strict=True))

    def _take_turn(self, statement: Turn, number: int, where: str) -> None:
        events = self._take_outputs(0.0)
        later = self._dues.in_time()
        with attributed_to(number, where):
            turns = self._turned(statement.turns)
            if all(abs(end - start) < COINCIDENT_RAD for start, end in turns):
                angles = ' and '.join(f'{math.degrees(start):.6g}' for start, _ in turns)
                raise ProgramError(f'the tool is already at {angles} deg')
            planned = plan_turn(self.position_m, turns, self.payload, where, self._parameters)
        timed = tuple(due.timed(planned, 0.0) for due in later)
        places = ((number, planned.move.length_m),)
        self._append(replace(planned, statements=places, timed=timed), events)

    def _arch(self, statement: Arch, number: int, name: str) -> Curve:
        """Return the best arch from the current position for the current payload."""
        end = resolve(statement.to, self.position_m)
        key = (
            statement,
            tuple(np.round(self.position_m, POINT_DECIMALS)),
            tuple(np.round(end, POINT_DECIMALS)),
            self.payload,
        )
        arches = self._request.arches
        if key not in arches:
            room = Clearances(self.position_m, end, statement.up_m, statement.down_m, statement.keep_out)

            def cost(curve: Curve) -> float:
                segment = PathSegment(
                    curve,
                    statement.limits,
                    0.0,
                    False,
                    MoveKind.SPLINE,
                    number=number,
                    name=name,
                    time_optimal=statement.time_optimal,
                    torque_rate_n_m_s=statement.torque_rate_n_m_s,
                    heat=self._heat_weight(statement),
                )
                stretches = [(curve.length_m, statement.limits)]
                planned = plan_move(
                    [segment],
                    curve,
                    stretches,
                    events=[],
                    payload_kg=self.payload,
                    parameters=self._parameters,
                )
                if statement.aim == Aim.TIME:
                    return planned.move.duration_s
                return planned.energy.lost_j + price_of_time_w(self._parameters) * planned.move.duration_s

            arches[key] = best_arch(room, cost, corners=statement.aim == Aim.ENERGY)
        return arches[key]

    def _heat_weight(self, statement: PathMove) -> float:
        """Return the weight of the motor losses in a time-optimal move."""
        saves = isinstance(statement, Arch) and statement.aim == Aim.ENERGY
        return heat_weight(self._parameters) if saves else 0.0

    def _take_cubic(self, statement: Cubic, number: int, name: str) -> None:
        end = resolve(statement.to, self.position_m)
        velocity = np.array(statement.end_velocity_m_s)
        curve = curves.timed_cubic(self.position_m, end, self._cubic_velocity, velocity, statement.duration_s)
        self._cubics.append((curve, number, name))
        self.position_m, self._cubic_velocity = end, velocity

    def _take_joints(self, statement: Joints, number: int, name: str) -> None:
        events = self._take_outputs(0.0)
        later = self._dues.in_time()
        with attributed_to(number, name):
            planned = plan_joints(
                statement.points,
                self.position_m,
                self.payload,
                name=name,
                parameters=self._parameters,
                returning=self._returning,
                smoothed_from=self._request.smoothed_from,
            )
        timed = tuple(due.timed(planned, 0.0) for due in later)
        places = ((number, planned.move.length_m),)
        self._append(replace(planned, statements=places, timed=timed), events)
        self.position_m = planned.move.end_m()

    def _end_of(self, statement: Statement) -> Floats:
        """Return the position after a statement."""
        if isinstance(statement, Joints):
            angles = np.array(statement.points[-1].angles_rad)
            end = kinematics.forward(angles, self._parameters.kinematics, unreachable='nan')
            return self.position_m if np.isnan(end).any() else end
        try:
            return end_of(statement, self.position_m)
        except ProgramError:  # an invalid circle, rejected when it is planned
            return self.position_m

    @property
    def _returning(self) -> bool:
        """Whether the next move is the first one and may start beyond limits."""
        return self._request.returning and not self._planned and not self._failed

    def _end_cubics(self) -> None:
        """Time and check a sequence of cubics, which begins and ends at rest."""
        if not self._cubics:
            return
        sequence, self._cubics = self._cubics, []
        _, number, name = sequence[-1]
        with attributed_to(number, name):
            if np.abs(self._cubic_velocity).max() > 0.0:
                raise ProgramError('the last cubic of a sequence must end with end_velocity_m_s [0, 0, 0]')
            curve = curves.joined([one for one, _, _ in sequence])
        events = self._take_outputs(0.0)
        later = self._dues.in_time()
        with attributed_to(number, name):
            planned = plan_cubic(curve, self.payload, name, self._parameters, self._returning)
        timed = tuple(due.timed(planned, 0.0) for due in later)
        places = tuple((one, planned.move.length_m) for _, one, _ in sequence)
        self._append(replace(planned, statements=places, timed=timed), events)

    def _dwell(self, time_s: float, number: int, name: str) -> None:
        events = self._take_outputs(0.0)
        changes = tuple((at_s, due.at(0.0)) for at_s, due in self._dues.in_dwell(time_s))
        self._plan_dwelt(
            _Dwelt(len(self._planned), time_s, number, name=name, events=events, changes=changes)
        )

    def _plan_dwelt(self, dwelt: '_Dwelt') -> None:
        """Plan a dwell, split at its output changes, because the master passes no position during a dwell."""
        del self._planned[dwelt.first :]
        begins = [0.0]
        for time_s in sorted(time_s for time_s, _ in dwelt.changes):
            if time_s > begins[-1] + ROUNDING_S:
                begins.append(time_s)
        for begin, end in pairwise((*begins, dwelt.time_s)):
            planned = plan_dwell(self.position_m, end - begin, self.payload, dwelt.name, self._parameters)
            events = event_rows([event for time_s, event in dwelt.changes if begin <= max(time_s, 0.0) < end])
            if begin == 0.0:
                events = np.vstack([dwelt.events, events])
            places = ((dwelt.number, 0.0),) if end == dwelt.time_s else ()
            self._append(replace(planned, statements=places), events)
        self._dwelt = dwelt

    def _end_move(self) -> None:
        """Blend the segments, and time and check the resulting move."""
        segments, self._segments = self._segments, []
        if not segments:
            return
        curve, ends, parts, stretches = blended(segments)
        waits = self._waits_after(segments[-1])
        payload, dues = self.payload, copy(self._dues)
        events, timed = self._dues.on_path(segments, ends, curve, waits)
        for event in sorted(events, key=lambda event: event.distance_m):
            if event.payload_kg is not None:
                self.payload = event.payload_kg
        returning = self._returning
        with attributed_to(segments[0].number, name_of(segments)):
            try:
                planned = self._plan_segments(
                    segments,
                    curve,
                    ends,
                    stretches=stretches,
                    events=events,
                    payload=payload,
                    returning=returning,
                )
            except UnevenSpeedError as error:

                def can(asked: list[PathSegment]) -> bool:
                    try:
                        other, middles, _, limits = blended(asked)
                        due, _ = copy(dues).on_path(asked, middles, other, waits)
                        self._plan_segments(
                            asked,
                            other,
                            middles,
                            stretches=limits,
                            events=due,
                            payload=payload,
                            returning=returning,
                        )
                    except ProgramError:
                        return False
                    return True

                raise advice(error, segments, parts, can) from None
        places = tuple((one.number, end) for one, end in zip(segments, ends, strict=True))
        planned = replace(
            planned,
            statements=places[:-1] if waits else places,
            timed=tuple(due.timed(planned, anchor_m) for due, anchor_m in timed),
            parts=tuple((one.name, end) for one, end in zip(segments, parts, strict=True))
            if len(segments) > 1
            else (),
        )
        self._planned.append(planned)
        self._dwelt = None
        if waits:
            self._wait(segments[-1])

    def _plan_segments(
        self,
        segments: list[PathSegment],
        curve: Curve,
        ends: list[float],
        stretches: Stretches,
        events: list[Event],
        payload: float,
        returning: bool,
    ) -> PlannedMove:
        """Time and check a move with its tool rotation."""

        def plan(asked: list[PathSegment], limits: Stretches) -> PlannedMove:
            return plan_move(
                asked,
                curve,
                limits,
                events=events,
                payload_kg=payload,
                parameters=self._parameters,
                returning=returning,
                heat=self._heat,
            )

        if all(start == end for one in segments for start, end in one.turns_rad):
            planned = plan(segments, stretches)
            angles = [start for start, _ in segments[0].turns_rad]
            return replace(planned, move=planned.move.with_turns(angles))
        heaviest = max([payload, *(one.payload_kg for one in events if one.payload_kg is not None)])
        limits = TurnLimits.of(self._parameters, heaviest)
        turns = turn_rows(segments, ends, curve.length_m)
        return plan_turning_move(
            plan, segments, stretches, turns=turns, limits=limits, name=name_of(segments)
        )

    def _waits_after(self, segment: PathSegment) -> bool:
        statement = self._statements[segment.number]
        return isinstance(statement, PathMove) and statement.in_position

    def _wait(self, segment: PathSegment) -> None:
        """Append a dwell until the robot is in position, at least as long as the controller needs to detect it."""
        time_s = self._parameters.shortest_wait_s
        with attributed_to(segment.number, segment.name):
            planned = plan_dwell(
                self.position_m,
                time_s,
                self.payload,
                name=segment.name,
                parameters=self._parameters,
                kind=MoveKind.IN_POSITION,
            )
        self._planned.append(self._with_turns(replace(planned, statements=((segment.number, 0.0),))))

    def _attach_to_last_move(self) -> None:
        """Attach outputs at the end of the program to the end of its last move."""
        if not self._planned:
            raise ProgramError('an output needs a move or a dwell before or after it')
        last = self._planned.pop()
        self._append(last, self._take_outputs(last.move.length_m + BEHIND_M))

    def _take_outputs(self, distance: float) -> Floats:
        """Return pending outputs as events at a distance on the next move, and update the payload."""
        dues = self._dues.now()
        for due in dues:
            if due.output.payload_kg is not None:
                self.payload = due.output.payload_kg
        return event_rows([due.at(distance) for due in dues])

    def _append(self, planned: PlannedMove, events: Floats) -> None:
        """Append a move with additional events."""
        move = replace(planned.move, events=np.vstack([planned.move.events, events]))
        self._planned.append(self._with_turns(replace(planned, move=move)))
        self._dwelt = None

    def _with_turns(self, planned: PlannedMove) -> PlannedMove:
        """Return a move with constant angles of the rotary axes, unless it already defines them."""
        return replace(planned, move=planned.move.with_turns(self.turns))


@dataclass(frozen=True)
class _Dwelt:
    """A planned dwell: index of its first move, time [s], statement, events at its start, and changes during it."""

    first: int
    time_s: float
    number: int
    name: str
    events: Floats
    changes: tuple[tuple[float, Event], ...]
