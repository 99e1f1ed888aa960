"""Bags read as traces: every message is assigned to the bus cycle of its stamp."""

from __future__ import annotations

import logging
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.errors import TelegramError, TraceError
from delta3_pacdrive.parameters import CYCLE_TIMES_S, ROTARY_AXES_MAX, numbered
from delta3_pacdrive.recording.bag_messages import PROFILE, BagMessages, typestore
from delta3_pacdrive.recording.signals import (
    CURRENT_SIGNALS,
    ROTARY_SIGNALS,
    SIGNALS,
    SUPPLY_SIGNALS,
    THERMAL_SIGNALS,
    TORQUE_SIGNALS,
)
from delta3_pacdrive.recording.telegram_signals import TELEGRAM_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegram_codec import Message, TelegramCodec

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray
    from rosbags.typesys.store import Typestore

    from delta3_pacdrive.numerics.types import Floats
    from delta3_pacdrive.robot.sercos.telegrams import Telegram

    Table = tuple[
        NDArray[np.int64], Floats
    ]  # stamps [ns] or cycles, and the numbers of a message in each row

FIRST = 100  # messages from which the layout of a topic is determined
BATCH = 20_000  # undecoded messages of a topic, about 4 MB
LAYOUTS = {
    topic: [t for t in TELEGRAM_SIGNALS if t.topic == topic] for topic in (t.topic for t in TELEGRAM_SIGNALS)
}
SHAFTS = telegrams.SHAFTS.topic
# topics with a signal per number
NUMBERS = {telegram.topic for telegram in (*telegrams.ROTARY_AT, *telegrams.TURNS, telegrams.DC_LINK)}
# signals of a rotary axis in units of its motor, and the parameters that convert them to the tool
OF_MOTOR = {
    'turn_position': 'gear_ratio',
    'turn_speed': 'gear_ratio',
    'turn_current': 'torque_constant_n_m_a',
}
UNREADABLE = -1
PROFILE_OF_START = 9  # length of a motion profile with a single phase
PROFILE_ROW = 6  # leading numbers that distinguish the start of a program from a change of its motion profile
_LOG = logging.getLogger(__name__)


def metadata(path: Path) -> dict[str, Any]:
    """Return the metadata of a bag without reading its messages.

    ``lost`` are the numbers of missing messages counted by the recorder, by relative name of the topic; ``cut``
    lists the missing parts of an incomplete bag.

    Raises
    ------
    TraceError
        The path is not a bag of a robot, or the bag cannot be read.

    """
    from delta3_pacdrive.recording.bags.bag_reader import open_bag

    try:
        return open_bag(path).meta
    except (OSError, TraceError) as error:
        raise TraceError(f'cannot read recording {path}: {error}') from error


def read_bag(path: str | Path) -> Trace:
    """Read the folder of a bag of one robot in any namespace.

    Every message belongs to the bus cycle of its stamp; the order in the bag does not matter. Messages from before
    cyclic operation are ignored. Messages that the nodes would reject (other names or lengths, numbers that are not
    finite) are counted by topic in ``meta['refused']``. Of ``plant/motor_shafts``, which may be published more often,
    only messages at cycle starts are used.

    Returns
    -------
    Trace
        All bus cycles contained in every recorded cyclic topic, with the signals of the recorded topics, and
        ``CURRENT_SIGNALS`` if the currents of all drives are recorded. ``meta`` is the metadata of the recorder,
        without an unknown ``start_cycle`` or ``end_cycle``. For an incomplete bag ``meta['cut']`` and the log list the
        missing parts.

    Raises
    ------
    TraceError
        There is no folder, it is not a bag, or nothing of it can be read; it has no cyclic topic, more than one robot
        or more than one run; its metadata is missing or contradicts the stamps; no cycle is complete.

    """
    path = Path(path)
    try:
        return _read_bag(path)
    except TraceError as error:
        raise TraceError(f'cannot read recording {path}: {error}') from error
    except OSError as error:
        raise TraceError(f'cannot read recording {path}: {error.strerror}') from error


