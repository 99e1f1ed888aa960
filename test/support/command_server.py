"""Forks one process for each command line of ``delta3`` or script, from an interpreter that has everything loaded.

    python -P command_server.py SOCKET

To load numba, numpy, scipy, matplotlib and the kernels takes longer than most commands. The stand-in for ``delta3`` and
``python``, ``forked_command.py``, hands over its arguments, folder, environment and streams. What runs is the function
of the console script, or the script, in a process of its own. A command line is not taken whose environment an
interpreter reads when it starts, or a library when it is loaded.
"""

import array
import atexit
import gc
import importlib
import json
import os
import runpy
import selectors
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import NoReturn, TextIO

STREAMS = 3
REQUEST_MAX = 1 << 18
NOT_TAKEN = 'not taken'
statuses: list[int] = []  # of the command that this process has become
# read while the interpreter starts, or when a library is loaded
PACE = 'DELTA3_TEST_PACE'
READ_EARLY = ('PYTHON', 'LD_', 'LC_', 'LANG', 'NUMBA', 'OPENBLAS', 'OMP_', 'MPL', 'XDG_', 'HOME')


def load() -> None:
    """Load what most commands need."""
    import delta3_pacdrive.cli
    from delta3_pacdrive import parameters, simulation

    for path in sorted(Path(delta3_pacdrive.cli.__file__).parent.glob('[!_]*.py')):
        importlib.import_module(f'delta3_pacdrive.cli.{path.stem}')
    for name in ('analysis.run_figures', 'analysis.report_page', 'controller.planner', 'ros.robot_client'):
        importlib.import_module(f'delta3_pacdrive.{name}')
    for name in ('scipy.optimize', 'scipy.interpolate', 'scipy.signal', 'matplotlib.backends.backend_agg'):
        importlib.import_module(name)
    simulation.load_kernels(parameters.load())
    gc.collect()
    gc.freeze()  # a child that looks for garbage copies no page of what is loaded


def read_early(environment: dict[str, str]) -> dict[str, str]:
    """Return the part of an environment that a process cannot change once it runs."""
    return {name: value for name, value in environment.items() if name.startswith(READ_EARLY)}


def paced(arguments: list[str], pace: str) -> list[str]:
    """Return a command line; a robot that is kept up, and whose pace it does not say, goes at that of the tests.

    Most of the time it stands and waits for commands that start: 1,000 bus cycles in each second of that take more of
    the processor than all else.
    """
    if not pace or arguments[1:2] != ['up'] or any(one.startswith('--real-time') for one in arguments):
        return arguments
    return [*arguments, '--real-time-factor', pace]


def stream_of(number: int, mode: str) -> TextIO:
    """Return what Python has for a standard stream."""
    own = (sys.__stdin__, sys.__stdout__, sys.__stderr__)[number]
    assert own is not None
    line_by_line = 1 if number == 2 or os.isatty(number) else -1
    return open(number, mode, line_by_line, own.encoding, own.errors, closefd=False)


def become(request: dict, streams: list[int]) -> NoReturn:
    """Be the command."""
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        default = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
        signal.signal(number, signal.SIG_IGN if number in request['ignored'] else default)
    os.chdir(request['folder'])
    os.environ.clear()
    os.environ.update(request['environment'])
    sys.argv = paced(request['arguments'], os.environ.pop(PACE, ''))
    sys.stdin, sys.stdout, sys.stderr = stream_of(0, 'r'), stream_of(1, 'w'), stream_of(2, 'w')
    statuses.append(1)  # of an exception that nobody catches
    if sys.argv[0] == 'delta3':
        from delta3_pacdrive.cli.main import main

        statuses.append(main())
    else:
        statuses.append(status_of_script(sys.argv[1:]))
    raise SystemExit(statuses[-1])


def status_of_script(arguments: list[str]) -> int:
    """Run a script as an interpreter does that is given its path; return its exit status."""
    sys.argv = arguments
    if not sys.flags.safe_path:
        sys.path.insert(0, str(Path(arguments[0]).resolve().parent))
    try:
        runpy.run_path(arguments[0], run_name='__main__')
    except SystemExit as end:
        if isinstance(end.code, str):
            raise  # the interpreter prints it, and ends with 1
        return end.code or 0
    return 0


def be_gone() -> None:
    """End a command without putting away one by one what is loaded, which takes longer than many a command."""
    if statuses:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError):
                stream.flush()
        os._exit(statuses[-1])


class Server:
    """Takes command lines, tells how they end, and lets none survive the stand-in that it runs for."""

    def __init__(self, address: str, environment: dict[str, str]) -> None:
        self._environment = environment  # what was read early: libraries add to it while they are loaded
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listening.bind(address)
        self._listening.listen(64)
        self._clients: dict[int, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listening, selectors.EVENT_READ, self._accept)
        self._woken, wake = socket.socketpair()
        for end in (self._woken, wake):
            end.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.set_wakeup_fd(wake.fileno())
        self._wake = wake
        self._selector.register(self._woken, selectors.EVENT_READ, self._reap)

    def serve(self) -> None:
        """Go on until the standard input of this process is closed."""
        self._selector.register(0, selectors.EVENT_READ, None)
        while True:
            for key, _ in self._selector.select():
                if key.data is None:
                    for pid in self._clients:
                        os.killpg(pid, signal.SIGKILL)
                    return
                key.data(key.fileobj)

    def _accept(self, listening: socket.socket) -> None:
        client, _ = listening.accept()
        self._selector.register(client, selectors.EVENT_READ, self._read)

    def _read(self, client: socket.socket) -> None:
        room = socket.CMSG_LEN(STREAMS * array.array('i').itemsize)
        text, attached, _, _ = client.recvmsg(REQUEST_MAX, room)
        if not text:
            self._leave(client)
            return
        streams = array.array('i')
        for _, _, data in attached:
            streams.frombytes(data)
        request = json.loads(text)
        if read_early(request['environment']) != self._environment:
            client.send(json.dumps(NOT_TAKEN).encode())
        else:
            self._start(client, request, list(streams))
        for stream in streams:
            os.close(stream)

    def _start(self, client: socket.socket, request: dict, streams: list[int]) -> None:
        pid = os.fork()
        with suppress(PermissionError):  # of the two, the second one finds it done
            os.setpgid(pid, pid)
        if pid:
            self._clients[pid] = client
            client.send(json.dumps({'pid': pid}).encode())
            return
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for key in self._selector.get_map().values():
            if isinstance(key.fileobj, socket.socket):
                key.fileobj.close()
        self._wake.close()
        self._selector.close()
        become(request, streams)

    def _leave(self, client: socket.socket) -> None:
        """End the command of a stand-in that was killed."""
        self._selector.unregister(client)
        client.close()
        for pid in [pid for pid, one in self._clients.items() if one is client]:
            with suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)

    def _reap(self, woken: socket.socket) -> None:
        woken.recv(4096)
        while self._clients:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if not pid:
                return
            client = self._clients.pop(pid)
            with suppress(OSError):
                client.send(json.dumps({'status': os.waitstatus_to_exitcode(status)}).encode())


if __name__ == '__main__':
    atexit.register(be_gone)  # the first one is called last
    first = read_early(dict(os.environ))
    load()
    server = Server(sys.argv[1], first)
    print('ready', flush=True)
    server.serve()
