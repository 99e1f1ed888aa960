"""Options and records of the oscilloscope, for ``scope`` and ``simulate``."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Options, option
from delta3_pacdrive.cli.command import flag as flag_option
from delta3_pacdrive.cli.option_types import (
    file_ending,
    finite_number,
    integer_within,
    non_empty,
    number_within,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from delta3_pacdrive.parameters import Parameters
    from delta3_pacdrive.recording.acquisition import Record, Setting
    from delta3_pacdrive.studies.framework.provenance import Provenance

EDGES, MODES = ('rising', 'falling', 'both', 'change'), ('single', 'normal', 'rolling')
DURATION_S = 1.0
TIME_S = number_within(0.0, 1e6, 's')


def record_file(text: str) -> str:
    """Read the name of a record to write; the suffix selects the format."""
    from delta3_pacdrive.recording.tables.column_table import suffix_refusal

    if refusal := suffix_refusal(non_empty(text)):
        raise argparse.ArgumentTypeError(f'cannot write {text}: {refusal}')
    return text


@dataclass
class ScopeOptions(Options):
    """Options of an oscilloscope."""

    rate: float = option(
        'sampling rate [Hz]: every n-th period of the current loop',
        'HZ',
        names=('--scope-rate', '--rate'),
        default=16_000.0,
        type=number_within(1.0, 16_000.0, 'Hz'),
    )
    duration: float | None = option(
        f'length of a record [s] (default: {DURATION_S:g}; without a trigger in a simulation: the whole run)',
        'S',
        names=('--scope-duration', '--duration'),
        type=TIME_S,
    )
    trigger: str | None = option(
        'trigger event: a channel that crosses --level, an IDN that changes (axis1.S-0-0104), fault, or program '
        '(program start)',
        'CHANNEL',
    )
    level: float | None = option(
        'trigger level in the unit of the channel (default: 0)',
        'VALUE',
        needs='--trigger',
        type=finite_number,
    )
    edge: str | None = option(
        'trigger edge (default: rising; change for an IDN)', 'EDGE', needs='--trigger', choices=EDGES
    )
    pre_trigger: float | None = option(
        'length of a record before its trigger [s]', 'S', needs='--trigger', type=TIME_S
    )
    mode: str = option(
        'single: one record; normal: one record per trigger; rolling: the latest samples, until Ctrl-C',
        'MODE',
        choices=MODES,
        default='single',
    )
    records: int | None = option('number of records in mode normal', 'N', type=integer_within(1, 10_000))
    plot: str | None = option(
        'plot the record to this .png file', 'FILE', type=file_ending('.png', of='a figure')
    )
    overwrite: bool = flag_option('replace existing records')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.records is not None and self.mode != 'normal':
            return f'--records requires --mode normal, not {self.mode}'
        return super().check()

    def setting(self, channels: Sequence[str], robot: Parameters, all_of_it: bool = False) -> Setting:
        """Return the setting of the oscilloscope; raises ParameterError. ``all_of_it``: the maximum length."""
        from delta3_pacdrive.recording.acquisition import SAMPLES_MAX, setting

        longest = all_of_it and self.trigger is None
        usual = SAMPLES_MAX / self.rate * 0.999 if longest else DURATION_S

        return setting(
            robot,
            channels,
            self.rate,
            usual if self.duration is None else self.duration,
            self.trigger,
            level=self.level or 0.0,
            edge=self.edge,
            pre_trigger_s=self.pre_trigger or 0.0,
            mode=self.mode,
            records=self.records or 0,
        )


class Records:
    """Writes the records of an oscilloscope as they arrive.

    Parameters
    ----------
    output
        File of the record; in mode normal each record appends its number to the name.
    origin
        Provenance stored in the files.

    Raises
    ------
    TraceError
        A file cannot be written, or exists.

    """

    def __init__(self, options: ScopeOptions, output: str, origin: Provenance) -> None:
        from delta3_pacdrive.errors import TraceError
        from delta3_pacdrive.recording.tables import column_table

        self._options, self._output, self._origin = options, output, origin
        self._several = options.mode == 'normal'
        self.written: list[dict[str, Any]] = []  # description and files of each record
        self.taken: list[tuple[Path, Record]] = []
        column_table.require_writable(output, 'record')
        for path in filter(None, (output, options.plot)):
            first = self._named(path, 1)
            if first.exists() and first.is_file() and not options.overwrite:
                raise TraceError(f'cannot write record {first}: it exists; --overwrite replaces it')

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
            from delta3_pacdrive.studies.runs.scope_figure import draw

            files.append(str(draw(record, self._named(self._options.plot, number), self._origin)))
        self.written.append(records.metadata(record) | {'files': files})
        self.taken.append((path, record))

    def sentences(self) -> list[str]:
        """Return one sentence for each written record."""
        return [
            f'oscilloscope: {row["samples"]} samples of {len(row["channels"])} channels at {row["rate_hz"]:g} Hz'
            + (f', trigger at {row["trigger_time_s"]:.6f} s' if row['trigger_time_s'] is not None else '')
            + f': {", ".join(row["files"])}'
            for row in self.written
        ]
