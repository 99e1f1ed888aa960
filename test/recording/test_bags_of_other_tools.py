"""Facts about bags of other tools: whatever is there is read, and a sentence names missing and assumed parts."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from bags import (
    CLOCK,
    CYCLES,
    META,
    STORE,
    TYPES,
    assert_holds,
    message,
    messages,
    numbers,
    record,
)
from delta3_pacdrive import simulation
from delta3_pacdrive.cli import compare, export, plot, report
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.recording import bag_trace, trace_file
from delta3_pacdrive.recording.signals import SIGNALS
from delta3_pacdrive.sercos.bus_time import NANOSECONDS

MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3
HALF = CYCLES // 2
BORROWED = 'its metadata is missing, gear ratio and torque constant are those of the packaged parameters'


def written(folder, arrivals, storage=MCAP, mode=None, meta=META):
    """Write a bag with a compression."""
    writer = Writer(folder, version=9, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {
            topic: writer.add_connection(f'/{topic}', kind, typestore=STORE) for topic, kind in TYPES.items()
        }
        for i, (topic, data) in enumerate(arrivals):
            writer.write(topics[topic], 1_700_000_000 * NANOSECONDS + i, data)
        if meta is not None:
            writer.set_custom_data('delta3_pacdrive', json.dumps(meta))
    return folder


def changed(bag, **values):
    """Change keys of the metadata of a bag."""
    document = yaml.safe_load((bag / 'metadata.yaml').read_text())
    document['rosbag2_bagfile_information'] |= values
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(document))
    return bag


def split(tmp_path, storage=MCAP, mode=None, meta=META, cut=HALF):
    """Write a bag as rosbag2 splits it: in two files."""
    parts = [
        written(tmp_path / name, messages(cycles), storage, mode, meta)
        for name, cycles in (('split', range(cut)), ('second', range(cut, CYCLES)))
    ]
    (name,) = [file for file in parts[1].iterdir() if file.suffix != '.yaml']
    shutil.move(name, parts[0])
    (own,) = [file for file in parts[0].iterdir() if file.name.startswith('split')]
    total = CYCLES * len(TYPES)
    return changed(parts[0], relative_file_paths=[own.name, name.name], message_count=total)


@pytest.mark.parametrize(
    ('storage', 'mode'),
    [
        (MCAP, None),
        (SQLITE, None),
        (MCAP, CompressionMode.STORAGE),
        *(
            (storage, mode)
            for storage in (MCAP, SQLITE)
            for mode in (CompressionMode.FILE, CompressionMode.MESSAGE)
        ),
    ],
)
class TestEveryWriter:
    """Every storage with every compression."""

    def test_a_whole_bag_is_read_without_a_note(self, storage, mode, tmp_path):
        bag = written(tmp_path / 'bag', messages(), storage, mode)
        assert_holds(trace_file.load(bag))
        assert bag_trace.cut(bag) == ''

    def test_a_bag_without_custom_data_is_read_with_borrowed_constants(self, storage, mode, tmp_path, robot):
        bag = written(tmp_path / 'bag', messages(), storage, mode, meta=None)
        trace = trace_file.load(bag)
        assert trace['motor_position'].shape == (CYCLES, 3)
        assert trace.meta['gear_ratio'] == robot.dynamics.gear_ratio
        assert bag_trace.cut(bag) == BORROWED

    def test_a_bag_without_metadata_or_identifier_is_read(self, storage, mode, tmp_path):
        bag = changed(written(tmp_path / 'bag', messages(), storage, mode), storage_identifier='')
        assert_holds(trace_file.load(bag))
        (bag / 'metadata.yaml').unlink()
        assert trace_file.load(bag)['motor_position'].shape == (CYCLES, 3)

    def test_a_file_alone_is_read(self, storage, mode, tmp_path):
        bag = written(tmp_path / 'bag', messages(), storage, mode)
        (file,) = [file for file in bag.iterdir() if file.suffix != '.yaml']
        alone = trace_file.load(shutil.move(file, tmp_path))
        assert alone['motor_command'].tolist() == trace_of(messages(), tmp_path)['motor_command'].tolist()

    def test_a_split_bag_is_read_and_a_missing_file_is_named(self, storage, mode, tmp_path):
        bag = split(tmp_path, storage, mode)
        assert_holds(trace_file.load(bag))
        assert bag_trace.cut(bag) == ''
        first, second = sorted(
            (file for file in bag.iterdir() if file.suffix != '.yaml'), key=lambda f: f.name[1] != 'p'
        )
        count = HALF * len(TYPES)
        kept = second.read_bytes()
        second.unlink()
        trace = trace_file.load(bag)
        assert_holds(trace, range(HALF))
        assert f'{count} of {2 * count} messages are missing' in trace.meta['cut']
        assert f'{second.name} of its 2 files missing' in trace.meta['cut']
        second.write_bytes(kept)
        first.unlink()
        trace = trace_file.load(bag)
        assert_holds(trace, range(HALF, CYCLES))
        assert f'; it begins at bus time {HALF * 1e-3:.3f} s; it ends' in trace.meta['cut']


def trace_of(arrivals, tmp_path):
    return trace_file.load(record(tmp_path / 'reference', arrivals))


def test_files_below_a_folder_and_files_that_are_not_listed(tmp_path):
    bag = record(tmp_path / 'bag', messages(range(HALF)))
    (bag / 'sub').mkdir()
    shutil.move(bag / 'bag.mcap', bag / 'sub')
    changed(bag, relative_file_paths=['sub/bag.mcap'])
    assert_holds(trace_file.load(bag), range(HALF))
    other = record(tmp_path / 'other', messages(range(HALF, CYCLES)))
    shutil.move(other / 'other.mcap', bag)
    assert_holds(trace_file.load(bag), range(HALF))
    assert bag_trace.cut(bag) == 'other.mcap left out, metadata.yaml does not list it'
    (bag / 'metadata.yaml').unlink()
    assert_holds(trace_file.load(bag))  # without a list everything is read


def test_a_damaged_file_of_a_split_bag_does_not_hide_the_other(tmp_path):
    bag = split(tmp_path)
    (bag / 'second.mcap').write_bytes(b'\0' * 500)
    trace = trace_file.load(bag)
    assert_holds(trace, range(HALF))
    assert 'second.mcap cannot be read' in trace.meta['cut']


def test_a_writer_without_the_profile_of_ros_is_read(tmp_path):
    bag = record(tmp_path / 'bag', messages())
    content = (bag / 'bag.mcap').read_bytes()
    assert content[21:25] == b'ros2'
    (bag / 'bag.mcap').write_bytes(content[:21] + b'none' + content[25:])
    assert_holds(trace_file.load(bag))
    assert bag_trace.cut(bag) == ''


def test_a_bag_of_a_few_topics_holds_their_signals(tmp_path):
    few = {name: TYPES[name] for name in ('tcp/actual', 'tcp/command')}
    bag = record(tmp_path / 'bag', messages(topics=few), meta=None, types=few)
    assert set(trace_file.load(bag).signals) == {'tcp_actual', 'tcp_command'}


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'a.mcap.zstd'])
def test_a_file_that_is_none_gets_one_sentence(name, tmp_path):
    (tmp_path / name).write_bytes(b'nothing of the kind' * 20)
    with pytest.raises(TraceError, match='it was cut off or is damaged') as caught:
        trace_file.load(tmp_path / name)
    assert '\n' not in str(caught.value)


# commands -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def half(robot, tmp_path_factory):
    """A bag of experiment 1 without the metadata of its recorder, whose second file is missing."""
    run = simulation.run(programs.load('experiment1', robot.motion), robot)
    constant = robot.motor.torque_constant_n_m_a
    cycles = range(len(run.time_s) // 2)
    signals = {name: run[name] for name in SIGNALS}
    arrivals = [
        (topic, message(topic, CLOCK.stamp(k), numbers(topic, k, signals, constant)))
        for k in cycles
        for topic in TYPES
    ]
    bag = record(tmp_path_factory.mktemp('half') / 'bag', arrivals, meta=None)
    changed(bag, relative_file_paths=['bag.mcap', 'bag_1.mcap'], message_count=2 * len(arrivals))
    return SimpleNamespace(bag=bag, run=run, cycles=len(cycles))


@pytest.mark.parametrize('single', [False, True])
@pytest.mark.parametrize(
    ('command', 'arguments'),
    [
        (plot, ['--signals', 'current', '--output', 'FOLDER']),
        (export, ['--output', 'FOLDER/a.npz']),
        (compare, ['experiment1', '--align', 'correlation']),
        (report, ['--output', 'FOLDER/a.html']),
    ],
)
def test_every_command_reads_what_is_there_and_names_what_is_missing(
    command, arguments, single, half, tmp_path, capsys
):
    path = str(half.bag / 'bag.mcap' if single else half.bag)
    words = [text.replace('FOLDER', str(tmp_path)) for text in arguments]
    words = ['trace', path, *words] if command is export else [path, *words]
    assert command.main([*words, '--json']) == 0
    text = capsys.readouterr().out
    document = json.dumps(json.loads(text)) + ''.join(file.read_text() for file in tmp_path.glob('a.html'))
    assert BORROWED in document
    assert ('bag_1.mcap of its 2 files missing' in document) is not single


def test_an_export_of_half_a_bag_holds_its_half(half, tmp_path):
    assert export.main(['trace', str(half.bag), '--output', str(tmp_path / 'a.npz')]) == 0
    found = trace_file.load(tmp_path / 'a.npz')
    assert len(found.time_s) == half.cycles
    np.testing.assert_allclose(found['current'], half.run['current'][: half.cycles], rtol=1e-12, atol=1e-15)
