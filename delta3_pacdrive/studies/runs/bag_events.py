"""Events in a bag: executed moves, their times and limits, outputs, holds, overrides and faults.

The limits of a recorded move are given as far as they can be determined without its program.
"""

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from delta3_pacdrive.control.messages import EXTEND, FAULT, LAST, ORDERS, REVOKE, Origin
from delta3_pacdrive.errors import Delta3Error, ProgramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.extension import Row
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import OUTPUTS as OUTPUT_NAMES
from delta3_pacdrive.planning.paths.move import STANDING, TIMED, Move, MoveKind
from delta3_pacdrive.planning.plan import Plan, PlanBuilder
from delta3_pacdrive.planning.plan_times import path_length_m
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.planning.timing.move_grid import Stretches
from delta3_pacdrive.recording.bag_messages import (
    FAULTS,
    MALFORMED,
    OUTPUTS,
    PLAN,
    PROFILE,
    PROGRESS,
    BagMessages,
    Sessions,
)
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.faults.schedule import Scheduled
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS, NEVER
from delta3_pacdrive.studies.places.planning.evaluation import AT_LIMIT, LIMITING, QUANTITIES, study
from delta3_pacdrive.studies.places.planning.report import limited_text
from delta3_pacdrive.studies.places.planning.study import MoveRow, Quantity
from delta3_pacdrive.studies.runs.run_signals import positive

LIMITS_MAX = 1000  # moves whose limit is determined; each takes milliseconds
ORDER_HEADER = 2  # leading values of the row that ends a plan: start cycle, override
BEYOND_LIMIT = 1.02  # a limit exceeded by more cannot be the limit of the move
# Least share of the time in which a limit leads that it is used up. True limits: at least 0.65 in packaged programs;
# TCP jerk of moves limited by the torque rate: 0.07 to 0.21.
LASTING = 0.4
CRUISING = 1e-3  # share of the largest acceleration below which the speed of the master is constant


def read(messages: BagMessages, trace: Trace, robot: Parameters | None = None) -> dict[str, Any]:
    """Return moves, outputs, events, faults and trips of the bag of a trace, times [s] from the start of its program.

    The format is that of the ``meta`` of a simulated trace. Messages that were not recorded or that come from an
    unknown publisher are missing; ``notes`` explains which programs have no moves. The limit of each move is added if
    ``robot`` is given.
    """
    period = positive(trace, 'cycle_time_s')
    story = _Story(period, int(trace.meta.get('start_cycle') or 0), robot, messages.sessions)
    messages.decode(
        {
            PLAN: story.plan,
            PROFILE: story.course,
            OUTPUTS: story.outputs,
            FAULTS: story.fault,
            PROGRESS: story.progress,
        }
    )
    return story.to_dict(round(float(trace.time_s[-1]) / period))


@dataclass(frozen=True)
class _Longer:
    """Moves appended to a plan that is being executed."""

    row: Row
    more: Plan

    def taken_with(self, profile: MotionProfile) -> bool:
        """Whether a motion profile accepts these moves; a robot at rest accepts them later than requested."""
        asked = self.row.profile
        later = profile.held and asked.held and profile.cycle > asked.cycle
        return later or (profile.cycle, profile.held) == (asked.cycle, asked.held)


_Followed = tuple[MotionProfile, _Longer | None]  # and the moves appended with it


_Sender = tuple[str, str]  # planner and session


@dataclass
class _Coming:
    """Parts of an order received from a planner so far."""

    number: int = -1
    moves: list[Move] = field(default_factory=list)
    plan: Plan | None = None
    longer: _Longer | None = None  # requested, perhaps not accepted yet


@dataclass(frozen=True)
class _Run:
    """Execution of a program; its moves are unknown without a plan."""

    session: str
    plan: Plan | None
    profiles: list[_Followed]

    @property
    def start(self) -> int:
        return self.profiles[0][0].cycle


def _origin(message: Any) -> Origin:
    """Return the origin of a row; raises TelegramError."""
    return Origin.from_label(message.layout.dim[0].label if message.layout.dim else '')


