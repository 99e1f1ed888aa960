"""Bring-up without launch files: start the processes of one robot, run a program, report, stop everything."""

import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace
from std_msgs.msg import String
from std_srvs.srv import SetBool

from delta3_pacdrive import interrupts, simulation
from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup.cpu_load import Strain
from delta3_pacdrive.bringup.lock import only_one
from delta3_pacdrive.bringup.processes import Child, end_all, respawn, spawn
from delta3_pacdrive.bringup.scheduling import NOT_PERMITTED, Schedule, real_time_is_permitted, relent
from delta3_pacdrive.controller.messages import QueueReport
from delta3_pacdrive.errors import ParameterError, RunError, RunInterruptedError, TelegramError
from delta3_pacdrive.motion import arrival, program_planner
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.recording import bag_trace
from delta3_pacdrive.ros import discovery, interfaces, node_process
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.recorder import RecorderNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.progress_report import read_progress
from delta3_pacdrive.sercos.watchdog import BOUND_S

READY_TIMEOUT_S = 30.0
LOOK_S = 0.05
STOP_TIMEOUT_S = 0.8  # for the drives to brake, before the processes end
RESTARTS_MAX, RESTARTS_S = 20, 60.0  # of processes that die, within that time
LOGS = 'delta3_logs_'  # beginning of the names of folders for logs, the process number follows
CLOSE_BAG_S = 10.0  # a bag without its metadata is lost


@dataclass(frozen=True)
class Options:
    """What a bring-up is asked for; without a program the robot stays up for moves, until it is interrupted."""

    program: Path | None
    parameters: Path | None = None
    namespace: str = '/'
    real_time_factor: float = 1.0
    bag: Path | None = None
    single_process: bool = False
    exchange_period_s: float | None = None
    real_time_priority: bool = True
    logs: Path | None = None  # where the processes' logs are kept; None: nowhere


class _Monitor(Node):
    """Follows the progress of the run from the parent process."""

    def __init__(self, namespace: str) -> None:
        super().__init__('bringup', namespace=namespace)
        self.progress: dict[str, Any] = {}
        self.refusal = ''  # of the newest request to the planner
        self.recorder = ''
        interfaces.PROGRESS.subscription(self, self._on_progress)
        interfaces.QUEUE.subscription(self, self._on_queue)
        interfaces.RECORDER_STATE.subscription(self, self._on_recorder)
        self.enable = interfaces.ENABLE.client(self)
        self.create_timer(LOOK_S, lambda: None)  # the executor needs one to keep its waits short

    def _on_progress(self, message: String) -> None:
        self.progress = read_progress(message.data) or self.progress

    def _on_queue(self, message: String) -> None:
        with suppress(TelegramError):
            self.refusal = QueueReport.from_json(message.data).refusal

    def _on_recorder(self, message: String) -> None:
        self.recorder = message.data


