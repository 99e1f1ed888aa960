"""Acquisition of an oscilloscope: assembles records from the sample streams of one or more drives.

A record begins some time before its trigger (pre-trigger). ``single`` keeps the first record, ``normal`` is armed again
after each record, ``rolling`` uses no trigger and keeps the newest samples. Missing samples are counted, and a record
with missing samples is rejected.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from delta3_pacdrive.errors import ParameterError, RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.channels import FAULT, PROGRAM, Channel, chosen, full_name
from delta3_pacdrive.robot.drive.scope import Block, decimation_of
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES

SAMPLES_MAX = 1_000_000  # per record: one minute at 16 kHz
RATE_MAX_HZ, RATE_MIN_HZ = 16_000.0, 1.0
TIME_DIGITS = 9  # of a second
ON_FAULT, ON_PROGRAM = 'fault', 'program'


class Edge(StrEnum):
    """Event in a signal that triggers a record."""

    RISING = 'rising'
    FALLING = 'falling'
    BOTH = 'both'
    CHANGE = 'change'  # any change of the value


class Mode(StrEnum):
    """Operating mode of an acquisition."""

    SINGLE = 'single'
    NORMAL = 'normal'
    ROLLING = 'rolling'


Source = tuple[int, Channel]  # axis (0 to 3) and channel


@dataclass(frozen=True)
class Trigger:
    """Event that starts a record: any of the sources crosses the level."""

    text: str
    sources: tuple[Source, ...]
    level: float
    edge: Edge

    @property
    def sentence(self) -> str:
        """The event as text."""
        if self.text == ON_FAULT:
            return 'a fault of a drive'
        if self.text == ON_PROGRAM:
            return 'the start of a program'
        if self.edge is Edge.CHANGE:
            return f'a change of {self.text}'
        unit = self.sources[0][1].unit
        how = 'through' if self.edge is Edge.BOTH else f'{self.edge} through'
        return f'{self.text} {how} {self.level:g} {unit}'.rstrip(' 1')

    def first_event(self, before: Floats | None, columns: Floats) -> int | None:
        """Return the first row after an event, or None.

        ``columns`` has one column per source, shape (rows, sources); ``before`` is the row before it, None at the
        beginning.
        """
        rows = columns if before is None else np.vstack([before, columns])
        old, new = rows[:-1], rows[1:]
        rising, falling = (old < self.level) & (new >= self.level), (old > self.level) & (new <= self.level)
        found = {
            Edge.RISING: rising, Edge.FALLING: falling, Edge.BOTH: rising | falling, Edge.CHANGE: new != old,
        }[self.edge]  # fmt: skip
        where = np.flatnonzero(found.any(axis=1))
        return int(where[0]) + (before is None) if len(where) else None


@dataclass(frozen=True)
class Setting:
    """Configuration of an oscilloscope."""

    channels: tuple[Source, ...]
    decimation: int  # current periods per sample
    sample_time_s: float
    samples: int  # per record
    pre_samples: int = 0  # before the trigger
    trigger: Trigger | None = None  # None: begin immediately
    mode: Mode = Mode.SINGLE
    records: int = 0  # number of records after which ``normal`` ends; 0: never

    def of_axis(self, axis: int) -> tuple[Channel, ...]:
        """Return the channels required from a drive, for display or trigger."""
        sources = self.trigger.sources if self.trigger else ()
        return tuple(dict.fromkeys(channel for of, channel in (*self.channels, *sources) if of == axis))

    @property
    def axes(self) -> tuple[int, ...]:
        """Drives with at least one channel."""
        return tuple(axis for axis in range(len(ALL_DRIVES)) if self.of_axis(axis))


def setting(
    parameters: Parameters,
    channels: Sequence[str],
    rate_hz: float,
    duration_s: float,
    trigger: str | None = None,
    level: float = 0.0,
    edge: str | None = None,
    pre_trigger_s: float = 0.0,
    mode: str = Mode.SINGLE,
    records: int = 0,
) -> Setting:
    """Return the configuration of an oscilloscope; raises ParameterError if it is not possible."""
    shown = chosen(channels)
    decimation = decimation_of(rate_hz, parameters)
    step = decimation * parameters.drive.current_period_s
    samples, before = round(duration_s / step), round(pre_trigger_s / step)
    if samples > SAMPLES_MAX:
        raise ParameterError(
            f'a record of {duration_s:g} s has {samples} samples at {1.0 / step:g} Hz, the limit is {SAMPLES_MAX}: '
            'choose a lower rate or a shorter time'
        )
    if samples < 1:
        raise ParameterError(f'a record of {duration_s:g} s has no samples at {1.0 / step:g} Hz')
    if before >= samples:
        raise ParameterError(
            f'the pre-trigger of {pre_trigger_s:g} s must be shorter than the record of {duration_s:g} s'
        )
    found = None if trigger is None else _trigger(trigger, shown, level, edge)
    if found is None and before:
        raise ParameterError('a pre-trigger needs a trigger')
    if found is not None and mode == Mode.ROLLING:
        raise ParameterError('the mode rolling does not use a trigger')
    if found is None and mode == Mode.NORMAL:
        raise ParameterError('the mode normal needs a trigger')
    return Setting(
        channels=shown,
        decimation=decimation,
        sample_time_s=step,
        samples=samples,
        pre_samples=before,
        trigger=found,
        mode=Mode(mode),
        records=records,
    )


def _trigger(text: str, shown: Sequence[Source], level: float, edge: str | None) -> Trigger:
    axes = sorted({axis for axis, _ in shown})
    if text in (ON_FAULT, ON_PROGRAM):
        channel = FAULT if text == ON_FAULT else PROGRAM
        return Trigger(text, tuple((axis, channel) for axis in axes), 0.5, Edge.RISING)
    (source,) = chosen([text])
    # operation data changes in steps when it is written
    default = Edge.CHANGE if '-' in source[1].name else Edge.RISING
    return Trigger(full_name(*source), (source,), level, Edge(edge) if edge else default)


@dataclass(frozen=True)
class Record:
    """Samples of an oscilloscope."""

    setting: Setting
    first: int  # number of the first sample; sample n has the bus time n * setting.sample_time_s
    values: Floats  # one column per channel, shape (samples, channels)
    trigger: int | None = None  # row of the trigger

    @property
    def time_s(self) -> Floats:
        """Bus time of each sample [s]."""
        numbers = np.arange(self.first, self.first + len(self.values))
        return np.round(numbers * self.setting.sample_time_s, TIME_DIGITS)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(full_name(axis, channel) for axis, channel in self.setting.channels)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the columns."""
        return tuple(channel.unit for _, channel in self.setting.channels)


