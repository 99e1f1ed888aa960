"""Linear systems whose matrices repeat: loops of several rates, taken together over one bus cycle.

Such a system answers a sine with the sine's own frequency and with images of it; the frequency response here is the
part of the same frequency, which is what a measurement by Fourier transform finds.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.analysis.tuning.response import Complex
from delta3_pacdrive.numerics.types import Floats

DOUBLINGS = 16  # of the cycles that noise is remembered for: a minute
MARGINAL = 1e-6  # over 1: what an integrator that nothing feeds back may show by rounding


@dataclass(frozen=True)
class Periodic:
    """x_{n+1} = A_n x_n + b_n u_n,  y_n = C_n x_n + d_n u_n, matrices of period N.

    Attributes
    ----------
    period_s
        Of one step n.
    a, b, c, d
        Shapes (N, states, states), (N, states), (N, outputs, states), (N, outputs).
    outputs
        Names of the outputs.

    """

    period_s: float
    a: Floats
    b: Floats
    c: Floats
    d: Floats
    outputs: tuple[str, ...]

    def over_cycle(self) -> Floats:
        """Transition matrix of one whole cycle, from its beginning."""
        product = np.eye(self.a.shape[1])
        for a in self.a:
            product = a @ product
        return product

    def spectral_radius(self) -> float:
        """Largest magnitude of the eigenvalues over one cycle: 1 or more does not decay."""
        return float(np.abs(np.linalg.eigvals(self.over_cycle())).max())

    def variance(self, output: str, every: int = 1) -> float:
        """Mean variance of an output under white noise of variance 1 at the input, of a stable system.

        The output is looked at in every so many steps; noise enters where ``b`` lets it.
        """
        row, steps = self.outputs.index(output), len(self.a)
        gained = np.zeros(self.a.shape[1:])
        for a, b in zip(self.a, self.b, strict=True):
            gained = a @ gained @ a.T + np.outer(b, b)
        # spread of all cycles before: what is gained in twice as many of them comes from what half of them leaves
        spread, over = gained, self.over_cycle()
        for _ in range(DOUBLINGS):
            spread = spread + over @ spread @ over.T
            over = over @ over
        total = 0.0
        for n in range(steps):
            c = self.c[n, row]
            if n % every == 0:
                total += float(c @ spread @ c + self.d[n, row] ** 2)
            spread = self.a[n] @ spread @ self.a[n].T + np.outer(self.b[n], self.b[n])
        return total / len(range(0, steps, every))

    def is_stable(self) -> bool:
        """Whether nothing grows."""
        return self.spectral_radius() < 1.0 + MARGINAL

    def respond(self, frequencies_hz: Floats, output: str, every: int = 1) -> Complex:
        """Frequency response to an output.

        Parameters
        ----------
        frequencies_hz
            Shape (F,).
        output
            One of ``outputs``.
        every
            The output is looked at in every so many steps.

        """
        row = self.outputs.index(output)
        z = np.exp(2j * np.pi * frequencies_hz * self.period_s)  # of one step
        steps, states = self.b.shape
        driven = np.zeros((len(z), states), dtype=np.complex128)
        for n in range(steps):
            driven = driven @ self.a[n].T + np.outer(z**n, self.b[n])
        whole: Any = (z**steps)[:, None, None] * np.eye(states) - self.over_cycle()
        x = np.linalg.solve(whole, driven[:, :, None])[:, :, 0]
        total = np.zeros(len(z), dtype=np.complex128)
        for n in range(steps):
            if n % every == 0:
                total += (x @ self.c[n, row]) * z**-n + self.d[n, row]
            x = x @ self.a[n].T + np.outer(z**n, self.b[n])
        return total / len(range(0, steps, every))

    def run(self, inputs: Floats) -> Floats:
        """Outputs, shape (samples, outputs), from rest under inputs of shape (samples,)."""
        x = np.zeros(self.a.shape[1])
        found = np.empty((len(inputs), len(self.outputs)))
        for k, u in enumerate(inputs):
            n = k % len(self.a)
            found[k] = self.c[n] @ x + self.d[n] * u
            x = self.a[n] @ x + self.b[n] * u
        return found
