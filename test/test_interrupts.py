"""Tests of the end of commands: signals at any moment, no space, memory or home; one message each."""

import ast
import json
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.output import run_and_report
from delta3_pacdrive.errors import RunInterruptedError
from delta3_pacdrive.recording import trace_file
from thoroughness import some

COMMAND = [sys.executable, '-P', '-m', 'delta3_pacdrive.cli.main']
MOMENTS = int(os.environ.get('DELTA3_MOMENTS', '2'))  # and one more, of each command
REACH_S = 1.2  # of processor: until then a command has loaded all it needs, and works
LIMIT_S = 900.0  # of one command on a machine whose cores are all busy
LOOK_S = 1e-3  # between two looks
# each offline command in the shortest way that goes through all of its stages
OFFLINE = {
    'simulate': ['simulate', '--trace', 'trace.npz'],
    'plot': ['plot', '{trace}'],
    'two-link': ['two-link', '--figures', 'arm'],
    'check': ['check', 'packaging'],
    'completion': ['completion', 'bash'],
    'experiment': ['experiment', '1', '--no-attribution'],
    'jacobian': ['jacobian', 'experiment1'],
    'tune': ['tune', '--program', 'experiment1'],
    'estimate': ['estimate', '{program}'],
    'plan': ['plan', '{program}', '--output', 'plan'],
    'pose': ['pose', '--output', 'pose'],
    'workspace': ['workspace', '--resolution', '30', '--output', 'workspace'],
    'export': ['export', 'trace', '{trace}', '--output', 'run.csv', '--overwrite'],
    'report': ['report', '{trace}'],
    'compare': ['compare', '{trace}', '{trace}', '--output', 'compare', '--no-attribution'],
    'calibrate': ['calibrate', 'plan', '--number', '24', '--output', 'calibration'],
    'learn': ['learn', '{program}', '--repetitions', '1', '--parameters', 'model'],
    'ripple': ['ripple', '{program}', '--cycle-time', '1'],
    'sweep': ['sweep', '{sweep}', '--workers', '1'],
}
IN_EACH_RUN = 'simulate', 'completion', 'sweep'  # each of them works in its own way
PROGRAM = """
start_m: [0.0, 0.0, -0.75]
limits: {speed_m_s: 2.5, acceleration_m_s2: 30.0, jerk_m_s3: 4000.0}
moves:
  - move_l: {to_m: [0.1, 0.05, -0.8]}
  - move_l: {to_m: [-0.1, 0.1, -0.77]}
  - move_l: {to_m: [0.0, 0.0, -0.75]}
"""

