"""Fixtures of the tests that use ROS: a domain of their own, localhost only, nothing left behind."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='these tests need the ROS wheels (extra "ros") or a sourced ROS 2')

DOMAIN = str(1 + os.getpid() % 100)  # below the ports that Linux hands out by itself


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
        from delta3_pacdrive.nodes import discovery

        discovery.keep_to_this_machine()
        yield
        for name in ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'FASTRTPS_DEFAULT_PROFILES_FILE'):
            os.environ.pop(name, None)


def processes_of_domain() -> list[str]:
    """Command lines of all processes that belong to the tests' domain, this one and zombies excluded."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            environment = (folder / 'environ').read_bytes().split(b'\0')
            command = (folder / 'cmdline').read_bytes().replace(b'\0', b' ').decode(errors='replace')
        except OSError:
            continue
        if f'ROS_DOMAIN_ID={DOMAIN}'.encode() in environment and int(folder.name) != os.getpid() and command:
            found.append(f'{folder.name}: {command}')
    return found


@pytest.fixture
def nothing_left_behind() -> Iterator[None]:
    """Fail if a test leaves a process or a shared-memory file."""
    before = set(os.listdir('/dev/shm'))
    yield
    deadline = time.monotonic() + 2.0
    while processes_of_domain() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert processes_of_domain() == []
    assert {name for name in os.listdir('/dev/shm') if 'fastrtps' in name or 'fastdds' in name} <= before


@pytest.fixture
def processes() -> Callable[[], list[str]]:
    """Give the look at the processes of the tests' domain."""
    return processes_of_domain


def _command_line(*arguments: str | Path) -> list[str]:
    return [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.main', *(str(item) for item in arguments)]


@pytest.fixture
def delta3() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the real command line to its end."""

    def run(*arguments: str | Path, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            _command_line(*arguments), capture_output=True, text=True, timeout=timeout, check=False
        )

    return run


@pytest.fixture
def start_delta3() -> Callable[..., subprocess.Popen[str]]:
    """Start the real command line."""

    def start(*arguments: str | Path) -> subprocess.Popen[str]:
        return subprocess.Popen(
            _command_line(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    return start
