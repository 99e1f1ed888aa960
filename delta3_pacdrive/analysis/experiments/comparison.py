"""Model and robot on one program: the signals of Table 10-1, cycle by cycle, and how far they are apart.

Everything of the arms comes from the answers of the drives, as the controller sees it: encoder position and speed over
the gear ratio (4.17), the TCP by forward kinematics with the nominal geometry. What is really there, the arm angle
behind the gear and the TCP of the arms as they are built, only simulations tell (``*_true``).

The actual acceleration is not measured: it is the slope of the straight line through the actual speed of the five
cycles (at 1 ms) within ``run_signals.SLOPE_S`` on either side. The reference acceleration is the same slope of the
reference speed, so that smoothing is no difference between the two; the thesis could compare only with the reference.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.run_signals import derivatives, program_part, slope
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.recording.signals import TRUE_SIGNALS
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


_AXES, _XYZ, _NORM = ('1', '2', '3'), ('x', 'y', 'z'), ('',)
_DEG = math.degrees(1.0)
QUANTITIES = {
    'arm_angle': Quantity('arm angle', 'rad', 'deg', _DEG, _AXES, True),
    'arm_speed': Quantity('arm velocity', 'rad/s', 'deg/s', _DEG, _AXES),
    'arm_acceleration': Quantity('arm acceleration', 'rad/s^2', 'deg/s^2', _DEG, _AXES),
    'current': Quantity('current I_eff', 'A', 'A', 1.0, _AXES),
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
        Signals by the names of ``QUANTITIES``, each (cycles, columns), nan where a recording has a gap.
    reference
        What the drives were told, delayed as set points reach them; of those that have one.
    missing
        Signals that the recording does not hold.

    """

    cycle: NDArray[np.int64]
    period_s: float
    actual: Values
    reference: Values
    missing: tuple[str, ...]

    @staticmethod
    def of(trace: Trace, parameters: Parameters) -> 'Run':
        """Take the signals from a trace of a robot with these parameters.

        Raises
        ------
        TraceError
            A signal that every recording holds is not there, or no cycle of the program is.

        """
        part = program_part(trace)
        period, gear_ratio = parameters.bus.cycle_time_s, parameters.dynamics.gear_ratio
        delay = parameters.set_point_delay_cycles
        command = part['motor_command'] / gear_ratio
        reference_speed = derivatives(command, period)[0]
        due = part['tcp_error'] + part['tcp_actual']
        speed = part['motor_speed'] / gear_ratio
        actual = {
            'arm_angle': part['motor_position'] / gear_ratio,
            'arm_speed': speed,
            'arm_acceleration': slope(speed, period),
            'current': part['current'],
            'tcp': part['tcp_actual'],
            'tcp_error_norm': _norm(part['tcp_error']),
            'tcp_error_norm_raw': _norm(part['tcp_command'] - part['tcp_actual']),
        }
        reference = {
            'arm_angle': delayed(command, delay),
            'arm_speed': delayed(reference_speed, delay),
            'arm_acceleration': delayed(slope(reference_speed, period), delay),
            'tcp': due,
        }
        missing = tuple(name for name in TRUE_SIGNALS if name not in part.signals)
        if not missing:
            actual['arm_angle_true'], actual['tcp_true'] = part['arm_angle'], part['tcp_true']
            actual['tcp_error_norm_true'] = _norm(due - part['tcp_true'])
            reference['arm_angle_true'], reference['tcp_true'] = reference['arm_angle'], due
        cycle = np.rint(part.time_s / period).astype(np.int64)
        return Run(cycle, period, actual, reference, missing)

    def rows(self, rows: NDArray[np.int64]) -> 'Run':
        """Return some of the cycles."""
        actual = {name: values[rows] for name, values in self.actual.items()}
        reference = {name: values[rows] for name, values in self.reference.items()}
        return Run(self.cycle[rows], self.period_s, actual, reference, self.missing)


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
    """A comparison holds model and robot over the same bus cycles of the program."""

    model: Run
    robot: Run

    @staticmethod
    def of(model: Run, robot: Run) -> 'Comparison':
        """Match two runs by the bus cycle counted from the start of the program.

        Raises
        ------
        TraceError
            The runs have different cycle times, or no cycle of the program in common.

        """
        if model.period_s != robot.period_s:
            raise TraceError(
                f'model and robot cannot be compared cycle by cycle: their bus cycle times are '
                f'{model.period_s:g} s and {robot.period_s:g} s'
            )
        common, of_model, of_robot = np.intersect1d(model.cycle, robot.cycle, return_indices=True)
        if not (common >= 0).any():
            raise TraceError('model and robot have no bus cycle of the program in common')
        return Comparison(model.rows(of_model), robot.rows(of_robot))

    @property
    def time_s(self) -> Floats:
        """Time of each cycle from the start of the program, shape (cycles,)."""
        return np.asarray(self.model.cycle * self.model.period_s, dtype=np.float64)

    @property
    def names(self) -> list[str]:
        """Signals that both runs hold, in the order of ``QUANTITIES``."""
        return [name for name in QUANTITIES if name in self.model.actual and name in self.robot.actual]

    @property
    def missing(self) -> list[str]:
        """Signals of simulations that at least one of the runs lacks."""
        return [name for name in QUANTITIES if name not in self.names]

    def measured(self, values: Floats) -> Floats:
        """Rows from the start of the program on that are known."""
        rows = values[self.model.cycle >= 0]
        return np.asarray(rows[np.isfinite(rows).all(axis=1)])

    def deviation(self, name: str) -> Floats:
        """Robot - model, shape (cycles, columns)."""
        return self.robot.actual[name] - self.model.actual[name]

    def mean_square_deviation(self, name: str) -> float:
        """Mean of the squared deviation over time [SI]: of a vector's length, or of all axes alike."""
        return _rms(self.measured(self.deviation(name)), QUANTITIES[name].columns == _XYZ) ** 2

    def reference_apart_m(self) -> float:
        """Largest distance of the two reference TCPs [m]: each plan begins where its encoders say that it stands."""
        return float(_norm(self.measured(self.robot.reference['tcp'] - self.model.reference['tcp'])).max())

    def statistics(self) -> list[Statistics]:
        """Return the numbers of each column of each signal, and of all its columns together."""
        return [row for name in self.names for row in self._of_signal(name)]

    def _of_signal(self, name: str) -> list[Statistics]:
        quantity = QUANTITIES[name]
        arrays = {'deviation': self.deviation(name)}
        for who, run in (('model', self.model), ('robot', self.robot)):
            arrays[who] = run.actual[name]
            if name in run.reference:
                arrays[f'{who}_from_reference'] = run.actual[name] - run.reference[name]
        cycle = self.model.cycle
        known = (cycle >= 0) & np.isfinite(np.hstack(list(arrays.values()))).all(axis=1)
        times = cycle[known] * self.model.period_s
        arrays = {key: quantity.factor * values[known] for key, values in arrays.items()}
        model = arrays['model']
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
                values = arrays[key][:, column] if key in arrays else None
                numbers[f'{key}_max'] = None if values is None else float(size(values).max())
                numbers[f'{key}_rms'] = None if values is None else _rms(values, in_space)
            worst = size(arrays['deviation'][:, column])
            for key in ('max', 'rms'):
                value = numbers[f'deviation_{key}'] or 0.0
                numbers[f'deviation_{key}_percent'] = 100.0 * value / peak if peak > 0.0 else None
            numbers |= {'peak': peak, 'deviation_max_at_s': float(times[worst.argmax()])}
            rows.append(Statistics(name, label, quantity.shown_unit, **numbers))  # type: ignore[arg-type]
        return rows


def delayed(values: Floats, cycles: float) -> Floats:
    """Return what a command was some cycles before, on the chord between two of them; nan before there was one."""
    whole = math.floor(cycles)
    share = cycles - whole
    out = np.full_like(values, np.nan)
    if len(values) > whole + 1:
        newer, older = values[1 : len(values) - whole], values[: len(values) - whole - 1]
        out[whole + 1 :] = (1.0 - share) * newer + share * older
    return out


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
