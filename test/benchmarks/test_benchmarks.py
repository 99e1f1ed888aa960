"""Tests of the reports of benchmarks without ROS: all values that do not depend on the machine."""

import json
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.benchmarks import graph, motion, robots, shaping, simulation, steering
from delta3_pacdrive.benchmarks.case import in_child, program_file
from delta3_pacdrive.bringup import scheduling
from delta3_pacdrive.cli import bench
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.motion_progress import MotionProgress


def run(capsys, *arguments):
    """Run ``delta3 bench``; return its JSON output."""
    assert bench.main([*arguments, '--json']) == 0
    return json.loads(capsys.readouterr().out)


def test_array_kinematics_invert_each_other(capsys, monkeypatch):
    monkeypatch.setattr(simulation, 'POSES', 10_000)
    result = run(capsys, 'kinematics')
    assert result['round_trip_max_m'] < 2e-15
    assert set(result['poses_per_s']) == {'inverse', 'forward', 'jacobian', 'singularity', 'capability'}


def test_rate_is_compared_with_the_target_of_its_direction():
    """Ten million inverse and five million forward solutions a second; no aim for the others."""
    rates = {name: {'median': 4e6, 'best': 6e6} for name in ('inverse', 'forward', 'jacobian')}
    text = simulation.kinematics_text({'poses_per_s': rates, 'round_trip_max_m': 1.5e-15, 'poses': 1000})
    assert [' '.join(line.split()) for line in text] == [
        'inverse 4.0 M poses/s median, 6.0 best, 0.40 of the aim',
        'forward 4.0 M poses/s median, 6.0 best, 0.80 of the aim',
        'jacobian 4.0 M poses/s median, 6.0 best',
        'round trip 1.5e-15 m at most, 1000 poses',
    ]


@pytest.mark.parametrize('seconds', [1.0, 6.0, 60.0])
def test_program_of_a_benchmark_has_about_the_requested_duration(seconds, robot, tmp_path):
    program = programs.load(program_file(seconds, str(tmp_path)), robot.motion)
    once = programs.load('experiment1', robot.motion)
    period = program_planner.plan(once, once.start_m, robot).plan.duration_s
    planned = program_planner.plan(program, program.start_m, robot)
    assert planned.plan.duration_s == pytest.approx(seconds, abs=0.51 * period + 0.1)


@pytest.mark.long
def test_the_benchmark_of_motions_counts_rounds_and_gives_bounds_in_their_order(monkeypatch, capsys):
    for name, value in (
        ('ROUNDS', 1),
        ('PICKS', 2),
        ('PICK_ROUNDS', 1),
        ('PACKAGING', ('packaging', 'packaging_stops')),
    ):
        monkeypatch.setattr(motion, name, value)
    result = run(capsys, 'motion', '--no-graph')
    for name, rounds_a_minute in (('packaging', 150.9), ('packaging_stops', 133.0)):
        facts = result['packaging'][name]
        assert facts['per_minute'] == pytest.approx(rounds_a_minute, abs=0.5)
        assert facts['per_minute'] * facts['cycle_s'] == pytest.approx(60.0)
    bounds = result['packaging']['bounds']
    assert bounds['motors alone'] < bounds['free jerk'] < bounds['planned'] == pytest.approx(0.1688, abs=1e-3)
    assert result['errors']['circle_m'] < 1e-6
    assert result['errors']['cruise_speed'] < 1e-3
    every = result | {'packaging': result['packaging'] | {'packaging_fast': result['packaging']['packaging']}}
    assert '150.9 per minute' in '\n'.join(motion.text(every))


def test_the_speed_of_robots_together_is_the_sum_of_theirs():
    own = {
        'cycles': 10_000,
        'overruns': 5,
        'lateness_ms': times(0.25),
        'lost_telegrams': 3,
        'notes': ['note'],
    }
    fast = {
        'crowded': 'crowded',
        'robots': {f'/robot{n}': own | {'bus_time_s': 10.0, 'wall_time_s': 2.0 + n} for n in (0, 2)},
    }
    slow = {'crowded': '', 'robots': {'/': own | {'bus_time_s': 10.0, 'wall_time_s': 10.0}}}
    lines = robots.text(
        {'one': slow, 'fast': fast, 'several': {'robots': {}, 'crowded': '', 'error': 'too busy'}}
    )
    rows = [' '.join(line.split()) for line in lines]
    assert rows == [
        'one robot, real time',
        '/ 10000 cycles, 5 overruns (0.050%), cycle start late 0.25 / 1.25 / 2.25 / 3.25 ms, 3 lost AT',
        'note',
        '2 robots, as fast as possible',
        'crowded',
        '/robot0 10000 cycles, 5.00 x real time, 3 lost AT',
        'note',
        '/robot2 10000 cycles, 2.50 x real time, 3 lost AT',
        'note',
        'together 7.5 x real time',
        'several: too busy',
        'times as p50 / p99 / p99.9 / max',
    ]


