"""Planning of script statements: new programs from rest, or moves appended to the running program, and their log.

The planning has no side effects on the robot: it converts statements and bus cycles to orders.
"""

import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from delta3_pacdrive.configuration.source_positions import Place
from delta3_pacdrive.control.motion_state import percent_allowed
from delta3_pacdrive.control.queue.running_moves import RunningMoves, begins_at_rest
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.extension import Extension, RunningProgram, Splice, SpliceError
from delta3_pacdrive.planning.paths.move import EVENT_NAMES, OUTPUTS, TRACK, UNCHANGED, Move
from delta3_pacdrive.planning.plan_times import path_length_m
from delta3_pacdrive.planning.planned_move import grouped
from delta3_pacdrive.planning.program.model import (
    Cubic,
    Dwell,
    Joints,
    Output,
    PathMove,
    Point,
    Program,
    Statement,
    Turn,
)
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.planning.round_planner import OPEN_CORNER, Arches
from delta3_pacdrive.scripting.source_position import NOWHERE, ScriptPlace

_NUMBER = re.compile(r'\bmoves\[(\d+)\]\.')
Written = tuple[Statement, ScriptPlace]
REPLANNED_MAX = 200  # statements of the last move that are replanned to blend the corner to the next one


@dataclass(frozen=True)
class Batch:
    """Statements that were planned together."""

    planned: Planned
    again: bool  # whether the first move replaces the last one of the preceding batch
    names: tuple[str, ...]  # line and kind of the statements of each move


@dataclass(frozen=True)
class Start:
    """Start of a program from rest."""

    planned: Planned
    cycle: int
    override: float


