"""The processes of one robot: which there are, how they are scheduled, and how one that has died is started again."""

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup.cpu_load import CpuLoadMonitor
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.bringup.processes import ManagedProcess, end_all, respawn, spawn
from delta3_pacdrive.bringup.scheduling import (
    NOT_PERMITTED,
    Schedule,
    drop_real_time,
    real_time_is_permitted,
)
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.recorder import RecorderNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode

RESTARTS_MAX, RESTARTS_S = 20, 60.0  # of processes that die, within that time
CLOSE_BAG_S = 10.0  # a bag without its metadata is lost
AXES = (1, 2, 3)
SPARE = ('recorder', 'view')  # a robot goes on without them


class RobotProcesses:
    """The processes of one robot.

    Parameters
    ----------
    options, robot, program
        What is asked for, parameters of the robot, name of the program for the recorder.
    logs
        Folder for what they print.

    Attributes
    ----------
    running
        All of them, those that have ended unnoticed as well.
    notes
        What people should know about how they run.

    """

    def __init__(self, options: Options, robot: core.Parameters, program: str, logs: Path) -> None:
        self._options, self._robot, self._program, self._logs = options, robot, program, logs
        self.running: list[ManagedProcess] = []
        self.notes: list[str] = []
        self._restarts: dict[
            str, Callable[[Schedule], ManagedProcess]
        ] = {}  # how one is started again, by name
        self._restarted: list[float] = []  # when [s]
        # Without a clock the robot takes all the processor time there is; that must not be in real time.
        paced = options.real_time_priority and options.real_time_factor > 0.0
        self._schedule = Schedule.REAL_TIME if paced else Schedule.ORDINARY
        self._in_real_time = paced and real_time_is_permitted()
        if paced and not self._in_real_time:
            self.notes.append(NOT_PERMITTED)
        self._load = CpuLoadMonitor()
        # The planner waits for a word on its pipe: nothing may move before the recorder listens.
        self._read_end, self._go = os.pipe()

    def start(self) -> None:
        """Start all of them; the planner waits."""
        options, program = self._options, self._options.program
        task = {'real_time_factor': options.real_time_factor, 'wait_for_program': program is not None}
        nodes: dict[str, Callable[[], Node]] = {
            'plant': self._factory(PlantNode, {}),
            **{
                f'mc4_drive_{axis}': self._factory(MC4DriveNode, {'axis': axis}, f'mc4_drive_{axis}')
                for axis in AXES
            },
            'transformation_task': self._factory(TransformationTaskNode, task),
        }
        if options.bag:
            bag = {'bag': str(options.bag), 'program': self._program}
            self._spawn('recorder', [self._factory(RecorderNode, bag)], Schedule.PREFERRED)
            self.running[-1].patience_s = CLOSE_BAG_S
        if options.single_process:
            self._spawn('robot', [*nodes.values()], self._schedule)
        else:
            for name, factory in nodes.items():
                self._spawn(name, [factory], self._schedule)
            if program is None:
                self._prepare_restarts()
        planner = self._factory(UnitRobotNode, {'program': str(program or '')})
        self._spawn('unit_robot', [planner], waits=True)
        if options.view_port is not None:
            self._start_view(options.view_port)

    def let_planner_go(self) -> None:
        """Let the planner begin."""
        os.write(self._go, b'g')

    def end(self) -> list[str]:
        """End all of them; return the names of those that had to be killed."""
        os.close(self._go)
        os.close(self._read_end)
        return end_all(self.running)

    def _factory(self, node: type[Node], values: dict[str, Any], name: str = '') -> Callable[[], Node]:
        flat = core.flatten(self._robot) | values
        overrides = [
            Parameter(key, value=list(value) if isinstance(value, tuple) else value)
            for key, value in flat.items()
        ]
        arguments = ['--ros-args', '-r', f'__node:={name}'] if name else []
        return partial(
            node, namespace=self._options.namespace, parameter_overrides=overrides, cli_args=arguments
        )

    def _spawn(
        self,
        name: str,
        factories: list[Callable[[], Node]],
        schedule: Schedule = Schedule.ORDINARY,
        waits: bool = False,
    ) -> None:
        def main() -> int:
            os.close(self._go)
            if waits and not os.read(self._read_end, 1):
                return 0
            return node_process.run(factories, [])

        self.running.append(spawn(name, main, self._log(name), schedule))

    def _start_view(self, port: int) -> None:
        """Start the page as a command of its own, so that nothing of it is loaded into the robot's processes."""
        arguments = ['view', '--wait', '--port', str(port), '--namespace', self._options.namespace]
        command = 'delta3_pacdrive.cli.main'
        self.running.append(respawn('view', command, arguments, self._log('view'), Schedule.ORDINARY))

    def _log(self, name: str) -> Path:
        return self._logs / f'{name}.log'

    # afterwards -------------------------------------------------------------------------------------------------------

    def _prepare_restarts(self) -> None:
        """Note how a process that dies is started again: by itself, with the same parameters."""
        options = self._options
        common = ['--ros-args', '--params-file', str(core.write(self._robot, self._logs / 'robot.yaml'))]
        common += ['-r', f'__ns:=/{options.namespace.strip("/")}']
        factor = ['-p', f'real_time_factor:={float(options.real_time_factor)}']
        own: dict[str, tuple[str, list[str]]] = {
            'plant': ('plant', []),
            'transformation_task': ('transformation_task', factor),
            'unit_robot': ('unit_robot', []),
        }
        for axis in AXES:
            name = f'mc4_drive_{axis}'
            own[name] = 'mc4_drive', ['-p', f'axis:={axis}', '-r', f'__node:={name}']
        for name, (module, arguments) in own.items():
            path = f'delta3_pacdrive.ros.nodes.{module}'
            self._restarts[name] = partial(respawn, name, path, [*common, *arguments], self._log(name))

    def restart(self, process: ManagedProcess) -> bool:
        """Start a process again that has died; False if it is none of those, or if too many have died."""
        now = time.monotonic()
        self._restarted = [then for then in self._restarted if now - then < RESTARTS_S]
        if process.name not in self._restarts or len(self._restarted) >= RESTARTS_MAX:
            return False
        self._restarted.append(now)
        schedule = Schedule.ORDINARY if process.name == 'unit_robot' else self._schedule
        self.running[self.running.index(process)] = self._restarts[process.name](schedule)
        return True

    def check_load(self, cycle: int) -> None:
        """Take real-time scheduling off a robot that is too much for the machine: nothing else could run beside it."""
        cores = self._load.excess() if self._in_real_time else 0.0
        if cores:
            self._in_real_time, self._schedule = False, Schedule.ORDINARY
            for process in self.running:
                drop_real_time(process.pid)
            self.notes.append(
                f'the machine is too slow: its real-time work takes {cores:.2f} of its cores; from bus cycle '
                f'{cycle} on it is scheduled like any other process'
            )
