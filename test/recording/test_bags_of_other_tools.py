"""Tests of bags of other tools: partial reading, with a message about missing and assumed parts."""

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
    JSON_SCHEMA,
    META,
    POINT,
    PROTOBUF_SCHEMA,
    RUN,
    STORE,
    TYPES,
    assert_holds,
    mcap,
    message,
    messages,
    numbers,
    record,
    refusal,
)
from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import simulation
from delta3_pacdrive.cli import compare, export, plot, report
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags import bag_trace
from delta3_pacdrive.recording.bags.bag_files import zstd
from delta3_pacdrive.recording.signals import SIGNALS
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS

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
        assert bag_trace.metadata(bag).get('cut', '') == ''

    def test_a_bag_without_custom_data_is_read_with_borrowed_constants(self, storage, mode, tmp_path, robot):
        bag = written(tmp_path / 'bag', messages(), storage, mode, meta=None)
        trace = trace_file.load(bag)
        assert trace['motor_position'].shape == (CYCLES, 3)
        assert trace.meta['gear_ratio'] == robot.dynamics.gear_ratio
        assert bag_trace.metadata(bag).get('cut', '') == BORROWED

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
        assert bag_trace.metadata(bag).get('cut', '') == ''
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
    assert bag_trace.metadata(bag).get('cut', '') == 'other.mcap left out, metadata.yaml does not list it'
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
    assert bag_trace.metadata(bag).get('cut', '') == ''


def test_a_bag_of_a_few_topics_holds_their_signals(tmp_path):
    few = {name: TYPES[name] for name in ('tcp/actual', 'tcp/command')}
    bag = record(tmp_path / 'bag', messages(topics=few), meta=None, types=few)
    assert set(trace_file.load(bag).signals) == {'tcp_actual', 'tcp_command'}


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'a.mcap.zstd'])
def test_invalid_file_is_rejected_with_one_message(name, tmp_path):
    (tmp_path / name).write_bytes(b'nothing of the kind' * 20)
    with pytest.raises(TraceError, match='it was cut off or is damaged') as caught:
        trace_file.load(tmp_path / name)
    assert '\n' not in str(caught.value)


# files without rosbag2 -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize('profile', ['', 'ros2'])
@pytest.mark.parametrize('compression', [None, '', 'zstd', 'lz4'])
def test_a_file_of_a_small_writer_is_read_with_each_compression_of_its_chunks(profile, compression, tmp_path):
    bag = mcap(tmp_path / 'a.mcap', messages(), profile=profile, compression=compression)
    trace = trace_file.load(bag)
    np.testing.assert_array_equal(trace['motor_command'], RUN['motor_command'])
    assert bag_trace.metadata(bag).get('cut', '') == BORROWED


@pytest.mark.parametrize('profile', ['', 'ros2'])
def test_an_unknown_compression_of_chunks_is_named(profile, tmp_path):
    assert "chunk compression 'brotli'" in refusal(
        mcap(tmp_path / 'a.mcap', messages(), profile=profile, compression='brotli')
    )


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_damaged_chunk_ends_the_reading_and_the_rest_is_reported(compression, tmp_path):
    whole = mcap(tmp_path / 'a.mcap', messages(), compression=compression)
    content = bytearray(whole.read_bytes())
    place = content.rindex(compression.encode()) + 30  # in the second of two chunks
    content[place : place + 40] = b'\xff' * 40
    whole.write_bytes(content)
    trace = trace_file.load(whole)
    np.testing.assert_array_equal(trace['motor_command'], RUN['motor_command'][:HALF])
    assert 'bytes at its end are not a complete message' in trace.meta['cut']


def test_topics_of_other_encodings_in_the_same_file_do_no_harm(tmp_path):
    others = [
        ('log', JSON_SCHEMA, 'json', b'{"message": "all is well"}'),
        ('gripper', PROTOBUF_SCHEMA, 'protobuf', b'\x0a\x02ok'),
        ('tcp/actual', JSON_SCHEMA, 'json', b'{"x": 0.1}'),  # the same topic a second time
    ]
    bag = mcap(tmp_path / 'a.mcap', messages(), others=others, compression='zstd')
    trace = trace_file.load(bag)
    np.testing.assert_array_equal(trace['tcp_actual'], RUN['tcp_actual'])
    assert 'refused' not in trace.meta
    assert "/tcp/actual is left out, as it is encoded as 'json', not as cdr" in trace.meta['cut']
    assert '/log' not in trace.meta['cut']


def test_robot_with_another_message_encoding_is_rejected_with_the_encoding(tmp_path):
    others = [('tcp/actual', JSON_SCHEMA, 'json', b'{}'), ('sercos/mdt', JSON_SCHEMA, 'ros1', b'{}')]
    sentence = refusal(mcap(tmp_path / 'a.mcap', [], types={}, others=others))
    assert "/tcp/actual is left out, as it is encoded as 'json', not as cdr" in sentence
    assert "/sercos/mdt is left out, as it is encoded as 'ros1'" in sentence


