"""A problem of estimation: what is free, and the residuals of signals against models, with their slopes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from delta3_pacdrive.analysis.estimation.quantities import Combination, Quantity, values_of
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

QUIET = 0.7  # of the sensors' noise: residuals below it show something else


@dataclass(frozen=True)
class Block:
    """A block is a signal that is compared.

    Attributes
    ----------
    name
        Of the signal.
    unit
        Of the residuals.
    sigma
        Standard deviation of a residual by sensor noise alone.
    period_s
        Distance of the samples.
    start_s
        Time of the first one.
    memory_s
        For how long the model carries a disturbance on.

    """

    name: str
    unit: str
    sigma: float
    period_s: float
    start_s: float = 0.0
    memory_s: float = 0.0

    @property
    def columns(self) -> str:
        """Names of its three columns: axes of the TCP, or numbers of the motors."""
        return 'xyz' if self.name == 'TCP' else '123'

    def is_quieter(self, rms: float) -> bool:
        """Whether residuals are too small to be noise of the sensors."""
        return rms < QUIET * self.sigma

    def times(self, count: int) -> Floats:
        """Times [s] of its first samples."""
        return self.start_s + self.period_s * np.arange(count, dtype=np.float64)


class Model(Protocol):
    """A model gives the residuals of one trace, for all quantities by symbol."""

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The signals that are compared."""

    @property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        """Shapes (n, 3) of the residuals of each block."""

    @property
    def depends(self) -> frozenset[str]:
        """Symbols of the quantities that the residuals depend on."""

    @property
    def step(self) -> float:
        """Step of difference quotients, as a share of a quantity's scale."""

    @property
    def accuracy(self) -> float:
        """Relative accuracy of the difference quotients: what is smaller is no sensitivity."""

    def residuals(self, values: Mapping[str, float]) -> list[Floats]:
        """Measured less modelled, one array (n, 3) per block."""


class Problem:
    """A problem joins the free quantities and the models of all traces.

    Vectors of values are in SI. ``scales`` [SI] are what changes are compared with, from the values of the parameters
    that are known beforehand; jacobians are per scale.
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
        # analysis, steps, intervals and checks ask for slopes at the same values
        self._slopes_at: tuple[bytes, dict[int, list[Floats]]] = (b'', {})

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The signals that are compared, of all models."""
        return tuple(block for model in self.models for block in model.blocks)

    def values(self, x: Floats) -> dict[str, float]:
        """Return every quantity by symbol, the free ones as in ``x``."""
        return self._known | {q.symbol: float(v) for q, v in zip(self.quantities, x, strict=True)}

    def combined(self, combination: Combination, x: Floats) -> float:
        """Value of a combination of quantities."""
        return combination.value(self.values(x), self.parameters)

    def residuals(self, x: Floats) -> list[Floats]:
        """Measured less modelled, one array (n, 3) per block."""
        values = self.values(x)
        return [array for model in self.models for array in model.residuals(values)]

    def jacobian(self, x: Floats, columns: Sequence[int] | None = None) -> list[Floats]:
        """Derivatives of the residuals per scale by central differences, one array (n, 3, columns) per block."""
        columns = range(len(x)) if columns is None else columns
        if self._slopes_at[0] != x.tobytes():
            self._slopes_at = x.tobytes(), {}
        known = self._slopes_at[1]
        for j in columns:
            if j not in known:
                change = np.zeros(len(x))
                change[j] = self.step * self.scales[j]
                higher, lower = self.values(x + change), self.values(x - change)
                known[j] = [part for model in self.models for part in self._slopes(model, j, higher, lower)]
        slopes = [known[j] for j in columns]
        return [np.stack([column[b] for column in slopes], axis=-1) for b in range(len(self.blocks))]

    def _slopes(
        self, model: Model, j: int, higher: Mapping[str, float], lower: Mapping[str, float]
    ) -> list[Floats]:
        if self.quantities[j].symbol not in model.depends:
            return [np.zeros(shape) for shape in model.shapes]
        parts = zip(model.residuals(higher), model.residuals(lower), strict=True)
        return [(high - low) / (2.0 * self.step) for high, low in parts]
