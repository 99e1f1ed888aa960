"""Child processes of a bring-up, forked from a parent that has loaded everything, so that they start immediately.

Once the parent has joined the graph it has threads and must not fork any more. A restarted child is therefore a new
interpreter: ``python -m delta3_pacdrive.bringup.processes NAME PARENT LOG SCHEDULE MODULE ARGUMENTS``.
"""

import ctypes
import importlib
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from delta3_pacdrive.bringup.scheduling import Schedule, set_scheduling

_PR_SET_PDEATHSIG = 1


@dataclass
class ManagedProcess:
    """One child process."""

    name: str
    pid: int
    log: Path  # file with its output
    patience_s: float = 1.0  # timeout for its end
    status: int | None = None  # exit status, negative for a signal; None while it runs

    def poll(self) -> int | None:
        """Return the exit status, None while the process runs."""
        if self.status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.status = os.waitstatus_to_exitcode(status)
        return self.status

    def send(self, number: signal.Signals) -> None:
        """Send a signal if the process is still running."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def ending(self) -> str:
        """Return how it ended, with the last error message that it printed."""
        status = self.status or 0
        how = f'was killed by {signal.Signals(-status).name}' if status < 0 else f'ended with status {status}'
        lines = [line for line in self.log.read_text(errors='replace').splitlines() if line.strip()]
        error = next((line for line in reversed(lines) if line.startswith('error: ')), '')
        return f'{self.name} {how}' + (f': {error.removeprefix("error: ")}' if error else '')


def spawn(
    name: str, main: Callable[[], int], log: Path, schedule: Schedule = Schedule.ORDINARY
) -> ManagedProcess:
    """Fork a child that runs ``main`` in a separate process group and dies with its parent."""
    sys.stdout.flush()
    sys.stderr.flush()
    parent = os.getpid()
    pid = os.fork()
    if pid:
        return ManagedProcess(name, pid, log)
    status = 1
    try:
        _become_child(name, parent, log)
        set_scheduling(schedule)
        status = main()
    except BaseException:  # noqa: BLE001 (a forked child must never return into its parent's code)
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def respawn(
    name: str,
    module: str,
    arguments: list[str],
    log: Path,
    schedule: Schedule,
    environment: Mapping[str, str] | None = None,
) -> ManagedProcess:
    """Start a child with the main function of a module and additional environment variables."""
    me = [sys.executable, '-P', '-m', 'delta3_pacdrive.bringup.processes']
    own = [name, str(os.getpid()), str(log), schedule.name, module]
    everything = os.environ | (environment or {})
    return ManagedProcess(name, os.posix_spawn(sys.executable, [*me, *own, *arguments], everything), log)


def main() -> int:
    """Run a restarted child."""
    name, parent, log, schedule, module, *arguments = sys.argv[1:]
    _become_child(name, int(parent), Path(log))
    set_scheduling(Schedule[schedule])
    sys.argv = [module, *arguments]
    return int(importlib.import_module(module).main())


def _become_child(name: str, parent: int, log: Path) -> None:
    os.setpgid(0, 0)  # Ctrl-C in the terminal reaches only the parent, which stops the robot first
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        raise SystemExit(1)
    Path('/proc/self/comm').write_text(name[:15])
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)


def end_all(children: list[ManagedProcess]) -> list[str]:
    """Interrupt all children, kill those that exceed their timeout, and kill all their descendants.

    Return the names of the children that were killed, or left processes behind.
    """
    for child in children:
        child.send(signal.SIGINT)
    start = time.monotonic()
    killed = []
    running = list(children)
    while running := [child for child in running if child.poll() is None]:
        for child in running:
            if time.monotonic() - start > child.patience_s:
                child.send(signal.SIGKILL)
                if child.status is None:  # it may have just ended
                    os.waitpid(child.pid, 0)
                    child.status = -signal.SIGKILL
                    killed.append(child.name)
        time.sleep(0.01)
    return killed + [child.name for child in children if _kill_group(child.pid) and child.name not in killed]


def _kill_group(number: int) -> bool:
    """Kill the remaining processes in the group of an ended child; return whether there were any."""
    left = False
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(number, 0)
        for process in psutil.process_iter(['status']):
            with suppress(ProcessLookupError):
                alive = process.info['status'] != psutil.STATUS_ZOMBIE
                left = left or (alive and os.getpgid(process.pid) == number)
        os.killpg(number, signal.SIGKILL)
    return left


def killed_sentence(names: list[str]) -> str:
    """Return a message about killed processes."""
    return f'{", ".join(names)} did not end, or left processes behind, and had to be killed'


if __name__ == '__main__':
    raise SystemExit(main())
