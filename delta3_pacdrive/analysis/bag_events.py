"""What a bag tells besides its signals: moves and when they were driven, outputs, holds, overrides, faults."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from delta3_pacdrive.analysis.planning.evaluation import of_recorded_move
from delta3_pacdrive.analysis.planning.report import limited_text
from delta3_pacdrive.analysis.run_signals import positive
from delta3_pacdrive.controller.messages import EXTEND, FAULT, ORDER, REVOKE, Origin
from delta3_pacdrive.errors import ProgramError, TelegramError
from delta3_pacdrive.faults.schedule import Scheduled
from delta3_pacdrive.motion.execution import MotionProfile, Timeline
from delta3_pacdrive.motion.extension import Row
from delta3_pacdrive.motion.plan import OUTPUTS, Move, Plan, PlanBuilder
from delta3_pacdrive.motion.plan_times import told_length_m
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.sercos.bus_time import NANOSECONDS, NEVER

LIMITS_MAX = 1000  # moves of which it is told what limits them: that takes milliseconds for each
ORDER_HEADER = 2  # of the row that ends a plan: start cycle, override
NUMBERS, TEXT, JOINT_STATE = (
    'std_msgs/msg/Float64MultiArray',
    'std_msgs/msg/String',
    'sensor_msgs/msg/JointState',
)


def read(path: Path, trace: Trace, robot: Parameters | None = None) -> dict[str, Any]:
    """Return moves, outputs, events, faults and trips of the bag of a trace, times [s] from the start of its program.

    They have the form that a simulation gives them in the ``meta`` of its trace. What is not recorded, or was written
    by somebody who does not know how, is not there. What limited a move is told if the robot is known.

    Raises
    ------
    TraceError
        The bag cannot be read.

    """
    from rosbags.typesys import Stores, get_typestore

    from delta3_pacdrive.recording.bag_reader import open_bag

    bag = open_bag(path)
    period = positive(trace, 'cycle_time_s')
    story = _Story(get_typestore(Stores.ROS2_JAZZY), period, int(trace.meta.get('start_cycle') or 0), robot)
    bag.read(
        {
            bag.robot + 'motion/plan': story.take(NUMBERS, story.plan),
            bag.robot + 'motion/course': story.take(NUMBERS, story.course),
            bag.robot + 'outputs': story.take(JOINT_STATE, story.outputs),
            bag.robot + 'faults/schedule': story.take(TEXT, story.fault),
            bag.robot + 'motion/progress': story.take(TEXT, story.progress),
        }
    )
    return story.told(round(float(trace.time_s[-1]) / period))


@dataclass(frozen=True)
class _Longer:
    """More moves for a plan that is driven."""

    told: Row
    more: Plan

    def taken_with(self, profile: MotionProfile) -> bool:
        """Whether they follow from a motion profile on; a robot that stands takes them later than asked for."""
        asked = self.told.profile
        later = profile.held and asked.held and profile.cycle > asked.cycle
        return later or (profile.cycle, profile.held) == (asked.cycle, asked.held)


_Followed = tuple[MotionProfile, _Longer | None]  # and what follows from it on, if a plan became longer


class _Story:
    """A story takes the messages of a bag in their order."""

    def __init__(self, typestore: Typestore, period_s: float, start: int, robot: Parameters | None) -> None:
        self._typestore, self._period_s, self._start, self._robot = typestore, period_s, start, robot
        self._limits: dict[int, str] = {}  # by the identity of a move
        self._moves: list[Move] = []
        self._plan: Plan | None = None
        self._longer: _Longer | None = None  # ordered, and perhaps taken
        self._timelines: list[tuple[Timeline, list[_Followed]]] = []
        self._switched: list[tuple[int, list[float]]] = []
        self._faults: list[dict[str, Any]] = []
        self._trips: dict[int, tuple[str, str]] = {}  # sentence and source by bus cycle

    def take(self, kind: str, add: Callable[[Any], None]) -> Callable[[bytes], None]:
        """Return what takes the bytes of a message."""
        from rosbags.serde import SerdeError

        def take(data: bytes) -> None:
            try:
                add(self._typestore.deserialize_cdr(data, kind))
            except (SerdeError, ProgramError, TelegramError, ValueError, TypeError, KeyError, IndexError):
                return  # a foreign writer

        return take

    def plan(self, message: Any) -> None:
        """Take a row of a plan: a move, or the order that ends the plan."""
        label = message.layout.dim[0].label if message.layout.dim else ''
        kind, row = Origin.from_label(label).kind, np.asarray(message.data)
        if kind in (ORDER, EXTEND):
            moves, self._moves = self._moves, []
            builder = PlanBuilder()
            for move in moves:
                builder.add(move)
            if kind == ORDER:
                self._plan = builder.build(row[ORDER_HEADER:].astype(np.int64))
            else:
                told = Row.from_array(row)
                self._longer = _Longer(told, builder.build(told.order))
        elif kind not in (FAULT, REVOKE):
            move, number, _ = Move.from_array(row, self._robot.kinematics if self._robot else None)
            self._moves = [*self._moves[:number], move]

    def course(self, message: Any) -> None:
        """Take what the master follows from a bus cycle on."""
        profile = MotionProfile.from_array(np.asarray(message.data))
        starts = profile.number == 0 and not profile.held and profile.table[0, 1] == 0.0
        if starts and len(profile.table) == 1 and self._plan is not None:
            self._timelines.append((Timeline(self._plan, self._period_s), [(profile, None)]))
        elif self._timelines:
            longer = self._longer if self._longer and self._longer.taken_with(profile) else None
            self._longer = None if longer else self._longer
            self._timelines[-1][1].append((profile, longer))

    def outputs(self, message: Any) -> None:
        """Take the state of all outputs since a bus cycle."""
        stamp = message.header.stamp
        cycle = round((stamp.sec + stamp.nanosec / NANOSECONDS) / self._period_s)
        self._switched.append((cycle, [float(value) for value in message.position]))

    def fault(self, message: Any) -> None:
        """Take a fault that is injected."""
        document = json.loads(message.data)
        document.pop('session', None)
        document.pop('serial', None)
        scheduled = Scheduled.from_document(document)
        row = {'text': scheduled.fault.text, 'after_s': self._time(scheduled.first)}
        if scheduled.end < NEVER:
            row['for_s'] = (scheduled.end - scheduled.first) * self._period_s
        self._faults.append(row)

    def progress(self, message: Any) -> None:
        """Take a report: it tells the fault of the robot, and the bus cycle in which that came."""
        facts = json.loads(message.data)
        if facts['fault'] and int(facts['fault_cycle']) >= 0:
            told = str(facts['fault']), str(facts.get('fault_source', ''))
            self._trips.setdefault(int(facts['fault_cycle']), told)

    def told(self, last_cycle: int) -> dict[str, Any]:
        """Return everything up to a bus cycle."""
        moves: list[dict[str, Any]] = []
        events: list[dict[str, Any]] = []
        for n, (timeline, profiles) in enumerate(self._timelines):
            follows = (
                self._timelines[n + 1][1][0][0].cycle if n + 1 < len(self._timelines) else last_cycle + 1
            )
            moves += self._driven(timeline, profiles, min(follows, last_cycle + 1))
            events += [self._event(profile, longer) for profile, longer in profiles[1:]]
        return {
            'moves': moves,
            'events': events,
            'outputs': list(self._changes()),
            'faults': self._faults,
            'trips': [
                {'time_s': self._time(cycle), 'text': text, 'source': source}
                for cycle, (text, source) in sorted(self._trips.items())
            ],
        }

    def _time(self, cycle: int) -> float:
        return (cycle - self._start) * self._period_s

    def _driven(self, timeline: Timeline, profiles: list[_Followed], end: int) -> list[dict[str, Any]]:
        """Return the moves of a program that were begun before a bus cycle, each from its first cycle to its last."""
        timeline.start(profiles[0][0].cycle, profiles[0][0].override)
        found: dict[int, list[int]] = {}
        known: dict[int, Move] = {}
        left_out = 0  # moves that are not in a longer plan any more
        follows = [*(profile.cycle for profile, _ in profiles[1:]), end]
        for number, ((profile, longer), until) in enumerate(zip(profiles, follows, strict=True)):
            if longer is not None:
                plan = timeline.plan.extended(longer.told.first, longer.told.kept, longer.more)
                timeline = timeline.extended(plan, profile)
                left_out += longer.told.first
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
                    'length_m': told_length_m(move),
                    'limited_by': self._limit(move),
                }
            )
        return moves

    def _limit(self, move: Move) -> str:
        """Say what limits a move, once for each that is driven again and again; '' if nobody knows."""
        if self._robot is None or (id(move) not in self._limits and len(self._limits) >= LIMITS_MAX):
            return ''
        if id(move) not in self._limits:
            row = of_recorded_move(move, self._robot)
            self._limits[id(move)] = limited_text(row) if row else ''
        return self._limits[id(move)]

    def _event(self, profile: MotionProfile, longer: _Longer | None) -> dict[str, Any]:
        text = 'stop on the path' if profile.held else f'on at {100.0 * profile.override:g} %'
        text = 'more moves follow' if longer else text
        return {'time_s': self._time(profile.cycle), 'text': text}

    def _changes(self) -> Any:
        """Tell which outputs changed, and the payload with the first of them."""
        names = [*OUTPUTS, 'payload']
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
