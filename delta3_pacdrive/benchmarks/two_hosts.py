"""Two hosts on one machine: network namespaces, connected by a link with delay, jitter, loss, duplicates and gaps.

Each host has a ``tun`` device; a process forwards packets between the two. Requires Linux, the program ``ip``, and the
permission to create network namespaces.
"""

import fcntl
import heapq
import json
import os
import random
import select
import shutil
import signal
import struct
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import RunError

IP = shutil.which('ip') or shutil.which('ip', path='/usr/sbin:/sbin') or ''
TUN = Path('/dev/net/tun')
NAMESPACES = Path('/run/netns')
SET_INTERFACE, PACKETS_WITHOUT_HEADER = 0x400454CA, 0x1001  # TUNSETIFF, IFF_TUN | IFF_NO_PI
PACKET_BYTES, AT_ONCE = 65536, 64
ADDRESSES = ('10.213.77.1', '10.213.77.2')
SEED = 1
LOCAL_SETTINGS = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'ROS_AUTOMATIC_DISCOVERY_RANGE',
)  # restrict a robot to its host


@dataclass(frozen=True)
class Conditions:
    """Treatment of packets in both directions.

    Attributes
    ----------
    delay_s, jitter_s
        Delays are distributed uniformly in delay ± jitter, so packets may overtake one another.
    loss, duplicate
        Shares of lost and duplicated packets.
    down
        Whether all packets are lost.

    """

    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    down: bool = False


def lack() -> str:
    """Return why two hosts are not possible on this machine, empty if they are."""
    if not IP:
        return 'the program ip is not installed'
    if os.geteuid() != 0:
        return 'only root may make network namespaces'
    if not os.access(TUN, os.R_OK | os.W_OK):
        return f'{TUN} is not available'
    probe = f'delta3_{os.getpid()}_probe'
    try:
        _ip('netns', 'add', probe)
        _ip('netns', 'del', probe)
    except RunError as error:
        return f'network namespaces are not permitted: {error}'
    return ''


def _ip(*words: str) -> None:
    done = subprocess.run([IP, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RunError(f'ip {" ".join(words)}: {done.stderr.strip()}')


@dataclass(frozen=True)
class Host:
    """A host with a separate network; ``peer`` is the address of the other one."""

    namespace: str
    address: str
    peer: str

    def start(self, command: Sequence[str], **options: Any) -> subprocess.Popen[str]:
        """Start a command on the host, with the other host as its discovery peer; end it with ``end``."""
        environment = {name: value for name, value in os.environ.items() if name not in LOCAL_SETTINGS}
        return subprocess.Popen(
            [IP, 'netns', 'exec', self.namespace, *command],
            env=environment | {'ROS_STATIC_PEERS': self.peer},
            text=True,
            **options,
        )


class Link:
    """A process that forwards packets between two open devices."""

    def __init__(self, devices: tuple[int, int]) -> None:
        read_end, self._commands = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            try:
                os.close(self._commands)
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with its parent
                _forward(devices, read_end)
            finally:
                os._exit(0)
        for number in (read_end, *devices):
            os.close(number)

    def set(self, conditions: Conditions) -> None:
        """Set the conditions of the link."""
        os.write(self._commands, json.dumps(asdict(conditions)).encode() + b'\n')

    def close(self) -> None:
        """End the process."""
        os.close(self._commands)
        os.waitpid(self._pid, 0)


def _forward(devices: tuple[int, int], commands: int) -> None:
    """Forward packets until the command pipe is closed."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    other = dict(zip(devices, reversed(devices), strict=True))
    chance, conditions, number = random.Random(SEED), Conditions(), 0  # noqa: S311 (repeatable losses)
    due: list[tuple[float, int, int, bytes]] = []
    while True:
        now = time.monotonic()
        while due and due[0][0] <= now:
            _, _, device, packet = heapq.heappop(due)
            with suppress(OSError):  # queue full: the packet is lost, as on any network
                os.write(device, packet)
        wait_s = max(0.0, due[0][0] - now) if due else None
        ready = select.select([*devices, commands], [], [], wait_s)[0]
        if commands in ready:
            lines = os.read(commands, PACKET_BYTES).splitlines()
            if not lines:
                return
            conditions = Conditions(**json.loads(lines[-1]))
        for device in ready:
            if device == commands:
                continue
            for _ in range(AT_ONCE):
                try:
                    packet = os.read(device, PACKET_BYTES)
                except BlockingIOError:
                    break
                for _ in range(1 + (chance.random() < conditions.duplicate)):
                    if conditions.down or chance.random() < conditions.loss:
                        continue
                    number += 1
                    delay_s = conditions.delay_s + conditions.jitter_s * (2.0 * chance.random() - 1.0)
                    heapq.heappush(due, (time.monotonic() + delay_s, number, other[device], packet))


def _device(name: str) -> int:
    """Create a device; return its file descriptor."""
    device = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
    try:
        fcntl.ioctl(device, SET_INTERFACE, struct.pack('16sH14x', name.encode(), PACKETS_WITHOUT_HEADER))
    except OSError as error:
        os.close(device)
        raise RunError(f'the device {name} cannot be created: {error.strerror}') from None
    return device


@contextmanager
def two_hosts() -> Iterator[tuple[Host, Host, Link]]:
    """Create two hosts and the link between them; raises RunError if that is not possible."""
    if why := lack():
        raise RunError(f'two hosts are not possible on this machine: {why}')
    pid = os.getpid()
    _tidy()
    names = [f'delta3_{pid}_{side}' for side in ('near', 'far')]
    hosts = [Host(names[k], ADDRESSES[k], ADDRESSES[1 - k]) for k in (0, 1)]
    link: Link | None = None
    devices: list[int] = []
    try:
        for k, host in enumerate(hosts):
            _ip('netns', 'add', host.namespace)
            name = f'd3_{pid}_{k}'
            devices.append(_device(name))
            _ip('link', 'set', name, 'netns', host.namespace)
            _ip('-n', host.namespace, 'addr', 'add', host.address, 'peer', host.peer, 'dev', name)
            for one in (name, 'lo'):
                _ip('-n', host.namespace, 'link', 'set', one, 'up')
        link = Link((devices[0], devices[1]))
        devices = []
        yield hosts[0], hosts[1], link
    finally:
        if link is not None:
            link.close()
        for device in devices:
            os.close(device)
        for name in names:
            with suppress(RunError):  # it may not exist
                _ip('netns', 'del', name)


def _tidy() -> None:
    """Remove the hosts of killed processes, and the processes that still run on them."""
    for path in NAMESPACES.glob('delta3_*_*'):
        pid = path.name.split('_')[1]
        if pid.isdecimal() and not Path('/proc', pid).exists():
            found = subprocess.run(
                [IP, 'netns', 'pids', path.name], capture_output=True, text=True, check=False
            )
            for left in found.stdout.split():
                with suppress(ProcessLookupError):
                    os.kill(int(left), signal.SIGKILL)
            with suppress(RunError):
                _ip('netns', 'del', path.name)


def end(processes: Sequence[subprocess.Popen[str]], patience_s: float = 20.0) -> None:
    """Interrupt processes; kill those that do not end in time."""
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    deadline = time.monotonic() + patience_s
    for process in processes:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
