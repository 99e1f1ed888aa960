"""Tuning study: loops before and after a change, workspace, program, sweep, recording."""

from dataclasses import dataclass, field
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import RunError, TuningError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.recording.trace_file import load as load_trace
from delta3_pacdrive.studies.drives.loops.analysis import (
    EXCHANGED,
    LOOPS,
    LoopResult,
    OperatingPoint,
    analyse,
    exact_shaft,
    exchanged_shaft,
    linear_cascade_loop,
    linear_loop,
    step_on_bench,
)
from delta3_pacdrive.studies.drives.loops.disturbance import rejection
from delta3_pacdrive.studies.drives.loops.loops import Entry, linear_cascade
from delta3_pacdrive.studies.drives.loops.tuned_drive import tuned_drive
from delta3_pacdrive.studies.drives.tuning import drive_settings as settings
from delta3_pacdrive.studies.drives.tuning import effect, figures, gains, measured_response, report
from delta3_pacdrive.studies.drives.tuning.drive_settings import Setting
from delta3_pacdrive.studies.drives.tuning.measured_response import MeasuredResponse
from delta3_pacdrive.studies.drives.tuning.proposal import Targets, propose
from delta3_pacdrive.studies.drives.tuning.study import Results, Settings, SweepPoint, Variant
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.runs.inputs import with_digests

TABLE_POINTS = 300  # frequencies of a linear loop if only its margins are needed
SPEED_MAX_RAD_S = 20.0  # of the bench; its longest run fits into the travel


