"""The processes of one robot: their nodes, scheduling and restarts."""

import os
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node

from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup import scheduling
from delta3_pacdrive.bringup.cpu_load import CpuLoadMonitor, cores_of_robot, in_turn, lack_of_room
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.bringup.processes import ManagedProcess, end_all, respawn, spawn
from delta3_pacdrive.bringup.scheduling import NOT_PERMITTED, Schedule
from delta3_pacdrive.control.operation.script_gate import first_decision
from delta3_pacdrive.recording.motion_progress import NO_REPORT, MotionProgress
from delta3_pacdrive.robot.faults.fault import TASK, UNIT_ROBOT
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, PLANT
from delta3_pacdrive.robot.sercos.watchdog import Watchdog
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.recorder import RecorderNode
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.parameters import overrides
from delta3_pacdrive.ros.wire import discovery, frames, preload
from delta3_pacdrive.ros.wire.interfaces import VISUALIZATION

RESTARTS_MAX, RESTARTS_S = 20, 60.0  # maximum number of restarts within a time
STUCK_S, STUCK_MAX_S = (
    15.0,
    120.0,
)  # the bus may wait for a participant; doubled each time until the bus is up
REPORT_S = 0.2  # between two reports of the transformation task
CLOSE_BAG_S = 10.0  # a bag without its metadata is lost
Nodes = dict[str, tuple[type[Node], dict[str, Any]]]  # kind and own parameters, by name
RECORDER = 'recorder'
SPARE = (RECORDER, 'view', VISUALIZATION)  # the robot continues without them
PROCESS_OF = {name: name for name in (PLANT, TASK, UNIT_ROBOT)} | {
    axis: f'mc4_drive_{number}' for number, axis in enumerate(ALL_DRIVES, 1)
}


class PhaseWatch:
    """Decides which participants are replaced because the bus waits for them in vain.

    Running processes may stop receiving from each other, for example after a long lack of processor time. Only time in
    which the transformation task reports counts: while it is suspended the state of the others is unknown.
    """

    def __init__(self, drives: Sequence[str]) -> None:
        self._drives = set(drives)
        self._stuck = Watchdog(REPORT_S)
        self._patience_s = STUCK_S
        self._in_vain = 0  # replacements since the bus was up
        self._newest = NO_REPORT

    def update(self, progress: MotionProgress, now_s: float) -> tuple[str, ...]:
        """Return the participants to replace, given the newest report of the transformation task."""
        if progress is self._newest:
            return ()
        is_first, self._newest = not self._newest.received, progress
        missing = set(progress.missing)
        if progress.phase == 'CP4':
            self._patience_s, self._in_vain = STUCK_S, 0
        if not missing or is_first:
            self._stuck.received(now_s)
        elif self._stuck.silence_s(now_s) > self._patience_s:
            self.restart(now_s)
            self._patience_s, self._in_vain = min(2.0 * self._patience_s, STUCK_MAX_S), self._in_vain + 1
            return self._cause(missing, progress.phase)
        return ()

    def restart(self, now_s: float) -> None:
        """Restart the timeout: a process has been started."""
        self._stuck.received(now_s)

    def _cause(self, missing: set[str], phase: str) -> tuple[str, ...]:
        """Return the participants whose replacement makes all missing ones visible."""
        if missing >= self._drives | {PLANT} or self._in_vain % 2 == 0:
            return (TASK,)
        if missing >= self._drives and phase != 'CP0':
            return (PLANT,)  # the drives reply to its shafts
        return tuple(sorted(missing))


