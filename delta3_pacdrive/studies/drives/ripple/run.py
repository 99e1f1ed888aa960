"""Ripple study: runs all cycle times with all interpolations; writes table and figures."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.studies.drives.ripple import figures, report
from delta3_pacdrive.studies.drives.ripple.cases import Case, measure
from delta3_pacdrive.studies.drives.ripple.study import Results, Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests


@dataclass
class Study(studies.Study):
    """Ripple study of a program."""

    settings: Settings
    robot: core.Parameters = field(init=False)
    program: Program = field(init=False)

    def __post_init__(self) -> None:
        """Read the parameters and the program; raises Delta3Error."""
        self.robot = core.load(self.settings.parameters)
        self.program = programs.load(self.settings.program, self.robot.motion)
        if self.program.faults:
            raise ProgramError(f'{self.settings.program} injects faults, which would affect the currents')

    def run(self) -> dict[str, Any]:
        """Run all cases, write all results and return the report; raises Delta3Error."""
        chosen = self.settings
        cases = tuple(
            measure(
                self.program,
                self.robot.replace(bus__cycle_time_s=cycle_time_s, drive__interpolation=interpolation),
                chosen.axis,
                self.on_progress,
            )
            for cycle_time_s in chosen.cycle_times_s
            for interpolation in chosen.interpolations
        )
        found = Results(self.program.name, chosen.axis, cases, self._shown_s(cases))
        origin = Provenance.of(self.command, self.robot, chosen.parameters, with_digests([chosen.program]))
        folder = ReportFolder(self.folder, origin)
        folder.clear([report.TABLE, 'inside_a_cycle_*.png', figures.CURRENTS])
        document = report.summary(found, chosen)
        self.on_progress('table and figures', 0, 0)
        return folder.results(
            'Ripple of the motor currents',
            document,
            report.text(document),
            report.tables(found),
            figures.by_name(found),
        )

    def _shown_s(self, cases: tuple[Case, ...]) -> float:
        """Return the start of the displayed bus cycle: as requested, or that of the largest current."""
        longest = max(case.cycle_time_s for case in cases)
        samples = cases[0].samples
        last_s = float(samples.time_s[-1])
        at_s = self.settings.at_s
        if at_s is None:
            at_s = float(samples.time_s[np.abs(samples.current).argmax()])
        elif not 0.0 <= at_s <= last_s:
            raise ProgramError(f'--at is {at_s:g} s, but the program runs from 0 to {last_s:.3f} s')
        # cycles of the slowest bus begin together with cycles of the faster ones
        return float(np.clip(np.floor(at_s / longest + 1e-6), 1, np.floor(last_s / longest) - 2)) * longest
