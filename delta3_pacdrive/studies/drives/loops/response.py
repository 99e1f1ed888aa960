"""Linear periodic systems, and figures of merit of open loops, closed loops and step responses.

``Periodic`` describes multi-rate loops over one bus cycle. The output of such a system for a sine contains the
frequency of the input and its images. Its frequency response is the part at the input frequency, as measured by a
Fourier transform.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats

Complex = NDArray[np.complex128]

SETTLED = 0.02  # of the final value, the usual band
RISE = (0.1, 0.9)
HALF_POWER = math.sqrt(0.5)
DOUBLINGS = 16  # of the number of cycles over which noise accumulates: one minute
MARGINAL = 1e-6  # excess over 1 that rounding gives an integrator without feedback


@dataclass(frozen=True)
class Margins:
    """Stability margins of an open loop L; None without the respective crossing."""

    gain_margin_db: float | None  # at phase -180 degrees
    gain_margin_hz: float | None
    # negative: gain change at which a crossing of -180 degrees with |L| > 1 reaches -1; lower gain limit of a
    # conditionally stable loop, excess gain of an unstable one
    gain_reduction_db: float | None
    phase_margin_deg: float | None  # phase above -180 degrees at the crossing of |L| = 1 closest to -1
    crossover_hz: float | None  # of this crossing
    delay_margin_s: float | None  # additional dead time up to instability
    sensitivity_peak: float  # M_s = max |1/(1 + L)|, inverse distance of L from -1; usually 1.2 to 2.0
    sensitivity_peak_hz: float


@dataclass(frozen=True)
class StepFigures:
    """Figures of a response to a unit step."""

    rise_time_s: float | None  # from 10 to 90 % of the step; None if 90 % is not reached
    overshoot: float  # share of the step
    settling_time_s: float | None  # to within 2 % of the step; None if it does not settle
    final: float  # mean of the last tenth


def margins(frequencies_hz: Floats, loop: Complex) -> Margins:
    """Return the margins of an open loop on an ascending grid of frequencies; crossings are interpolated."""
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    log_f, log_size = np.log(frequencies_hz), np.log(np.maximum(size, 1e-300))
    gains = []
    for turn in range(math.floor(phase.min() / math.tau) - 1, math.ceil(phase.max() / math.tau) + 1):
        for at in _crossings(log_f, phase - (2 * turn + 1) * math.pi):
            gains.append((-float(np.interp(at, log_f, log_size)), math.exp(at)))
    phases = []
    for at in _crossings(log_f, log_size):
        over = float(np.interp(at, log_f, phase)) + math.pi
        over = (over + math.pi) % math.tau - math.pi
        phases.append((over, math.exp(at)))
    decibel = 20.0 / math.log(10.0)
    gain = min((g for g in gains if g[0] > 0.0), default=None)
    less = max((g[0] for g in gains if g[0] <= 0.0), default=None)
    least = min(phases, key=lambda crossing: abs(crossing[0]), default=None)
    delays = [(over % math.tau) / (math.tau * f) for over, f in phases]
    sensitivity = 1.0 / np.maximum(np.abs(1.0 + loop), 1e-12)
    peak = int(np.argmax(sensitivity))
    return Margins(
        gain_margin_db=gain[0] * decibel if gain else None,
        gain_margin_hz=gain[1] if gain else None,
        gain_reduction_db=None if less is None else less * decibel,
        phase_margin_deg=math.degrees(least[0]) if least else None,
        crossover_hz=least[1] if least else None,
        delay_margin_s=min(delays, default=None),
        sensitivity_peak=float(sensitivity[peak]),
        sensitivity_peak_hz=float(frequencies_hz[peak]),
    )


def bandwidth(frequencies_hz: Floats, closed: Complex) -> float | None:
    """Return the frequency [Hz] above which |T| stays 3 dB below its first value; None if there is none."""
    relative = np.abs(closed) / abs(closed[0])
    over = np.flatnonzero(relative >= HALF_POWER)
    last = int(over[-1])
    if last == len(relative) - 1:
        return None
    edge = [last + 1, last]
    return math.exp(np.interp(HALF_POWER, relative[edge], np.log(frequencies_hz[edge])))


def step_figures(time_s: Floats, response: Floats) -> StepFigures:
    """Return the figures of a response to a unit step at time 0, the first sample."""
    rise = None
    if response.max() >= RISE[1]:
        start, end = (_moment(time_s, response, level) for level in RISE)
        rise = end - start
    outside = np.flatnonzero(np.abs(response - 1.0) > SETTLED)
    settling: float | None = 0.0
    if len(outside):
        last = int(outside[-1])
        settling = float(time_s[last + 1]) if last + 1 < len(time_s) else None
    tail = response[-max(1, len(response) // 10) :]
    return StepFigures(rise, max(0.0, float(response.max()) - 1.0), settling, float(tail.mean()))


def _crossings(x: Floats, y: Floats) -> list[float]:
    """Return the zero crossings of y, linearly interpolated."""
    indices = np.flatnonzero((y[:-1] < 0.0) != (y[1:] < 0.0))
    return [float(x[k] - y[k] * (x[k + 1] - x[k]) / (y[k + 1] - y[k])) for k in indices]


def _moment(time_s: Floats, response: Floats, level: float) -> float:
    """Return the interpolated time at which a response first reaches a level."""
    first = int(np.argmax(response >= level))
    around = slice(max(first - 1, 0), first + 1)
    return float(np.interp(level, response[around], time_s[around]))


def decibels(values: Complex) -> Floats:
    """Return the magnitude in dB."""
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(values), 1e-15)))


def degrees(values: Complex) -> Floats:
    """Return the unwrapped phase in degrees, beginning between -270 and 90."""
    phase = np.degrees(np.unwrap(np.angle(values)))
    return np.asarray(phase - 360.0 * np.floor((phase[0] + 270.0) / 360.0))


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