SWEEP = """
program: program.yaml
runs: 3
vary:
  dynamics.payload_mass_kg: {uniform: [0.4, 0.6]}
"""


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return the files of a short program and of a trace; kernels are compiled after this."""
    folder = tmp_path_factory.mktemp('files')
    program, sweep, path = (folder / name for name in ('program.yaml', 'sweep.yaml', 'trace.npz'))
    program.write_text(PROGRAM, encoding='utf-8')
    sweep.write_text(SWEEP, encoding='utf-8')
    subprocess.run([*COMMAND, 'simulate', '--trace', path], check=True, capture_output=True, timeout=LIMIT_S)
    return {'program': program, 'sweep': sweep, 'trace': path}


@pytest.fixture(scope='module', autouse=True)
def asked_of_nobody():
    """Ask a robot that there is not; the answer takes ten seconds, in which other tests run."""
    alone = os.environ | {'ROS_DOMAIN_ID': str(110 + os.getpid() % 100)}
    command = [*COMMAND, 'move', 'state', '--namespace', 'nobody']
    process = subprocess.Popen(command, env=alone, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


def catches(process, number):
    """Whether a process has a handler for a signal."""
    try:
        lines = Path(f'/proc/{process.pid}/status').read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return False
    (mask,) = (int(line.split()[1], 16) for line in lines if line.startswith('SigCgt'))
    return bool(mask >> (number - 1) & 1)


def start(arguments, folder, **options):
    """Start a command; return it once it answers signals (before that it is Python that starts, not the command)."""
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )
    while not catches(process, signal.SIGTERM):
        if over_within(process, LOOK_S):
            break
    return process


def over_within(process, seconds):
    """Whether a process ends within some time; where others need the processor, nothing looks without a pause."""
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True


def worked_until(process, seconds):
    """Let a process work for some seconds of processor, or to its end; return how long it has worked."""
    ticks, begin, worked = os.sysconf('SC_CLK_TCK'), None, 0.0
    while process.poll() is None:
        fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
        now = sum(int(field) for field in fields[11:13]) / ticks
        begin = now if begin is None else begin
        worked = now - begin
        if worked >= seconds or over_within(process, LOOK_S):
            break
    return worked


def children_of(folder):
    """Return the processes that still work in a folder."""
    found = []
    for path in Path('/proc').glob('[0-9]*'):
        with suppress(OSError):
            if path.joinpath('cwd').resolve() == folder:
                found.append(path.joinpath('cmdline').read_text())
    return found


def ended(command, **options):
    """Return a command that has ended."""
    defaults = {'capture_output': True, 'text': True, 'timeout': LIMIT_S}
    return subprocess.run(command, check=False, **defaults | options)


def assert_one_sentence(errors, expected):
    lines = [line for line in errors.splitlines() if line]
    assert len(lines) == 1, errors
    assert expected in lines[0]


@pytest.mark.parametrize('name', some(OFFLINE, IN_EACH_RUN))
def test_ctrl_c_at_any_moment_ends_an_offline_command_with_one_message(name, files, tmp_path):
    arguments = [text.format(**files) for text in OFFLINE[name]]
    reach_s, interrupted = REACH_S, 0
    # denser at the begin: imports, kernels and the first work come one after the other there
    for moment in range(MOMENTS, -1, -1):
        process = start(arguments, tmp_path)
        worked_s = worked_until(process, reach_s * (moment / MOMENTS) ** 4)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=LIMIT_S)
        assert 'Traceback' not in errors
        assert process.returncode in (0, 130), errors
        if process.returncode:  # else it was over before, or had nothing left to do but to end
            assert_one_sentence(errors, 'interrupted')
            interrupted += 1
        elif moment == MOMENTS:
            reach_s = worked_s
    assert interrupted >= MOMENTS // 2
    assert children_of(tmp_path) == []


@pytest.mark.parametrize('name', ['simulate', 'tune'])
@pytest.mark.parametrize(('number', 'status'), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_end_by_another_signal_is_reported_with_its_own_status(name, number, status, files, tmp_path):
    process = start(OFFLINE[name], tmp_path)
    process.send_signal(number)
    _, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == status
    assert_one_sentence(errors, f'ended by {number.name}')


def test_thirty_times_ctrl_c_gives_one_message_too(files, tmp_path):
    for name in ('simulate', 'jacobian'):
        process = start([text.format(**files) for text in OFFLINE[name]], tmp_path)
        for _ in range(30):
            process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 130
        assert_one_sentence(errors, 'interrupted')


TWICE = """
import os, signal
from delta3_pacdrive import interrupts
write = os.write
def write_and_interrupt(file, data):
    write(file, data)
    signal.raise_signal(signal.SIGINT)
os.write = write_and_interrupt
interrupts.install()
signal.raise_signal(signal.SIGTERM)
"""


def test_second_signal_during_the_final_report_does_not_repeat_it():
    done = ended([sys.executable, '-P', '-c', TWICE])
    assert done.returncode == 143
    assert_one_sentence(done.stderr, 'ended by SIGTERM')


def test_an_interrupted_command_answers_in_json_as_well(tmp_path):
    process = start(['estimate', '--json'], tmp_path)
    # options are read, heavy modules are being loaded
    while 'numpy' not in Path(f'/proc/{process.pid}/maps').read_text() and not over_within(process, LOOK_S):
        pass
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130
    assert json.loads(output) == {'ok': False, 'error': 'interrupted'}


def test_signals_that_the_parent_ignores_stay_ignored(tmp_path):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = start(['two-link'], tmp_path, preexec_fn=ignore)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0


SWALLOWED = """
import ctypes, signal, time
from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.output import run_and_report
interrupts.install()

@ctypes.CFUNCTYPE(None)
def callback():
    signal.raise_signal(signal.SIGINT)  # as at the moment at which a compiler calls back

def work():
    callback()
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        pass
    return 0

with interrupts.raising():
    raise SystemExit(run_and_report(work))
