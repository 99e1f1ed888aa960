"""Tests of ``delta3 run`` for users: good runs, interruptions, killed processes; and the end of ``delta3 up``."""

import contextlib
import ctypes
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from delta3_pacdrive.bringup.scheduling import drop_real_time, real_time_is_permitted
from robots import PACE, crowding

Runner = Callable[..., subprocess.CompletedProcess[str]]

START_DEADLINE_S = 60.0
END_DEADLINE_S = (
    2.0  # promised to users of a machine that does nothing else: Ctrl-C ends every process in this time
)

LONG_PROGRAM = """
moves:
  - move_l: {to_m: [0.1, 0.0, -0.8]}
  - dwell: {time_s: 600.0}
"""


def _wait_for(condition: Callable[[], bool], what: str, seconds: float = START_DEADLINE_S) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f'{what} did not come true within {seconds} s'
        time.sleep(0.02)


def _pid_of(name: str, processes: Callable[[], list[str]]) -> int:
    return next(
        int(entry.split(':')[0])
        for entry in processes()
        if Path(f'/proc/{entry.split(":")[0]}/comm').read_text().strip() == name[:15]
    )


@pytest.fixture
def long_run(
    tmp_path: Path, start_delta3: Callable[..., subprocess.Popen[str]], nothing_left_behind: None
) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Start a run that lasts for ten minutes, and wait until it is recording the motion."""
    yield from _long_run(tmp_path, start_delta3)


@pytest.fixture
def light_run(
    tmp_path: Path, start_delta3: Callable[..., subprocess.Popen[str]], nothing_left_behind: None
) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Start such a run in one process, which leaves half of a small machine to others."""
    yield from _long_run(tmp_path, start_delta3, '--single-process')


def _long_run(
    tmp_path: Path, start_delta3: Callable[..., subprocess.Popen[str]], *options: str
) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    program = tmp_path / 'long.yaml'
    program.write_text(LONG_PROGRAM)
    bag = tmp_path / 'bag'
    # at a quarter of the pace: a machine that is busy with six processes has time for what is looked at
    process = start_delta3('run', program, '--bag', bag, '--real-time-factor', '0.25', *options)
    try:
        # the recorder's file grows only once cyclic operation has begun
        file = bag / 'bag.mcap'
        _wait_for(
            lambda: process.poll() is not None or (file.exists() and file.stat().st_size > 1_000_000), 'a run'
        )
        assert process.poll() is None, process.stderr.read()
        yield process, bag
    finally:
        process.kill()
        process.communicate()


def _end(process: subprocess.Popen[str]) -> tuple[float, str]:
    started = time.monotonic()
    _, errors = process.communicate(timeout=60.0)
    return time.monotonic() - started, errors


@pytest.mark.real_time
def test_interrupt_stops_every_process_and_leaves_a_readable_bag(
    long_run: tuple, processes: Callable[[], list[str]], delta3: Runner
) -> None:
    process, bag = long_run
    assert len(processes()) >= 8
    second = delta3('run')
    assert second.returncode == 1
    assert second.stderr.startswith('error: a robot is already up in namespace /')
    assert process.poll() is None
    crowded = crowding()  # with this robot, which has to end itself
    process.send_signal(signal.SIGINT)
    duration, errors = _end(process)
    assert process.returncode == 130
    assert errors.strip().endswith('error: interrupted')
    assert duration < END_DEADLINE_S * max(crowded, crowding())
    assert processes() == []
    from delta3_pacdrive.recording import trace_file

    assert len(trace_file.load(bag).time_s) > 100


@pytest.mark.parametrize(
    'victim',
    [
        pytest.param('plant', marks=pytest.mark.long),
        'mc4_drive_2',
        pytest.param('transformation_task', marks=pytest.mark.long),
    ],
)
def test_a_process_that_dies_ends_the_run_with_its_name(
    victim: str, long_run: tuple, processes: Callable[[], list[str]]
) -> None:
    process, _ = long_run
    os.kill(_pid_of(victim, processes), signal.SIGKILL)
    _, errors = _end(process)
    assert process.returncode == 1
    assert f'error: {victim} was killed by SIGKILL' in errors
    assert errors.count('\n') == 1