def test_the_benchmark_of_shaping_counts_the_moves_by_their_reduction(monkeypatch):
    """Forty moves, of which the shaped ones swing less by 0.5, 1.5 ... 39.5 dB, and take 10 ms longer."""
    seen, shaped = [], iter(range(40))

    def swing(move, program, planned, one):
        seen.append(program.payload_kg)
        return 1e-3 if one.control.shaping == 'none' else 1e-3 * 10.0 ** (-(next(shaped) + 0.5) / 20.0)

    def plan(program, one):
        move = SimpleNamespace(duration_s=0.2 if one.control.shaping == 'none' else 0.21)
        return SimpleNamespace(plan=SimpleNamespace(move=lambda _: move))

    monkeypatch.setattr(shaping, 'swing_after', swing)
    monkeypatch.setattr(shaping.simulation, 'plan_of', plan)
    found = shaping.measure(40, ('none', 'zv'), ('built',))['robots']['built']
    assert found['none']['swing_median_m'] == found['none']['swing_max_m'] == 1e-3
    assert found['none']['less_median_db'] == found['none']['longer_s'] == 0.0
    one = found['zv']
    assert one['longer_s'] == pytest.approx(0.01)
    assert [one[key] for key in ('less_min_db', 'less_5_percent_db', 'less_median_db')] == pytest.approx(
        [0.5, 2.45, 20.0]
    )
    assert one['promised_share'] == 0.5
    assert one['swing_max_m'] == pytest.approx(1e-3 * 10.0 ** (-0.5 / 20.0))
    assert 0.0 <= min(seen) < 0.4 < 1.6 < max(seen) <= 2.0


@pytest.mark.long
def test_mujoco_moves_the_same_mechanism_to_the_same_place(capsys):
    pytest.importorskip('mujoco', reason='the second engine, MuJoCo, is not installed')
    result = run(capsys, 'simulate', '--seconds', '1')
    mechanism = result['mechanism']
    assert mechanism['motion_m'] > 5e-3
    # MuJoCo's step is of the first order, and its rods give way a little
    assert mechanism['tcp_apart_m'] < 3e-3 * mechanism['motion_m']
    assert result['tcp_difference_max_m'] < 5e-6


def times(start):
    """Four percentiles that are easy to recognise."""
    return {'p50': start, 'p99': start + 1.0, 'p99.9': start + 2.0, 'max': start + 3.0}


FIGURES = {
    'cycles': 20_000, 'overruns': 5, 'slip_s': 0.0125, 'lateness_ms': times(0.25), 'mdt_to_last_at_ms': times(10.5),
    'bus_time_s': 20.0, 'wall_time_s': 25.0, 'lost_telegrams': 3, 'refused_telegrams': 4,
    'outstanding': [50, 49, 0, 1], 'cores': {'plant': 0.25, 'mc4_drive_1': 0.5}, 'us_per_cycle': 750.0,
    'memory_mib': {'plant': 100.0, 'mc4_drive_1': 50.0},
}  # fmt: skip


def test_the_benchmark_of_the_graph_prints_its_columns_side_by_side(monkeypatch, capsys):
    def measure(action):
        case, column, seconds = action.args
        assert seconds == 7.0
        if case == 'machine':
            return {'lateness_ms': times(2.5)}
        return FIGURES | {'us_per_cycle': {'bare': 1000.0}.get(case, 750.0) * (1 + (column == 'ordinary'))}

    monkeypatch.setattr(graph, 'in_child', measure)
    monkeypatch.setattr(graph, 'real_time_is_permitted', lambda: True)
    assert bench.main(['graph', '--seconds', '7']) == 0
    printed = capsys.readouterr().out
    rows = [' '.join(line.split()) for line in printed.splitlines()]
    twice = [
        'real-time scheduling ordinary user (slices of 0.1 ms)',
        'cycles 20000, slip 12.5 ms 20000, slip 12.5 ms',
        'overruns 5 (0.025%) 5 (0.025%)',
        'cycle start late 0.25 / 1.25 / 2.25 / 3.25 ms 0.25 / 1.25 / 2.25 / 3.25 ms',
        'MDT to last AT 10.50 / 11.50 / 12.50 / 13.50 ms 10.50 / 11.50 / 12.50 / 13.50 ms',
        'bus / wall time 20.000 s / 25.000 s = 0.800 20.000 s / 25.000 s = 0.800',
        'telegrams 3 lost, 4 refused 3 lost, 4 refused',
        'outstanding 0 / 1 / 3 / 3 cycles 0 / 1 / 3 / 3 cycles',
        'processor 0.75 cores, 750 us per cycle 0.75 cores, 1500 us per cycle',
        'memory (PSS) 150 MiB 150 MiB',
        'cores plant 0.25, mc4_drive_1 0.50',
        'wakes up late 2.50 / 3.50 / 4.50 / 5.50 ms 2.50 / 3.50 / 4.50 / 5.50 ms',
        'robot / bare nodes, ordinary user (slices of 0.1 ms)',
        'processor us per cycle 1500.00 / 2000.00 = 0.75',
        'MDT to last AT p99 11.50 / 11.50 = 1.00',
    ]
    assert [row for row in twice if row not in rows] == []
    (fast,) = (n for n, row in enumerate(rows) if row == 'robot, one process, as fast as possible')
    assert rows[fast + 1] == 'cycles 20000, slip 12.5 ms'  # one column: nothing is scheduled in real time