class Acquisition:
    """Assembler of records from the blocks of all drives; ``take`` is called with each record."""

    def __init__(self, setting: Setting, take: Callable[[Record], None]) -> None:
        self.setting, self._take = setting, take
        self._blocks: dict[int, list[Block]] = {axis: [] for axis in setting.axes}
        self._expected: dict[int, int | None] = dict.fromkeys(setting.axes)
        self._columns_of = {
            (axis, channel): column
            for axis in setting.axes
            for column, channel in enumerate(setting.of_axis(axis))
        }
        self._next: int | None = None  # number of the next sample to be joined
        self._first = 0  # number of the first kept sample
        self._kept: list[Floats] = []  # rows of the displayed channels
        self._count = 0  # number of kept rows
        self._before: Floats | None = None  # last row of the trigger sources
        self._trigger: int | None = None  # sample number
        self._gap = False  # the kept rows begin after a gap
        self.records = 0  # number of records so far
        self.lost = 0  # missing samples
        self.done = False

    @property
    def triggered(self) -> bool:
        """Whether a record is in progress."""
        return self._trigger is not None or self.setting.trigger is None

    def add(self, axis: int, block: Block) -> None:
        """Add a block of a drive, 0 to 3; raises RunError if samples are missing in a record in progress."""
        if self.done or axis not in self._blocks:
            return
        expected = self._expected[axis]
        if expected is not None and block.first != expected:
            self._handle_gap(axis, block.first - expected)
        self._expected[axis] = block.first + len(block.values)
        self._blocks[axis].append(block)
        self._join()

    def _handle_gap(self, axis: int, count: int) -> None:
        """Start again after a gap."""
        restarted = count < 0
        self.lost += max(count, 0)
        if self.triggered and self._next is not None:
            if restarted:
                raise RunError(f'the bus was restarted while {ALL_DRIVES[axis]} was recorded')
            raise RunError(
                f'{count} samples of {ALL_DRIVES[axis]} were lost during a record, which must not have gaps. '
                'Choose fewer channels or a lower rate'
            )
        for of in self._blocks:
            self._blocks[of] = []
        self._expected = {of: None if of != axis else self._expected[of] for of in self._blocks}
        self._next, self._gap = None, not restarted
        self._clear()

    def _clear(self) -> None:
        self._kept, self._count, self._before = [], 0, None

    def _join(self) -> None:
        """Process the samples that all drives have delivered."""
        if not all(self._blocks.values()):
            return
        begin = max(blocks[0].first for blocks in self._blocks.values())
        begin = begin if self._next is None else max(begin, self._next)
        end = min(blocks[-1].first + len(blocks[-1].values) for blocks in self._blocks.values())
        if end <= begin:
            return
        if self._count == 0:
            self._first = begin
        tables = {axis: _rows(blocks, begin, end) for axis, blocks in self._blocks.items()}
        for axis, blocks in self._blocks.items():
            self._blocks[axis] = [block for block in blocks if block.first + len(block.values) > end]
        self._next = end
        self._process(self._columns(tables, self.setting.channels), tables, begin)

    def _columns(self, tables: dict[int, Floats], sources: Iterable[Source]) -> Floats:
        return np.column_stack(
            [tables[axis][:, self._columns_of[axis, channel]] for axis, channel in sources]
        )

    def _process(self, shown: Floats, tables: dict[int, Floats], begin: int) -> None:
        self._kept.append(shown)
        self._count += len(shown)
        trigger = self.setting.trigger
        watched = None if trigger is None else self._columns(tables, trigger.sources)
        while not self.done:
            if trigger is not None and watched is not None and self._trigger is None:
                row = trigger.first_event(self._before, watched) if len(watched) else None
                if row is None:
                    self._before = watched[-1] if len(watched) else self._before
                    self._discard_old(self.setting.pre_samples)
                    return
                self._trigger = begin + row
                self._before = watched[row]
                if self._gap and self._trigger - self._first < self.setting.pre_samples:
                    raise RunError(
                        f'{self.lost} samples were lost just before the trigger: a record must not have gaps. '
                        'Choose fewer channels or a lower rate'
                    )
            if self.setting.mode is Mode.ROLLING:
                self._discard_old(self.setting.samples)
                return
            start = self._start()
            end = start + self.setting.samples
            if self._first + self._count < end:
                return
            self._complete(start, end)
            if watched is not None:
                used = min(max(end - begin, 0), len(watched))
                self._before = watched[used - 1] if used else self._before
                watched, begin = watched[used:], begin + used

    def _start(self) -> int:
        if self._trigger is None:
            return self._first
        # fewer pre-trigger samples shortly after the beginning
        return max(self._first, self._trigger - self.setting.pre_samples)

    def _discard_old(self, keep: int) -> None:
        """Discard whole pieces of samples that are too old for a record."""
        while self._kept and self._count - len(self._kept[0]) >= keep:
            self._first += len(self._kept[0])
            self._count -= len(self._kept[0])
            del self._kept[0]

    def _complete(self, start: int, end: int) -> None:
        rows = np.concatenate(self._kept)[start - self._first : end - self._first]
        mark = None if self._trigger is None else self._trigger - start
        self.records += 1
        single = self.setting.mode is Mode.SINGLE
        self.done = single or self.records == self.setting.records
        rest = np.concatenate(self._kept)[end - self._first :]
        self._kept, self._count, self._first = [rest], len(rest), end
        self._trigger, self._gap = None, False
        self._take(Record(self.setting, start, rows, mark))

    def newest(self) -> Record | None:
        """Return the current samples of a rolling acquisition as a record; None without samples."""
        if not self._count:
            return None
        end = self._first + self._count
        start = max(self._first, end - self.setting.samples)
        return Record(self.setting, start, np.concatenate(self._kept)[start - self._first :])

    def finish(self) -> None:
        """Complete the last record: a rolling one, or one cut short by the end of a run."""
        if self.done or not self._count or not self.triggered:
            return
        end = self._first + self._count
        if self.setting.mode is Mode.ROLLING:
            self._complete(max(self._first, end - self.setting.samples), end)
        else:
            self._complete(self._start(), end)
        self.done = True


def _rows(blocks: Sequence[Block], begin: int, end: int) -> Floats:
    parts = [
        block.values[max(begin - block.first, 0) : max(end - block.first, 0)]
        for block in blocks
        if block.first < end
    ]
    return np.concatenate(parts)
