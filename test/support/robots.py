"""Fixtures of the tests that use ROS: a separate domain, localhost only, complete clean-up."""

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='these tests need the ROS wheels (extra "ros") or a sourced ROS 2')

import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

import commands
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.control.messages import Origin, Status
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.wire.qos import LATCHED

DEADLINE_S = (
    30.0  # longest motion that is waited for: 2,000 bus cycles, at 110 a second on a busy slow machine
)

STRETCH_MAX = 6.0  # by which a deadline may be stretched on a machine that has other things to do
END_S = 30.0  # for processes to be gone, where others keep all cores busy
AT_ONCE = 12  # callbacks between two looks at a condition: less than a bus cycle of a robot has
PACE = ('--real-time-factor', '0.2')  # of a robot that waits for commands: in real time it needs a core
DOMAINS = 100  # below the ports that Linux hands out by itself


def _free_domain() -> tuple[str, Any]:
    """Return a ROS domain that no other run of these tests is in, and the lock that keeps others out."""
    wanted = os.environ.get('ROS_DOMAIN_ID', '')
    first = int(wanted) if wanted.isdecimal() else 1 + os.getpid() % DOMAINS
    for domain in [first, *(1 + (first + n) % DOMAINS for n in range(DOMAINS))]:
        lock = (Path(tempfile.gettempdir()) / f'delta3_test_domain_{domain}.lock').open('w')
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return str(domain), lock
        except OSError:
            lock.close()
    raise RuntimeError('every ROS domain is taken by a run of these tests')


DOMAIN, _LOCK = _free_domain()


@pytest.fixture(autouse=True, scope='session')
def compiled() -> None:
    """Compile every kernel before the first test waits for something."""
    simulation.precompile(parameters.load())


@pytest.fixture(autouse=True, scope='session')
def own_domain() -> Iterator[None]:
    """Keep every process of the tests in one domain on this machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', DOMAIN)
        for name in (
            'ROS_AUTOMATIC_DISCOVERY_RANGE',
            'FASTRTPS_DEFAULT_PROFILES_FILE',
            'FASTDDS_DEFAULT_PROFILES_FILE',
        ):
            patch.delenv(name, raising=False)
        from delta3_pacdrive.ros.wire import discovery

        discovery.keep_to_this_machine()
        yield
        for name in ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'FASTRTPS_DEFAULT_PROFILES_FILE'):
            os.environ.pop(name, None)


def processes_of_domain() -> list[str]:
    """Return the command lines of the processes of the domain, without zombies and without the tests themselves."""
    found, own = [], _starters()
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            environment = (folder / 'environ').read_bytes().split(b'\0')
            command = (folder / 'cmdline').read_bytes().replace(b'\0', b' ').decode(errors='replace')
        except OSError:
            continue
        if 'chrom' in command or 'playwright' in command:
            continue  # the browser of a test belongs to its module
        if f'ROS_DOMAIN_ID={DOMAIN}'.encode() in environment and folder.name not in own and command:
            found.append(f'{folder.name}: {command}')
    return found


def _starters() -> set[str]:
    """Return this process, its parent, and so on: they may have passed on the domain."""
    found, process = set(), str(os.getpid())
    while process != '0':
        found.add(process)
        process = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()[1]
    return found


@contextmanager
def nothing_is_left() -> Iterator[None]:
    """Fail if a process or an unused shared-memory file remains at the end."""
    before = _shared_memory()
    yield
    deadline = time.monotonic() + END_S
    while (processes_of_domain() or _nobodys_memory(before)) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert processes_of_domain() == []
    assert _nobodys_memory(before) == set()


def _nobodys_memory(before: set[str]) -> set[str]:
    """Return the new shared-memory files that no process uses; other tests create and remove some meanwhile."""
    new = _shared_memory() - before
    return (new - _mapped(new)) & _shared_memory()


def _shared_memory() -> set[str]:
    return {name for name in os.listdir('/dev/shm') if 'fastrtps' in name or 'fastdds' in name}


def _mapped(names: set[str]) -> set[str]:
    """Return the shared-memory files that a process has mapped or open: other tests run in parallel."""
    found = set()
    for folder in Path('/proc').glob('[0-9]*') if names else ():
        try:
            used = (folder / 'maps').read_text(errors='replace')
            used += ' '.join(os.readlink(link) for link in (folder / 'fd').iterdir())
        except OSError:
            continue
        found |= {name for name in names if name in used}
    return found


@pytest.fixture
def nothing_left_behind() -> Iterator[None]:
    """Fail if a test leaves a process or a shared-memory file; remove it for the other tests."""
    try:
        with nothing_is_left():
            yield
    finally:
        _end(_started)


@pytest.fixture
def processes() -> Callable[[], list[str]]:
    """Give the look at the processes of the tests' domain."""
    return processes_of_domain