class Moves(RunningMoves):
    """The moves of one script; ``timeline`` includes the latest order."""

    def __init__(self, name: str, parameters: Parameters) -> None:
        super().__init__()
        self._name, self._parameters = name, parameters
        self._tool_rad: tuple[float, ...] = ()  # when the robot was last at rest
        self.override = 1.0  # of the next program, 1 = as planned
        self.payload_kg = parameters.dynamics.payload_mass_kg  # at the start of the next program
        self._places: list[ScriptPlace] = []  # of the statements of the running program
        self.on_planned: Callable[[Batch], None] = lambda _: None
        self.notices: list[str] = []
        self._arches: Arches = {}

    def copy(self) -> Self:
        """Return a copy, to be discarded if an order is rejected."""
        same = copy(self)
        same._places, same.notices = list(self._places), list(self.notices)
        return same

    def start_later(self, start: Start, cycle: int) -> None:
        """Record that a program from rest starts in another bus cycle than ordered."""
        self.timeline = Timeline(start.planned.plan, self._parameters.bus.cycle_time_s)
        self.timeline.start(cycle, start.override)

    def end(self) -> None:
        """Record the end of the program: the next one starts from rest."""
        self.clear(self.payload_kg if self.running is None else self.running.payload_kg)

    def order(
        self, written: Sequence[Written], cycle: int, start_m: Point, turns_rad: tuple[float, ...] = ()
    ) -> Start | Extension:
        """Plan statements for execution from a bus cycle; raises ProgramError.

        ``start_m`` and ``turns_rad`` are the position and the tool angles of a robot at rest.
        """
        if all(isinstance(statement, Output) for statement, _ in written):
            pause = Dwell(self._parameters.bus.cycle_time_s)  # outputs must belong to a move
            written = [*written, (pause, written[-1][1])]
        self._tool_rad = turns_rad
        if self.running is None or self.timeline is None:
            return self._from_rest(written, cycle, start_m)
        try:
            return self._appended(written, cycle, rounded=True)
        except SpliceError:
            return self._appended(written, cycle, rounded=False)

    def preview(
        self, written: Sequence[Written], start_m: Point, turns_rad: tuple[float, ...] = ()
    ) -> Planned:
        """Return the plan of statements after all ordered moves, without executing it; raises ProgramError.

        ``start_m`` and ``turns_rad`` are the position and the tool angles of a robot at rest.
        """
        program, running = self._program(written, None), self.running
        if running is None:
            return self._planned(program, start_m, turns_rad)
        end_rad = running.plan.end_turns_rad
        end_rad = (*end_rad, *self._tool_rad[len(end_rad) :])
        program = replace(program, payload_kg=running.payload_kg)
        return self._planned(program, self.plan_end_m or start_m, end_rad)

    def _planned(self, program: Program, start_m: Point, turns_rad: tuple[float, ...]) -> Planned:
        """Return the plan of a program from rest."""
        return program_planner.plan(
            program,
            np.array(start_m),
            self._parameters,
            returning=True,
            open_end=True,
            arches=self._arches,
            turns_rad=turns_rad,
        )

    def left_on_belt_s(self, cycle: int) -> float:
        """Return the motion time from a bus cycle until the plan leaves its belt [s], at 100 %; 0 if it stays."""
        timeline, end = self.timeline, self._leaving_move(cycle)
        if timeline is None or end is None:
            return 0.0
        now, plan = timeline.at(cycle), timeline.plan
        move, starts = plan.move(now.number), plan.tables.starts
        driven = now.distance_m / move.length_m if move.length_m > 0.0 else 0.0
        return float(starts[end + 1] - starts[now.number]) - driven * move.duration_s

    def leaves_belt_in(self, cycle: int) -> int | None:
        """Return the first bus cycle, not before ``cycle``, after the plan has left its belt; None if it stays."""
        timeline, end = self.timeline, self._leaving_move(cycle)
        if timeline is None or end is None:
            return None
        cycles = range(cycle, timeline.end_cycle)
        return cycles.start + bisect_right(cycles, end, key=lambda one: timeline.at(one).number)

    def _leaving_move(self, cycle: int) -> int | None:
        """Return the number of the first move, from the present one of a bus cycle on, that leaves its belt."""
        if self.timeline is None:
            return None
        plan = self.timeline.plan
        numbers = range(self.timeline.at(cycle).number, len(plan))
        return next((n for n in numbers if _leaves_belt(plan.move(n))), None)

    def clear(self, payload_kg: float) -> None:
        """Clear the running program; ``payload_kg`` is the present payload."""
        self.timeline = self.running = None
        self.payload_kg = payload_kg

    def _program(self, written: Sequence[Written], splice: Splice | None) -> Program:
        again = () if splice is None else splice.again
        stood = [*self._places[len(self._places) - len(again) :], *(place for _, place in written)]
        source = next((place.file for _, place in written if place != NOWHERE), '')
        at = [Place(place.line, place.column) if place.file == source else None for place in stood]
        places = tuple(at) if source else ()
        statements = (*again, *(statement for statement, _ in written))
        payload = self.payload_kg if splice is None else splice.payload_kg
        return Program(self._name, statements, payload_kg=payload, source=source, places=places)

    def _from_rest(self, written: Sequence[Written], cycle: int, start_m: Point) -> Start:
        program = self._program(written, None)
        planned = self._planned(program, start_m, self._tool_rad)
        self._places = []
        self._note(program, planned, written, again=False)
        override = min(self.override, planned.override_max)
        self.running, self.override_max = RunningProgram.of(program, planned), planned.override_max
        self.timeline = Timeline(planned.plan, self._parameters.bus.cycle_time_s)
        self.timeline.start(cycle, override)
        return Start(planned, cycle, override)

    def _appended(self, written: Sequence[Written], cycle: int, rounded: bool) -> Extension:
        statements = [statement for statement, _ in written]
        moves = self.append_point(cycle - 1).plan(
            statements,
            lambda splice: self._program(written, splice),
            self._parameters,
            statements_max=REPLANNED_MAX,
            turns_rad=self._tool_rad,
            rounded=rounded,
            arches=self._arches,
        )
        extension = self.extension(moves, cycle)
        if moves.open_corner and not begins_at_rest(statements):
            _, place = written[0]
            self.notices.append(f'{place}: the corner before this move is not rounded: {moves.open_corner}')
        self._note(moves.program, moves.planned, written, again=bool(moves.splice.again))
        self.append(moves, extension)
        self.timeline = extension.timeline
        return extension

    def _note(self, program: Program, planned: Planned, written: Sequence[Written], again: bool) -> None:
        self._places = [*self._places, *(place for _, place in written)][-REPLANNED_MAX:]
        names = tuple(_in_lines(name, program) for name in planned.names)
        parts = tuple(tuple((_in_lines(name, program), end) for name, end in one) for one in planned.parts)
        self.on_planned(Batch(replace(planned, parts=parts), again, names))
        notices = [notice for notice in planned.notices if OPEN_CORNER not in notice]
        self.notices = grouped(
            [*self.notices, *(_in_lines(notice, program, f'{program.source}:') for notice in notices)]
        )

    def follow(self, profile: MotionProfile) -> None:
        """Switch to another motion profile; raises ProgramError if it does not continue the present one."""
        if self.timeline is None:
            raise ProgramError('no program runs')
        self.timeline = self.timeline.copy()
        self.timeline.change(profile)

    def require_override(self, override: float) -> None:
        """Reject an override that exceeds a motor limit or the TCP speed limit; raises ProgramError."""
        if self.timeline is not None and override > self.override_max:
            raise ProgramError(
                f'override is {100.0 * override:g} %, but motors and TCP speed limit allow at most '
                f'{percent_allowed(self.override_max)} % in these moves'
            )

    def seconds_left(self, cycle: int) -> float:
        """Return the remaining time of the ordered moves after a bus cycle [s]."""
        if self.timeline is None:
            return 0.0
        return max(self.timeline.end_cycle - cycle, 0) * self._parameters.bus.cycle_time_s

    @property
    def plan_end_m(self) -> Point | None:
        """End position of the last ordered move [m]; None at rest."""
        if self.timeline is None:
            return None
        x, y, z = self.timeline.plan.end_m().tolist()
        return x, y, z


def _leaves_belt(move: Move) -> bool:
    of_belts = move.events[move.events[:, 1] == EVENT_NAMES.index(TRACK)]
    return bool(len(of_belts)) and not of_belts[-1, 2]