def test_short_names_of_types_are_those_of_ros(tmp_path):
    schemas = {topic: (kind.replace('/msg/', '/'), 'ros2msg', '') for topic, kind in TYPES.items()}
    trace = trace_file.load(mcap(tmp_path / 'a.mcap', messages(), types=schemas))
    assert list(trace.signals) == list(SIGNALS)


def test_a_topic_of_another_type_is_left_out_and_named(tmp_path):
    bag = record(tmp_path / 'bag', messages(), types=TYPES | {'tcp/error': POINT}, namespace='/cell2/')
    assert_holds(trace_file.load(bag), signals=[name for name in SIGNALS if name != 'tcp_error'])
    assert (
        '/cell2/tcp/error is left out, as it is of type geometry_msgs/msg/PointStamped, not geometry_msgs/msg/Vector3'
        in bag_trace.metadata(bag).get('cut', '')
    )


def topics_with(cycles_of, count=60):
    """Return the messages of a longer run, in which some topics lack bus cycles."""
    run = {name: np.random.default_rng(i).normal(size=(count, 3)) for i, name in enumerate(SIGNALS)}
    arrivals = [
        (topic, message(topic, CLOCK.stamp(k), numbers(topic, k, run)))
        for k in range(count)
        for topic in TYPES
        if k in cycles_of.get(topic, range(count))
    ]
    return run, arrivals


@pytest.mark.parametrize(
    ('kept', 'sentence'),
    [
        (range(0, 60, 10), 'tcp/actual is left out, it has messages of every 10 bus cycles only'),
        ([30], 'tcp/actual is left out, it has one message only'),
    ],
)
def test_a_topic_that_was_recorded_less_often_does_not_thin_out_the_others(kept, sentence, tmp_path):
    run, arrivals = topics_with({'tcp/actual': kept})
    trace = trace_file.load(record(tmp_path / 'bag', arrivals))
    assert 'tcp_actual' not in trace.signals
    np.testing.assert_array_equal(trace['motor_command'], run['motor_command'])
    assert trace.meta['notices'] == [sentence]


@pytest.mark.parametrize(
    ('kept', 'count', 'is_told'),
    [
        (range(60), 60, False),
        (range(16, 60), 44, False),  # a few bus cycles are under way where a recording begins and ends
        (range(17, 60), 43, True),
        (range(44), 44, False),
        (range(43), 43, True),
        ([*range(30), *range(31, 60)], 59, True),
    ],
)
def test_bus_cycles_that_one_topic_lacks_are_counted(kept, count, is_told, tmp_path):
    _, arrivals = topics_with({'tcp/actual': kept})
    trace = trace_file.load(record(tmp_path / 'bag', arrivals))
    assert len(trace.time_s) == count
    told = [f'{60 - count} of 60 bus cycles are left out, tcp/actual lacks most of them'] if is_told else None
    assert trace.meta.get('notices') == told


@pytest.fixture
def limit(monkeypatch):
    """Return the largest size [bytes] to which files of this test may unpack."""
    monkeypatch.setattr(whole_file, 'UNPACKED_BYTES_MAX', 1 << 20)
    return 1 << 20


@pytest.mark.parametrize('listed', [True, False])
def test_a_compressed_file_is_unpacked_up_to_the_limit_and_no_further(listed, limit, tmp_path):
    folder = tmp_path / 'bag'
    plain = record(folder, messages()) / 'bag.mcap'
    content = plain.read_bytes()
    plain.unlink()
    packed = folder / 'bag.mcap.zstd'
    if listed:
        changed(folder, relative_file_paths=[packed.name], compression_mode='FILE', compression_format='zstd')
    else:
        (folder / 'metadata.yaml').unlink()
    for size in (limit, limit + 1, 200 * limit):
        packed.write_bytes(zstd.compress(content + bytes(size - len(content))))
        assert packed.stat().st_size < limit / 10
        if size == limit:
            assert (
                len(trace_file.load(folder).time_s) == CYCLES
            )  # what follows its end is no damage of the messages
        else:
            assert 'MiB of memory, the limit is 1 MiB' in refusal(folder)


@pytest.mark.parametrize(('more', 'read'), [(0, True), (1, False), (1 << 26, False)])
def test_a_compressed_message_is_unpacked_up_to_the_limit_and_no_further(more, read, limit, tmp_path):
    bomb = zstd.compress(bytes(limit + more))
    arrivals = [(topic, zstd.compress(data)) for topic, data in messages()]
    bag = record(tmp_path / 'bag', [*arrivals, ('tcp/error', bomb)])
    if read:
        assert trace_file.load(bag).meta['refused'] == {'tcp/error': 1}
    else:
        assert 'bag.mcap cannot be unpacked: it would take 1 MiB' in refusal(bag)


def test_a_compressed_message_that_ends_too_early_is_damage(tmp_path):
    arrivals = [(topic, zstd.compress(data)) for topic, data in messages()]
    bag = record(tmp_path / 'bag', [*arrivals, ('tcp/error', arrivals[0][1][:-2])])
    assert 'a compressed message ends too early' in refusal(bag)


# commands -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def half(robot, tmp_path_factory):
    """A bag of experiment 1 without its metadata and without its second file."""
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
def test_every_command_reads_available_files_and_names_missing_ones(
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
