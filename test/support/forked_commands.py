"""``delta3`` and ``python`` for tests of many command lines: forks of one interpreter that has everything loaded."""

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent
servers: list[int] = []  # process numbers; they stay until all tests are over


def folder(environment: Mapping[str, str] | None = None) -> Path:
    """Return the folder of commands that hand their lines to a server, which starts with the first call.

    ``python`` does so with scripts only; everything else that it is asked for it does itself. The server has the
    environment of this process, or another one.
    """
    own = os.environ if environment is None else environment
    # tests look for the processes of a domain by their first environment
    return _folder(own.get('ROS_DOMAIN_ID', ''), None if environment is None else tuple(sorted(own.items())))


@cache
def _folder(_: str, environment: tuple[tuple[str, str], ...] | None) -> Path:
    made = Path(tempfile.mkdtemp(prefix='delta3_commands_'))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    socket, client = made / 'socket', HERE / 'forked_command.py'
    server = subprocess.Popen(
        [sys.executable, '-P', HERE / 'command_server.py', socket],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=None if environment is None else dict(environment),
        # in the session of the tests: the kernel shares processors between sessions, and may let a small one wait
        process_group=0,
    )
    servers.append(server.pid)
    atexit.register(server.communicate)  # at the end of its standard input it ends
    assert server.stdout is not None
    assert server.stdout.readline() == 'ready\n', 'the server of command lines did not come up'
    for name in ('delta3', 'python'):
        stand_in = made / name
        stand_in.write_text(
            f'#!/bin/sh\nexec "{sys.executable}" -I -S "{client}" "{socket}" {name} "$@"\n', encoding='utf-8'
        )
        stand_in.chmod(0o755)
    return made
