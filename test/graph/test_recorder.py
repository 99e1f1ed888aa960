"""Facts about the recorder by itself, without a robot: what it lacks, and what it does when the disk is full."""

import ctypes
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3Stamped
from rosbags.rosbag2 import Reader
from std_msgs.msg import Header, String

from delta3_pacdrive import parameters
from delta3_pacdrive.bag_recovery import recover
from delta3_pacdrive.nodes.qos import CYCLIC_PUBLISHER, LATCHED
from delta3_pacdrive.nodes.recorder import RecorderNode

TMPFS_BYTES = 600_000
AT_ONCE = 50  # messages, fewer than the queues hold
FRAME = 'x' * 200


class Studio:
    """A recorder, and somebody who publishes the virtual master of a robot."""

    def __init__(self, graph: Any, bag: Path) -> None:
        flat = parameters.flatten(parameters.load())
        lists = {key: list(value) if isinstance(value, tuple) else value for key, value in flat.items()}
        self._graph = graph
        self.recorder = graph.add(RecorderNode, bag=str(bag), **lists)
        self._master = graph.listener.create_publisher(Vector3Stamped, 'motion/master', CYCLIC_PUBLISHER)
        self.phase = graph.listener.create_publisher(Header, 'sercos/phase', LATCHED)
        self.states: list[String] = graph.listen(String, 'recorder/state', LATCHED)
        graph.spin_until(self._master.get_subscription_count, 'recorder')

    def say(self, cycle: int) -> None:
        """Publish the master of a cycle."""
        seconds, rest = divmod(cycle, 1000)
        header = Header(stamp=Time(sec=seconds, nanosec=rest * 1_000_000), frame_id=FRAME)
        self._master.publish(Vector3Stamped(header=header))

    def counts(self) -> tuple[int, int]:
        """Return the messages of the master, and those that are missing."""
        found: tuple[int, int] = self.recorder.completeness()['motion/master']
        return found

    def close(self) -> None:
        """End the recorder."""
        self._graph.remove(self.recorder)


def closed_bag(bag: Path) -> tuple[int, dict[str, Any]]:
    """Return how many messages a bag holds, and what the recorder says of it."""
    with Reader(bag) as reader:
        assert reader.message_count == len(list(reader.messages()))
        return reader.message_count, json.loads(reader.storage.metadata.custom['delta3_pacdrive'])


def test_who_joins_a_robot_that_is_up_counts_from_the_first_message_on(graph: Any, tmp_path: Path) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    studio.phase.publish(Header(frame_id='CP4 3fa9'))
    for cycle in (6_930_170, 6_930_171, 6_930_174):
        studio.say(cycle)
    graph.spin_until(lambda: studio.counts()[0] == 3, 'three messages')
    assert studio.counts() == (3, 2)
    studio.close()
    messages, meta = closed_bag(tmp_path / 'bag')
    assert (messages, meta['lost']) == (4, {'motion/master': 2})
    assert 'start_cycle' not in meta  # it knows of no program


def test_what_was_recorded_reaches_the_file_of_a_bag_that_stays_open(graph: Any, tmp_path: Path) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    studio.say(0)
    graph.spin_until(lambda: studio.counts()[0] == 1, 'a message')

    def left() -> int:
        return sum(channel.msgcount for channel in recover(tmp_path / 'bag' / 'bag.mcap').channels.values())

    graph.spin_until(left, 'the message in the file')  # every FLUSH_S, which is less than a second


def test_a_full_disk_ends_the_recording_and_not_the_recorder(graph: Any, small_disk: Path) -> None:
    studio = Studio(graph, small_disk / 'bag')
    cycles = iter(range(100_000))

    def stopped() -> bool:
        for _ in range(AT_ONCE):
            studio.say(next(cycles))
        return bool(studio.states)

    graph.spin_until(stopped, 'a full disk')
    assert [state.data for state in studio.states] == ['stopped: no space left on device']
    before = studio.counts()
    stopped()
    graph.spin_for(0.2)
    assert studio.counts() == before  # it lives, and records nothing any more
    studio.close()
    messages, meta = closed_bag(small_disk / 'bag')
    assert messages > 100
    assert meta['stopped'] == 'no space left on device'
    assert not meta['lost']


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Return a file system of its own that is soon full."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mount(b'tmpfs', bytes(folder), b'tmpfs', 0, f'size={TMPFS_BYTES}'.encode()):
        pytest.skip(f'mounting a small disk is not permitted: {os.strerror(ctypes.get_errno())}')
    yield folder
    libc.umount2(bytes(folder), 2)