@pytest.mark.long
def test_a_recorder_that_dies_stops_no_robot_and_its_bag_can_be_read(
    tmp_path: Path,
    start_delta3: Callable[..., subprocess.Popen[str]],
    processes: Callable[[], list[str]],
    nothing_left_behind: None,
) -> None:
    program = tmp_path / 'slow.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.2, 0, -0.75], speed_m_s: 0.03}}]')
    bag = tmp_path / 'bag'
    # so slow that a machine which is busy with it has time for the recorder, and the program does not end before that
    process = start_delta3('run', program, '--bag', bag, '--json', '--real-time-factor', '0.25')
    file = bag / 'bag.mcap'
    # several times as much as is looked for: topic after topic is written, and a busy recorder takes big bites
    _wait_for(
        lambda: process.poll() is not None or (file.exists() and file.stat().st_size > 2_000_000),
        'a run',
        3.0 * START_DEADLINE_S,
    )
    os.kill(_pid_of('recorder', processes), signal.SIGKILL)
    output, errors = process.communicate(timeout=120.0)
    assert process.returncode == 0, errors
    result = json.loads(output)
    assert result['ok'] is True
    told = [note for note in result['notices'] if note.startswith('recorder was killed by SIGKILL')]
    assert told, result['notices']
    from delta3_pacdrive.recording import trace_file

    assert 100 < len(trace_file.load(bag).time_s) < result['cycles']


@pytest.mark.long
@pytest.mark.parametrize(
    # at the begin of a bag there are topics, or there are none yet, but no bus cycles
    ('left', 'told'),
    [(60, 'it was cut off or is damaged'), (60_000, 'it contains no ')],
)
def test_unreadable_recording_keeps_the_other_results(
    left: int,
    told: str,
    tmp_path: Path,
    start_delta3: Callable[..., subprocess.Popen[str]],
    processes: Callable[[], list[str]],
    nothing_left_behind: None,
) -> None:
    program = tmp_path / 'slow.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.2, 0, -0.75], speed_m_s: 0.06}}]')
    bag = tmp_path / 'bag'
    process = start_delta3('run', program, '--bag', bag, '--json')
    file = bag / 'bag.mcap'
    _wait_for(
        lambda: process.poll() is not None or (file.exists() and file.stat().st_size > 500_000), 'a run'
    )
    os.kill(_pid_of('recorder', processes), signal.SIGKILL)
    os.truncate(file, left)
    output, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors
    result = json.loads(output)
    assert result['ok'] is True
    assert told in result['bag_cut']


