"""Signals for the comparison of model and robot: those of Table 10-1, in every bus cycle.

Arm signals come from the answers of the drives, as the controller sees them: encoder position and speed over the gear
ratio (4.17), and the TCP by forward kinematics with the nominal geometry. The true arm angle after the gear and the
TCP of the real arms (``*_true``) are available in simulations only.

The actual acceleration is not measured. It is the slope of the least-squares line through the actual speed of five
cycles (at 1 ms) within ``run_signals.SLOPE_S`` on either side. The reference acceleration is the same slope of the
reference speed, so both are smoothed equally; the thesis could only compare with the unsmoothed reference.

The current is the mean of all samples of the current loop in a bus cycle, because this mean moves the arm; maxima and
rms are those of the samples.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.tables.quantities import unit_named
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework.columns import in_unit
from delta3_pacdrive.studies.runs.clock_estimation import ON_GRID, resampled
from delta3_pacdrive.studies.runs.measured import delay_cycles
from delta3_pacdrive.studies.runs.run_signals import delayed, derivatives, positive, program_part, slope

Values = dict[str, Floats]  # shape (cycles, columns), keys as in ``QUANTITIES``


@dataclass(frozen=True)
class Quantity:
    """Signal that is compared."""

    text: str
    unit: str  # SI
    shown_unit: str
    columns: tuple[str, ...]  # names of the columns; '' for a single one
    position: bool = False  # whether its peak is relative to its start instead of zero

    @property
    def factor(self) -> float:
        """Shown value of 1 in SI."""
        return float(in_unit(1.0, unit_named(self.shown_unit)))


OF_SAMPLES = ('current_min', 'current_max', 'current_rms')  # in addition to the mean
_AXES, XYZ, _NORM = ('1', '2', '3'), ('x', 'y', 'z'), ('',)
QUANTITIES = {
    'arm_angle': Quantity('arm angle', 'rad', 'deg', _AXES, position=True),
    'arm_speed': Quantity('arm velocity', 'rad/s', 'deg/s', _AXES),
    'arm_acceleration': Quantity('arm acceleration', 'rad/s^2', 'deg/s^2', _AXES),
    'current': Quantity('current I_eff', 'A', 'A', _AXES),
    'current_at': Quantity('current I_eff in the AT', 'A', 'A', _AXES),
    'tcp': Quantity('TCP position', 'm', 'mm', XYZ, position=True),
    'tcp_error_norm': Quantity('norm of the TCP error', 'm', 'mm', _NORM),
    'tcp_error_norm_raw': Quantity('norm of the TCP error with set-point delay', 'm', 'mm', _NORM),
    'arm_angle_true': Quantity('true arm angle', 'rad', 'deg', _AXES, position=True),
    'tcp_true': Quantity('true TCP position', 'm', 'mm', XYZ, position=True),
    'tcp_error_norm_true': Quantity('norm of the true TCP error', 'm', 'mm', _NORM),
}


@dataclass(frozen=True)
class Run:
    """Signals from shortly before to shortly after a program."""

    cycle: NDArray[np.int64]  # bus cycles from the start of the program, shape (cycles,)
    period_s: float
    actual: Values  # by QUANTITIES, each (cycles, columns), nan in gaps; also OF_SAMPLES if available
    reference: Values  # commands with set-point delay, for signals with a command
    missing: tuple[str, ...]  # signals that the recording lacks
    origin_s: float = 0.0  # time of cycle 0
    knows_start: bool = True  # whether that is the start of a program

    @staticmethod
    def of(trace: Trace, parameters: Parameters) -> 'Run':
        """Return the signals of a trace of a robot with these parameters; raises TraceError."""
        return Run.of_part(program_part(trace), parameters)

    @staticmethod
    def of_part(part: Trace, parameters: Parameters) -> 'Run':
        """Return the signals of a displayed part, on an even grid without gaps.

        Raises
        ------
        TraceError
            The trace contains no cycle time.

        """
        period, gear_ratio = positive(part, 'cycle_time_s'), parameters.dynamics.gear_ratio
        delay, signals = delay_cycles(part, parameters), part.signals
        actual, reference = dict[str, Floats](), dict[str, Floats]()
        if 'motor_position' in signals:
            actual['arm_angle'] = part['motor_position'] / gear_ratio
        if 'motor_speed' in signals:
            actual['arm_speed'] = part['motor_speed'] / gear_ratio
            actual['arm_acceleration'] = slope(actual['arm_speed'], period)
        elif 'arm_acceleration' in signals:
            actual['arm_acceleration'] = part['arm_acceleration']
        if 'current' in signals:
            actual['current'] = actual['current_at'] = part['current']
            if set(CURRENT_SIGNALS) <= signals.keys():
                actual |= {'current': part['current_mean']} | {name: part[name] for name in OF_SAMPLES}
        if 'tcp_actual' in signals:
            actual['tcp'] = part['tcp_actual']
        if 'tcp_error' in signals:
            actual['tcp_error_norm'] = norm(part['tcp_error'])
        elif 'tcp_error_norm' in signals:
            actual['tcp_error_norm'] = part['tcp_error_norm']
        if {'tcp_command', 'tcp_actual'} <= signals.keys():
            actual['tcp_error_norm_raw'] = norm(part['tcp_command'] - part['tcp_actual'])
        if 'motor_command' in signals:
            command = part['motor_command'] / gear_ratio
            reference_speed = derivatives(command, period)[0]
            reference['arm_angle'] = delayed(command, delay)
            reference['arm_speed'] = delayed(reference_speed, delay)
            reference['arm_acceleration'] = delayed(slope(reference_speed, period), delay)
        elif 'arm_acceleration_reference' in signals:
            reference['arm_acceleration'] = delayed(part['arm_acceleration_reference'], delay)
        if {'tcp_error', 'tcp_actual'} <= signals.keys():
            reference['tcp'] = part['tcp_error'] + part['tcp_actual']
        missing = tuple(name for name in TRUE_SIGNALS if name not in signals)
        if not missing and {'arm_angle', 'tcp'} <= reference.keys():
            actual['arm_angle_true'], actual['tcp_true'] = part['arm_angle'], part['tcp_true']
            actual['tcp_error_norm_true'] = norm(reference['tcp'] - part['tcp_true'])
            reference['arm_angle_true'], reference['tcp_true'] = reference['arm_angle'], reference['tcp']
        knows_start = part.meta.get('start_cycle') is not None
        origin = float(part.meta.get('origin_s', 0.0))
        cycle = np.rint((part.time_s - origin) / period).astype(np.int64)
        return Run(
            cycle=cycle,
            period_s=period,
            actual=actual,
            reference=reference,
            missing=missing,
            origin_s=origin,
            knows_start=knows_start,
        )

    @property
    def time_s(self) -> Floats:
        """Time of each cycle, from the start of the program if it is known, shape (cycles,)."""
        return np.asarray(self.cycle * self.period_s + self.origin_s, dtype=np.float64)

    def rows(self, rows: NDArray[np.int64]) -> 'Run':
        """Return a selection of cycles."""
        actual = {name: values[rows] for name, values in self.actual.items()}
        reference = {name: values[rows] for name, values in self.reference.items()}
        return replace(self, cycle=self.cycle[rows], actual=actual, reference=reference)

    def shifted(self, shift_s: float) -> 'Run':
        """Return the run with shifted times; shifts by whole cycles are exact."""
        cycles = round(shift_s / self.period_s)
        if abs(shift_s - cycles * self.period_s) <= ON_GRID * self.period_s:
            return replace(self, cycle=self.cycle + cycles)
        return replace(self, origin_s=self.origin_s + shift_s)

    def at(self, other: 'Run') -> 'Run':
        """Return the run at the times of another, interpolated if necessary.

        Accelerations are slopes over the cycles of the other run, so that both are smoothed equally.
        """
        within = (other.time_s >= self.time_s[0]) & (other.time_s <= self.time_s[-1])
        time_s = other.time_s[within]

        def moved(values: Values) -> Values:
            found = {name: resampled(self.time_s, of, time_s, self.period_s) for name, of in values.items()}
            if set(OF_SAMPLES) <= found.keys():
                found |= self._currents_within(time_s, other.period_s)
            if {'arm_speed', 'arm_acceleration'} <= found.keys() and self.period_s != other.period_s:
                found['arm_acceleration'] = slope(found['arm_speed'], other.period_s)
            return found

        return replace(
            self,
            cycle=other.cycle[within],
            period_s=other.period_s,
            actual=moved(self.actual),
            reference=moved(self.reference),
            origin_s=other.origin_s,
        )

    def _currents_within(self, time_s: Floats, period_s: float) -> Values:
        """Return the currents over all samples of longer cycles that begin at these times."""
        count = round(period_s / self.period_s)
        rows = np.rint((time_s - self.time_s[0]) / self.period_s).astype(np.int64)
        rows = np.minimum(rows[:, None] + np.arange(count), len(self.cycle) - 1)
        of = {name: self.actual[name][rows] for name in ('current', *OF_SAMPLES)}
        return {
            'current': of['current'].mean(axis=1),
            'current_min': of['current_min'].min(axis=1),
            'current_max': of['current_max'].max(axis=1),
            'current_rms': np.sqrt((of['current_rms'] ** 2).mean(axis=1)),
        }

    def of_the_at(self) -> 'Run':
        """Return the run with the current of the AT, for comparison with a run without other samples."""
        actual = {name: values for name, values in self.actual.items() if name not in OF_SAMPLES}
        if 'current_at' in actual:
            actual['current'] = actual.pop('current_at')
        return replace(self, actual=actual)


def norm(values: Floats) -> Floats:
    """Return the length of each row as a column, shape (cycles, 1)."""
    return np.asarray(np.linalg.norm(values, axis=1))[:, None]
