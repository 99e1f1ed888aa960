"""Tests of the processes of a robot: membership, scheduling and exit."""

import fcntl
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip(
    'rclpy', reason='processes of a robot need the ROS wheels (extra "ros") or a sourced ROS 2'
)

from delta3_pacdrive import parameters
from delta3_pacdrive.bringup import robot_processes, scheduling
from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.cpu_load import in_turn
from delta3_pacdrive.bringup.environment import log_folder, only_one
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.bringup.processes import ManagedProcess, end_all
from delta3_pacdrive.bringup.robot_processes import REPORT_S, STUCK_S, PhaseWatch, RobotProcesses
from delta3_pacdrive.errors import ParameterError, RunError
from delta3_pacdrive.recording.motion_progress import MotionProgress


def run_python(code, *arguments):
    """Run a Python process to its end."""
    command = [sys.executable, '-c', code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300.0, check=False)


# one robot in a namespace of a domain


def test_the_lock_of_a_robot_is_that_of_its_namespace_and_domain(monkeypatch):
    name = f'facts_{os.getpid()}'
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    with only_one(f'/{name}'):
        with pytest.raises(RunError, match=f'up in namespace {name} of domain 7'), only_one(name):
            pass
        with only_one(f'/{name}/cell2'):
            pass
        monkeypatch.setenv('ROS_DOMAIN_ID', '8')
        with only_one(f'/{name}'):
            pass
        monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    with only_one(f'/{name}'):
        pass


# folders for logs

LOGGING = """
import signal
from delta3_pacdrive.bringup.environment import log_folder
with log_folder(None) as folder:
    print(folder, flush=True)
    signal.pause()
"""


