"""Tests of recorded set points: CSV files and bags, and scripts that play them."""

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from delta3_pacdrive import scripting
from delta3_pacdrive.control.cycle.set_points import SetPointKind
from delta3_pacdrive.errors import ProgramError, ScriptError
from delta3_pacdrive.recording.bag_messages import typestore
from delta3_pacdrive.scripting.steering import TOPICS, RecordedSetPoint, read

VELOCITIES = 'time_s,vx_m_s,vy_m_s,vz_m_s\n'
POSITIONS = 'time_s,x_m,y_m,z_m\n'
DAY_S = 1_780_000_000  # a time of day


def write_bag(path: Path, messages: list[tuple[str, float, tuple[float, float, float], str]]) -> None:
    """Write a bag of set points: topic, time [s], values and frame."""
    types = typestore()
    named = {name.rpartition('/')[2]: types.types[name] for name in types.types}
    stamped, stamp, vector = named['Header'], named['Time'], named['Vector3']
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(
                topic, next(TOPICS[name][1] for name in TOPICS if topic.endswith(name)), typestore=types
            )
            for topic in {topic for topic, *_ in messages}
        }
        for topic, time_s, (x, y, z), frame in messages:
            ns = round(time_s * 1e9)
            header = stamped(stamp(ns // 10**9, ns % 10**9), frame)
            if topic.endswith('twist'):
                message = named['TwistStamped'](
                    header, named['Twist'](vector(x, y, z), vector(0.0, 0.0, 0.0))
                )
            else:
                turn = named['Quaternion'](0.0, 0.0, 0.0, 1.0)
                message = named['PoseStamped'](header, named['Pose'](named['Point'](x, y, z), turn))
            kind = connections[topic].msgtype
            writer.write(connections[topic], ns, types.serialize_cdr(message, kind))


def test_times_of_a_csv_file_count_from_its_first_row(tmp_path: Path) -> None:
    file = tmp_path / 'stream.csv'
    file.write_text(f'{VELOCITIES}7.5,0.1,0,-0.1\n\n7.52,0.2,0,0\n')
    assert read(file) == [
        RecordedSetPoint(0.0, SetPointKind.VELOCITY, (0.1, 0.0, -0.1)),
        RecordedSetPoint(pytest.approx(0.02), SetPointKind.VELOCITY, (0.2, 0.0, 0.0)),
    ]
    file.write_text(f'\ufeff{POSITIONS}0,0.1,0,-0.8\n', encoding='utf-8')
    assert read(file)[0].kind is SetPointKind.POSITION


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', "line 1: the heading is ''"),
        ('time_s,x_mm,y_mm,z_mm\n0,1,2,3\n', 'but must be time_s,vx_m_s'),
        (f'{POSITIONS}0,1,2\n', r"line 2: '0,1,2' is not a row of 4 finite numbers"),
        (f'{POSITIONS}0,1,2,nan\n', 'line 2'),
        (f'{POSITIONS}0,1,2,3\n0,1,2,3\n', 'line 3: time_s is 0, which is not after that of the row before'),
        (POSITIONS, 'has no set points'),
    ],
)
def test_other_files_are_rejected_with_their_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / 'stream.csv'
    file.write_text(text)
    with pytest.raises(ProgramError, match=words):
        read(file)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r'none\.csv cannot be read: No such file'):
        read(tmp_path / 'none.csv')
    with pytest.raises(ProgramError, match='cannot be read'):
        read(tmp_path)
    (tmp_path / 'bytes.csv').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(ProgramError, match='cannot be read'):
        read(tmp_path / 'bytes.csv')


def test_a_bag_gives_the_set_points_of_its_robot_by_stamp(tmp_path: Path) -> None:
    messages = [
        ('/cell/servo/twist', DAY_S + 0.02, (0.2, 0.0, 0.0), 'line'),
        ('/cell/servo/twist', DAY_S + 0.0, (0.1, 0.0, 0.0), 'base'),
        ('/cell/servo/pose', DAY_S + 0.04, (0.0, 0.1, -0.8), 'base'),
    ]
    write_bag(tmp_path / 'bag', messages)
    first, second, third = read(tmp_path / 'bag')
    assert (first.values, first.belt) == ((0.1, 0.0, 0.0), '')
    assert (second.time_s, second.belt) == (0.02, 'line')
    assert (third.time_s, third.kind) == (0.04, SetPointKind.POSITION)
    write_bag(tmp_path / 'two', [*messages, ('/other/servo/pose', DAY_S, (0.0, 0.0, 0.0), '')])
    with pytest.raises(ProgramError, match='several robots: /cell/servo/pose, /cell/servo/twist, /other'):
        read(tmp_path / 'two')


def test_a_played_file_moves_the_tcp_along_its_curve(robot, tmp_path: Path) -> None:
    """Rows with jitter: what counts is their time."""
    generator = np.random.default_rng(4)
    times = np.cumsum(generator.uniform(0.01, 0.03, 120))
    x, y, z = robot.motion.home_m

    def curve(time_s: float) -> tuple[float, float]:
        return x + 0.05 * (1.0 - math.cos(2.0 * time_s)), y + 0.05 * math.sin(2.0 * time_s) ** 2

    rows = [f'{time},{",".join(map(repr, curve(time - times[0])))},{z}' for time in times.tolist()]
    file = tmp_path / 'stream.csv'
    file.write_text(POSITIONS + '\n'.join(rows))
    with scripting.simulate(robot) as called, called.servo() as steering:
        called.wait_time(0.05)
        steering.play(file)
    tcp = called.trace['tcp_command']
    duration = times[-1] - times[0]
    begin = next(n for n in range(len(tcp)) if np.linalg.norm(tcp[n, :2] - [x, y]) > 1e-3)
    away = [
        min(
            np.linalg.norm(tcp[begin + round(1e3 * (time - 0.1)) + lag, :2] - curve(time))
            for lag in range(-150, 150)
        )
        for time in np.arange(0.5, duration - 0.1, 0.05)
    ]
    assert max(away) < 2e-4


def test_a_row_that_jumps_ends_the_script_at_its_line(robot, tmp_path: Path) -> None:
    file = tmp_path / 'stream.csv'
    file.write_text(f'{POSITIONS}0,0,0,-0.75\n0.02,0.3,0,-0.75\n')
    with (
        pytest.raises(ScriptError, match='a position is 300 mm from where the stream leads'),
        scripting.simulate(robot) as called,
        called.servo() as steering,
    ):
        steering.play(file)
