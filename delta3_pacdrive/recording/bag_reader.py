"""Bags: the topics and the metadata of a folder of rosbag2, whole or cut off, before its messages are read."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from delta3_pacdrive.errors import Delta3Error, TraceError, shown
from delta3_pacdrive.parameters import CYCLE_TIMES_S
from delta3_pacdrive.parameters import load as load_parameters
from delta3_pacdrive.recording.bag_files import damaged, files_of, opened
from delta3_pacdrive.recording.bag_recovery import CDR
from delta3_pacdrive.recording.bag_writer import METADATA_KEY, OPEN_KEY, STOPPED_KEY
from delta3_pacdrive.recording.carried import CARRIED
from delta3_pacdrive.recording.sessions import Sessions
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.telegrams import JOINT_STATE, motor_current

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from rosbags.typesys.store import Typestore

    from delta3_pacdrive.recording.bag_files import Store
    from delta3_pacdrive.recording.bag_recovery import Channel

    Take = Callable[[bytes], None]

TYPES = {telegram.topic: telegram.type for telegram in CARRIED}
TEXT, NUMBERS = 'std_msgs/msg/String', 'std_msgs/msg/Float64MultiArray'
# what a message of a foreign writer may lead to
SPOILT = (
    Delta3Error,
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)
PROFILE, PHASE = 'motion/course', 'sercos/phase'
PROFILE_OF_START = 9  # numbers of a motion profile with a single phase
PROFILE_ROW = 6  # numbers that tell a start of a program from a change of its motion profile


@dataclass(frozen=True)
class Bag:
    """The bag is known to be one of a robot.

    Attributes
    ----------
    names
        Relative names of its cyclic topics, by topic.
    currents
        Topics that hold the samples of the current loops of the drives, in their order; empty if one of them has none.
    robot
        What stands before the names.
    meta
        Checked metadata of the recorder.
    read
        Calls functions with the data of the messages of topics.

    """

    names: dict[str, str]
    currents: tuple[str, ...]
    robot: str
    meta: dict[str, Any]
    read: Callable[[Mapping[str, Take]], None]


def open_bag(path: Path) -> Bag:
    """Look at the topics and the metadata of a bag: a folder or a single file, whole or in parts.

    Whatever is there is read; ``meta['cut']`` names files, messages and metadata that are missing.

    Raises
    ------
    TraceError
        There is no such bag, or nothing in it can be read.

    """
    information = _information((_text_of(path / 'metadata.yaml'),)) if path.is_dir() else {}
    files, notes = files_of(path, information)
    stores = [opened(file) for file in files]
    left = [store for store in stores if store.channels]
    notes += [
        f'{store.path.name} cannot be read ({store.damage})' for store in stores if store not in left and left
    ]
    if not left:
        raise damaged(next((store.damage for store in stores if store.damage), 'it is empty'))
    information = information or _information(store.metadata for store in left)
    custom = information.get('custom_data')
    if isinstance(custom, dict) and METADATA_KEY in custom:
        meta = _metadata(custom)
        if STOPPED_KEY in custom:
            notes.append(f'the recorder stopped writing: {custom[STOPPED_KEY]}')
    else:
        robot = load_parameters()
        meta = {
            'gear_ratio': robot.dynamics.gear_ratio,
            'torque_constant_n_m_a': robot.motor.torque_constant_n_m_a,
        }
        notes.append(
            'its metadata is missing, gear ratio and torque constant are those of the packaged parameters'
        )
    channels = [channel for store in left for channel in store.channels]
    names, left_out = _cyclic_topics(channels)
    notes += left_out
    missing = _missing(information, sum(channel.msgcount for channel in channels), left)
    if notes or missing:
        meta['cut'] = '; '.join(filter(None, [missing, *notes]))

    def read(add: Mapping[str, Take]) -> None:
        for store in left:
            store.read(add)

    topic, name = next(iter(names.items()))
    namespace = topic.removesuffix(name)
    held = {one.topic for one in channels if one.msgcount and not _foreign(one, JOINT_STATE)}
    currents = tuple(namespace + motor_current(axis, 0).topic for axis in DRIVES)
    return Bag(names, currents if held.issuperset(currents) else (), namespace, meta, read)


def _missing(information: Mapping[str, Any], counted: int, stores: Sequence[Store]) -> str:
    """Name the messages that a bag lacks of which ``counted`` are left; '' if that is its index only."""
    total, custom = information.get('message_count'), information.get('custom_data')
    left = [store.recovered for store in stores if store.recovered is not None]
    is_open = isinstance(custom, dict) and OPEN_KEY in custom
    if isinstance(total, int) and total >= counted and not is_open:
        return f'it was cut off: {total - counted} of {total} messages are missing' if total > counted else ''
    if not is_open and all(file.ended for file in left):
        return ''
    lost = sum(file.lost_bytes for file in left)
    return (
        f'it was cut off: {counted} messages are left, what was not yet on the disk is missing, '
        f'and {lost} bytes at its end are no whole message'
    )


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError):
        return ''


def _information(texts: Iterable[str]) -> dict[str, Any]:
    """Return the first metadata of rosbag2 that can be read."""
    for text in texts:
        try:
            document = yaml.safe_load(text)
        except (yaml.YAMLError, RecursionError, ValueError):
            continue
        if isinstance(document, dict):
            document = document.get('rosbag2_bagfile_information', document)
        if isinstance(document, dict) and document:
            return document
    return {}


def taking(typestore: Typestore, kind: str, add: Callable[[Any], None]) -> Take:
    """Return what takes the bytes of a message of a type; those of a foreign writer count for nothing."""
    from rosbags.serde import SerdeError

    def take(data: bytes) -> None:
        try:
            add(typestore.deserialize_cdr(data, kind))
        except (SerdeError, *SPOILT):
            return

    return take


class Profiles:
    """The motion profiles of a bag tell the bus cycles at which programs started."""

    def __init__(self, typestore: Typestore) -> None:
        self._typestore = typestore
        self._starts: set[tuple[int, str]] = set()  # and the session of each
        self.sessions = Sessions()

    def add(self, data: bytes) -> None:
        """Take a message of ``motion/course``: cycle, move, override, held, and phases (t, s, v, a, jerk)."""
        from rosbags.serde import SerdeError

        try:
            message: Any = self._typestore.deserialize_cdr(data, 'std_msgs/msg/Float64MultiArray')
        except SerdeError:
            return
        row = np.asarray(message.data)
        if len(row) < PROFILE_ROW or not np.isfinite(row[:PROFILE_ROW]).all():
            return
        cycle, number, _, held, _, distance = row[:PROFILE_ROW].tolist()
        # a change of override, a stop and a resume begin further on, or have phases; so has a plan that became longer
        one_phase = len(row) <= PROFILE_OF_START
        if number == 0.0 and not held and distance == 0.0 and one_phase and 0.0 <= cycle < 2**53:
            self._starts.add((int(cycle), _session_of(message)))

    @property
    def starts(self) -> list[int]:
        """In their order; those of other sessions were played back."""
        return sorted(
            {cycle for cycle, session in self._starts if not session or self.sessions.holds(session)}
        )


def _session_of(message: Any) -> str:
    """Return the session that the label of a motion profile names (kind, planner, session, number), or ''."""
    words = message.layout.dim[0].label.split(' ') if message.layout.dim else []
    return words[2] if len(words) == 4 else ''


def _cyclic_topics(channels: Iterable[Channel]) -> tuple[dict[str, str], list[str]]:
    """Return the relative names of the cyclic topics of the only robot, and notes on the omitted topics."""
    names: dict[str, str] = {}
    left_out: list[str] = []
    robots: set[str] = set()
    for channel in channels:
        topic = '/' + channel.topic.lstrip('/')
        name = next((name for name in TYPES if topic.endswith('/' + name)), None)
        if name is None or not channel.msgcount:
            continue
        if why := _foreign(channel, TYPES[name]):
            left_out.append(f'{topic} is left out, as it is {why}')
            continue
        names[channel.topic] = name
        robots.add(topic.removesuffix('/' + name) or '/')
    if not names:
        found = f': {"; ".join(left_out)}' if left_out else ' (sercos/mdt, sercos/at/axis1, ...)'
        raise TraceError(f'it holds no cyclic topic of a robot{found}')
    if len(robots) > 1:
        raise TraceError(f'it holds {len(robots)} robots, in the namespaces {", ".join(sorted(robots))}')
    return names, list(dict.fromkeys(left_out))


def _foreign(channel: Channel, kind: str) -> str:
    """Return how the messages of a topic differ from those of the robot; '' if they do not."""
    if channel.encoding != CDR:
        return f'encoded as {shown(channel.encoding)}, not as {CDR}'
    return '' if channel.msgtype == kind else f'of type {channel.msgtype or "unknown"}, not {kind}'


def _metadata(custom: Any) -> dict[str, Any]:
    """Return the checked metadata of the recorder."""
    if not isinstance(custom, dict) or METADATA_KEY not in custom:
        raise TraceError(f'its metadata is missing, metadata.yaml has no custom_data {METADATA_KEY}')
    try:
        meta = json.loads(custom[METADATA_KEY])
        items = dict(meta.items())
    except (AttributeError, RecursionError, TypeError, ValueError):
        raise TraceError(f'its metadata, custom_data {METADATA_KEY}, is no JSON object') from None
    for key in ('gear_ratio', 'torque_constant_n_m_a', 'cycle_time_s'):
        value = items.get(key)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not 0.0 < value <= sys.float_info.max
        ):
            raise TraceError(f'its metadata gives no positive {key}')
    if items['cycle_time_s'] not in CYCLE_TIMES_S:
        raise TraceError(
            f'its metadata says cycle_time_s is {items["cycle_time_s"]:g}, not 0.001, 0.002 or 0.004'
        )
    for key in ('start_cycle', 'end_cycle'):
        value = items.pop(key, None)
        if value is not None and type(value) is not int:
            raise TraceError(f'its metadata says {key} is {value!r:.40}, not a whole number')
        if value is not None and value >= 0:
            items[key] = value
    return items
