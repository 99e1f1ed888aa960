"""Ripple study: runs all cycle times with all interpolations with oscilloscopes; writes table and figures."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.studies.drives.ripple import figures, report
from delta3_pacdrive.studies.drives.ripple.study import JERK_FROM_HZ, Case, Results, Samples, Settings
from delta3_pacdrive.studies.framework import study as studies
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from delta3_pacdrive.studies.framework.study import OnProgress
from delta3_pacdrive.studies.runs import oscilloscope as oscilloscope_run
from delta3_pacdrive.studies.runs.inputs import with_digests
from delta3_pacdrive.studies.runs.oscilloscope import Recorded
from delta3_pacdrive.studies.runs.run_signals import AFTER_S

LEFT = ('reference', 'speed_reference', 'current_reference', 'motor_current')


def measure(program: Program, robot: Parameters, axis: int, on_progress: OnProgress) -> Case:
    """Run a program and compute the figures from its start until shortly after its end.

    Raises
    ------
    ProgramError
        The program is rejected.
    RunError
        A drive has no torque, or loses it.

    """
    bus, drive = robot.bus, robot.drive
    stage = f'{1e3 * bus.cycle_time_s:g} ms, {drive.interpolation}'
    run = oscilloscope_run.run(program, robot, on_progress, stage, LEFT)
    start, end = run.meta['start_cycle'], run.meta['end_cycle'] + round(AFTER_S / bus.cycle_time_s)
    cycles = slice(start, min(end, len(run.answers)))
    rows = slice(cycles.start * run.steps, cycles.stop * run.steps)
    at_current = run.answers[cycles, 2] / robot.motor.torque_constant_n_m_a
    current = run.scope.left['motor_current'][rows]
    error = np.linalg.norm(run.tcp_error[cycles], axis=1)
    return Case(
        cycle_time_s=bus.cycle_time_s,
        interpolation=drive.interpolation,
        axis=(1, 2, 3),
        set_point_delay_s=robot.set_point_delay_cycles * bus.cycle_time_s,
        at_current_peak_a=_peak(at_current),
        at_current_rms_a=_rms(at_current).tolist(),
        current_peak_a=_peak(current),
        current_rms_a=_rms(current).tolist(),
        jerk_rad_s3=_rms(jerk(current, robot)).tolist(),
        tcp_error_max_m=float(error.max()),
        tcp_error_rms_m=float(_rms(error)),
        samples=_samples(run=run, rows=rows, cycles=cycles, at_current=at_current, axis=axis, robot=robot),
    )


def _peak(values: Floats) -> list[float]:
    peaks: list[float] = np.abs(values).max(axis=0).tolist()
    return peaks


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def jerk(current: Floats, robot: Parameters) -> Floats:
    """Jerk [rad/s^3] of an arm with mean inertia due to the torque of its motor, above ``JERK_FROM_HZ``."""
    period_s = robot.drive.current_period_s
    per_ampere = robot.motor.torque_constant_n_m_a * robot.dynamics.gear_ratio
    raw = np.diff(current, axis=0) / period_s * per_ampere / robot.drive.observer_arm_inertia_kg_m2
    spectrum = np.fft.rfft(raw, axis=0)
    spectrum[np.fft.rfftfreq(len(raw), period_s) < JERK_FROM_HZ] = 0.0
    return np.fft.irfft(spectrum, len(raw), axis=0)


def _samples(
    run: Recorded, rows: slice, cycles: slice, at_current: Floats, axis: int, robot: Parameters
) -> Samples:
    period_s, cycle_s, i = robot.drive.current_period_s, robot.bus.cycle_time_s, axis - 1
    left, found = run.scope.left, run.scope.found
    count = rows.stop - rows.start
    return Samples(
        time_s=np.arange(count) * period_s,
        set_point=left['reference'][rows, i],
        speed_reference=left['speed_reference'][rows, i],
        speed=found['speed'][rows, i],
        current_reference=left['current_reference'][rows, i],
        voltage=found['voltage'][rows, i],
        current=left['motor_current'][rows, i],
        at_time_s=np.arange(cycles.stop - cycles.start) * cycle_s,
        at_current=at_current[:, i],
    )


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