def unnumbered(sentence: str) -> str:
    """Return a sentence without statement numbers, which do not exist in a script."""
    return _NUMBER.sub('', sentence)


def _in_lines(text: str, program: Program, file: str = '') -> str:
    """Return a text with statement numbers replaced by line numbers."""

    def line(found: re.Match[str]) -> str:
        place = program.places[int(found[1])] if program.places else None
        return '' if place is None else f'{file}{place.line}: '

    return _NUMBER.sub(line, text)


def without_wait(statement: Statement) -> tuple[Statement, bool]:
    """Return the statement without its in-position wait, and whether it had one."""
    if isinstance(statement, PathMove) and statement.in_position:
        return replace(statement, in_position=False), True
    return statement, False


def is_move(statement: Statement) -> bool:
    """Whether a statement moves the robot or its tool."""
    return isinstance(statement, PathMove | Cubic | Joints | Turn)


def alone(statement: Statement) -> tuple[Statement, bool]:
    """Return a move for single-stepping, and whether it ends at rest."""
    if isinstance(statement, PathMove):
        return replace(statement, blend_m=0.0), True
    return statement, not (isinstance(statement, Cubic) and any(statement.end_velocity_m_s))


class MotionLog:
    """The log of one script, updated with every change of the timeline."""

    def __init__(self, cycle_time_s: float) -> None:
        self._cycle_time_s = cycle_time_s
        self._timeline: Timeline | None = None
        self._from = 0  # first cycle of the timeline
        self._moves: list[tuple[str, int, int, float]] = []  # kind, first and end cycle, length
        self._events: list[tuple[int, int, float, float]] = []  # cycle, bit, value, payload
        self._logged = 0  # number of logged events of the last move
        self._continues = False  # whether the timeline starts within the last logged move
        self.start_cycle: int | None = None

    def follow(self, timeline: Timeline, cycle: int, continues: bool) -> None:
        """Start to log a timeline from a bus cycle; ``continues``: it starts within the preceding move."""
        self.end(cycle)
        self._timeline, self._from, self._continues = timeline, cycle, continues
        if self.start_cycle is None:
            self.start_cycle = cycle

    def end(self, cycle: int) -> None:
        """Log the moves of the present timeline up to a bus cycle (exclusive)."""
        timeline, first = self._timeline, self._from
        self._timeline = None
        if timeline is None or cycle <= first:
            return
        rest_cycle = min(max(timeline.end_cycle, first + 1), cycle)
        begun, last = timeline.at(first).number, timeline.at(rest_cycle - 1).number
        if timeline.profile is not None and begun != timeline.profile.number:
            self._continues = False  # the preceding move has ended
        for number in range(begun, last + 1):
            begin = max(timeline.first_cycle_in(number), first)
            end = rest_cycle if number == last else min(timeline.first_cycle_in(number + 1), rest_cycle)
            self._note(timeline, number, begin, end, last_of_all=number == last)
            self._continues = False

    def _note(self, timeline: Timeline, number: int, begin: int, end: int, last_of_all: bool) -> None:
        move = timeline.plan.move(number)
        kind, length_m = move.kind.name.lower(), path_length_m(move)
        if self._continues and self._moves:
            _, begin, _, _ = self._moves.pop()
        else:
            self._logged = 0
        self._moves.append((kind, begin, end, length_m))
        over = not last_of_all or end >= timeline.end_cycle
        for place, bit, value, payload in move.events[self._logged :].tolist():
            cycle = self._cycle_at(timeline, number, place, begin, end)
            if cycle == end and not over:
                break
            self._events.append((cycle, int(bit), value, payload))
            self._logged += 1

    @staticmethod
    def _cycle_at(timeline: Timeline, number: int, place_m: float, begin: int, end: int) -> int:
        """Return the first bus cycle in which the master has reached a distance of a move, at most ``end``."""
        while begin < end:
            middle = (begin + end) // 2
            now = timeline.at(middle)
            if now.number > number or now.distance_m >= place_m:
                end = middle
            else:
                begin = middle + 1
        return begin

    def _time_s(self, cycle: int) -> float:
        return (cycle - (self.start_cycle or 0)) * self._cycle_time_s

    def moves(self) -> list[dict[str, Any]]:
        """Return kind, start [s], end [s] and length [m] of each move; time counts from the first move."""
        return [
            {'kind': kind, 'start_s': self._time_s(begin), 'end_s': self._time_s(end), 'length_m': length_m}
            for kind, begin, end, length_m in self._moves
        ]

    def outputs(self) -> list[dict[str, Any]]:
        """Return time [s], name, value and payload [kg] of each output change; None: payload unchanged."""
        return [
            {
                'time_s': self._time_s(cycle),
                'name': OUTPUTS[bit] if bit >= 0 else 'payload',
                'value': value,
                'payload_kg': None if payload == UNCHANGED else payload,
            }
            for cycle, bit, value, payload in self._events
            if bit < len(OUTPUTS)
        ]