class Bringup:
    """One run of one robot; ``run`` does it all."""

    def __init__(self, options: Options) -> None:
        self._options = options
        self.robot, self._program, self._planned = _check(options)
        self._children: list[Child] = []
        self._restarts: dict[str, Callable[[Schedule], Child]] = {}  # how a process is started again, by name
        self._restarted: list[float] = []  # when [s]
        self.notes: list[str] = []
        self._interrupted = False
        self._in_real_time = False
        self._schedule = Schedule.ORDINARY
        self._strain = Strain()
        self._monitor: _Monitor
        self._process: node_process.Process
        self.ready_s = 0.0

    def run(self, show: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
        """Start, run, stop; ``show`` is called with the progress about ten times a second.

        Raises
        ------
        RunError
            A process died, the bus did not start, a drive tripped, or the run was interrupted.

        """
        discovery.keep_to_this_machine()
        with only_one(self._options.namespace), _log_folder(self._options.logs) as logs:
            simulation.rehearse(self.robot)
            try:
                self._start_processes(logs)
                self._watch(show)
                result = self._result()
            finally:
                self._stop()
        if self._options.bag:
            result['bag_missing'] = sum(bag_trace.missing(self._options.bag).values())
            result['bag_cut'] = bag_trace.cut(self._options.bag)
        return result

    def _start_processes(self, logs: Path) -> None:
        options, program = self._options, self._options.program
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._interrupt)
        task = {'real_time_factor': options.real_time_factor, 'wait_for_program': program is not None}
        nodes: dict[str, Callable[[], Node]] = {
            'plant': self._factory(PlantNode, {}),
            **{
                f'mc4_drive_{axis}': self._factory(MC4DriveNode, {'axis': axis}, f'mc4_drive_{axis}')
                for axis in (1, 2, 3)
            },
            'transformation_task': self._factory(TransformationTaskNode, task),
        }
        # Without a clock the robot takes all the processor time there is; that must not be in real time.
        paced = options.real_time_priority and options.real_time_factor > 0.0
        schedule = self._schedule = Schedule.REAL_TIME if paced else Schedule.ORDINARY
        self._in_real_time = paced and real_time_is_permitted()
        if paced and not self._in_real_time:
            self.notes.append(NOT_PERMITTED)
        planner = self._factory(UnitRobotNode, {'program': str(program or '')})
        if options.bag:
            bag = {'bag': str(options.bag), 'program': self._program.name if self._program else 'moves'}
            self._spawn('recorder', [self._factory(RecorderNode, bag)], logs, Schedule.PREFERRED)
        if options.single_process:
            self._spawn('robot', [*nodes.values()], logs, schedule)
        else:
            for name, factory in nodes.items():
                self._spawn(name, [factory], logs, schedule)
            if program is None:
                self._prepare_restarts(logs)
        # The planner waits for a word on its pipe: nothing may move before the recorder listens.
        read_end, self._go = os.pipe()
        self._spawn('unit_robot', [planner], logs, wait_for=read_end)
        os.close(read_end)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._process = node_process.Process()
        self._monitor = _Monitor(options.namespace)
        self._process.add(self._monitor)

    def _prepare_restarts(self, logs: Path) -> None:
        """Note how a process that dies is started again: by itself, with the same parameters."""
        options = self._options
        common = ['--ros-args', '--params-file', str(core.write(self.robot, logs / 'robot.yaml'))]
        common += ['-r', f'__ns:=/{options.namespace.strip("/")}']
        names = {
            'plant': ('plant', []),
            'transformation_task': (
                'transformation_task',
                ['-p', f'real_time_factor:={float(options.real_time_factor)}'],
            ),
            'unit_robot': ('unit_robot', []),
            **{
                f'mc4_drive_{axis}': ('mc4_drive', ['-p', f'axis:={axis}', '-r', f'__node:=mc4_drive_{axis}'])
                for axis in (1, 2, 3)
            },
        }
        for name, (module, own) in names.items():
            self._restarts[name] = partial(
                respawn,
                name,
                f'delta3_pacdrive.ros.nodes.{module}',
                [*common, *own],
                logs / f'{name}.log',
            )

    def _factory(self, node: type[Node], values: dict[str, Any], name: str = '') -> Callable[[], Node]:
        flat = core.flatten(self.robot) | values
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
        logs: Path,
        schedule: Schedule = Schedule.ORDINARY,
        wait_for: int | None = None,
    ) -> None:
        go = getattr(self, '_go', None)

        def main() -> int:
            if go is not None:
                os.close(go)
            if wait_for is not None and not os.read(wait_for, 1):
                return 0
            return node_process.run(factories, [])

        child = spawn(name, main, logs / f'{name}.log', schedule)
        if name == 'recorder':
            child.patience_s = CLOSE_BAG_S
        self._children.append(child)

    def _interrupt(self, number: int, _: Any) -> None:
        interrupts.note(number)
        self._interrupted = True

    def _watch(self, show: Callable[[dict[str, Any]], None]) -> None:
        """Look after the run until the program has ended."""
        monitor = self._monitor
        deadline = time.monotonic() + READY_TIMEOUT_S
        released = False
        while not (progress := self.look()).get('finished') or self._program is None:
            if not released and (monitor.recorder or not self._options.bag):
                os.write(self._go, b'g')
                released = True
            if progress.get('phase') == 'CP4' and not self.ready_s:
                self.ready_s = _process_age_s()
            if self.ready_s:
                show(progress)
                if self._program is None and self._interrupted:
                    return
            elif time.monotonic() > deadline:
                waiting = progress.get('waiting') or monitor.refusal or 'the transformation task to appear'
                raise RunError(f'the bus is not in cyclic operation after {READY_TIMEOUT_S:g} s: {waiting}')
        show(progress)

    def look(self, seconds: float = LOOK_S) -> dict[str, Any]:
        """Spin a little, then raise if something went wrong; return the newest progress."""
        monitor = self._monitor
        self._process.spin_for(seconds)
        if self._interrupted and (self._program is not None or not self.ready_s):
            raise RunInterruptedError('interrupted')
        for child in list(self._children):
            # who ends all processes at once, as a service manager does, wants none of them back
            if child.poll() is not None and not self._interrupted:
                self._replace(child)
        if self._in_real_time and monitor.progress.get('phase') == 'CP4':
            self._look_for_strain()
        if monitor.progress.get('fault') and (self._program is not None or not self.ready_s):
            self._await_standstill()
            raise RunError(monitor.progress['fault'])
        # once the program is loaded, what is refused is asked for by somebody else
        if self._program is not None and not monitor.progress.get('moves') and monitor.refusal:
            raise RunError(monitor.refusal)
        return monitor.progress

    def _look_for_strain(self) -> None:
        """Take real-time scheduling off a robot that is too much for the machine: nothing else could run beside it."""
        cores = self._strain.excess()
        if cores:
            self._in_real_time, self._schedule = False, Schedule.ORDINARY
            for child in self._children:
                relent(child.pid)
            self.notes.append(
                f'the machine is too slow: its real-time work takes {cores:.2f} of its cores; from bus cycle '
                f'{self._monitor.progress.get("cycles", 0)} on it is scheduled like any other process'
            )

    def _replace(self, child: Child) -> None:
        """Start a process again that has died, if the robot is to stay up; raises RunError if it is not."""
        sentence = f'{child.ending()} in bus cycle {self._monitor.progress.get("cycles", 0)}'
        now = time.monotonic()
        if child.name == 'recorder' and self.ready_s:
            self._children.remove(child)
            self.notes.append(f'{sentence}; nothing is recorded any more, the robot goes on')
            return
        self._restarted = [then for then in self._restarted if now - then < RESTARTS_S]
        if child.name not in self._restarts or len(self._restarted) >= RESTARTS_MAX:
            if child.name not in ('robot', 'transformation_task', 'unit_robot'):
                self._await_standstill()
            raise RunError(sentence)
        self._restarted.append(now)
        schedule = Schedule.ORDINARY if child.name == 'unit_robot' else self._schedule
        self._children[self._children.index(child)] = self._restarts[child.name](schedule)
        self.notes.append(f'{sentence}; started again')

    def _await_standstill(self) -> None:
        """Let a robot with a fault come to its stop, so that it is on record."""
        deadline = time.monotonic() + BOUND_S
        while self._monitor.progress.get('in_torque') and time.monotonic() < deadline:
            self._process.spin_for(LOOK_S)

    def _stop(self) -> None:
        """Stop the robot, then the processes; leave nothing behind."""
        if hasattr(self, '_monitor'):
            self._brake()
        if hasattr(self, '_go'):
            os.close(self._go)
        self.killed = end_all(self._children)
        if hasattr(self, '_process'):
            self._process.close()
        rclpy.try_shutdown()

    def _brake(self) -> None:
        """Disable the drives: a controlled stop, then the brakes."""
        monitor = self._monitor
        dead = [child for child in self._children if child.poll() is not None and child.name != 'recorder']
        if dead or monitor.progress.get('phase') != 'CP4' or not monitor.enable.service_is_ready():
            return
        monitor.enable.call_async(SetBool.Request(data=False))
        deadline = time.monotonic() + STOP_TIMEOUT_S
        while monitor.progress.get('in_torque') and time.monotonic() < deadline:
            self._process.spin_for(LOOK_S)

    def _result(self) -> dict[str, Any]:
        progress = self._monitor.progress
        figures = progress.get('figures', {})
        statistics = ('refused_telegrams', 'slip_s', 'lateness_ms', 'mdt_to_last_at_ms', 'outstanding')
        missed = None
        if self._planned and 'final_tcp_m' in figures:
            missed = arrival.why_not_arrived(figures['final_tcp_m'], self._planned.plan.end_m().tolist())
        return {
            'ok': missed is None,
            **({'error': missed} if missed else {}),
            'program': self._planned.name if self._planned else '',
            'notices': [*(self._planned.notices if self._planned else ()), *self.notes],
            'program_s': self._planned.plan.duration_s if self._planned else 0.0,
            'repeat': self._planned.repeat if self._planned else 1,
            'ready_s': round(self.ready_s, 3),
            **{key: progress[key] for key in ('cycles', 'bus_time_s', 'wall_time_s', 'overruns')},
            'lost_telegrams': progress['lost_telegrams'],
            **figures,
            **{key: progress[key] for key in statistics if key in progress},
        }

    def add(self, node: Node) -> None:
        """Take a node into this process."""
        self._process.add(node)

    @property
    def node(self) -> Node:
        """The node of this process, for whoever wants to take part."""
        return self._monitor

    @property
    def interrupted(self) -> bool:
        """Whether a signal, or ``stop``, asks for the end; whoever operates from within looks at it."""
        return self._interrupted

    def stop(self) -> None:
        """End a bring-up without a program."""
        self._interrupted = True

    def processes(self) -> list[Child]:
        """Child processes, for whoever measures them."""
        return list(self._children)


