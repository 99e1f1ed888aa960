"""Loops of one drive with one set of gains: linear and on the bench, in time and in frequency."""

import math
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.excitation import RATE_SHARE, multisine
from delta3_pacdrive.studies.drives.loops import identification
from delta3_pacdrive.studies.drives.loops.bench import Bench, Place, Run
from delta3_pacdrive.studies.drives.loops.identification import Measured
from delta3_pacdrive.studies.drives.loops.load import Load, friction_slope, gear_of
from delta3_pacdrive.studies.drives.loops.loops import OUTPUTS, Entry, Shaft, linear_cascade
from delta3_pacdrive.studies.drives.loops.response import (
    Complex,
    Margins,
    StepFigures,
    bandwidth,
    decibels,
    margins,
    step_figures,
)
from delta3_pacdrive.studies.framework.study import OnProgress

LOWEST_HZ = 0.5  # of the linear curves
POINTS = 600
NYQUIST_SHARE = 0.98  # highest frequency of the curves, relative to the Nyquist frequency
PERIODS = 4  # of a multisine; the first one settles


@dataclass(frozen=True)
class Loop:
    """Loop of the cascade with its excitation.

    The multisine is long enough for the lowest frequency of interest, and so small that the speed does not change its
    sign and currents and voltages stay far from their limits.
    """

    name: str
    place: Place  # on the bench
    error: Entry  # cut of the linear loop
    feedback: str  # output at the cut
    entry: Entry  # set point of the closed loop
    actual: str  # actual value of the closed loop
    period_s: float  # of the multisine
    highest_hz: float
    rms: float
    height: float  # of the step
    window_s: float

    def rate_steps(self, parameters: Parameters) -> int:
        """Return the number of current periods per set point."""
        drive = parameters.drive
        period = drive.position_period_s if self.place == Place.POSITION else drive.velocity_period_s
        return round(period / drive.current_period_s)

    def error_steps(self, parameters: Parameters) -> int:
        """Return the number of current periods per value of the error."""
        return 1 if self.place == Place.CURRENT else self.rate_steps(parameters)


LOOPS = (
    Loop(
        name='current',
        place=Place.CURRENT,
        error=Entry.CURRENT_ERROR,
        feedback='current_filtered',
        entry=Entry.CURRENT_SET_POINT,
        actual='current',
        period_s=0.1,
        highest_hz=3500.0,
        rms=0.3,
        height=0.5,
        window_s=0.012,
    ),
    Loop(
        name='velocity',
        place=Place.SPEED,
        error=Entry.SPEED_ERROR,
        feedback='speed_filtered',
        entry=Entry.SPEED_SET_POINT,
        actual='speed',
        period_s=0.5,
        highest_hz=1500.0,
        rms=1.5,
        height=2.0,
        window_s=0.15,
    ),
    Loop(
        name='position',
        place=Place.POSITION,
        error=Entry.POSITION_ERROR,
        feedback='read',
        entry=Entry.POSITION,
        actual='position',
        period_s=1.0,
        highest_hz=700.0,
        rms=0.03,
        height=0.05,
        window_s=0.3,
    ),
)
# all loops, cut at the current set point: margin of the whole drive against changes of winding and load
CASCADE = 'cascade'
# the same for a drive that reads its plant once per exchange period, as in the graph and in simulations
EXCHANGED = 'exchanged'
CASCADE_PERIOD_S, CASCADE_LOWEST_HZ, CASCADE_HIGHEST_HZ, CASCADE_RMS_A = 0.5, 4.0, 1500.0, 0.4


@dataclass(frozen=True)
class Step:
    """Step response of the drive on the bench and of the linear loop, relative to the step."""

    time_s: Floats
    drive: Floats
    linear: Floats
    figures: StepFigures


@dataclass(frozen=True)
class LoopResult:
    """Result for a loop with one set of gains."""

    name: str
    stable: bool  # closed linear loop
    margins: Margins  # linear open loop
    bandwidth_hz: float | None  # linear closed loop, -3 dB; None for the cascade
    frequencies_hz: Floats
    open_loop: Complex  # linear
    closed_loop: Complex | None  # linear
    measured_open: Measured | None = None  # on the bench; None if not measured or the drive tripped
    measured_closed: Measured | None = None
    step: Step | None = None
    fault: str = ''  # describes why the drive tripped on the bench


@dataclass(frozen=True)
class OperatingPoint:
    """Load and speed at which the loops are analysed."""

    load: Load
    speed_rad_s: float  # of the bench, motor side
    amplitude: float = 1.0  # multiple of the default excitations

    def load_of(self, place: Place) -> Load:
        """Return the load of the drive for a loop: a locked shaft for the current loop."""
        return HELD if place == Place.CURRENT else self.load

    def bench(self, place: Place, parameters: Parameters) -> Bench:
        """Return the bench for a set point; raises RunError."""
        return Bench(parameters, self.load_of(place), place, self.speed_rad_s)


