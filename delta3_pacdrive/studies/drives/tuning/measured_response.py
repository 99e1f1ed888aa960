"""Frequency responses of a recording, each with the linear response for comparison.

With oscilloscope signals and an excitation added to a set point, a loop is opened as on the bench. A recording of bus
cycles gives the response from the bus command to the position in the AT. Its input is the motion of a program, which
contains little above some ten hertz. Both signals are therefore differenced twice before the transform, which keeps
leakage of the large slow motion out of the response; the coherence shows the usable band.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.drives.loops import identification
from delta3_pacdrive.studies.drives.loops.analysis import (
    CASCADE,
    HELD,
    OperatingPoint,
    exact_shaft,
    exchanged_shaft,
)
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.load import Load, modes_at
from delta3_pacdrive.studies.drives.loops.loops import Entry, linear_cascade, notch_response
from delta3_pacdrive.studies.drives.loops.response import Complex
from delta3_pacdrive.studies.estimation.measurement import moving_rows, sample_time_s

PIECES = 4  # minimum number of pieces of a recording that is not periodic; they overlap by half
PIECE_MIN = 64
COMMAND = 'command'


@dataclass(frozen=True)
class MeasuredResponse:
    """Response found in a recording, with the linear one."""

    name: str  # 'current' (closed), 'position' (open), 'cascade' (open) or 'command' (closed)
    title: str
    axis: int  # 1 to 3
    measured: Measured
    linear: Complex  # at the same frequencies


def identify(
    trace: Trace, axis: int, parameters: Parameters, operation: OperatingPoint
) -> list[MeasuredResponse]:
    """Return the frequency responses of an axis, 1 to 3, that the signals of a trace provide.

    Raises
    ------
    TuningError
        Signals are missing or too short, or the trace is of another robot.
    EstimationError
        The trace is not evenly sampled, or the robot does not move in it.

    """
    ratio = trace.meta.get('gear_ratio', parameters.dynamics.gear_ratio)
    if ratio != parameters.dynamics.gear_ratio:
        raise TuningError(
            f'the recording is of a robot with gear ratio {ratio:g}, '
            f'the parameters have {parameters.dynamics.gear_ratio:g}'
        )
    sample = sample_time_s(trace)
    if sample > 0.5 * parameters.bus.cycle_time_s:
        return [_of_command(trace, sample, axis, parameters, operation)]
    _check_rate(sample, parameters)
    found = []
    if {'current_added', 'current_reference'} <= trace.signals.keys():
        opened = _opened(
            trace, trace['current_reference'], Entry.CURRENT, axis, parameters=parameters, operation=operation
        )
        found.append(MeasuredResponse(CASCADE, 'cascade, open at the current set point', axis, *opened))
    if {'position_added', 'position_reference'} <= trace.signals.keys():
        error = trace['position_reference'] - trace['motor_position']
        opened = _opened(trace, error, Entry.POSITION, axis, parameters=parameters, operation=operation)
        found.append(MeasuredResponse('position', 'position loop, open', axis, *opened))
    if {'current_reference', 'current'} <= trace.signals.keys():
        found.append(_of_current(trace, axis, parameters, operation))
    if not found:
        raise TuningError(
            'the recording is faster than the bus cycle but lacks current_reference, required for responses of loops; '
            'the outer loops also need current_added or position_added'
        )
    return found


def _check_rate(sample_s: float, parameters: Parameters) -> None:
    period = parameters.drive.current_period_s
    if abs(sample_s - period) > 1e-3 * period:
        raise TuningError(
            f'the recording is sampled every {sample_s:g} s: responses of the loops require the period of the current '
            f'loop, {period:g} s, a response of the command the bus cycle, {parameters.bus.cycle_time_s:g} s'
        )


def _estimate(trace: Trace, x: Floats, y: Floats, every: int, instrument: Floats | None = None) -> Measured:
    """Estimate from every ``every``-th sample; a recording with a known repetition is transformed by whole periods."""
    x, y = x[::every], y[::every]
    if instrument is not None:
        instrument = instrument[::every]
    period_s = every * sample_time_s(trace)
    repeats, lines = _repetition(trace, len(trace.time_s))
    if lines is not None and repeats % every == 0:
        return identification.response(
            x, y, period_s, repeats // every, instrument=instrument, lines=lines, drifts=True
        )
    return identification.response(x, y, period_s, _piece(len(x)), instrument)


def _repetition(trace: Trace, samples: int) -> tuple[int, NDArray[np.int64] | None]:
    """Return period and lines of the excitation from the metadata of a trace; (0, None) without."""
    try:
        repeats = int(trace.meta['repeats_after'])
        lines = np.array(trace.meta['lines'], dtype=np.int64)
    except (KeyError, TypeError, ValueError):
        return 0, None
    fits = lines.ndim == 1 and len(lines) and lines.min() > 0 and lines.max() < repeats / 2
    return (repeats, lines) if fits and 0 < repeats <= samples else (0, None)


def _piece(samples: int) -> int:
    if samples < PIECES * PIECE_MIN:
        raise TuningError(
            f'the recording has {samples} usable samples; a spectrum needs at least {PIECES * PIECE_MIN}'
        )
    return 1 << int(np.log2(samples / PIECES))


def _steps(period_s: float, parameters: Parameters) -> int:
    return round(period_s / parameters.drive.current_period_s)


def _opened(
    trace: Trace, seen: Floats, entry: Entry, axis: int, parameters: Parameters, operation: OperatingPoint
) -> tuple[Measured, Complex]:
    """Return the open loop of an axis, measured and linear, from the input at ``entry`` to the signal ``seen``.

    The linear loop of an axis in the robot is the mean over the modes of the pose, weighted by its shares.
    """
    drive = parameters.drive
    added, output, period_s = {
        Entry.CURRENT: ('current_added', 'current_asked', drive.velocity_period_s),
        Entry.POSITION: ('position_added', 'position_error', drive.position_period_s),
    }[entry]
    every = _steps(period_s, parameters)
    sensitivity = _estimate(trace, trace[added][:, axis - 1], seen[:, axis - 1], every)
    if entry == Entry.CURRENT:
        # the loop is cut before the notch filters, the recorded reference is after them
        filters = notch_response(sensitivity.frequencies_hz, parameters)
        sensitivity = replace(sensitivity, values=sensitivity.values / filters)
    modes = modes_at(_pose(trace, parameters), parameters)
    speed = float(trace.meta.get('speed_rad_s', operation.speed_rad_s))
    linear: Any = 0.0
    for inertia, share in zip(modes.inertia_kg_m2, modes.shares[axis - 1], strict=True):
        cascade = linear_cascade(
            parameters, exact_shaft(parameters, Load('mode', float(inertia)), speed), entry
        )
        linear = linear + share * cascade.respond(sensitivity.frequencies_hz, output, every)
    return identification.opened(sensitivity), np.asarray(1.0 / linear - 1.0)


def _of_current(
    trace: Trace, axis: int, parameters: Parameters, operation: OperatingPoint
) -> MeasuredResponse:
    every = _steps(parameters.drive.velocity_period_s, parameters)
    instrument = next(
        (trace[n][:, axis - 1] for n in ('current_added', 'position_added') if n in trace.signals), None
    )
    if instrument is not None and not np.ptp(instrument) > 0.0:
        instrument = None  # another axis was excited
    asked, current = (trace[name][:, axis - 1] for name in ('current_reference', 'current'))
    measured = _estimate(trace, asked, current, every, instrument)
    shaft = exact_shaft(parameters, HELD, operation.speed_rad_s)
    closed = linear_cascade(parameters, shaft, Entry.CURRENT_SET_POINT)
    linear = closed.respond(measured.frequencies_hz, 'current', every)
    return MeasuredResponse('current', 'current loop, closed', axis, measured, linear)


def _of_command(
    trace: Trace, sample_s: float, axis: int, parameters: Parameters, operation: OperatingPoint
) -> MeasuredResponse:
    if abs(sample_s - parameters.bus.cycle_time_s) > 1e-3 * sample_s:
        raise TuningError(
            f'the recording is sampled every {sample_s:g} s, the parameters have '
            f'{parameters.bus.cycle_time_s:g} s (bus.cycle_time_s)'
        )
    rows = moving_rows(trace)
    command, actual = (
        np.diff(trace[name][rows, axis - 1], n=2) for name in ('motor_command', 'motor_position')
    )
    measured = identification.response(command, actual, sample_s, _piece(len(command)))
    shaft = exchanged_shaft(parameters, operation.load, operation.speed_rad_s)
    closed = linear_cascade(parameters, shaft, Entry.COMMAND)
    steps = _steps(parameters.bus.cycle_time_s, parameters)
    linear = closed.respond(measured.frequencies_hz, 'position', steps)
    return MeasuredResponse(COMMAND, 'bus command to position, closed', axis, measured, linear)


def _pose(trace: Trace, parameters: Parameters) -> Any:
    """Return the pose [m] of a recording from its metadata, or that of its mean shaft positions."""
    if isinstance(pose := trace.meta.get('pose_m'), list) and len(pose) == 3:
        return pose
    arms = trace['motor_position'].mean(axis=0) / parameters.dynamics.gear_ratio
    return kinematics.forward(arms, parameters.kinematics)
