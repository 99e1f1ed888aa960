"""Estimation problem: free quantities, and the residuals of signals against models with their slopes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.signal import butter, sosfiltfilt

from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.studies.estimation.quantities import Combination, Quantity, values_of

QUIET = 0.7  # of the sensor noise: smaller residuals have another cause
BAND_HZ = (
    60.0  # motion below, mostly noise above; the gears of a built robot ring at 200 Hz with random phase
)
EDGE_PERIODS = 3.0  # periods of the band edge removed at either end for filter transients
SAMPLES_PER_BAND = 2.5  # kept samples per period of the band edge


@dataclass(frozen=True)
class Block:
    """Compared signal."""

    name: str  # of the signal
    unit: str  # of the residuals
    sigma: float  # standard deviation of a residual due to sensor noise alone
    period_s: float  # of the samples
    start_s: float = 0.0  # time of the first sample
    memory_s: float = 0.0  # time constant of the model

    @property
    def columns(self) -> str:
        """Labels of its three columns: axes of the TCP, or motor numbers."""
        return 'xyz' if self.name == 'TCP' else '123'

    def is_quieter(self, rms: float) -> bool:
        """Whether residuals are too small to be sensor noise."""
        return rms < QUIET * self.sigma

    def times(self, count: int) -> Floats:
        """Return the times [s] of the first ``count`` samples."""
        return self.start_s + self.period_s * np.arange(count, dtype=np.float64)


class MotionBand:
    """Zero-phase low pass for signals (n, columns), which keeps the band of the motion.

    ``edge`` samples are removed at either end because of the filter's transients; of the others, every ``every``-th is
    kept. Raises EstimationError if fewer than four times ``edge`` samples are given.
    """

    def __init__(self, count: int, period_s: float, model: str, band_hz: float = BAND_HZ) -> None:
        self._section = butter(4, band_hz, fs=1.0 / period_s, output='sos')
        self.edge = round(EDGE_PERIODS / band_hz / period_s)
        self.every = max(1, round(1.0 / (SAMPLES_PER_BAND * band_hz * period_s)))
        if count < 4 * self.edge:
            raise EstimationError(f'the motion is too short for a {model}')
        self._kept = slice(self.edge, count - self.edge, self.every)

    def __call__(self, values: Floats) -> Floats:
        """Return the kept samples of filtered values."""
        return np.asarray(sosfiltfilt(self._section, values, axis=0)[self._kept])


class Model(Protocol):
    """Model that computes the residuals of one trace from the values of all quantities by symbol."""

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Compared signals."""

    @property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        """Shapes (n, 3) of the residuals of each block."""

    @property
    def depends(self) -> frozenset[str]:
        """Symbols of the quantities on which the residuals depend."""

    @property
    def step(self) -> float:
        """Step of difference quotients, as a share of a quantity's scale."""

    @property
    def accuracy(self) -> float:
        """Relative accuracy of the difference quotients, below which a sensitivity counts as zero."""

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured less modelled, one array (n, 3) per block."""


class Problem:
    """Free quantities and the models of all traces.

    Values are in SI. ``scales`` [SI] are the reference for changes, computed from the initial parameters; Jacobians
    are per scale.
    """

    def __init__(
        self, quantities: Sequence[Quantity], models: Sequence[Model], parameters: Parameters
    ) -> None:
        self.quantities = tuple(quantities)
        self.models = tuple(models)
        self.parameters = parameters
        self.accuracy = max(model.accuracy for model in models)
        self.step = max(model.step for model in models)
        self._known = values_of(parameters)
        self.scales: Floats = np.array([q.extent(self._known[q.symbol]) for q in self.quantities])
        # inverse standard deviations [1/scale] of the priors; 0 without one
        self.prior_weights: Floats = np.array([1.0 / q.prior if q.prior else 0.0 for q in self.quantities])
        # cache: analysis, steps, intervals and checks use slopes at the same values
        self._slopes_at: tuple[bytes, dict[int, list[Floats]]] = (b'', {})

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Compared signals of all models."""
        return tuple(block for model in self.models for block in model.blocks)

    def values(self, x: Floats) -> dict[str, float]:
        """Return all quantities by symbol, with the free ones as in ``x``."""
        return self._known | {q.symbol: float(v) for q, v in zip(self.quantities, x, strict=True)}

    def combined(self, combination: Combination, x: Floats) -> float:
        """Return the value of a combination of quantities."""
        return combination.value(self.values(x), self.parameters)

    def residuals(self, x: Floats) -> list[Floats]:
        """Measured less modelled, one array (n, 3) per block."""
        values = self.values(x)
        return [array for model in self.models for array in model.residuals(values)]

    def jacobian(self, x: Floats, columns: Sequence[int] | None = None) -> list[Floats]:
        """Return derivatives of the residuals per scale by central differences, one array (n, 3, columns) per block.

        At the border of stable closed loops the differences are one-sided.

        Raises
        ------
        EstimationError
            The residuals are not finite on either side.

        """
        columns = range(len(x)) if columns is None else columns
        if self._slopes_at[0] != x.tobytes():
            self._slopes_at = x.tobytes(), {}
        known = self._slopes_at[1]
        for j in columns:
            if j not in known:
                known[j] = [part for model in self.models for part in self._slopes(model, j, x)]
        slopes = [known[j] for j in columns]
        return [np.stack([column[b] for column in slopes], axis=-1) for b in range(len(self.blocks))]

    def _slopes(self, model: Model, j: int, x: Floats) -> list[Floats]:
        if self.quantities[j].symbol not in model.depends:
            return [np.zeros(shape) for shape in model.shapes]
        change = np.zeros(len(x))
        change[j] = self.step * self.scales[j]
        width = 2.0 * self.step
        higher, lower = (model.residuals(self.values(x + own)) for own in (change, -change))
        if not (_finite(higher) and _finite(lower)):
            width, centre = self.step, model.residuals(self.values(x))
            higher, lower = (higher, centre) if _finite(higher) else (centre, lower)
            if not (_finite(higher) and _finite(lower)):
                raise EstimationError(
                    f'the model of the closed loop is unstable with {self.quantities[j].symbol} near {x[j]:.3g} '
                    f'{self.quantities[j].unit}: check signs, units and axes of the log'
                )
        return [(high - low) / width for high, low in zip(higher, lower, strict=True)]


def _finite(arrays: Sequence[Floats]) -> bool:
    return all(bool(np.isfinite(array).all()) for array in arrays)
