"""Linear periodically time-varying systems: multi-rate loops described over one bus cycle.

The output of such a system for a sine contains the frequency of the input and its images. The frequency response here
is the part at the input frequency, as measured by a Fourier transform.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.drives.loops.response import Complex

DOUBLINGS = 16  # of the number of cycles over which noise accumulates: one minute
MARGINAL = 1e-6  # excess over 1 that rounding gives an integrator without feedback


@dataclass(frozen=True)
class Periodic:
    """x_{n+1} = A_n x_n + b_n u_n,  y_n = C_n x_n + d_n u_n, matrices of period N."""

    period_s: float  # of one step n
    a: Floats  # shape (N, states, states)
    b: Floats  # shape (N, states)
    c: Floats  # shape (N, outputs, states)
    d: Floats  # shape (N, outputs)
    outputs: tuple[str, ...]  # names

    def over_cycle(self) -> Floats:
        """Return the transition matrix of one cycle, from its beginning."""
        product = np.eye(self.a.shape[1])
        for a in self.a:
            product = a @ product
        return product

    def spectral_radius(self) -> float:
        """Return the largest eigenvalue magnitude over one cycle; 1 or more does not decay."""
        return float(np.abs(np.linalg.eigvals(self.over_cycle())).max())

    def variance(self, output: str, every: int = 1) -> float:
        """Return the mean variance of an output of a stable system under white input noise of variance 1.

        The output is sampled once in ``every`` steps.
        """
        row, steps = self.outputs.index(output), len(self.a)
        gained = np.zeros(self.a.shape[1:])
        for a, b in zip(self.a, self.b, strict=True):
            gained = a @ gained @ a.T + np.outer(b, b)
        # sum over all previous cycles by doubling: the sum of 2n cycles is that of n plus the same, n cycles older
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
        """Return whether the system is stable; an integrator without feedback counts as stable."""
        return self.spectral_radius() < 1.0 + MARGINAL

    def respond(self, frequencies_hz: Floats, output: str, every: int = 1) -> Complex:
        """Return the frequency response from the input to an output, sampled once in ``every`` steps; shape (F,)."""
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
        """Return the outputs, shape (samples, outputs), from rest under inputs of shape (samples,)."""
        x = np.zeros(self.a.shape[1])
        found = np.empty((len(inputs), len(self.outputs)))
        for k, u in enumerate(inputs):
            n = k % len(self.a)
            found[k] = self.c[n] @ x + self.d[n] * u
            x = self.a[n] @ x + self.b[n] * u
        return found
