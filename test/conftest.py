"""What the tests share: the default robot, the README, and property tests that draw the same examples every time."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # shells start what runs in the background so; the programs that are tested would ignore Ctrl-C, too
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile('facts', derandomize=True, database=None, deadline=None, max_examples=100)
settings.load_profile('facts')


@pytest.fixture(scope='session')
def robot():
    """Return the parameters of the default robot."""
    from delta3_pacdrive import parameters

    return parameters.load()


@pytest.fixture(scope='session')
def readme_blocks():
    """Return the README's blocks of code: a list of (heading or bold words above it, language, text)."""
    text = (Path(__file__).parent.parent / 'README.md').read_text(encoding='utf-8')
    blocks, place = [], ''
    for match in re.finditer(
        r'^```(\w*)\n(.*?)^```$|^#+ ([^\n]*)$|^\*\*([^*\n]*)\*\*', text, re.DOTALL | re.MULTILINE
    ):
        language, code, heading, bold = match.groups()
        if code is None:
            place = heading or bold
        else:
            blocks.append((place, language, code))
    return blocks


@pytest.fixture
def readme_lines(readme_blocks):
    """Return the command lines of the README's block under a heading, without what is said about them."""

    def lines(wanted):
        (block,) = (text for place, language, text in readme_blocks if (place, language) == (wanted, 'sh'))
        stripped = (re.sub(r'\s{2,}#.*', '', line).strip() for line in block.splitlines())
        return [line for line in stripped if line]

    return lines


@pytest.fixture
def shell(tmp_path):
    """Return what runs a command line in a folder of its own, as a user of the environment under test does."""
    environment = os.environ | {'PATH': f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'}

    def run(line, *, cwd=tmp_path, timeout=280.0, **variables):
        return subprocess.run(
            ['bash', '-c', line],
            cwd=cwd,
            env=environment | variables,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    return run