_started: list[subprocess.Popen[str]] = []


def _start(command: list[str], arguments: tuple[str | Path, ...], **options: Any) -> subprocess.Popen[str]:
    line = [*command, *(str(item) for item in arguments)]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)
    _started.append(process)
    return process


CLIENTS = {'move', 'io', 'drive'}  # commands that start no process
COMMAND = [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.main']


@pytest.fixture
def delta3() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a command line to its end: a client in this process, any other in a new interpreter."""

    def run(*arguments: str | Path, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        if arguments[0] in CLIENTS or arguments[:2] == ('faults', 'inject'):
            return commands.delta3(*arguments)
        line = [*COMMAND, *(str(item) for item in arguments)]
        return subprocess.run(line, capture_output=True, text=True, timeout=timeout, check=False)

    return run


def _end(processes: list[subprocess.Popen[str]]) -> None:
    """End those of the processes that still run."""
    running = [process for process in processes if process.poll() is None]
    for process in running:
        process.send_signal(signal.SIGINT)
    for process in running:
        try:
            process.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
    processes.clear()


@pytest.fixture(scope='session')
def start_delta3() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start a command line in a new interpreter; processes that a failed test leaves running are ended."""
    yield lambda *arguments, **options: _start(COMMAND, arguments, **options)
    _end(_started)


_WORK = """
import time
wall, own = time.perf_counter(), time.process_time()
while time.process_time() - own < 0.1:
    pass
print((time.perf_counter() - wall) / 0.1)
"""


def crowding() -> float:
    """Return how many times longer work on all processors takes now than on a machine that does nothing else."""
    workers = [
        subprocess.Popen([sys.executable, '-c', _WORK], stdout=subprocess.PIPE, text=True)
        for _ in range(os.cpu_count() or 1)
    ]
    return min(max(1.0, *(float(worker.communicate()[0]) for worker in workers)), STRETCH_MAX)


def read_until(stream: Any, words: str, seconds: float = 120.0) -> str:
    """Read lines until one contains these words; return all. Fails at the end of the stream or of the time."""
    lines: list[str] = []

    def read() -> None:
        for line in iter(stream.readline, ''):
            lines.append(line)
            if words in line:
                return

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    reader.join(seconds)
    text = ''.join(lines)
    assert words in text, f'{words!r} was not printed within {seconds:g} s: {text}'
    return text


class Deadline:
    """A time limit for a process that works all the time: time in which others had the processor does not count."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._wall_s, self._own_s = time.monotonic(), time.process_time()

    def over(self) -> bool:
        passed = time.monotonic() - self._wall_s
        if passed <= self._seconds:  # to read the time of a process of many threads takes 50 us
            return False
        worked = time.process_time() - self._own_s
        return worked > self._seconds or passed > STRETCH_MAX * self._seconds


class Graph:
    """Nodes on one executor, in a context of their own unless one is given."""

    def __init__(self, context: rclpy.Context | None = None) -> None:
        self._owns_context = context is None
        self.context = context or rclpy.Context()
        if self._owns_context:
            rclpy.init(context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self.nodes: list[Node] = []
        self.listener = self.add(Node, 'listener')
        self.listener.create_timer(0.05, lambda: None)

    def add(self, kind: type[Node], *arguments: Any, **overrides: Any) -> Any:
        """Create a node; keywords are parameters, dots written as double underscores."""
        given = [Parameter(key.replace('__', '.'), value=value) for key, value in overrides.items()]
        names = {}
        if kind is MC4DriveNode:
            overrides = {'axis': 1} | overrides
            given = [Parameter(key.replace('__', '.'), value=value) for key, value in overrides.items()]
            names = {'cli_args': ['--ros-args', '-r', f'__node:=mc4_drive_{overrides["axis"]}']}
        node = kind(*arguments, context=self.context, parameter_overrides=given, **names)
        self.adopt(node)
        return node

    def adopt(self, node: Node) -> None:
        """Register a node of another creator."""
        self.nodes.append(node)
        self._executor.add_node(node)

    def robot(self, order: tuple[str, ...] = ('plant', '1', '2', '3', 'task'), **overrides: Any) -> Any:
        """Start the nodes of a robot in an order; return the task."""
        task = None
        for name in order:
            if name == 'plant':
                self.add(PlantNode, **overrides)
            elif name == 'task':
                task = self.add(TransformationTaskNode, real_time_factor=0.0, **overrides)
            else:
                self.add(MC4DriveNode, axis=int(name), **overrides)
        return task

    def listen(self, kind: type, topic: str, qos: Any = 10) -> list[Any]:
        """Return the list into which a topic's messages go."""
        messages: list[Any] = []
        self.listener.create_subscription(kind, topic, messages.append, qos)
        return messages

    def remove(self, node: Node) -> None:
        """Take a node away, as if its process had died."""
        self._executor.remove_node(node)
        self.nodes.remove(node)
        self.spin_for(0.5)  # what has been queued for it already, on a busy machine too
        node.destroy_node()

    def spin_until(self, condition: Callable[[], Any], what: str, deadline_s: float = DEADLINE_S) -> None:
        """Spin until a condition holds; fail at the deadline."""
        deadline = Deadline(deadline_s)
        while not condition():
            assert not deadline.over(), f'not within {deadline_s} s: {what}'
            # a few callbacks at a time: a robot without a clock keeps the executor busy for ever
            self._executor.spin_once(timeout_sec=0.05)
            for _ in range(AT_ONCE - 1):
                self._executor.spin_once(timeout_sec=0.0)

    def spin_for(self, seconds: float) -> None:
        """Spin for a while."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.01)

    def label(self, kind: str, number: int) -> str:
        """Return the current label of orders of the robot's own planner, for a foreign publisher that copies it."""
        statuses = self.listen(String, 'motion/status', LATCHED)
        self.spin_until(lambda: statuses and statuses[-1].data, 'the status')
        status = Status.from_json(statuses[-1].data)
        return Origin(kind, status.planner, status.session, number).label()

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service; return its response."""
        client = self.listener.create_client(kind, service)
        self.spin_until(client.service_is_ready, f'service {service}')
        future = client.call_async(request)
        self.spin_until(future.done, f'answer of {service}')
        return future.result()

    def close(self) -> None:
        """Destroy everything."""
        for node in self.nodes:
            self._executor.remove_node(node)
            node.destroy_node()
        self._executor.shutdown()
        if self._owns_context:
            rclpy.shutdown(context=self.context)


@pytest.fixture
def graph() -> Iterator[Graph]:
    """Give an empty graph on one executor."""
    made = Graph()
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(scope='module')
def shared_graph() -> Iterator[Graph]:
    """Give one graph to all facts of a file that look at the same robot; nodes may be made without a context."""
    rclpy.init()
    made = Graph(rclpy.get_default_context())
    try:
        yield made
    finally:
        made.close()
        rclpy.shutdown()
