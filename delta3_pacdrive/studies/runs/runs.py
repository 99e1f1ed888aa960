"""Runs that are displayed or compared: a recording, or a program that is simulated on demand."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ParameterError, TraceError, sources_of
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.tables import column_file
from delta3_pacdrive.recording.trace import Trace, is_bag
from delta3_pacdrive.robot.sercos import words
from delta3_pacdrive.studies.places.planning.evaluation import study
from delta3_pacdrive.studies.places.planning.report import limited_text
from delta3_pacdrive.studies.runs import bag_cell, bag_events, derived_signals, measured, run_signals
from delta3_pacdrive.studies.runs import cell_history as cell_story
from delta3_pacdrive.studies.runs.cell_history import CellStory
from delta3_pacdrive.studies.runs.inputs import is_recording, is_table, with_digests

CONTINUED_S = 0.5  # displayed after a stop, when the brakes have closed
PROGRAM, TRACE, BAG, TABLE = 'program', 'trace', 'bag', 'table'  # kinds of runs
STARTED, OUTPUT, EVENT, FAULT = 'start', 'output', 'event', 'fault'  # kinds of marks


@dataclass(frozen=True)
class DrivenMove:
    """Executed move, with times [s] from the start of the program."""

    number: int  # in the program, from 1
    kind: str  # name of the MoveKind in lower case
    start_s: float
    end_s: float
    length_m: float  # of the path; 0 where a length has no meaning
    limited_by: str = ''  # what prevents a faster move; empty if unknown


@dataclass(frozen=True)
class Mark:
    """Event at a time [s] from the start of the program."""

    time_s: float
    kind: str  # one of the constants above
    text: str
    sources: tuple[str, ...] = ()  # possible causes of a fault of the robot, as in RobotFault


@dataclass(frozen=True)
class DriveChange:
    """New state of a drive from a time [s] on; ``released`` is the state of its brake, None if unknown."""

    time_s: float
    state: str
    released: bool | None


@dataclass(frozen=True)
class Run:
    """A recording or a simulation."""

    name: str  # as typed
    title: str  # name of the program
    kind: str  # program, trace, bag, or table for measurements without bus cycles
    robot: Parameters
    program: Program | None  # the simulated program; None for a recording
    source: str  # requested parameter file; empty for the packaged one, or if the recording contains its own
    robot_note: str  # origin of parameters that the run does not contain; empty if it does
    whole: Trace
    window: Trace  # displayed cycles without gaps, times from the start of the program
    moves: tuple[DrivenMove, ...]
    marks: tuple[Mark, ...]
    # changes of outputs and payload in the format of plan_times.output_changes
    outputs: tuple[Mapping[str, Any], ...]
    # state changes of each drive from its status words; empty if unknown
    drives: tuple[tuple[DriveChange, ...], ...]
    notes: tuple[str, ...]  # sentences
    origin: str  # name with the digest of the file
    cell: CellStory | None = None  # objects and parts around the robot; None without a cell

    @property
    def period_s(self) -> float:
        """Bus cycle."""
        return run_signals.positive(self.window, 'cycle_time_s')

    @property
    def knows_start(self) -> bool:
        """Whether times count from the start of a program; otherwise they are bus time."""
        return self.window.meta.get('start_cycle') is not None

    @property
    def contains_robot(self) -> bool:
        """Whether it is a recording that contains the parameters of its robot."""
        own = self.whole.meta.get('parameters')
        return self.kind != PROGRAM and isinstance(own, dict) and not self.robot_note

    @property
    def parameter_source(self) -> str | None:
        """Parameter file for the provenance; for a recording with its own parameters the recording."""
        if self.kind == PROGRAM:
            return core.of_run(self.source or None, self.name)
        return self.source or None if self.robot_note else self.name

    def changed_parameters(self) -> dict[str, tuple[Any, Any]]:
        """Return the parameters that differ from the packaged ones, by name: own and packaged value."""
        return differing(self.robot, core.load())


def differing(one: Parameters, other: Parameters) -> dict[str, tuple[Any, Any]]:
    """Return the values in which two robots differ, by dotted name."""
    first, second = core.flatten(one), core.flatten(other, absent=True)
    return {name: (first[name], second[name]) for name in first if first[name] != second[name]}


def load(
    text: str,
    source: str | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    columns: str | None = None,
) -> Run:
    """Load a recording or simulate a program.

    Parameters
    ----------
    text
        A trace file, a table, a bag, a program file or the name of a packaged program.
    source
        Parameter file for a program, or for a recording without parameters.
    from_s, to_s
        Displayed part, times from the start of the program; None: default.
    columns
        Column file that defines the columns of a table.

    Raises
    ------
    Delta3Error
        The run does not exist, cannot be read or simulated, or that part is empty.

    """
    program: Program | None = None
    if not is_recording(text):
        if columns is not None:
            raise TraceError(f'{text} is a program, the column file {columns} applies to tables only')
        trace, robot, program, note, kind = *_simulated(text, core.of_run(source, text)), '', PROGRAM
        story: Mapping[str, Any] = trace.meta
    else:
        trace, kind, robot, note = recorded(text, source, columns)
        story, known = trace.meta, None if note else robot
        if trace.messages is not None:
            story = bag_events.read(trace.messages, trace, known)
    part = _part(trace, from_s, to_s)
    try:
        moves, marks, notes = _moves(story, part), _marks(story, part), notes_of(trace)
        drives = _drives(trace)
        notes += tuple(story['notes']) if kind == BAG else ()
    except (KeyError, TypeError, ValueError):
        raise TraceError(f'{text}: the data of its moves, outputs, faults or notes cannot be read') from None
    title = str(trace.meta.get('program') or Path(text).name)
    outputs = tuple(story.get('outputs', ()))
    (origin,) = with_digests([text])
    return Run(
        name=text,
        title=title,
        kind=kind,
        robot=robot,
        program=program,
        source=source if source and (kind == PROGRAM or note) else '',
        robot_note=note,
        whole=trace,
        window=part,
        moves=moves,
        marks=marks,
        outputs=outputs,
        drives=drives,
        notes=notes,
        origin=origin,
        cell=bag_cell.read(trace) if kind == BAG else cell_story.of_trace(trace, text),
    )


def recorded(
    text: str, source: str | None = None, columns: str | None = None
) -> tuple[Trace, str, Parameters, str]:
    """Return the trace of a recording, its kind, its robot, and a sentence if the robot is assumed.

    Tables of measurements are resampled to an even grid and completed with computed signals.

    Raises
    ------
    Delta3Error
        The recording cannot be read.

    """
    trace = trace_file.load(text, None if columns is None else column_file.read(columns), gaps=True)
    robot, note = _robot_of(trace, source)
    kind = BAG if is_bag(Path(text)) else TRACE
    if is_table(text) and 'cycle_time_s' not in trace.meta:
        trace, kind = measured.completed(measured.on_grid(trace, text), robot), TABLE
    return trace, kind, robot, note


def _part(trace: Trace, from_s: float | None, to_s: float | None) -> Trace:
    """Return the displayed part; a table keeps the times of its file."""
    origin = float(trace.meta.get('origin_s', 0.0))
    edges = (None if edge is None else edge - origin for edge in (from_s, to_s))
    part = run_signals.program_part(_shown(derived_signals.added(trace), *edges))
    return Trace(part.time_s + origin, part.signals, part.meta) if origin else part


def _simulated(text: str, source: str | None) -> tuple[Trace, Parameters, Program]:
    from delta3_pacdrive import simulation

    robot = core.load(source)
    program = programs.load(text, robot.motion)
    simulation.load_kernels(robot)
    trace, placed = simulation.run(program, robot), simulation.placed(robot, program)
    note_limits(trace, program, placed)
    return trace, placed, program


def note_limits(trace: Trace, program: Program, robot: Parameters) -> None:
    """Add the limit of each move to the ``meta`` of a simulation; ``robot`` is placed at the start of the program."""
    rows = study(program_planner.plan(program, robot.motion.home_m, robot), robot).rows
    for n, move in enumerate(trace.meta['moves']):
        # all rounds are equal except for the approach of the first
        move['limited_by'] = limited_text(rows[n % len(rows)])


def _robot_of(trace: Trace, source: str | None) -> tuple[Parameters, str]:
    """Return the robot of a recording, and the origin of its parameters if the recording does not contain them."""
    own = trace.meta.get('parameters')
    if isinstance(own, dict):
        try:
            return core.from_flat(own, 'parameters of the recording'), ''
        except ParameterError as error:
            why = f'the recording contains parameters of another version ({error})'
    else:
        why = 'the recording does not contain its parameters'
    robot = core.load(source)
    if trace.meta.get('checksum') == robot.checksum:
        return robot, ''
    return robot, f'{why}: those of {source or core.DEFAULT_FILE} are used'


def _shown(trace: Trace, from_s: float | None, to_s: float | None) -> Trace:
    """Return the trace with its display window: the program, and for a stopped program the time after the stop."""
    stopped, start = trace.meta.get('stopped'), run_signals.noted_cycle(trace, 'start_cycle')
    if stopped and to_s is None and start is not None and len(trace.time_s):
        period = run_signals.positive(trace, 'cycle_time_s')
        last = run_signals.shown_cycles(trace)[1]
        to_s = min((last - start) * period + CONTINUED_S, float(trace.time_s[-1]) - start * period)
        if from_s is None:
            from_s = -run_signals.BEFORE_S
    if from_s is None and to_s is None:
        return trace
    return run_signals.windowed(trace, from_s, to_s)


def _moves(story: Mapping[str, Any], part: Trace) -> tuple[DrivenMove, ...]:
    """Return the moves within the displayed part, the last one cut off at the end of the run."""
    first, last, stop = float(part.time_s[0]), float(part.time_s[-1]), _stop_s(part)
    found = [
        DrivenMove(
            number=n,
            kind=str(row['kind']),
            start_s=float(row['start_s']),
            end_s=min(float(row['end_s']), last),
            length_m=float(row['length_m']),
            limited_by=str(row.get('limited_by', '')),
        )
        for n, row in enumerate(story.get('moves', ()), start=1)
    ]
    return tuple(move for move in found if move.end_s > first and move.start_s < min(last, stop))


def _marks(story: Mapping[str, Any], part: Trace) -> tuple[Mark, ...]:
    marks = []
    if part.meta.get('start_cycle') is not None:
        marks.append(Mark(0.0, STARTED, 'start of the program'))
    marks += [Mark(float(row['time_s']), OUTPUT, _output_text(row)) for row in story.get('outputs', ())]
    marks += [Mark(float(row['time_s']), EVENT, str(row['text'])) for row in story.get('events', ())]
    for row in story.get('faults', ()):
        after, lasting = float(row['after_s']), float(row.get('for_s', math.inf))
        marks.append(Mark(after, FAULT, f'injected: {row["text"]}'))
        if math.isfinite(lasting):
            marks.append(Mark(after + lasting, EVENT, f'over: {row["text"]}'))
    marks += [
        Mark(float(row['time_s']), FAULT, str(row['text']), sources_of(str(row.get('source', ''))))
        for row in story.get('trips', ())
    ]
    stop = _stop_s(part)
    marks = [mark for mark in marks if mark.kind != OUTPUT or mark.time_s <= stop]
    if math.isfinite(stop):
        source = sources_of(str(part.meta.get('stop_source', '')))
        marks.append(Mark(stop, FAULT, f'stop: {part.meta["stopped"]}', source))
    within = [mark for mark in marks if part.time_s[0] <= mark.time_s <= part.time_s[-1]]
    return tuple(sorted(within, key=lambda mark: mark.time_s))


def _drives(trace: Trace) -> tuple[tuple[DriveChange, ...], ...]:
    """Return the changes of each drive; empty if the status word of any drive is unknown."""
    status = trace.meta.get('drive_status') or ()
    if not all(status):
        return ()
    start, period = (
        run_signals.noted_cycle(trace, 'start_cycle') or 0,
        run_signals.positive(trace, 'cycle_time_s'),
    )
    return tuple(tuple(_changes(rows, start, period)) for rows in status)


def _changes(rows: Sequence[Sequence[int]], start: int, period_s: float) -> Iterator[DriveChange]:
    before = None
    for cycle, word in rows:
        state = words.drive_state(word), words.brake_state(word)
        if state != before:  # words may differ in warnings only
            yield DriveChange((cycle - start) * period_s, *state)
        before = state


def _stop_s(part: Trace) -> float:
    """Return the time at which a fault stopped a simulation; inf if there was none or it is unknown."""
    start, cycle = (run_signals.noted_cycle(part, key) for key in ('start_cycle', 'stop_cycle'))
    if not part.meta.get('stopped') or start is None or cycle is None:
        return math.inf
    return float((cycle - start) * run_signals.positive(part, 'cycle_time_s'))


def _output_text(row: Mapping[str, Any]) -> str:
    payload = '' if row.get('payload_kg') is None else f', payload {float(row["payload_kg"]):g} kg'
    value = float(row['value'])
    if row['name'] == 'payload':
        return payload.removeprefix(', ')
    state = {0.0: 'off', 1.0: 'on'}.get(value, f'{value:g}')
    return f'{row["name"]} {state}{payload}'


def notes_of(trace: Trace) -> tuple[str, ...]:
    """Return sentences about missing data of a recording, and about assumptions made in reading it."""
    meta = trace.meta
    notes = [str(notice) for notice in meta.get('notices', ())]
    if meta.get('stopped'):
        notes.append(f'The program was aborted: {meta["stopped"]}')
    if meta.get('cut'):
        notes.append(f'The recording is incomplete: {meta["cut"]}')
    for key, what in (('lost', 'are missing'), ('refused', 'were malformed')):
        if counts := dict(meta.get(key) or {}):
            topic = max(counts, key=lambda name: counts[name])
            notes.append(
                f'{sum(counts.values())} messages of {len(counts)} topics {what}, most of {topic}: {counts[topic]}'
            )
    if (starts := meta.get('starts', ())) and len(starts) > 1:
        notes.append(
            f'The recording contains {len(starts)} programs; times count from the start of the first one'
        )
    return tuple(notes)


def named(runs: Sequence[Run]) -> list[str]:
    """Return a short unique name for each run: file or program and robot, with folders or a number where necessary."""

    def of_robot(name: str, run: Run) -> str:
        return f'{name} ({run.source})' if run.source else name

    short = [of_robot(Path(run.name).name or run.name, run) for run in runs]
    whole = [of_robot(run.name, run) for run in runs]
    numbered = [f'{n}: {name}' for n, name in enumerate(short, start=1)]
    return next((names for names in (short, whole) if len(set(names)) == len(names)), numbered)
