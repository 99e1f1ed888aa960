"""One run with oscilloscopes, and the figures of its currents."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.studies.framework.columns import HIDDEN, Column
from delta3_pacdrive.studies.framework.study import OnProgress
from delta3_pacdrive.studies.runs import oscilloscope as oscilloscope_run
from delta3_pacdrive.studies.runs.oscilloscope import Recorded
from delta3_pacdrive.studies.runs.run_signals import AFTER_S

# planned jerk has tens of Hz; higher frequencies are audible and excite frame and gears
JERK_FROM_HZ = 100.0
LEFT = ('reference', 'speed_reference', 'current_reference', 'motor_current')


@dataclass(frozen=True)
class Samples:
    """Samples of one motor in every period of the current loop, shapes (n,)."""

    time_s: Floats  # start of the period, from the start of the program
    set_point: Floats  # during the period [rad]
    speed_reference: Floats  # during the period [rad/s]
    speed: Floats  # at the start of the period [rad/s]
    current_reference: Floats  # during the period [A]
    voltage: Floats  # during the period [V]
    current: Floats  # at the end of the period [A]
    at_time_s: Floats  # sampling time of the AT
    at_current: Floats  # sample in the AT [A]


@dataclass(frozen=True)
class Case:
    """Figures of a cycle time with an interpolation; lists are by axis."""

    cycle_time_s: Annotated[float, Column('cycle time [s]')]
    interpolation: Annotated[str, Column('interpolation')]
    axis: Annotated[tuple[int, ...], Column('axis', in_json=False)]  # numbers of the axes
    set_point_delay_s: Annotated[float, Column('set-point delay [s]')]
    at_current_peak_a: Annotated[list[float], Column('AT peak [A]')]  # of the samples in the AT
    at_current_rms_a: Annotated[list[float], Column('AT rms [A]')]
    current_peak_a: Annotated[list[float], Column('peak [A]')]  # of all samples
    current_rms_a: Annotated[list[float], Column('rms [A]')]
    # rms jerk of an arm with mean inertia due to its motor, above JERK_FROM_HZ
    jerk_rad_s3: Annotated[list[float], Column('jerk [rad/s3]')]
    tcp_error_max_m: Annotated[float, Column('TCP error max [m]')]  # set-point delay removed
    tcp_error_rms_m: Annotated[float, Column('TCP error rms [m]')]
    samples: Annotated[Samples, HIDDEN]  # of the motor shown in the figures


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
