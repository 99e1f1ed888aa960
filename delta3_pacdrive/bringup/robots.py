"""Several robots under one supervisor: each has a bring-up in a separate process and namespace.

The supervisor is not part of the ROS graph. It starts the bring-ups, receives their reports over pipes, and ends them.
A failed robot is reported by name and not restarted; the others continue.
"""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
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
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.shared_clock import SharedClock, create
from delta3_pacdrive.view import serving

LOOK_S = 0.1
TELL_S = 0.2  # period of the reports of a robot whose state does not change
END_S = 30.0  # timeout for a robot to brake and to close its bag
PARTICIPANTS_MAX = 31  # that discover each other on one host (config/localhost.xml), and one operator
REPORTED = (
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
    """State of a robot as known to the supervisor."""

    namespace: str
    progress: dict[str, Any] = field(default_factory=dict)  # part of its newest report
    ready_s: float = 0.0  # start-up time, 0 before it is up
    notes: list[str] = field(default_factory=list)  # messages for the user
    result: dict[str, Any] | None = None  # of a successful bring-up
    error: str = ''  # reason of an unexpected end
    ended: bool = False


def _drives(options: Options) -> int:
    return len(core.load(options.parameters).axes)


def participants(robots: int, options: Options, page: bool) -> int:
    """Return the number of participants of several robots."""
    nodes = 1 if options.single_process else _drives(options) + 2
    bringup_and_planner = 2
    return robots * (nodes + bringup_and_planner + page + (options.bag is not None) + options.markers)


def require_room(robots: int, options: Options, page: bool) -> None:
    """Raise RunError if so many robots could not discover each other on one host."""
    count = participants(robots, options, page)
    if count > PARTICIPANTS_MAX:
        most = PARTICIPANTS_MAX // participants(1, options, page)
        raise RunError(
            f'{robots} robots would have {count} participants, but no more than {PARTICIPANTS_MAX} discover each '
            f'other on one machine: with these options {most} robots are possible'
        )


class Robots:
    """Several robots; ``run`` starts them and keeps them up until their end is requested.

    Parameters
    ----------
    options
        Of each robot, with its namespace.
    page, port
        Whether each has a page, and the port of the first one; None: free ports.
    started_s
        Start of the run on the monotonic clock [s].
    shared_clock
        Whether the robots share one bus clock.

    """

    def __init__(
        self,
        options: Sequence[Options],
        page: bool,
        port: int | None,
        started_s: float,
        shared_clock: bool = False,
    ) -> None:
        for one in options[:1]:  # the others differ in names only
            check_options(one)
        for one in options:
            if one.bag is not None and one.bag.exists():
                raise RunError(f'cannot record into {one.bag}: it exists already')
        # all robots start together and share the cores
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
        self.crowded = ''  # reason against real-time scheduling; empty if possible or unchecked
        self._children: list[ManagedProcess] = []
        self._pipes: list[int] = []
        self._rests: list[bytes] = []
        self._is_ending = False

    def end(self) -> None:
        """Request the end of all robots."""
        self._is_ending = True

    def run(
        self, show: Callable[[Sequence[RobotNow]], None], log: Callable[[str], None] = lambda _: None
    ) -> None:
        """Start the robots and keep them up until ``end`` or until all have ended.

        ``show`` is called with their states, ``log`` with ``crowded`` before the first robot starts.
        """
        with log_folder(self._options[0].logs) as logs, ExitStack() as turn:
            self._ask_for_room(turn)
            if self.crowded:
                log(self.crowded)
            try:
                with interrupts.answered_by(self.end):
                    for number, options in enumerate(self._options):
                        self._start(number, options, logs / name_of(options.namespace))
                    while not all(robot.ended for robot in self.now) and not self._is_ending:
                        self._poll()
                        if all(robot.progress or robot.ended for robot in self.now):
                            turn.close()  # they have their final scheduling, which the next bring-up measures
                        show(self.now)
                    self._ask_all(signal.SIGINT)
                    self._await_all(show)
            finally:
                self._kill_all()

    def _ask_for_room(self, turn: ExitStack) -> None:
        """Check the capacity for all robots, and hold the lock until they have started."""
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
            return _be(
                options, logs, page=bool(self._ports), port=port, pipe=write_end, started_s=self._started_s
            )

        name = f'up {name_of(options.namespace)}'
        self._children.append(spawn(name, main, logs / 'bringup.log'))
        os.close(write_end)
        os.set_blocking(read_end, False)
        self._pipes.append(read_end)
        self._rests.append(b'')

    def _poll(self) -> None:
        """Wait a little, then process reports and check for ended processes."""
        time.sleep(LOOK_S)
        for number, (robot, child) in enumerate(zip(self.now, self._children, strict=True)):
            ended = child.poll() is not None
            for facts in self._reports(number):
                _update(robot, facts)
            if ended and not robot.ended:
                robot.ended = True
                if self._places:
                    self._places[number].leave()  # otherwise the others would wait for it
                if robot.result is None and not robot.error and not self._is_ending:
                    robot.error = child.ending()

    def _reports(self, number: int) -> Iterator[dict[str, Any]]:
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
            self._poll()
            show(self.now)

    def _kill_all(self) -> None:
        """Kill the remaining processes and report those that did not exit in time."""
        for robot, child in zip(self.now, self._children, strict=False):
            if child.poll() is None:
                os.kill(child.pid, signal.SIGKILL)
                os.waitpid(child.pid, 0)
                robot.error = f'it did not end within {END_S:g} s'
        for pipe in self._pipes:
            os.close(pipe)


def _update(robot: RobotNow, facts: dict[str, Any]) -> None:
    robot.progress = facts.get('progress', robot.progress)
    robot.ready_s = facts.get('ready_s', robot.ready_s)
    robot.notes += [facts['note']] if 'note' in facts else []
    robot.result = facts.get('result', robot.result)
    robot.error = facts.get('error', robot.error)


class _Reporter:
    """Sends the state of a robot to the supervisor over a pipe."""

    def __init__(self, pipe: int) -> None:
        self._pipe = pipe
        self._reported: dict[str, Any] = {}
        self._reported_s = 0.0
        self._ready = False
        self._notes = 0

    def send(self, **facts: Any) -> None:
        line = json.dumps(facts).encode() + b'\n'
        with suppress(BrokenPipeError):  # the supervisor was killed; a signal will follow
            while line:
                line = line[os.write(self._pipe, line) :]

    def update(self, bringup: Bringup, progress: MotionProgress) -> None:
        for note in bringup.notes[self._notes :]:
            self._notes += 1
            self.send(note=note)
        if progress.in_torque and not self._ready:
            self._ready = True
            self.send(ready_s=bringup.ready_s)
        facts = {key: getattr(progress, key) for key in REPORTED} if progress.received else {}
        lasting = ('phase', 'waiting', 'state', 'fault', 'in_torque')
        changed = any(facts.get(key) != self._reported.get(key) for key in lasting)
        if changed or time.monotonic() - self._reported_s > TELL_S:
            self._reported, self._reported_s = facts, time.monotonic()
            self.send(progress=facts)


def _be(options: Options, logs: Path, page: bool, port: int | None, pipe: int, started_s: float) -> int:
    """Run the bring-up of one robot in a child process; return the exit status."""
    for number in interrupts.NUMBERS:  # before the bring-up handles them
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    reporter = _Reporter(pipe)
    try:
        with ExitStack() as stack:
            view = None
            if page:
                place = stack.enter_context(serving.held(serving.HOST, port))
                view = stack.enter_context(started(place, options.namespace, logs))
                reporter.send(note=f'the page comes up at {place.url}')
            bringup = Bringup(replace(options, logs=logs, view=view), started_s)
            update = partial(reporter.update, bringup)
            result = bringup.run(update, update)
        reporter.send(result=result)
    except (RunInterruptedError, KeyboardInterrupt):  # during start-up
        return 0
    except (Delta3Error, OSError) as error:
        reporter.send(error=' '.join(str(error).split()))
        return 1
    return 0