class RobotProcesses:
    """The processes of one robot; their output goes to the folder ``logs``."""

    def __init__(self, options: Options, robot: core.Parameters, program: str, logs: Path) -> None:
        self._options, self._robot, self._program, self._logs = options, robot, program, logs
        self.running: list[ManagedProcess] = []  # including those that have ended unnoticed
        self.notes = list(filter(None, [discovery.exposure()]))  # messages for the user
        self.restarts = 0  # number of restarted processes
        # restart functions by name
        self._restarts: dict[str, Callable[[Schedule], ManagedProcess]] = {}
        self._restarted: list[float] = []  # when [s]
        self._cyclic: list[int] = []  # PIDs of the processes that work in each cycle
        # Without a clock the robot takes all available processor time, which must not be in real time.
        paced = options.real_time_priority and options.real_time_factor > 0.0
        # A planner without a heartbeat counts as dead.
        self._planner_schedule = Schedule.PREFERRED if options.real_time_priority else Schedule.ORDINARY
        self._permitted = paced and scheduling.real_time_is_permitted()
        if paced and not self._permitted:
            self.notes.append(NOT_PERMITTED)
        # of every node
        self._common = {frames.PREFIX: options.frame_prefix} if options.frame_prefix else {}
        self._crowded = options.crowded if self._permitted else ''
        self._in_real_time = False
        self._schedule = Schedule.REAL_TIME if paced else Schedule.ORDINARY
        self._load = CpuLoadMonitor()
        # The planner waits for a byte on its pipe: nothing may move before the recorder is ready.
        self._read_end, self._go = os.pipe()

    def start(self) -> None:
        """Start all processes, in real time if there is capacity; the planner waits."""
        preload.load_type_support()
        with in_turn() if self._crowded is None else nullcontext():
            if self._crowded is None:
                needed = cores_of_robot(self._options.single_process, len(self._robot.axes))
                self._crowded = lack_of_room(1, needed)
                self.notes += [self._crowded] if self._crowded else []
            if self._crowded:
                self._schedule = Schedule.SHORT
            self._in_real_time = self._permitted and not self._crowded
            self._start()
            if self._in_real_time:
                scheduling.await_real_time(self._cyclic)

    def _start(self) -> None:
        options, program = self._options, self._options.program
        task: dict[str, Any] = {
            'real_time_factor': float(options.real_time_factor),
            'joint_motion': options.joint_motion,
        }
        plant: dict[str, Any] = {'cell': str(options.cell)} if options.cell else {}
        if options.script:
            begins = first_decision(self._robot)
            task |= {'script_cycle': begins}
            plant |= {'cell_start_cycle': begins}
        if options.shared_clock:
            task |= {'shared_clock': options.shared_clock, 'clock_member': options.clock_member}
        axes = range(1, len(self._robot.axes) + 1)
        memory = options.memory or self._logs
        memory.mkdir(parents=True, exist_ok=True)
        nodes: Nodes = {
            'plant': (PlantNode, plant),
            **{
                f'mc4_drive_{axis}': (
                    MC4DriveNode,
                    {'axis': axis, 'memory': str(memory / f'axis{axis}.json')},
                )
                for axis in axes
            },
            'transformation_task': (
                TransformationTaskNode,
                task
                | ({'wait_for_program': True} if program else {})
                | ({'learned': str(options.learned)} if options.learned else {}),
            ),
        }
        planned: dict[str, Any] = {'cell': str(options.cell)} if options.cell else {}
        if program:
            planned |= {'program': str(program), 'first_statement': options.first}
        planner = UnitRobotNode, planned
        shown: Nodes = {VISUALIZATION: (RobotVisualizationNode, {})}
        if options.view is not None:
            self.running.append(options.view)
        if options.bag:
            bag = {'bag': str(options.bag), 'program': self._program}
            self._spawn(RECORDER, {RECORDER: (RecorderNode, bag)}, Schedule.PREFERRED)
            self.running[-1].patience_s = CLOSE_BAG_S
        cyclic = (
            {'robot': nodes}
            if options.single_process
            else {name: {name: node} for name, node in nodes.items()}
        )
        for name, own in cyclic.items():
            self._spawn(name, own, self._schedule)
            self._cyclic.append(self.running[-1].pid)
        if not options.single_process:
            self._prepare_restarts(nodes | {'unit_robot': planner, **shown})
        if options.markers:
            self._spawn(VISUALIZATION, shown)
        self._spawn('unit_robot', {'unit_robot': planner}, self._planner_schedule, waits=True)

    def let_planner_go(self) -> None:
        """Release the planner."""
        os.write(self._go, b'g')

    def end(self) -> list[str]:
        """End all processes, the recorder last; return the names of those that had to be killed."""
        os.close(self._go)
        os.close(self._read_end)
        recorders = [process for process in self.running if process.name == RECORDER]
        killed = end_all([process for process in self.running if process not in recorders])
        return killed + end_all(recorders)

    def _spawn(
        self, name: str, nodes: Nodes, schedule: Schedule = Schedule.ORDINARY, waits: bool = False
    ) -> None:
        factories = [
            partial(
                node,
                namespace=self._options.namespace,
                parameter_overrides=overrides(self._robot, values | self._common),
                cli_args=['--ros-args', '-r', f'__node:={own}'],
            )
            for own, (node, values) in nodes.items()
        ]

        def main() -> int:
            os.close(self._go)
            if waits and not os.read(self._read_end, 1):
                return 0
            return node_process.run(factories, [])

        self.running.append(spawn(name, main, self._log(name), schedule))

    def _log(self, name: str) -> Path:
        return self._logs / f'{name}.log'

    # restarts ---------------------------------------------------------------------------------------------------------

    def _prepare_restarts(self, nodes: Nodes) -> None:
        """Store how each process is restarted: separately, with the same parameters."""
        common = ['--ros-args', '--params-file', str(core.write(self._robot, self._logs / 'robot.yaml'))]
        common += ['-r', f'__ns:=/{self._options.namespace.strip("/")}']
        for key, text in self._common.items():
            common += ['-p', f"{key}:='{text}'"]  # quoted: a text such as yes would be read as a boolean
        for name, (node, values) in nodes.items():
            arguments = [*common, '-r', f'__node:={name}']
            for key, value in values.items():
                # learned torques are discarded after a fault, such as the death of a process, but not before a program
                if key != 'learned' or self._options.program:
                    arguments += ['-p', f'{key}:={value}']
            self._restarts[name] = partial(respawn, name, node.__module__, arguments, self._log(name))

    def restart(self, process: ManagedProcess) -> bool:
        """Restart a dead process; False if it cannot be restarted, or too many have died."""
        now = time.monotonic()
        self._restarted = [then for then in self._restarted if now - then < RESTARTS_S]
        if process.name not in self._restarts or len(self._restarted) >= RESTARTS_MAX:
            return False
        self._restarted.append(now)
        self.restarts += 1
        own = {'unit_robot': self._planner_schedule, VISUALIZATION: Schedule.ORDINARY}
        schedule = own.get(process.name, self._schedule)
        self.running[self.running.index(process)] = self._restarts[process.name](schedule)
        return True

    def check_load(self, cycle: int) -> None:
        """Remove real-time scheduling if the robot overloads the machine and starves all other processes."""
        cores = self._load.excess() if self._in_real_time else 0.0
        if cores:
            self._in_real_time, self._schedule = False, Schedule.ORDINARY
            for process in self.running:
                scheduling.drop_real_time(process.pid)
            self.notes.append(
                f'the machine is too slow: its real-time work takes {cores:.2f} of its cores; from bus cycle '
                f'{cycle} on it is scheduled like any other process'
            )