def test_logs_that_a_killed_bring_up_has_left_are_removed_by_the_next_and_those_of_the_living_are_kept(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    foreign = tmp_path / 'delta3_logs_of_somebody'
    foreign.mkdir()
    other = subprocess.Popen(
        [sys.executable, '-c', LOGGING],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {'TMPDIR': str(tmp_path)},
    )
    try:
        theirs = Path(other.stdout.readline().rstrip())
        assert theirs.parent == tmp_path
        with log_folder(None) as own, log_folder(None):
            assert theirs.is_dir()
            assert own.is_dir()
    finally:
        other.kill()
        other.communicate()
    (theirs / 'plant.log').write_text('the last words')
    with log_folder(None) as own:
        assert sorted(tmp_path.iterdir()) == sorted([foreign, own])
    assert list(tmp_path.iterdir()) == [foreign]


# children

CHILD = """
import signal, sys, time
def end(*_):
    time.sleep(float(sys.argv[1]))
    sys.exit(0)
signal.signal(signal.SIGINT, end if sys.argv[1] != 'never' else signal.SIG_IGN)
print('up', flush=True)
time.sleep(60)
"""


def started(way):
    """Start a process that is asked to end by SIGINT; it says when it is up."""
    process = subprocess.Popen([sys.executable, '-c', CHILD, way], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == 'up\n'
    return process


def child_of(process, tmp_path, name, patience_s=1.0):
    return ManagedProcess(name, process.pid, tmp_path / 'log', patience_s)


def test_end_all_gives_each_process_its_time_and_names_the_killed_ones(tmp_path):
    quick, slow, deaf = (started(way) for way in ('0', '0.3', 'never'))
    children = [
        child_of(quick, tmp_path, 'quick'),
        child_of(slow, tmp_path, 'slow', 10.0),
        child_of(deaf, tmp_path, 'deaf', 0.1),
    ]
    try:
        assert end_all(children) == ['deaf']
        assert [child.status for child in children] == [0, 0, -9]
    finally:
        for process in (quick, slow, deaf):
            process.kill()
            process.communicate()


PARENT = """
import os, signal, subprocess, sys
os.setpgid(0, 0)
subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'])
print('up', flush=True)
signal.sigwait([signal.SIGINT])
os._exit(0)
"""


def test_end_all_kills_grandchildren(tmp_path):
    parent = subprocess.Popen(
        [sys.executable, '-c', f'import signal; signal.pthread_sigmask(0, [2]); {PARENT}'],
        stdout=subprocess.PIPE,
    )
    assert parent.stdout.readline() == b'up\n'
    assert end_all([child_of(parent, tmp_path, 'view', 30.0)]) == ['view']
    assert parent.stdout.read() == b''  # the end of it is open in no process any more


def test_recorder_is_stopped_after_all_other_processes(tmp_path):
    code = CHILD.replace(
        'time.sleep(float(sys.argv[1]))', 'print(time.monotonic()); time.sleep(0.2); print(time.monotonic())'
    )
    recorder, plant = (
        subprocess.Popen([sys.executable, '-c', code, '0.2'], stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    )
    processes = RobotProcesses(Options(program=None), parameters.load(), '', tmp_path)
    processes.running = [child_of(recorder, tmp_path, 'recorder'), child_of(plant, tmp_path, 'plant')]
    try:
        assert [process.stdout.readline() for process in (recorder, plant)] == ['up\n', 'up\n']
        assert processes.end() == []
        (asked, _), (_, ended) = (map(float, process.stdout) for process in (recorder, plant))
        assert ended <= asked
    finally:
        for process in (recorder, plant):
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    ('status', 'printed', 'sentence'),
    [
        (3, '', 'plant ended with status 3'),
        (-9, 'begins\n', 'plant was killed by SIGKILL'),
        (1, 'error: one\nerror: two\n\n', 'plant ended with status 1: two'),
        (1, 'error: one\nTraceback\n', 'plant ended with status 1: one'),
    ],
)
def test_end_is_reported_with_the_last_error(status, printed, sentence, tmp_path):
    (tmp_path / 'log').write_text(printed)
    assert ManagedProcess('plant', 0, tmp_path / 'log', status=status).ending() == sentence


# participants that are alive, but are not heard

DRIVES = ('axis1', 'axis2', 'axis3')


class Bus:
    """A transformation task that reports its phase every 0.2 s, and a watch that follows it."""

    def __init__(self):
        self.watch, self.now_s = PhaseWatch(DRIVES), 100.0

    def replaced(self, phase, missing, seconds):
        """Return (seconds after the first report, replaced participants) of each replacement."""
        found = []
        for n in range(round(seconds / REPORT_S) + 1):
            if names := self.watch.update(MotionProgress(phase=phase, missing=tuple(missing)), self.now_s):
                found.append((round(n * REPORT_S, 3), names))
            self.now_s += REPORT_S
        return found


@pytest.mark.parametrize(
    ('phase', 'missing', 'replaced'),
    [
        ('CP0', ['axis3'], ('axis3',)),
        ('CP0', ['plant'], ('plant',)),
        ('CP0', ['axis3', 'axis1'], ('axis1', 'axis3')),
        ('CP0', [*DRIVES], DRIVES),
        ('CP0', [*DRIVES, 'plant'], ('transformation_task',)),
        ('CP1', ['axis2'], ('axis2',)),
        ('CP1', [*DRIVES], ('plant',)),  # the drives answer with the shafts of the plant
        ('CP2', ['axis2'], ('axis2',)),
        ('CP2', [*DRIVES], ('plant',)),
    ],
)
def test_a_participant_that_the_bus_waits_for_more_than_15_s_is_replaced(phase, missing, replaced):
    bus = Bus()
    bus.watch.update(MotionProgress(phase='CP4'), bus.now_s)
    ((after_s, names),) = bus.replaced(phase, missing, 2.0 * STUCK_S)
    assert names == replaced
    assert STUCK_S - REPORT_S <= after_s <= STUCK_S + 2.0 * REPORT_S


def test_the_time_between_two_replacements_doubles_and_every_other_one_is_that_of_the_task():
    bus = Bus()
    times, names = zip(*bus.replaced('CP0', ['axis3'], 600.0), strict=True)
    gaps = [later - earlier for earlier, later in zip((0.0, *times), times, strict=False)]
    assert gaps == pytest.approx([15.0, 30.0, 60.0, 120.0, 120.0, 120.0, 120.0], abs=2.0 * REPORT_S)
    assert names[:4] == (('axis3',), ('transformation_task',), ('axis3',), ('transformation_task',))
    assert bus.replaced('CP4', [], 1.0) == []
    assert bus.replaced('CP0', ['axis3'], 20.0)[0][1] == ('axis3',)


def test_no_participant_is_replaced_while_the_bus_advances_or_waits_for_none():
    bus = Bus()
    for _ in range(10):
        assert bus.replaced('CP0', ['axis3'], STUCK_S - 1.0) == []
        assert bus.replaced('CP1', [], 0.0) == []
    assert bus.replaced('CP3', [], 100.0) == []  # for a program, or for other robots
    assert bus.replaced('CP2', [], 100.0) == []  # for equal parameters


def test_time_in_which_the_task_reports_nothing_does_not_count():
    bus = Bus()
    stale = MotionProgress(phase='CP0', missing=('axis3',))
    for _ in range(1000):
        assert bus.watch.update(stale, bus.now_s) == ()
        bus.now_s += REPORT_S
    assert bus.watch.update(replace(stale), bus.now_s) == ()  # all were suspended for 200 s


def test_a_process_that_was_started_again_has_its_time():
    bus = Bus()
    for _ in range(5):
        assert bus.replaced('CP0', ['axis3'], STUCK_S - 1.0) == []
        bus.watch.restart(bus.now_s)


# scheduling

PERMITTED = """
from delta3_pacdrive.bringup import scheduling
before = scheduling.real_time_is_permitted()
scheduling.give_up_real_time()
print(before, scheduling.real_time_is_permitted())
"""


def may_schedule_in_real_time():
    """Return whether a new process gets real-time scheduling."""
    code = 'import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))'
    return run_python(code).returncode == 0


def test_real_time_is_permitted_where_it_works_and_not_where_it_was_given_up():
    done = run_python(PERMITTED)
    assert done.stdout.split() == [str(may_schedule_in_real_time()), 'False'], done.stderr


def test_robot_requests_and_reserves_processor_time_in_one_turn(monkeypatch, tmp_path):
    order = []

    def note(what, answer):
        def noted(*_):
            order.append((what, is_free(Path('/proc'))))
            return answer

        return noted

    child = ManagedProcess('child', os.getpid(), tmp_path / 'log')
    monkeypatch.setattr(scheduling, 'real_time_is_permitted', lambda: True)
    monkeypatch.setattr(scheduling, 'await_real_time', note('waited', None))
    monkeypatch.setattr(robot_processes, 'lack_of_room', note('asked', ''))
    monkeypatch.setattr(robot_processes, 'spawn', note('started', child))
    with in_turn():  # nobody else has his turn now; who comes behind waits for that
        pass
    RobotProcesses(Options(program=None), parameters.load(), '', tmp_path).start()
    assert list(dict.fromkeys(order)) == [('asked', False), ('started', False), ('waited', False)]
    assert order.count(('started', False)) == 6
    order.clear()
    RobotProcesses(Options(program=None, crowded='no room'), parameters.load(), '', tmp_path).start()
    assert {what for what, _ in order} == {'started'}


LATE = """
import os, sys, time
sys.stdin.readline()
time.sleep(0.2)
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
sys.stdin.readline()
"""


@pytest.mark.skipif(not may_schedule_in_real_time(), reason='nobody here may schedule in real time')
def test_processes_are_awaited_until_they_are_in_real_time_and_those_that_have_ended_are_not():
    gone, late = (subprocess.Popen([sys.executable, '-c', LATE], stdin=subprocess.PIPE) for _ in range(2))
    try:
        gone.kill()
        gone.communicate()
        late.stdin.write(b'go\n')
        late.stdin.flush()
        scheduling.await_real_time([gone.pid, late.pid], 60.0)
        assert os.sched_getscheduler(late.pid) == os.SCHED_FIFO
        begin = time.monotonic()
        scheduling.await_real_time([os.getpid()], 0.05)  # one who never is
        assert 0.05 <= time.monotonic() - begin < 30.0
    finally:
        late.kill()
        late.communicate()


def is_free(folder):
    """Return whether the lock of the folder is free."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    finally:
        os.close(opened)
    return True


# being one process or several

ALONE = """
import sys
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.ros import node_process
def fail():
    print(node_process.is_separate())
    raise RunError('no node today')
sys.exit(node_process.run([fail] * int(sys.argv[1]), []))
"""


@pytest.mark.parametrize('nodes', [1, 2])
def test_process_detects_a_second_node_and_reports_a_failed_start(nodes):
    done = run_python(ALONE, str(nodes))
    assert done.stdout == f'{nodes == 1}\n'
    assert done.stderr == 'error: no node today\n'
    assert done.returncode == 1


# what a bring-up refuses before the first process starts


def test_bring_up_rejects_invalid_options_before_the_first_process_starts(tmp_path):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(RunError, match='bag: it exists already'):
        Bringup(Options(program=None, bag=tmp_path / 'bag'))
    with pytest.raises(RunError, match="namespace '/cell 2' is not valid"):
        Bringup(Options(program=None, namespace='/cell 2'))
    file = tmp_path / 'robot.yaml'
    packaged = Path(__file__).parents[2] / 'config' / 'delta3.yaml'
    text = packaged.read_text(encoding='utf-8')
    (line,) = (row for row in text.splitlines() if row.strip().startswith('enable_cycle:'))
    file.write_text(text.replace(line, line.partition(':')[0] + ': -1'), encoding='utf-8')
    with pytest.raises(ParameterError, match=r'enable_cycle and motion\.start_cycle of at least 0'):
        Bringup(Options(program=None, parameters=file))
