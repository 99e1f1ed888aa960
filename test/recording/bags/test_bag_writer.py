"""Tests of the bag writer: readable at every moment, and robust against a full disk."""

import ctypes
import errno
import json
import os
import signal
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.bags import bag_writer
from delta3_pacdrive.recording.bags.bag_recovery import CHUNK, MAGIC, recover
from delta3_pacdrive.recording.bags.bag_writer import OPEN_KEY, STOPPED_KEY, BagWriter

TEXT = 'std_msgs/msg/String'
MESSAGE = b'\0\1\0\0' + bytes(200)
TMPFS_BYTES = 1 << 20


def opened(folder, topics=('/a', '/b')):
    writer = BagWriter(folder, {'delta3_pacdrive': '{}'}, lambda why: {'delta3_pacdrive': json.dumps(why)})
    connections = [writer.add_topic(topic, TEXT, 10, latched) for latched, topic in enumerate(topics)]
    writer.begin()
    return writer, connections


def fill(writer, connections, count, first=0):
    for n in range(first, first + count):
        writer.write(connections[n % 2], 1000 + n, MESSAGE)


def held(folder):
    """Return the messages that the reader of rosbag2 finds, by topic, and the custom data."""
    with Reader(folder) as reader:
        counts = {connection.topic: 0 for connection in reader.connections}
        for connection, _, data in reader.messages():
            assert bytes(data) == MESSAGE
            counts[connection.topic] += 1
        assert counts == {connection.topic: connection.msgcount for connection in reader.connections}
        assert reader.message_count == sum(counts.values())
        # the file by itself, as its own statistics have it
        (file,) = reader.storage.storages
        assert {connection.topic: connection.msgcount for connection in file.connections} == counts
        assert file.metadata.message_count == reader.message_count
        assert (file.metadata.start_time, file.metadata.end_time) == (reader.start_time, reader.end_time)
        return counts, dict(reader.storage.metadata.custom)


def left(folder):
    """Return how many messages are left in the file, index or not."""
    return sum(channel.msgcount for channel in recover(folder / f'{folder.name}.mcap').channels.values())


def test_a_bag_is_complete_when_it_is_closed(tmp_path):
    writer, topics = opened(tmp_path / 'bag')
    fill(writer, topics, 9001)  # more than one chunk of 1 MiB
    writer.close({'delta3_pacdrive': '{"lost": {}}'})
    assert held(tmp_path / 'bag') == ({'/a': 4501, '/b': 4500}, {'delta3_pacdrive': '{"lost": {}}'})


def test_bag_records_the_offered_qos_of_its_topics(tmp_path):
    writer, _ = opened(tmp_path / 'bag')
    writer.add_topic('/c', TEXT, 77, False)
    writer.close({})
    with Reader(tmp_path / 'bag') as reader:
        offered = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert {topic: qos.depth for topic, qos in offered.items()} == {'/a': 10, '/b': 10, '/c': 77}
    latched = [topic for topic, qos in offered.items() if qos.durability == QosDurability.TRANSIENT_LOCAL]
    assert latched == ['/b']


def recovered(file):
    """Return the number of messages left in a file, and the further known properties."""
    found = recover(file)
    return sum(channel.msgcount for channel in found.channels.values()), found.ended, found.lost_bytes


def test_a_whole_file_is_recovered_whole_and_a_chunk_with_another_checksum_not_at_all(tmp_path):
    writer, topics = opened(tmp_path / 'bag')
    fill(writer, topics, 10)
    writer.close({})
    file = tmp_path / 'bag' / 'bag.mcap'
    assert recovered(file) == (10, True, 0)
    content = bytearray(file.read_bytes())
    # the chunk that holds the messages: code, size, two times, size of its records, checksum, compression, size
    place, message = len(MAGIC), content.index(MESSAGE)
    while content[place] != CHUNK or message > place + 9 + struct.unpack_from('<Q', content, place + 1)[0]:
        place += 9 + struct.unpack_from('<Q', content, place + 1)[0]
    (size,) = struct.unpack_from('<Q', content, place + 25)
    records = content[place + 49 : place + 49 + size]
    struct.pack_into('<I', content, place + 33, zlib.crc32(records))  # other writers give one
    file.write_bytes(content)
    assert recovered(file) == (10, True, 0)
    content[message + 50] ^= 1
    file.write_bytes(content)
    messages, ended, lost = recovered(file)
    assert (messages, ended) == (0, False)
    assert lost > 10 * len(MESSAGE)


def test_metadata_and_topics_are_on_the_disk_from_the_beginning(tmp_path):
    opened(tmp_path / 'bag')
    text = (tmp_path / 'bag' / 'metadata.yaml').read_text()
    assert 'name: /b' in text
    assert OPEN_KEY in text
    assert [c.topic for c in recover(tmp_path / 'bag' / 'bag.mcap').channels.values()] == ['/a', '/b']