def _process_age_s() -> float:
    """Time since this process was started [s], interpreter and imports included."""
    started_s: float = psutil.Process().create_time()
    return time.time() - started_s


def _check(
    options: Options,
) -> tuple[core.Parameters, Program | None, program_planner.Planned | None]:
    """Read and check everything before the first process starts."""
    robot = core.load(options.parameters)
    if options.exchange_period_s is not None:
        robot = robot.replace(bus__exchange_period_s=options.exchange_period_s)
    if robot.motion.enable_cycle < 0 or robot.motion.start_cycle < 0:
        raise ParameterError('a bring-up needs motion.enable_cycle and motion.start_cycle of at least 0')
    try:
        validate_namespace(options.namespace)
    except InvalidNamespaceException as error:
        raise RunError(
            f'namespace {options.namespace!r} is not valid: {str(error).splitlines()[0]}'
        ) from None
    if options.bag is not None and options.bag.exists():
        raise RunError(f'cannot record into {options.bag}: it exists already')
    if options.program is None:
        return robot, None, None
    program = programs.load(options.program, robot.motion)
    robot = simulation.placed(robot, program)
    return robot, program, program_planner.plan(program, robot.motion.home_m, robot)


def _remove_left_logs() -> None:
    """Remove the logs of bring-ups that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f'{LOGS}*_*'):
        number = folder.name.removeprefix(LOGS).partition('_')[0]
        if number.isdecimal() and not psutil.pid_exists(int(number)):
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _log_folder(folder: Path | None) -> Iterator[Path]:
    """Give the folder for logs, one that vanishes if none is asked for; raises RunError."""
    if folder is None:
        _remove_left_logs()
        with tempfile.TemporaryDirectory(prefix=f'{LOGS}{os.getpid()}_') as temporary:
            yield Path(temporary)
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f'cannot write logs into {folder}: {error.strerror}') from error
    yield folder
