"""Run a command of ``delta3`` in a separate process."""

import signal
import subprocess
import sys
from typing import Any

END_S = 20.0  # timeout for the exit of an interrupted command, which first brings its robot to rest


def start(*arguments: str, **streams: Any) -> 'subprocess.Popen[str]':
    """Start a command."""
    command = [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.main', *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **streams)


def end(child: 'subprocess.Popen[str]') -> str:
    """Interrupt a command and return its remaining output."""
    if child.poll() is None:
        child.send_signal(signal.SIGINT)
    try:
        return child.communicate(timeout=END_S)[0]
    except subprocess.TimeoutExpired:
        child.kill()
        return child.communicate()[0]
