"""Comparison of model and robot on one program: deviations of their signals."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.runs.clock_estimation import ON_GRID
from delta3_pacdrive.studies.thesis.experiments.compared_signals import OF_SAMPLES, QUANTITIES, XYZ, Run, norm


@dataclass(frozen=True)
class Statistics:
    """Statistics of one signal of model and robot, in the displayed unit.

    ``*_max`` are largest absolute values and ``deviation`` is robot - model. Percentages are relative to ``peak``, the
    largest excursion of the model over all columns of the signal, from its start for positions, otherwise from zero.
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
    """Model and robot over the same bus cycles of a program."""

    model: Run  # at the times of the run with the longer cycle, as is robot
    robot: Run
    start_s: float = 0.0  # start of the program; -inf if unknown

    @staticmethod
    def of(model: Run, robot: Run, shift_s: float = 0.0) -> 'Comparison':
        """Match two runs by their times from the start of the program.

        Parameters
        ----------
        model, robot
            The runs; the one with the shorter cycle is resampled to the times of the other.
        shift_s
            Added to the times of the robot.

        Raises
        ------
        TraceError
            The runs have no signal or no cycle of the program in common.

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
        """Whether a cycle is at or after the start of the program, shape (cycles,)."""
        return np.asarray(self.time_s >= self.start_s - ON_GRID * self.model.period_s)

    @property
    def names(self) -> list[str]:
        """Signals known in both runs in some cycle of the program, in the order of ``QUANTITIES``."""
        both = [name for name in QUANTITIES if name in self.model.actual and name in self.robot.actual]
        return [name for name in both if len(self.measured(self.deviation(name)))]

    @property
    def missing(self) -> list[str]:
        """Signals that one of the runs lacks."""
        lacking = [name for name in QUANTITIES if name not in self.names]
        # without other samples the current is that of the AT
        return [name for name in lacking if name != 'current_at' or 'current' not in self.names]

    def measured(self, values: Floats) -> Floats:
        """Return the known rows from the start of the program."""
        rows = values[self.counted]
        return np.asarray(rows[np.isfinite(rows).all(axis=1)])

    def extent(self, run: Run, name: str) -> tuple[Floats, Floats]:
        """Return a signal for its maximum and for its rms, which for a current cover all samples."""
        values = run.actual[name]
        if name != 'current' or not all(own in run.actual for own in OF_SAMPLES):
            return values, values
        low, high, rms = (run.actual[own] for own in OF_SAMPLES)
        return np.maximum(high, -low), rms

    def deviation(self, name: str) -> Floats:
        """Robot - model, shape (cycles, columns)."""
        return self.robot.actual[name] - self.model.actual[name]

    def mean_square_deviation(self, name: str) -> float:
        """Mean squared deviation over time [SI]: of the length of a vector, or of all axes."""
        return _rms(self.measured(self.deviation(name)), QUANTITIES[name].columns == XYZ) ** 2

    def reference_apart_m(self) -> float:
        """Largest distance of the two reference TCPs [m]; they differ because a plan starts at the measured position.

        Nan if one has no reference.
        """
        if not ('tcp' in self.model.reference and 'tcp' in self.robot.reference):
            return math.nan
        apart = self.measured(self.robot.reference['tcp'] - self.model.reference['tcp'])
        return float(norm(apart).max(initial=0.0))

    def statistics(self) -> list[Statistics]:
        """Return the statistics of each column of each signal, and of all columns of a signal."""
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
        # the length of a vector in space, the largest of three axes
        in_space = quantity.columns == XYZ
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


def _length(values: Floats) -> Floats:
    return norm(values)[:, 0]


def _largest(values: Floats) -> Floats:
    return np.asarray(np.abs(values).max(axis=1))


def _rms(values: Floats, of_vector: bool) -> float:
    """Root mean square over time: of the length of a vector, or of all columns."""
    squares = (values**2).sum(axis=1) if of_vector else (values**2).mean(axis=1)
    return math.sqrt(squares.mean())