@pytest.mark.parametrize('number', [pytest.param(signal.SIGTERM, marks=pytest.mark.long), signal.SIGHUP])
def test_a_robot_that_is_ended_brakes_first(
    number: signal.Signals, start_delta3: Callable, delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    process = start_delta3('up', '--bag', tmp_path / 'bag', *PACE)
    assert delta3('move', 'wait').returncode == 0
    process.send_signal(number)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors
    with AnyReader([tmp_path / 'bag']) as reader:
        connections = [c for c in reader.connections if c.topic == '/axis1/motor_current']
        frames = [
            reader.deserialize(data, connection.msgtype).header.frame_id
            for connection, _, data in reader.messages(connections)
        ]
    brakes = [frame.split()[0] for frame in frames]
    assert 'free' in brakes
    assert brakes[-1] == 'held'


@pytest.mark.long
def test_second_robot_runs_in_another_namespace(light_run: tuple, delta3: Runner) -> None:
    process, _ = light_run
    done = delta3('run', '--namespace', 'cell2', '--single-process', '--json')
    assert done.returncode == 0, done.stderr
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _end(process)


@pytest.mark.long
def test_the_benchmark_of_the_graph_has_a_column_for_each_kind_of_user(
    delta3: Runner, nothing_left_behind: None
) -> None:
    cases = [word for case in ('machine', 'bare', 'single') for word in ('--case', case)]
    done = delta3('bench', 'graph', '--seconds', '1', *cases, '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    columns = {'real-time', 'ordinary'} if real_time_is_permitted() else {'ordinary'}
    assert all(result[case].keys() == columns for case in ('machine', 'bare', 'single'))
    for column in columns:
        assert result['bare'][column]['cycles'] == 1000
        assert result['single'][column]['lost_telegrams'] == 0
        assert result['machine'][column]['lateness_ms']['max'] > 0.0


@pytest.mark.long
def test_the_benchmark_of_motions_measures_every_figure_it_promises(delta3: Runner) -> None:
    done = delta3('bench', 'motion', '--seconds', '1', '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['planning_ms'].keys() == result['cycle_us'].keys()
    assert all(times['p50'] > 0.0 for times in result['planning_ms'].values())
    assert all(0.0 < times['p50'] < times['p90'] < times['max'] for times in result['picks_ms'].values())
    errors = result['errors']
    assert errors['circle_m'] < 1e-6
    assert errors['cruise_speed'] < 1e-3
    assert errors['points_m'] < 1e-9
    bounds = result['packaging']['bounds']
    assert bounds['motors alone'] < bounds['free jerk'] < bounds['planned']
    arriving = result['plans_arriving']
    assert arriving['without']['plans'] == 0
    assert arriving['with']['plans'] >= 15
    assert arriving['with']['lateness_ms'].keys() == arriving['without']['lateness_ms'].keys()


@pytest.mark.long
def test_robot_too_fast_for_the_machine_yields(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'rounds.yaml'
    program.write_text(
        'repeat: 50\nmoves: [{move_l: {to_m: [0.1, 0, -0.8]}}, {move_l: {to_m: [0, 0, -0.75]}}]'
    )
    done = delta3('run', program, '--real-time-factor', '100', '--json')
    result = json.loads(done.stdout)
    assert result['bus_time_s'] / result['wall_time_s'] < 50.0
    assert [note for note in result['notices'] if note.startswith('the machine is too slow: ')]


def without_permission() -> None:
    """Take from this process, and those that it starts, the right to schedule in real time."""
    drop_from_bounding_set, sys_nice = 24, 23
    ctypes.CDLL(None).prctl(drop_from_bounding_set, sys_nice, 0, 0, 0)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))


def policies_of(processes: list[str]) -> set[int]:
    """Return the scheduling policies of all threads of processes."""
    found = set()
    for entry in processes:
        for thread in Path(f'/proc/{entry.split(":")[0]}/task').iterdir():
            with contextlib.suppress(ProcessLookupError):
                found.add(os.sched_getscheduler(int(thread.name)))
    return found


def test_missing_real_time_permission_is_explained_and_the_robot_runs(
    start_delta3: Callable[..., subprocess.Popen[str]],
    processes: Callable[[], list[str]],
    nothing_left_behind: None,
) -> None:
    process = start_delta3('up', *PACE, preexec_fn=without_permission)
    line = process.stderr.readline()
    assert 'rtprio 20' in line
    assert '--single-process' in line
    assert process.stderr.readline().startswith('ready after')
    assert policies_of(processes()) == {os.SCHED_OTHER}
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors


@pytest.mark.real_time
def test_child_with_lower_priority_has_no_real_time_thread(tmp_path: Path) -> None:
    code = (
        'import threading, time\n'
        'threading.Thread(target=time.sleep, args=(60,)).start()\n'
        'print("up", flush=True)'
    )
    process = subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == 'up\n'
        threads = [int(path.name) for path in Path(f'/proc/{process.pid}/task').iterdir()]
        assert len(threads) == 2
        try:
            for thread in threads:
                os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            pytest.skip('real-time scheduling is not permitted here')
        drop_real_time(process.pid)
        assert [os.sched_getscheduler(thread) for thread in threads] == [os.SCHED_OTHER] * 2
    finally:
        process.kill()
        process.communicate()


def test_a_robot_that_is_not_in_position_fails_a_run(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program, impatient = tmp_path / 'waits.yaml', tmp_path / 'impatient.yaml'
    program.write_text(
        'start_m: [0.0, 0.0, -0.75]\npayload_kg: 10\nin_position: true\n'
        'limits: {speed_m_s: 1.0, acceleration_m_s2: 15.0}\nmoves: [{move_l: {to_m: [0.0, 0.5, -0.9]}}]'
    )
    impatient.write_text('/**:\n  ros__parameters:\n    motion: {in_position_timeout_s: 0.05}\n')
    options = ['--single-process', '--real-time-factor', '0', '--parameters', f'delta3+{impatient}']
    done = delta3('run', program, '--json', *options)
    assert done.returncode == 1
    result = json.loads(done.stdout)
    assert 'not in position 0.05 s after the set points came to rest at the end of move 1' in result['error']


@pytest.mark.long
def test_a_fourth_drive_that_is_killed_ends_the_run_with_its_name(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'killed.yaml'
    program.write_text(
        'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.2, turn_deg: 90}}]\n'
        'faults: [{fault: kill, node: axis4, after_s: 0.2}]\n'
    )
    done = delta3('run', program, '--parameters', 'rotary', '--real-time-factor', '0')
    assert done.returncode == 1
    assert 'mc4_drive_4 was killed by SIGKILL in bus cycle' in done.stderr
    done = delta3('run', program)
    assert done.returncode == 1
    assert 'the robot has no' in done.stderr