def test_flushed_messages_are_on_the_disk_in_one_chunk(tmp_path):
    writer, topics = opened(tmp_path / 'bag')
    fill(writer, topics, 10)
    assert left(tmp_path / 'bag') == 0
    writer.flush()
    assert left(tmp_path / 'bag') == writer.messages == 10
    size = (tmp_path / 'bag' / 'bag.mcap').stat().st_size
    writer.flush()  # nothing new: no empty chunks
    assert (tmp_path / 'bag' / 'bag.mcap').stat().st_size == size
    assert bag_writer.FLUSH_S <= 1.0


def test_killed_writer_leaves_the_flushed_messages(tmp_path):
    code = (
        'import sys, os, signal; from pathlib import Path\n'
        'from delta3_pacdrive.recording.bags.bag_writer import BagWriter\n'
        f'w = BagWriter(Path(sys.argv[1]), {{}}); t = w.add_topic("/a", {TEXT!r}, 10, False); w.begin()\n'
        'for n in range(500): w.write(t, n, bytes(204))\n'
        'w.flush(); w.write(t, 500, bytes(204)); os.kill(os.getpid(), signal.SIGKILL)\n'
    )
    done = subprocess.run([sys.executable, '-c', code, str(tmp_path / 'bag')], check=False)
    assert done.returncode == -signal.SIGKILL
    assert left(tmp_path / 'bag') == 500


class Disk:
    """A disk with so much room [bytes] for the file of a bag."""

    def __init__(self, room):
        self.room = room

    def pwrite(self, file, data, place):
        if place >= self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.pwrite(file, bytes(data)[: self.room - place], place)


@pytest.fixture
def disk(monkeypatch):
    """Return a disk of adjustable size."""
    own = Disk(1 << 40)

    class Patched:
        """The module os with that disk."""

        pwrite = staticmethod(own.pwrite)

        def __getattr__(self, name):
            return getattr(os, name)

    monkeypatch.setattr(bag_writer, 'os', Patched())
    return own


@pytest.mark.parametrize('room', [60_000, 100_000, 300_000, 1_300_000, 3_000_000])
def test_a_full_disk_stops_the_writing_and_leaves_a_whole_bag(room, disk, tmp_path):
    writer, topics = opened(tmp_path / 'bag')
    disk.room = room
    for n in range(100):
        fill(writer, topics, 200, 200 * n)
        writer.flush()
    assert writer.stopped == 'no space left on device'
    counts, custom = held(tmp_path / 'bag')
    assert sum(counts.values()) == writer.messages
    # what the index needs is given up besides, in whole chunks of 50 kB
    assert (tmp_path / 'bag' / 'bag.mcap').stat().st_size > room - 3 * 60_000
    assert custom[STOPPED_KEY] == json.loads(custom['delta3_pacdrive']) == writer.stopped
    assert OPEN_KEY not in custom
    disk.room = 1 << 40
    fill(writer, topics, 10)  # it stays stopped: the bag is closed
    writer.close({'delta3_pacdrive': '{"lost": {}}'})
    again, custom = held(tmp_path / 'bag')
    assert again == counts
    assert json.loads(custom['delta3_pacdrive']) == {'lost': {}}


def test_a_disk_that_is_full_at_the_end_costs_the_last_chunks_at_most(disk, tmp_path):
    writer, topics = opened(tmp_path / 'bag')
    for n in range(10):
        fill(writer, topics, 200, 200 * n)
        writer.flush()
    disk.room = (tmp_path / 'bag' / 'bag.mcap').stat().st_size + 10  # no room for the index
    writer.close({})
    assert writer.stopped == 'no space left on device'
    assert sum(held(tmp_path / 'bag')[0].values()) == 1800


def test_a_bag_that_cannot_begin_is_rejected_with_the_reason(disk, tmp_path):
    writer = BagWriter(tmp_path / 'bag', {})
    writer.add_topic('/a', TEXT, 10, False)
    path = tmp_path / 'bag' / 'bag.mcap'
    before = path.read_bytes()
    disk.room = len(before) + 10
    with pytest.raises(RunError, match='no space left on device'):
        writer.begin()
    assert path.read_bytes() == before  # no half of a chunk
    with pytest.raises(RunError, match='exists already'):
        BagWriter(tmp_path / 'bag', {})


@pytest.fixture
def small_disk(tmp_path):
    """Return a real file system of 1 MiB."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mount(b'tmpfs', bytes(folder), b'tmpfs', 0, f'size={TMPFS_BYTES}'.encode()):
        pytest.skip(f'mounting a small disk is not permitted: {os.strerror(ctypes.get_errno())}')
    yield Path(folder)
    libc.umount2(bytes(folder), 2)


def test_a_real_disk_that_is_full_leaves_a_whole_bag(small_disk):
    writer, topics = opened(small_disk / 'bag')
    (small_disk / 'other').write_bytes(bytes(300_000))
    for n in range(100):
        fill(writer, topics, 200, 200 * n)
        writer.flush()
    assert writer.stopped == 'no space left on device'
    counts, custom = held(small_disk / 'bag')
    assert sum(counts.values()) > 2000
    assert custom[STOPPED_KEY] == writer.stopped
