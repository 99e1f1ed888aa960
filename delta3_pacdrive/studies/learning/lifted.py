"""Norm-optimal iterative learning control of one axis in lifted form: errors and torques of a repetition are vectors.

    e = d - G u                     error of a repetition; G: lower triangular Toeplitz matrix of an impulse response
    u+ minimises |e+|^2 + w_d |u+ - u|^2 + w_u |u+|^2
    u+ = Q (G'G + (w_d + w_u) I)^-1 (w_d u + G'(G u + e))
    Q  = (I + kappa D'D)^-1         zero-phase low pass, D: second differences

Weights are relative to the largest |G(f)|^2. All matrices are banded: n cycles cost n times the square of the length
of the response once, and n times the length per update.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_solve_banded, cholesky_banded

from delta3_pacdrive.numerics.types import Floats

POINTS = 4096  # frequencies of the criterion


class AxisLearning:
    """Learning update of one axis.

    Parameters
    ----------
    response
        Impulse response from torque to motor angle [rad/(N m)], shape (taps,).
    cycles
        Number of cycles of a repetition.
    cycle_time_s
        Bus cycle.
    bandwidth_hz, change_weight, torque_weight
        As in ``study.Settings``.

    """

    def __init__(
        self,
        response: Floats,
        cycles: int,
        cycle_time_s: float,
        bandwidth_hz: float,
        change_weight: float,
        torque_weight: float,
    ) -> None:
        self._response, self._cycle_time_s = response, cycle_time_s
        gain_square = float(np.abs(np.fft.rfft(response, POINTS)).max()) ** 2
        self._change = change_weight * gain_square
        self._weight = self._change + torque_weight * gain_square
        self._kappa = _bend(bandwidth_hz, cycle_time_s) ** -4
        self._normal = cholesky_banded(gram(response, cycles, self._weight), lower=True)
        smooth = np.zeros((3, cycles))
        smooth[0], smooth[1], smooth[2] = 1.0 + 6.0 * self._kappa, -4.0 * self._kappa, self._kappa
        self._smooth = cholesky_banded(smooth, lower=True)

    def update(self, torques: Floats, errors: Floats) -> Floats:
        """Return the torques [N m] of the next repetition from torques and errors [rad] of this one, shapes (n,)."""
        aim = errors + np.convolve(torques, self._response)[: len(torques)]
        pulled = np.convolve(aim[::-1], self._response)[: len(aim)][::-1]
        found = cho_solve_banded((self._normal, True), pulled + self._change * torques)
        return np.asarray(cho_solve_banded((self._smooth, True), found))

    def filters(self) -> tuple[Floats, Floats, Any]:
        """Return frequencies [Hz], and the gains K and L of the update u+ = K u + L e."""
        frequencies = np.asarray(np.fft.rfftfreq(POINTS, self._cycle_time_s), dtype=np.float64)
        smooth = 1.0 / (1.0 + self._kappa * _bend(frequencies, self._cycle_time_s) ** 4)
        model = np.fft.rfft(self._response, POINTS)
        square = np.abs(model) ** 2
        known = smooth / (square + self._weight)
        return frequencies, known * (square + self._change), known * np.conj(model)


def _bend(frequency_hz: ArrayLike, cycle_time_s: float) -> Floats:
    """Gain of a first difference; its square is that of the second difference."""
    return np.asarray(2.0 * np.sin(np.pi * cycle_time_s * np.asarray(frequency_hz, dtype=np.float64)))


def gram(response: Floats, cycles: int, weight: float) -> Floats:
    """Return the lower bands of G'G + weight I, shape (taps, cycles)."""
    taps = len(response)
    bands = np.zeros((taps, cycles))
    for k in range(min(taps, cycles)):
        sums = np.cumsum(response[: taps - k] * response[k:])
        column = np.arange(cycles - k)
        bands[k, : cycles - k] = sums[np.minimum(cycles - 1 - k - column, taps - k - 1)]
    bands[0] += weight
    return bands


def contraction(axes: list[AxisLearning], responses: Floats) -> tuple[float, float]:
    """Return the largest singular value of K - L G over all frequencies, and its frequency [Hz].

    ``responses`` are impulse responses of a robot in the format of ``responses.measured``.
    """
    frequencies, *_ = axes[0].filters()
    kept, taken = (
        np.stack(rows, axis=-1) for rows in zip(*(axis.filters()[1:] for axis in axes), strict=True)
    )
    loops = np.fft.rfft(responses, POINTS, axis=0)
    left = kept[:, :, None] * np.eye(3) - taken[:, :, None] * loops
    sizes = np.linalg.svd(left, compute_uv=False)[:, 0]
    worst = int(sizes.argmax())
    return float(sizes[worst]), float(frequencies[worst])
