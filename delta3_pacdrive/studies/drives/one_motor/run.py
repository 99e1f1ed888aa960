"""Single-motor study: runs one motor; writes figures 8.2 to 8.4, table and trace."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.studies.drives.one_motor import figures, motor_run, report
from delta3_pacdrive.studies.drives.one_motor.study import Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder


@dataclass
class Study(studies.Study):
    """Single-motor study; ``inputs`` are its files with the digests of their bytes."""

    settings: Settings
    program: Program
    inputs: Sequence[str]
    robot: core.Parameters = field(init=False)

    def __post_init__(self) -> None:
        """Read the parameters; raises Delta3Error."""
        chosen = self.settings
        given = {
            'motor__load_inertia_kg_m2': chosen.load_inertia_kg_m2,
            'motor__load_torque_n_m': chosen.load_torque_n_m,
            'motor__coupling_effect': chosen.coupling_effect,
        }
        self.robot = core.load(chosen.parameters).replace(
            **{name: value for name, value in given.items() if value is not None}
        )
        if self.program.faults:
            raise ProgramError(f'{self.program.name} injects faults, which a single motor does not support')

    def run(self) -> dict[str, Any]:
        """Run the motor, write all results and return the report; raises Delta3Error."""
        chosen = self.settings
        found = motor_run.run(self.program, self.robot, chosen.axis, self.on_progress)
        origin = Provenance.of(self.command, self.robot, chosen.parameters, self.inputs)
        folder = ReportFolder(self.folder, origin)
        folder.clear([report.TABLE, 'figure_8_*.png'])
        document = report.summary(found)
        if chosen.trace:
            trace = report.trace(found)
            trace.meta['provenance'] = origin.lines()
            trace_file.save(trace, chosen.trace)
        self.on_progress('table and figures', 0, 0)
        return folder.results(
            'One motor', document, report.text(document), report.tables(found), figures.by_name(found)
        )
