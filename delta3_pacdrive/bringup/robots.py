"""Several robots under one supervisor: each has a bring-up of its own, in a process and a namespace of its own.

The supervisor takes no part in the graph. It starts the bring-ups, hears what they tell over pipes, and ends them all.
What happens to one robot does not touch the others: whoever dies is told by name, and stays away.
"""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from delta3_pacdrive import interrupts
from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup import scheduling
from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.cpu_load import cores_of_robot, in_turn, lack_of_room
from delta3_pacdrive.bringup.environment import log_folder, name_of
from delta3_pacdrive.bringup.options import Options, check_options
from delta3_pacdrive.bringup.page import started
from delta3_pacdrive.bringup.processes import ManagedProcess, spawn
from delta3_pacdrive.errors import Delta3Error, RunError, RunInterruptedError
from delta3_pacdrive.sercos.configuration_check import drives_of
from delta3_pacdrive.sercos.shared_clock import SharedClock, create
from delta3_pacdrive.view import serving

LOOK_S = 0.1
TELL_S = 0.2  # between two reports of a robot whose state does not change
END_S = 30.0  # for a robot to brake, and to close its bag
PARTICIPANTS_MAX = (
    31  # of the graph that find each other on one machine (config/localhost.xml), and one who operates
)
TOLD = (
    'phase',
    'waiting',
    'state',
    'fault',
    'in_torque',
    'bus_time_s',
    'cycles',
    'overruns',
    'lost_telegrams',
)


@dataclass
class RobotNow:
    """What the supervisor knows of a robot.

    Attributes
    ----------
    namespace
        Of the robot.
    progress
        Some of its newest report; empty before it has one.
    ready_s
        How long it took to come up [s]; 0 before it is.
    notes
        What people should know about it, in the order in which it came.
    result
        Of its bring-up; None before it has ended well.
    error
        Why it has ended; empty if it has not, or if it was asked to.
    ended
        Whether it has ended.

    """

    namespace: str
    progress: dict[str, Any] = field(default_factory=dict)
    ready_s: float = 0.0
    notes: list[str] = field(default_factory=list)
    result: dict[str, Any] | None = None
    error: str = ''
    ended: bool = False


def _drives(options: Options) -> int:
    return len(drives_of(core.load(options.parameters)))


def participants(robots: int, options: Options, page: bool) -> int:
    """Return how many processes of the graph some robots are."""
    nodes = 1 if options.single_process else _drives(options) + 2
    bringup_and_planner = 2
    return robots * (nodes + bringup_and_planner + page + (options.bag is not None) + options.markers)


def require_room(robots: int, options: Options, page: bool) -> None:
    """Raise RunError if so many robots would not find each other on one machine."""
    count = participants(robots, options, page)
    if count > PARTICIPANTS_MAX:
        most = PARTICIPANTS_MAX // participants(1, options, page)
        raise RunError(
            f'{robots} robots would be {count} processes of the graph, but no more than {PARTICIPANTS_MAX} find each '
            f'other on one machine: with these options there can be {most} robots'
        )