@pytest.mark.parametrize(
    ('watched_s', 'told'),
    [
        (57.0, 'page 0.095 cores, 30.2 pictures a second in motion, 214 kB/s for 57 s'),
        (0.3, 'page watched for 0.3 s: too short to say what it takes'),
    ],
)
def test_benchmark_reports_the_load_of_a_page_watched_for_long(watched_s, told, monkeypatch, capsys):
    page = {
        'page_watched_s': watched_s, 'page_cores': 0.095, 'page_pictures_hz': 30.2, 'page_kb_s': 214.0
    }  # fmt: skip
    monkeypatch.setattr(graph, 'in_child', lambda _: FIGURES | page)
    assert bench.main(['graph', '--view', '--case', 'viewed', '--scheduling', 'ordinary']) == 0
    rows = [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert told in rows


@pytest.mark.parametrize(
    ('options', 'cases'),
    [
        (['--view'], ['separate', 'viewed']),
        (['--scope'], ['separate', 'scoped']),
        (['--view', '--scope'], ['separate', 'viewed', 'scoped']),
    ],
)
def test_load_of_a_viewer_is_measured_against_an_unwatched_robot(options, cases, monkeypatch, capsys):
    monkeypatch.setattr(graph, 'in_child', lambda action: {'case': action.args[0]})
    result = run(capsys, 'graph', '--scheduling', 'ordinary', *options)
    assert [case for case in result if case in graph.CASES] == cases
    assert [result[case]['ordinary']['case'] for case in cases] == cases


def test_real_time_is_not_measured_where_it_is_not_permitted(monkeypatch, capsys):
    monkeypatch.setattr(graph, 'real_time_is_permitted', lambda: False)
    assert bench.main(['graph', '--scheduling', 'real-time']) == 1
    assert 'real-time scheduling is not permitted here' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (
            ['kinematics', '--seconds', '3'],
            '--seconds is for graph, robots, motion, simulate, cell and network, not for kinematics',
        ),
        (['motion', '--case', 'bare'], '--case is for graph, not for motion'),
        (['simulate', '--scheduling', 'ordinary'], '--scheduling is for graph, not for simulate'),
        (['graph', '--no-graph'], '--no-graph is for motion, not for graph'),
        (['kinematics', '--view'], '--view is for graph, not for kinematics'),
        (['kinematics', '--scope'], '--scope is for graph, not for kinematics'),
        (['graph', '--seconds', '0.5'], '--seconds is 0.5, but must be between 1 and 3600'),
    ],
)
def test_an_option_of_another_benchmark_is_rejected_by_name(arguments, reason, capsys):
    with pytest.raises(SystemExit):
        bench.main(arguments)
    assert reason in capsys.readouterr().err


class Measured:
    """A process that takes 0.45 s of processor time between two looks, and 60 MiB of memory."""

    def __init__(self, pid):
        self.times = iter([(1.0, 0.5), (1.25, 0.7)])
        self.pid = pid

    def cpu_times(self):
        return SimpleNamespace(**dict(zip(('user', 'system'), next(self.times), strict=True)))

    def memory_full_info(self):
        return SimpleNamespace(pss=60 * 2**20)


class Robot:
    """A robot of two processes that is looked at in bus cycles 100 and 1900."""

    def __init__(self, options):
        self.options = options

    def processes(self):
        return [SimpleNamespace(name=name, pid=n) for n, name in enumerate(('plant', 'mc4_drive_1'))]

    def run(self, show):
        for cycles, finished in ((100, False), (1000, False), (1900, True)):
            show(MotionProgress(cycles=cycles, finished=finished))
        return {'cycles': 1900}


