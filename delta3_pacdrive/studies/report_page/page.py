"""The HTML file of a page with its style, scripts and data; it makes no network requests.

``assets/page.js`` is built from ``web/report_page`` in the sources (CONTRIBUTING.md). It contains three.js and uPlot,
whose licences are included in ``assets/LICENSES.txt`` and in the page.
"""

import json
import re
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.recording.record_file import SavedRecord
from delta3_pacdrive.studies.framework.provenance import Provenance, write_text
from delta3_pacdrive.studies.report_page import scopes
from delta3_pacdrive.studies.report_page.document import report_document
from delta3_pacdrive.studies.report_page.tables import sections
from delta3_pacdrive.studies.runs.alignment import START
from delta3_pacdrive.studies.runs.run_comparison import compare
from delta3_pacdrive.studies.runs.runs import Run, named

LONGEST_S = 300.0  # all runs together
BASE_BYTES, BYTES_PER_S = 1_000_000, 100_000  # size limit of a page, plus that per second of a run
BYTES_PER_VALUE = 4  # plus that per value of a record
COARSER, COARSEST = 4.0, 1024.0  # factor on the resolution of data that is too large, and its maximum
RUNS_MAX = 4
# signals of which a pose needs one each
POSE = {
    'TCP position': ('tcp_actual', 'tcp_command'),
    'motor angles': ('motor_position', 'motor_command'),
}


def require_writable_page(path: Path) -> None:
    """Raise ReportError if a page cannot be written; called before anything is computed."""
    if not path.is_dir() and path.suffix.lower() not in ('.html', '.htm'):
        reason = (
            'the name of a page must end in .html'  # protects a recording from being overwritten by mistake
        )
    else:
        reason = whole_file.file_refusal(path)
    if reason:
        raise ReportError(f'cannot write {path}: {reason}')


def write(
    path: Path,
    runs: Sequence[Run],
    origin: Provenance,
    how: str = START,
    records: Sequence[SavedRecord] = (),
) -> None:
    """Write the page of one or more runs, with records of the first; an existing file is replaced only on success.

    Raises
    ------
    ReportError
        There are too many runs, they are too long, a run has no pose, a record does not belong to the first run, or
        the file cannot be written.
    TraceError
        The runs cannot be compared.

    """
    write_text(page(runs, origin, how, records), path)


def page(
    runs: Sequence[Run], origin: Provenance, how: str = START, records: Sequence[SavedRecord] = ()
) -> str:
    """Return the page as text; raises as ``write`` does."""
    length_s = sum(float(run.window.time_s[-1] - run.window.time_s[0]) for run in runs)
    if len(runs) > RUNS_MAX:
        raise ReportError(f'a report takes at most {RUNS_MAX} runs, not {len(runs)}')
    if length_s > LONGEST_S:
        raise ReportError(
            f'the runs last {length_s:.0f} s, the limit of a page is {LONGEST_S:g} s: shorten them with --from and --to'
        )
    for run in runs:
        _require_pose(run)
    records = scopes.shown(runs[0], records)
    comparisons = [compare(runs[0], other, how) for other in runs[1:]]
    title = ' and '.join(dict.fromkeys(run.title for run in runs))
    tables = sections(runs, comparisons, origin, records)
    most = BASE_BYTES + BYTES_PER_S * length_s + BYTES_PER_VALUE * sum(one.values.size for one in records)
    coarser = 1.0
    while True:
        found = report_document(title, runs, comparisons, coarser, records)
        document = json.dumps(found, allow_nan=False)
        text = _assembled(title, runs, tables, document)
        if len(text.encode()) <= most or coarser >= COARSEST:
            return text
        coarser *= COARSER


def _require_pose(run: Run) -> None:
    """Raise ReportError for a run whose robot cannot be drawn."""
    for quantity, names in POSE.items():
        if not any(name in run.window.signals for name in names):
            raise ReportError(f'{run.name} cannot be shown: it has no {quantity} ({" or ".join(names)})')


def _assembled(title: str, runs: Sequence[Run], tables: str, document: str) -> str:
    files = resources.files('delta3_pacdrive.studies.report_page') / 'assets'
    names = named(runs)
    labels = [f'{run.kind} {name}' for name, run in zip(names, runs, strict=True)]
    parts = {
        'title': escape(title),
        'runs': ''.join(f'<li class="run run{n}">{escape(text)}</li>' for n, text in enumerate(labels)),
        'style': (files / 'page.css').read_text(encoding='utf-8'),
        'tables': tables,
        # must not close its element, nor keep it open as <!--<script> does
        'document': document.replace('<', '\\u003c'),
        'licences': escape((files / 'LICENSES.txt').read_text(encoding='utf-8')),
        'script': (files / 'page.js').read_text(encoding='utf-8'),
    }
    template = (files / 'page.html').read_text(encoding='utf-8')
    return re.sub(r'{{(\w+)}}', lambda found: parts[found[1]], template)