"""


def test_an_interrupt_that_a_callback_swallows_is_raised_again():
    begin = time.monotonic()
    done = ended([sys.executable, '-P', '-c', SWALLOWED])
    assert done.returncode == 130
    assert_one_sentence(done.stderr, 'interrupted')
    assert time.monotonic() - begin < 20.0  # not when the work was over by itself


CONVERTED = """
import signal
from delta3_pacdrive import interrupts
from delta3_pacdrive.cli.output import run_and_report
interrupts.install()

def work():
    try:
        signal.raise_signal(signal.SIGTERM)
    except KeyboardInterrupt:
        raise RuntimeError('as the import of an extension does')

with interrupts.raising():
    raise SystemExit(run_and_report(work))
"""


def test_interrupt_converted_on_its_way_is_still_an_interrupt():
    done = ended([sys.executable, '-P', '-c', CONVERTED])
    assert done.returncode == 143
    assert_one_sentence(done.stderr, 'ended by SIGTERM')


def test_signal_with_a_handler_of_ros_is_an_interrupt_too(capfd):
    class ExternalShutdownException(Exception):  # noqa: N818 (as rclpy calls it)
        pass

    def work():
        raise ExternalShutdownException

    def run():
        raise RunInterruptedError('interrupted')

    assert run_and_report(run) == 130
    assert_one_sentence(capfd.readouterr().err, 'interrupted')
    assert run_and_report(work) == 130
    assert_one_sentence(capfd.readouterr().err, 'interrupted')


def test_error_in_the_code_keeps_its_traceback():
    def work():
        raise RuntimeError('a mistake')

    with pytest.raises(RuntimeError, match='a mistake'):
        run_and_report(work)


@pytest.mark.parametrize(
    ('error', 'sentence'),
    [
        (MemoryError(), 'not enough memory'),
        (OSError(28, 'No space left on device', 'x.csv'), 'x.csv: No space left on device'),
        (KeyboardInterrupt(), 'interrupted'),
        (interrupts.Interrupted(signal.SIGHUP), 'ended by SIGHUP'),
    ],
)
def test_system_errors_give_one_message(error, sentence, capfd):
    def work():
        raise error

    assert run_and_report(work) != 0
    assert_one_sentence(capfd.readouterr().err, sentence)


@pytest.mark.parametrize(
    'arguments', [['--help'], ['simulate', '--help'], ['two-link'], ['two-link', '--json'], ['drive', 'list']]
)
def test_full_disk_under_standard_output_is_reported(arguments):
    with open('/dev/full', 'w') as full:
        done = ended([*COMMAND, *arguments], capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert_one_sentence(done.stderr, 'No space left on device')


def test_closed_streams_are_not_replaced_by_a_file(tmp_path):
    """Otherwise, the output would go to the file that has got the number of the closed stream."""
    trace = tmp_path / 'run.npz'
    done = ended(
        [
            'sh',
            '-c',
            'exec "$@" <&- >&- 2>&-',
            'sh',
            *COMMAND,
            'simulate',
            'experiment1',
            '--trace',
            str(trace),
        ]
    )
    assert done.returncode == 0
    assert trace_file.load(trace).meta['stopped'] == ''


@pytest.mark.parametrize('domain', ['abc', '999', '-1', ' '])
@pytest.mark.parametrize(
    'command', [['move', 'state'], ['run'], ['drive', '1', 'S-0-0104'], ['experiment', '1', '--graph']]
)
def test_invalid_ros_domain_is_reported(command, domain):
    environment = os.environ | {'ROS_DOMAIN_ID': domain}
    done = ended([*COMMAND, *command], env=environment)
    assert done.returncode == 1
    assert_one_sentence(done.stderr, f'ROS_DOMAIN_ID is {domain!r}, but must be a whole number from 0 to 232')


def test_robot_that_is_not_running_is_reported_with_its_namespace(asked_of_nobody):
    pytest.importorskip('rclpy', reason='the extra "ros" is not installed')
    output, errors = asked_of_nobody.communicate(timeout=LIMIT_S)
    sentence = 'error: no motion/progress within 10 s: is a robot up in namespace /nobody?\n'
    assert (asked_of_nobody.returncode, output, errors) == (1, '', sentence)


def test_commands_without_a_graph_do_not_care_for_the_domain():
    environment = os.environ | {'ROS_DOMAIN_ID': 'abc'}
    for command in (['two-link'], ['drive', 'list'], ['move', '--help']):
        done = ended([*COMMAND, *command], env=environment)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('command', [['simulate'], ['tune'], ['run']])
def test_insufficient_memory_is_reported_before_libraries_block(command):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (600_000 * 1024,) * 2)

    done = ended([*COMMAND, *command], preexec_fn=limit)
    assert done.returncode == 1
    assert_one_sentence(done.stderr, 'memory is limited to 614 MB')


@pytest.mark.long
def test_names_that_yaml_reads_as_other_types_are_names(tmp_path):
    name = os.fsdecode(b'a\xff')
    done = ended([*COMMAND, 'simulate', name])
    assert done.returncode == 1
    assert_one_sentence(done.stderr, 'cannot read program file a\\udcff')
    done = ended([*COMMAND, 'two-link', '--figures', name], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / name).glob('*.png'))


def test_missing_home_folder_is_no_obstacle(tmp_path):
    caches = ('HOME', 'XDG_CACHE_HOME', 'NUMBA_CACHE_DIR')
    environment = {key: value for key, value in os.environ.items() if key not in caches}
    for home in ({}, {'HOME': '/proc'}):  # none, and one in which nothing can be written
        done = ended(
            [*COMMAND, 'two-link'],
            env=environment | home,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
    assert not list(tmp_path.iterdir())  # no folder that is called ~


EVENT = """
over = threading.Event()
with interrupts.answered_by(over.set):
    pass