@dataclass
class Study(studies.Study):
    """Tuning study in a report folder; the constructor raises Delta3Error for invalid settings."""

    settings: Settings
    robot: Parameters = field(init=False)
    operation: OperatingPoint = field(init=False)
    program: Program = field(init=False)  # program that shows the effect

    def __post_init__(self) -> None:
        """Read the parameters and check everything that requires no computation."""
        chosen = self.settings
        self.robot = robot_of(chosen)
        self._drive = tuned_drive(chosen.axis, self.robot)
        self.operation = OperatingPoint(
            self._drive.load(chosen.pose_m, self.robot), chosen.speed_rad_s, chosen.amplitude
        )
        margins = {'phase_deg': chosen.phase_margin_deg, 'gain_db': chosen.gain_margin_db}
        self._margins_given = {name: value for name, value in margins.items() if value is not None}
        self._targets = Targets(**self._margins_given) if chosen.auto else None
        self._changes = [settings.parse(text, chosen.axis) for text in chosen.changes]
        self._changed = settings.apply(self._changes, self.robot)
        self._sweep = settings.parse_sweep(chosen.sweep, chosen.axis) if chosen.sweep else ()
        for setting in self._sweep:
            setting.apply(self._changed)
        self._loads = (self.operation.load, *self._drive.extremes(self.robot))
        self.program = self._drive.program(chosen.program, self.robot)

    def run(self) -> dict[str, Any]:
        """Run the study, write its results to the folder and return the report; raises Delta3Error."""
        chosen = self.settings
        inputs = with_digests(
            name for name in (chosen.program or self._drive.usual_program, chosen.recording) if name
        )
        folder = ReportFolder(self.folder, Provenance.of(self.command, self.robot, chosen.parameters, inputs))
        folder.make()
        measured = self.measured()
        proposal = None
        if self._targets is not None:
            proposal = propose(
                self.robot, self._targets, chosen.speed_rad_s, chosen.payload_kg, self.on_progress
            )
            self._changed = proposal.robot
            folder.clear([gains.FILE])
        compared = bool(self._changes or proposal)
        robots = {'before': self.robot, 'after': self._changed} if compared else {'now': self.robot}
        variants = {name: self.variant(robot, name if compared else '') for name, robot in robots.items()}
        points = [self.sweep_point(setting, number) for number, setting in enumerate(self._sweep)]
        self.on_progress('tables and figures', 0, 0)
        swept = self._sweep[0].name if self._sweep else ''
        by_loop: dict[str, dict[str, LoopResult]] = {}
        for name, variant in variants.items():
            for loop in variant.loops:
                by_loop.setdefault(loop.name, {})[name] = loop
        found = Results(
            operation=self.operation,
            program=self.program.name,
            variants=variants,
            by_loop=by_loop,
            swept=swept,
            points=points,
            measured=measured,
            proposal=proposal,
            margins_given=bool(self._margins_given),
        )
        document, drawings = report.summary(found), figures.by_name(found)
        if proposal is not None and document['proposal']['proposed']:
            path = folder.path / gains.FILE
            gains.write(proposal.gains, proposal.kept_text, path, folder.provenance)
            folder.add(folder.path / gains.FILE)
        text, tables = report.text(document), report.tables(found)
        return folder.results('Tuning of the drives', document, text, tables, drawings)

    def variant(self, robot: Parameters, which: str) -> Variant:
        """Return loops, margins over the workspace and effect on the program with one set of gains."""
        label = f'{which}: ' if which else ''
        own = self._drive.in_loops(robot)
        loops = analyse(
            own, self.operation, lambda stage, done, total: self.on_progress(label + stage, done, total)
        )
        self.on_progress(f'{label}workspace', 0, 0)
        speed = self.operation.speed_rad_s
        workspace = []
        for load in self._loads:
            exact, exchanged = exact_shaft(own, load, speed), exchanged_shaft(own, load, speed)
            loops_there = [
                *(linear_loop(loop, own, OperatingPoint(load, speed), TABLE_POINTS) for loop in LOOPS[1:]),
                linear_cascade_loop(own, exact, TABLE_POINTS),
                linear_cascade_loop(own, exchanged, TABLE_POINTS, EXCHANGED),
            ]
            workspace.append((load, loops_there))
        self.on_progress(f'{label}program {self.program.name}', 0, 0)
        disturbed = rejection(own, exchanged_shaft(own, self.operation.load, speed))
        return Variant(robot, loops, workspace, effect.run(self.program, robot, self._drive), disturbed)

    def sweep_point(self, setting: Setting, number: int) -> SweepPoint:
        """Return the results for one value of the sweep."""
        self.on_progress(f'sweep: {setting.text}', number, len(self._sweep))
        robot = setting.apply(self._changed)
        own = self._drive.in_loops(robot)
        overshoot: dict[str, float | None] = {}
        for loop in LOOPS:
            try:
                overshoot[loop.name] = step_on_bench(loop, own, self.operation).figures.overshoot
            except RunError:
                overshoot[loop.name] = None
        loops = [linear_loop(loop, own, self.operation, TABLE_POINTS) for loop in LOOPS]
        shafts = [exchanged_shaft(own, load, self.operation.speed_rad_s) for load in self._loads]
        exchanged = all(linear_cascade(own, shaft, Entry.CURRENT).is_stable() for shaft in shafts)
        shown = effect.run(self.program, robot, self._drive)
        return SweepPoint(setting.value, loops, overshoot, exchanged, shown)

    def measured(self) -> list[MeasuredResponse]:
        """Return the responses of the recording, if any; raises TraceError, TuningError, EstimationError."""
        if self.settings.recording is None:
            return []
        self.on_progress('reading', 0, 0)
        trace = load_trace(self.settings.recording)
        return measured_response.identify(trace, self.settings.axis, self.robot, self.operation)


def robot_of(chosen: Settings) -> Parameters:
    """Return the parameters given by settings and check the settings of the operation; raises Delta3Error."""
    robot = core.load(chosen.parameters)
    if chosen.exchange_period_s is not None:
        robot = robot.replace(bus__exchange_period_s=chosen.exchange_period_s)
    if chosen.payload_kg is not None:
        if not 0.0 <= chosen.payload_kg <= core.PAYLOAD_MAX_KG:
            raise TuningError(
                f'the payload is {chosen.payload_kg:g} kg, but must be between 0 and {core.PAYLOAD_MAX_KG:g} kg'
            )
        robot = robot.replace(dynamics__payload_mass_kg=chosen.payload_kg)
    if not 0.0 <= chosen.speed_rad_s <= SPEED_MAX_RAD_S:
        raise TuningError(
            f'the speed of the bench is {chosen.speed_rad_s:g} rad/s, but must be between 0 and {SPEED_MAX_RAD_S:g}'
        )
    if not 1e-3 <= chosen.amplitude <= 100.0:
        raise TuningError(f'the amplitude is {chosen.amplitude:g}, but must be between 0.001 and 100')
    return robot