class _Story:
    """Collects the messages of a bag in their order."""

    def __init__(self, period_s: float, start: int, robot: Parameters | None, sessions: Sessions) -> None:
        self._period_s, self._start, self._robot = period_s, start, robot
        self._limits: dict[int, str] = {}  # by the identity of a move
        self._sessions = sessions
        self._coming: dict[_Sender, _Coming] = {}
        self._runs: list[_Run] = []
        self._newest: dict[_Sender, _Run] = {}
        self._switched: list[tuple[int, list[float]]] = []
        self._faults: list[dict[str, Any]] = []
        self._trips: dict[int, tuple[float, str, str]] = {}  # time, sentence and source by bus cycle

    def plan(self, message: Any) -> None:
        """Add a row of a plan: a move, or the order that completes the plan."""
        origin, row = _origin(message), np.asarray(message.data)
        if origin.kind in (FAULT, REVOKE):
            return
        coming = self._coming.setdefault((origin.planner, origin.session), _Coming())
        if origin.number != coming.number:
            coming.number, coming.moves = origin.number, []
        if origin.kind not in LAST:
            move, number, _ = Move.from_array(row, self._robot.kinematics if self._robot else None)
            if number > len(coming.moves):
                raise ProgramError(f'move {number} came where {len(coming.moves)} was due')
            coming.moves[number:] = [move]
            return
        builder = PlanBuilder()
        for move in coming.moves:
            builder.add(move)
        if origin.kind in ORDERS:
            coming.plan = coming.longer = None
            coming.plan = builder.build(row[ORDER_HEADER:].astype(np.int64))
        elif origin.kind == EXTEND:
            extension = Row.from_array(row)
            coming.longer = _Longer(extension, builder.build(extension.order))

    def course(self, message: Any) -> None:
        """Add a motion profile; profiles of planners whose plan was not recorded are ignored."""
        origin = _origin(message)
        sender = origin.planner, origin.session
        coming = self._coming.get(sender)
        if coming is None:
            return
        profile = MotionProfile.from_array(np.asarray(message.data))
        starts = profile.number == 0 and not profile.held and profile.table[0, 1] == 0.0
        if starts and len(profile.table) == 1:
            self._newest[sender] = run = _Run(origin.session, coming.plan, [(profile, None)])
            self._runs.append(run)
            coming.plan = coming.longer = None
        elif sender in self._newest:
            longer = coming.longer if coming.longer and coming.longer.taken_with(profile) else None
            coming.longer = None if longer else coming.longer
            self._newest[sender].profiles.append((profile, longer))

    def outputs(self, message: Any) -> None:
        """Add the state of all outputs, valid from a bus cycle on."""
        if len(message.position) != len(OUTPUT_NAMES) + 1 or not np.isfinite(message.position).all():
            return
        stamp = message.header.stamp
        cycle = round((stamp.sec + stamp.nanosec / NANOSECONDS) / self._period_s)
        self._switched.append((cycle, [float(value) for value in message.position]))

    def fault(self, message: Any) -> None:
        """Add an injected fault."""
        document = json.loads(message.data)
        document.pop('session', None)
        document.pop('serial', None)
        scheduled = Scheduled.from_document(document)
        row = {'text': scheduled.fault.text, 'after_s': self._time(scheduled.first)}
        if scheduled.end < NEVER:
            row['for_s'] = (scheduled.end - scheduled.first) * self._period_s
        self._faults.append(row)

    def progress(self, message: Any) -> None:
        """Add the fault of the robot, with its bus cycle, from a progress report."""
        report = MotionProgress.of_recording(message.data)
        cycle = report.fault_cycle
        if report.fault and cycle >= 0:
            self._trips.setdefault(cycle, (self._time(cycle), report.fault, report.fault_source))

    def to_dict(self, last_cycle: int) -> dict[str, Any]:
        """Return all events up to a bus cycle."""
        moves: list[dict[str, Any]] = []
        events: list[dict[str, Any]] = []
        notes: list[str] = []
        runs = [run for run in self._runs if self._sessions.holds(run.session)]
        ends = [*(run.start for run in runs[1:]), last_cycle + 1]
        for run, end in zip(runs, ends, strict=False):
            try:
                moves += self._driven(run, min(end, last_cycle + 1))
            except MALFORMED as error:
                why = (
                    str(error)
                    if isinstance(error, Delta3Error)
                    else 'it contains numbers that are not valid in a program'
                )
                notes.append(
                    f'The moves of the program that began at {self._time(run.start):.3f} s are unknown: {why}'
                )
            events += [self._event(profile, longer) for profile, longer in run.profiles[1:]]
        return {
            'moves': moves,
            'events': events,
            'outputs': list(self._changes()),
            'faults': self._faults,
            'trips': [
                {'time_s': time_s, 'text': text, 'source': source}
                for _, (time_s, text, source) in sorted(self._trips.items())
            ],
            'notes': notes,
        }

    def _time(self, cycle: int) -> float:
        return (cycle - self._start) * self._period_s

    def _driven(self, run: _Run, end: int) -> list[dict[str, Any]]:
        """Return the moves that a program began before a bus cycle, each from its first to its last cycle.

        Raises
        ------
        ProgramError
            The plan is unknown, or a motion profile does not follow from its predecessor: rows are missing.

        """
        profiles = run.profiles
        if run.plan is None:
            raise ProgramError('its plan is not recorded completely')
        timeline = Timeline(run.plan, self._period_s)
        timeline.start(profiles[0][0].cycle, profiles[0][0].override)
        found: dict[int, list[int]] = {}
        known: dict[int, Move] = {}
        left_out = 0  # moves that an extended plan no longer contains
        follows = [*(profile.cycle for profile, _ in profiles[1:]), end]
        for number, ((profile, longer), until) in enumerate(zip(profiles, follows, strict=True)):
            if longer is not None:
                plan = timeline.plan.extended(longer.row.first, longer.row.kept, longer.more)
                timeline = timeline.extended(plan, profile)
                left_out += longer.row.first
            elif number:
                timeline.change(profile)
            over = timeline.end_cycle
            for cycle in range(profile.cycle, min(until, over, end)):
                now = timeline.at(cycle).number + left_out
                known[now] = timeline.plan.move(now - left_out)
                found.setdefault(now, [cycle, cycle])[1] = cycle + 1
        moves = []
        for number, (first, last) in sorted(found.items()):
            move = known[number]
            moves.append(
                {
                    'kind': move.kind.name.lower(),
                    'start_s': self._time(first),
                    'end_s': self._time(last),
                    'length_m': path_length_m(move),
                    'limited_by': self._limit(move),
                }
            )
        return moves

    def _limit(self, move: Move) -> str:
        """Return the limit of a move, computed once per move; empty if unknown."""
        if self._robot is None or (id(move) not in self._limits and len(self._limits) >= LIMITS_MAX):
            return ''
        if id(move) not in self._limits:
            row = of_recorded_move(move, self._robot)
            self._limits[id(move)] = limited_text(row) if row else ''
        return self._limits[id(move)]

    def _event(self, profile: MotionProfile, longer: _Longer | None) -> dict[str, Any]:
        text = 'stop on the path' if profile.held else f'on at {100.0 * profile.override:g} %'
        return {'time_s': self._time(profile.cycle), 'text': 'more moves follow' if longer else text}

    def _changes(self) -> Any:
        """Yield the changes of outputs; the first change of a cycle carries the payload if that changed."""
        names = [*OUTPUT_NAMES, 'payload']
        for (_, before), (cycle, after) in zip(self._switched, self._switched[1:], strict=False):
            changed = [n for n, (a, b) in enumerate(zip(before, after, strict=False)) if a != b]
            payload = after[-1] if len(names) - 1 in changed else None
            for n in changed[:-1] if payload is not None and len(changed) > 1 else changed:
                yield {
                    'time_s': self._time(cycle),
                    'name': names[n],
                    'value': after[n],
                    'payload_kg': payload,
                }
                payload = None


