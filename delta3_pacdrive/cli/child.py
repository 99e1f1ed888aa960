"""Another command in a process of its own, which brings its robot to rest before it ends."""

import signal
import subprocess
import sys
from typing import Any

END_S = 15.0  # in which a command that is interrupted ends


def start(*arguments: str, **streams: Any) -> 'subprocess.Popen[str]':
    """Start a command."""
    command = [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.main', *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **streams)


def end(child: 'subprocess.Popen[str]') -> str:
    """Interrupt a command, and return what it still says."""
    if child.poll() is None:
        child.send_signal(signal.SIGINT)
    try:
        return child.communicate(timeout=END_S)[0]
    except subprocess.TimeoutExpired:
        child.kill()
        return child.communicate()[0]