"""


def events_set_by_signals(source):
    """Return the names of the events that a handler sets: it blocks if it interrupts the holder of their lock."""
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    names = {ast.unparse(call.args[0]) for call in calls if ast.unparse(call.func).endswith('answered_by')}
    assigned = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Assign)]
    events = {ast.unparse(one.targets[0]) for one in assigned if ast.unparse(one.value).endswith('Event()')}
    return {f'{event}.set' for event in events} & names


def test_no_signal_handler_acquires_the_lock_of_an_event():
    assert events_set_by_signals(EVENT) == {'over.set'}
    package = Path(interrupts.__file__).parent
    sources = {path: path.read_text(encoding='utf-8') for path in package.rglob('*.py')}
    users = {path: source for path, source in sources.items() if 'answered_by(' in source}
    assert len(users) > 5
    assert {
        path.name: found for path, source in users.items() if (found := events_set_by_signals(source))
    } == {}


FLAG = """
import os, signal
from delta3_pacdrive import interrupts
flag, looks = interrupts.Flag(), []
with interrupts.answered_by(flag.set):
    for look in range(10):
        looks.append(bool(flag))
        if look == 4:
            os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGINT)
print(looks == [False] * 5 + [True] * 5, interrupts.sentence(interrupts.asked()))
"""


def test_flag_requests_the_end_and_work_continues_until_it_is_read():
    done = ended([sys.executable, '-P', '-c', FLAG])
    assert (done.returncode, done.stdout) == (0, 'True ended by SIGTERM\n')


STUCK = """
import sys, threading
from concurrent.futures import ThreadPoolExecutor
from delta3_pacdrive import interrupts
ThreadPoolExecutor(1).submit(threading.Event().wait)
interrupts.install()
interrupts.ignore()
interrupts.end_within(0.1, 3)
sys.exit(3)
"""
DEAF = """
import os, signal
from delta3_pacdrive import interrupts
interrupts.install()
with interrupts.answered_by(lambda: None, patience_s=float(__import__('sys').argv[1])):
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGTERM)
print('ended by itself')
"""


def test_a_thread_that_never_ends_does_not_keep_the_process():
    assert ended([sys.executable, '-P', '-c', STUCK]).returncode == 3


@pytest.mark.parametrize(
    ('patience_s', 'answer'),
    [('-1', (143, '', 'error: ended by SIGTERM\n')), ('60', (0, 'ended by itself\n', ''))],
)
def test_work_that_does_not_look_is_left_by_a_later_signal(patience_s, answer):
    done = ended([sys.executable, '-P', '-c', DEAF, patience_s])
    assert (done.returncode, done.stdout, done.stderr) == answer


def test_a_process_that_calls_a_command_as_a_function_outlives_the_end_of_its_page():
    code = """
import threading, time
from delta3_pacdrive import interrupts
threading.Thread(target=threading.Event().wait, daemon=True).start()
interrupts.end_within(0.0, 3)
time.sleep(0.2)
print('goes on')
"""
    done = ended([sys.executable, '-P', '-c', code])
    assert (done.returncode, done.stdout) == (0, 'goes on\n')
