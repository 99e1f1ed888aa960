"""Bring-up without launch files: starts the processes of one robot, runs a program, reports, stops everything."""

import gc
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.srv import AddDiagnostics
from rclpy.node import Node

from delta3_pacdrive import interrupts, simulation
from delta3_pacdrive.bringup.environment import log_folder, only_one
from delta3_pacdrive.bringup.monitor import LOOK_S, STOP_WALL_S, RobotMonitor, brake
from delta3_pacdrive.bringup.options import Options, check_options
from delta3_pacdrive.bringup.processes import ManagedProcess, end_all, killed_sentence
from delta3_pacdrive.bringup.robot_processes import (
    PROCESS_OF,
    RECORDER,
    SPARE,
    STUCK_MAX_S,
    STUCK_S,
    PhaseWatch,
    RobotProcesses,
)
from delta3_pacdrive.bringup.scheduling import Schedule, set_scheduling
from delta3_pacdrive.errors import RunError, RunInterruptedError, TraceError
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.recording.bags import bag_trace
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.watchdog import BOUND_S, Watchdog
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.wire import discovery, domain, interfaces
from delta3_pacdrive.studies.runs.derived_signals import loads_of_round

ENERGY_CYCLES_MAX = 600_000  # of a recording that is evaluated for its energy


def waits_for_others(options: Options, progress: MotionProgress) -> bool:
    """Whether a robot only waits for the others of its shared bus clock, which have their own timeouts."""
    return bool(options.shared_clock) and progress.phase == 'CP3'