def of_recorded_move(move: Move, parameters: Parameters) -> MoveRow | None:
    """Evaluate a recorded move without its program; return None if its limit cannot be determined.

    The limits assumed for the TCP are those of the stops of the move and its constant speed. The result is valid only
    if the move reaches another limit as well; a move slowed down because of the rms current reaches none.
    """
    known = Planned(
        name='',
        plan=Plan.of([move]),
        notices=(),
        rms_current_a=(0.0, 0.0, 0.0),
        override_max=1.0,
        repeat=1,
        names=('',),
        stretches=(_stretches(move),),
        rate=1.0,
        loads=(),
        ends=(),
        open_from=None,
        payload_kg=move.payload_kg,
        torque_rates_n_m_s=(math.inf,),
    )
    found = study(known, parameters)
    (row,) = found.rows
    quantity = row.limited_by.quantity
    if quantity == Quantity.TIME:
        return row
    reached = max(use.used for use in row.uses if use.quantity != Quantity.TCP_SPEED)
    exceeded = max(use.used for use in row.uses) > BEYOND_LIMIT
    # a leading limit that is rarely used up is a side effect, for example of a motion at a limit of the torque rate
    leads = found.samples.leading == QUANTITIES.index(quantity)
    lasts = quantity not in LIMITING or np.count_nonzero(
        found.samples.used[quantity][leads] >= AT_LIMIT
    ) > LASTING * np.count_nonzero(leads)
    return row if reached >= AT_LIMIT and not exceeded and lasts else None


def _stretches(move: Move) -> Stretches:
    """Return the TCP limits found in a move; empty if the program gives the time."""
    if move.kind in (*STANDING, *TIMED, MoveKind.TURN):
        return ()
    acceleration = np.abs(move.master[:, 3])
    even = (move.master[:, 4] == 0.0) & (acceleration <= CRUISING * acceleration.max())
    speed = float(move.master[even, 2].max(initial=0.0))
    return ((move.length_m, Limits(speed or np.inf, move.stop_acceleration, move.stop_jerk)),)
