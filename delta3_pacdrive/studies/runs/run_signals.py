"""The displayed part of a run, derivatives of its signals, and its energy.

Times count from the start of the program, the first one if a recording has several; without a program they are bus
time.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.dynamics import gravity
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.numerics.kernel import interpreted
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Motor, Parameters, numbered, rotary_axis_parameters
from delta3_pacdrive.planning.limits.energy import Energy, sampled_energy
from delta3_pacdrive.planning.limits.gear_load import GearFigures, sampled_gear_load
from delta3_pacdrive.planning.limits.temperature import Temperatures, sampled_heat_load, temperatures
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.motor import friction_torques
from delta3_pacdrive.robot.motor_heat import heat_constants, torque_share

BEFORE_S = 0.05  # shown before the program starts
AFTER_S = 0.10  # shown after the program ends
REST_S = 10.0  # pause that separates two programs of a recording
ZOOM_S = 0.15  # length of Fig. 11.4
LACKING_MAX = 1_000_000  # missing cycles; they need as much memory as recorded ones
SLOPE_S = 2.0e-3  # half window of the straight line whose slope is the actual acceleration


def windowed(trace: Trace, from_s: float | None, to_s: float | None) -> Trace:
    """Return the trace with a display window: times [s] from the start of the program, None for the default."""
    return Trace(trace.time_s, trace.signals, trace.meta | {'window_s': [from_s, to_s]})


def shown_cycles(trace: Trace) -> tuple[int, int]:
    """Return first and last bus cycle of the displayed part.

    This is the window of ``windowed``, or else the program: from shortly before its start until shortly after its end,
    or after the last motion if the end is not recorded. If the start is unknown it is the whole recording.

    Raises
    ------
    TraceError
        The cycle time is missing, or no cycle of that part is recorded.

    """
    period, cycles = positive(trace, 'cycle_time_s'), cycles_of(trace)
    if not len(cycles):
        raise TraceError('the recording contains no cycle')
    start, end = noted_cycle(trace, 'start_cycle'), noted_cycle(trace, 'end_cycle')
    first, last = int(cycles[0]), int(cycles[-1])
    if start is not None:
        first = start - round(BEFORE_S / period)
        end = _end_of_motion(trace, cycles, start) if end is None else end
    if end is not None:
        last = end + round(AFTER_S / period)
    from_s, to_s = trace.meta.get('window_s', (None, None))
    if from_s is not None:
        first = (start or 0) + math.ceil(from_s / period - 1e-6)
        # a window that starts after the program extends to the end of the recording
        last = last if last > first else int(cycles[-1])
    if to_s is not None:
        last = (start or 0) + math.floor(to_s / period + 1e-6)
    if not ((cycles >= first) & (cycles <= last)).any():
        low, high = ((edge - (start or 0)) * period for edge in cycles[[0, -1]])
        what = 'of the program' if from_s is None and to_s is None else 'of that window'
        raise TraceError(f'the recording contains no cycle {what}: it goes from {low:g} to {high:g} s')
    return first, last


def _end_of_motion(trace: Trace, cycles: NDArray[np.int64], start: int) -> int:
    """Return the last cycle in which the command moves, at least the start; without commands the last cycle.

    A program that starts after a pause of more than ``REST_S`` is a separate run and would compress this one to
    spikes.
    """
    if 'motor_command' not in trace.signals:
        return int(cycles[-1])
    moving = (np.diff(trace['motor_command'], axis=0) != 0.0).any(axis=1) & (np.diff(cycles) == 1)
    ends = cycles[1:][moving]
    for later in trace.meta.get('starts', ()):
        before = ends[ends < later]
        if later > start and len(before) and later - before[-1] > REST_S / positive(trace, 'cycle_time_s'):
            ends = before
            break
    return max(start, int(ends[-1])) if len(ends) else int(cycles[-1])


def program_part(trace: Trace) -> Trace:
    """Return the displayed cycles, with times [s] from the start of the program.

    Missing cycles are filled with nan, so that lines have gaps and differences span one cycle.

    Raises
    ------
    TraceError
        The cycle time is missing, no cycle of that part is recorded, or too many cycles are missing.

    """
    period, cycles = positive(trace, 'cycle_time_s'), cycles_of(trace)
    start = noted_cycle(trace, 'start_cycle')
    first, last = shown_cycles(trace)
    keep = (cycles >= first) & (cycles <= last)
    cycles = cycles[keep]
    rows = cycles - cycles[0]
    if (lacking := int(rows[-1]) + 1 - len(rows)) > LACKING_MAX:
        raise TraceError(
            f'the recording lacks {lacking} of {rows[-1] + 1} cycles, the limit is {LACKING_MAX}: choose a part with '
            '--from and --to'
        )
    numbers = np.arange(rows[-1] + 1)
    signals = {}
    for name, values in trace.signals.items():
        signals[name] = np.full((len(numbers), values.shape[1]), np.nan)
        signals[name][rows] = values[keep]
    return Trace((numbers + (cycles[0] - (start or 0))) * period, signals, trace.meta)


def positive(trace: Trace, key: str) -> float:
    """Return a required positive number in the ``meta`` of a trace; raises TraceError."""
    value = trace.meta.get(key)
    if not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise TraceError(f'the recording contains no valid {key}')
    return float(value)


def cycles_of(trace: Trace) -> NDArray[np.int64]:
    """Return the bus cycles of a trace, shape (cycles,); raises TraceError."""
    return np.rint(trace.time_s / positive(trace, 'cycle_time_s')).astype(np.int64)


def noted_cycle(trace: Trace, key: str) -> int | None:
    """Return an optional bus cycle in the ``meta`` of a trace; raises TraceError."""
    value = trace.meta.get(key)
    if value is None:
        return None
    if not isinstance(value, int | float) or not math.isfinite(value) or not float(value).is_integer():
        raise TraceError(f'{key} of the recording is {shown(value)}, expected a whole number')
    return int(value)


def currents_of(trace: Trace) -> tuple[Floats, Floats]:
    """Return peak and rms current [A] of each axis in each bus cycle, shapes (cycles, 3); nan where unknown.

    They cover all samples of the current loops. A recording without these has one sample per cycle in the AT, which is
    used for both.
    """
    if all(name in trace.signals for name in CURRENT_SIGNALS):
        return np.maximum(trace['current_max'], -trace['current_min']), trace['current_rms']
    sample = np.abs(trace.signals.get('current', np.full((len(trace.time_s), 3), np.nan)))
    return sample, sample


def derivatives(values: Floats, period_s: float, half: int = 1) -> tuple[Floats, Floats]:
    """First and second derivative of the least-squares parabola through ``half`` samples on each side.

    With one sample on each side these are the central and the second difference; the first is also the slope of the
    least-squares line. Shapes (n, 3); nan where the window is incomplete.
    """
    offsets = np.arange(-half, half + 1, dtype=np.float64)
    squares = offsets**2 - np.mean(offsets**2)
    weights = np.stack(
        [offsets / (offsets @ offsets) / period_s, 2.0 * squares / (squares @ squares) / period_s**2]
    )
    out = np.full((2, *values.shape), np.nan)
    if len(values) >= len(offsets):
        windows = np.lib.stride_tricks.sliding_window_view(values, len(offsets), axis=0)
        out[:, half:-half] = np.einsum('nkw,dw->dnk', windows, weights)
    return out[0], out[1]


def slope(values: Floats, period_s: float) -> Floats:
    """Slope of the least-squares line through the cycles within ``SLOPE_S``; nan where the window is incomplete."""
    return derivatives(values, period_s, max(1, round(SLOPE_S / period_s)))[0]


def delayed(values: Floats, cycles: float) -> Floats:
    """Return a command delayed by a number of cycles, interpolated linearly; nan before its first value."""
    whole = math.floor(cycles)
    share = cycles - whole
    out = np.full_like(values, np.nan)
    if len(values) > whole + 1:
        newer, older = values[1 : len(values) - whole], values[: len(values) - whole - 1]
        out[whole + 1 :] = (1.0 - share) * newer + share * older
    return out


def busiest(time_s: Floats, speeds: Floats) -> float:
    """Return the start of the window of length ``ZOOM_S`` centred on the fastest change of speed."""
    change = np.abs(np.gradient(speeds, axis=0)).max(axis=1) if len(speeds) > 1 else np.zeros(len(speeds))
    middle = time_s[np.argmax(np.nan_to_num(change))]
    begin = min(middle - ZOOM_S / 2.0, time_s[-1] - ZOOM_S)
    return round(float(max(begin, time_s[0])), 2)


NEEDED = ('shaft_speed', 'current_mean', 'current_rms')


def energy_of_round(trace: Trace, parameters: Parameters, repeat: int) -> Energy | None:
    """Return the mean energy of one round of a simulated or recorded program; None if the trace is incomplete.

    Friction is that of the parameters; in a built robot the friction of the gears differs.
    """
    found = _motor_samples(trace, parameters)
    return None if found is None else sampled_energy(*found, parameters).times(1.0 / repeat)


def temperatures_of_round(trace: Trace, parameters: Parameters) -> Temperatures | None:
    """Return the temperatures of the motors after a shift of the program of a trace; None if it is incomplete.

    The permanent override is at most that of the run.
    """
    found = _motor_samples(trace, parameters)
    if found is None:
        return None
    times, speed, mean, square = found
    first, last = _rows_of_program(trace, NEEDED, parameters) or (0, 0)
    if 'winding_temperature' in trace.signals:
        winding = trace['winding_temperature'][first:last]
        share = interpreted(torque_share)(winding, heat_constants(parameters).view(np.recarray)[0])
        mean, square = share * mean, share**2 * square
    standing = None
    if 'shaft_position' in trace.signals:
        standing = _standing_current(trace, parameters, float(times[0]))[first:last] + _friction_current(
            speed, parameters.motor
        )
    arms = sampled_heat_load(times, speed, mean, square, parameters, standing_a=standing)
    loads = [(arms, parameters)]
    for number in range(len(parameters.rotary_axes)):
        names = [numbered(name, number) for name in ('turn_speed', 'turn_current')]
        if all(name in trace.signals for name in names):
            own = rotary_axis_parameters(parameters, number)
            turning, current = (trace[name][first:last] for name in names)
            turning = own.dynamics.gear_ratio * turning
            standing = _friction_current(turning, own.motor)
            load = sampled_heat_load(times, turning, current, current**2, own, standing_a=standing)
            loads.append((load, own))
    return temperatures(loads, None if standing is None else 1.0)


def _friction_current(speed_rad_s: Floats, motor: Motor) -> Floats:
    """Return the currents [A] for the friction at motor speeds, same shape."""
    return friction_torques(speed_rad_s, motor) / motor.torque_constant_n_m_a


def _standing_current(trace: Trace, parameters: Parameters, start_s: float) -> Floats:
    """Return the currents [A] of the arms for the weight, with a program from ``start_s`` [s] on, shape (n, 3)."""
    ratio = parameters.dynamics.gear_ratio
    angles, payloads = trace['shaft_position'] / ratio, payloads_kg(trace, parameters, start_s)
    torque = np.empty_like(angles)
    for payload in np.unique(payloads):
        own = payloads == payload
        torque[own] = gravity(angles[own], parameters.replace(dynamics__payload_mass_kg=float(payload)))
    return torque / ratio / parameters.motor.torque_constant_n_m_a


def payloads_kg(trace: Trace, parameters: Parameters, start_s: float) -> Floats:
    """Return the payload in each row of a trace, as its program changes it from ``start_s`` [s] on, shape (n,)."""
    payloads = np.full(len(trace.time_s), parameters.dynamics.payload_mass_kg)
    for change in trace.meta.get('outputs', ()):
        if change['payload_kg'] is not None:
            payloads[trace.time_s - start_s >= change['time_s']] = change['payload_kg']
    return payloads


def _motor_samples(trace: Trace, parameters: Parameters) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Return times, motor speeds, currents and mean squares of the currents; None if the trace is incomplete."""
    rows = _rows_of_program(trace, NEEDED, parameters)
    if rows is None:
        return None
    first, last = rows
    speed, mean, rms = (np.asarray(trace[name][first : last + 1], dtype=np.float64) for name in NEEDED)
    # currents are averages over a cycle, speeds are values at its start
    between = 0.5 * (speed[:-1] + speed[1:])
    return trace.time_s[first:last], between, mean[:-1], rms[:-1] ** 2


def gears_of_round(trace: Trace, parameters: Parameters) -> GearFigures | None:
    """Return the figures of the gears for the program of a trace with derived signals; None if it is incomplete."""
    rows = _rows_of_program(trace, ('shaft_speed', 'gear_torque'), parameters)
    if rows is None:
        return None
    own = slice(rows[0], rows[1] + 1)
    speed, torque = trace['shaft_speed'][own], trace['gear_torque'][own]
    return sampled_gear_load(trace.time_s[own], speed, torque, parameters.gear).figures(parameters.gear)


def _rows_of_program(trace: Trace, needed: Sequence[str], parameters: Parameters) -> tuple[int, int] | None:
    """Return first and last row of the program; None if a cycle of it or a needed signal is missing."""
    if any(name not in trace.signals for name in needed):
        return None
    start, end = (trace.meta.get(name) for name in ('start_cycle', 'end_cycle'))
    if start is None or end is None:
        return None
    cycles = np.rint(trace.time_s / parameters.bus.cycle_time_s).astype(np.int64)
    end = min(end, cycles[-1])
    if not cycles[0] <= start < end:
        return None
    first, last = np.searchsorted(cycles, [start, end]).tolist()
    if cycles[first] != start or end - start != last - first:
        return None
    return first, last
