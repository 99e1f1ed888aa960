"""What the commands share that look into drives: options of the oscilloscope, and the records that it leaves."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Options, option
from delta3_pacdrive.cli.command import flag as flag_option
from delta3_pacdrive.cli.option_types import filled, finite_number, integer_within, number_within

if TYPE_CHECKING:
    from collections.abc import Sequence

    from delta3_pacdrive.analysis.provenance import Provenance
    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.recording.acquisition import Record, Setting

EDGES, MODES = ('rising', 'falling', 'both', 'change'), ('single', 'normal', 'rolling')
DURATION_S = 1.0
TIME_S = number_within(0.0, 1e6, 's')


def record_file(text: str) -> str:
    """Take the name of a record to be written: its ending says how."""
    from delta3_pacdrive.recording.column_table import suffix_refusal

    if refusal := suffix_refusal(filled(text)):
        raise argparse.ArgumentTypeError(f'cannot write {text}: {refusal}')
    return text


def _figure_file(text: str) -> str:
    if Path(text).suffix.lower() != '.png':
        raise argparse.ArgumentTypeError(f'cannot write {text}: the name of a figure must end in .png')
    return text


@dataclass
class ScopeOptions(Options):
    """Options of an oscilloscope, with the names that drives have for them."""

    rate: float = option(
        'samples of a channel in a second [Hz]: every n-th period of the current loop, at most all of them',
        'HZ',
        names=('--scope-rate', '--rate'),
        default=16_000.0,
        type=number_within(1.0, 16_000.0, 'Hz'),
    )
    duration: float | None = option(
        f'length of a record [s]; {DURATION_S:g} s, in a simulation without a trigger all of it',
        'S',
        names=('--scope-duration', '--duration'),
        type=TIME_S,
    )
    trigger: str | None = option(
        'begin with this event: a channel that crosses --level, an IDN that changes (axis1.S-0-0104), fault, or '
        'program: the start of one',
        'CHANNEL',
    )
    level: float | None = option(
        'of the trigger, in the unit of its channel; 0 if not given', 'VALUE', type=finite_number
    )
    edge: str | None = option(
        'of the trigger: rising, or change for an IDN, if not given', 'EDGE', choices=EDGES
    )
    pre_trigger: float | None = option('how much of a record lies before its trigger [s]', 'S', type=TIME_S)
    mode: str = option(
        'single: one record; normal: one after each trigger; rolling: the newest samples, until Ctrl-C',
        'MODE',
        choices=MODES,
        default='single',
    )
    records: int | None = option(
        'end after so many records in mode normal', 'N', type=integer_within(1, 10_000)
    )
    plot: str | None = option('draw the record in this .png file', 'FILE', type=_figure_file)
    overwrite: bool = flag_option('replace records that exist already')

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if self.trigger is None:
            for name, value in (
                ('--level', self.level),
                ('--edge', self.edge),
                ('--pre-trigger', self.pre_trigger),
            ):
                if value is not None:
                    return f'{name} is for --trigger, which is not given'
        if self.records is not None and self.mode != 'normal':
            return f'--records is for --mode normal, not for {self.mode}'
        return super().check()

    def setting(self, channels: Sequence[str], robot: Parameters, all_of_it: bool = False) -> Setting:
        """Return what is to be recorded; raises ParameterError. ``all_of_it``: as much as a record can hold."""
        from delta3_pacdrive.recording.acquisition import SAMPLES_MAX, setting

        longest = all_of_it and self.trigger is None
        usual = SAMPLES_MAX / self.rate * 0.999 if longest else DURATION_S

        return setting(
            robot,
            channels,
            self.rate,
            usual if self.duration is None else self.duration,
            self.trigger,
            self.level or 0.0,
            self.edge,
            self.pre_trigger or 0.0,
            self.mode,
            self.records or 0,
        )


class Records:
    """The records of an oscilloscope are written as they come.

    Parameters
    ----------
    options
        Of the oscilloscope.
    output
        File of the record; of several, each has its number behind the name.
    origin
        Where they come from.

    Attributes
    ----------
    written
        What each tells of itself, with its files.
    taken
        File and samples of each.

    Raises
    ------
    TraceError
        They cannot be written, or exist already.

    """

    def __init__(self, options: ScopeOptions, output: str, origin: Provenance) -> None:
        from delta3_pacdrive.errors import TraceError
        from delta3_pacdrive.recording import column_table

        self._options, self._output, self._origin = options, output, origin
        self._several = options.mode == 'normal'
        self.written: list[dict[str, Any]] = []
        self.taken: list[tuple[Path, Record]] = []
        column_table.require_writable(output, 'record')
        for path in filter(None, (output, options.plot)):
            first = self._named(path, 1)
            if first.exists() and first.is_file() and not options.overwrite:
                raise TraceError(f'cannot write record {first}: it exists already, --overwrite replaces it')

    def _named(self, path: str, number: int) -> Path:
        from delta3_pacdrive.recording.record_file import numbered

        return numbered(path, number) if self._several else Path(path)

    def take(self, record: Record) -> None:
        """Write a record; raises TraceError or FigureError."""
        from delta3_pacdrive.recording import record_file as records

        number = len(self.written) + 1
        path = self._named(self._output, number)
        meta = {'provenance': self._origin.lines()}
        files = [str(records.write(record, path, meta))]
        if self._options.plot:
            from delta3_pacdrive.analysis.scope_figure import draw

            files.append(str(draw(record, self._named(self._options.plot, number), self._origin)))
        self.written.append(records.metadata(record) | {'files': files})
        self.taken.append((path, record))

    def sentences(self) -> list[str]:
        """Say what was written, a sentence for each record."""
        return [
            f'oscilloscope: {row["samples"]} samples of {len(row["channels"])} channels at {row["rate_hz"]:g} Hz'
            + (f', trigger at {row["trigger_time_s"]:.6f} s' if row['trigger_time_s'] is not None else '')
            + f': {", ".join(row["files"])}'
            for row in self.written
        ]