def _read_bag(path: Path) -> Trace:
    # imported here because only bags need these slow imports
    from delta3_pacdrive.recording.bags.bag_reader import open_bag
    from delta3_pacdrive.recording.bags.completeness import common_cycles
    from delta3_pacdrive.recording.bags.current_samples import SampleColumn, of_cycles

    bag = open_bag(path)
    types = typestore()
    columns = {
        name: _Column(layouts, types) for name, layouts in LAYOUTS.items() if name in bag.names.values()
    }
    samples = {
        topic: SampleColumn(
            axis,
            lambda telegram: _Column([telegram], types),
            partial(_parse, types, telegrams.JOINT_STATE),
        )
        for topic, axis in zip(bag.currents, DRIVES, strict=False)
    }
    messages = BagMessages()
    add = {topic: columns[name].add for topic, name in bag.names.items()}
    add |= {topic: column.add for topic, column in samples.items()}
    bag.read(add | messages.takers(bag.robot))
    meta = bag.meta
    if 'cycle_time_s' not in meta:
        meta['cycle_time_s'] = _cycle_time(
            column.table()[0] for name, column in columns.items() if name != SHAFTS
        )
    clock = Clock(meta['cycle_time_s'])
    tables = {}
    for name, column in columns.items():
        if len((table := _by_cycle(name, column.table(), clock))[0]):
            tables[name] = table
    if not tables:
        raise TraceError('it contains no message of cyclic operation')
    sampled, currents = np.empty(0, np.int64), dict[str, 'Floats']()
    if samples:
        sampled, currents = of_cycles([column.table() for column in samples.values()], clock.period_ns)
    cycles, notices = common_cycles(tables, sampled, counted='lost' in meta)
    if len(cycles) > 1 and (step := int(np.diff(cycles).min())) > 1:
        raise TraceError(
            f'its messages are {step * meta["cycle_time_s"]:g} s apart, '
            f'but its metadata has cycle_time_s {meta["cycle_time_s"]:g}'
        )
    counted = {name: column.refused for name, column in columns.items()}
    counted |= {topic.removeprefix(bag.robot): column.refused for topic, column in samples.items()}
    if refused := {name: count for name, count in counted.items() if count}:
        meta['refused'] = refused
    status = [columns[t.topic].status_changes(clock) for t in telegrams.AT if t.topic in columns]
    if len(status) == len(telegrams.AT):
        meta['drive_status'] = status
    if starts := _starts(messages):
        meta['starts'] = starts
        within = [start for start in starts if start >= cycles[0]]
        # a recorder started during a program still knows its start
        meta['start_cycle'] = within[0] if within else starts[-1]
    if notices:
        meta['notices'] = notices
        _LOG.warning('note: recording %s: %s', path, '; '.join(notices))
    if 'cut' in meta:
        meta['cut'] += _extent(cycles, meta['cycle_time_s'])
        _LOG.warning('note: recording %s: %s', path, meta['cut'])
    signals = _signals(
        tables, cycles, {name: TELEGRAM_SIGNALS[column.telegram] for name, column in columns.items()}
    )
    if 'current' in signals:
        signals['current'] /= meta['torque_constant_n_m_a']
    _convert_to_tool(signals, meta)
    if np.isin(cycles, sampled).all():
        rows = np.searchsorted(sampled, cycles)
        signals |= {name: currents[name][rows] for name in CURRENT_SIGNALS}
    return Trace(cycles * meta['cycle_time_s'], signals, meta, messages)


def _starts(messages: BagMessages) -> list[int]:
    """Return the start cycles of programs in ascending order, from the motion profiles of a bag."""
    starts: set[int] = set()

    def add(message: Any) -> None:
        """Add a message of ``motion/course``: cycle, move, override, held, and phases (t, s, v, a, jerk)."""
        row = np.asarray(message.data)
        if len(row) < PROFILE_ROW or not np.isfinite(row[:PROFILE_ROW]).all():
            return
        cycle, number, _, held, _, distance = row[:PROFILE_ROW].tolist()
        # profiles after override, stop, resume or an appended move begin later or have more phases
        one_phase = len(row) <= PROFILE_OF_START
        if number == 0.0 and not held and distance == 0.0 and one_phase and 0.0 <= cycle < 2**53:
            session = _session_of(message)
            if not session or messages.sessions.holds(session):  # those of other sessions were played back
                starts.add(int(cycle))

    messages.decode({PROFILE: add})
    return sorted(starts)


def _session_of(message: Any) -> str:
    """Return the session in the label of a motion profile (kind, planner, session, number), or ''."""
    words = message.layout.dim[0].label.split(' ') if message.layout.dim else []
    return words[2] if len(words) == 4 else ''


