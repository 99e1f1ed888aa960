"""Tests of a robot with drives on another host: bits of the simulation, lost packets, and recovery."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import pages
from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.benchmarks import network
from delta3_pacdrive.benchmarks.two_hosts import Conditions, Host, Link, end, lack, two_hosts
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, SIGNALS

LACK = lack()
pytestmark = pytest.mark.skipif(bool(LACK), reason=f'there cannot be two hosts here: {LACK}')

MESSAGES, PORT = 400, 5555
AWAIT_END = """
from delta3_pacdrive.ros.clients.robot_client import operating
with operating('/') as operator:
    operator.wait_until(lambda: operator.progress.finished, 'end of the program', 200.0)
    print(operator.progress.lost_telegrams, operator.progress.fault)
"""
SEND = f"""
import socket, sys, time
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in range({MESSAGES}):
    link.sendto(number.to_bytes(4, 'big'), (sys.argv[1], {PORT}))
    time.sleep(1e-3)  # no device has room for all of them at once
"""
RECEIVE = f"""
import socket
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.bind(('0.0.0.0', {PORT}))
print('here', flush=True)
link.settimeout(3.0)
try:
    while True:
        print(int.from_bytes(link.recv(9), 'big'), flush=True)
except TimeoutError:
    pass
"""


@pytest.fixture
def hosts(nothing_left_behind: None) -> Iterator[tuple[Host, Host, Link]]:
    with two_hosts() as made:
        yield made


def received(hosts: tuple[Host, Host, Link], conditions: Conditions) -> list[int]:
    """Return the numbers of the packets that have come, in their order."""
    near, far, link = hosts
    link.set(conditions)
    receiver = far.start([sys.executable, '-c', RECEIVE], stdout=subprocess.PIPE)
    assert receiver.stdout is not None
    assert receiver.stdout.readline() == 'here\n'
    assert near.start([sys.executable, '-c', SEND, far.address]).wait() == 0
    return [int(line) for line in receiver.communicate(timeout=60.0)[0].split()]


@pytest.mark.long
def test_link_loses_repeats_and_reorders_the_requested_packets(
    hosts: tuple[Host, Host, Link],
) -> None:
    assert received(hosts, Conditions()) == list(range(MESSAGES))
    assert received(hosts, Conditions(down=True)) == []
    mixed = received(hosts, Conditions(delay_s=0.02, jitter_s=0.02))
    assert sorted(mixed) == list(range(MESSAGES)) != mixed
    lossy = received(hosts, Conditions(loss=0.25, duplicate=0.25))
    assert set(lossy) < set(range(MESSAGES))
    assert 0.65 < len(set(lossy)) / MESSAGES < 0.93
    assert 1.1 < len(lossy) / len(set(lossy)) < 1.4


def test_remains_of_a_killed_process_are_removed_by_the_next(nothing_left_behind: None) -> None:
    code = (
        'import os, signal; from delta3_pacdrive.benchmarks.two_hosts import two_hosts\n'
        "with two_hosts() as (near, _, _): near.start(['sleep', '1000'], stdout=-3); "
        'print(near.namespace, flush=True); '
        'os.kill(os.getpid(), signal.SIGKILL)'
    )
    done = subprocess.run([sys.executable, '-P', '-c', code], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == -9
    left = Path('/run/netns', done.stdout.strip())
    assert left.exists()
    with two_hosts():
        assert not left.exists()


@pytest.mark.long
def test_drives_on_another_host_give_the_bits_of_the_simulation_over_a_bad_link(
    hosts: tuple[Host, Host, Link], tmp_path: Path
) -> None:
    near, far, link = hosts
    robot = parameters.load()
    simulated = simulation.run(program_file.load('experiment1', robot.motion), robot)
    link.set(Conditions(delay_s=3e-4, jitter_s=2e-4, loss=0.005, duplicate=0.01))
    record = [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.main', 'record', str(tmp_path / 'bag')]
    recorder = near.start(record, stderr=subprocess.PIPE)
    try:
        with network.robot(near, far, 0.0, waits=True):
            planner = network.node(near, 'unit_robot', 'program:=experiment1')
            try:
                awaiting = near.start([sys.executable, '-P', '-c', AWAIT_END], stdout=subprocess.PIPE)
                assert awaiting.communicate(timeout=300.0)[0] == '0 \n'
            finally:
                end([planner])
    finally:
        end([recorder])
    recorded = trace_file.load(tmp_path / 'bag')
    cycles = [np.rint(trace.time_s / robot.bus.cycle_time_s).astype(int) for trace in (simulated, recorded)]
    common, ours, theirs = np.intersect1d(*cycles, return_indices=True)
    assert len(common) > 0.5 * len(simulated.time_s)
    for name in (*SIGNALS, *CURRENT_SIGNALS):
        np.testing.assert_array_equal(recorded[name][theirs], simulated[name][ours], err_msg=name)


@pytest.mark.long
def test_the_commands_of_the_page_make_a_robot_on_two_machines(
    hosts: tuple[Host, Host, Link], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    near, far, _ = hosts
    controller, drives = (
        block.text.replace('192.168.7.1', near.address).replace('192.168.7.2', far.address).splitlines()
        for block in pages.blocks(pages.SOURCE / 'docs/integrator.md')
        if block.words == 'test/system/test_two_hosts.py'
    )
    assert (controller.pop(0), drives.pop(0)) == tuple(
        f'export ROS_STATIC_PEERS={host.peer}' for host in (near, far)
    )
    environment = pages.environment(tmp_path)
    for name in ('PATH', 'AMENT_PREFIX_PATH'):
        monkeypatch.setenv(name, environment[name])
    (line,) = drives
    lines = [(far, line.replace('axis:=1', f'axis:={n}').replace('drive_1', f'drive_{n}')) for n in (1, 2, 3)]
    nodes = [
        host.start(['bash', '-c', f'exec {line}'])
        for host, line in (*lines, *((near, one) for one in controller))
    ]
    try:
        awaiting = near.start([sys.executable, '-P', '-c', AWAIT_END], stdout=subprocess.PIPE)
        assert awaiting.communicate(timeout=300.0)[0].endswith(' \n')  # no fault
    finally:
        end(nodes)