class Robots:
    """Some robots; ``run`` brings them up and keeps them up until it is asked to end.

    Parameters
    ----------
    options
        Of each robot, with its namespace; raises what is wrong with them.
    page
        Whether each has a page in the browser; and its ports, of the first robot on. Without a port it is a free one.
    started_s
        When the work on it began, on the clock that never jumps [s].
    shared_clock
        Whether they go by one bus clock.

    Attributes
    ----------
    now
        What is known of each.
    crowded
        Why there is no room to schedule them in real time; empty if there is, or if nobody looked.

    """

    def __init__(
        self,
        options: Sequence[Options],
        page: bool,
        port: int | None,
        started_s: float,
        shared_clock: bool = False,
    ) -> None:
        for one in options[:1]:  # the others are as this one is, but for names
            check_options(one)
        for one in options:
            if one.bag is not None and one.bag.exists():
                raise RunError(f'cannot record into {one.bag}: it exists already')
        # all come up at the same time, on the cores that there are
        share = max(1.0, len(options) / len(os.sched_getaffinity(0)))
        self._options = [replace(one, patience_s=share * one.patience_s) for one in options]
        self._places: list[SharedClock] = []
        if shared_clock:
            path = create(len(options))
            self._places = [SharedClock(path, member) for member in range(len(options))]
            self._options = [
                replace(one, shared_clock=path, clock_member=member)
                for member, one in enumerate(self._options)
            ]
        self._started_s = started_s
        self._ports = [port + n if port else None for n in range(len(options))] if page else []
        self.now = [RobotNow(one.namespace) for one in options]
        self.crowded = ''
        self._children: list[ManagedProcess] = []
        self._pipes: list[int] = []
        self._rests: list[bytes] = []
        self._is_ending = False

    def end(self) -> None:
        """Ask for the end of all."""
        self._is_ending = True

    def run(
        self, show: Callable[[Sequence[RobotNow]], None], say: Callable[[str], None] = lambda _: None
    ) -> None:
        """Bring them up, keep them up until ``end`` or until none is left.

        ``show`` is called with what is known, ``say`` with ``crowded`` before the first robot starts.
        """
        with log_folder(self._options[0].logs) as logs, ExitStack() as turn:
            self._ask_for_room(turn)
            if self.crowded:
                say(self.crowded)
            try:
                with interrupts.answered_by(self.end):
                    for number, options in enumerate(self._options):
                        self._start(number, options, logs / name_of(options.namespace))
                    while not all(robot.ended for robot in self.now) and not self._is_ending:
                        self._look()
                        if all(robot.progress or robot.ended for robot in self.now):
                            turn.close()  # they are scheduled as they are to be: the next one sees them
                        show(self.now)
                    self._ask_all(signal.SIGINT)
                    self._await_all(show)
            finally:
                self._kill_all()

    def _ask_for_room(self, turn: ExitStack) -> None:
        """Find out whether there is room for all in real time, and let nobody else ask until the turn is over."""
        options = self._options[0]
        paced = options.real_time_priority and options.real_time_factor > 0.0
        if paced and scheduling.real_time_is_permitted():
            count = len(self._options)
            turn.enter_context(in_turn())
            needed = count * cores_of_robot(options.single_process, _drives(options))
            self.crowded = lack_of_room(count, needed)
            self._options = [replace(one, crowded=self.crowded) for one in self._options]

    def _start(self, number: int, options: Options, logs: Path) -> None:
        logs.mkdir(exist_ok=True)
        read_end, write_end = os.pipe()
        port = self._ports[number] if self._ports else None

        def main() -> int:
            os.close(read_end)
            for pipe in self._pipes:
                os.close(pipe)
            return _be(options, logs, bool(self._ports), port, write_end, self._started_s)

        name = f'up {name_of(options.namespace)}'
        self._children.append(spawn(name, main, logs / 'bringup.log'))
        os.close(write_end)
        os.set_blocking(read_end, False)
        self._pipes.append(read_end)
        self._rests.append(b'')

    def _look(self) -> None:
        """Wait a little, then hear what the robots have told, and look who has ended."""
        time.sleep(LOOK_S)
        for number, (robot, child) in enumerate(zip(self.now, self._children, strict=True)):
            ended = child.poll() is not None
            for facts in self._heard(number):
                _take(robot, facts)
            if ended and not robot.ended:
                robot.ended = True
                if self._places:
                    self._places[number].leave()  # who has never come would be waited for
                if robot.result is None and not robot.error and not self._is_ending:
                    robot.error = child.ending()

    def _heard(self, number: int) -> Iterator[dict[str, Any]]:
        with suppress(BlockingIOError):
            while block := os.read(self._pipes[number], 65536):
                self._rests[number] += block
        *lines, self._rests[number] = self._rests[number].split(b'\n')
        yield from map(json.loads, lines)

    def _ask_all(self, number: signal.Signals) -> None:
        for child in self._children:
            child.send(number)

    def _await_all(self, show: Callable[[Sequence[RobotNow]], None]) -> None:
        deadline = time.monotonic() + END_S
        while not all(robot.ended for robot in self.now) and time.monotonic() < deadline:
            self._look()
            show(self.now)

    def _kill_all(self) -> None:
        """Leave nobody behind; who has not ended in time is told."""
        for robot, child in zip(self.now, self._children, strict=False):
            if child.poll() is None:
                os.kill(child.pid, signal.SIGKILL)
                os.waitpid(child.pid, 0)
                robot.error = f'it did not end within {END_S:g} s'
        for pipe in self._pipes:
            os.close(pipe)


def _take(robot: RobotNow, facts: dict[str, Any]) -> None:
    robot.progress = facts.get('progress', robot.progress)
    robot.ready_s = facts.get('ready_s', robot.ready_s)
    robot.notes += [facts['note']] if 'note' in facts else []
    robot.result = facts.get('result', robot.result)
    robot.error = facts.get('error', robot.error)


class _Teller:
    """Tells the supervisor how a robot is, over a pipe."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self._told: dict[str, Any] = {}
        self._told_s = 0.0
        self._ready = False
        self._notes = 0

    def tell(self, **facts: Any) -> None:
        line = json.dumps(facts).encode() + b'\n'
        with suppress(BrokenPipeError):  # a supervisor that was killed: a signal tells it
            while line:
                line = line[os.write(self._pipe, line) :]

    def look(self, bringup: Bringup, progress: dict[str, Any]) -> None:
        for note in bringup.notes[self._notes :]:
            self._notes += 1
            self.tell(note=note)
        if progress.get('in_torque') and not self._ready:
            self._ready = True
            self.tell(ready_s=bringup.ready_s)
        facts = {key: progress[key] for key in TOLD if key in progress}
        lasting = ('phase', 'waiting', 'state', 'fault', 'in_torque')
        changed = any(facts.get(key) != self._told.get(key) for key in lasting)
        if changed or time.monotonic() - self._told_s > TELL_S:
            self._told, self._told_s = facts, time.monotonic()
            self.tell(progress=facts)


def _be(options: Options, logs: Path, page: bool, port: int | None, pipe: int, started_s: float) -> int:
    """Be the bring-up of one robot; return the exit status."""
    for number in interrupts.NUMBERS:  # before the bring-up answers them
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    teller = _Teller(pipe)
    try:
        with ExitStack() as stack:
            view = None
            if page:
                place = stack.enter_context(serving.held(serving.HOST, port))
                view = stack.enter_context(started(place, options.namespace, logs))
                teller.tell(note=f'the page comes up at {place.url}')
            bringup = Bringup(replace(options, logs=logs, view=view), started_s)
            look = lambda progress: teller.look(bringup, progress)  # noqa: E731 (both are the same)
            result = bringup.run(look, look)
        teller.tell(result=result)
    except (RunInterruptedError, KeyboardInterrupt):  # while it came up
        return 0
    except (Delta3Error, OSError) as error:
        teller.tell(error=' '.join(str(error).split()))
        return 1
    return 0