class Bringup:
    """One run of one robot.

    Parameters
    ----------
    options
        Options of the run.
    started_s
        Start of the run on the monotonic clock [s]; by default now.
    schedule
        Of this process after the robot's have been started: preferred if it reads every telegram.

    """

    def __init__(
        self, options: Options, started_s: float | None = None, schedule: Schedule = Schedule.ORDINARY
    ) -> None:
        self._schedule = schedule
        self._started_s = time.monotonic() if started_s is None else started_s
        self.options = options
        self.robot, self._program, self._planned = check_options(options)
        self.interrupted = self._is_in_haste = (
            False  # end requested, by a signal or ``stop``; without braking
        )
        self._interrupted_s = 0.0
        self._processes: RobotProcesses
        self._monitor: RobotMonitor
        self._process: node_process.Process
        self._phases = PhaseWatch(self.robot.axes)
        self._reports_watchdog = Watchdog(LOOK_S)  # of the transformation task
        self._deaf_s = STUCK_S  # timeout of the task before this process rejoins the domain
        self._has_guests = False  # nodes of others, which could not rejoin
        self._deadline_s = 0.0
        self.ready_s = 0.0  # time from the start to cyclic operation, 0 before it

    def run(
        self,
        show: Callable[[MotionProgress], None],
        rising: Callable[[MotionProgress], None] = lambda _: None,
    ) -> dict[str, Any]:
        """Start, run and stop the robot.

        ``show`` is called with the progress about ten times a second, ``rising`` before cyclic operation, when the
        progress may be empty.

        Raises
        ------
        RunError
            A process died, the bus did not start, a drive tripped, or the run was interrupted.

        """
        discovery.keep_to_this_machine()
        with only_one(self.options.namespace), log_folder(self.options.logs) as logs:
            simulation.compile_kernels(self.robot)
            simulation.load_cyclic_kernels(self.robot)  # once for all processes, and not in a bus cycle
            # later signals end the process as usual: reading a long recording takes time
            with interrupts.answered_by(self._interrupt):
                try:
                    self._start(logs)
                    self._watch(show, rising)
                    if self.options.cell is not None:
                        self._ask_for_parts()
                    result = self._result()
                finally:
                    self._stop()
        if self.options.bag:
            result |= self._recorded(self.options.bag, result['cycles'])
        return result

    def _recorded(self, bag: Path, cycles: int) -> dict[str, Any]:
        """Return facts about the recording; a damaged recording does not fail the run."""
        try:
            meta = bag_trace.metadata(bag)
            facts: dict[str, Any] = {
                'bag_missing': sum(meta.get('lost', {}).values()),
                'bag_cut': meta.get('cut', ''),
            }
            if self._planned and cycles <= ENERGY_CYCLES_MAX:
                facts |= self._energy(self._planned, bag)
        except TraceError as error:
            return {'bag_missing': 0, 'bag_cut': str(error)}
        return facts

    def _energy(self, planned: Planned, bag: Path) -> dict[str, Any]:
        """Return energy of a round and load of supply and gears from the recording, empty if it is incomplete."""
        trace = bag_trace.read_bag(bag)
        timeline = Timeline(planned.plan, self.robot.bus.cycle_time_s)
        timeline.start(trace.meta.get('start_cycle', NEVER))
        trace.meta['end_cycle'] = timeline.end_cycle  # not recorded
        return loads_of_round(trace, self.robot, planned.repeat)

    def _start(self, logs: Path) -> None:
        self._processes = RobotProcesses(
            self.options, self.robot, self._program.name if self._program else 'moves', logs
        )
        gc.freeze()  # the collector would touch all objects and thereby copy their pages in every child
        self._processes.start()
        set_scheduling(self._schedule)  # before the transport starts threads, which inherit it
        self._join()

    def _join(self) -> None:
        """Join the domain with a new monitor."""
        node_process.join()
        self._process = node_process.Process()
        self._monitor = RobotMonitor(self.options.namespace, getattr(self, '_monitor', None))
        self._process.add(self._monitor)
        self._reports_watchdog.received(time.monotonic())

    def _interrupt(self) -> None:
        """Request the end; a second request after a while skips braking."""
        now_s = time.monotonic()
        if self.interrupted and now_s - self._interrupted_s > interrupts.PATIENCE_S:
            self._is_in_haste = True
        if not self.interrupted:
            self._interrupted_s = now_s
        self.interrupted = True

    def _watch(
        self, show: Callable[[MotionProgress], None], rising: Callable[[MotionProgress], None]
    ) -> None:
        """Monitor the run until the program has ended."""
        monitor = self._monitor
        self._deadline_s = time.monotonic() + self.options.patience_s
        released = False
        while not (progress := self.poll()).finished or self._program is None:
            if not released and (monitor.recorder or not self.options.bag):
                self._processes.let_planner_go()
                released = True
            if progress.phase == 'CP4' and not self.ready_s:
                self.ready_s = time.monotonic() - self._started_s
            if self.ready_s:
                show(progress)
                if self._program is None and self.interrupted:
                    return
            elif time.monotonic() > self._deadline_s and not waits_for_others(self.options, progress):
                waiting = progress.waiting or monitor.refusal or 'the transformation task to appear'
                raise RunError(
                    f'the bus is not in cyclic operation after {self.options.patience_s:g} s: {waiting}'
                )
            else:
                rising(progress)
        self._await_currents()
        show(self._monitor.progress)

    def _await_currents(self) -> None:
        """Wait for the drives to report the currents of the program, which takes some cycles of the service channel."""
        deadline = time.monotonic() + BOUND_S
        while time.monotonic() < deadline and not self.interrupted:
            figures = self._monitor.progress.statistics.get('figures', {})
            if not any(None in figures.get(name, ()) for name in ('current_peak_a', 'current_rms_a')):
                return
            self._process.spin_for(LOOK_S)

    def _ask_for_parts(self) -> None:
        """Query unfinished part events of the plant, such as a part in the gripper."""
        service = self._monitor.input
        if not service.service_is_ready():
            return
        asked = service.call_async(AddDiagnostics.Request())
        deadline = time.monotonic() + BOUND_S
        while not asked.done() and time.monotonic() < deadline:
            self._process.spin_for(LOOK_S)
        answer = asked.result() if asked.done() else None
        if answer is not None and answer.success:
            self._monitor.parts.add(json.dumps(json.loads(answer.message)['under_way']))

    def poll(self, seconds: float = LOOK_S) -> MotionProgress:
        """Process messages for a while, raise if something went wrong, and return the newest progress."""
        monitor, before = self._monitor, self._monitor.progress
        self._process.spin_for(seconds)
        if self.interrupted and (self._program is not None or not self.ready_s):
            raise RunInterruptedError('interrupted')
        for process in list(self._processes.running):
            # a service manager may end all processes together: none is restarted then
            if process.poll() is not None and not self.interrupted:
                self._replace(process)
        if not self.interrupted:
            self._replace_silent_partners(monitor.progress is not before)
            monitor = self._monitor
        if monitor.progress.phase == 'CP4':
            self._processes.check_load(monitor.progress.cycles)
        if monitor.progress.fault and (self._program is not None or not self.ready_s):
            self._await_standstill()
            raise RunError(monitor.progress.fault)
        # once the program is loaded, rejections concern other clients
        if self._program is not None and not monitor.progress.moves and monitor.refusal:
            raise RunError(monitor.refusal)
        return monitor.progress

    def _replace(self, process: ManagedProcess) -> None:
        """Restart a dead process if the robot is to stay up; raises RunError if it cannot be restarted."""
        sentence = f'{process.ending()} in bus cycle {self._monitor.progress.cycles}'
        self._dispose(process)
        if process.name == RECORDER and self.ready_s:
            self._processes.running.remove(process)
            self.notes.append(f'{sentence}; the recording has ended, the robot continues')
        elif process.name == 'view':
            self._processes.running.remove(process)
            self.notes.append(f'{sentence}; the page has ended, the robot continues')
        elif self._stays_up and self._processes.restart(process):
            self._phases.restart(time.monotonic())
            self.notes.append(f'{sentence}; started again')
        elif process.name == interfaces.VISUALIZATION:
            self._processes.running.remove(process)
            self.notes.append(f'{sentence}; the markers have ended, the robot continues')
        else:
            if process.name not in ('robot', 'transformation_task', 'unit_robot'):
                self._await_standstill()
            raise RunError(sentence)

    @property
    def _stays_up(self) -> bool:
        """Whether the robot stays up for requests; a program or a script ends when a process dies."""
        return self._program is None and not self.options.script

    @property
    def _knows_participants(self) -> bool:
        """Whether identifiers of participants are those of Fast DDS."""
        return os.environ.get(discovery.MIDDLEWARE, '') in discovery.FAST_DDS

    def _still_loads(self, name: str) -> bool:
        """Whether the process of a participant runs but has not joined the domain yet."""
        processes = [one for one in self._processes.running if one.name == PROCESS_OF.get(name)]
        return self._knows_participants and not all(map(self._monitor.participants_of, processes))

    def _dispose(self, process: ManagedProcess) -> None:
        """Remove the participants of a dead process; otherwise its publishers count until the lease expires."""
        if not self._knows_participants:
            return
        hosts = [discovery.HERE, *discovery.peers_of(os.environ.get(discovery.PEERS, ''))]
        for prefix in self._monitor.participants_of(process):
            domain.dispose(prefix, hosts)

    def _replace_silent_partners(self, received: bool) -> None:
        """Replace participants for which the bus waits in vain; rejoin the domain if the task is not received."""
        now_s = time.monotonic()
        if received:
            self._reports_watchdog.received(now_s)
            self._deaf_s = STUCK_S
        elif self._reports_watchdog.silence_s(now_s) > self._deaf_s and not self._has_guests:
            node_process.leave(self._process)
            self._join()
            self._deaf_s = min(2.0 * self._deaf_s, STUCK_MAX_S)
            self.notes.append('no report from transformation_task: rejoined the domain')
        if any(map(self._still_loads, self._monitor.progress.missing)):
            self._phases.restart(now_s)  # on a busy machine loading exceeds the timeout
        for name in self._phases.update(self._monitor.progress, now_s):
            processes = [one for one in self._processes.running if one.name == PROCESS_OF.get(name)]
            for process in processes:
                end_all([process])
                self._dispose(process)
                if not self._processes.restart(process):
                    self._replace(process)
                    continue
                self._phases.restart(time.monotonic())
                self._deadline_s += STUCK_S
                self.notes.append(
                    f'the bus was in {self._monitor.progress.phase} for too long '
                    f'({self._monitor.progress.waiting}): started {process.name} again'
                )

    def _await_standstill(self) -> None:
        """Wait for a robot with a fault to stop, so that the stop is recorded."""
        deadline = time.monotonic() + BOUND_S
        while self._monitor.progress.in_torque and time.monotonic() < deadline:
            self._process.spin_for(LOOK_S)

    def _stop(self) -> None:
        """Stop the robot, then all processes."""
        if hasattr(self, '_monitor'):
            self._brake()
        if hasattr(self, '_processes'):
            killed = self._processes.end()
            if killed:
                sys.stderr.write(f'note: {killed_sentence(killed)}\n')
        node_process.leave(getattr(self, '_process', None))

    def _brake(self) -> None:
        """Disable the drives: a controlled stop, then the brakes."""
        monitor = self._monitor
        running = self._processes.running
        if not any(one.poll() is not None and one.name not in SPARE for one in running):
            deadline = time.monotonic() + STOP_WALL_S
            brake(
                monitor,
                self._process.spin_for,
                LOOK_S,
                lambda: self._is_in_haste or time.monotonic() > deadline,
            )

    def _result(self) -> dict[str, Any]:
        progress = self._monitor.progress
        facts = progress.to_fields()
        figures = progress.statistics.get('figures', {})
        statistics = ('refused_telegrams', 'slip_s', 'lateness_ms', 'mdt_to_last_at_ms', 'outstanding')
        unlearned = progress.unlearned
        dropped = [f'learned torques were not followed: {unlearned}'] if unlearned else []
        parts = self._monitor.parts.report()
        return {
            'ok': True,
            'program': self._planned.name if self._planned else '',
            'notices': [*(self._planned.notices if self._planned else ()), *dropped, *self.notes],
            'program_s': self._planned.plan.duration_s if self._planned else 0.0,
            'repeat': self._planned.repeat if self._planned else 1,
            'ready_s': round(self.ready_s, 3),
            **{key: facts[key] for key in ('cycles', 'bus_time_s', 'wall_time_s', 'overruns')},
            'lost_telegrams': progress.lost_telegrams,
            'restarts': self._processes.restarts,
            **figures,
            **{key: facts[key] for key in statistics if key in facts},
            **({} if parts is None else {'cell': parts}),
        }

    def add(self, node: Node) -> None:
        """Add a node to this process."""
        self._has_guests = True
        self._process.add(node)

    @property
    def node(self) -> Node:
        """The node of this process, for additional publishers and subscriptions."""
        self._has_guests = True
        return self._monitor

    def stop(self) -> None:
        """End a bring-up without a program."""
        self.interrupted = True

    @property
    def notes(self) -> list[str]:
        """Messages for the user about the processes."""
        return self._processes.notes if hasattr(self, '_processes') else []

    def processes(self) -> list[ManagedProcess]:
        """Return the processes of the robot."""
        return list(self._processes.running)
