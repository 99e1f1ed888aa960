"""Stands in for ``delta3`` or ``python``: has a fork of ``command_server.py`` run the command line on its streams.

    python -I -S forked_command.py SOCKET delta3 [ARGUMENTS]
    python -I -S forked_command.py SOCKET python SCRIPT [ARGUMENTS]

It passes signals on, and ends as the command does. What the server does not take runs in a fresh interpreter.
"""

import array
import json
import os
import signal
import socket
import sys
from contextlib import suppress

PASSED_ON = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
STREAMS = array.array('i', [0, 1, 2])
ANSWER_MAX = 4096


def are_open() -> bool:
    """Tell whether all streams are open; otherwise a socket would take the place of one."""
    try:
        for stream in STREAMS:
            os.fstat(stream)
    except OSError:
        return False
    return True


def run_afresh(name: str, arguments: list[str]) -> None:
    """Become a new interpreter that runs the command line."""
    what = ['-P', '-m', 'delta3_pacdrive.cli.main'] if name == 'delta3' else []
    os.execv(sys.executable, [sys.executable, *what, *arguments])


def main(address: str, name: str, arguments: list[str]) -> None:
    """Be the command line."""
    is_script = name == 'python' and arguments[:1] and os.path.isfile(arguments[0])
    if not are_open() or not (name == 'delta3' or is_script):
        run_afresh(name, arguments)
    answered = {number for number in PASSED_ON if signal.getsignal(number) != signal.SIG_IGN}
    running: list[int] = []
    early: list[int] = []

    def pass_on(number: int, _: object) -> None:
        if running:
            with suppress(ProcessLookupError):  # it has just ended
                os.kill(running[0], number)
        else:
            early.append(number)

    for number in answered:
        signal.signal(number, pass_on)
    server = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    server.connect(address)
    request = {
        'arguments': [name, *arguments],
        'folder': os.getcwd(),
        'environment': dict(os.environ),
        'ignored': list(PASSED_ON - answered),
    }
    server.sendmsg([json.dumps(request).encode()], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, STREAMS)])
    answer = json.loads(server.recv(ANSWER_MAX))
    if answer == 'not taken':
        for number in answered:
            signal.signal(number, signal.SIG_DFL)
        for number in early:
            os.kill(os.getpid(), number)
        run_afresh(name, arguments)
    # whoever reads what the command prints waits for the command, and for nobody else
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in STREAMS:
        os.dup2(nothing, stream)
    running.append(answer['pid'])
    for number in early:
        pass_on(number, None)
    status = json.loads(server.recv(ANSWER_MAX))['status']
    if status < 0:
        signal.signal(-status, signal.SIG_DFL)
        os.kill(os.getpid(), -status)
    sys.exit(status)


main(sys.argv[1], sys.argv[2], sys.argv[3:])
