"""Report folder of a run: figures of its signals and of the records of the drives' oscilloscopes."""

from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import record_file, trace_csv, trace_file
from delta3_pacdrive.recording.acquisition import Record
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.report_folder import ReportFolder, Table
from delta3_pacdrive.studies.runs import run_figures, scope_figure

SIGNALS, RECORDS, FIGURE = 'signals.csv', 'oscilloscope_records.csv', 'oscilloscope.png'

Kept = tuple[Path, Record]  # file and record


def write(folder: ReportFolder, trace: Trace, records: Sequence[Kept], text: Iterable[str] = ()) -> None:
    """Write the figures and signals of a run, figures of its records, and the page with the lines ``text``.

    The folder already contains the files of the records.

    Raises
    ------
    Delta3Error
        Something cannot be drawn or written.

    """
    # a run stopped before its program start has no figures
    with suppress(TraceError) if trace.meta.get('stopped') else nullcontext():
        run_figures.draw(trace, folder)
    signals = folder.path / SIGNALS
    trace_file.save(trace, signals)
    folder.add(trace_csv.metadata_path(signals))
    folder.add(signals)
    add_records(folder, records)
    folder.page(f'Run of {trace.meta.get("program", "a program")}', text)


def add_records(folder: ReportFolder, records: Sequence[Kept]) -> None:
    """Add figure and file of each record, and a table with one row per record; raises Delta3Error."""
    rows = []
    for number, (path, record) in enumerate(records, start=1):
        name = str(record_file.numbered(FIGURE, number)) if len(records) > 1 else FIGURE
        folder.figures({name: partial(scope_figure.figure_of, record)}, with_foot=True)
        folder.add(path)
        facts = record_file.metadata(record)
        rows.append(
            {
                'record': path.name,
                'figure': name,
                'channels': ' '.join(facts['channels']),
                'samples': facts['samples'],
                'rate [Hz]': facts['rate_hz'],
                'first sample [s]': facts['time_s'],
                'trigger': facts['trigger'],
                'seen [s]': facts['trigger_time_s'],
            }
        )
    if rows:
        folder.table(Table.of_rows(RECORDS, rows))
