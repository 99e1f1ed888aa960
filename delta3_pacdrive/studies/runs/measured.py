"""Measurements without bus cycles: resampled to an even time grid and completed with computed signals.

The period is estimated from the times. Missing samples leave gaps; unevenly spaced samples are interpolated linearly.
Arm, motor and TCP signals are computed from one another with the parameters of the robot.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs.run_signals import LACKING_MAX, cycles_of, delayed, positive

if TYPE_CHECKING:
    from delta3_pacdrive.numerics.types import Floats
    from delta3_pacdrive.parameters import Parameters

EVEN = 0.01  # of a period: largest deviation of a sample from the grid
LONG = 3.0  # periods between unevenly spaced samples that are still interpolated
INSTANTS_MIN = 3


def on_grid(trace: Trace, name: str) -> Trace:
    """Return a trace on an even grid that starts at 0, with ``cycle_time_s`` and ``origin_s`` in ``meta``.

    Raises
    ------
    TraceError
        The recording ``name`` has too few samples, or too many are missing.

    """
    origin, time_s = float(trace.time_s[0]) if len(trace.time_s) else 0.0, trace.time_s
    if len(time_s) < INSTANTS_MIN:
        raise TraceError(
            f'{name} contains {len(time_s)} samples, at least {INSTANTS_MIN} are needed to find their period'
        )
    time_s = time_s - origin  # epoch seconds would cost digits
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    rows = np.concatenate([[0], np.cumsum(np.rint(steps / usual).clip(1).astype(np.int64))])
    if rows[-1] + 1 - len(rows) > LACKING_MAX:
        raise TraceError(
            f'{name} lacks {rows[-1] + 1 - len(rows)} of {rows[-1] + 1} samples, the limit is {LACKING_MAX}'
        )
    period, first = (float(value) for value in np.polyfit(rows, time_s, 1))
    period = _round_period(period, int(rows[-1]))
    first += float(np.mean(time_s - first - rows * period))
    meta, notices = dict(trace.meta), list(trace.meta.get('notices', ()))
    if np.abs(time_s - first - rows * period).max() <= EVEN * period:
        signals = trace.signals
        if lacking := int(rows[-1]) + 1 - len(rows):
            notices.append(f'{lacking} of {rows[-1] + 1} samples are missing; the period is {period:.6g} s.')
    else:
        period, first = usual, float(time_s[0])
        rows = np.arange(int((time_s[-1] - first) / period + EVEN) + 1)
        signals = {
            key: _between(time_s, values, np.asarray(first + rows * period), LONG * period)
            for key, values in trace.signals.items()
        }
        notices.append(
            f'The samples are not evenly spaced ({steps.min():.4g} to {steps.max():.4g} s): they are interpolated '
            f'linearly every {period:.6g} s.'
        )
    meta |= {'cycle_time_s': period, 'origin_s': origin + first, 'notices': notices}
    return Trace(rows * period, signals, meta)


def _round_period(period: float, count: int) -> float:
    """Return a period rounded to whole microseconds or to a whole number of samples per second, if that fits."""
    for rounded in (round(period, 6), 1.0 / max(round(1.0 / period), 1)):
        if abs(rounded - period) * count <= EVEN * period:
            return rounded
    return period


def _between(time_s: Floats, values: Floats, at_s: Floats, longest_s: float) -> Floats:
    """Interpolate values linearly between samples; nan where these are more than ``longest_s`` apart."""
    found = np.column_stack([np.interp(at_s, time_s, column) for column in values.T])
    before = np.searchsorted(time_s, at_s, side='right').clip(1, len(time_s) - 1)
    found[time_s[before] - time_s[before - 1] > longest_s] = np.nan
    return found


def completed(trace: Trace, robot: Parameters) -> Trace:
    """Return a trace with the motor and TCP signals that follow from its other signals.

    References count as commands of the same instant. The set-point delay of the robot is removed from the TCP error,
    as in a run.
    """
    found, gear = of_motors(trace, robot), robot.dynamics.gear_ratio
    for of_motor, of_tcp in (('motor_position', 'tcp_actual'), ('motor_command', 'tcp_command')):
        if of_motor in found and of_tcp not in found:
            angles = found[of_motor] / gear
            known = np.isfinite(angles).all(axis=1)
            tcp = np.full_like(angles, np.nan)
            if known.any():
                tcp[known] = kinematics.forward(angles[known], robot.kinematics, unreachable='nan')
            found[of_tcp] = tcp
    if {'tcp_actual', 'tcp_command'} <= found.keys() and 'tcp_error' not in found:
        rows = cycles_of(trace)
        # missing commands stay nan, also for the delayed command of the next cycle
        command = np.full((rows[-1] - rows[0] + 1, 3), np.nan)
        command[rows - rows[0]] = found['tcp_command']
        late = delayed(command, delay_cycles(trace, robot))[rows - rows[0]]
        found['tcp_error'] = late - found['tcp_actual']
    return Trace(trace.time_s, found, trace.meta)


def of_motors(trace: Trace, robot: Parameters) -> dict[str, Floats]:
    """Return the signals of a trace, with motor signals added from arm signals."""
    found = dict(trace.signals)
    pairs = (
        ('arm_position', 'motor_position'),
        ('arm_speed', 'motor_speed'),
        ('arm_position_reference', 'motor_command'),
    )
    for of_arm, of_motor in pairs:
        if of_arm in found and of_motor not in found:
            found[of_motor] = found[of_arm] * robot.dynamics.gear_ratio
    return found


def delay_cycles(trace: Trace, robot: Parameters) -> float:
    """Return the set-point delay of a robot in periods of a trace."""
    period, cycle = positive(trace, 'cycle_time_s'), robot.bus.cycle_time_s
    return robot.set_point_delay_cycles if period == cycle else robot.set_point_delay_cycles * cycle / period
