"""Measurements for an estimation: recordings, or a simulated robot with oscilloscopes and sensor noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from delta3_pacdrive import kinematics, simulation
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.program.model import Output, Program
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.study import OnProgress, silent
from delta3_pacdrive.studies.runs import measured
from delta3_pacdrive.studies.runs import oscilloscope as oscilloscope_run
from delta3_pacdrive.studies.runs.clock_estimation import CLOCKS_MAX

MOVING_RAD_S = 1.0  # speed of a shaft above which it moves
MARGIN_S = 0.02  # kept before and after the motion
REST_S = 0.05  # constant command after which the robot is at rest
EVEN_CLOCK = 1e-6  # clock deviation within rounding
EVERY = 'bus_cycles_per_sample'  # meta data of a log sampled every few bus cycles
EVERY_MAX = 10
COMMANDS = {'motor_command', 'arm_position_reference'}


@dataclass(frozen=True)
class Noise:
    """Sensor noise: white, normally distributed, with typical standard deviations per sample.

    The current sensor resolves about a thousandth of the peak current, a good SinCos encoder a few increments of 2^19
    per revolution. The speed is the encoder's difference over some loop periods; the TCP is measured by a laser
    tracker. The voltage is the drive's own command and has no noise; errors of the power stage are not modelled.
    """

    current_a: float = 0.02
    motor_speed_rad_s: float = 0.05
    motor_position_rad: float = 2.0e-5
    tcp_measured_m: float = 3.0e-5

    def sigmas(self) -> dict[str, float]:
        """Return the standard deviations by signal name [SI]."""
        return {
            'current': self.current_a,
            'motor_speed': self.motor_speed_rad_s,
            'motor_position': self.motor_position_rad,
            'tcp_measured': self.tcp_measured_m,
        }


NOISE = Noise()


def sample_time_s(trace: Trace) -> float:
    """Return the sampling period [s]; raises EstimationError unless samples are evenly spaced."""
    if len(trace.time_s) < 2:
        raise EstimationError('the trace is too short')
    steps = np.diff(trace.time_s)
    period = float(np.median(steps))
    if np.abs(steps - period).max() > 1e-3 * period:
        raise EstimationError(
            f'the trace is not evenly sampled: steps from {steps.min():g} to {steps.max():g} s'
        )
    return period


def completed(trace: Trace, parameters: Parameters) -> Trace:
    """Return a recording with motor signals added from arm signals, and speeds from positions."""
    signals = measured.of_motors(trace, parameters)
    if 'motor_speed' not in signals and 'motor_position' in signals:
        signals['motor_speed'] = np.gradient(signals['motor_position'], sample_time_s(trace), axis=0)
    return Trace(trace.time_s, signals, trace.meta)


def parts_of(
    trace: Trace, parameters: Parameters, name: str, each_cycle: bool = True
) -> tuple[list[Trace], list[str]]:
    """Return the parts of a recording between its gaps, and notes on omitted samples and corrected times.

    The first part is used as it is. Each later part begins after the command, or else the speed, was constant for 50
    ms, because the motion during the gap is unknown. Parts without motion are omitted. Samples that are nearly a number
    of bus cycles apart come from the clock of the controller; their times are bus times, multiplied by a constant.
    With ``each_cycle``, signals are interpolated between samples several bus cycles apart: commands by cubic splines,
    others linearly.

    Raises
    ------
    Delta3Error
        The recording is too short, or no part of it shows a motion.

    """
    notes: list[str] = []
    if 'cycle_time_s' not in trace.meta:
        gridded = measured.on_grid(trace, name)
        origin = gridded.meta['origin_s']
        trace = Trace(gridded.time_s + origin, gridded.signals, gridded.meta)
    period = float(np.median(np.diff(trace.time_s))) if len(trace.time_s) > 1 else 0.0
    cycle = parameters.bus.cycle_time_s
    rows = np.rint((trace.time_s - trace.time_s[:1]) / (period or 1.0)).astype(np.int64)
    every = round(period / cycle)
    if not 1 <= every <= EVERY_MAX:
        every = 1
    fast = period / (every * cycle) - 1.0
    if EVEN_CLOCK < abs(fast) <= CLOCKS_MAX:
        consecutive = 'consecutive bus cycles' if every == 1 else f'every {every} bus cycles'
        notes.append(
            f'The clock is {100.0 * abs(fast):.2g} % {"fast" if fast > 0.0 else "slow"}: samples are assigned to '
            f'{consecutive} of {cycle * 1e3:g} ms'
        )
        times = trace.time_s[0] + rows * every * cycle
        trace = Trace(times, trace.signals, trace.meta | {'cycle_time_s': every * cycle})
    is_coarse = each_cycle and every > 1 and abs(fast) <= CLOCKS_MAX and bool(COMMANDS & trace.signals.keys())
    if is_coarse:
        notes.append(f'Every {every} bus cycles are sampled; the commands between them are interpolated')
    known = np.all([np.isfinite(values).all(axis=1) for values in trace.signals.values()], axis=0)
    kept = np.flatnonzero(known)
    pieces = np.split(kept, np.flatnonzero(np.diff(rows[kept]) != 1) + 1)
    if len(pieces) == 1 and len(kept) == len(rows):
        whole = completed(trace, parameters)
        return [_in_each_cycle(whole, every, cycle) if is_coarse else whole], notes
    parts: list[Trace] = []
    for number, piece in enumerate(pieces):
        part = completed(_rows(trace, piece), parameters) if len(piece) > 2 else None
        part = part if part is None or not number else _from_rest(part)
        if part is not None and _moves(part):
            parts.append(part)
    if not parts:
        raise EstimationError('no part of the trace between its gaps begins at rest and moves')
    used = sum(len(part.time_s) for part in parts)
    if is_coarse:
        parts = [_in_each_cycle(part, every, cycle) for part in parts]
    notes.append(
        f'{int(rows[-1]) + 1 - used} of {int(rows[-1]) + 1} samples are omitted: gaps, and the motion after them until '
        'the robot is at rest'
    )
    return parts, notes


def _rows(trace: Trace, rows: NDArray[np.int64]) -> Trace:
    return Trace(
        trace.time_s[rows], {name: values[rows] for name, values in trace.signals.items()}, trace.meta
    )


def _in_each_cycle(part: Trace, every: int, cycle_s: float) -> Trace:
    """Return a part sampled every few bus cycles with a row for each bus cycle."""
    from_first = part.time_s - part.time_s[0]
    times = cycle_s * np.arange(every * (len(from_first) - 1) + 1)
    signals = {
        name: np.column_stack([np.interp(times, from_first, column) for column in values.T])
        for name, values in part.signals.items()
    }
    signals['motor_command'] = CubicSpline(from_first, part['motor_command'])(times)
    return Trace(part.time_s[0] + times, signals, part.meta | {'cycle_time_s': cycle_s, EVERY: every})


def _from_rest(part: Trace) -> Trace | None:
    """Return a part after the first rest of its command, or of its speed; None if it never rests."""
    count = round(REST_S / sample_time_s(part))
    if 'motor_command' in part.signals:
        still = (np.diff(part['motor_command'], axis=0) == 0.0).all(axis=1)
    else:
        still = (np.abs(part['motor_speed']) < MOVING_RAD_S).all(axis=1)
    resting = np.convolve(still, np.ones(count), 'valid') > count - 0.5
    return (
        _rows(part, np.arange(int(np.argmax(resting)) + count, len(part.time_s))) if resting.any() else None
    )


def _moves(part: Trace) -> bool:
    try:
        moving_rows(part)
    except EstimationError:
        return False
    return True


def moving_rows(trace: Trace) -> slice:
    """Return the rows from program start to end, or else from the first to the last motion.

    At other times the brakes hold the arms, so the current carries no information.
    """
    period, first = sample_time_s(trace), trace.time_s[0]
    cycle = float(trace.meta.get('cycle_time_s', 0.0))
    start, end = trace.meta.get('start_cycle'), trace.meta.get('end_cycle')
    if cycle and start is not None and end is not None:
        begin = round((start * cycle - first) / period)
        stop = round((end * cycle - first) / period) + 1
    else:
        speed = trace['motor_speed']
        moving = np.flatnonzero((np.abs(speed) > MOVING_RAD_S).any(axis=1))
        if not len(moving):
            raise EstimationError('nothing moves in the trace')
        margin = round(MARGIN_S / period)
        begin, stop = moving[0] - margin, moving[-1] + margin
    begin, stop = max(0, begin), min(len(trace.time_s), stop)
    if stop - begin < 2:
        raise EstimationError('the trace contains no motion of the program')
    return slice(begin, stop)


def simulate(
    program: Program, parameters: Parameters, sampling: str = 'drive', on_progress: OnProgress = silent
) -> Trace:
    """Run a program and return exact signals, including ``tcp_measured``.

    Parameters
    ----------
    program
        Must not change the payload, whose mass is estimated.
    parameters
        Parameters of the measured robot.
    sampling
        'bus': once per bus cycle, like a recording. 'drive': every period of the current loop, with the phase voltage
        and the exact ``shaft_position`` and ``shaft_speed``; exchanges take two such periods.
    on_progress
        Receives the numbers of completed and of all bus cycles.

    Raises
    ------
    EstimationError
        The program changes the payload or injects faults.
    ProgramError, RunError
        As for ``simulation.run``.

    """
    if program.faults:
        raise EstimationError('a program with injected faults cannot be used for an estimation')
    carries = [s for s in program.statements if isinstance(s, Output) and s.payload_kg is not None]
    if carries or program.payload_kg not in (None, parameters.dynamics.payload_mass_kg):
        raise EstimationError(
            'the program changes the payload, which must be constant and as in the parameters'
        )
    if sampling == 'bus':
        trace = simulation.run(program, parameters)
    else:
        trace = _run_with_oscilloscope(program, parameters, on_progress)
    if parameters.rich.enabled and 'tcp_true' in trace.signals:
        trace.signals['tcp_measured'] = trace['tcp_true']
    else:
        arms = trace['shaft_position'] / parameters.dynamics.gear_ratio
        trace.signals['tcp_measured'] = kinematics.forward(arms, parameters.kinematics)
    return trace


def _run_with_oscilloscope(program: Program, parameters: Parameters, on_progress: OnProgress) -> Trace:
    """Run drives and plant period by period, bit-identical to a simulation with two periods per exchange."""
    recorded = oscilloscope_run.run(program, parameters, on_progress, 'measurement')
    scope = recorded.scope
    signals = scope.signals() | {
        'shaft_position': scope.found['position'],
        'shaft_speed': scope.found['speed'],
    }
    times = np.arange(len(signals['current']), dtype=np.float64) * parameters.drive.current_period_s
    return Trace(times, signals, recorded.meta)


def with_noise(trace: Trace, parameters: Parameters, scale: float, seed: int) -> Trace:
    """Return a copy with ``scale`` times the sensor noise ``NOISE``; encoder values stay on their grid."""
    generator = np.random.default_rng(seed)
    signals = dict(trace.signals)
    for name, sigma in NOISE.sigmas().items():
        if name in signals and scale > 0.0:
            signals[name] = signals[name] + scale * sigma * generator.standard_normal(signals[name].shape)
    if 'motor_position' in signals and scale > 0.0:
        per_rad = parameters.bus.increments_per_rev / (2.0 * np.pi)
        signals['motor_position'] = np.floor(signals['motor_position'] * per_rad + 0.5) / per_rad
    return Trace(trace.time_s, signals, trace.meta | {'noise': scale, 'seed': seed})