def _extent(cycles: NDArray[np.int64], period_s: float) -> str:
    """Return begin and end of an incomplete recording as text."""
    begin = f'; it begins at bus time {cycles[0] * period_s:.3f} s' if cycles[0] > 0 else ''
    return f'{begin}; it ends at bus time {cycles[-1] * period_s:.3f} s'


def _cycle_time(stamps: Iterable[NDArray[np.int64]]) -> float:
    """Return the smallest distance [s] of stamps [ns], assumed to be the cycle time; raises TraceError."""
    steps = [int(step.min()) for own in stamps if len(step := np.diff(np.unique(own)))]
    found = min(steps, default=0) / NANOSECONDS
    if found not in CYCLE_TIMES_S:
        raise TraceError(f'its metadata is missing, and stamps {found:g} s apart do not fit a cycle time')
    return found


class _Column:
    """Decoder of the messages of one topic into stamps and numbers.

    Of several layouts it uses the one that fits most of the first messages.
    """

    def __init__(self, layouts: Sequence[Telegram], typestore: Typestore) -> None:
        self._words: list[NDArray[np.int64]] = []
        self._codecs = {one: TelegramCodec(one, partial(_parse, typestore, one.type)) for one in layouts}
        self._batch: list[bytes] = []
        self._tables: list[Table] = []
        self.refused = 0

    def add(self, data: bytes) -> None:
        """Add a message."""
        self._batch.append(data)
        if len(self._batch) == BATCH:
            self._decode_batch()

    def table(self) -> Table:
        """Return stamps [ns] of the messages of cyclic operation, shape (n,), and their numbers, (n, numbers)."""
        self._decode_batch()
        if not self._tables:
            return np.empty(0, np.int64), np.empty((0, sum(self.telegram.lengths)))
        stamps, values = zip(*self._tables, strict=True)
        return np.concatenate(stamps), np.concatenate(values)

    @property
    def telegram(self) -> Telegram:
        """Layout of the messages."""
        return next(iter(self._codecs))

    def status_changes(self, clock: Clock) -> list[list[int]]:
        """Return the changes of the status word S-0-0135 of an AT as pairs of bus cycle and new word."""
        stamps, _ = self.table()
        words = np.concatenate([np.empty(0, np.int64), *self._words])
        if not len(words):
            return []
        cycles, rows = np.unique(stamps // clock.period_ns, return_index=True)
        words = words[rows]
        cycles, words = cycles[words != UNREADABLE], words[words != UNREADABLE]
        changed = np.flatnonzero(np.diff(words, prepend=UNREADABLE))
        return [[int(cycles[n]), int(words[n])] for n in changed]

    def _decode_batch(self) -> None:
        if len(self._codecs) > 1 and self._batch:
            first = self._batch[:FIRST]
            fitting = {
                telegram: sum(_fits(codec, data) for data in first)
                for telegram, codec in self._codecs.items()
            }
            telegram = max(fitting, key=fitting.__getitem__)
            self._codecs = {telegram: self._codecs[telegram]}
        codec = self._codecs[self.telegram]
        if self._batch and not self._tables:  # the robot may have a prefix of frames
            codec = self._codecs[self.telegram] = codec.with_prefix_of(self._batch[0])
        sec, nanosec, frames, values, others = codec.decode_all(self._batch)
        self._batch = []
        self._append(sec, nanosec, frames, values)
        parsed = []
        for data in others:
            try:
                parsed.append(codec.decode_message(data))
            except TelegramError:
                self.refused += 1
        if parsed:
            own, rests, texts, rows = zip(*parsed, strict=True)
            self._append(np.array(own), np.array(rests), np.array(texts), np.array(rows))

    def _append(self, sec: NDArray[Any], nanosec: NDArray[Any], frames: NDArray[Any], values: Floats) -> None:
        """Keep the valid messages of cyclic operation."""
        cyclic = sec >= 0
        good = cyclic & (nanosec < NANOSECONDS) & np.isfinite(values).all(axis=1)
        self.refused += int(cyclic.sum() - good.sum())
        stamps = sec[good].astype(np.int64) * NANOSECONDS + nanosec[good].astype(np.int64)
        self._tables.append((stamps, values[good]))
        if self.telegram in (*telegrams.AT, *telegrams.ROTARY_AT):
            self._words.append(_status_words(frames[good]))


def _fits(codec: TelegramCodec, data: bytes) -> bool:
    """Return whether a codec can read a message."""
    try:
        return bool(codec.decode_layout(data) or codec.decode_message(data))
    except TelegramError:
        return False


def _status_words(frames: NDArray[Any]) -> NDArray[np.int64]:
    """Return the status words in the frames of AT, ``UNREADABLE`` if there is none."""
    texts, indices = np.unique(frames, return_inverse=True)
    words = [UNREADABLE] * len(texts)
    for n, text in enumerate(texts.tolist()):
        with suppress(TelegramError):
            session = text.rpartition(b' ')[2]
            words[n] = telegrams.parse_at_frame(text, session)[0]
    return np.array(words, dtype=np.int64)[indices]


def _parse(typestore: Typestore, message_type: str, data: bytes) -> Message:
    """Parse a message of any layout; raises TelegramError."""
    from rosbags.serde import SerdeError

    try:
        message: Any = typestore.deserialize_cdr(data, message_type)
    except SerdeError as error:
        raise TelegramError(f'a telegram is not a {message_type}') from error
    header = message.header
    head = header.stamp.sec, header.stamp.nanosec, header.frame_id.encode()
    if message_type == telegrams.JOINT_STATE:
        return Message(*head, message.name, (message.position, message.velocity, message.effort))
    vector = message.point if message_type == telegrams.POINT else message.vector
    return Message(*head, (), ((vector.x, vector.y, vector.z),))


def _by_cycle(name: str, table: Table, clock: Clock) -> Table:
    """Return the bus cycles of a topic in ascending order, and the numbers of each."""
    stamps, values = table
    in_cycle = stamps % clock.period_ns
    if name == SHAFTS:
        stamps, values = stamps[in_cycle == 0], values[in_cycle == 0]
    elif in_cycle.any():
        first = stamps[np.flatnonzero(in_cycle)[0]]
        raise TraceError(
            f'{name} has a message at bus time {first / NANOSECONDS:.9f} s, '
            f'which is not the begin of a cycle of {clock.period_ns / NANOSECONDS:g} s'
        )
    cycles, first_rows, rows = np.unique(stamps // clock.period_ns, return_index=True, return_inverse=True)
    differing = np.flatnonzero((values != values[first_rows][rows]).any(axis=1))
    if len(differing):
        time_s = stamps[differing[0]] / NANOSECONDS
        raise TraceError(
            f'it contains more than one run: {name} has different messages at bus time {time_s:g} s'
        )
    return cycles, values[first_rows]


def _signals(
    tables: dict[str, Table], cycles: NDArray[np.int64], names: dict[str, tuple[str, ...]]
) -> dict[str, Floats]:
    """Return the signals of all topics in common cycles, in the order of ``SIGNALS``; ``names`` are those by topic."""
    rows = {name: values[np.searchsorted(own, cycles)] for name, (own, values) in tables.items()}
    found: dict[str, Floats] = {}
    at_topics = [telegram.topic for telegram in telegrams.AT]
    for topic, values in rows.items():
        if topic not in at_topics:
            wide = 1 if topic in NUMBERS else values.shape[1] // len(names[topic])
            for i, signal in enumerate(names[topic]):
                if signal:
                    # the arms come first
                    found[signal] = np.ascontiguousarray(values[:, wide * i : wide * i + min(wide, 3)])
    feedback = [rows[telegram.topic] for telegram in telegrams.AT if telegram.topic in rows]
    if len(feedback) == len(telegrams.AT):
        for i, signal in enumerate(TELEGRAM_SIGNALS[telegrams.AT[0]]):
            found[signal] = np.stack([one[:, i] for one in feedback], axis=1)
    names_kept = (*SIGNALS, *SUPPLY_SIGNALS, *THERMAL_SIGNALS, *TORQUE_SIGNALS, *ROTARY_SIGNALS)
    return {signal: found[signal] for signal in names_kept if signal in found}


def _convert_to_tool(signals: dict[str, Floats], meta: dict[str, Any]) -> None:
    """Convert the signals of each rotary axis from the motor to the tool, in place."""
    given = meta.get('parameters')
    known = given if isinstance(given, dict) else {}
    for number in range(ROTARY_AXES_MAX):
        for name, key in OF_MOTOR.items():
            signal, constant = numbered(name, number), known.get(f'{numbered("rotary", number)}.{key}')
            if signal in signals and isinstance(constant, int | float) and constant > 0.0:
                signals[signal] /= constant
            else:
                signals.pop(signal, None)
