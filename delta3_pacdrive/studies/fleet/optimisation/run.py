"""Optimisation study: runs rounds of trials, reuses existing ones, writes the best trial and the report."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive import simulation
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.parameters import from_flat
from delta3_pacdrive.studies.fleet.optimisation import figures, report, specification
from delta3_pacdrive.studies.fleet.optimisation.design import BASE, Optimisation, Trial, Trials
from delta3_pacdrive.studies.fleet.optimisation.search import NEEDED, Search, base_values, trial_of
from delta3_pacdrive.studies.fleet.optimisation.study import Results
from delta3_pacdrive.studies.fleet.sweep import engine, store
from delta3_pacdrive.studies.fleet.sweep.run import require_engine
from delta3_pacdrive.studies.fleet.sweep.single_run import Row, Runner
from delta3_pacdrive.studies.fleet.sweep.study import Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance, os_errors_as
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests

PARAMETERS, PROGRAM = 'best_parameters.yaml', 'best_program.yaml'


@dataclass
class Study(studies.Study):
    """Optimisation study in a folder; existing trials are reused."""

    settings: Settings
    optimisation: Optimisation = field(init=False)
    kept: int = field(init=False, default=0)  # trials on disk

    def __post_init__(self) -> None:
        """Read the optimisation; raises Delta3Error."""
        require_engine()
        require_optuna()
        self.optimisation = specification.load(self.settings.specification)

    def unfinished(self) -> str:
        """Return the message after an interrupt, with the number of runs on disk."""
        return f'interrupted: {self.kept} runs are in {self.folder}; the same command continues'

    def run(self) -> dict[str, Any]:
        """Run the missing trials, write all results and return the report; raises Delta3Error."""
        sweep, search = self.optimisation.sweep, Search(self.optimisation)
        kept = store.Store(self.folder, sweep)
        rows = kept.open()
        self.kept = len(rows)
        maker = _Maker(self, kept, rows)
        trials: list[Trial] = []
        with ExitStack() as stack:
            maker.stack = stack
            if not search.begins_with_base:
                maker.make([(BASE, {})])
            for asked in search.rounds():
                maker.make(asked)
                done = [trial_of(self.optimisation, number, values, rows[number]) for number, values in asked]
                search.report(done)
                trials += done
                self._show(trials, search)
        self.on_progress('tables and figures', 0, 0)
        table = kept.finish(rows.values())
        base = trials[0] if search.begins_with_base else trial_of(self.optimisation, BASE, {}, rows[BASE])
        base = replace(base, values=base_values(self.optimisation))
        found = Trials(self.optimisation, base, trials, search.importance())
        folder = ReportFolder(self.folder, self._provenance())
        folder.clear([*report.TABLES, *figures.file_names(), PARAMETERS, PROGRAM])
        folder.add(table)
        best = self._best(found, folder)
        results = Results(found, maker.seconds, maker.made, maker.workers, best)
        document = report.summary(results)
        return folder.results(
            f'Optimisation {sweep.name}',
            document,
            report.text(document),
            report.tables(found),
            figures.by_name(found),
        )

    def _show(self, trials: Sequence[Trial], search: Search) -> None:
        found = Trials(self.optimisation, trials[0], trials, {})
        best = found.best
        suffix = f', best {found.value(best):.5g}' if best else ''
        self.on_progress(f'trials{suffix}', len(trials), self.optimisation.sweep.runs)

    def _best(self, found: Trials, folder: ReportFolder) -> tuple[Path, ...]:
        """Write parameters and program of the best trial; return their files."""
        if found.best is None:
            return ()
        runner, files = Runner(self.optimisation.sweep), (self.folder / PARAMETERS, self.folder / PROGRAM)
        head = [
            f'trial {found.best.number} of optimisation {self.optimisation.sweep.name}: '
            f'{self.optimisation.goal} {found.value(found.best):.6g}',
            f'made by: {self.command}',
        ]
        with os_errors_as(f'cannot write to {self.folder}', SweepError):
            core.write(runner.made(found.best.values)[0], files[0], head)
            yaml_file.write(files[1], runner.document(found.best.values), head)
        for path in files:
            folder.add(path)
        return files

    def _provenance(self) -> Provenance:
        sweep = self.optimisation.sweep
        inputs = [f'optimisation {sweep.digest}', *with_digests([str(self.settings.specification)])]
        return Provenance.of(
            self.command, from_flat(dict(sweep.parameters)), 'base of the optimisation', inputs, sweep.seed
        )


@dataclass
class _Maker:
    """Makes missing runs; its workers start with the first of them."""

    study: Study
    store: store.Store
    rows: dict[int, Row]
    stack: ExitStack = field(default_factory=ExitStack)
    client: Any = None
    workers: int = 0
    made: int = 0
    seconds: float = 0.0

    def make(self, asked: Sequence[tuple[int, dict[str, Any]]]) -> None:
        """Make the missing runs of a round; raises SweepError."""
        missing = [(number, values) for number, values in asked if number not in self.rows]
        for number, values in asked:
            if number in self.rows:
                self._require_same(number, values)
        if not missing:
            return
        if self.client is None:
            self._begin()
        started = time.monotonic()
        engine.make(self.client, self.study.optimisation.sweep, [[one] for one in missing], self._keep)
        self.seconds += time.monotonic() - started

    def _begin(self) -> None:
        settings, sweep = self.study.settings, self.study.optimisation.sweep
        simulation.load_kernels(from_flat(dict(sweep.parameters)))
        self.study.on_progress('workers start', 0, 0)
        self.client = self.stack.enter_context(engine.cluster(settings.workers, settings.scheduler))
        self.workers = engine.workers_of(self.client)

    def _keep(self, batch: list[Row]) -> None:
        self.store.add(batch)
        self.rows.update((row['run'], row) for row in batch)
        self.made += len(batch)
        self.study.kept = len(self.rows)

    def _require_same(self, number: int, values: dict[str, Any]) -> None:
        row = self.rows[number]
        if any(row.get(name) != value for name, value in engine.to_row(values).items()):
            raise SweepError(
                f'trial {number} in {self.study.folder} has other values than those of this search: choose another '
                '--output, or remove the folder'
            )


def require_optuna() -> None:
    """Reject optimisations if optuna is not installed; raises SweepError."""
    import importlib.util

    if importlib.util.find_spec('optuna') is None:
        raise SweepError(NEEDED)
