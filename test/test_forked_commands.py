"""A forked command line does what that of a new interpreter does: pages are tested with the first (CONTRIBUTING.md)."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import forked_commands

WAIT_S = 60.0
AGAIN_S = 2.0
pytestmark = pytest.mark.timeout(200)


@pytest.fixture
def environment():
    """Give the environment whose delta3 is forked."""
    path = [str(forked_commands.folder()), str(Path(sys.executable).parent), os.environ['PATH']]
    return os.environ | {'PATH': os.pathsep.join(path)}


def lines(folder, environment, text):
    """Run lines of a shell; return their status and what they print."""
    done = subprocess.run(
        ['bash', '-c', text],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def waiting(environment, tmp_path):
    """Give a command that waits for its program on standard input, and the pipe that it reads from."""
    script = tmp_path / 'waiting.py'
    script.write_text(
        'import sys\nfrom delta3_pacdrive import interrupts\nfrom delta3_pacdrive.cli.main import main\n'
        "interrupts.install()\nprint('begun', flush=True)\nsys.exit(main())\n"
    )
    pipe = subprocess.PIPE
    process = subprocess.Popen(
        ['python', script, 'check', '-'], env=environment, stdin=pipe, stdout=pipe, stderr=pipe, text=True
    )
    assert process.stdout.readline() == 'begun\n'
    yield process, process.stdin
    process.kill()
    process.communicate(timeout=WAIT_S)


@pytest.mark.parametrize(
    'text',
    [
        'delta3 --version',
        'delta3 nonsense',
        'delta3 pose 0 0; echo $?',
        'delta3 check no_such_file.yaml || cat no_such_file.yaml',
        'echo "moves: [1]" | delta3 check -',
        'mkdir -p below && cd below && delta3 check ../none.yaml',
        'delta3 --help | head -1',
        'delta3 pose 0 0 -0.75 >/dev/full',
        'COLUMNS=60 delta3 pose --help',
        'delta3 check no_such_file.yaml <&-',
        'echo "import sys; print(sys.argv, __name__); sys.exit(3)" >own.py; python own.py 1 -x; echo $?',
        'echo "raise SystemExit(\'told\')" >own.py; python own.py; echo $?',
        'python -c "print(1)"',
        'python no_such_file.py 2>/dev/null || echo $?',
    ],
)
def test_streams_status_folder_and_environment_are_those_of_the_command_line(text, environment, tmp_path):
    fresh = environment | {'PATH': environment['PATH'].partition(os.pathsep)[2]}
    assert lines(tmp_path, environment, text) == lines(tmp_path, fresh, text)


def ended_by(number, process):
    """Send a signal until it is heard, as a user does; return what is written to the standard error.

    An interpreter that is about to read looks for signals, then reads: one in between is seen with the next one.
    """
    deadline = time.monotonic() + WAIT_S
    while True:
        process.send_signal(number)
        try:
            return process.communicate(timeout=AGAIN_S)[1]
        except subprocess.TimeoutExpired:
            assert time.monotonic() < deadline, 'the signal does not reach the command'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_reaches_the_command_and_its_status_comes_back(number, waiting):
    process, _ = waiting
    errors = ended_by(number, process)
    assert process.returncode == 128 + number
    assert errors.startswith('error: ')


def test_a_stand_in_that_is_killed_takes_its_command_with_it(waiting):
    process, writing = waiting
    process.kill()
    gone = select.poll()
    gone.register(writing, 0)
    assert gone.poll(1000.0 * WAIT_S), 'the command still reads'


def test_what_is_read_when_an_interpreter_starts_is_read_by_a_new_one(environment, tmp_path):
    code, output, _ = lines(tmp_path, environment | {'PYTHONVERBOSE': '1'}, 'delta3 --version 2>&1')
    assert code == 0
    assert "import 'delta3_pacdrive.cli.main'" in output or '# code object from' in output