def test_processor_time_is_that_of_all_processes_over_the_cycles_between_two_looks(monkeypatch):
    monkeypatch.setattr(graph, 'in_child', lambda action: action())
    monkeypatch.setattr(graph, 'give_up_real_time', lambda: None)
    monkeypatch.setattr('psutil.Process', Measured)
    monkeypatch.setattr('delta3_pacdrive.bringup.bringup.Bringup', Robot)
    found = graph.measure(1.0, ['single'], ['ordinary'], True)['single']['ordinary']
    assert found['us_per_cycle'] == pytest.approx(1e6 * 2 * 0.45 / 1800)
    assert found['cores'].keys() == {'plant', 'mc4_drive_1'}
    assert found['cores']['plant'] == found['cores']['mc4_drive_1'] > 0.0
    assert found['memory_mib'] == {'plant': 60.0, 'mc4_drive_1': 60.0}


def test_process_without_real_time_priority_has_an_ordinary_user():
    def look():
        scheduling.give_up_real_time()
        scheduling.set_scheduling(scheduling.Schedule.REAL_TIME)
        return {'permitted': scheduling.real_time_is_permitted(), 'policy': os.sched_getscheduler(0)}

    assert in_child(look) == {'permitted': False, 'policy': os.SCHED_OTHER}


def test_system_error_of_a_case_is_a_message(capfd):
    def refused():
        raise OSError(28, 'No space left on device')

    with pytest.raises(RunError, match='No space left on device'):
        in_child(refused)
    assert 'Traceback' not in capfd.readouterr().err


def test_case_with_a_killed_benchmark_ends_without_output():
    code = (
        'import os, signal\n'
        'from delta3_pacdrive.benchmarks.case import in_child\n'
        'def orphan():\n'
        '    parent = os.getppid()\n'
        '    os.kill(parent, signal.SIGKILL)\n'
        '    while os.getppid() == parent:\n'
        '        pass\n'
        '    return {}\n'
        'in_child(orphan)\n'
    )
    # it waits until nobody, the case neither, has its standard error
    ended = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=300.0, check=False
    )
    assert ended.returncode == -signal.SIGKILL
    assert ended.stderr == ''


def test_the_benchmark_of_steering_prints_shares_lags_and_dead_ends():
    result = steering.measure(3)
    assert result['streams']['count'] == 3
    assert result['streams']['dead_ends'] == 0
    assert {row['rate_hz'] for row in result['lags']} == set(steering.RATES_HZ)
    assert max(result['streams']['shares'].values()) <= 1.001
    result |= {'step_s': 5.3e-6, 'standstill': [{'kind': 'velocity', 'rest_s': 0.2995, 'limit_s': 0.3}]}
    result['streams']['shares'] = {'speed': 0.99996, 'motors': 0.98}
    result['lags'] = [{'rate_hz': 20.0, 'lag_s': -0.007, 'deviation_max_m': 0.01509, 'jerk_max_m_s3': 600.0}]
    lines = list(steering.text(result))
    assert lines[1] == '  speed 100.00 %, motors 98.00 %'
    assert lines[4].split() == ['20', 'Hz', '-7', 'ms', '15.09', 'mm', '600', 'm/s3']
    assert lines[5] == 'standstill after the last set point at 1 m/s: velocity 300 ms'
    assert lines[6] == 'one step: 5.3 us'


def test_a_motion_beyond_a_limit_has_a_share_above_one():
    robot = parameters.load()
    limits = Limits(0.1, 1.0, 10.0)
    rows = np.zeros((10, 3, 3))
    rows[:, 0] = (0.0, 0.0, -0.8)
    rows[:, 1, 0] = 0.2
    shares = steering.Motion.of(rows, 1e-3).shares(robot, limits)
    assert shares['speed'] == pytest.approx(2.0)
    assert shares['jerk'] == 0.0
    rows[:, 0, 2] = robot.kinematics.workspace_bottom_m * 1.01
    assert steering.Motion.of(rows, 1e-3).shares(robot, limits)['workspace'] == pytest.approx(1.01)


def test_the_figure_of_steering_shows_the_tcp_on_its_curve():
    figure = steering.follow(parameters.load(), 50.0)
    place, speed, acceleration = figure.axes
    assert figure.get_suptitle() == 'A stream of 50 Hz with 20 ms jitter, 5 % lost'
    assert [axes.get_ylabel() for axes in figure.axes] == ['y [mm]', 'speed [m/s]', 'acceleration [m/s2]']
    assert acceleration.get_xlabel() == 'time [s]'
    lines = {line.get_label(): line for line in place.lines}
    assert set(lines) == {'set points at arrival', 'curve', 'TCP'}
    away = lines['TCP'].get_ydata() - lines['curve'].get_ydata()
    assert np.abs(away[500:]).max() < 3.0
    assert lines['curve'].get_ydata().max() == pytest.approx(100.0, abs=0.1)
    assert acceleration.lines[0].get_ydata().max() == pytest.approx(15.0, rel=1e-3)
    # 0.1 m at 0.7 revolutions per second
    assert speed.lines[0].get_ydata()[700] == pytest.approx(0.1 * 0.7 * 2.0 * np.pi, rel=0.1)