HELD = Load('held shaft', math.inf)


def grid_hz(sample_s: float, points: int = POINTS) -> Floats:
    """Return the frequencies for a linear loop that is sampled every ``sample_s``."""
    return np.geomspace(LOWEST_HZ, NYQUIST_SHARE / (2.0 * sample_s), points)


def exact_shaft(parameters: Parameters, load: Load, speed_rad_s: float) -> Shaft:
    """Return the shaft of a drive that reads its load in every velocity period, as on a bench."""
    if not math.isfinite(load.inertia_kg_m2):
        return Shaft(load.inertia_kg_m2, 0.0, parameters.drive.velocity_period_s)
    if gear_of(parameters) is not None:
        # the shaft model of the drive does not depend on the exchange period
        return replace(
            exchanged_shaft(parameters, load, speed_rad_s),
            exchange_period_s=parameters.drive.velocity_period_s,
        )
    slope = friction_slope(speed_rad_s, parameters)
    return Shaft(load.inertia_kg_m2, slope, parameters.drive.velocity_period_s)


def exchanged_shaft(parameters: Parameters, load: Load, speed_rad_s: float) -> Shaft:
    """Return the shaft of a drive that exchanges with its plant at the period of the parameters."""
    believed = parameters.drive.observer_arm_inertia_kg_m2 / parameters.dynamics.gear_ratio**2
    slope = friction_slope(speed_rad_s, parameters)
    return Shaft(load.inertia_kg_m2, slope, parameters.bus.exchange_period_s, believed, gear_of(parameters))


def linear_loop(
    loop: Loop, parameters: Parameters, operation: OperatingPoint, points: int = POINTS
) -> LoopResult:
    """Return a loop from its difference equations."""
    shaft = exact_shaft(parameters, operation.load_of(loop.place), operation.speed_rad_s)
    period = parameters.drive.current_period_s
    rate, error_rate = loop.rate_steps(parameters), loop.error_steps(parameters)
    frequencies = grid_hz(error_rate * period, points)
    opened = linear_cascade(parameters, shaft, loop.error).respond(frequencies, loop.feedback, error_rate)
    closed = linear_cascade(parameters, shaft, loop.entry)
    shown = frequencies[frequencies < NYQUIST_SHARE / (2.0 * rate * period)]
    closed_loop = closed.respond(shown, loop.actual, rate)
    of_open, of_closed = margins(frequencies, opened), bandwidth(shown, closed_loop)
    return LoopResult(
        name=loop.name,
        stable=closed.is_stable(),
        margins=of_open,
        bandwidth_hz=of_closed,
        frequencies_hz=frequencies,
        open_loop=opened,
        closed_loop=closed_loop,
    )


def linear_cascade_loop(
    parameters: Parameters, shaft: Shaft, points: int = POINTS, name: str = CASCADE
) -> LoopResult:
    """Return the cascade, cut at the current set point: L = 1/S - 1."""
    steps = round(parameters.drive.velocity_period_s / parameters.drive.current_period_s)
    frequencies = grid_hz(parameters.drive.velocity_period_s, points)
    closed = linear_cascade(parameters, shaft, Entry.CURRENT)
    opened = 1.0 / closed.respond(frequencies, 'current_asked', steps) - 1.0
    return LoopResult(
        name=name,
        stable=closed.is_stable(),
        margins=margins(frequencies, opened),
        bandwidth_hz=None,
        frequencies_hz=frequencies,
        open_loop=opened,
        closed_loop=None,
    )


def analyse(parameters: Parameters, operation: OperatingPoint, on_progress: OnProgress) -> list[LoopResult]:
    """Return the three loops and the cascade, linear and on the bench."""
    results = []
    for number, loop in enumerate(LOOPS):
        on_progress(f'{loop.name} loop', number, len(LOOPS) + 1)
        results.append(_on_bench(loop, linear_loop(loop, parameters, operation), parameters, operation))
    on_progress('cascade', len(LOOPS), len(LOOPS) + 1)
    shaft = exact_shaft(parameters, operation.load, operation.speed_rad_s)
    cascade = linear_cascade_loop(parameters, shaft)
    if cascade.stable:
        cascade = _measured_cascade(cascade, parameters, operation)
    return [*results, cascade]


