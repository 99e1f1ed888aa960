"""Topics and metadata of a bag (folder or file of rosbag2), read before its messages."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.parameters import CYCLE_TIMES_S
from delta3_pacdrive.parameters import load as load_parameters
from delta3_pacdrive.recording.bags.bag_files import damaged, files_of, open_file
from delta3_pacdrive.recording.bags.bag_recovery import CDR
from delta3_pacdrive.recording.bags.bag_writer import METADATA_KEY, STOPPED_KEY
from delta3_pacdrive.recording.telegram_signals import TELEGRAM_SIGNALS
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINT_STATE, motor_current

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from delta3_pacdrive.recording.bags.bag_files import Store
    from delta3_pacdrive.recording.bags.bag_recovery import Channel

    Take = Callable[[bytes], None]


TYPES = {telegram.topic: telegram.type for telegram in TELEGRAM_SIGNALS}


@dataclass(frozen=True)
class Bag:
    """Bag of one robot."""

    names: dict[str, str]  # relative names of the cyclic topics, by topic
    currents: tuple[
        str, ...
    ]  # topics with current samples of the drives, in their order; empty unless all exist
    robot: str  # namespace, including the separator
    meta: dict[str, Any]  # checked metadata of the recorder
    read: Callable[[Mapping[str, Take]], None]  # calls functions by topic with the data of messages


def open_bag(path: Path) -> Bag:
    """Read the topics and the metadata of a bag: a folder or a single file, complete or not.

    ``meta['cut']`` names missing files, messages and metadata.

    Raises
    ------
    TraceError
        There is no bag, or nothing of it can be read.

    """
    information = _information((_text_of(path / 'metadata.yaml'),)) if path.is_dir() else {}
    files, notes = files_of(path, information)
    stores = [open_file(file) for file in files]
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
    held = {one.topic for one in channels if one.msgcount and not _mismatch(one, JOINT_STATE)}
    currents = tuple(namespace + motor_current(axis, 0).topic for axis in DRIVES)
    return Bag(names, currents if held.issuperset(currents) else (), namespace, meta, read)


def _missing(information: Mapping[str, Any], counted: int, stores: Sequence[Store]) -> str:
    """Return a note on missing messages, of which ``counted`` are left; '' if only the index is missing."""
    total = information.get('message_count')
    left = [store.recovered for store in stores if store.recovered is not None]
    if isinstance(total, int) and total >= counted:
        return f'it was cut off: {total - counted} of {total} messages are missing' if total > counted else ''
    if all(file.ended for file in left):
        return ''
    lost = sum(file.lost_bytes for file in left)
    return (
        f'it was cut off: {counted} messages are left, unwritten messages are missing, '
        f'and {lost} bytes at its end are not a complete message'
    )


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError):
        return ''


def _information(texts: Iterable[str]) -> dict[str, Any]:
    """Return the first readable metadata of rosbag2."""
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


def _cyclic_topics(channels: Iterable[Channel]) -> tuple[dict[str, str], list[str]]:
    """Return the relative names of the cyclic topics of the only robot, and notes on omitted topics."""
    names: dict[str, str] = {}
    left_out: list[str] = []
    robots: set[str] = set()
    for channel in channels:
        topic = '/' + channel.topic.lstrip('/')
        name = next((name for name in TYPES if topic.endswith('/' + name)), None)
        if name is None or not channel.msgcount:
            continue
        if mismatch := _mismatch(channel, TYPES[name]):
            left_out.append(f'{topic} is left out, as it is {mismatch}')
            continue
        names[channel.topic] = name
        robots.add(topic.removesuffix('/' + name) or '/')
    if not names:
        found = f': {"; ".join(left_out)}' if left_out else ' (sercos/mdt, sercos/at/axis1, ...)'
        raise TraceError(f'it contains no cyclic topic of a robot{found}')
    if len(robots) > 1:
        raise TraceError(f'it contains {len(robots)} robots, in the namespaces {", ".join(sorted(robots))}')
    return names, list(dict.fromkeys(left_out))


def _mismatch(channel: Channel, kind: str) -> str:
    """Return how the messages of a topic differ from those of the robot, or ''."""
    if channel.encoding != CDR:
        return f'encoded as {shown(channel.encoding)}, not as {CDR}'
    return '' if channel.msgtype == kind else f'of type {channel.msgtype or "unknown"}, not {kind}'


def _metadata(custom: Any) -> dict[str, Any]:
    """Return the metadata of the recorder after checking it."""
    if not isinstance(custom, dict) or METADATA_KEY not in custom:
        raise TraceError(f'its metadata is missing, metadata.yaml has no custom_data {METADATA_KEY}')
    try:
        meta = json.loads(custom[METADATA_KEY])
        items = dict(meta.items())
    except (AttributeError, RecursionError, TypeError, ValueError):
        raise TraceError(f'its metadata, custom_data {METADATA_KEY}, is not a JSON object') from None
    for key in ('gear_ratio', 'torque_constant_n_m_a', 'cycle_time_s'):
        value = items.get(key)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not 0.0 < value <= sys.float_info.max
        ):
            raise TraceError(f'its metadata has no positive {key}')
    if items['cycle_time_s'] not in CYCLE_TIMES_S:
        raise TraceError(
            f'its metadata has cycle_time_s {items["cycle_time_s"]:g}, not 0.001, 0.002 or 0.004'
        )
    for key in ('start_cycle', 'end_cycle'):
        value = items.pop(key, None)
        if value is not None and type(value) is not int:
            raise TraceError(f'its metadata has {key} {value!r:.40}, not a whole number')
        if value is not None and value >= 0:
            items[key] = value
    return items
