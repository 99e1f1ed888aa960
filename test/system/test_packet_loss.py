"""Tests of packets lost in one direction between processes of a robot: repeated phase-up and full communication."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from delta3_pacdrive.benchmarks import two_hosts
from delta3_pacdrive.bringup.robot_processes import STUCK_MAX_S, STUCK_S
from delta3_pacdrive.ros.wire.domain import DISCOVERY_PORT, DOMAIN_PORTS
from robots import DOMAIN
from thoroughness import some

NFT = shutil.which('nft') or shutil.which('nft', path='/usr/sbin:/sbin') or ''
LOST_S = 4.0
AT_ONCE_MAX = 6  # directions in which packets are lost in a round
PROCESSES = (
    'plant',
    'mc4_drive_1',
    'mc4_drive_2',
    'mc4_drive_3',
    'transformation_',
    'unit_robot',
)  # as Linux cuts them
FIRST = ('mc4_drive_2', 'transformation_')
BACK_S = (
    STUCK_S + STUCK_MAX_S
)  # the patience of delta3 up, and the time in which a busy machine starts a process
# waits for CP4, resets the robot and lets the planner clear its queue, for each line that it reads
OPERATOR = f"""
import json, sys, time
from delta3_pacdrive.errors import RefusedError
from delta3_pacdrive.ros.clients.robot_client import operating

def is_reset():
    if operator.progress.fault:
        try:
            operator.call('reset')
        except RefusedError:  # the drives have not come to rest
            pass
    return not operator.progress.fault

with operating('/') as operator:
    for line in sys.stdin:
        asked = time.monotonic()
        operator.wait_until(
            lambda: operator.progress.phase == 'CP4' and operator.progress_s > asked, 'CP4', {BACK_S!r}
        )
        back_s, fault = time.monotonic() - asked, operator.progress.fault
        operator.wait_until(is_reset, 'reset', {BACK_S!r})
        operator.call('clear')
        print(json.dumps({{'back_s': back_s, 'fault': fault}}), flush=True)
