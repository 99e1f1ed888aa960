"""Sweep study: reuses existing runs, makes the missing ones, and writes table, figures and report."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import from_flat
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.fleet.sweep import engine, figures, report, specification, store
from delta3_pacdrive.studies.fleet.sweep.sampling import values_of
from delta3_pacdrive.studies.fleet.sweep.single_run import Row, Runner
from delta3_pacdrive.studies.fleet.sweep.study import Outcome, Results, Runs, Settings, Sweep
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests

TRIED = 3  # runs of a dry run
ROW_BYTES = 16  # approximate size of a number in parts and tables
HEAD = ('run', 'outcome', 'reason')


@dataclass
class Study(studies.Study):
    """Sweep study in a folder; existing runs of the same sweep are reused."""

    settings: Settings
    sweep: Sweep = field(init=False)
    values: dict[str, NDArray[Any]] = field(init=False)
    maker: engine.RunMaker | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Read the sweep and draw its values; raises Delta3Error."""
        require_engine()
        self.sweep = specification.load(self.settings.specification)
        self.values = values_of(self.sweep)

    @property
    def kept(self) -> int:
        """Number of runs on disk."""
        return 0 if self.maker is None else len(self.maker.rows)

    def unfinished(self) -> str:
        """Return the message after an interrupt, with the number of runs on disk."""
        return f'interrupted: {self.kept} of {self.sweep.runs} runs are in {self.folder}; the same command continues'

    def run(self) -> dict[str, Any]:
        """Make the missing runs, write all results and return the report; raises Delta3Error."""
        kept = store.Store(self.folder, self.sweep)
        with engine.RunMaker(self.sweep, kept, self.settings, self.on_progress) as self.maker:
            rows = self.maker.rows
            missing = [number for number in range(1, self.sweep.runs + 1) if number not in rows]
            if missing:
                self.maker.make(engine.work_of(self.sweep, self.values, missing))
        self.on_progress('tables and figures', 0, 0)
        table = kept.finish(rows.values())
        found = runs_of(self.sweep, self.values, rows)
        folder = ReportFolder(self.folder, self._provenance())
        folder.clear([*report.TABLES, *figures.file_names()])
        folder.add(table)
        specification_name = str(self.settings.specification)
        seconds = self.maker.seconds if missing else float('nan')
        results = Results(found, seconds, len(missing), self.maker.workers)
        document = report.summary(results, specification_name)
        return folder.results(
            f'Sweep {self.sweep.name}',
            document,
            report.text(document),
            report.tables(found, specification_name),
            figures.by_name(found),
        )

    def dry_run(self) -> dict[str, Any]:
        """Make a few runs; return the number of runs, the time on one core, and the disk space."""
        kept = store.Store(self.folder, self.sweep).open() if (self.folder / store.MANIFEST).exists() else {}
        runner, numbers, seconds = Runner(self.sweep), 1, []
        for number in range(1, min(TRIED, self.sweep.runs) + 1):
            start = time.process_time()
            row = runner.run(number, engine.values_in(self.values, number))
            seconds.append(time.process_time() - start)
            numbers = max(numbers, len(row))
        left = self.sweep.runs - len(kept)
        each_s = float(np.median(seconds))
        return {
            'ok': True,
            'sweep': self.sweep.name,
            'runs': self.sweep.runs,
            'runs_made': len(kept),
            'seconds_a_run': each_s,
            'core_seconds': each_s * left,
            'disk_bytes': self.sweep.runs * ROW_BYTES * (numbers + len(self.values)),
        }

    def again(self, number: int) -> Trace:
        """Repeat a run and return its trace with all signals; raises Delta3Error."""
        if not 1 <= number <= self.sweep.runs:
            raise SweepError(f'run is {number}, but the sweep has runs 1 to {self.sweep.runs}')
        runner = Runner(self.sweep)
        return runner.traced(*runner.made(engine.values_in(self.values, number)))

    def _provenance(self) -> Provenance:
        robot = from_flat(dict(self.sweep.parameters))
        inputs = [f'sweep {self.sweep.digest}', *with_digests([str(self.settings.specification)])]
        return Provenance.of(self.command, robot, 'base of the sweep', inputs, self.sweep.seed)


def require_engine() -> None:
    """Reject sweeps if their libraries are not installed; raises SweepError."""
    import importlib.util

    if any(importlib.util.find_spec(name) is None for name in ('dask', 'distributed', 'pyarrow')):
        raise SweepError(store.NEEDED)


def runs_of(sweep: Sweep, values: Mapping[str, NDArray[Any]], rows: Mapping[int, Row]) -> Runs:
    """Return the table of all runs."""
    ordered = [rows[number] for number in range(1, sweep.runs + 1)]
    names = dict.fromkeys(name for row in ordered for name in row)
    kept = {name: _numbers(ordered, name) for name in names if name not in HEAD and name not in values}
    outcomes = [Outcome(row['outcome']) for row in ordered]
    return Runs(sweep, values, kept, outcomes, [row['reason'] for row in ordered])


def _numbers(rows: list[Row], name: str) -> Floats:
    found = [row.get(name) for row in rows]
    return np.array([np.nan if value is None else value for value in found], dtype=np.float64)