def step_on_bench(loop: Loop, parameters: Parameters, operation: OperatingPoint) -> Step:
    """Return the response to a step of the set point; raises RunError if the drive trips."""
    period, cycle = parameters.drive.current_period_s, parameters.bus.cycle_time_s
    per_cycle = round(cycle / period)
    samples = per_cycle * round(loop.window_s / cycle)
    height = loop.height * operation.amplitude
    bench = operation.bench(loop.place, parameters)
    run = bench.run(np.concatenate([np.zeros(per_cycle), np.full(samples, height)]))
    times: Floats = np.arange(samples, dtype=np.float64) * period
    response = _actual(loop, run, bench.speed_rad_s)
    relative = (response - response[per_cycle])[per_cycle:] / height
    shaft = exact_shaft(parameters, operation.load_of(loop.place), operation.speed_rad_s)
    linear = linear_cascade(parameters, shaft, loop.entry).run(np.ones(samples))
    return Step(times, relative, linear[:, OUTPUTS.index(loop.actual)], step_figures(times, relative))


def deviation(measured: Measured, linear: Complex) -> dict[str, float] | None:
    """Return the largest distance of a measured from a linear curve in the trusted band; None without a band."""
    inside = measured.in_band
    if not inside.any():
        return None
    quotient = measured.values[inside] / linear[inside]
    return {
        'up_to_hz': float(measured.frequencies_hz[inside][-1]),
        'decibels': float(np.abs(decibels(quotient)).max()),
        'degrees': float(np.abs(np.degrees(np.angle(quotient))).max()),
    }


def _on_bench(
    loop: Loop, linear: LoopResult, parameters: Parameters, operation: OperatingPoint
) -> LoopResult:
    try:
        found = replace(linear, step=step_on_bench(loop, parameters, operation))
        if linear.stable:
            opened, closed = _measured(loop, parameters, operation)
            found = replace(found, measured_open=opened, measured_closed=closed)
    except RunError as error:
        return replace(linear, fault=str(error))
    return found


def _measured(loop: Loop, parameters: Parameters, operation: OperatingPoint) -> tuple[Measured, Measured]:
    period = parameters.drive.current_period_s
    rate, error_rate = loop.rate_steps(parameters), loop.error_steps(parameters)
    highest = min(loop.highest_hz, RATE_SHARE / (rate * period))
    excitation = multisine(loop.period_s, period, highest, loop.rms * operation.amplitude)
    bench = operation.bench(loop.place, parameters)
    run = bench.run(excitation.periods(PERIODS, rate))
    error, feedback = _error_and_feedback(loop, run, parameters)
    added, actual = run.added, _actual(loop, run, bench.speed_rad_s)
    n = excitation.samples

    def estimate(x: Floats, y: Floats, every: int) -> Measured:
        x, y, instrument = (signal[n::every] for signal in (x, y, added))
        return identification.response(
            x, y, every * period, n // every, instrument=instrument, lines=excitation.lines
        )

    return estimate(error, feedback, error_rate), estimate(added, actual, rate)


def _measured_cascade(cascade: LoopResult, parameters: Parameters, operation: OperatingPoint) -> LoopResult:
    period = parameters.drive.current_period_s
    steps = round(parameters.drive.velocity_period_s / period)
    rms = CASCADE_RMS_A * operation.amplitude
    highest = min(CASCADE_HIGHEST_HZ, RATE_SHARE / (steps * period))
    excitation = multisine(CASCADE_PERIOD_S, period, highest, rms, CASCADE_LOWEST_HZ)
    try:
        run = operation.bench(Place.PLANT, parameters).run(excitation.periods(PERIODS, steps))
    except RunError as error:
        return replace(cascade, fault=str(error))
    n = excitation.samples
    added, asked = run.added[n::steps], run['current_asked'][n::steps]
    sensitivity = identification.response(added, asked, steps * period, n // steps, lines=excitation.lines)
    return replace(cascade, measured_open=identification.opened(sensitivity))


def _actual(loop: Loop, run: Run, speed_rad_s: float) -> Floats:
    """Return the actual value of a loop at the start of each period, without the motion of the bench."""
    if loop.place == Place.CURRENT:
        return run.at_start('motor_current')
    if loop.place == Place.SPEED:
        return run.at_start('speed') - speed_rad_s
    ramp = speed_rad_s * run.period_s * np.arange(len(run.added))
    return run.at_start('position') - ramp


def _error_and_feedback(loop: Loop, run: Run, parameters: Parameters) -> tuple[Floats, Floats]:
    if loop.place == Place.CURRENT:
        feedback = run['current_filtered']
        return run['current_reference_filtered'] - feedback, feedback
    if loop.place == Place.SPEED:
        feedback = run['speed_filtered']
        return run['speed_reference'] - feedback, feedback
    per_rad = parameters.bus.increments_per_rev / math.tau
    error = run['reference'] - run['increments'] / per_rad
    # the reference is the ramp of the bench plus the added set point
    return error, run.added - error