"""


def lack() -> str:
    """Return why no packets can be dropped here; empty if they can."""
    if os.geteuid() != 0:
        return 'only root may make network namespaces'
    for name, path in (('ip', two_hosts.IP), ('nft', NFT)):
        if not path:
            return f'the program {name} is not installed'
    try:
        with namespace('probe') as inside:
            drop(inside, [([1], [2])])
    except subprocess.CalledProcessError as error:
        return f'network namespaces with packet filters are not permitted: {error.stderr.strip()}'
    return ''


@contextmanager
def namespace(name: str) -> Iterator[list[str]]:
    """Give the words that run a command in a separate network with the loopback only."""
    name = f'delta3_{os.getpid()}_{name}'
    subprocess.run([two_hosts.IP, 'netns', 'add', name], check=True, capture_output=True, text=True)
    inside = [two_hosts.IP, 'netns', 'exec', name]
    try:
        command = [*inside, two_hosts.IP, 'link', 'set', 'lo', 'up']
        subprocess.run(command, check=True, capture_output=True, text=True)
        yield inside
    finally:
        subprocess.run([two_hosts.IP, 'netns', 'del', name], check=True)


def drop(inside: list[str], directions: list[tuple[list[int], list[int]]]) -> None:
    """Lose the packets that go from any of some ports to any of others."""
    rules = [f'udp sport {{{_listed(a)}}} udp dport {{{_listed(b)}}} counter drop' for a, b in directions]
    chain = '\n'.join(['type filter hook input priority 0', *rules])
    text = f'table inet loss {{\nchain in {{\n{chain}\n}}\n}}\n'
    subprocess.run([*inside, NFT, '-f', '-'], input=text, check=True, capture_output=True, text=True)


def dropped(inside: list[str]) -> list[int]:
    """Let all packets through again; return how many were lost in each direction."""
    done = subprocess.run(
        [*inside, NFT, '--json', 'list', 'table', 'inet', 'loss'], check=True, capture_output=True, text=True
    )
    subprocess.run([*inside, NFT, 'delete', 'table', 'inet', 'loss'], check=True)
    rules = [entry['rule']['expr'] for entry in json.loads(done.stdout)['nftables'] if 'rule' in entry]
    return [item['counter']['packets'] for rule in rules for item in rule if 'counter' in item]


def _listed(ports: list[int]) -> str:
    return ', '.join(map(str, ports))


def ports_of(process: psutil.Process) -> tuple[list[int], list[int]]:
    """Return the ports from which a process sends, and those of its domain, at which it receives."""
    inodes = set()
    for entry in Path('/proc', str(process.pid), 'fd').iterdir():
        inodes.add(os.readlink(entry).removeprefix('socket:[').removesuffix(']'))
    lines = Path('/proc', str(process.pid), 'net', 'udp').read_text().splitlines()[1:]
    own = [int(line.split()[1].rpartition(':')[2], 16) for line in lines if line.split()[9] in inodes]
    first = DISCOVERY_PORT + DOMAIN_PORTS * int(DOMAIN)
    received = [port for port in own if first <= port < first + DOMAIN_PORTS]
    return [port for port in own if port not in received], received


class Robot:
    """A robot of ``delta3 up`` in a separate network, and an operator."""

    def __init__(self, inside: list[str]) -> None:
        self._inside = inside
        up = [
            '-m',
            'delta3_pacdrive.cli.main',
            'up',
            '--real-time-factor',
            '0.1',
            '--no-realtime',
            '--json',
        ]
        pipes: dict[str, Any] = {'stdout': subprocess.PIPE, 'text': True}
        self.up = subprocess.Popen([*inside, sys.executable, '-P', *up], stderr=subprocess.PIPE, **pipes)
        self.operator = subprocess.Popen(
            [*inside, sys.executable, '-P', '-c', OPERATOR], stdin=subprocess.PIPE, **pipes
        )

    def lose(self, directions: list[tuple[str, str]]) -> list[int]:
        """Drop the packets from processes to others for a while; return their number."""
        own = {}
        for child in psutil.Process(self.up.pid).children():
            own[Path(f'/proc/{child.pid}/comm').read_text().strip()] = ports_of(child)
        drop(self._inside, [(own[a][0], own[b][1]) for a, b in directions])
        time.sleep(LOST_S)
        return dropped(self._inside)

    def back(self) -> dict[str, Any]:
        """Wait until the bus is in CP4 and the planner answers; return how long that took, and the fault."""
        assert self.operator.stdin is not None
        assert self.operator.stdout is not None
        self.operator.stdin.write('\n')
        self.operator.stdin.flush()
        line = self.operator.stdout.readline()
        assert line, self.errors()
        return dict(json.loads(line))

    def errors(self) -> str:
        """Return the reports of ``delta3 up`` after its end."""
        self.up.send_signal(signal.SIGINT)
        return self.up.communicate(timeout=60.0)[1]

    def end(self) -> dict[str, Any]:
        """End both with Ctrl-C; return the summary."""
        for process in (self.operator, self.up):
            process.send_signal(signal.SIGINT)
        self.operator.communicate(timeout=60.0)
        output, errors = self.up.communicate(timeout=60.0)
        assert self.up.returncode == 0, errors
        return dict(json.loads(output))


LACK = lack()
pytestmark = pytest.mark.skipif(bool(LACK), reason=f'no packets can be dropped here: {LACK}')


@pytest.fixture
def robot(nothing_left_behind: None) -> Iterator[Robot]:
    with namespace('loss') as inside:
        made = Robot(inside)
        try:
            yield made
        finally:
            for process in (made.up, made.operator):
                process.kill()
                process.wait()


@pytest.mark.parametrize('rounds', some([1, 30], [1]))
def test_robot_returns_to_cyclic_operation_after_4_s_without_communication(robot: Robot, rounds: int) -> None:
    chance = random.Random(4)
    assert robot.back()['fault'] == ''
    pairs = [(a, b) for a in PROCESSES for b in PROCESSES if a != b]
    found = []
    for number in range(rounds):
        directions = chance.sample(pairs, chance.randint(1, AT_ONCE_MAX)) if number else [FIRST]
        lost = robot.lose(directions)
        assert min(lost) > 0, directions
        found.append(robot.back())
        assert found[-1]['back_s'] < BACK_S, directions
    assert found[0]['fault'] != ''  # the bus has lost a drive
    times = sorted(item['back_s'] for item in found)
    fell = sum(item['fault'] != '' for item in found)
    print(
        f'{rounds} rounds, {fell} with a fault; back after {times[len(times) // 2]:.2f} s in the median and '
        f'{times[-1]:.2f} s at most; {robot.end()["restarts"]} processes restarted'
    )
