"""Frequency responses from recorded signals: Welch's spectra, the H1 estimate, its coherence and its error.

H1 = S_xy / S_xx is free of the noise at the output y. Inside a closed loop the input x holds that noise as well; with
the added set point r, which the noise knows nothing of, H = S_ry / S_rx is free of both. A loop of unity feedback is
L = S_rb / S_re of feedback b and error e; the loop around a place where r is added to what the controllers ask for is
L = 1/S - 1 with S = S_ru / S_rr of the sum u.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from delta3_pacdrive.analysis.tuning.response import Complex
from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats

AVERAGES_MIN = 3
ERROR_MAX = 0.05  # of |H|, one standard deviation, 0.4 dB and 3 degrees: what is trustworthy
COHERENCE_MIN = 0.5  # below, the error by the formula is no more than a guess
QUIET = 1e-12  # of the strongest line, below which an input is not excited


@dataclass(frozen=True)
class Measured:
    """A measured frequency response has a coherence, and so an error.

    Attributes
    ----------
    frequencies_hz
        Shape (F,), ascending.
    values
        Complex, shape (F,).
    coherence
        Share of the output's power that follows the input, 0 to 1, shape (F,).
    averages
        Independent pieces of signal that it is the mean of.
    magnified
        Factor by which a formula that made the values enlarges relative errors, shape (F,).

    """

    frequencies_hz: Floats
    values: Complex
    coherence: Floats
    averages: int
    magnified: Floats | float = 1.0

    @property
    def error(self) -> Floats:
        """Standard deviation of |H| relative to it (Bendat and Piersol): sqrt((1 - g)/(2 n g)) of the coherence g."""
        share = np.clip(self.coherence, 1e-12, 1.0)
        return np.asarray(self.magnified * np.sqrt((1.0 - share) / (2.0 * self.averages * share)))

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Where the error is small enough."""
        return (self.error <= ERROR_MAX) & (self.coherence >= COHERENCE_MIN)

    @property
    def in_band(self) -> NDArray[np.bool_]:
        """Which frequencies lie in the band that is trusted, shape (F,)."""
        low, high = self.band_hz() or (np.inf, -np.inf)
        return (self.frequencies_hz >= low) & (self.frequencies_hz <= high)

    def band_hz(self) -> tuple[float, float] | None:
        """Longest band, in octaves, without a frequency that is not trustworthy; None: there is no such band."""
        best, first = None, None
        for k, good in enumerate([*self.trusted.tolist(), False]):
            if good and first is None:
                first = k
            elif not good and first is not None:
                low, high = float(self.frequencies_hz[first]), float(self.frequencies_hz[k - 1])
                if best is None or high / low > best[1] / best[0]:
                    best = low, high
                first = None
        return best


def response(
    x: Floats,
    y: Floats,
    sample_s: float,
    piece: int,
    instrument: Floats | None = None,
    lines: NDArray[np.int64] | None = None,
    drifts: bool = False,
) -> Measured:
    """Estimate the frequency response from x to y.

    Parameters
    ----------
    x, y
        Signals, shape (samples,).
    sample_s
        Distance of the samples.
    piece
        Samples that are transformed at once; of a signal that repeats, its period.
    instrument
        Signal that excites the loop from outside; None: x itself, the H1 estimate.
    lines
        Harmonics of ``piece`` that are excited, of a signal that repeats; None: any signal, with Hann windows that
        overlap by half.
    drifts
        Of a signal that repeats: whether slow changes of pose and load go with it. Then two periods at a time are
        transformed under a Hann window, which keeps the changes out of the lines.

    Raises
    ------
    TuningError
        The signals are too short for three pieces, or x does not move.

    """
    hann = lines is None or drifts
    if lines is not None and drifts:
        piece, lines = 2 * piece, 2 * lines
    overlap = piece // 2 if hann else 0
    pieces = 1 + (len(x) - piece) // (piece - overlap)
    if pieces < AVERAGES_MIN:
        raise TuningError(
            f'{len(x)} samples are too short for {AVERAGES_MIN} pieces of {piece} '
            f'({piece * sample_s:g} s): no spectrum can be averaged'
        )
    if not np.ptp(x) > 0.0:
        raise TuningError('the input does not move: there is no response to it')
    options = {
        'nperseg': piece,
        'noverlap': overlap,
        'window': 'hann' if hann else 'boxcar',
        'detrend': 'linear' if hann else 'constant',
    }

    def spectrum(a: Floats, b: Floats) -> tuple[Floats, Complex]:
        return signal.csd(a, b, fs=1.0 / sample_s, **options)  # type: ignore[no-any-return]

    r = x if instrument is None else instrument
    frequencies, rx = spectrum(r, x)
    keep = np.arange(1, len(frequencies)) if lines is None else lines
    (_, ry), (_, rr), (_, xx), (_, yy) = spectrum(r, y), spectrum(r, r), spectrum(x, x), spectrum(y, y)
    power = np.abs(rr)[keep]
    keep = keep[power > QUIET * power.max()]
    rx, ry, rr, xx, yy = (s[keep] for s in (rx, ry, np.abs(rr), np.abs(xx), np.abs(yy)))
    coherence = np.minimum(
        np.abs(rx) ** 2 / np.maximum(rr * xx, 1e-300), np.abs(ry) ** 2 / np.maximum(rr * yy, 1e-300)
    )
    # pieces that overlap by half under a Hann window count for about 0.95 of as many independent ones
    return Measured(frequencies[keep], ry / rx, np.minimum(coherence, 1.0), pieces)


def opened(sensitivity: Measured) -> Measured:
    """Return the open loop L = 1/S - 1 of a measured sensitivity; where L is small its errors are large."""
    values = 1.0 / sensitivity.values - 1.0
    magnified = 1.0 / np.maximum(np.abs(1.0 - sensitivity.values), 1e-12)
    return replace(sensitivity, values=values, magnified=magnified)
