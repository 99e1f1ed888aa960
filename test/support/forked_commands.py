"""``delta3`` and ``python`` for tests of many command lines: forks of one interpreter that has everything loaded."""

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent
servers: list[int] = []  # process numbers; they stay until all tests are over


def folder() -> Path:
    """Return the folder of commands that hand their lines to a server, which starts with the first call.

    ``python`` does so with scripts only; everything else that it is asked for it does itself.
    """
    return _folder(
        os.environ.get('ROS_DOMAIN_ID', '')
    )  # whose processes tests look for by their first environment


@cache
def _folder(domain: str) -> Path:
    made = Path(tempfile.mkdtemp(prefix='delta3_commands_'))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    socket, client = made / 'socket', HERE / 'forked_command.py'
    server = subprocess.Popen(
        [sys.executable, '-P', HERE / 'command_server.py', socket],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
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
