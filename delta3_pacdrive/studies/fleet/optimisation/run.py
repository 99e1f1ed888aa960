"""Optimisation study: runs rounds of trials, reuses existing ones, writes the best trial and the report."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.parameters import from_flat
from delta3_pacdrive.studies.fleet.optimisation import figures, report, specification
from delta3_pacdrive.studies.fleet.optimisation.search import NEEDED, Search, base_values, trial_of
from delta3_pacdrive.studies.fleet.optimisation.study import BASE, Optimisation, Results, Trial, Trials
from delta3_pacdrive.studies.fleet.sweep import engine, store
from delta3_pacdrive.studies.fleet.sweep.run import require_engine
from delta3_pacdrive.studies.fleet.sweep.single_run import Runner
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
    maker: engine.RunMaker | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Read the optimisation; raises Delta3Error."""
        require_engine()
        require_optuna()
        self.optimisation = specification.load(self.settings.specification)

    @property
    def kept(self) -> int:
        """Number of runs on disk."""
        return 0 if self.maker is None else len(self.maker.rows)

    def unfinished(self) -> str:
        """Return the message after an interrupt, with the number of runs on disk."""
        return f'interrupted: {self.kept} runs are in {self.folder}; the same command continues'

    def run(self) -> dict[str, Any]:
        """Run the missing trials, write all results and return the report; raises Delta3Error."""
        sweep, search = self.optimisation.sweep, Search(self.optimisation)
        kept = store.Store(self.folder, sweep)
        trials: list[Trial] = []
        with engine.RunMaker(sweep, kept, self.settings, self.on_progress) as maker:
            self.maker, rows = maker, maker.rows
            if not search.begins_with_base:
                self._make([(BASE, {})], maker)
            for asked in search.rounds():
                self._make(asked, maker)
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

    def _make(self, asked: Sequence[tuple[int, dict[str, Any]]], maker: engine.RunMaker) -> None:
        """Make the missing runs of a round; raises SweepError if a stored run has other values."""
        for number, values in asked:
            row = maker.rows.get(number)
            if row and any(row.get(name) != value for name, value in engine.to_row(values).items()):
                raise SweepError(
                    f'trial {number} in {self.folder} has other values than those of this search: choose another '
                    '--output, or remove the folder'
                )
        if missing := [[one] for one in asked if one[0] not in maker.rows]:
            maker.make(missing)

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


def require_optuna() -> None:
    """Reject optimisations if optuna is not installed; raises SweepError."""
    import importlib.util

    if importlib.util.find_spec('optuna') is None:
        raise SweepError(NEEDED)
