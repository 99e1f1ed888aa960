"""Model and robot on one program: the signals of Table 10-1, cycle by cycle, and how far they are apart.

Everything of the arms comes from the answers of the drives, as the controller sees it: encoder position and speed over
the gear ratio (4.17), the TCP by forward kinematics with the nominal geometry. What is really there, the arm angle
behind the gear and the TCP of the arms as they are built, only simulations tell (``*_true``).

The actual acceleration is not measured: it is the slope of the straight line through the actual speed of the five
cycles (at 1 ms) within ``run_signals.SLOPE_S`` on either side. The reference acceleration is the same slope of the
reference speed, so that smoothing is no difference between the two; the thesis could compare only with the reference.

The current is the mean of all samples that the current loop leaves in a bus cycle, which is what moves the arm; its
maxima and rms are those of the samples.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.alignment import ON_GRID, resampled
from delta3_pacdrive.analysis.measured import delay_cycles
from delta3_pacdrive.analysis.run_signals import delayed, derivatives, positive, program_part, slope
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.trace import Trace

Values = dict[str, Floats]  # (cycles, columns) by the names of ``QUANTITIES``


@dataclass(frozen=True)
class Quantity:
    """A quantity is a signal that is compared.

    Attributes
    ----------
    text
        What it is, in words.
    unit
        SI, in which it is held.
    shown_unit, factor
        In which people read it: shown value = factor x value.
    columns
        Names of its columns; '' where there is one.
    position
        Whether its peak counts from where it starts, not from zero.

    """

    text: str
    unit: str
    shown_unit: str
    factor: float
    columns: tuple[str, ...]
    position: bool = False


OF_SAMPLES = ('current_min', 'current_max', 'current_rms')  # beside the mean
_AXES, _XYZ, _NORM = ('1', '2', '3'), ('x', 'y', 'z'), ('',)
_DEG = math.degrees(1.0)
QUANTITIES = {
    'arm_angle': Quantity('arm angle', 'rad', 'deg', _DEG, _AXES, True),
    'arm_speed': Quantity('arm velocity', 'rad/s', 'deg/s', _DEG, _AXES),
    'arm_acceleration': Quantity('arm acceleration', 'rad/s^2', 'deg/s^2', _DEG, _AXES),
    'current': Quantity('current I_eff', 'A', 'A', 1.0, _AXES),
    'current_at': Quantity('current I_eff in the AT', 'A', 'A', 1.0, _AXES),
    'tcp': Quantity('TCP position', 'm', 'mm', 1e3, _XYZ, True),
    'tcp_error_norm': Quantity('norm of the TCP error', 'm', 'mm', 1e3, _NORM),
    'tcp_error_norm_raw': Quantity('norm of the TCP error with set-point delay', 'm', 'mm', 1e3, _NORM),
    'arm_angle_true': Quantity('true arm angle', 'rad', 'deg', _DEG, _AXES, True),
    'tcp_true': Quantity('true TCP position', 'm', 'mm', 1e3, _XYZ, True),
    'tcp_error_norm_true': Quantity('norm of the true TCP error', 'm', 'mm', 1e3, _NORM),
}


@dataclass(frozen=True)
class Run:
    """A run holds the signals from shortly before its program to shortly after.

    Attributes
    ----------
    cycle
        Bus cycles from the start of the program, shape (cycles,).
    period_s
        Of the bus.
    actual
        Signals by the names of ``QUANTITIES``, each (cycles, columns), nan where a recording has a gap; beside them
        ``OF_SAMPLES``, where they are known.
    reference
        What the drives were told, delayed as set points reach them; of those that have one.
    missing
        Signals that the recording does not hold.
    origin_s
        Time of the cycle 0.
    knows_start
        Whether that is the start of a program.

    """

    cycle: NDArray[np.int64]
    period_s: float
    actual: Values
    reference: Values
    missing: tuple[str, ...]
    origin_s: float = 0.0
    knows_start: bool = True

    @staticmethod
    def of(trace: Trace, parameters: Parameters) -> 'Run':
        """Take the signals from a trace of a robot with these parameters; raises TraceError."""
        return Run.of_part(program_part(trace), parameters)

    @staticmethod
    def of_part(part: Trace, parameters: Parameters) -> 'Run':
        """Take the signals from the part of a trace that is shown, on an even grid without gaps.

        Raises
        ------
        TraceError
            The trace does not tell its cycle time.

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
            actual['tcp_error_norm'] = _norm(part['tcp_error'])
        elif 'tcp_error_norm' in signals:
            actual['tcp_error_norm'] = part['tcp_error_norm']
        if {'tcp_command', 'tcp_actual'} <= signals.keys():
            actual['tcp_error_norm_raw'] = _norm(part['tcp_command'] - part['tcp_actual'])
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
            actual['tcp_error_norm_true'] = _norm(reference['tcp'] - part['tcp_true'])
            reference['arm_angle_true'], reference['tcp_true'] = reference['arm_angle'], reference['tcp']
        knows_start = part.meta.get('start_cycle') is not None
        origin = float(part.meta.get('origin_s', 0.0))
        cycle = np.rint((part.time_s - origin) / period).astype(np.int64)
        return Run(cycle, period, actual, reference, missing, origin, knows_start)

    @property
    def time_s(self) -> Floats:
        """Time of each cycle, from the start of the program if that is known, shape (cycles,)."""
        return np.asarray(self.cycle * self.period_s + self.origin_s, dtype=np.float64)

    def rows(self, rows: NDArray[np.int64]) -> 'Run':
        """Return some of the cycles."""
        actual = {name: values[rows] for name, values in self.actual.items()}
        reference = {name: values[rows] for name, values in self.reference.items()}
        return replace(self, cycle=self.cycle[rows], actual=actual, reference=reference)

    def shifted(self, shift_s: float) -> 'Run':
        """Return the run at other times: whole cycles stay whole."""
        cycles = round(shift_s / self.period_s)
        if abs(shift_s - cycles * self.period_s) <= ON_GRID * self.period_s:
            return replace(self, cycle=self.cycle + cycles)
        return replace(self, origin_s=self.origin_s + shift_s)

    def at(self, other: 'Run') -> 'Run':
        """Return the run at the times of another, between its own cycles if need be.

        Accelerations are the slope over the cycles of the other, so that they are smoothed alike.
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
        """Return the currents of all samples of longer cycles, each from one of these times on."""
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
        """Return the run with the current as an AT tells it, for a comparison with one that has no other."""
        actual = {name: values for name, values in self.actual.items() if name not in OF_SAMPLES}
        if 'current_at' in actual:
            actual['current'] = actual.pop('current_at')
        return replace(self, actual=actual)


@dataclass(frozen=True)
class Statistics:
    """Statistics are one signal of model and robot in numbers, in the unit that people read.

    ``*_max`` are largest absolute values, ``deviation`` is robot - model, percentages are of ``peak``: the largest
    excursion of the model over all columns of the signal, from its start for positions, else from zero.
    """

    signal: str
    column: str
    unit: str
    model_max: float
    model_rms: float
    robot_max: float
    robot_rms: float
    deviation_max: float
    deviation_rms: float
    deviation_max_at_s: float
    peak: float
    deviation_max_percent: float | None
    deviation_rms_percent: float | None
    model_from_reference_max: float | None
    model_from_reference_rms: float | None
    robot_from_reference_max: float | None
    robot_from_reference_rms: float | None


@dataclass(frozen=True)
class Comparison:
    """A comparison holds model and robot over the same bus cycles of the program.

    Attributes
    ----------
    model, robot
        At the same times: those of the model, or of whichever has the longer cycle.
    start_s
        When the program starts; -inf if neither knows it.

    """

    model: Run
    robot: Run
    start_s: float = 0.0

    @staticmethod
    def of(model: Run, robot: Run, shift_s: float = 0.0) -> 'Comparison':
        """Match two runs by their times from the start of the program.

        Parameters
        ----------
        model, robot
            The runs; the one with the shorter cycle is taken at the times of the other.
        shift_s
            What is added to the times of the robot.

        Raises
        ------
        TraceError
            The runs have no signal, or no cycle of the program, in common.

        """
        start_s = 0.0 if model.knows_start else shift_s if robot.knows_start else -math.inf
        robot = robot.shifted(shift_s)
        apart = abs(model.origin_s - robot.origin_s)
        if model.period_s > robot.period_s or (model.period_s == robot.period_s and apart):
            robot = robot.at(model)
        elif model.period_s < robot.period_s:
            model = model.at(robot)
        if not set(OF_SAMPLES) <= model.actual.keys() & robot.actual.keys():
            model, robot = model.of_the_at(), robot.of_the_at()
        _, of_model, of_robot = np.intersect1d(model.cycle, robot.cycle, return_indices=True)
        found = Comparison(model.rows(of_model), robot.rows(of_robot), start_s)
        if not found.counted.any():
            raise TraceError('model and robot have no bus cycle of the program in common')
        if not found.names:
            raise TraceError('model and robot have no signal in common')
        return found

    @property
    def time_s(self) -> Floats:
        """Time of each cycle from the start of the program, shape (cycles,)."""
        return self.model.time_s

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which cycles are those of the program and behind it."""
        return np.asarray(self.time_s >= self.start_s - ON_GRID * self.model.period_s)

    @property
    def names(self) -> list[str]:
        """Signals that both runs hold in some cycle of the program, in the order of ``QUANTITIES``."""
        both = [name for name in QUANTITIES if name in self.model.actual and name in self.robot.actual]
        return [name for name in both if len(self.measured(self.deviation(name)))]

    @property
    def missing(self) -> list[str]:
        """Signals of simulations that at least one of the runs lacks."""
        lacking = [name for name in QUANTITIES if name not in self.names]
        # where there is no other, the current is that of the AT
        return [name for name in lacking if name != 'current_at' or 'current' not in self.names]

    def measured(self, values: Floats) -> Floats:
        """Rows from the start of the program on that are known."""
        rows = values[self.counted]
        return np.asarray(rows[np.isfinite(rows).all(axis=1)])

    def extent(self, run: Run, name: str) -> tuple[Floats, Floats]:
        """Return a signal as it counts for its maximum, and as it counts for its rms: of a current all samples."""
        values = run.actual[name]
        if name != 'current' or not all(own in run.actual for own in OF_SAMPLES):
            return values, values
        low, high, rms = (run.actual[own] for own in OF_SAMPLES)
        return np.maximum(high, -low), rms

    def deviation(self, name: str) -> Floats:
        """Robot - model, shape (cycles, columns)."""
        return self.robot.actual[name] - self.model.actual[name]

    def mean_square_deviation(self, name: str) -> float:
        """Mean of the squared deviation over time [SI]: of a vector's length, or of all axes alike."""
        return _rms(self.measured(self.deviation(name)), QUANTITIES[name].columns == _XYZ) ** 2

    def reference_apart_m(self) -> float:
        """Largest distance of the two reference TCPs [m]: each plan begins where its encoders say that it stands.

        Nan if one has no reference.
        """
        if not ('tcp' in self.model.reference and 'tcp' in self.robot.reference):
            return math.nan
        apart = self.measured(self.robot.reference['tcp'] - self.model.reference['tcp'])
        return float(_norm(apart).max(initial=0.0))

    def statistics(self) -> list[Statistics]:
        """Return the numbers of each column of each signal, and of all its columns together."""
        return [row for name in self.names for row in self._of_signal(name)]

    def _of_signal(self, name: str) -> list[Statistics]:
        quantity = QUANTITIES[name]
        arrays = {'deviation': self.deviation(name)}
        for who, run in (('model', self.model), ('robot', self.robot)):
            arrays[who] = run.actual[name]
            arrays[f'{who}_max'], arrays[f'{who}_rms'] = self.extent(run, name)
            if name in run.reference:
                arrays[f'{who}_from_reference'] = run.actual[name] - run.reference[name]
        known = self.counted & np.isfinite(np.hstack(list(arrays.values()))).all(axis=1)
        if not known.any():
            return []
        times = self.time_s[known]
        arrays = {key: quantity.factor * values[known] for key, values in arrays.items()}
        model = arrays['model_max']
        from_start = model - model[0] if quantity.position else model
        columns = {label: slice(i, i + 1) for i, label in enumerate(quantity.columns)}
        if len(columns) > 1:
            columns['all'] = slice(None)
        # of a vector in space the length counts, of three axes the worst
        in_space = quantity.columns == _XYZ
        size = _length if in_space else _largest
        peak = float(size(from_start).max())
        rows = []
        for label, column in columns.items():
            numbers: dict[str, float | None] = {}
            for key in ('model', 'robot', 'deviation', 'model_from_reference', 'robot_from_reference'):
                if key not in arrays:
                    numbers[f'{key}_max'] = numbers[f'{key}_rms'] = None
                    continue
                largest, square = (arrays.get(f'{key}_{of}', arrays[key])[:, column] for of in ('max', 'rms'))
                numbers[f'{key}_max'] = float(size(largest).max())
                numbers[f'{key}_rms'] = _rms(square, in_space)
            worst = size(arrays['deviation'][:, column])
            for key in ('max', 'rms'):
                value = numbers[f'deviation_{key}'] or 0.0
                numbers[f'deviation_{key}_percent'] = 100.0 * value / peak if peak > 0.0 else None
            numbers |= {'peak': peak, 'deviation_max_at_s': float(times[worst.argmax()])}
            rows.append(Statistics(name, label, quantity.shown_unit, **numbers))  # type: ignore[arg-type]
        return rows


def _norm(values: Floats) -> Floats:
    return _length(values)[:, None]


def _length(values: Floats) -> Floats:
    return np.asarray(np.linalg.norm(values, axis=1))


def _largest(values: Floats) -> Floats:
    return np.asarray(np.abs(values).max(axis=1))


def _rms(values: Floats, of_vector: bool) -> float:
    """Root of the mean square over time: of a vector's length, or of all columns alike."""
    squares = (values**2).sum(axis=1) if of_vector else (values**2).mean(axis=1)
    return math.sqrt(squares.mean())
