"""Study of a line: tables of cycle times, simulation of the shift, report."""

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import expected
from delta3_pacdrive.errors import LineError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.fleet.line import figures, report, shift, specification
from delta3_pacdrive.studies.fleet.line import shift as parts
from delta3_pacdrive.studies.fleet.line.cycle_times import CycleTable, Station
from delta3_pacdrive.studies.fleet.line.design import Line
from delta3_pacdrive.studies.fleet.line.report import MINUTE_S
from delta3_pacdrive.studies.fleet.line.shift import BeltShift
from delta3_pacdrive.studies.fleet.line.study import Check, Results, Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests

ERROR_MAX_S = 2e-3  # of a tabulated cycle time


def check(table: CycleTable, plans: int, seed: int) -> Floats:
    """Return the errors of tabulated cycle times against plans of the same random cycles [s]."""
    draw = np.random.default_rng(seed)
    spread = table.station.belt.spread_m
    across = draw.uniform(-spread, spread, plans)
    earliest, latest = table.starts_m(across)
    part = draw.uniform(earliest, np.maximum(earliest, latest))
    planned = np.array([table.station.cycle_s(float(y), float(p)) for y, p in zip(across, part, strict=True)])
    off: Floats = table.cycles_s(across, part) - planned
    return off


@dataclass
class Study(studies.Study):
    """Study of one shift of a line."""

    settings: Settings
    line: Line = field(init=False)
    results: Results | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Read the specification of the line; raises Delta3Error."""
        settings, self.line = self.settings, specification.load(self.settings.specification)
        line = self.line
        self.line = replace(
            line,
            rule=line.rule if settings.rule is None else settings.rule,
            seed=line.seed if settings.seed is None else settings.seed,
            hours=line.hours if settings.hours is None else settings.hours,
        )

    def run(self) -> dict[str, Any]:
        """Simulate the shift, write the results to the folder and return the report; raises Delta3Error."""
        results = self.results = self.simulated()
        folder = ReportFolder(self.folder, self._provenance())
        folder.clear([*report.TABLES, figures.ROBOTS, figures.MINUTES])
        document = report.summary(results)
        return folder.results(
            f'Line {self.line.name}',
            document,
            report.text(document),
            report.tables(results),
            figures.by_name(results),
        )

    def simulated(self) -> Results:
        """Simulate the shift; raises LineError."""
        tables = self._tables()
        check = self._checked([table for rows in tables.values() for row in rows for table in row])
        start = time.monotonic()
        belts = tuple(
            shift.simulate(
                self.line, belt, parts.of_belt(self.line, belt), tables[belt.name], self.on_progress
            )
            for belt in self.line.belts
            if tables[belt.name]
        )
        return Results(self.line, belts, check, time.monotonic() - start)

    def require_minute(self, minute: int, robot: str | None) -> None:
        """Raise LineError if a minute of this robot, or without one of the common DC link, cannot be replayed."""
        names = [one.name for one in self.line.robots]
        if robot is not None and robot not in names:
            raise LineError(f'unknown robot {shown(robot)}, {expected(robot, names)}')
        if robot is None and not self.line.parameters.supply.enabled:
            raise LineError(
                'supply.enabled of the robots is false, but --common-supply needs a model of the DC link: choose '
                'parameters like model+supply in the line file'
            )
        if MINUTE_S * (minute - 1) >= self.line.shift_s:
            raise LineError(f'minute is {minute}, but the shift ends after {self.line.shift_s / MINUTE_S:g}')

    def belt_of(self, robot: str) -> BeltShift:
        """Return the results for the belt of a robot; the study must have run."""
        belts = () if self.results is None else self.results.belts
        return next(belt for belt in belts if robot in belt.robots)

    def _tables(self) -> dict[str, list[list[CycleTable]]]:
        """Return the tables by belt, one for each robot and type of parts."""
        line, made = self.line, {}
        for belt in line.belts:
            rows = []
            for robot in line.robots_of(belt.name):
                self.on_progress(f'cycles of {robot.name}', 0, 0)
                rows.append([CycleTable(Station(line, belt, robot, kind)) for kind in line.kinds])
            made[belt.name] = rows
        return made

    def _checked(self, tables: list[CycleTable]) -> Check:
        """Check random cycles of all tables against plans; raises LineError if an error is too large."""
        plans = self.settings.plans
        worst = 0.0
        for number, table in enumerate(tables):
            self.on_progress('plans for comparison', number * plans // len(tables), plans)
            own = (number + 1) * plans // len(tables) - number * plans // len(tables)
            if own:
                worst = max(worst, float(np.abs(check(table, own, self.line.seed)).max()))
        if worst > ERROR_MAX_S:
            raise LineError(
                f'the tables of cycle times deviate by {1e3 * worst:.2f} ms from plans, but must be within '
                f'{1e3 * ERROR_MAX_S:g} ms'
            )
        return Check(plans, worst)

    def _provenance(self) -> Provenance:
        line = self.line
        inputs = with_digests([str(self.settings.specification)])
        return Provenance.of(self.command, line.parameters, 'parameters of the line', inputs, line.seed)
