"""The output of a new interpreter, for tests of imports."""

import os
import subprocess
import sys

LIMIT_S = 300.0  # to compile kernels on a busy machine


def printed(program: str, *arguments: str) -> tuple[str, str]:
    """Return the last output line of a program, and its standard error."""
    done = subprocess.run(
        [sys.executable, '-P', '-c', program, *arguments],
        env=os.environ,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()[-1], done.stderr
