"""``delta3 plot``: draw the figures of the thesis for a bag or a trace."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.command import Command, argument, option
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.run_options import WindowOptions
from delta3_pacdrive.recording.signals import (
    CURRENT_SIGNALS,
    DERIVED_SIGNALS,
    OF_DRIVES,
    REQUESTED_SIGNALS,
    ROTARY_SIGNALS,
    SIGNALS,
    SUPPLY_SIGNALS,
    THERMAL_SIGNALS,
    TORQUE_SIGNALS,
    TRUE_SIGNALS,
)

if TYPE_CHECKING:
    from delta3_pacdrive.recording.trace import Trace

KNOWN = (
    SIGNALS
    | TORQUE_SIGNALS
    | CURRENT_SIGNALS
    | TRUE_SIGNALS
    | SUPPLY_SIGNALS
    | THERMAL_SIGNALS
    | ROTARY_SIGNALS
    | DERIVED_SIGNALS
    | REQUESTED_SIGNALS
)


def _signals(text: str) -> list[str]:
    names = [name.strip() for name in text.split(',') if name.strip()]
    for name in names:
        if name not in KNOWN and not name.startswith(OF_DRIVES):
            raise argparse.ArgumentTypeError(f'unknown signal {name!r}, expected some of {", ".join(KNOWN)}')
    if not names:
        raise argparse.ArgumentTypeError('at least one signal is required')
    return list(dict.fromkeys(names))


@dataclass
class Options(WindowOptions):
    """Options of the command."""

    recording: str = argument('bag (folder, .mcap, .db3), trace (.npz) or table (.csv, .parquet, .mat)')
    output: str = option('folder for the figures and their data', 'DIR', default='figures')
    signals: list[str] | None = option(
        'plot only these signals, such as current,tcp_error: ' + ', '.join(KNOWN),
        'NAMES',
        type=_signals,
    )
    parameters: str | None = option('parameter file of the robot of a table', 'FILE')
    columns: str | None = option('column file that maps the columns of a table to signals', 'FILE')


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.recording import trace_csv, trace_file
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import ReportFolder
    from delta3_pacdrive.studies.runs import derived_signals, run_figures, run_signals, runs, trace_export
    from delta3_pacdrive.studies.runs.inputs import with_digests

    trace, kind, _, assumed = runs.recorded(options.recording, options.parameters, options.columns)
    notes = [*runs.notes_of(trace), *([assumed] if kind == runs.TABLE else [])]
    trace = derived_signals.added(trace)
    origin_s = float(trace.meta.get('origin_s', 0.0))
    if origin_s:
        notes.append(f'Times in the figures count from the first row, at {origin_s:.9g} s')
    if options.signals:
        trace_export.require_known(options.signals)
        trace = trace_export.completed(trace, options.signals)
    starts = trace.meta.get('starts')
    starts = [start for start in starts if isinstance(start, int)] if isinstance(starts, list) else []
    if len(starts) > 1 and 'cycle_time_s' in trace.meta:
        first = run_signals.noted_cycle(trace, 'start_cycle') or 0
        period = run_signals.positive(trace, 'cycle_time_s')
        times = ', '.join(f'{(start - first) * period:g}' for start in starts)
        print(f'note: programs started at {times} s; select a window with --from and --to', file=sys.stderr)
    windowed = options.from_s is not None or options.to_s is not None
    if windowed:
        edges = (None if edge is None else edge - origin_s for edge in (options.from_s, options.to_s))
        trace = run_signals.windowed(trace, *edges)
    # a recording contains its parameters
    origin = Provenance.of(options.command_line, inputs=with_digests([options.recording]))
    origin = replace(origin, parameters=str(trace.meta.get('checksum', 'unknown')))
    folder = ReportFolder(Path(options.output), origin)
    run_figures.draw(trace, folder, options.signals)
    trace.meta['plotted'] = origin.lines()
    data = folder.path / 'signals.csv'
    trace_file.save(_written(trace, windowed, options.signals), data)
    folder.add(trace_csv.metadata_path(data))
    folder.add(data)
    folder.page(f'Figures of {options.recording}')
    result = {'ok': True, 'files': folder.files, 'notes': notes, 'provenance': origin.lines()}
    return Output(result, folder.files, notes=[f'note: {note}' for note in notes])


def _written(trace: 'Trace', windowed: bool, signals: Sequence[str] | None) -> 'Trace':
    """Return the data of the figures in bus time: all signals, or the selected ones."""
    from delta3_pacdrive.studies.runs import run_signals

    rows = slice(None)
    if windowed:
        first, last = (edge * trace.meta['cycle_time_s'] for edge in run_signals.shown_cycles(trace))
        half = trace.meta['cycle_time_s'] / 2.0
        rows = slice(*trace.time_s.searchsorted([first - half, last + half]).tolist())
    chosen = {name: trace[name][rows] for name in signals or trace.signals}
    return type(trace)(trace.time_s[rows] + float(trace.meta.get('origin_s', 0.0)), chosen, trace.meta)


main = Command(
    'plot', 'Plot TCP path, arm angles, velocities, accelerations, currents and TCP error.', Options, run
)
