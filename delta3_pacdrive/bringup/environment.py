"""Exclusive use of a namespace, and the log folder of a bring-up.

Fast to import, so that a second bring-up is rejected immediately.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil

from delta3_pacdrive import private_files
from delta3_pacdrive.errors import RunError, shown

NAME = 'robot'  # followed by a number if there are several
LOGS = 'delta3_logs_'  # prefix of log folders, followed by the PID


def namespaces(robots: int, prefix: str) -> list[str]:
    """Return the namespaces of several robots, ``/robot1``, ``/robot2`` ..., below an optional prefix."""
    below = prefix.strip('/')
    return [f'/{below}/{NAME}{n + 1}'.replace('//', '/') for n in range(robots)]


def name_of(namespace: str) -> str:
    """Return the name of a robot and of its folders, from its namespace."""
    return namespace.rpartition('/')[2]


def bag_of(folder: Path, namespace: str) -> Path:
    """Return the folder of the recording of one of several robots."""
    return folder / name_of(namespace)


@contextmanager
def only_one(namespace: str) -> Iterator[None]:
    """Hold the lock of a namespace; raises RunError if another process of this user holds it or it cannot be made."""
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    name = f'domain{domain}_{namespace.strip("/").replace("/", ".")}.lock'
    with ExitStack() as stack:
        try:
            stack.enter_context(private_files.lock(private_files.temporary_folder('locks') / name))
        except BlockingIOError:
            raise RunError(f'a robot is already up in namespace {namespace} of domain {domain}') from None
        except OSError as error:
            raise RunError(
                f'cannot lock namespace {shown(namespace)} of domain {domain}: {error.filename}: {error.strerror}'
            ) from None
        yield


def _remove_left_logs() -> None:
    """Remove the logs of killed bring-ups."""
    for folder in Path(tempfile.gettempdir()).glob(f'{LOGS}*_*'):
        number = folder.name.removeprefix(LOGS).partition('_')[0]
        if number.isdecimal() and not psutil.pid_exists(int(number)):
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def log_folder(folder: Path | None) -> Iterator[Path]:
    """Provide the log folder, a temporary one if none is given; raises RunError."""
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
